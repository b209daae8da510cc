//! Motion on any map, with odometry as evidence on moves.

mod reading;
mod weights;

pub use reading::OdometryReading;

use crate::error::{Parameter, TransitionError};
use crate::kernels::log2;
use crate::map::RoadMap;
use crate::transition::{SparseTransition, Transition, TransitionEntries, check_slices, log};
use weights::{Way, Weights, nearest};

/// A sparse operator whose moves have lengths, with the distance driven as evidence: at a
/// junction, a vehicle that has driven 200 m took the road of that length.
///
/// **Not for steps that are short against the roads.** A step starts and ends at places. If a
/// vehicle is sampled several times between two places, as by a GPS tick each second on roads
/// of 200 m, a state cannot remember the metres since the last place: each tick is taken for a
/// stay, or for a whole road, without an error, and the belief becomes sure of wrong places (in
/// 6,000 such ticks, above 0.9 in 5,841 and right in 2,645). A log-likelihood far below 0 at
/// each step is the sign. Take a [`CellTransition`](super::CellTransition), whose states are
/// positions along roads; or add up readings and their variances until a place is reached or seen,
/// and step then; for places in a row take a [`RouteTransition`](super::RouteTransition).
///
/// The control of a step is an `Option<OdometryReading>`: a distance d with its
/// variance s², in the unit of the lengths (metres, on a map), which is
/// [evidence on the move](Transition::evidence). With B for the
/// operator that is given as a base, and L for the lengths,
///
/// ```text
/// A[i, j] = B[i, j] p(d | L[i, j])     p(d | L) = exp(−(d − L)² / 2 s²) / √(2π s²)
/// ```
///
/// and A = B where it is `None`. Columns do not sum to one: a distance also speaks against
/// a place none of whose ways is as long. Only the moves of B are possible: if a step may pass
/// several places, B needs entries for all places that it may reach. A stay has the length 0.
///
/// **The variance** is that of d − L for the right move, and above 0. Beside the odometer's
/// own error, such as (0.02 d)², it includes the error of the places at both ends: for
/// sightings evenly within ±r metres of a place, r² / 3 for either end, 2 r² / 3 together. For
/// heavier tails, as of an odometer that is sometimes wrong altogether, take an
/// [`EvidenceTransition`](crate::transition::EvidenceTransition).
///
/// Densities are relative to that at the length, of all moves, nearest to the distance.
/// Products and a step of Viterbi cost O(E), with an exponential for each of E
/// entries in products. Entries below 2.2e-308, the smallest normal double, are 0 in
/// products in linear space: if a length is some 38 deviations farther from the distance than
/// the nearest, inference takes the step in logarithms, which costs about
/// four times as much. Memory: that of the base, 32 bytes an entry and
/// 8 bytes a state.
///
/// ```
/// use wayfix::motion::{DistanceTransition, OdometryReading};
/// use wayfix::{SparseTransition, Transition};
///
/// // From place 0 a road of 100 m leads to place 1, and one of 200 m to place 2.
/// let roads = [(1, 0, 0.5), (2, 0, 0.5), (1, 1, 1.0), (2, 2, 1.0)];
/// let roads = SparseTransition::from_triplets(3, roads)?;
/// let a = DistanceTransition::new(roads, |to, from| 100.0 * (to as f64 - from as f64))?;
/// let mut out = [0.0; 3];
/// a.apply(&None, &[1.0, 0.0, 0.0], &mut out);
/// assert_eq!(out, [0.0, 0.5, 0.5]);
/// let driven = OdometryReading { distance: 190.0, variance: 900.0 };
/// a.apply(&Some(driven), &[1.0, 0.0, 0.0], &mut out);
/// assert!(out[2] > 50.0 * out[1]);
/// # Ok::<(), wayfix::TransitionError>(())
/// ```
#[derive(Debug, Clone)]
pub struct DistanceTransition {
    pub(crate) base: SparseTransition,
    /// The entries of the base, column by column; column j is `starts[j]..starts[j + 1]`.
    pub(crate) ways: Vec<Way>,
    starts: Vec<usize>,
    /// The distinct lengths, in ascending order.
    lengths: Vec<f64>,
    /// The smallest entry of the base.
    least: f64,
}

/// ln of the smallest normal double.
const LEAST_LOG: f64 = -708.396_418_532_264;

impl DistanceTransition {
    /// Creates an operator with the moves of `base`, each with its `length(to, from)`.
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

    /// Creates an operator with the moves of `base` along the roads of a map, with their lengths in
    /// metres; a stay has the length 0.
    ///
    /// ```
    /// use wayfix::motion::DistanceTransition;
    /// use wayfix::canberra;
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
    pub fn on_map<P>(map: &RoadMap<P>, base: SparseTransition) -> Result<Self, TransitionError> {
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
                TransitionError::Parameter(Parameter::new(what, 0.0, expected))
            })
        })
    }

    /// The operator of steps without a distance.
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

    /// Builds the operator; calls `length` column by column, in ascending order.
    pub(crate) fn build(
        base: SparseTransition,
        mut length: impl FnMut(usize, usize) -> Result<f64, TransitionError>,
    ) -> Result<Self, TransitionError> {
        let (mut ways, mut starts) = (Vec::with_capacity(base.entries()), vec![0]);
        for from in 0..base.states() {
            for (to, p) in base.outgoing(&(), from) {
                let value = length(to, from)?;
                if !(value >= 0.0 && value.is_finite()) {
                    let what =
                        format!("the length of the transition from state {from} to state {to}");
                    let expected = "a finite value of at least 0";
                    return Err(Parameter::new(what, value, expected).into());
                }
                ways.push(Way { to: to as u32, length: value, p, log2: log2(p) });
            }
            starts.push(ways.len());
        }
        let mut lengths: Vec<f64> = ways.iter().map(|way| way.length).collect();
        lengths.sort_unstable_by(f64::total_cmp);
        lengths.dedup();
        lengths.shrink_to_fit();
        let least = ways.iter().map(|way| way.p).fold(1.0, f64::min);
        Ok(Self { base, ways, starts, lengths, least })
    }

    fn column(&self, from: usize) -> &[Way] {
        &self.ways[self.starts[from]..self.starts[from + 1]]
    }

    fn weights(&self, odometry: OdometryReading) -> Weights {
        Weights::new(nearest(&self.lengths, odometry.distance), odometry)
    }

    /// The columns, each with its state.
    fn columns(&self) -> impl Iterator<Item = (usize, &[Way])> {
        (0..self.states()).map(|from| (from, self.column(from)))
    }

    /// The way of an entry of the base.
    fn way(&self, to: usize, from: usize) -> Option<&Way> {
        let column = self.column(from);
        let at = column.binary_search_by_key(&to, |way| way.to as usize).ok()?;
        Some(&column[at])
    }
}

impl Transition for DistanceTransition {
    type Control = Option<OdometryReading>;

    fn states(&self) -> usize {
        self.base.states()
    }

    fn apply(&self, control: &Option<OdometryReading>, x: &[f64], out: &mut [f64]) {
        let Some(odometry) = *control else { return self.base.apply(&(), x, out) };
        check_slices(self.states(), x, out);
        let weights = self.weights(odometry);
        out.fill(0.0);
        for (from, ways) in self.columns().filter(|column| x[column.0] != 0.0) {
            ways.iter().for_each(|way| out[way.to as usize] += weights.of(way) * x[from]);
        }
    }

    fn apply_transpose(&self, control: &Option<OdometryReading>, x: &[f64], out: &mut [f64]) {
        let Some(odometry) = *control else { return self.base.apply_transpose(&(), x, out) };
        check_slices(self.states(), x, out);
        let weights = self.weights(odometry);
        for (from, ways) in self.columns() {
            out[from] = ways.iter().map(|way| weights.of(way) * x[way.to as usize]).sum();
        }
    }

    fn apply_log(&self, control: &Option<OdometryReading>, x: &[f64], out: &mut [f64]) {
        let Some(odometry) = *control else { return self.base.apply_log(&(), x, out) };
        check_slices(self.states(), x, out);
        let weights = self.weights(odometry);
        out.fill(f64::NEG_INFINITY);
        for (from, ways) in self.columns().filter(|column| x[column.0] > f64::NEG_INFINITY) {
            for way in ways {
                let out = &mut out[way.to as usize];
                *out = log::add(*out, way.p.ln() + weights.log(way) + x[from]);
            }
        }
    }

    fn apply_transpose_log(&self, control: &Option<OdometryReading>, x: &[f64], out: &mut [f64]) {
        let Some(odometry) = *control else { return self.base.apply_transpose_log(&(), x, out) };
        check_slices(self.states(), x, out);
        let weights = self.weights(odometry);
        for (from, ways) in self.columns() {
            let terms = ways.iter().map(|way| way.p.ln() + weights.log(way) + x[way.to as usize]);
            out[from] = terms.fold(f64::NEG_INFINITY, log::add);
        }
    }

    fn evidence(&self, control: &Option<OdometryReading>) -> Option<f64> {
        control.map(|odometry| self.weights(odometry).log_factor())
    }

    fn needs_logs(&self, control: &Option<OdometryReading>) -> bool {
        control.is_some_and(|odometry| {
            let ends = [self.lengths.first(), self.lengths.last()];
            let weights = self.weights(odometry);
            let least = ends.into_iter().flatten().map(|length| weights.log_at(*length));
            least.fold(0.0, f64::min) < LEAST_LOG - self.least.ln()
        })
    }

    fn check_control(&self, control: &Option<OdometryReading>) -> Result<(), TransitionError> {
        control.as_ref().map_or(Ok(()), OdometryReading::check)
    }
}

impl TransitionEntries for DistanceTransition {
    fn incoming(
        &self,
        control: &Option<OdometryReading>,
        to: usize,
    ) -> impl Iterator<Item = (usize, f64)> {
        let weights = control.map(|odometry| self.weights(odometry));
        let entries = self.base.incoming(&(), to).map(move |(from, p)| {
            let weight = |weights: Weights| self.way(to, from).map_or(0.0, |way| weights.of(way));
            (from, weights.map_or(p, weight))
        });
        entries.filter(|entry| entry.1 > 0.0)
    }

    fn outgoing(
        &self,
        control: &Option<OdometryReading>,
        from: usize,
    ) -> impl Iterator<Item = (usize, f64)> {
        let weights = control.map(|odometry| self.weights(odometry));
        let entries = self
            .column(from)
            .iter()
            .map(move |way| (way.to as usize, weights.map_or(way.p, |weights| weights.of(way))));
        entries.filter(|entry| entry.1 > 0.0)
    }

    fn incoming_log2(
        &self,
        control: &Option<OdometryReading>,
        to: usize,
    ) -> impl Iterator<Item = (usize, f64)> {
        let weights = control.map(|odometry| self.weights(odometry));
        let entries = self.base.incoming_log2(&(), to).map(move |(from, log2)| {
            let weight = |weights: Weights| {
                self.way(to, from).map_or(f64::NEG_INFINITY, |way| weights.log2(way))
            };
            (from, weights.map_or(log2, weight))
        });
        entries.filter(|entry| entry.1 > f64::NEG_INFINITY)
    }

    fn outgoing_log2(
        &self,
        control: &Option<OdometryReading>,
        from: usize,
    ) -> impl Iterator<Item = (usize, f64)> {
        let weights = control.map(|odometry| self.weights(odometry));
        let entries = self.column(from).iter().map(move |way| {
            (way.to as usize, weights.map_or(way.log2, |weights| weights.log2(way)))
        });
        entries.filter(|entry| entry.1 > f64::NEG_INFINITY)
    }

    fn max_product(
        &self,
        control: &Option<OdometryReading>,
        x: &[f64],
        out: &mut [f64],
        from: &mut [u32],
    ) {
        let Some(odometry) = *control else { return self.base.max_product(&(), x, out, from) };
        check_slices(self.states(), x, out);
        let weights = self.weights(odometry);
        out.fill(f64::NEG_INFINITY);
        from.fill(0);
        // Predecessors come in ascending order, so that the lowest wins ties.
        for (j, ways) in self.columns().filter(|column| x[column.0] > f64::NEG_INFINITY) {
            for way in ways {
                let (i, value) = (way.to as usize, weights.log2(way) + x[j]);
                if value > out[i] {
                    (out[i], from[i]) = (value, j as u32);
                }
            }
        }
    }
}
