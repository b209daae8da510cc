//! Readers of tags at nodes, and of the names of roads. If the part q of a cell is in range of tag
//! t, of T tags, the probability of reading t is r q + m / T, that of another tag m / T, and that
//! of none 1 − r q − m.

use std::cmp::Reverse;

use crate::NetworkError;
use crate::cells::RoadCells;
use wayfix::error::OutOfRange;
use wayfix::likelihood::{Groups, LocalLikelihood, SparseObservation};
use wayfix::{Diagonal, Likelihood, LikelihoodError, Scratch, SparseLikelihood};

/// Tag that a cell is in range of, with the part of the cell that is; `None` out of range.
type InRange = Option<(usize, f32)>;

/// A sensor that reads at most one tag in a step: tags at nodes, read from the cells nearby (an
/// RFID tag, a toll gate, a stop that is announced), or groups of cells (the name of a road).
///
/// The observation is the number of a tag, or `None` if nothing was read, which counts against the
/// places where something should have been read. In a step,
///
/// - in range of a tag, it is read with probability `read`; in a cell that is partly in range, with
///   that part of the probability;
/// - with probability `misread`, in all cells, any tag is read, all equally likely.
///
/// **Both are per step.** Readings of successive steps depend on each other: at ten steps a second
/// a vehicle beside a damaged tag misses it ten times. So keep `read` low, or leave out steps with
/// `None`: a tag that is read then counts, and one that is missed hardly does.
///
/// With a `misread` of 0, a wrong reading is an
/// [error](wayfix::HmmError::Impossible) if the belief excludes the tag.
///
/// A step costs what a [`SparseLikelihood`] does, with the cells in range of the tag, or of any tag
/// if nothing was read. Memory: 32 bytes for each cell in range, and 24 for each tag.
///
/// ```
/// use wayfix_roads::NetworkBuilder;
/// use wayfix::map::{PlanePosition, RoadClass};
/// use wayfix_roads::cells::RoadCells;
/// use wayfix_roads::cells::{ReadRates, TagLikelihood};
/// use wayfix::{Likelihood, Scratch};
///
/// let mut builder = NetworkBuilder::new();
/// builder.node(1, PlanePosition { x: 0.0, y: 0.0 })?;
/// builder.node(2, PlanePosition { x: 4.0, y: 0.0 })?;
/// builder.one_way(1, 2, RoadClass::Street)?;
/// let cells = RoadCells::new(builder.build()?, 1.0)?;
///
/// // A tag at the second node is read within 1.5 m.
/// let rates = ReadRates { read: 0.8, misread: 0.01 };
/// let reader = TagLikelihood::at_nodes(&cells, &[1], 1.5, rates)?;
/// let mut scratch = Scratch::default();
/// let likelihoods = reader.diagonal(&Some(0), &mut scratch)?;
/// assert_eq!(likelihoods.as_slice(), [0.01, 0.01, 0.41000000000000003, 0.81]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct TagLikelihood {
    cells: SparseLikelihood,
    /// Likelihoods of reading each tag.
    tags: Vec<SparseObservation>,
    /// Likelihoods of reading nothing.
    nothing: SparseObservation,
    /// Largest likelihood of reading nothing: that of a cell out of range.
    out_of_range: f64,
}

/// Rates at which a [`TagLikelihood`] reads, per step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReadRates {
    /// Probability that a tag in range is read.
    pub read: f64,
    /// Probability that any tag is read by mistake.
    pub misread: f64,
}

impl TagLikelihood {
    /// Creates a reader of tags at nodes, tag t at `nodes[t]`, read within `range` metres along the
    /// road before and behind the node. If a cell is in range of several tags, the one with the
    /// largest part counts, and the first of equal ones. O(cells + tags).
    ///
    /// # Errors
    ///
    /// [`NetworkError::Parameter`] for a node that does not exist or is given twice, a range
    /// that is not above 0 and finite, or rates that are not probabilities with a sum of at most 1.
    pub fn at_nodes<P>(
        cells: &RoadCells<P>,
        nodes: &[usize],
        range: f64,
        rates: ReadRates,
    ) -> Result<Self, NetworkError> {
        let network = cells.network();
        if !(range > 0.0 && range.is_finite()) {
            return parameter("the range of a reader", range, "metres above 0");
        }
        let mut tags = vec![None; network.nodes().len()];
        for (tag, &node) in nodes.iter().enumerate() {
            match tags.get_mut(node) {
                Some(known @ None) => *known = Some(tag),
                Some(_) => return parameter("the node of a tag", node as f64, "each node once"),
                None => return parameter("the node of a tag", node as f64, "a node of the map"),
            }
        }
        let in_range = |cell: usize| {
            let (edge, stretch) = (network.edges()[cells.edge(cell)], cells.stretch(cell));
            let length = stretch.end - stretch.start;
            let part = |tag: Option<usize>, from: f64, to: f64| {
                let overlap = to.min(stretch.end) - from.max(stretch.start);
                tag.map(|tag| (tag, (overlap / length).clamp(0.0, 1.0) as f32))
            };
            let before = part(tags[edge.to], edge.metres - range, edge.metres);
            let behind = part(tags[edge.from], 0.0, range);
            let found = [before, behind].into_iter().flatten().filter(|(_, part)| *part > 0.0);
            // Among equal parts the lower tag must win, so tags compare in reverse.
            found.max_by(|a, b| a.1.total_cmp(&b.1).then(Reverse(a.0).cmp(&Reverse(b.0))))
        };
        let in_range: Vec<InRange> = (0..cells.states()).map(in_range).collect();
        Self::new(&in_range, nodes.len(), rates)
    }

    /// Creates a reader of groups, such as [roads](RoadCells::by_road): the tag is the number of
    /// the group. O(cells).
    ///
    /// # Errors
    ///
    /// [`NetworkError::Parameter`] for rates that are not probabilities with a sum of at most
    /// 1.
    pub fn of_groups(groups: &Groups, rates: ReadRates) -> Result<Self, NetworkError> {
        let in_range = groups.as_slice().iter().map(|&group| Some((group, 1.0)));
        let in_range: Vec<InRange> = in_range.collect();
        Self::new(&in_range, groups.count(), rates)
    }

    fn new(in_range: &[InRange], tags: usize, rates: ReadRates) -> Result<Self, NetworkError> {
        let ReadRates { read, misread } = rates;
        for (what, value) in [("the read rate", read), ("the misread rate", misread)] {
            if !(0.0..=1.0).contains(&value) {
                return parameter(what, value, "a value from 0 to 1");
            }
        }
        if read + misread > 1.0 {
            return parameter("the sum of read and misread rate", read + misread, "at most 1");
        }
        let by_mistake = misread / tags as f64;
        // Neither read nor misread. Rounding may take this below 0 if the rates sum to one.
        let nothing = |part: f32| (1.0 - read * f64::from(part) - misread).max(0.0);
        // "Elsewhere" is where the part in range is smallest, or 0 if any cell is out of range.
        // Cells with a larger part are listed, with a smaller likelihood of reading nothing.
        let part = |in_range: &InRange| in_range.map_or(0.0, |(_, part)| part);
        let least = in_range.iter().map(part).fold(1.0, f32::min);
        let (mut read_at, mut missed_at) = (vec![Vec::new(); tags], Vec::new());
        for (cell, &in_range) in in_range.iter().enumerate() {
            let Some((tag, part)) = in_range else { continue };
            read_at[tag].push((cell, read * f64::from(part) + by_mistake));
            // Cells with the smallest part are "elsewhere".
            if part > least {
                missed_at.push((cell, nothing(part)));
            }
        }
        let seen = SparseObservation::from_sorted;
        Ok(Self {
            cells: SparseLikelihood::new(in_range.len()),
            tags: read_at.into_iter().map(|listed| seen(listed, by_mistake)).collect(),
            nothing: seen(missed_at, nothing(least)),
            out_of_range: nothing(0.0),
        })
    }

    /// Number of tags.
    #[must_use]
    pub fn tags(&self) -> usize {
        self.tags.len()
    }

    /// Cells where a tag is read, in ascending order.
    ///
    /// # Panics
    ///
    /// If the tag does not exist.
    #[must_use]
    pub fn cells(&self, tag: usize) -> impl ExactSizeIterator<Item = usize> {
        self.tags[tag].listed().iter().map(|entry| entry.0)
    }

    fn seen(&self, tag: Option<usize>) -> Result<&SparseObservation, LikelihoodError> {
        let Some(symbol) = tag else { return Ok(&self.nothing) };
        let symbols = self.tags();
        self.tags.get(symbol).ok_or(LikelihoodError::Symbol { symbol, symbols })
    }
}

fn parameter<T>(what: &'static str, value: f64, expected: &'static str) -> Result<T, NetworkError> {
    Err(OutOfRange::new(what, value, expected).into())
}

impl Likelihood for TagLikelihood {
    type Observation = Option<usize>;

    fn states(&self) -> usize {
        wayfix::Likelihood::states(&self.cells)
    }

    /// # Errors
    ///
    /// [`LikelihoodError::Symbol`] for a tag that does not exist.
    fn diagonal<'a>(
        &'a self,
        &tag: &'a Option<usize>,
        scratch: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        self.cells.diagonal(self.seen(tag)?, scratch)
    }
}

impl LocalLikelihood for TagLikelihood {
    /// # Errors
    ///
    /// As [`diagonal`](Likelihood::diagonal).
    fn local<'a>(
        &'a self,
        &tag: &'a Option<usize>,
        states: &[usize],
        scratch: &'a mut Scratch,
    ) -> Result<(Diagonal<'a>, f64), LikelihoodError> {
        let seen = self.seen(tag)?;
        let (found, others) = self.cells.local(seen, states, scratch)?;
        // Others are bounded by a cell out of range, whether or not such a cell was asked for.
        let out_of_range = if tag.is_some() { seen.elsewhere() } else { self.out_of_range };
        Ok((found, others.max(out_of_range)))
    }

    /// Appends the cells in range of a tag; none if nothing was read, since most cells are then
    /// equally likely.
    fn listed_states(&self, &tag: &Option<usize>, states: &mut Vec<usize>) {
        if let Some(tag) = tag.filter(|tag| *tag < self.tags()) {
            states.extend(self.cells(tag));
        }
    }
}
