//! Motion on any map, driven by odometry.

mod weights;

use super::restart::log2_bound;
use super::{
    Odometry, SparseTransition, Transition, TransitionEntries, buffers, check_slices, log,
};
use crate::error::TransitionError;
use crate::kernels::log2;
use crate::map::RoadMap;
use weights::{Way, Weights, share};

/// A sparse operator each of whose moves has a length, and which knows by
/// odometry how far a step has led: on a junction a vehicle that has driven
/// 200 m took the road of that length.
///
/// The control of a step is an `Option<Odometry>`, a distance d with its
/// variance s², in the unit of the lengths (metres, on a map). With B for the
/// operator that is given as a base, and L for the lengths,
///
/// ```text
/// A[i, j] ∝ B[i, j] exp(−(d − L[i, j])² / 2 s²),   columns sum to one
/// ```
///
/// and A = B where it is `None`. A variance of 0 leaves the moves of the nearest
/// length, in proportion to B. Only the moves of B are there: where a step may
/// pass several places, B needs entries for all that it may come to. One that
/// stays has the length 0.
///
/// **The variance** is that of d − L for the right move. Beside the odometer's
/// own error, such as (0.02 d)², it holds where on the road the vehicle was when
/// it was taken for at the place: for sightings within ±r metres, evenly, r² / 3
/// for either end, 2 r² / 3 together.
///
/// Since columns sum to one, odometry chooses among the ways out of a place, and
/// does not speak against a place none of whose ways is as long.
///
/// Products and a step of Viterbi cost O(E), with an exponential for each of E
/// entries; to list what leads into a state costs as much as the columns of the
/// states where it comes from. Probabilities below 2.2e-308, the smallest normal
/// double, are 0. Memory: that of the base, 24 bytes an entry and 8 bytes a
/// state.
///
/// ```
/// use wayfix::{DistanceTransition, Odometry, SparseTransition, Transition};
///
/// // From place 0 a road of 100 m leads to place 1, and one of 200 m to place 2.
/// let roads = [(1, 0, 0.5), (2, 0, 0.5), (1, 1, 1.0), (2, 2, 1.0)];
/// let roads = SparseTransition::from_triplets(3, roads)?;
/// let a = DistanceTransition::new(roads, |to, from| 100.0 * (to as f64 - from as f64))?;
/// let mut out = [0.0; 3];
/// a.apply(&None, &[1.0, 0.0, 0.0], &mut out);
/// assert_eq!(out, [0.0, 0.5, 0.5]);
/// let driven = Odometry { distance: 190.0, variance: 900.0 };
/// a.apply(&Some(driven), &[1.0, 0.0, 0.0], &mut out);
/// assert!(out[2] > 0.98);
/// # Ok::<(), wayfix::TransitionError>(())
/// ```
#[derive(Debug, Clone)]
pub struct DistanceTransition {
    pub(crate) base: SparseTransition,
    /// The entries of the base, column by column; those of j are
    /// `starts[j]..starts[j + 1]`.
    pub(crate) ways: Vec<Way>,
    starts: Vec<usize>,
    /// The most entries that a column has.
    most: usize,
}

impl DistanceTransition {
    /// The moves of `base`, each with its `length(to, from)`.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Parameter`] for a length that is NaN, negative or
    /// infinite.
    pub fn new(
        base: SparseTransition,
        length: impl Fn(usize, usize) -> f64,
    ) -> Result<Self, TransitionError> {
        Self::build(base, |to, from| Ok(length(to, from)))
    }

    /// The moves of `base` along the roads of a map, with their lengths in
    /// metres; a move that stays has the length 0.
    ///
    /// ```
    /// use wayfix::{DistanceTransition, canberra};
    ///
    /// let turning = canberra::turning().into_transition();
    /// let a = DistanceTransition::on_map(&canberra::map(), turning)?;
    /// assert_eq!(a.base().entries(), 420);
    /// # Ok::<(), wayfix::TransitionError>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`TransitionError::PartStates`] if the map has another number of places,
    /// or [`TransitionError::Parameter`] for a move without a road.
    pub fn on_map(map: &RoadMap, base: SparseTransition) -> Result<Self, TransitionError> {
        let (found, expected) = (map.places().len(), base.states());
        if found != expected {
            return Err(TransitionError::PartStates { part: "map", found, expected });
        }
        Self::build(base, |to, from| {
            if to == from {
                return Ok(0.0);
            }
            let road = map.roads_from(from).find(|road| road.0 == to);
            road.map(|(_, road)| road.metres).ok_or_else(|| {
                let what = format!("the number of roads from state {from} to state {to}");
                let expected = "1, since there is such a transition";
                TransitionError::Parameter { what, value: 0.0, expected }
            })
        })
    }

    /// The operator of steps of which no distance is known.
    #[must_use]
    pub fn base(&self) -> &SparseTransition {
        &self.base
    }

    /// The length of a move, or `None` if the base has no such entry.
    /// O(log entries of the column).
    #[must_use]
    pub fn length(&self, to: usize, from: usize) -> Option<f64> {
        let column = (from < self.states()).then(|| self.column(from))?;
        let at = column.binary_search_by_key(&to, |way| way.to as usize).ok()?;
        Some(column[at].length)
    }

    /// Asks for the lengths column by column, in ascending order.
    pub(crate) fn build(
        base: SparseTransition,
        mut length: impl FnMut(usize, usize) -> Result<f64, TransitionError>,
    ) -> Result<Self, TransitionError> {
        let (mut ways, mut starts) = (Vec::with_capacity(base.entries()), vec![0]);
        let mut most = 0;
        for from in 0..base.states() {
            for (to, p) in base.outgoing(&(), from) {
                let value = length(to, from)?;
                if !(value >= 0.0 && value.is_finite()) {
                    let what =
                        format!("the length of the transition from state {from} to state {to}");
                    let expected = "a finite value of at least 0";
                    return Err(TransitionError::Parameter { what, value, expected });
                }
                ways.push(Way { to: to as u32, length: value, log: p.ln() });
            }
            most = most.max(ways.len() - starts[from]);
            starts.push(ways.len());
        }
        Ok(Self { base, ways, starts, most })
    }

    fn column(&self, from: usize) -> &[Way] {
        &self.ways[self.starts[from]..self.starts[from + 1]]
    }

    /// Hands over each column, with its probabilities.
    fn visit(&self, odometry: Odometry, mut visit: impl FnMut(usize, &[Way], &[f64])) {
        buffers::with(self.most, |buffer: &mut [f64]| {
            for from in 0..self.states() {
                let ways = self.column(from);
                let p = &mut buffer[..ways.len()];
                let weights = Weights::new(ways, odometry);
                p.iter_mut().zip(ways).for_each(|(p, way)| *p = weights.of(way));
                let sum = p.iter().sum();
                p.iter_mut().for_each(|p| *p = share(*p, sum));
                visit(from, ways, p);
            }
        });
    }
}

impl Transition for DistanceTransition {
    type Control = Option<Odometry>;

    fn states(&self) -> usize {
        self.base.states()
    }

    fn apply(&self, control: &Option<Odometry>, x: &[f64], out: &mut [f64]) {
        let Some(odometry) = *control else { return self.base.apply(&(), x, out) };
        check_slices(self.states(), x, out);
        out.fill(0.0);
        self.visit(odometry, |from, ways, p| {
            ways.iter().zip(p).for_each(|(way, p)| out[way.to as usize] += p * x[from]);
        });
    }

    fn apply_transpose(&self, control: &Option<Odometry>, x: &[f64], out: &mut [f64]) {
        let Some(odometry) = *control else { return self.base.apply_transpose(&(), x, out) };
        check_slices(self.states(), x, out);
        self.visit(odometry, |from, ways, p| {
            out[from] = ways.iter().zip(p).map(|(way, p)| p * x[way.to as usize]).sum();
        });
    }

    fn apply_log(&self, control: &Option<Odometry>, x: &[f64], out: &mut [f64]) {
        let Some(odometry) = *control else { return self.base.apply_log(&(), x, out) };
        check_slices(self.states(), x, out);
        out.fill(f64::NEG_INFINITY);
        self.visit(odometry, |from, ways, p| {
            for (way, p) in ways.iter().zip(p) {
                let out = &mut out[way.to as usize];
                *out = log::add(*out, p.ln() + x[from]);
            }
        });
    }

    fn apply_transpose_log(&self, control: &Option<Odometry>, x: &[f64], out: &mut [f64]) {
        let Some(odometry) = *control else { return self.base.apply_transpose_log(&(), x, out) };
        check_slices(self.states(), x, out);
        self.visit(odometry, |from, ways, p| {
            out[from] = log::sum(ways.iter().map(|way| way.to as usize).zip(p.iter().copied()), x);
        });
    }

    fn check_control(&self, control: &Option<Odometry>) -> Result<(), TransitionError> {
        control.as_ref().map_or(Ok(()), Odometry::check)
    }
}

impl TransitionEntries for DistanceTransition {
    fn incoming(
        &self,
        &control: &Option<Odometry>,
        to: usize,
    ) -> impl Iterator<Item = (usize, f64)> {
        let entries = self.base.incoming(&(), to).map(move |(from, p)| {
            let Some(odometry) = control else { return (from, p) };
            let ways = self.column(from);
            let weights = Weights::new(ways, odometry);
            let (mut sum, mut weight) = (0.0, 0.0);
            for way in ways {
                let of = weights.of(way);
                sum += of;
                weight = if way.to as usize == to { of } else { weight };
            }
            (from, share(weight, sum))
        });
        entries.filter(|entry| entry.1 > 0.0)
    }

    fn outgoing(
        &self,
        &control: &Option<Odometry>,
        from: usize,
    ) -> impl Iterator<Item = (usize, f64)> {
        let ways = self.column(from);
        let scaled = control.map(|odometry| {
            let weights = Weights::new(ways, odometry);
            (weights, ways.iter().map(|way| weights.of(way)).sum::<f64>())
        });
        let entries = self.base.outgoing(&(), from).zip(ways).map(move |((to, p), way)| {
            (to, scaled.map_or(p, |(weights, sum)| share(weights.of(way), sum)))
        });
        entries.filter(|entry| entry.1 > 0.0)
    }

    fn max_product(
        &self,
        control: &Option<Odometry>,
        x: &[f64],
        out: &mut [f64],
        from: &mut [u32],
    ) {
        let Some(odometry) = *control else { return self.base.max_product(&(), x, out, from) };
        check_slices(self.states(), x, out);
        out.fill(f64::NEG_INFINITY);
        from.fill(0);
        // Predecessors come in ascending order: of equal ones the lowest stays.
        self.visit(odometry, |j, ways, p| {
            for (way, p) in ways.iter().zip(p) {
                let i = way.to as usize;
                if log2_bound(*p) + x[j] > out[i] {
                    let value = log2(*p) + x[j];
                    if value > out[i] {
                        (out[i], from[i]) = (value, j as u32);
                    }
                }
            }
        });
    }
}
