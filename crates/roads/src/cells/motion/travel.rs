//! Distance driven in a step, in cells: the weights w_k of the powers of M, which sum to one and
//! have the mean and the variance of the metres.

use std::fmt;
use std::sync::Arc;

use wayfix::TransitionError;
use wayfix::error::OutOfRange;
use wayfix::transition::kit::check_sum;

/// Largest number of cells of a step.
const MOST: f64 = 1e7;
/// Largest deviation of a step, in cells.
const MOST_OFF: f64 = 1e5;
/// Probability, relative to the largest, at which tails end.
const TAIL: f64 = 1e-20;

/// Distance driven in a step: the probability of each number of cells. The control of a
/// [`CellTransition`](super::CellTransition), which makes it from metres; cheap to clone.
///
/// ```
/// use wayfix_roads::cells::Travel;
///
/// assert_eq!(Travel::still().weights(), [1.0]);
/// // A vehicle of unknown speed: one to three cells.
/// let travel = Travel::of_cells(1, &[0.25, 0.5, 0.25])?;
/// assert_eq!((travel.mean(), travel.variance()), (2.0, 0.5));
/// # Ok::<(), wayfix::TransitionError>(())
/// ```
#[derive(Clone, PartialEq)]
pub struct Travel {
    table: Arc<Table>,
}

#[derive(PartialEq)]
struct Table {
    /// Number of cells of the first weight.
    first: usize,
    /// Probability of each number of cells; never empty.
    weights: Vec<f64>,
    /// Probability of at least each number of cells.
    tails: Vec<f64>,
}

impl Travel {
    /// Returns a step of no distance.
    #[must_use]
    pub fn still() -> Self {
        Self::from_weights(0, vec![1.0])
    }

    /// Creates a distance from the probabilities of `first` cells, one more, and so on, such as
    /// those of a vehicle whose speed is known only to be in a range.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Parameter`] for a probability that is NaN, negative or infinite, if they
    /// do not sum to one, or for more than 10,000,000 cells.
    pub fn of_cells(first: usize, weights: &[f64]) -> Result<Self, TransitionError> {
        check_sum(weights, "the sum of the probabilities of distances".into(), |at| {
            format!("the probability of {} cells", first.saturating_add(at))
        })?;
        let most = first as f64 + weights.len() as f64;
        if most > MOST {
            return Err(too_far("the number of cells of a step", most));
        }
        let first_above = weights.iter().position(|w| *w > 0.0).unwrap_or(0);
        let end = weights.iter().rposition(|w| *w > 0.0).map_or(0, |last| last + 1);
        Ok(Self::from_weights(first + first_above, weights[first_above..end].to_vec()))
    }

    /// Creates a distance with this mean and variance, in cells; the variance is at least that of
    /// lying between two whole numbers. Both are at least 0 (or NaN). Cells are then lost with the
    /// probabilities `lost` of each whole number.
    #[expect(clippy::cast_sign_loss, reason = "both were just compared with 0")]
    pub(super) fn measured(
        mean: f64,
        variance: f64,
        lost: &[f64],
    ) -> Result<Self, TransitionError> {
        let deviation = variance.sqrt();
        if !(0.0..=MOST).contains(&mean) {
            return Err(too_far("the number of cells of a step", mean));
        }
        if !(0.0..=MOST_OFF).contains(&deviation) {
            let what = "the deviation of a step in cells".to_owned();
            let expected = "at most 100,000";
            return Err(OutOfRange::new(what, deviation, expected).into());
        }
        // A mean that is whole up to rounding is meant to be whole.
        let whole = mean.round();
        let mean = if (mean - whole).abs() <= 1e-9 { whole } else { mean };
        let (below, part) = (mean.floor() as usize, mean.fract());
        // The distance is a mixture of the two whole numbers next to the mean, which has this mean
        // and the variance part (1 − part). A Skellam distribution around each adds the rest of the
        // variance.
        let side = skellam((variance - part * (1.0 - part)).max(0.0));
        let reach = side.len() - 1;
        let first = below.saturating_sub(reach + lost.len() - 1);
        let mut weights = vec![0.0; below + reach + 2 - first];
        for (lost, chance) in lost.iter().enumerate() {
            for (share, centre) in [(1.0 - part, below), (part, below + 1)] {
                let share = chance * share;
                for (off, p) in side.iter().enumerate() {
                    // A vehicle with a negative distance stays.
                    weights[centre.saturating_sub(lost + off) - first] += share * p;
                    if off > 0 {
                        weights[(centre + off).saturating_sub(lost) - first] += share * p;
                    }
                }
            }
        }
        while weights.last() == Some(&0.0) {
            weights.pop();
        }
        Ok(Self::from_weights(first, weights))
    }

    /// Scales weights to sum to one; the first is above 0.
    fn from_weights(first: usize, mut weights: Vec<f64>) -> Self {
        let sum: f64 = weights.iter().sum();
        weights.iter_mut().for_each(|weight| *weight /= sum);
        // Summed from the far end, so that small tails keep their digits.
        let mut tails = weights.clone();
        for at in (1..tails.len()).rev() {
            tails[at - 1] += tails[at];
        }
        Self { table: Arc::new(Table { first, weights, tails }) }
    }

    /// Smallest number of cells.
    #[must_use]
    pub fn first(&self) -> usize {
        self.table.first
    }

    /// Largest number of cells.
    #[must_use]
    pub fn last(&self) -> usize {
        self.table.first + self.table.weights.len() - 1
    }

    /// Probabilities of the numbers of cells from [`first`](Self::first) onwards; they sum to one.
    #[must_use]
    pub fn weights(&self) -> &[f64] {
        &self.table.weights
    }

    /// Mean number of cells.
    #[must_use]
    pub fn mean(&self) -> f64 {
        self.cells().map(|(cells, p)| p * cells).sum()
    }

    /// Variance of the number of cells.
    #[must_use]
    pub fn variance(&self) -> f64 {
        let mean = self.mean();
        self.cells().map(|(cells, p)| p * (cells - mean).powi(2)).sum()
    }

    fn cells(&self) -> impl Iterator<Item = (f64, f64)> {
        let first = self.table.first;
        self.table.weights.iter().enumerate().map(move |(at, p)| ((first + at) as f64, *p))
    }

    /// Probability of a number of cells, at most the last.
    pub(super) fn exactly(&self, cells: usize) -> f64 {
        cells.checked_sub(self.table.first).map_or(0.0, |at| self.table.weights[at])
    }

    /// Probability of at least a number of cells, at most the last.
    pub(super) fn at_least(&self, cells: usize) -> f64 {
        cells.checked_sub(self.table.first).map_or(1.0, |at| self.table.tails[at])
    }
}

impl fmt::Debug for Travel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (mean, variance) = (self.mean(), self.variance());
        let mut text = f.debug_struct("Travel");
        text.field("cells", &mean).field("variance", &variance).finish_non_exhaustive()
    }
}

/// Checks a reading; the metres may be negative.
pub(super) fn check_reading(metres: f64, variance: f64) -> Result<(), TransitionError> {
    if !metres.is_finite() {
        let text = format!("{metres} metres driven, expected a finite value");
        return Err(TransitionError::Control(text));
    }
    if !(variance >= 0.0 && variance.is_finite()) {
        let text = format!("a variance of {variance} of the metres driven, expected 0 or more");
        return Err(TransitionError::Control(text));
    }
    Ok(())
}

fn too_far(what: &str, value: f64) -> TransitionError {
    OutOfRange::new(what.to_owned(), value, "at most 10,000,000").into()
}

/// Probabilities e^−v I_k(v) of a symmetric Skellam distribution with variance v for k = 0, 1, …,
/// until they are below 1e-20 of the first.
///
/// By the ratios of successive Bessel functions, I_k / I_{k−1} = 1 / (2 k / v + I_{k+1} / I_k),
/// from far out, where any ratio will do, inwards.
#[expect(clippy::cast_sign_loss, reason = "a variance is at least 0")]
fn skellam(variance: f64) -> Vec<f64> {
    // Twelve deviations out, the distribution is far below 1e-20 of its peak. The ratio there is
    // taken as 0: the recursion shrinks this error at every step inwards.
    let far = (12.0 * variance.sqrt()) as usize + 20;
    let mut ratios = vec![0.0; far + 1];
    for k in (1..far).rev() {
        ratios[k] = 1.0 / (2.0 * k as f64 / variance + ratios[k + 1]);
    }
    let mut values = vec![1.0];
    for ratio in &ratios[1..] {
        let value = values[values.len() - 1] * ratio;
        if value < TAIL {
            break;
        }
        values.push(value);
    }
    // The values are I_k / I_0, and e^v = I_0 + 2 Σ I_k for the variance v. So dividing by this sum
    // makes the first value e^−v I_0.
    let sum = 2.0 * values.iter().rev().sum::<f64>() - 1.0;
    values.iter_mut().for_each(|value| *value /= sum);
    values
}
