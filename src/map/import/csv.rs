//! Networks from two CSV files.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use csv::{ReaderBuilder, StringRecord, Trim};

use super::words::{class_of, directions, speed_of};
use super::{
    ImportNote, ImportOptions, ImportReport, LEAST_METRES, finish, open, position_problem,
};
use crate::map::excerpt::excerpt;
use crate::map::fields::{Line, csv_error};
use crate::map::{EdgeOptions, MapError, NetworkBuilder, Position, RoadNetwork};

/// Names of a column, and whether a file must have it.
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
    (&["length_m"], false),
    (&["oneway"], false),
    (&["speed_kmh"], false),
];

impl RoadNetwork {
    /// Reads a network from two CSV files with headers.
    ///
    /// Nodes: `node,lat,lon` or `id,latitude,longitude`, in degrees. Edges: `from,to`, and if known
    /// `class` (main, arterial, collector, street, or 3 to 0; otherwise a street), `length_m`
    /// (otherwise straight), `speed_kmh`, and `oneway` (yes, no, -1). Without the column `oneway`
    /// edges lead in one direction; with it, in both where it says no or nothing. Columns stand
    /// in any order; the report names those that are not known. Parallel edges and loops are kept.
    /// O((nodes + edges) log).
    ///
    /// A length of 0, as from rounding, is replaced by that of the straight line, and one below
    /// 0.1 m by that; a loop without a length is skipped. All are counted.
    ///
    /// # Errors
    ///
    /// [`MapError::Line`] with file and line for a missing column, a value that can't be parsed, a
    /// node given twice or not on Earth (which says so if latitude and longitude seem swapped), and
    /// an edge of a node that is missing or with a negative length; [`MapError::Read`] if a file
    /// can't be opened or read; and those of [`cleaned`](Self::cleaned).
    pub fn from_csv_files(
        nodes: impl AsRef<Path>,
        edges: impl AsRef<Path>,
        options: &ImportOptions,
    ) -> Result<(Self, ImportReport), MapError> {
        let (nodes, nodes_reader): (_, File) = open(nodes.as_ref())?;
        let (edges, edges_reader): (_, File) = open(edges.as_ref())?;
        read((&nodes, nodes_reader), (&edges, edges_reader), options)
    }

    /// Reads a network from two readers, as [`from_csv_files`](Self::from_csv_files); errors call
    /// them "nodes" and "edges".
    ///
    /// ```
    /// use wayfix::map::{ImportNote, ImportOptions, RoadNetwork};
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
    /// # Ok::<(), wayfix::map::MapError>(())
    /// ```
    ///
    /// # Errors
    ///
    /// As [`from_csv_files`](Self::from_csv_files).
    pub fn from_csv(
        nodes: impl Read,
        edges: impl Read,
        options: &ImportOptions,
    ) -> Result<(Self, ImportReport), MapError> {
        read(("nodes", nodes), ("edges", edges), options)
    }
}

fn read(
    nodes: (&str, impl Read),
    edges: (&str, impl Read),
    options: &ImportOptions,
) -> Result<(RoadNetwork, ImportReport), MapError> {
    let (mut builder, mut report) = (NetworkBuilder::new(), ImportReport::default());
    let ignored = each_row(nodes, NODES, |row| {
        let position = Position { latitude: row.number(1)?, longitude: row.number(2)? };
        if let Some(problem) = position_problem(position) {
            return Err(problem);
        }
        builder.node(row.id(0)?, position).map(|_| ()).map_err(|error| error.to_string())
    })?;
    report.ignored_columns = ignored;
    let ignored = each_row(edges, EDGES, |row| edge(&row, &mut builder, &mut report))?;
    report.ignored_columns.extend(ignored);
    finish(builder, report, options)
}

/// Adds the edge of a row, or both.
fn edge(
    row: &Line<'_>,
    builder: &mut NetworkBuilder,
    report: &mut ImportReport,
) -> Result<(), String> {
    let (from, to) = (row.id(0)?, row.id(1)?);
    let mut options = EdgeOptions::of(class_of(&excerpt(row.text(2)))?);
    if !row.text(3).is_empty() {
        options.metres = Some(row.number(3)?);
        if options.metres == Some(0.0) {
            options.metres = None;
            if from != to {
                report.note(ImportNote::ZeroLength);
            }
        }
    }
    let [forward, backward] = match row.places[4] {
        None => [true, false],
        Some(_) => directions(row.text(4)).ok_or_else(|| {
            format!("oneway is {:?}, expected yes, no or -1", excerpt(row.text(4)))
        })?,
    };
    if !row.text(5).is_empty() {
        options.speed = speed_of(row.text(5));
        if options.speed.is_none() {
            report.note(ImportNote::UnknownSpeed);
        }
    }
    if options.metres.is_none() {
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

/// Calls `take` with each line after the header, and adds file and line to its errors. Returns the
/// columns that are not known.
fn each_row<const N: usize>(
    (file, reader): (&str, impl Read),
    names: [Column; N],
    mut take: impl FnMut(Line<'_>) -> Result<(), String>,
) -> Result<Vec<String>, MapError> {
    let at = |line, problem| MapError::Line { file: file.to_owned(), line, problem };
    let mut reader =
        ReaderBuilder::new().has_headers(false).flexible(true).trim(Trim::All).from_reader(reader);
    let mut record = StringRecord::new();
    let first_names = names.map(|(names, _)| names[0]);
    let mut header: Option<([Option<usize>; N], usize)> = None;
    let mut ignored = Vec::new();
    loop {
        let line = reader.position().line();
        let more =
            reader.read_record(&mut record).map_err(|error| csv_error(file, line, &error))?;
        let line = record.position().map_or(line, csv::Position::line);
        let Some((columns, width)) = &header else {
            let columns =
                names.map(|(names, _)| record.iter().position(|name| names.contains(&name)));
            for (column, (names, required)) in columns.iter().zip(names) {
                if required && column.is_none() {
                    let found = if more {
                        record.iter().collect::<Vec<_>>().join(",")
                    } else {
                        String::new()
                    };
                    let names = names.join(" or ");
                    return Err(at(
                        line,
                        format!("no column {names} in the header {:?}", excerpt(&found)),
                    ));
                }
            }
            let known = |place: usize| columns.contains(&Some(place));
            let unknown = record.iter().enumerate().filter(|&(place, _)| !known(place));
            ignored.extend(unknown.map(|(_, name)| format!("{} in {file}", excerpt(name))));
            header = Some((columns, record.len()));
            continue;
        };
        if !more {
            return Ok(ignored);
        }
        if record.len() != *width {
            return Err(at(
                line,
                format!("{} columns, expected {width} as in the header", record.len()),
            ));
        }
        let row = Line { record: &record, places: columns, names: &first_names };
        take(row).map_err(|problem| at(line, problem))?;
    }
}
