//! Answers to CSV files.

use std::io::Write;

use csv::Writer;

use super::{MatchedDrive, Matcher, RoadAnswer};

const ROUTE: [&str; 7] = ["trace", "seq", "from", "to", "enter_m", "exit_m", "off_road"];
const POINT: [&str; 11] = [
    "trace",
    "point",
    "time",
    "estimator",
    "from",
    "to",
    "metres_along",
    "probability",
    "entropy",
    "log_likelihood",
    "off_road",
];

/// Writer of routes: `trace,seq,from,to,enter_m,exit_m,off_road`, a line for each edge or stretch
/// off the road, with nodes as in the input.
#[derive(Debug)]
pub struct RouteWriter<W: Write> {
    writer: Writer<W>,
}

impl<W: Write> RouteWriter<W> {
    /// Creates a writer, and writes the header.
    ///
    /// # Errors
    ///
    /// An error of the writer, as for all methods here.
    pub fn new(writer: W) -> Result<Self, csv::Error> {
        let mut new = Self::without_header(writer);
        new.writer.write_record(ROUTE)?;
        new.writer.flush()?;
        Ok(new)
    }

    /// Creates a writer of lines alone, for one of several parts of a file.
    #[must_use]
    pub fn without_header(writer: W) -> Self {
        Self { writer: Writer::from_writer(writer) }
    }

    /// Passes on all that was written; an error tells of a full disk. Each drive is passed on when
    /// it is written.
    ///
    /// # Errors
    ///
    /// As [`new`](Self::new).
    pub fn flush(&mut self) -> Result<(), csv::Error> {
        Ok(self.writer.flush()?)
    }

    /// Passes on all that was written, and returns the writer.
    ///
    /// # Errors
    ///
    /// As [`new`](Self::new).
    pub fn into_inner(self) -> Result<W, csv::Error> {
        self.writer.into_inner().map_err(|error| error.into_error().into())
    }

    /// Writes the route of a drive. A stretch off the road is from the node where the road was
    /// left to the one where it is reached again; empty, where there is none.
    ///
    /// # Errors
    ///
    /// As [`new`](Self::new).
    pub fn write(
        &mut self,
        trace: &str,
        matcher: &Matcher,
        drive: &MatchedDrive,
    ) -> Result<(), csv::Error> {
        let id = |node: usize| matcher.network().nodes()[node].id.to_string();
        let edges = matcher.network().edges();
        for (seq, stretch) in drive.route().iter().enumerate() {
            let nodes = if let Some(edge) = stretch.edge {
                [id(edges[edge].from), id(edges[edge].to)]
            } else {
                let before = seq.checked_sub(1).and_then(|seq| drive.route()[seq].edge);
                let after = drive.route().get(seq + 1).and_then(|next| next.edge);
                let end = |node: Option<usize>| node.map_or(String::new(), id);
                [end(before.map(|edge| edges[edge].to)), end(after.map(|edge| edges[edge].from))]
            };
            let metres = [stretch.enter, stretch.exit].map(|metres| format!("{metres:.1}"));
            let off_road = if stretch.edge.is_some() { "0" } else { "1" };
            let [from, to] = nodes;
            let [enter, exit] = metres;
            self.writer.write_record([
                trace,
                &seq.to_string(),
                &from,
                &to,
                &enter,
                &exit,
                off_road,
            ])?;
        }
        Ok(self.writer.flush()?)
    }
}

/// Writer of answers for points:
/// `trace,point,time,estimator,from,to,metres_along,probability,entropy,log_likelihood,off_road`.
#[derive(Debug)]
pub struct PointWriter<W: Write> {
    writer: Writer<W>,
}

impl<W: Write> PointWriter<W> {
    /// Creates a writer, and writes the header.
    ///
    /// # Errors
    ///
    /// An error of the writer, as for all methods here.
    pub fn new(writer: W) -> Result<Self, csv::Error> {
        let mut new = Self::without_header(writer);
        new.writer.write_record(POINT)?;
        new.writer.flush()?;
        Ok(new)
    }

    /// Creates a writer of lines alone, for one of several parts of a file.
    #[must_use]
    pub fn without_header(writer: W) -> Self {
        Self { writer: Writer::from_writer(writer) }
    }

    /// Passes on all that was written; an error tells of a full disk. Each drive is passed on when
    /// it is written.
    ///
    /// # Errors
    ///
    /// As [`new`](Self::new).
    pub fn flush(&mut self) -> Result<(), csv::Error> {
        Ok(self.writer.flush()?)
    }

    /// Passes on all that was written, and returns the writer.
    ///
    /// # Errors
    ///
    /// As [`new`](Self::new).
    pub fn into_inner(self) -> Result<W, csv::Error> {
        self.writer.into_inner().map_err(|error| error.into_error().into())
    }

    /// Writes the live answers of a drive, those `lag` points late, and the smoothed ones. Off the
    /// road, both nodes are empty. `log_likelihood` is ln p(point | all before), the same for the
    /// three estimators; the entropy is in nats. Late answers equal those of a
    /// [`Vehicle`](super::Vehicle) up to rounding.
    ///
    /// # Errors
    ///
    /// As [`new`](Self::new).
    pub fn write(
        &mut self,
        trace: &str,
        matcher: &Matcher,
        drive: &MatchedDrive,
        lag: usize,
    ) -> Result<(), csv::Error> {
        for point in 0..drive.points().len() {
            let answers = [
                ("live", drive.live(point)),
                ("late", drive.late(point, lag)),
                ("smoothed", drive.smoothed(point)),
            ];
            for (estimator, answer) in answers {
                let log = drive.log_normalizer(point);
                let time = drive.points()[point].time;
                self.line([trace, estimator], (point, time), matcher, &answer, log)?;
            }
        }
        Ok(self.writer.flush()?)
    }

    fn line(
        &mut self,
        [trace, estimator]: [&str; 2],
        (point, time): (usize, f64),
        matcher: &Matcher,
        answer: &RoadAnswer,
        log_likelihood: f64,
    ) -> Result<(), csv::Error> {
        let network = matcher.network();
        let id = |node: usize| network.nodes()[node].id.to_string();
        let edge = answer.edge.map(|edge| &network.edges()[edge]);
        self.writer.write_record([
            trace,
            &point.to_string(),
            &time.to_string(),
            estimator,
            &edge.map_or(String::new(), |edge| id(edge.from)),
            &edge.map_or(String::new(), |edge| id(edge.to)),
            &format!("{:.1}", answer.metres_along),
            &format!("{:.6}", answer.probability),
            &format!("{:.6}", answer.entropy),
            &format!("{log_likelihood:.6}"),
            &format!("{:.6}", answer.off_road),
        ])
    }
}
