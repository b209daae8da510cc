//! Motion on the cells of roads, by metres driven: A = Σ w_k M^k, with M one cell ahead. All such
//! operators commute, so the rate of readings does not matter.
//!
//! Products take Horner's rule: one product with M for each cell of the distance. All terms are at
//! least 0, so nothing cancels. Entries are listed by walks over the edges: arrivals leave a heap
//! by their distance, so that all arrivals at an edge after the same number of cells are added up
//! before it is left.

use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::sync::Arc;

use super::odometer::Odometer;
use super::travel::{Travel, check_reading};
use super::turns::{EdgeTurns, TurnWeights, Turns};
use crate::cells::road_cells::{Layout, RoadCells};
use wayfix::internal::buffers;
use wayfix::map::FittedTurn;
use wayfix::transition::kit::check_slices;
use wayfix::{Transition, TransitionEntries, TransitionError};

/// A vehicle on the [cells of roads](RoadCells), by the metres driven in a step: ticks of
/// centimetres as well as jumps of a kilometre over many junctions.
///
/// Let M move the belief by one cell: to the next on the same edge, or from the last one to the
/// first cells of the edges that may follow, by their [`TurnWeights`]; forbidden turns are never
/// taken. The control is a [`Travel`], the probability w_k of each number k of cells, and the
/// operator
///
/// ```text
/// A = Σ w_k M^k
/// ```
///
/// All operators of the same M commute, and two steps are one step by the sum of their distances,
/// also across junctions: the result does not depend on the rate of the readings.
///
/// # Metres
///
/// [`travel`](Self::travel) turns metres with a variance into w, and keeps both exactly: around a
/// whole number of cells a symmetric Skellam distribution (close to a Gaussian, defined on whole
/// numbers, and closed under sums), and between two whole numbers in proportion. The variance is
/// that of the metres and of the [rounding](RoadCells::rounding) of the map, and at least that of
/// lying between whole numbers. Tails below 1e-20 are cut. A vehicle that would have driven less
/// than nothing stays.
///
/// **Readings shorter than some ten cells go through an [`Odometer`]**, which keeps what does not
/// make up a whole cell. Given directly, each of them adds up to a quarter of a squared cell to the
/// variance.
///
/// **Errors of readings are taken to be independent**, so they average out. Wheels that are 2% too
/// large do not: if they are the odometer, take a [`WheelTransition`](super::WheelTransition),
/// which learns their scale.
///
/// # Control or evidence
///
/// A distance chooses the operator, and its columns sum to one. That loses nothing here: with all
/// distances equally likely beforehand, the probability of a reading is the same wherever the
/// vehicle is, so the reading says nothing about where it is. A
/// [`DistanceTransition`](wayfix::motion::DistanceTransition) differs: its roads have lengths to
/// compare with.
///
/// The exception is the end of the network: an edge that nothing may follow, such as a one-way road
/// that leaves the map. By default, a vehicle there stays. Its odometer speaks against that, and a
/// wrong position that comes to such an end survives there longer than it should.
/// [`with_evidence_at_ends`](Self::with_evidence_at_ends) counts this: to drive on from an end is
/// then impossible. Columns sum to less than one, which is [evidence on the
/// move](Transition::evidence), with the costs that this has in a
/// [`PrunedFilter`](wayfix::PrunedFilter). A map without such [ends](Self::ends) is better. A dead
/// end with a way back is not one of them.
///
/// A vehicle turns around at nodes only, not between them. If it may be carried elsewhere, put this
/// into a [`RestartTransition`](wayfix::transition::RestartTransition).
///
/// # Costs
///
/// Products take k passes over all cells and turns for a step of at most k cells: 50 for a
/// kilometre on cells of 20 m. Entries are listed by walking over edges, at a cost independent of
/// the number of all cells: O(number of weights) for a step within an edge, and for steps across
/// junctions O(r log r), where r counts the edges (at each distance) and cells reached. A
/// [`PrunedFilter`](wayfix::PrunedFilter) needs no more than these. Memory: 12 bytes an edge and 32
/// bytes a turn, beside the cells, which are shared.
///
/// ```
/// use wayfix_roads::NetworkBuilder;
/// use wayfix::map::{PlanePosition, RoadClass};
/// use wayfix_roads::cells::RoadCells;
/// use wayfix_roads::cells::{CellTransition, TurnWeights};
/// use wayfix::{Belief, Hmm, LikelihoodVector, Prior};
///
/// // A road of 100 m that forks into a main road and a street.
/// let mut builder = NetworkBuilder::new();
/// for (id, x, y) in [(1, 0.0, 0.0), (2, 100.0, 0.0), (3, 200.0, 50.0), (4, 200.0, -50.0)] {
///     builder.node(id, PlanePosition { x, y })?;
/// }
/// builder.both_ways(1, 2, RoadClass::Main)?;
/// builder.both_ways(2, 3, RoadClass::Main)?;
/// builder.both_ways(2, 4, RoadClass::Street)?;
/// let cells = RoadCells::new(builder.build()?, 5.0)?;
///
/// let motion = CellTransition::new(&cells, &TurnWeights::default())?;
/// let mut odometer = motion.odometer();
/// let start = Prior::BeforeFirstTransition(Belief::certain(cells.states(), cells.cell_at(0, 0.0))?);
/// let hmm = Hmm::new(start, motion, LikelihoodVector::linear(cells.states()))?;
/// let mut filter = hmm.filter();
/// // Ten times a second, 1.5 m driven with an error of 3 cm.
/// for _ in 0..100 {
///     filter.predict_with(&odometer.add(1.5, 0.0009)?)?;
/// }
/// // 150 m on: halfway on the main road, most likely, within a few cells.
/// let at = filter.belief().mode();
/// let network = cells.network();
/// assert_eq!(cells.edge(at), network.edge_between(1, 2).unwrap());
/// assert!((cells.metres_along(at) + odometer.ahead() - 52.5).abs() < 5.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct CellTransition {
    layout: Arc<Layout>,
    /// Turns by the edge before and by the edge after.
    next: Turns,
    before: Turns,
    /// Edges that nothing may follow.
    ends: Vec<u32>,
    /// True if a vehicle stays at an end, false if it cannot.
    stay: bool,
    pub(super) mean_metres: f64,
    rounding: f64,
}

impl CellTransition {
    /// Creates the motion on cells, with the turns of their network. O(turns): the pairs of an edge
    /// and one that may follow it.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Parameter`] for a weight out of its range, or
    /// [`TransitionError::TooMany`] for more turns than 32-bit indices address.
    pub fn new<P>(cells: &RoadCells<P>, weights: &TurnWeights) -> Result<Self, TransitionError> {
        Ok(Self::of_turns(cells, Turns::new(cells.network(), weights)?))
    }

    /// Creates the motion on cells, with learned turns of their network. O(turns).
    ///
    /// # Errors
    ///
    /// [`TransitionError::PartStates`] if the number of edges differs, and
    /// [`TransitionError::Forbidden`] for a turn that this network does not have.
    pub fn with_turns<P>(cells: &RoadCells<P>, turns: &EdgeTurns) -> Result<Self, TransitionError> {
        let (found, expected) = (turns.turns.starts.len() - 1, cells.network().edges().len());
        if found != expected {
            return Err(TransitionError::PartStates { part: "turns", found, expected });
        }
        for FittedTurn { from, to, .. } in turns.turns() {
            if cells.network().edges()[from].to != cells.network().edges()[to].from
                || !cells.network().may_turn(from, to)
            {
                return Err(TransitionError::Forbidden { to, from });
            }
        }
        Ok(Self::of_turns(cells, turns.turns.clone()))
    }

    fn of_turns<P>(cells: &RoadCells<P>, next: Turns) -> Self {
        let before = next.reversed();
        let layout = cells.layout().clone();
        let edges = (0..).zip(0..layout.edge_count());
        let ends = edges.filter(|edge| next.of(edge.1).is_empty()).map(|edge| edge.0).collect();
        let (mean_metres, rounding) = (cells.mean_metres(), cells.rounding());
        Self { layout, next, before, ends, stay: true, mean_metres, rounding }
    }

    /// Rules out staying at an end of the network when metres are driven.
    #[must_use]
    pub fn with_evidence_at_ends(self) -> Self {
        Self { stay: false, ..self }
    }

    /// Edges that nothing may follow, in ascending order.
    #[must_use]
    pub fn ends(&self) -> impl ExactSizeIterator<Item = usize> {
        self.ends.iter().map(|&edge| edge as usize)
    }

    /// Returns the probability that an edge is followed by another at its end.
    ///
    /// # Panics
    ///
    /// If `edge` does not exist.
    #[must_use]
    pub fn turn(&self, edge: usize, next: usize) -> f64 {
        self.next.probability(edge, next)
    }

    /// Returns the control of a step by metres driven, with the variance of their error in square
    /// metres; for long steps, see [above](Self#metres).
    ///
    /// # Errors
    ///
    /// [`TransitionError::Control`] unless the metres are finite and at least 0, and the variance
    /// is finite and at least 0, or [`TransitionError::Parameter`] for more than 10,000,000 cells,
    /// or a deviation of more than 100,000.
    pub fn travel(&self, metres: f64, variance: f64) -> Result<Travel, TransitionError> {
        check_reading(metres, variance)?;
        if metres < 0.0 {
            let text = format!("{metres} metres driven, expected 0 or more");
            return Err(TransitionError::Control(text));
        }
        // The error from rounding lengths to whole cells is a variance that grows with the
        // distance.
        let all = variance + metres * self.rounding;
        Travel::measured(metres / self.mean_metres, all / self.mean_metres.powi(2), &[1.0])
    }

    /// Returns an odometer at 0, which turns short readings into controls.
    #[must_use]
    pub fn odometer(&self) -> Odometer {
        Odometer::new(self.mean_metres, self.rounding)
    }

    fn stays_at_end(&self, edge: usize) -> bool {
        self.stay && self.next.of(edge).is_empty()
    }
}

impl Transition for CellTransition {
    type Control = Travel;

    fn states(&self) -> usize {
        self.layout.states()
    }

    fn apply(&self, travel: &Travel, x: &[f64], out: &mut [f64]) {
        self.product(travel, x, out);
    }

    fn apply_transpose(&self, travel: &Travel, x: &[f64], out: &mut [f64]) {
        self.transposed_product(travel, x, out);
    }

    fn evidence(&self, travel: &Travel) -> Option<f64> {
        (!self.stay && !self.ends.is_empty() && travel.last() > 0).then_some(0.0)
    }
}

impl TransitionEntries for CellTransition {
    fn incoming(&self, travel: &Travel, to: usize) -> impl Iterator<Item = (usize, f64)> {
        self.incoming_entries(travel, to)
    }

    fn outgoing(&self, travel: &Travel, from: usize) -> impl Iterator<Item = (usize, f64)> {
        self.outgoing_entries(travel, from)
    }
}

impl CellTransition {
    /// Computes `out = M x`, one cell ahead.
    fn apply_one_cell(&self, x: &[f64], out: &mut [f64]) {
        // Cells are numbered along the edges, so moving one cell ahead is a shift by one. Only the
        // first cell of each edge gets a value from another edge, which the turns then overwrite.
        out[1..].copy_from_slice(&x[..x.len() - 1]);
        for edge in 0..self.layout.edge_count() {
            let arrivals = self.before.of(edge).iter();
            out[self.layout.first(edge)] =
                arrivals.map(|&(before, p)| p * x[self.layout.last(before as usize)]).sum();
        }
        // What would drive on beyond an end stays in its last cell, in addition to what has just
        // arrived there.
        if self.stay {
            for &edge in &self.ends {
                let last = self.layout.last(edge as usize);
                out[last] += x[last];
            }
        }
    }

    /// Computes `out = M' x`.
    fn apply_one_cell_transpose(&self, x: &[f64], out: &mut [f64]) {
        // Here the shift goes back by one cell, and the turns overwrite the last cell of each edge.
        out[..x.len() - 1].copy_from_slice(&x[1..]);
        for edge in 0..self.layout.edge_count() {
            let turns = self.next.of(edge).iter();
            out[self.layout.last(edge)] =
                turns.map(|&(next, p)| p * x[self.layout.first(next as usize)]).sum();
        }
        if self.stay {
            for &edge in &self.ends {
                let last = self.layout.last(edge as usize);
                out[last] = x[last];
            }
        }
    }

    /// Computes Σ w_k M^k x by Horner's rule, with M given as `one`.
    fn polynomial(
        &self,
        travel: &Travel,
        x: &[f64],
        out: &mut [f64],
        one: impl Fn(&Self, &[f64], &mut [f64]),
    ) {
        check_slices(self.states(), x, out);
        let set = |weight: f64, out: &mut [f64]| {
            out.iter_mut().zip(x).for_each(|(out, x)| *out = weight * x);
        };
        let last = travel.last();
        if last == 0 {
            return set(travel.exactly(0), out);
        }
        buffers::with(x.len(), |other| {
            // Products alternate between the two buffers, starting with the one for which the last
            // of the `last` products ends in `out`.
            let (mut from, mut to) =
                if last.is_multiple_of(2) { (out, &mut *other) } else { (&mut *other, out) };
            set(travel.exactly(last), from);
            // Invariant: `from` is Σ w_k M^(k − cells − 1) x over k > `cells`, with w_k =
            // `travel.exactly(k)`.
            for cells in (0..last).rev() {
                one(self, from, to);
                let weight = travel.exactly(cells);
                if weight > 0.0 {
                    to.iter_mut().zip(x).for_each(|(out, x)| *out += weight * x);
                }
                (from, to) = (to, from);
            }
        });
    }

    pub(super) fn product(&self, travel: &Travel, x: &[f64], out: &mut [f64]) {
        self.polynomial(travel, x, out, Self::apply_one_cell);
    }

    pub(super) fn transposed_product(&self, travel: &Travel, x: &[f64], out: &mut [f64]) {
        self.polynomial(travel, x, out, Self::apply_one_cell_transpose);
    }
}

/// Arrival of a walk at an edge: the cells of the walk before the nearest cell of the edge, and the
/// probability. Ordered for a heap: fewer cells come first.
#[derive(Debug, Clone, Copy)]
struct Arrival {
    /// Counted from the nearest cell of the edge where the walk starts.
    distance: usize,
    edge: u32,
    p: f64,
}

impl Arrival {
    fn key(&self) -> (usize, u32) {
        (self.distance, self.edge)
    }
}

impl PartialEq for Arrival {
    fn eq(&self, other: &Self) -> bool {
        self.key() == other.key()
    }
}

impl Eq for Arrival {}

impl PartialOrd for Arrival {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Arrival {
    fn cmp(&self, other: &Self) -> Ordering {
        other.key().cmp(&self.key())
    }
}

impl CellTransition {
    /// Lists the entries out of a cell, in ascending order.
    pub(super) fn outgoing_entries(
        &self,
        travel: &Travel,
        from: usize,
    ) -> impl Iterator<Item = (usize, f64)> + use<'_> {
        let edge = self.layout.edge(from);
        let is_end = usize::from(self.stays_at_end(edge));
        let travel = travel.clone();
        // Most steps end on the same edge and need no walk. The last cell of an end edge collects a
        // tail of the weights, so it is left to the walk.
        let near = from + travel.last() + is_end <= self.layout.last(edge);
        let cells = if near { travel.first()..travel.last() + 1 } else { 0..0 };
        let far = if near { Vec::new() } else { self.walk(&travel, from, true) };
        let near = cells.map(move |cells| (from + cells, travel.exactly(cells)));
        near.chain(far).filter(|entry| entry.1 > 0.0)
    }

    /// Lists the entries into a cell, in ascending order.
    pub(super) fn incoming_entries(
        &self,
        travel: &Travel,
        to: usize,
    ) -> impl Iterator<Item = (usize, f64)> + use<'_> {
        let edge = self.layout.edge(to);
        let is_end = to == self.layout.last(edge) && self.stays_at_end(edge);
        let travel = travel.clone();
        let near = !is_end && to - self.layout.first(edge) >= travel.last();
        let cells = if near { travel.first()..travel.last() + 1 } else { 0..0 };
        let far = if near { Vec::new() } else { self.walk(&travel, to, false) };
        let near = cells.rev().map(move |cells| (to - cells, travel.exactly(cells)));
        near.chain(far).filter(|entry| entry.1 > 0.0)
    }

    /// Walks over the edges in order of distance, so that all arrivals at an edge after the same
    /// number of cells become one. Lists the cells reached, each once, in ascending order.
    fn walk(&self, travel: &Travel, start: usize, ahead: bool) -> Vec<(usize, f64)> {
        let edge = self.layout.edge(start);
        // The walk counts from the cell where it would enter its first edge; the start is `before`
        // cells farther.
        let before =
            if ahead { start - self.layout.first(edge) } else { self.layout.last(edge) - start };
        // A vehicle that is held at an end may have driven any number of cells beyond it. So the
        // weights into an end are tails, and the weight of zero cells also counts.
        let into_end = !ahead && before == 0 && self.stays_at_end(edge);
        let first = before + if into_end { 0 } else { travel.first() };
        let last = before + travel.last();
        let mut heap = BinaryHeap::new();
        heap.push(Arrival { distance: 0, edge: edge as u32, p: 1.0 });
        let mut found = Vec::new();
        while let Some(Arrival { distance, edge, mut p }) = heap.pop() {
            // Every edge has at least one cell, so no later arrival has this key: all are merged
            // here.
            while let Some(same) = heap.peek().filter(|other| other.key() == (distance, edge)) {
                p += same.p;
                heap.pop();
            }
            let edge = edge as usize;
            let cells = self.layout.cells(edge);
            let out_of_end = ahead && self.stays_at_end(edge);
            let farthest = (last + 1 - distance).min(cells.len());
            for number in first.saturating_sub(distance)..farthest {
                let driven = distance + number - before;
                let is_end = out_of_end && number + 1 == cells.len();
                if !is_end {
                    let cell = if ahead { cells.start + number } else { cells.end - 1 - number };
                    let weight =
                        if into_end { travel.at_least(driven) } else { travel.exactly(driven) };
                    found.push((cell, p * weight));
                }
            }
            // A vehicle that would drive on beyond an end is in its last cell, which therefore gets
            // a tail of the weights.
            if out_of_end && farthest == cells.len() {
                let driven = (distance + cells.len() - 1).saturating_sub(before);
                found.push((cells.end - 1, p * travel.at_least(driven)));
            }
            let distance = distance + cells.len();
            if distance <= last {
                let turns = if ahead { self.next.of(edge) } else { self.before.of(edge) };
                let arrivals = turns.iter().map(|turn| (turn.0, p * turn.1));
                heap.extend(arrivals.map(|(edge, p)| Arrival { distance, edge, p }));
            }
        }
        // A walk around a block may reach a cell several times, at different distances.
        found.sort_unstable_by_key(|entry| entry.0);
        found.dedup_by(|next, kept| {
            let same = next.0 == kept.0;
            kept.1 += if same { next.1 } else { 0.0 };
            same
        });
        found
    }
}
