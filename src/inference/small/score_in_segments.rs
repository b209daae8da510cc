//! The log-likelihood, forward through eight segments at a time.

use super::chain::{Chain, Matrix};
use super::diagonals::{Diagonals, Factors};
use super::ends::{log_likelihood, start};
use super::segments::{self, Segments, Source};
use crate::kernels::LANES;
use crate::kernels::lockstep::Abreast;

/// x through segment after segment.
pub(super) fn in_segments<const N: usize>(
    matrix: &Matrix<N>,
    prior: Chain<N>,
    moves: bool,
    steps: usize,
    diagonals: &mut dyn Diagonals,
) -> Option<f64> {
    let mut source = Source::new(diagonals);
    let (mut chain, mut first) = (prior, 1);
    if !moves {
        chain = start(chain, source.diagonals, &mut source.factors)?;
        first = 2;
    }
    let mut likelihoods = Vec::new();
    while let Some(length) = segments::length(steps + 1 - first) {
        likelihoods.resize(length, [Abreast::default(); N]);
        let unlooked = source.gather(matrix, first, &mut likelihoods)?;
        Segments::new(matrix, &likelihoods, unlooked)?.ahead(&mut chain)?;
        first += LANES * length;
    }
    let rest = source.rest(matrix, first..steps + 1)?;
    rest.ahead(matrix, &mut chain, &mut vec![[0.0; N]; steps + 1 - first])?;
    let ones = Chain::new([1.0; N])?;
    log_likelihood(&[chain, ones], &[source.factors, Factors::default()])
}
