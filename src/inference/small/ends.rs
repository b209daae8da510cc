//! The ends of a sequence, and where its halves meet.

use super::super::LogSum;
use super::LEAST_FACTOR;
use super::chain::{Chain, none_between_0_and, times};
use super::diagonals::{Diagonals, Factors};

/// x_1 where nothing moves before the first observation.
pub(super) fn start<const N: usize>(
    prior: Chain<N>,
    diagonals: &mut dyn Diagonals,
    factors: &mut Factors,
) -> Option<Chain<N>> {
    let mut chain = prior;
    let mut b = [0.0; N];
    diagonals.ahead(1..2, &mut b, factors)?;
    none_between_0_and(LEAST_FACTOR, &b).then_some(())?;
    chain.values = times(&b, &chain.values);
    chain.look()?;
    Some(chain)
}

/// Where the forward half ends: it takes the steps before this one.
pub(super) fn middle(first: usize, steps: usize) -> usize {
    first.midpoint(steps + 1)
}

/// ln p(y_1 … y_T), where the halves meet.
pub(super) fn log_likelihood<const N: usize>(
    chains: &[Chain<N>; 2],
    factors: &[Factors; 2],
) -> Option<f64> {
    let both: f64 = times(&chains[0].values, &chains[1].values).iter().sum();
    let mut sum = LogSum::default();
    sum.add(both.ln());
    factors
        .iter()
        .zip(chains)
        .for_each(|(factors, chain)| factors.add_to(&mut sum, chain.exponent));
    (both > 0.0).then(|| sum.value())
}
