//! The forward pass over a whole sequence, in arrays: the filter's own
//! products, sums and roundings, so the same numbers to the bit. What the
//! filter would look at twice, it is asked to do itself.

use super::super::LogSum;
use super::columns::Order;
use super::likelihoods::{Factors, Gathered, gather};
use super::{columns, control_of, power, with_constant};
use crate::belief::Belief;
use crate::error::InferenceError;
use crate::hmm::Hmm;
use crate::inference::filter_state::FilterState;
use crate::inference::posteriors::Posteriors;
use crate::inference::step::is_one;
use crate::kernels::LIFT;
use crate::likelihood::{Likelihood, Scratch};
use crate::sequence::Sequence;
use crate::transition::Transition;

/// For fewer steps it is not worth while to find out how the operator adds.
const FEWEST_STEPS: usize = 800;
/// As in a step of the filter.
const LEAST_NORMALISER: f64 = power(-32);
/// A product below this part of their sum is looked at again.
const SMALL: f64 = f64::MIN_POSITIVE * power(42);

/// Filtered distributions, ln p(y_k | y_1 … y_{k-1}) of each step, and their
/// sum.
pub(in super::super) type Filtered = (Posteriors, Vec<f64>, f64);

/// [`Hmm::forward`], or `None` where it takes the general routine.
pub(in super::super) fn forward<A, B, S>(
    hmm: &Hmm<A, B>,
    sequence: &S,
) -> Option<Result<Filtered, InferenceError>>
where
    A: Transition,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation> + ?Sized,
{
    let (n, steps) = (hmm.states(), sequence.steps());
    let control = control_of(hmm, steps.saturating_sub(FEWEST_STEPS))?;
    let matrix = columns::of(hmm.transition(), control)?;
    let order = columns::order(hmm.transition(), control, &matrix)?;
    let mut pass = Pass {
        values: hmm.prior().belief().as_slice().to_vec(),
        logs: Vec::with_capacity(steps),
        sum: LogSum::default(),
    };
    pass.values.reserve_exact(n * steps);
    let mut gathered = Gathered::default();
    let mut scratch = Scratch::default();
    let mut filter = hmm.filter();
    while pass.logs.len() < steps {
        let first = pass.logs.len() + 1;
        if hmm.prior().moves_at(first) {
            gather(hmm, sequence, first, &mut scratch, &mut gathered);
            if pass.advance(&matrix, order, &gathered) {
                continue;
            }
        }
        // The next step, and others as long as the filter keeps logarithms.
        let before = FilterState {
            steps: pass.logs.len(),
            belief: Belief::known(pass.values[pass.values.len() - n..].to_vec()),
            logs: None,
            log_likelihood: pass.sum,
        };
        let mut taken = filter.restore(&before);
        while taken.is_ok() && pass.logs.len() < steps {
            let number = pass.logs.len() + 1;
            let log = filter.step_with(sequence.control(number), sequence.observation(number));
            taken = log.map(|log| pass.logs.push(log));
            pass.values.extend_from_slice(filter.held().linear);
            if filter.held().logs.is_none() {
                break;
            }
        }
        if let Err(error) = taken {
            return Some(Err(error));
        }
        pass.sum = filter.state().log_likelihood;
    }
    Some(Ok((Posteriors::from_values(n, pass.values), pass.logs, pass.sum.value())))
}

/// What there is so far.
struct Pass {
    values: Vec<f64>,
    logs: Vec<f64>,
    sum: LogSum,
}

impl Pass {
    /// Goes on as far as it can; whether that is through all that was
    /// gathered.
    fn advance(&mut self, matrix: &[f64], order: Order, gathered: &Gathered) -> bool {
        let done = match order {
            Order::OneByOne => self.dispatch::<false>(matrix, gathered),
            Order::ByFours => self.dispatch::<true>(matrix, gathered),
        };
        done.is_some_and(|done| done == gathered.wanted)
    }

    fn dispatch<const FOURS: bool>(
        &mut self,
        matrix: &[f64],
        gathered: &Gathered,
    ) -> Option<usize> {
        let n = gathered.states;
        with_constant!(n, N => self.run::<N, FOURS>(matrix, gathered))
    }

    /// Returns how many steps it took.
    fn run<const N: usize, const FOURS: bool>(
        &mut self,
        matrix: &[f64],
        gathered: &Gathered,
    ) -> Option<usize> {
        let matrix: [[f64; N]; N] = matrix.as_chunks().0.try_into().ok()?;
        let mut belief = *self.values.last_chunk::<N>()?;
        let before = self.logs.len();
        for (b, factors) in gathered.values.as_chunks::<N>().0.iter().zip(&gathered.factors) {
            let Some(normaliser) = step::<N, FOURS>(&matrix, b, factors, &mut belief) else {
                break;
            };
            self.values.extend_from_slice(&belief);
            self.logs.push(normaliser);
        }
        let taken = &mut self.logs[before..];
        for (log, factors) in taken.iter_mut().zip(&gathered.factors) {
            *log = log.ln() + factors.log_scale + factors.log_factor;
            self.sum.add(*log);
        }
        Some(taken.len())
    }
}

/// One step of the filter: its normaliser, and the belief after it; or `None`,
/// and the belief as it was.
#[inline]
fn step<const N: usize, const FOURS: bool>(
    matrix: &[[f64; N]; N],
    b: &[f64; N],
    factors: &Factors,
    belief: &mut [f64; N],
) -> Option<f64> {
    let predicted = columns::product::<N, FOURS>(matrix, &belief.map(|p| p * LIFT));
    let mut after = predicted;
    after.iter_mut().zip(b).for_each(|(after, b)| *after *= b);
    let products = sum(&after);
    let normaliser = products / LIFT;
    let mut valid = is_one(sum(&predicted) / LIFT);
    valid &= normaliser >= LEAST_NORMALISER * factors.largest;
    for i in 0..N {
        // 0 only where it has to be.
        let zero = after[i] == 0.0 && (predicted[i] == 0.0 || b[i] == 0.0);
        valid &= zero || after[i] >= SMALL * products;
    }
    if !valid {
        return None;
    }
    let factor = 1.0 / products;
    *belief = after.map(|p| p * factor);
    Some(normaliser)
}

/// Σ xᵢ, in the order of `kernels::sum`.
#[inline]
fn sum<const N: usize>(x: &[f64; N]) -> f64 {
    match x.as_slice() {
        [a, b, c, d, e, f, g, h] => ((a + b) + (c + d)) + ((e + f) + (g + h)),
        x => x.iter().sum(),
    }
}
