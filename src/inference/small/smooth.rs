//! The smoother from both ends of a sequence: p(X_k | y_1 … y_T) is in
//! proportion to x_k ∘ r_k. Each recursion keeps its results in its own half;
//! after the middle it meets those of the other.

use super::chain::{Chain, Matrix};
use super::diagonals::{Diagonals, Factors, Sensed};
use super::ends::{log_likelihood, middle, start};
use super::halves::{Put, Stretch, both, posterior};
use super::segments;
use super::smooth_in_segments::in_segments;
use super::{columns, control_of, filled_up, with_constant, without_room};
use crate::hmm::Hmm;
use crate::inference::posteriors::Posteriors;
use crate::kernels::in_large_pages;
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::Transition;

/// Up to so many states to go through segments is faster, or as fast with half the
/// memory.
const MOST_IN_SEGMENTS: usize = 4;

/// [`Hmm::smooth`], or `None` where it takes the general routine.
pub(in super::super) fn smooth<A, B, S>(hmm: &Hmm<A, B>, sequence: &S) -> Option<(Posteriors, f64)>
where
    A: Transition,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation> + ?Sized,
{
    let steps = sequence.steps();
    let control = control_of(hmm, steps)?;
    let matrix = columns::of(hmm.transition(), control)?;
    let prior = hmm.prior().belief().as_slice();
    let moves = hmm.prior().moves_at(1);
    let (mut values, log_likelihood) =
        dispatch(&matrix, prior, moves, steps, &mut Sensed::new(hmm, sequence))?;
    without_room(&mut values, hmm.states());
    Some((Posteriors::from_values(hmm.states(), values), log_likelihood))
}

fn dispatch(
    matrix: &[f64],
    prior: &[f64],
    moves: bool,
    steps: usize,
    diagonals: &mut dyn Diagonals,
) -> Option<(Vec<f64>, f64)> {
    with_constant!(prior.len(), N => {
        let matrix = Matrix::<N>::new(matrix, prior.len())?;
        let prior = Chain::new(filled_up(prior, 0.0)?)?;
        // A constant, so that there is no code for sizes that do not pay.
        let first = if const { N <= MOST_IN_SEGMENTS } && segments::enough(steps) {
            in_segments(&matrix, prior, moves, steps, diagonals)
        } else {
            None
        };
        first.or_else(|| from_both_ends(&matrix, prior, moves, steps, diagonals))
    })
}

/// x and r at once, until they meet, and beyond.
fn from_both_ends<const N: usize>(
    matrix: &Matrix<N>,
    prior: Chain<N>,
    moves: bool,
    steps: usize,
    diagonals: &mut dyn Diagonals,
) -> Option<(Vec<f64>, f64)> {
    let mut factors = [Factors::default(); 2];
    let mut chains = [prior, Chain::new([1.0; N])?];
    let mut values = in_large_pages(vec![0.0; N * (steps + 1)]);
    let rows = values.as_chunks_mut::<N>().0;
    rows[0] = chains[0].values;
    if !moves {
        chains[0] = start(chains[0], diagonals, &mut factors[0])?;
        rows[1] = chains[0].values;
    }
    let first = if moves { 1 } else { 2 };
    let middle = middle(first, steps);

    // Row k − 1 for step k.
    let mut all = vec![0.0; N * steps];
    let (ahead, back) = all.split_at_mut(N * (middle - 1));
    let later = &mut ahead[N * (first - 1)..];
    diagonals.ahead(first..middle, later, &mut factors[0])?;
    diagonals.back(middle..steps + 1, back, &mut factors[1])?;
    let all = all.as_chunks::<N>().0;

    let (ahead, back) = rows.split_at_mut(middle);
    let early = Stretch { diagonals: &all[first - 1..middle - 1], places: &mut ahead[first..] };
    let late = Stretch { diagonals: &all[middle - 1..], places: back };
    both(matrix, &mut chains, early, late, Put::Vector)?;
    let log_likelihood = log_likelihood(&chains, &factors)?;
    let late = Stretch { diagonals: &all[middle - 1..], places: back };
    let early = Stretch { diagonals: &all[first - 1..middle - 1], places: &mut ahead[first..] };
    both(matrix, &mut chains, late, early, Put::Posterior)?;
    rows[first - 1] = posterior(&rows[first - 1], &chains[1].values);
    if !moves {
        rows[0] = rows[1]; // the same state
    }
    Some((values, log_likelihood))
}
