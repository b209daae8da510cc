//! True routes from a file.

use std::collections::HashMap;
use std::path::Path;

use csv::{ReaderBuilder, StringRecord, Trim};
use wayfix_roads::RoadNetwork;
use wayfix_roads::matching::{Trace, TracePoint};

use super::roads::measures::Driven;

/// A true route.
#[derive(Default)]
pub(crate) struct Truth {
    driven: Vec<Driven>,
    /// Known times of the first points on parts of the route, and true for parts off the road.
    times: Vec<(f64, bool)>,
}

/// True routes by the names of their drives.
#[derive(Default)]
pub(crate) struct Truths(HashMap<String, Truth>);

const COLUMNS: [&str; 4] = ["trace", "order", "from", "to"];
/// Optional columns: metres along the edge where it was entered and left, and the time of the first
/// point on it.
const MORE: [&str; 3] = ["enter_m", "exit_m", "time"];

/// Line of a file: the edge (`None` off the road) and the optional numbers.
type Line = (Option<usize>, [Option<f64>; 3]);

impl Truths {
    /// Reads `trace,order,from,to[,enter_m,exit_m,time]`, with columns and lines in any order. Off
    /// the road both nodes are empty.
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
        let more = MORE.map(|name| header.iter().position(|found| found == name));
        // Lines come in any order, so routes are collected first and sorted below.
        let mut routes: HashMap<String, Vec<(u64, Line)>> = HashMap::new();
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
            let mut known = [None; 3];
            for (value, (column, name)) in known.iter_mut().zip(more.into_iter().zip(MORE)) {
                let text = column.map_or("", |column| &record[column]);
                // `parse` accepts NaN and infinity, neither of them a distance or a time.
                let parsed = text.parse().ok().filter(|number: &f64| number.is_finite());
                if parsed.is_none() && !text.is_empty() {
                    return Err(at(format!("{name} is {text:?}, expected a number")));
                }
                *value = parsed;
            }
            // Only both nodes empty mean off the road: one alone is a mistake, which `number`
            // reports.
            let edge = if record[columns[2]].is_empty() && record[columns[3]].is_empty() {
                None
            } else {
                let ids = [number(2)?, number(3)?];
                let mut ends = [0; 2];
                for (end, id) in ends.iter_mut().zip(ids) {
                    let found = network.index_of_id(id);
                    *end = found.ok_or_else(|| at(format!("the roads have no node {id}")))?;
                }
                Some(network.edge_between(ends[0], ends[1]).ok_or_else(|| {
                    at(format!("there is no road from node {} to {}", ids[0], ids[1]))
                })?)
            };
            routes.entry(name.to_owned()).or_default().push((number(1)?, (edge, known)));
        }
        if let Some((name, _)) =
            routes.iter().find(|(_, lines)| lines.iter().all(|line| line.1.0.is_none()))
        {
            return Err(format!("{file}: drive {name} has no roads, expected at least one"));
        }
        if routes.is_empty() {
            return Err(format!("{file}, line 2: there are no roads, expected at least one"));
        }
        let in_order = |mut route: Vec<(u64, Line)>| {
            route.sort_by_key(|step| step.0);
            let mut truth = Truth::default();
            for (_, (edge, [enter, exit, time])) in route {
                // In the order of the route: the last one up to a point tells where the point was.
                truth.times.extend(time.map(|time| (time, edge.is_none())));
                // Without metres, the whole edge was driven.
                let whole = |edge: usize| network.edges()[edge].metres;
                let part = |edge| (edge, [enter.unwrap_or(0.0), exit.unwrap_or(whole(edge))]);
                truth.driven.extend(edge.map(part));
            }
            truth
        };
        Ok(Self(routes.into_iter().map(|(name, route)| (name, in_order(route))).collect()))
    }

    pub(crate) fn take(&mut self, name: &str) -> Option<Truth> {
        self.0.remove(name)
    }
}

impl Truth {
    /// True if the vehicle was off the road at a point; `None` before the first known time.
    pub(crate) fn is_off_road(&self, point: &TracePoint) -> Option<bool> {
        let last = self.times.iter().rev().find(|(time, _)| *time <= point.time);
        last.map(|(_, is_off_road)| *is_off_road)
    }

    /// Edges driven between the first and the last point, with the parts of the first and last edge
    /// that these points tell. `tail` has the points after the last one, which were left out.
    pub(crate) fn driven(
        &self,
        network: &RoadNetwork,
        points: &[TracePoint],
        tail: &[TracePoint],
    ) -> Vec<Driven> {
        let project = |edge: usize, point: &TracePoint| network.project(edge, point.position);
        let [first, last] = [&points[0], &points[points.len() - 1]];
        let mut count = self.driven.len();
        if !tail.is_empty() {
            // The true route ends later than the points. Its edge nearest to the last point is the
            // end, searched backwards for as far as the vehicle may have driven since.
            let mut before = last.position;
            let moved = |point: &TracePoint| {
                let before = std::mem::replace(&mut before, point.position);
                before.metres_to(point.position)
            };
            // Roads are longer than the straight lines between points.
            let most = 200.0 + 1.5 * tail.iter().map(moved).sum::<f64>();
            let (mut back, mut nearest) = (0.0, f64::INFINITY);
            for (number, &(edge, _)) in self.driven.iter().enumerate().rev() {
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
        let mut driven = self.driven[..count].to_vec();
        let along = |edge: usize, point| project(edge, point).metres_along;
        // `read` ensures at least one edge.
        driven[0].1[0] = along(driven[0].0, first);
        driven[count - 1].1[1] = along(driven[count - 1].0, last);
        driven
    }
}
