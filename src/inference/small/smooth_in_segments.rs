//! The smoother over eight segments at a time: forward from segment to segment,
//! then backward, and on the way back through the steps of each.

use std::ops::Range;

use super::chain::{Chain, Matrix};
use super::diagonals::{Diagonals, Factors};
use super::ends::{log_likelihood, start};
use super::halves::posterior;
use super::segments::{self, Segments, Source, eight};
use crate::kernels::lockstep::{Abreast, scatter};
use crate::kernels::segments_smooth::Smooth;
use crate::kernels::{self, Eight, LANES, in_large_pages};

/// What is known of eight segments before the way back.
struct Kept<const N: usize> {
    steps: Range<usize>,
    unlooked: usize,
    segments: Segments<N>,
    /// x at their starts.
    starts: [Eight; N],
}

/// x through segment after segment, r back, then both through the steps of each.
pub(super) fn in_segments<const N: usize>(
    matrix: &Matrix<N>,
    prior: Chain<N>,
    moves: bool,
    steps: usize,
    diagonals: &mut dyn Diagonals,
) -> Option<(Vec<f64>, f64)> {
    let mut source = Source::new(diagonals);
    let (mut chain, mut first) = (prior, 1);
    let mut values = in_large_pages(vec![0.0; N * (steps + 1)]);
    let rows = values.as_chunks_mut::<N>().0;
    if !moves {
        chain = start(chain, source.diagonals, &mut source.factors)?;
        first = 2;
    }
    let before = chain;
    let (mut likelihoods, mut smoothed) = (Vec::new(), Vec::new());
    let mut kept = Vec::new();
    while let Some(length) = segments::length(steps + 1 - first) {
        likelihoods.resize(length, [Abreast::default(); N]);
        let unlooked = source.gather(matrix, first, &mut likelihoods)?;
        let segments = Segments::new(matrix, &likelihoods, unlooked)?;
        let starts = segments.ahead(&mut chain)?;
        // Until the way back they wait where results will be.
        let steps = first..first + LANES * length;
        let place = rows[steps.clone()].as_flattened_mut().as_chunks_mut().0;
        place.iter_mut().zip(likelihoods.as_flattened()).for_each(|(to, b)| *to = b.0);
        first = steps.end;
        kept.push(Kept { steps, unlooked, segments, starts });
    }
    let rest = source.rest(matrix, first..steps + 1)?;
    rest.ahead(matrix, &mut chain, &mut rows[first..])?;
    let mut back = Chain::new([1.0; N])?;
    let log_likelihood = log_likelihood(&[chain, back], &[source.factors, Factors::default()])?;

    rest.back(matrix, &mut back, &mut rows[first..])?;
    while let Some(Kept { steps, unlooked, segments, starts }) = kept.pop() {
        let ends = segments.back(&mut back)?;
        let place = rows[steps].as_flattened_mut();
        let length = place.len() / (LANES * N);
        likelihoods.resize(length, [Abreast::default(); N]);
        smoothed.resize(length, [Abreast::default(); N]);
        let from = likelihoods.as_flattened_mut().iter_mut();
        from.zip(place.as_chunks().0).for_each(|(b, from)| b.0 = *from);
        let work = Smooth {
            model: matrix.few(unlooked),
            starts: &starts,
            ends: &ends,
            likelihoods: &likelihoods,
            out: &mut smoothed,
        };
        kernels::segments_smooth::smooth(work).then_some(())?;
        scatter(smoothed.as_flattened(), eight(place));
    }
    let first = usize::from(!moves);
    rows[first] = posterior(&before.values, &back.values);
    rows[0] = rows[first]; // the same state, if nothing moves
    Some((values, log_likelihood))
}
