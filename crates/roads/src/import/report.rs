//! Report of an import: what was read, skipped and replaced.

use std::collections::BTreeMap;
use std::fmt;

use crate::CleaningStep;

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
