//! [`FusedLikelihood`], the fusion of two sensors: the product of their diagonals.
//!
//! Products of numbers are exact unless they leave the range of normal doubles. If one does, or if
//! a sensor gives logarithms, all are added in logarithms, so that no state is lost.

use rand::Rng;

use super::Values;
use super::owned::Owned;
use super::{Diagonal, Likelihood, LocalLikelihood, SampleObservation, Scratch, check_local};
use crate::error::{HmmError, LikelihoodError};

/// Two sensors whose errors are independent given the state: the product of their diagonals. The
/// observation is a pair; nest fusions for more than two sensors.
///
/// ```
/// use wayfix::likelihood::LogLikelihoodFn;
/// use wayfix::{FusedLikelihood, Likelihood, OptionalLikelihood, TableLikelihood};
///
/// let camera = TableLikelihood::from_rows(&[[0.9, 0.1], [0.2, 0.8]])?;
/// let odometer = LogLikelihoodFn::new(2, |km: &f64, i| -(km - i as f64).powi(2));
/// let both = FusedLikelihood::new(OptionalLikelihood::new(camera), odometer)?;
/// # use wayfix::{Belief, DenseTransition, Hmm, Prior};
/// # let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
/// let hmm = Hmm::new(prior, DenseTransition::from_rows(&[[0.5; 2]; 2])?, both)?;
/// let smoothing = hmm.smooth(&[(Some(0), 0.2), (None, 0.4)])?;
/// # assert_eq!(smoothing.posteriors().modes(), [0, 0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy)]
pub struct FusedLikelihood<B1, B2> {
    pub(crate) first: B1,
    pub(crate) second: B2,
}

impl<B1: Likelihood, B2: Likelihood> FusedLikelihood<B1, B2> {
    /// Fuses two sensors.
    ///
    /// # Errors
    ///
    /// [`HmmError::StateCount`] if the sensors differ in their number of states.
    pub fn new(first: B1, second: B2) -> Result<Self, HmmError>
    where
        B1::Observation: Owned,
        B2::Observation: Owned,
    {
        let (expected, found) = (first.states(), second.states());
        if found != expected {
            return Err(HmmError::StateCount {
                part: "second sensor",
                found,
                first: "first sensor",
                expected,
            });
        }
        Ok(Self { first, second })
    }

    /// Returns the first sensor.
    #[must_use]
    pub fn first(&self) -> &B1 {
        &self.first
    }

    /// Returns the second sensor.
    #[must_use]
    pub fn second(&self) -> &B2 {
        &self.second
    }
}

impl<B1, B2> Likelihood for FusedLikelihood<B1, B2>
where
    B1: Likelihood<Observation: Sized>,
    B2: Likelihood<Observation: Sized>,
{
    type Observation = (B1::Observation, B2::Observation);

    fn states(&self) -> usize {
        self.first.states()
    }

    fn diagonal<'a>(
        &'a self,
        (first, second): &'a Self::Observation,
        scratch: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        let n = self.states();
        let (product, parts) = scratch.with_parts(n, 2);
        let (left, right) = parts.split_at_mut(1);
        let first = self.first.diagonal(first, &mut left[0])?;
        let second = self.second.diagonal(second, &mut right[0])?;
        product_of(&first, &second, product)
    }
}

impl<B1, B2> LocalLikelihood for FusedLikelihood<B1, B2>
where
    B1: LocalLikelihood<Observation: Sized>,
    B2: LocalLikelihood<Observation: Sized>,
{
    fn local<'a>(
        &'a self,
        (first, second): &'a Self::Observation,
        states: &[usize],
        scratch: &'a mut Scratch,
    ) -> Result<(Diagonal<'a>, f64), LikelihoodError> {
        let (product, parts) = scratch.with_parts(states.len(), 2);
        let (left, right) = parts.split_at_mut(1);
        let (first, most_first) = self.first.local(first, states, &mut left[0])?;
        let (second, most_second) = self.second.local(second, states, &mut right[0])?;
        let largest =
            (check_local(&first, most_first, states)?, check_local(&second, most_second, states)?);
        // In a state that is not asked for, each factor is at most its bound, so the product is at
        // most the product of the bounds.
        let others = most_first * most_second;
        let exact = is_exact(most_first, most_second, others);
        let product = multiplied(&first, &second, largest, exact, product);
        if !product.is_log() {
            // Rounded up: a bound must not fall below the exact product.
            let others = if others > 0.0 { others.next_up() } else { 0.0 };
            return Ok((product, others.min(f64::MAX)));
        }
        // The bound gets the shifts that `multiplied` took out of the values.
        let shift = (shift(first.is_log(), largest.0), shift(second.is_log(), largest.1));
        let log = |part: &Diagonal<'_>, b: f64| if part.is_log() { b } else { b.ln() };
        let logs = (log(&first, most_first), log(&second, most_second));
        let others = (logs.0 - shift.0) + (logs.1 - shift.1);
        // The logarithms of the bounds and the three sums are rounded, so the bound is raised.
        let size = logs.0.abs() + logs.1.abs() + shift.0.abs() + shift.1.abs();
        let others = if size.is_finite() { others + 4.0 * f64::EPSILON * size } else { others };
        Ok((product, others))
    }

    fn listed_states(&self, (first, second): &Self::Observation, states: &mut Vec<usize>) {
        self.first.listed_states(first, states);
        self.second.listed_states(second, states);
    }
}

/// Product of two diagonals, written to `out`, which has a value for each state.
///
/// # Errors
///
/// [`LikelihoodError`] if one of them is not valid.
pub fn product_of<'a>(
    first: &Diagonal<'_>,
    second: &Diagonal<'_>,
    out: &'a mut [f64],
) -> Result<Diagonal<'a>, LikelihoodError> {
    let largest = (first.check(out.len())?, second.check(out.len())?);
    Ok(multiplied(first, second, largest, true, out))
}

/// Product of two diagonals with these maxima; in logarithms unless `exact` is true and all
/// products are exact.
fn multiplied<'a>(
    first: &Diagonal<'_>,
    second: &Diagonal<'_>,
    largest: (f64, f64),
    exact: bool,
    out: &'a mut [f64],
) -> Diagonal<'a> {
    let log_factor = first.log_factor + second.log_factor;
    if exact && multiply(first.values, second.values, out) {
        return Diagonal { log_factor, ..Diagonal::linear(out) };
    }
    // The maxima are subtracted first: logarithms of -100,000 have lost digits that their
    // differences still have.
    let shift = (shift(first.is_log(), largest.0), shift(second.is_log(), largest.1));
    let logs = first.logs().zip(second.logs());
    out.iter_mut().zip(logs).for_each(|(out, (a, b))| *out = (a - shift.0) + (b - shift.1));
    let log_factor = log_factor + (shift.0 + shift.1);
    Diagonal { log_factor, ..Diagonal::log(out) }
}

/// Amount to subtract from logarithms with the given maximum; 0 for linear values.
fn shift(is_log: bool, largest: f64) -> f64 {
    if is_log && largest.is_finite() { largest } else { 0.0 }
}

/// True if a product is a normal number, and so has full precision, or is 0 because a factor is 0.
fn is_exact(a: f64, b: f64, product: f64) -> bool {
    (f64::MIN_POSITIVE..=f64::MAX).contains(&product) || a == 0.0 || b == 0.0
}

/// Multiplies two diagonals into `out`. Returns false if one is in logarithms, or a product leaves
/// the range of normal numbers; `out` is then incomplete.
fn multiply(first: Values<'_>, second: Values<'_>, out: &mut [f64]) -> bool {
    let (
        Values::Linear(first) | Values::Checked { linear: first, .. },
        Values::Linear(second) | Values::Checked { linear: second, .. },
    ) = (first, second)
    else {
        return false;
    };
    out.iter_mut().zip(first).zip(second).all(|((out, a), b)| {
        *out = a * b;
        is_exact(*a, *b, *out)
    })
}

impl<Y1, Y2, B1, B2> SampleObservation for FusedLikelihood<B1, B2>
where
    B1: SampleObservation<Observation = Y1, Sample = Y1>,
    B2: SampleObservation<Observation = Y2, Sample = Y2>,
{
    type Sample = (Y1, Y2);

    fn sample<R: Rng + ?Sized>(&self, state: usize, rng: &mut R) -> (Y1, Y2) {
        (self.first.sample(state, rng), self.second.sample(state, rng))
    }
}

#[cfg(feature = "serde")]
crate::stored! {
    [B1: Likelihood<Observation: Sized>, B2: Likelihood<Observation: Sized>] FusedLikelihood<B1, B2>: [B1, B2], |fused| {
        first: B1 = fused.first,
        second: B2 = fused.second,
    } => Self::new(first, second);
}
