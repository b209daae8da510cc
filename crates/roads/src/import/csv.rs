//! Networks from two CSV files.
//!
//! Every number is checked on its own line, so that an error names it; what is unusual but usable
//! is replaced and counted in the report.

use std::io::Read;
use std::path::Path;

use csv::StringRecord;

use super::report::{
    ImportNote, ImportOptions, ImportReport, LEAST_METRES, finish, position_problem,
};
use super::tags::{class_of, directions, speed_of};
use crate::{EdgeOptions, NetworkBuilder, NetworkError, RoadNetwork};
use wayfix::internal::{Row, Text, each_row, excerpt, open, unknown};
use wayfix::map::{Place, Position};

/// Names that a column may have, and whether it is required.
type Column = (&'static [&'static str], bool);

const NODES: [Column; 4] = [
    (&["node", "id"], true),
    (&["lat", "latitude"], true),
    (&["lon", "longitude"], true),
    (&["name"], false),
];

const EDGES: [Column; 6] = [
    (&["from"], true),
    (&["to"], true),
    (&["class"], false),
    (&["length_m", "metres"], false),
    (&["oneway"], false),
    (&["speed_kmh"], false),
];

impl RoadNetwork {
    /// Reads a network from two CSV files with headers.
    ///
    /// Nodes: `node,lat,lon` or `id,latitude,longitude`, in degrees, and optionally `name`. Edges:
    /// `from,to`, and optionally `class` (main, arterial, collector, street, or 3 to 0; street by
    /// default), `length_m` or `metres` (straight by default), `speed_kmh`, and `oneway` (yes, no,
    /// -1). Without the column `oneway`, edges lead in one direction; with it, in both where it is
    /// no or empty. Columns may be in any order; the report names unknown ones. Parallel edges and
    /// loops are kept. O((nodes + edges) log).
    ///
    /// A length of 0, as from rounding, is replaced by that of the straight line, and if this is
    /// below 0.1 m, by 0.1 m; a loop without a length is skipped. All are counted.
    ///
    /// # Errors
    ///
    /// [`NetworkError::Line`] with file and line for a missing column, a value that can't be
    /// parsed, a node given twice or not on Earth (with a hint if latitude and longitude seem
    /// swapped), and an edge with a missing node or a negative length; [`NetworkError::Read`] if a
    /// file can't be opened or read; and those of [`cleaned`](Self::cleaned).
    pub fn from_csv_files(
        nodes: impl AsRef<Path>,
        edges: impl AsRef<Path>,
        options: &ImportOptions,
    ) -> Result<(Self, ImportReport), NetworkError> {
        let (nodes, nodes_reader) = open(nodes.as_ref())?;
        let (edges, edges_reader) = open(edges.as_ref())?;
        read((&nodes, nodes_reader), (&edges, edges_reader), options)
    }

    /// Reads a network from two readers, as [`from_csv_files`](Self::from_csv_files) does from
    /// files; errors call them "nodes" and "edges".
    ///
    /// ```
    /// use wayfix_roads::{ImportNote, ImportOptions, RoadNetwork};
    ///
    /// let nodes = "node,lon,lat\n7,149.13,-35.28\n8,149.13,-35.29\n";
    /// let edges = "from,to,class,length_m,oneway\n7,8,2,1113.2,no\n7,8,0,0,yes\n";
    /// let options = ImportOptions::default();
    /// let (network, report) = RoadNetwork::from_csv(nodes.as_bytes(), edges.as_bytes(), &options)?;
    /// assert_eq!(network.edges().len(), 3);
    /// assert_eq!(report.count(ImportNote::ZeroLength), 1);
    ///
    /// let edges = "from,to\n7,9\n";
    /// let error = RoadNetwork::from_csv(nodes.as_bytes(), edges.as_bytes(), &options).unwrap_err();
    /// assert_eq!(
    ///     error.to_string(),
    ///     "edges, line 2: the road from place 7 to place 9 needs place 9, which does not exist"
    /// );
    /// # Ok::<(), wayfix_roads::NetworkError>(())
    /// ```
    ///
    /// # Errors
    ///
    /// As [`from_csv_files`](Self::from_csv_files).
    pub fn from_csv(
        nodes: impl Read,
        edges: impl Read,
        options: &ImportOptions,
    ) -> Result<(Self, ImportReport), NetworkError> {
        read(("nodes", nodes), ("edges", edges), options)
    }
}

fn read(
    nodes: (&str, impl Read),
    edges: (&str, impl Read),
    options: &ImportOptions,
) -> Result<(RoadNetwork, ImportReport), NetworkError> {
    let (mut builder, mut report) = (NetworkBuilder::new(), ImportReport::default());
    let ignored = each_line(nodes, NODES, |row| {
        let position = Position { latitude: row.number(1)?, longitude: row.number(2)? };
        if let Some(problem) = position_problem(position) {
            return Err(problem);
        }
        let place = Place { id: row.id(0)?, position, name: row.text(3).to_owned() };
        builder.place(place).map(|_| ()).map_err(|error| error.to_string())
    })?;
    report.ignored_columns = ignored;
    let ignored = each_line(edges, EDGES, |row| edge(&row, &mut builder, &mut report))?;
    report.ignored_columns.extend(ignored);
    finish(builder, report, options)
}

/// Adds the edge of a row, in each of its directions.
fn edge(
    row: &Row<'_>,
    builder: &mut NetworkBuilder,
    report: &mut ImportReport,
) -> Result<(), String> {
    let (from, to) = (row.id(0)?, row.id(1)?);
    let mut options = EdgeOptions::of(class_of(&excerpt(row.text(2)))?);
    if !row.text(3).is_empty() {
        options.metres = Some(row.number(3)?);
        // Loops of length 0 get a note of their own, further down.
        if options.metres == Some(0.0) {
            options.metres = None;
            if from != to {
                report.note(ImportNote::ZeroLength);
            }
        }
    }
    let [forward, backward] = if row.has(4) {
        directions(row.text(4)).ok_or_else(|| row.unexpected(4, "yes, no or -1"))?
    } else {
        // Without the column, each direction has a row of its own.
        [true, false]
    };
    if !row.text(5).is_empty() {
        options.speed = speed_of(row.text(5));
        if options.speed.is_none() {
            report.note(ImportNote::UnknownSpeed);
        }
    }
    if options.metres.is_none() {
        // A loop has no straight line to take its length from.
        let Some(metres) = builder.metres_between(from, to).map_err(|error| error.to_string())?
        else {
            report.note(ImportNote::LoopWithoutLength);
            return Ok(());
        };
        if metres < LEAST_METRES {
            report.note(ImportNote::ShortLine);
        }
        options.metres = Some(metres.max(LEAST_METRES));
    }
    let mut add =
        |[from, to]: [u64; 2]| builder.edge(from, to, options.clone()).map_err(|e| e.to_string());
    let there = if forward { Some(add([from, to])?) } else { None };
    let back = if backward { Some(add([to, from])?) } else { None };
    if let (Some(there), Some(back)) = (there, back) {
        builder.pair(there, back);
    }
    Ok(())
}

/// Calls `take` with each line after the header, whose columns may be in any order. Returns the
/// unknown ones.
fn each_line<const N: usize>(
    (file, reader): (&str, impl Read),
    names: [Column; N],
    mut take: impl FnMut(Row<'_>) -> Result<(), String>,
) -> Result<Vec<String>, NetworkError> {
    let mut ignored = Vec::new();
    let find = |header: &StringRecord| {
        let columns = names.map(|(names, _)| header.iter().position(|name| names.contains(&name)));
        for (column, (names, required)) in columns.iter().zip(names) {
            if required && column.is_none() {
                let found = header.iter().collect::<Vec<_>>().join(",");
                let (names, found) = (names.join(" or "), excerpt(&found));
                return Err(format!("no column {names} in the header {found:?}"));
            }
        }
        ignored.extend(unknown(header, &columns).map(|name| format!("{name} in {file}")));
        Ok(columns)
    };
    let take = |row: Row<'_>| match (row.len(), row.width) {
        (found, width) if found != width => {
            Err(format!("{found} columns, expected {width} as in the header"))
        }
        _ => take(row),
    };
    each_row((file, reader), Text::Strict, &names.map(|(names, _)| names[0]), find, take)?;
    Ok(ignored)
}
