//! Sum of short readings, released in whole cells. Metres released and metres kept add up to the
//! metres read, and so do their variances.
//!
//! Cells lost in slips of wheels have a compound Poisson distribution of geometric losses (Pólya
//! and Aeppli), computed by Panjer's recursion (1981).

use super::travel::{Travel, check_reading};
use wayfix::TransitionError;

/// Number of deviations by which a release must be above 0, so that hardly any probability is left
/// for having driven less than nothing.
const DEVIATIONS: f64 = 3.0;
/// Cells over which a vehicle that may be anywhere in its cell keeps its place there. Chosen on
/// simulated grids: with 1, a belief between rare fixes is far too wide; with 16, sets of 95% hold
/// 94% where cells are as large as the range of a tag.
const CELLS_ROUNDED_TOGETHER: f64 = 4.0;

/// Odometer of a vehicle on cells: adds up readings of any size, and releases whole cells.
///
/// A reading that is short against a cell does not say that the vehicle is in the next one. Moving
/// a part of the belief there, as small as the reading against the cell, has the right mean, but
/// adds variance at each tick: 22 m after 100 m on cells of 5 m. But the reading is the same for
/// all cells that the vehicle may be in, so each hypothesis is equally far ahead of its cell. The
/// metres that do not make up a cell are therefore kept here, once for all, with their variance:
/// the position along the road is the middle of the cell plus [`ahead`](Self::ahead) metres, at
/// most half a cell either way. A release is a whole number of cells with the variance added up, so
/// the belief spreads by that variance and nothing else, whatever the rate.
///
/// Made by [`CellTransition::odometer`](super::CellTransition::odometer). If the deviation is more
/// than a third of the cells to be released, as with a bad odometer over one cell, they are kept
/// longer.
///
/// **Cells are taken to be small** against what the variance adds up to between two looks at the
/// map: the vehicle keeps its place in the cell, so one that was at its edge may be in the next
/// without the belief knowing. On aisles of 2 m with cells of 1 m and noise of 3 cm in each metre,
/// sets of 95% held the vehicle's cell in 80% of ticks. A [`WheelOdometer`](super::WheelOdometer)
/// accounts for this.
///
/// **Backwards**: negative metres are subtracted, which is exact as long as the vehicle returns the
/// same way. Reversing past a junction and taking another road there is not modelled.
///
/// ```
/// use wayfix_roads::NetworkBuilder;
/// use wayfix::map::{PlanePosition, RoadClass};
/// use wayfix_roads::cells::RoadCells;
/// use wayfix_roads::cells::{CellTransition, TurnWeights};
///
/// let mut builder = NetworkBuilder::new();
/// builder.node(1, PlanePosition { x: 0.0, y: 0.0 })?;
/// builder.node(2, PlanePosition { x: 100.0, y: 0.0 })?;
/// builder.both_ways(1, 2, RoadClass::Street)?;
/// let cells = RoadCells::new(builder.build()?, 5.0)?;
/// let motion = CellTransition::new(&cells, &TurnWeights::default())?;
///
/// let mut odometer = motion.odometer();
/// // 60 ticks of 5 cm: more than half a cell, which is then released.
/// let driven: f64 = (0..60).map(|_| odometer.add(0.05, 1e-6).unwrap().mean()).sum();
/// assert!((driven - 1.0).abs() < 1e-9);
/// assert!((odometer.ahead() + 2.0).abs() < 1e-9); // 3 m driven, 5 m released
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Odometer {
    cell: f64,
    rounding: f64,
    ahead: f64,
    variance: f64,
    /// Slips of wheels, if the vehicle is anywhere in its cell rather than in the middle.
    slips: Option<Slips>,
    still: Travel,
}

impl Odometer {
    pub(super) fn new(cell: f64, rounding: f64) -> Self {
        Self { cell, rounding, ahead: 0.0, variance: 0.0, slips: None, still: Travel::still() }
    }

    /// Sets slips of wheels, and the metres ahead to start from. The vehicle may be anywhere in its
    /// cell.
    pub(super) fn slipping(self, slips: Slips, ahead: f64) -> Self {
        Self { slips: Some(slips), ahead, ..self }
    }

    /// Adds a reading in metres with the variance of its error, in square metres, and returns the
    /// control of the step: no distance, until there is a cell to be released.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Control`] unless the metres are finite, and the variance finite and at
    /// least 0; [`TransitionError::Parameter`] for more than 10,000,000 cells. Nothing is added
    /// then.
    pub fn add(&mut self, metres: f64, variance: f64) -> Result<Travel, TransitionError> {
        check_reading(metres, variance)?;
        // Nothing is stored before all checks have passed, so an error leaves the odometer as it
        // was.
        let (ahead, variance) = (self.ahead + metres, self.variance + variance);
        check_reading(ahead, variance)?;
        // Rounded to the nearest cell, so at most half a cell either way is kept for later.
        let cells = (ahead / self.cell + 0.5).floor();
        let all = (variance + cells.max(0.0) * self.cell * self.rounding) / self.cell.powi(2);
        let travel = if cells >= 1.0 && cells >= DEVIATIONS * all.sqrt() {
            let travel = match &self.slips {
                None => Travel::measured(cells, all, &[1.0])?,
                Some(slips) => {
                    let lost = slips.loss_distribution(cells * self.cell, self.cell);
                    // Cells are rounded in groups of `CELLS_ROUNDED_TOGETHER`. A release of n cells
                    // counts as n / CELLS_ROUNDED_TOGETHER groups, so the sum is the same whether
                    // cells are released together or one by one.
                    let all = cells / CELLS_ROUNDED_TOGETHER
                        * cell_change_variance(CELLS_ROUNDED_TOGETHER * all / cells);
                    Travel::measured(cells, all, &lost)?
                }
            };
            (self.ahead, self.variance) = (ahead - cells * self.cell, 0.0);
            travel
        } else {
            (self.ahead, self.variance) = (ahead, variance);
            self.still.clone()
        };
        Ok(travel)
    }

    /// Metres added and not yet released: how far the vehicle is ahead of the middle of its cell.
    /// From minus half a cell to half a cell, unless it reversed, or the variance is large.
    #[must_use]
    pub fn ahead(&self) -> f64 {
        self.ahead
    }

    /// Variance of the metres ahead, in square metres.
    #[must_use]
    pub fn variance(&self) -> f64 {
        self.variance
    }

    /// Forgets the metres not yet released, for a vehicle that was carried elsewhere.
    pub fn reset(&mut self) {
        self.restart(0.0);
    }

    /// Forgets the metres not yet released, and starts this many metres ahead.
    pub(super) fn restart(&mut self, ahead: f64) {
        (self.ahead, self.variance) = (ahead, 0.0);
    }
}

/// Probability, relative to the largest, at which the tail ends.
const TAIL: f64 = 1e-20;
/// Limit beyond which values are scaled down.
const LARGE: f64 = 1e200;

/// Slips of wheels, in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Slips {
    /// Slips in each metre.
    pub(super) rate: f64,
    /// Mean metres lost in each slip.
    pub(super) metres: f64,
}

impl Slips {
    /// Probabilities of the number of whole cells lost over a distance; they sum to one, up to
    /// the tail. O(largest number).
    pub(super) fn loss_distribution(&self, driven: f64, cell: f64) -> Vec<f64> {
        // A slip loses j cells with probability (1 − q) q^j. So a share q of the slips loses any
        // cells, namely 1 + j of them with this same probability.
        let q = self.metres / (self.metres + cell);
        let events = self.rate * driven * q;
        if events == 0.0 {
            return vec![1.0];
        }
        // Panjer's recursion for the probability P(s) of losing s cells, with e = `events`: s P(s)
        // = e (1 − q) W(s), where W(s) = Σ j q^(j−1) P(s − j). With U(s) = Σ q^(j−1) P(s − j), both
        // sums follow from those of s − 1 without cancellation: U(s) = P(s − 1) + q U(s − 1), W(s)
        // = U(s) + q W(s − 1).
        let mut lost = vec![1.0];
        let (mut u, mut w, mut largest) = (0.0, 0.0, 1.0_f64);
        let mut past = false;
        for cells in 1.. {
            u = lost[cells - 1] + q * u;
            w = u + q * w;
            let p = events * (1.0 - q) * w / cells as f64;
            // The list ends once values are below a share of the largest, but not while they still
            // rise.
            past |= p < lost[cells - 1];
            largest = largest.max(p);
            if past && p < TAIL * largest {
                break;
            }
            lost.push(p);
            // The recursion starts at 1 instead of e^−events, which may underflow, so values can
            // grow. It is linear, so all of its state can be scaled; the sum is divided out below.
            if p > LARGE {
                (u, w, largest) = (u / LARGE, w / LARGE, largest / LARGE);
                lost.iter_mut().for_each(|p| *p /= LARGE);
            }
        }
        let sum: f64 = lost.iter().rev().sum();
        lost.iter_mut().for_each(|p| *p /= sum);
        lost
    }
}

/// Variance of the number of cells between the cell where a vehicle is and the one where it should
/// be, for an error of this variance (in squared cells), if it is equally likely anywhere in its
/// cell.
///
/// An error of x cells becomes ⌊x⌋ with probability 1 − f and ⌊x⌋ + 1 with f, the fraction of x, so
/// f (1 − f) adds to the variance. On average over a Gaussian the total is E|x| if the error is
/// small, and 1/6 more than its variance if it is large.
pub(super) fn cell_change_variance(variance: f64) -> f64 {
    let deviation = variance.sqrt();
    // For |x| ≤ 1, which is seven deviations here, f (1 − f) = |x| − x². With the variance E x²
    // added, E|x| = σ √(2 / π) is left.
    if deviation < 1.0 / 7.0 {
        return deviation * std::f64::consts::FRAC_2_PI.sqrt();
    }
    // Fourier series of f (1 − f), averaged term by term: E cos(2 π n x) = exp(−2 π² n² σ²).
    let square = std::f64::consts::PI.powi(2);
    let term = |n: f64| (-2.0 * square * n * n * variance).exp() / (square * n * n);
    variance + 1.0 / 6.0 - (1..=9).map(|n| term(f64::from(n))).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn losses_are_those_of_the_sum_over_numbers_of_slips() {
        let slips = Slips { rate: 0.3, metres: 0.7 };
        let (driven, cell) = (4.0, 0.5);
        let found = slips.loss_distribution(driven, cell);
        let q: f64 = 0.7 / 1.2;
        let events = slips.rate * driven;
        // Poisson number of slips, each with a geometric loss, which may be 0.
        let first = Some(1.0 - q);
        let geometric = std::iter::successors(first, |p| Some(p * q)).take(found.len());
        let geometric: Vec<f64> = geometric.collect();
        let mut power = vec![0.0; found.len()];
        power[0] = 1.0;
        let (mut expected, mut share) = (vec![0.0; found.len()], (-events).exp());
        for number in 1..60 {
            expected.iter_mut().zip(&power).for_each(|(sum, p)| *sum += share * p);
            share *= events / f64::from(number);
            power = (0..power.len())
                .map(|s| (0..=s).map(|j| geometric[j] * power[s - j]).sum())
                .collect();
        }
        for (found, expected) in found.iter().zip(&expected) {
            assert!((found - expected).abs() < 1e-15);
        }
    }

    #[test]
    fn mean_and_variance_are_those_of_the_model() {
        for (rate, metres, driven) in [(0.02, 0.1, 1.0), (1.0, 3.0, 50.0), (500.0, 0.1, 2000.0)] {
            let slips = Slips { rate, metres };
            let lost = slips.loss_distribution(driven, 0.5);
            let cells = |k: usize| k as f64;
            let mean: f64 = lost.iter().enumerate().map(|(k, p)| p * cells(k)).sum();
            let off = |(k, p): (usize, &f64)| p * (cells(k) - mean).powi(2);
            let variance: f64 = lost.iter().enumerate().map(off).sum();
            let expected = rate * driven * metres / 0.5;
            assert!((mean / expected - 1.0).abs() < 1e-9, "{mean} {expected}");
            let each = metres / 0.5;
            let expected = rate * driven * each * (1.0 + 2.0 * each);
            assert!((variance / expected - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn rounding_is_that_of_a_vehicle_anywhere_in_its_cell() {
        for deviation in [0.01, 0.1, 0.142, 0.143, 0.3, 1.0, 4.0] {
            // By the midpoint rule over errors.
            let step = deviation / 2000.0;
            let (mut sum, mut expected) = (0.0, 0.0);
            for k in -16_000..16_000 {
                let x = (f64::from(k) + 0.5) * step;
                let p = (-0.5 * (x / deviation).powi(2)).exp();
                let f = x - x.floor();
                sum += p;
                expected += p * (x * x + f * (1.0 - f));
            }
            let found = cell_change_variance(deviation * deviation);
            assert!((found / (expected / sum) - 1.0).abs() < 1e-6, "{deviation}: {found}");
        }
        assert_eq!(cell_change_variance(0.0), 0.0);
    }
}
