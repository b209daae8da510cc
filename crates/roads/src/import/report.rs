//! Report of an import.

use std::collections::BTreeMap;
use std::fmt;

use crate::CleaningStep;

/// Counts of an import: of the network as it was read, of roads skipped and values replaced, and
/// of the cleaning after it.
#[derive(Debug, Clone, PartialEq, Default)]
#[non_exhaustive]
pub struct ImportReport {
    /// Nodes read.
    pub nodes: usize,
    /// Directed edges read.
    pub edges: usize,
    /// Forbidden turns read, as pairs of edges.
    pub forbidden_turns: usize,
    /// Steps of the cleaning, in their order.
    pub cleaning: Vec<CleaningStep>,
    /// Columns of CSV files that the import does not know, with the file.
    pub ignored_columns: Vec<String>,
    notes: BTreeMap<ImportNote, usize>,
}

/// Part of a file that is not in the network as it stands in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum ImportNote {
    /// A way for others than cars, or of a kind that the options leave out: skipped.
    NotDrivable,
    /// A road closed to the public: skipped.
    Closed,
    /// An area: skipped.
    Area,
    /// A road with nodes that the file does not hold, as at the border of an extract: cut there.
    MissingNode,
    /// A line of fewer than two points: skipped.
    NoLine,
    /// A geometry that is no line, or a feature without a geometry: skipped.
    OtherGeometry,
    /// A loop without a length: skipped.
    LoopWithoutLength,
    /// A length of 0: replaced by that of the straight line.
    ZeroLength,
    /// A straight line of less than 0.1 m: its length replaced by 0.1 m.
    ShortLine,
    /// A speed that is not a number, such as `CH:urban`, or not above 0 and up to 1e9 m/s: none
    /// taken.
    UnknownSpeed,
    /// A road whose direction changes by the hour: taken as two-way.
    Reversible,
    /// A turn restriction that leads through a way instead of a node: not used.
    RestrictionThroughWay,
    /// A turn restriction that does not hold for cars: not used.
    RestrictionForOthers,
    /// A turn restriction that holds at some hours: not used.
    RestrictionByHour,
    /// A turn restriction whose kind is not known, or whose roads are not in the network or do
    /// not meet there: not used.
    RestrictionUnused,
}

impl fmt::Display for ImportNote {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NotDrivable => "ways not for cars or not chosen, skipped",
            Self::Closed => "roads closed to the public, skipped",
            Self::Area => "areas, skipped",
            Self::MissingNode => "roads cut at nodes that the file does not hold",
            Self::NoLine => "lines of fewer than two points, skipped",
            Self::OtherGeometry => "geometries that are missing or no lines, skipped",
            Self::LoopWithoutLength => "loops without length, skipped",
            Self::ZeroLength => "lengths of 0, replaced by the straight line's",
            Self::ShortLine => "lengths below 0.1 m, replaced by it",
            Self::UnknownSpeed => "speeds that are no number in range, not taken",
            Self::Reversible => "reversible roads, taken as two-way",
            Self::RestrictionThroughWay => "turn restrictions through a way, not used",
            Self::RestrictionForOthers => "turn restrictions not for cars, not used",
            Self::RestrictionByHour => "turn restrictions by the hour, not used",
            Self::RestrictionUnused => "turn restrictions without their roads, not used",
        })
    }
}

impl ImportReport {
    /// Number of times that a note applies.
    #[must_use]
    pub fn count(&self, note: ImportNote) -> usize {
        self.notes.get(&note).copied().unwrap_or(0)
    }

    /// Notes that apply, with their counts above 0.
    #[must_use]
    pub fn notes(&self) -> impl ExactSizeIterator<Item = (ImportNote, usize)> {
        self.notes.iter().map(|(&note, &count)| (note, count))
    }

    pub(super) fn note(&mut self, note: ImportNote) {
        *self.notes.entry(note).or_default() += 1;
    }
}

/// Prints the counts of the network, then one line for each note and step of cleaning.
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
            write!(f, "\ncolumn not known: {column}")?;
        }
        self.cleaning.iter().try_for_each(|step| write!(f, "\n{step}"))
    }
}
