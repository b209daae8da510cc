//! Options and report of an import, and what all formats share: checks of positions, and the last
//! steps.

use std::collections::BTreeMap;
use std::fmt;

use crate::{Cleaning, CleaningStep, NetworkBuilder, NetworkError, RoadNetwork};
use wayfix::internal::Number;
use wayfix::map::Position;

/// Options of an import: which roads are read, and how the network is cleaned.
///
/// Service roads, tracks and private roads are recognised in OpenStreetMap extracts and in GeoJSON
/// features with a `highway` property; all roads of CSV files are read.
///
/// ```
/// use wayfix_roads::{Cleaning, ImportOptions};
///
/// let options = ImportOptions::default()
///     .with_parking_aisles(false)
///     .with_cleaning(vec![Cleaning::LargestComponent, Cleaning::Contraction]);
/// assert!(options.service_roads);
/// ```
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
#[expect(clippy::struct_excessive_bools, reason = "each is a kind of road, chosen by itself")]
pub struct ImportOptions {
    /// Roads to and on private ground, car parks and depots (`highway=service`); true by default.
    pub service_roads: bool,
    /// Aisles of car parks and driveways, if service roads are read; true by default.
    pub parking_aisles: bool,
    /// Farm and forest tracks (`highway=track`); false by default.
    pub tracks: bool,
    /// Roads closed to the public (`access=private`, `no` and the like); false by default.
    pub private_roads: bool,
    /// Operations that [clean](crate::RoadNetwork::cleaned) the network after reading; none by
    /// default.
    pub cleaning: Vec<Cleaning>,
}

impl Default for ImportOptions {
    fn default() -> Self {
        Self {
            service_roads: true,
            parking_aisles: true,
            tracks: false,
            private_roads: false,
            cleaning: Vec::new(),
        }
    }
}

impl ImportOptions {
    /// Sets whether service roads are read.
    #[must_use]
    pub fn with_service_roads(self, service_roads: bool) -> Self {
        Self { service_roads, ..self }
    }

    /// Sets whether aisles of car parks and driveways are read.
    #[must_use]
    pub fn with_parking_aisles(self, parking_aisles: bool) -> Self {
        Self { parking_aisles, ..self }
    }

    /// Sets whether tracks are read.
    #[must_use]
    pub fn with_tracks(self, tracks: bool) -> Self {
        Self { tracks, ..self }
    }

    /// Sets whether roads closed to the public are read.
    #[must_use]
    pub fn with_private_roads(self, private_roads: bool) -> Self {
        Self { private_roads, ..self }
    }

    /// Sets the operations that clean the network after reading.
    #[must_use]
    pub fn with_cleaning(self, cleaning: Vec<Cleaning>) -> Self {
        Self { cleaning, ..self }
    }
}

/// Counts of an import: the network as read, the roads skipped and values replaced, and the
/// cleaning after it.
#[derive(Debug, Clone, PartialEq, Default)]
#[non_exhaustive]
pub struct ImportReport {
    /// Nodes read.
    pub nodes: usize,
    /// Directed edges read.
    pub edges: usize,
    /// Forbidden turns read, as pairs of edges.
    pub forbidden_turns: usize,
    /// Steps of the cleaning, in order.
    pub cleaning: Vec<CleaningStep>,
    /// Unknown columns of CSV files, each with its file.
    pub ignored_columns: Vec<String>,
    notes: BTreeMap<ImportNote, usize>,
}

/// Kind of data that the network does not contain as the file has it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum ImportNote {
    /// A way not for cars, or of a kind that the options exclude: skipped.
    NotDrivable,
    /// A road closed to the public: skipped.
    Closed,
    /// An area: skipped.
    Area,
    /// A road with nodes that the file does not contain, as at the border of an extract: cut there.
    MissingNode,
    /// A line of fewer than two points: skipped.
    NoLine,
    /// A geometry other than a line, or a feature without a geometry: skipped.
    OtherGeometry,
    /// A loop without a length: skipped.
    LoopWithoutLength,
    /// A length of 0: replaced by that of the straight line.
    ZeroLength,
    /// A straight line of less than 0.1 m: its length replaced by 0.1 m.
    ShortLine,
    /// A speed that is not a number, such as `CH:urban`, or is not above 0 and at most 1e9 m/s:
    /// ignored.
    UnknownSpeed,
    /// A road whose direction changes with the hour: read as two-way.
    Reversible,
    /// A turn restriction that leads through a way instead of a node: not used.
    RestrictionThroughWay,
    /// A turn restriction that does not apply to cars: not used.
    RestrictionForOthers,
    /// A turn restriction that applies at some hours: not used.
    RestrictionByHour,
    /// A turn restriction of unknown kind, or whose roads are not in the network or do not meet at
    /// its node: not used.
    RestrictionUnused,
}

impl fmt::Display for ImportNote {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NotDrivable => "ways not for cars or not chosen, skipped",
            Self::Closed => "roads closed to the public, skipped",
            Self::Area => "areas, skipped",
            Self::MissingNode => "roads cut at nodes that the file does not contain",
            Self::NoLine => "lines of fewer than two points, skipped",
            Self::OtherGeometry => "geometries missing or other than lines, skipped",
            Self::LoopWithoutLength => "loops without length, skipped",
            Self::ZeroLength => "lengths of 0, replaced by the straight line's",
            Self::ShortLine => "lengths below 0.1 m, replaced by 0.1 m",
            Self::UnknownSpeed => "speeds that are not a number in range, ignored",
            Self::Reversible => "reversible roads, taken as two-way",
            Self::RestrictionThroughWay => "turn restrictions through a way, not used",
            Self::RestrictionForOthers => "turn restrictions not for cars, not used",
            Self::RestrictionByHour => "turn restrictions by the hour, not used",
            Self::RestrictionUnused => "turn restrictions without their roads, not used",
        })
    }
}

impl ImportReport {
    /// Count of a note.
    #[must_use]
    pub fn count(&self, note: ImportNote) -> usize {
        self.notes.get(&note).copied().unwrap_or(0)
    }

    /// Notes with counts above 0, each with its count.
    #[must_use]
    pub fn notes(&self) -> impl ExactSizeIterator<Item = (ImportNote, usize)> {
        self.notes.iter().map(|(&note, &count)| (note, count))
    }

    pub(super) fn note(&mut self, note: ImportNote) {
        *self.notes.entry(note).or_default() += 1;
    }
}

/// Prints the counts of the network, then one line for each note, unknown column and step of
/// cleaning.
impl fmt::Display for ImportReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "read {} nodes, {} edges", self.nodes, self.edges)?;
        if self.forbidden_turns > 0 {
            write!(f, ", {} forbidden turns", self.forbidden_turns)?;
        }
        for (note, count) in self.notes() {
            write!(f, "\n{count} {note}")?;
        }
        for column in &self.ignored_columns {
            write!(f, "\nunknown column: {column}")?;
        }
        self.cleaning.iter().try_for_each(|step| write!(f, "\n{step}"))
    }
}

/// Length in metres that replaces shorter straight lines.
pub(super) const LEAST_METRES: f64 = 0.1;

/// Builds and cleans a network, and completes the report.
pub(super) fn finish(
    builder: NetworkBuilder,
    mut report: ImportReport,
    options: &ImportOptions,
) -> Result<(RoadNetwork, ImportReport), NetworkError> {
    let network = builder.build()?;
    report.nodes = network.nodes().len();
    report.edges = network.edges().len();
    report.forbidden_turns = network.forbidden_turns().len();
    let (network, cleaning) = network.cleaned(&options.cleaning)?;
    report.cleaning = cleaning;
    Ok((network, report))
}

/// Describes what is wrong with a position; `None` for one on Earth.
pub(super) fn position_problem(position: Position) -> Option<String> {
    let Position { latitude, longitude } = position;
    if latitude.abs() <= 90.0 && longitude.abs() <= 180.0 {
        return None;
    }
    // Valid if exchanged. With a longitude below 90°, a swapped position cannot be told from a
    // correct one.
    if latitude.abs() > 90.0 && latitude.abs() <= 180.0 && longitude.abs() <= 90.0 {
        let [latitude, longitude] = [latitude, longitude].map(Number);
        return Some(format!(
            "latitude {latitude} and longitude {longitude} seem to be swapped, expected degrees from -90 to 90 for the latitude"
        ));
    }
    // NaN fails every comparison, so the coordinate that is NaN is the one reported.
    let (name, value, limit) = if latitude.abs() <= 90.0 {
        ("longitude", longitude, 180)
    } else {
        ("latitude", latitude, 90)
    };
    let value = Number(value);
    Some(format!("{name} is {value}, expected degrees from -{limit} to {limit}"))
}
