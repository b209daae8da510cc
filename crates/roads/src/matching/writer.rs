//! CSV files of answers: routes, or the roads at each point.

use std::io::Write;

use csv::Writer;

use super::{MatchedDrive, Matcher};

/// Writer of the answers for drives as CSV. Each drive is flushed as soon as it is written.
#[derive(Debug)]
pub struct AnswerWriter<W: Write> {
    writer: Writer<W>,
    rows: Rows,
}

#[derive(Debug, Clone, Copy)]
enum Rows {
    Routes,
    Points { lag: usize },
}

impl<W: Write> AnswerWriter<W> {
    /// Creates a writer of routes: `trace,seq,from,to,enter_m,exit_m,off_road`, with one line per
    /// edge or stretch off the road and the ids of its nodes. A stretch off the road leads from the
    /// end node of the edge before to the start node of the edge after; either is empty without
    /// that edge.
    #[must_use]
    pub fn routes(writer: W) -> Self {
        Self { writer: Writer::from_writer(writer), rows: Rows::Routes }
    }

    /// Creates a writer of the live answers for the points of drives, the answers `lag` points
    /// late, and the smoothed ones:
    /// `trace,point,time,estimator,from,to,metres_along,probability,entropy,log_likelihood,off_road`.
    ///
    /// Off the road, both nodes are empty. `log_likelihood` is ln p(point | all before), the same
    /// for the three estimators; the entropy is in nats. Late answers equal those of a
    /// [`Vehicle`](super::Vehicle) up to rounding.
    #[must_use]
    pub fn points(writer: W, lag: usize) -> Self {
        Self { writer: Writer::from_writer(writer), rows: Rows::Points { lag } }
    }

    /// Writes the header. Of a file written in parts, only the first should have one.
    ///
    /// # Errors
    ///
    /// An error of the writer, as for all methods here.
    pub fn with_header(mut self) -> Result<Self, csv::Error> {
        let header = match self.rows {
            Rows::Routes => "trace,seq,from,to,enter_m,exit_m,off_road",
            Rows::Points { .. } => {
                "trace,point,time,estimator,from,to,metres_along,probability,entropy,log_likelihood,off_road"
            }
        };
        self.writer.write_record(header.split(','))?;
        self.flush()?;
        Ok(self)
    }

    /// Writes the answers for a drive.
    ///
    /// # Errors
    ///
    /// As [`with_header`](Self::with_header).
    pub fn write(
        &mut self,
        trace: &str,
        matcher: &Matcher,
        drive: &MatchedDrive,
    ) -> Result<(), csv::Error> {
        let edges = matcher.network().edges();
        let id = |node: Option<usize>| {
            node.map_or(String::new(), |node| matcher.network().nodes()[node].id.to_string())
        };
        let from = |edge: Option<usize>| id(edge.map(|edge| edges[edge].from));
        let to = |edge: Option<usize>| id(edge.map(|edge| edges[edge].to));
        let fixed = |value: f64, digits: usize| format!("{value:.digits$}");
        match self.rows {
            Rows::Routes => {
                let route = drive.route();
                for (seq, stretch) in route.iter().enumerate() {
                    let before = seq.checked_sub(1).and_then(|seq| route[seq].edge);
                    let after = route.get(seq + 1).and_then(|next| next.edge);
                    let is_off_road = stretch.edge.is_none();
                    self.writer.write_record([
                        trace,
                        &seq.to_string(),
                        &if is_off_road { to(before) } else { from(stretch.edge) },
                        &if is_off_road { from(after) } else { to(stretch.edge) },
                        &fixed(stretch.enter, 1),
                        &fixed(stretch.exit, 1),
                        if is_off_road { "1" } else { "0" },
                    ])?;
                }
            }
            Rows::Points { lag } => {
                for (number, point) in drive.points().iter().enumerate() {
                    let answers = [
                        ("live", drive.live(number)),
                        ("late", drive.late(number, lag)),
                        ("smoothed", drive.smoothed(number)),
                    ];
                    for (estimator, answer) in answers {
                        self.writer.write_record([
                            trace,
                            &number.to_string(),
                            &point.time.to_string(),
                            estimator,
                            &from(answer.edge),
                            &to(answer.edge),
                            &fixed(answer.metres_along, 1),
                            &fixed(answer.probability, 6),
                            &fixed(answer.entropy, 6),
                            &fixed(drive.log_normalizer(number), 6),
                            &fixed(answer.off_road, 6),
                        ])?;
                    }
                }
            }
        }
        self.flush()
    }

    /// Flushes what was written. A full disk may show only here.
    ///
    /// # Errors
    ///
    /// As [`with_header`](Self::with_header).
    pub fn flush(&mut self) -> Result<(), csv::Error> {
        Ok(self.writer.flush()?)
    }

    /// Flushes what was written, and returns the inner writer.
    ///
    /// # Errors
    ///
    /// As [`with_header`](Self::with_header).
    pub fn into_inner(self) -> Result<W, csv::Error> {
        self.writer.into_inner().map_err(|error| error.into_error().into())
    }
}
