//! Readers of tags at nodes, and of the names of roads.

use super::ObservationError;
use crate::error::{LikelihoodError, Parameter};
use crate::likelihood::{Diagonal, Groups, Likelihood, LocalLikelihood, Scratch, Unlisted};
use crate::map::RoadCells;

/// Mark of a cell from which no tag is read.
const NONE: u32 = u32::MAX;

/// A sensor that reads at most one tag in a step: of tags at nodes, read from the cells nearby
/// (an RFID tag, a toll gate, a stop that is announced), or of groups of cells (the name of a
/// road).
///
/// The observation is the number of a tag, or `None` if nothing was read, which speaks against the
/// places where something should have been. In a step,
///
/// - in range of a tag, it is read with probability `read`, in a cell of which only a part is in
///   range with that part of it;
/// - with probability `misread`, in all cells, any tag is read, each as likely.
///
/// **Both are per step.** Readings of successive steps depend on each other: at ten steps a second
/// a vehicle beside a damaged tag misses it ten times. So `read` is best given low, or steps with
/// `None` left out: a tag that is read then counts, and one that is missed hardly.
///
/// With a `misread` of 0, a wrong reading is an
/// [error](crate::InferenceError::Impossible) if the belief excludes the tag.
///
/// O(n) for all cells; as a [`LocalLikelihood`], O(cells asked + cells of the tag). Memory: 16
/// bytes a cell and 8 bytes a tag.
///
/// ```
/// use wayfix::map::{NetworkBuilder, PlanePosition, RoadCells, RoadClass};
/// use wayfix::observation::{ReadRates, TagLikelihood};
/// use wayfix::{Diagonal, Likelihood, Scratch};
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
/// let mut out = [0.0; 4];
/// # use wayfix::likelihood::LocalLikelihood;
/// reader.local(&Some(0), &[0, 1, 2, 3], &mut out, &mut Scratch::default())?;
/// assert_eq!(out, [0.01, 0.01, 0.41000000000000003, 0.81]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct TagLikelihood {
    rates: ReadRates,
    /// Tag of each cell and the part of the cell in range of it.
    near: Vec<(u32, f32)>,
    /// Cells of tag t are those from `starts[t]` to `starts[t + 1]`.
    cells: Vec<u32>,
    starts: Vec<usize>,
}

/// How often a [`TagLikelihood`] reads, per step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReadRates {
    /// Probability that a tag in range is read.
    pub read: f64,
    /// Probability that a tag is read by mistake, any of them.
    pub misread: f64,
}

impl TagLikelihood {
    /// Creates a reader of tags at nodes, tag t at `nodes[t]`, from so many metres along the road
    /// before a node and behind it. Where a cell is in range of several, that of the largest part
    /// counts, of equal ones the first. O(cells + tags log tags).
    ///
    /// # Errors
    ///
    /// [`ObservationError::Parameter`] for a node that does not exist or is given twice, a range
    /// that is not above 0 and finite, or rates that are not probabilities with a sum of at most 1.
    pub fn at_nodes<P>(
        cells: &RoadCells<P>,
        nodes: &[usize],
        range: f64,
        rates: ReadRates,
    ) -> Result<Self, ObservationError> {
        let network = cells.network();
        if !(range > 0.0 && range.is_finite()) {
            return parameter("the range of a reader", range, "metres above 0");
        }
        let mut tags = vec![NONE; network.nodes().len()];
        for (tag, &node) in (0..).zip(nodes) {
            match tags.get_mut(node) {
                Some(known) if *known == NONE => *known = tag,
                Some(_) => return parameter("the node of a tag", node as f64, "each node once"),
                None => return parameter("the node of a tag", node as f64, "a node of the map"),
            }
        }
        let near = |cell: usize| {
            let (edge, stretch) = (network.edges()[cells.edge(cell)], cells.stretch(cell));
            let length = stretch.end - stretch.start;
            let part = |from: f64, to: f64| {
                let overlap = to.min(stretch.end) - from.max(stretch.start);
                (overlap / length).clamp(0.0, 1.0) as f32
            };
            let before = (tags[edge.to], part(edge.metres - range, edge.metres));
            let behind = (tags[edge.from], part(0.0, range));
            let in_range = [before, behind].into_iter().filter(|(tag, p)| *tag != NONE && *p > 0.0);
            let key = |(tag, p): (u32, f32)| (p, std::cmp::Reverse(tag));
            in_range.fold((NONE, 0.0), |best, one| {
                if best.0 == NONE || key(one) > key(best) { one } else { best }
            })
        };
        Self::new((0..cells.states()).map(near).collect(), nodes.len(), rates)
    }

    /// Creates a reader of groups, such as [roads](RoadCells::by_road): the number of the group is
    /// the tag. O(cells).
    ///
    /// # Errors
    ///
    /// [`ObservationError::Parameter`] for rates that are not probabilities with a sum of at most
    /// 1.
    pub fn of_groups(groups: &Groups, rates: ReadRates) -> Result<Self, ObservationError> {
        let near = groups.as_slice().iter().map(|&group| (group as u32, 1.0));
        Self::new(near.collect(), groups.count(), rates)
    }

    fn new(near: Vec<(u32, f32)>, tags: usize, rates: ReadRates) -> Result<Self, ObservationError> {
        let ReadRates { read, misread } = rates;
        for (what, value) in [("the read rate", read), ("the misread rate", misread)] {
            if !(0.0..=1.0).contains(&value) {
                return parameter(what, value, "a value from 0 to 1");
            }
        }
        if read + misread > 1.0 {
            return parameter("the sum of read and misread rate", read + misread, "at most 1");
        }
        let mut starts = vec![0; tags + 1];
        let in_range = || near.iter().filter(|cell| cell.0 != NONE);
        in_range().for_each(|cell| starts[cell.0 as usize + 1] += 1);
        (0..tags).for_each(|tag| starts[tag + 1] += starts[tag]);
        let mut places = starts.clone();
        let mut cells = vec![0; starts[tags]];
        for (cell, &(tag, _)) in (0..).zip(&near).filter(|cell| cell.1.0 != NONE) {
            let place = &mut places[tag as usize];
            cells[*place] = cell;
            *place += 1;
        }
        Ok(Self { rates, near, cells, starts })
    }

    /// Number of tags.
    #[must_use]
    pub fn tags(&self) -> usize {
        self.starts.len() - 1
    }

    /// Cells from which a tag is read, in ascending order.
    ///
    /// # Panics
    ///
    /// If there is no such tag.
    #[must_use]
    pub fn cells(&self, tag: usize) -> impl ExactSizeIterator<Item = usize> {
        self.cells[self.starts[tag]..self.starts[tag + 1]].iter().map(|&cell| cell as usize)
    }

    /// Likelihood in a cell.
    fn value(&self, seen: Option<usize>, cell: usize) -> f64 {
        let ReadRates { read, misread } = self.rates;
        let (tag, part) = self.near[cell];
        let read = read * f64::from(part);
        match seen {
            None => (1.0 - read - misread).max(0.0),
            Some(seen) if tag as usize == seen && tag != NONE => read + self.by_mistake(),
            Some(_) => self.by_mistake(),
        }
    }

    /// Probability that a certain tag is read by mistake.
    fn by_mistake(&self) -> f64 {
        self.rates.misread / self.tags() as f64
    }

    fn check(&self, seen: Option<usize>) -> Result<(), LikelihoodError> {
        let symbols = self.tags();
        match seen {
            Some(symbol) if symbol >= symbols => Err(LikelihoodError::Symbol { symbol, symbols }),
            _ => Ok(()),
        }
    }
}

fn parameter<T>(
    what: &'static str,
    value: f64,
    expected: &'static str,
) -> Result<T, ObservationError> {
    Err(Parameter::new(what, value, expected).into())
}

impl Likelihood for TagLikelihood {
    type Observation = Option<usize>;

    fn states(&self) -> usize {
        self.near.len()
    }

    /// # Errors
    ///
    /// [`LikelihoodError::Symbol`] for a tag that does not exist.
    fn diagonal<'a>(
        &'a self,
        &seen: &Option<usize>,
        scratch: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        self.check(seen)?;
        let values = scratch.values(self.states());
        match seen {
            Some(tag) => {
                values.fill(self.by_mistake());
                self.cells(tag).for_each(|cell| values[cell] = self.value(seen, cell));
            }
            None => {
                values.iter_mut().enumerate().for_each(|(cell, b)| *b = self.value(None, cell));
            }
        }
        Ok(Diagonal::linear(values))
    }
}

impl LocalLikelihood for TagLikelihood {
    /// # Errors
    ///
    /// As [`diagonal`](Likelihood::diagonal).
    fn local(
        &self,
        &seen: &Option<usize>,
        states: &[usize],
        out: &mut [f64],
        _: &mut Scratch,
    ) -> Result<Unlisted, LikelihoodError> {
        self.check(seen)?;
        out.iter_mut().zip(states).for_each(|(out, &cell)| *out = self.value(seen, cell));
        let Some(tag) = seen else {
            return Ok(Unlisted::at_most(1.0 - self.rates.misread));
        };
        let others = self.cells(tag).filter(|cell| states.binary_search(cell).is_err());
        let values = others.map(|cell| self.value(seen, cell));
        Ok(Unlisted::at_most(values.fold(self.by_mistake(), f64::max)))
    }

    fn listed_states(&self, seen: &Option<usize>, states: &mut Vec<usize>) {
        if let Some(tag) = seen.filter(|&tag| tag < self.tags()) {
            states.extend(self.cells(tag));
        }
    }
}
