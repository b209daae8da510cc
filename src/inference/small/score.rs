//! The log-likelihood, from both ends of a sequence to its middle:
//! p(y_1 … y_T) = Σ_i x_m(i) r_m(i) for any m.

use super::chain::{Chain, Matrix, UNLOOKED};
use super::diagonals::{Diagonals, Factors, Sensed};
use super::ends::{log_likelihood, middle, start};
use super::halves::{Put, Stretch, both};
use super::score_in_segments::in_segments;
use super::segments;
use super::{columns, control_of, filled_up, with_constant};
use crate::hmm::Hmm;
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::Transition;

/// How many steps of each half are gathered at a time: they stay in the fastest
/// cache.
const GATHERED: usize = 32 * UNLOOKED;

/// Up to so many states to go through segments is faster, or as fast with AVX2.
const MOST_IN_SEGMENTS: usize = 3;

/// [`Hmm::log_likelihood`], or `None` where it takes the general routine.
pub(in super::super) fn score<A, B, S>(hmm: &Hmm<A, B>, sequence: &S) -> Option<f64>
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
    dispatch(&matrix, prior, moves, steps, &mut Sensed::new(hmm, sequence))
}

fn dispatch(
    matrix: &[f64],
    prior: &[f64],
    moves: bool,
    steps: usize,
    diagonals: &mut dyn Diagonals,
) -> Option<f64> {
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

/// x and r, until they meet.
fn from_both_ends<const N: usize>(
    matrix: &Matrix<N>,
    prior: Chain<N>,
    moves: bool,
    steps: usize,
    diagonals: &mut dyn Diagonals,
) -> Option<f64> {
    let mut factors = [Factors::default(); 2];
    let (mut first, mut last) = (1, steps + 1); // the steps that are left
    let mut chains = [prior, Chain::new([1.0; N])?];
    if !moves {
        chains[0] = start(chains[0], diagonals, &mut factors[0])?;
        first = 2;
    }
    let middle = middle(first, steps);
    let length = GATHERED.min(last - middle);
    let mut gathered = vec![[0.0; N]; 2 * length];
    let (ahead, back) = gathered.split_at_mut(length);
    let mut places = vec![[0.0; N]; 2 * length];
    let (ahead_places, back_places) = places.split_at_mut(length);
    while first < middle || last > middle {
        let counts = [(middle - first).min(GATHERED), (last - middle).min(GATHERED)];
        let (ahead, back) = (&mut ahead[..counts[0]], &mut back[..counts[1]]);
        diagonals.ahead(first..first + counts[0], ahead.as_flattened_mut(), &mut factors[0])?;
        diagonals.back(last - counts[1]..last, back.as_flattened_mut(), &mut factors[1])?;
        let ahead = Stretch { diagonals: ahead, places: &mut ahead_places[..counts[0]] };
        let back = Stretch { diagonals: back, places: &mut back_places[..counts[1]] };
        both(matrix, &mut chains, ahead, back, Put::Vector)?;
        (first, last) = (first + counts[0], last - counts[1]);
    }
    log_likelihood(&chains, &factors)
}
