//! Motion on any map, with odometry as evidence on moves: the likelihood of a distance, given the
//! length of a move (guide, section 10, By distance). Densities are relative to that of the length
//! nearest to the distance, so that no entry exceeds that of the base.

use std::f64::consts::PI;

use crate::error::{OutOfRange, TransitionError};
use crate::map::RoadMap;
use crate::transition::{
    MoveLikelihood, SparseTransition, Transition, TransitionEntries, WithMoveLikelihood, delegate,
};
use wayfix_kernels::limits::LARGEST_LOG;
use wayfix_kernels::log2;

/// A sparse operator whose moves have lengths, with the distance driven as evidence: at a
/// junction, a vehicle that has driven 200 m took the road of that length.
///
/// **Not for steps that are short against the roads.** A step starts and ends at places. If a
/// vehicle is sampled several times between two places, as by a GPS tick each second on roads of
/// 200 m, a state cannot remember the metres since the last place: each tick is taken for a stay or
/// for a whole road, without an error, and the belief becomes sure of wrong places (in 6,000 such
/// ticks, above 0.9 in 5,841 and right in 2,645). A log-likelihood far below 0 at each step is the
/// sign. Take a `CellTransition` of wayfix-roads, whose states are positions along roads;
/// or add up readings and their variances until a place is reached or seen, and step then. For
/// places in a row take a `RouteTransition` of wayfix-recognition.
///
/// The control of a step is an `Option<OdometryReading>`: a distance d with its variance s², in the
/// unit of the lengths (metres, on a map), which is [evidence on the move](Transition::evidence).
/// With the operator B given as a base, and the lengths L,
///
/// ```text
/// A[i, j] = B[i, j] p(d | L[i, j])     p(d | L) = exp(−(d − L)² / 2 s²) / √(2π s²)
/// ```
///
/// and A = B where it is `None`. Columns do not sum to one: a distance is also evidence against a
/// place that no way of that length leaves. Only the moves of B are possible: if a step may pass
/// several places, B needs entries for all places that it may reach. A stay has the length 0.
///
/// **The variance** is that of d − L for the right move, and above 0. Beside the odometer's
/// own error, such as (0.02 d)², it includes the error of the places at both ends: for
/// sightings evenly within ±r metres of a place, r² / 3 for either end, 2 r² / 3 together. For
/// heavier tails, as of an odometer that is sometimes wrong altogether, take an
/// [`EvidenceTransition`](crate::transition::EvidenceTransition).
///
/// Densities are relative to the density at the length, among all moves, that is nearest to the
/// distance. Products and a step of Viterbi cost O(E) for E entries; products take an exponential
/// for each. If a length is some 38 deviations farther from the distance than the nearest one,
/// entries fall below 2.2e-308, the smallest normal double: inference then takes the step in
/// logarithms, which costs about four times as much. Memory: that of the base, 32 bytes an entry,
/// and 8 for each distinct length.
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
pub struct DistanceTransition(pub(crate) WithMoveLikelihood<SparseTransition, Lengths>);

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
    /// [`TransitionError::PartStates`] if the map has a different number of places, or
    /// [`TransitionError::Parameter`] for a move without a road.
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
                TransitionError::Parameter(OutOfRange::new(what, 0.0, expected))
            })
        })
    }

    /// Operator of the steps without a distance: the base.
    #[must_use]
    pub fn base(&self) -> &SparseTransition {
        &self.0.base
    }

    /// Length of a move, or `None` if the base has no such entry. O(log entries of the column).
    #[must_use]
    pub fn length(&self, to: usize, from: usize) -> Option<f64> {
        let length = || self.0.likelihood.length(self.base(), to, from);
        (from < self.states()).then(length).flatten()
    }

    /// Builds the operator; calls `length` column by column, in ascending order.
    pub(crate) fn build(
        base: SparseTransition,
        mut length: impl FnMut(usize, usize) -> Result<f64, TransitionError>,
    ) -> Result<Self, TransitionError> {
        // `moves` grows in the order of the base's entries, column by column: `lengths` relies on
        // this order when it cuts out a column by the positions of the base.
        let (mut moves, mut least) = (Vec::with_capacity(base.entries()), 1.0_f64);
        for from in 0..base.states() {
            for (to, p) in base.outgoing(&(), from) {
                let value = length(to, from)?;
                if !(value >= 0.0 && value.is_finite()) {
                    let what =
                        format!("the length of the transition from state {from} to state {to}");
                    let expected = "a finite value of at least 0";
                    return Err(OutOfRange::new(what, value, expected).into());
                }
                moves.push(Length { to: to as u32, metres: value, p, log2: log2(p) });
                least = least.min(p);
            }
        }
        let mut distinct: Vec<f64> = moves.iter().map(|length| length.metres).collect();
        distinct.sort_unstable_by(f64::total_cmp);
        distinct.dedup();
        distinct.shrink_to_fit();
        Ok(Self(WithMoveLikelihood { base, likelihood: Lengths { moves, distinct, least } }))
    }
}

impl Transition for DistanceTransition {
    type Control = Option<OdometryReading>;

    delegate!(a, read => a.0, read; states products evidence needs_logs check_control);
}

impl TransitionEntries for DistanceTransition {
    delegate!(a, read => a.0, read; all_entries);
}

/// Odometry reading of a step: a distance and the variance of its error, in the unit
/// of the lengths of a [`DistanceTransition`](crate::motion::DistanceTransition), such as metres.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct OdometryReading {
    /// Distance driven; finite.
    pub distance: f64,
    /// Variance of the distance, in squared units; finite and above 0.
    pub variance: f64,
}

/// Lengths of the moves of an operator, in the order of its columns.
#[derive(Debug, Clone)]
pub(crate) struct Lengths {
    pub(crate) moves: Vec<Length>,
    /// The distinct lengths, in ascending order.
    distinct: Vec<f64>,
    /// Smallest entry of the base.
    least: f64,
}

/// Length of a move, with the base's entry for it and log2 of that: side by side, since products
/// and decoding read all three for each entry.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Length {
    to: u32,
    pub(crate) metres: f64,
    p: f64,
    log2: f64,
}

/// ln of the smallest normal double.
const LEAST_LOG: f64 = -708.396_418_532_264;

impl Lengths {
    fn lengths(&self, base: &SparseTransition, from: usize) -> &[Length] {
        &self.moves[base.positions(from)]
    }

    fn length(&self, base: &SparseTransition, to: usize, from: usize) -> Option<f64> {
        base.position(to, from).map(|nth| self.lengths(base, from)[nth].metres)
    }

    /// The length nearest to a distance.
    fn nearest(&self, distance: f64) -> f64 {
        // The nearest is the last length below the distance or the first one at or above it. Before
        // the first, the slice starts at 0 and one of the two is merely farther. On a tie the lower
        // length wins, since `far` must be less. Halves keep the difference of two large values
        // finite.
        let above = self.distinct.partition_point(|length| *length < distance);
        let near = self.distinct[above.saturating_sub(1)..].iter().take(2).copied();
        let far = |length: f64| (0.5 * length - 0.5 * distance).abs();
        near.fold(f64::INFINITY, |best, length| if far(length) < far(best) { length } else { best })
    }
}

impl MoveLikelihood<SparseTransition> for Lengths {
    type Measurement = Option<OdometryReading>;
    type Move = f64;

    /// Logarithm of the density at the nearest length.
    fn log_factor(&self, read: &Option<OdometryReading>) -> Option<f64> {
        read.map(|OdometryReading { distance, variance }| {
            // Half of the difference of two finite values is finite, even where the difference is
            // not. So the exponent −(2 `off`)² / 2 is −2 `off`² below.
            let off = (0.5 * distance - 0.5 * self.nearest(distance)) / variance.sqrt();
            -0.5 * ((2.0 * PI).ln() + variance.ln()) - 2.0 * off * off
        })
    }

    fn move_log_likelihood(
        &self,
        base: &SparseTransition,
        read: &Option<OdometryReading>,
    ) -> Option<impl Fn(usize, usize, Option<f64>) -> f64> {
        let read = (*read)?;
        let nearest = self.nearest(read.distance);
        Some(move |to, from, metres: Option<f64>| {
            // Only entries of the base are asked for, so there always is a length.
            let length = metres.or_else(|| self.length(base, to, from));
            length.map_or(f64::NEG_INFINITY, |length| log_density_ratio(read, length, nearest))
        })
    }

    fn check(
        &self,
        _: &SparseTransition,
        read: &Option<OdometryReading>,
    ) -> Result<(), TransitionError> {
        let Some(OdometryReading { distance, variance }) = *read else { return Ok(()) };
        let text = if !distance.is_finite() {
            format!("an odometry distance of {distance}, expected a finite value")
        } else if !(variance > 0.0 && variance.is_finite()) {
            format!("an odometry variance of {variance}, expected a finite value above 0")
        } else {
            return Ok(());
        };
        Err(TransitionError::Control(text))
    }

    /// True if the least entry, the smallest of the base times the least density, is not a normal
    /// double.
    fn needs_logs(&self, _: &SparseTransition, read: &Option<OdometryReading>) -> bool {
        read.is_some_and(|read| {
            // The density falls with the distance from the reading, so it is least at one of the
            // ends of the sorted lengths.
            let nearest = self.nearest(read.distance);
            let ends = [self.distinct.first(), self.distinct.last()];
            let least =
                ends.into_iter().flatten().map(|length| log_density_ratio(read, *length, nearest));
            least.fold(0.0, f64::min) < LEAST_LOG - self.least.ln()
        })
    }

    fn column(
        &self,
        base: &SparseTransition,
        from: usize,
    ) -> impl Iterator<Item = (usize, f64, f64)> {
        let lengths = self.lengths(base, from).iter();
        lengths.map(|length| (length.to as usize, length.p, length.metres))
    }

    fn column_log2(
        &self,
        base: &SparseTransition,
        from: usize,
    ) -> impl Iterator<Item = (usize, f64, f64)> {
        let lengths = self.lengths(base, from).iter();
        lengths.map(|length| (length.to as usize, length.log2, length.metres))
    }
}

/// Logarithm of the density at a length relative to that at the nearest one, at most 0; −∞ below
/// the range of valid logarithms.
///
/// It is −[(d − L)² − (d − N)²] / 2 s², computed as the product of L − N and (L + N) / 2 − d: a
/// difference of large squares would lose its digits.
fn log_density_ratio(read: OdometryReading, length: f64, nearest: f64) -> f64 {
    let gap = length - nearest;
    // Half of the second factor, (L + N) / 2 − d: unlike the factor itself, it cannot overflow.
    let off = 0.25 * length + 0.25 * nearest - 0.5 * read.distance;
    // Zero times infinity would be NaN: gap / variance may overflow where off is 0.
    let excess = if gap == 0.0 || off == 0.0 { 0.0 } else { 2.0 * (gap / read.variance) * off };
    // Above 0 only by rounding: no length is nearer than the nearest.
    let log = (-excess).min(0.0);
    if log >= -LARGEST_LOG { log } else { f64::NEG_INFINITY }
}

#[cfg(feature = "serde")]
crate::stored! {
    [] DistanceTransition: [], |a| {
        base: SparseTransition = a.base(),
        lengths: Vec<f64> = a.0.likelihood.moves.iter().map(|length| length.metres).collect::<Vec<_>>(),
    } => distances(base, &lengths);
}

#[cfg(feature = "serde")]
fn distances(
    base: SparseTransition,
    lengths: &[f64],
) -> Result<DistanceTransition, TransitionError> {
    let (found, expected) = (lengths.len(), base.entries());
    if found != expected {
        let what = "the number of lengths".to_owned();
        let expected = "one for each entry of the base";
        return Err(OutOfRange::new(what, found as f64, expected).into());
    }
    let mut lengths = lengths.iter().copied();
    DistanceTransition::build(base, |_, _| Ok(lengths.next().unwrap_or(f64::NAN)))
}
