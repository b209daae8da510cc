//! True routes from a file.

use std::collections::HashMap;
use std::path::Path;

use csv::{ReaderBuilder, StringRecord, Trim};
use wayfix::map::RoadNetwork;
use wayfix::matching::{Trace, TracePoint};

/// Edges of a true route.
pub(crate) struct Truth(Vec<usize>);

/// True routes by the names of their drives.
#[derive(Default)]
pub(crate) struct Truths(HashMap<String, Truth>);

const COLUMNS: [&str; 4] = ["trace", "order", "from", "to"];

impl Truths {
    /// Reads `trace,order,from,to`, with columns and lines in any order.
    pub(crate) fn read(
        path: &Path,
        network: &RoadNetwork,
        traces: &[Trace],
    ) -> Result<Self, String> {
        let file = path.display();
        let mut reader = ReaderBuilder::new()
            .trim(Trim::All)
            .from_path(path)
            .map_err(|error| format!("cannot read {file}: {error}"))?;
        let failed = |error: csv::Error| format!("{file}: {error}");
        let header = reader.headers().map_err(failed)?.clone();
        let mut columns = [0; 4];
        for (column, name) in columns.iter_mut().zip(COLUMNS) {
            *column = header.iter().position(|found| found == name).ok_or_else(|| {
                let header: Vec<&str> = header.iter().collect();
                format!(
                    "{file}, line 1: the header {:?} has no column {name}, expected trace,order,from,to",
                    header.join(",")
                )
            })?;
        }
        let names: std::collections::HashSet<&str> =
            traces.iter().map(|trace| trace.name.as_str()).collect();
        let mut routes: HashMap<String, Vec<(u64, usize)>> = HashMap::new();
        let mut record = StringRecord::new();
        while reader.read_record(&mut record).map_err(failed)? {
            let line = record.position().map_or(0, csv::Position::line);
            let at = |problem: String| format!("{file}, line {line}: {problem}");
            let name = &record[columns[0]];
            if !names.contains(name) {
                return Err(at(format!("there is no drive {name:?} among the traces")));
            }
            let number = |column: usize| {
                let text = &record[columns[column]];
                let expected = || at(format!("{} is {text:?}, expected a number", COLUMNS[column]));
                text.parse::<u64>().map_err(|_| expected())
            };
            let ids = [number(2)?, number(3)?];
            let mut ends = [0; 2];
            for (end, id) in ends.iter_mut().zip(ids) {
                let found = network.index_of_id(id);
                *end = found.ok_or_else(|| at(format!("the roads have no node {id}")))?;
            }
            let edge = network.edge_between(ends[0], ends[1]).ok_or_else(|| {
                at(format!("there is no road from node {} to {}", ids[0], ids[1]))
            })?;
            routes.entry(name.to_owned()).or_default().push((number(1)?, edge));
        }
        if routes.is_empty() {
            return Err(format!("{file}, line 2: there are no roads, expected at least one"));
        }
        let in_order = |mut route: Vec<(u64, usize)>| {
            route.sort_by_key(|step| step.0);
            Truth(route.into_iter().map(|step| step.1).collect())
        };
        Ok(Self(routes.into_iter().map(|(name, route)| (name, in_order(route))).collect()))
    }

    pub(crate) fn take(&mut self, name: &str) -> Option<Truth> {
        self.0.remove(name)
    }
}

impl Truth {
    /// Edges that were driven by the points, and the metres along the first and along the last
    /// edge, as far as the first and the last point tell. `tail` has points after the last, which
    /// were left out.
    pub(crate) fn driven(
        &self,
        network: &RoadNetwork,
        points: &[TracePoint],
        tail: &[TracePoint],
    ) -> (&[usize], [f64; 2]) {
        let project = |edge: usize, point: &TracePoint| network.project(edge, point.position);
        let [first, last] = [&points[0], &points[points.len() - 1]];
        let mut count = self.0.len();
        if !tail.is_empty() {
            // The end is the nearest road to the last point, as far back as the vehicle may have
            // come since.
            let mut before = last.position;
            let moved = |point: &TracePoint| {
                let before = std::mem::replace(&mut before, point.position);
                before.metres_to(point.position)
            };
            let most = 200.0 + 1.5 * tail.iter().map(moved).sum::<f64>();
            let (mut back, mut nearest) = (0.0, f64::INFINITY);
            for (number, &edge) in self.0.iter().enumerate().rev() {
                let off = project(edge, last).metres_off;
                if off < nearest {
                    (nearest, count) = (off, number + 1);
                }
                back += network.edges()[edge].metres;
                if back > most {
                    break;
                }
            }
        }
        let edges = &self.0[..count];
        let ends = [(edges[0], first), (edges[count - 1], last)];
        (edges, ends.map(|(edge, point)| project(edge, point).metres_along))
    }
}
