//! A step of Viterbi, formula 7 of the guide: v'(i) = log2 b(i) + max over j of log2 A\[i, j\] + v(j).
//!
//! Scores are on the grid of 2^-45 (`log2`), so that their sums are exact above -256, and ties are
//! ties to the bit. Callers keep the best near 0: they take the whole part of the largest score out
//! of the next step, by its `shift`.

use crate::layout::{EntryValues, Maxima, Sink, Sliced};
use crate::log2::{log2_lanes, log2_over};
use crate::semiring::MaxPlus;
use crate::simd::{
    Blocks, BlocksMut, LANES, Simd, kernels, row_block, row_block_ahead, store, store_indices,
};

/// Scores of an observation, before `shift` is subtracted.
#[derive(Debug, Clone, Copy)]
pub struct Scores<'a> {
    pub values: &'a [f64],
    pub form: ScoresIn,
    pub shift: f64,
}

/// How scores are given.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ScoresIn {
    Log2,
    /// Natural logarithms, and the largest of them, which is subtracted.
    Ln(f64),
    /// Likelihoods.
    Linear,
}

impl Scores<'_> {
    /// Scores of given values.
    #[inline(always)]
    fn score<S: Simd>(self, s: S, b: S::V) -> S::V {
        // The form is the same for all blocks: the branch is taken out of the loop, or predicted.
        let b = match self.form {
            ScoresIn::Log2 => b,
            ScoresIn::Ln(largest) => log2_over(s, b, largest),
            ScoresIn::Linear => log2_lanes(s, b),
        };
        s.sub(b, s.splat(self.shift))
    }

    /// Writes the scores of all states.
    pub fn write(self, out: &mut [f64]) {
        // Added to zeros: 0 + x is x, except for −0, which no comparison tells from 0.
        out.fill(0.0);
        add_scores(out, Some(self));
    }
}

kernels! {
    /// `next` = max over j of log2 A\[i, j\] + `x[j]`, plus the likelihood of i if likelihoods are
    /// given; `from[i]` is the lowest j that attains it. `log2` has the logarithms of the values.
    /// Returns the largest of `next`.
    pub fn max_step = maximize<'a>(
        matrix: &'a Sliced, log2: &'a EntryValues, x: &'a [f64], likelihoods: Option<Scores<'a>>,
        next: &'a mut [f64], from: &'a mut [u32],
    ) -> f64;

    /// Adds the scores of an observation to those of the states, and returns the largest.
    pub fn add_scores = add<'a>(scores: &'a mut [f64], added: Option<Scores<'a>>) -> f64;
}

#[inline(always)]
fn maximize<S: Simd>(
    s: S,
    matrix: &Sliced,
    log2: &EntryValues,
    x: &[f64],
    likelihoods: Option<Scores<'_>>,
    next: &mut [f64],
    from: &mut [u32],
) -> f64 {
    let n = matrix.lines();
    assert!(x.len() == n && next.len() == n && from.len() == n, "one value per state");
    // Likelihoods for the wrong number of states would silently give a wrong answer: where a full
    // block is missing, the kernel reads the remainder instead.
    assert!(likelihoods.is_none_or(|b| b.values.len() == n), "one likelihood per state");
    let mut sink = MaxSink::<S> {
        likelihoods: likelihoods.map(|b| (b, b.values.as_chunks())),
        next: next.as_chunks_mut(),
        from: from.as_chunks_mut(),
        largest: s.splat(f64::NEG_INFINITY),
    };
    matrix.product_with(s, MaxPlus, 0..n.div_ceil(LANES), log2, x, &mut sink);
    largest_of(s, sink.largest, sink.next.1)
}

struct MaxSink<'a, S: Simd> {
    likelihoods: Option<(Scores<'a>, Blocks<'a>)>,
    next: BlocksMut<'a>,
    from: (&'a mut [[u32; LANES]], &'a mut [u32]),
    /// Largest of whole blocks.
    largest: S::V,
}

impl<S: Simd> Sink<S, Maxima<S>> for MaxSink<'_, S> {
    #[inline(always)]
    fn take(&mut self, s: S, block: usize, Maxima { mut value, index }: Maxima<S>) {
        if let Some((likelihoods, values)) = self.likelihoods {
            value =
                s.add(value, likelihoods.score(s, row_block_ahead::<S, true>(s, values, block)));
        }
        store(s, &mut self.next, block, value);
        store_indices(s, &mut self.from, block, index);
        // Lanes of the last block beyond the last row must not count: `largest_of` reads its rows.
        if block < self.next.0.len() {
            self.largest = s.max(value, self.largest);
        }
    }
}

/// Largest value of the lanes and of the rest.
#[inline(always)]
fn largest_of<S: Simd>(s: S, largest: S::V, rest: &[f64]) -> f64 {
    let largest = s.to_array(largest).into_iter().chain(rest.iter().copied());
    largest.fold(f64::NEG_INFINITY, f64::max)
}

#[inline(always)]
fn add<S: Simd>(s: S, scores: &mut [f64], added: Option<Scores<'_>>) -> f64 {
    let blocks = scores.len().div_ceil(LANES);
    let mut sums = scores.as_chunks_mut::<LANES>();
    // Empty without likelihoods, and then not read.
    let values = added.map_or((&[][..], &[][..]), |added| added.values.as_chunks());
    let mut largest = s.splat(f64::NEG_INFINITY);
    for block in 0..blocks {
        let mut sum = row_block(s, (sums.0, sums.1), block);
        if let Some(added) = added {
            sum = s.add(sum, added.score(s, row_block(s, values, block)));
        }
        store(s, &mut sums, block, sum);
        // `row_block` fills the rest with zeros, which may exceed all scores.
        if block < sums.0.len() {
            largest = s.max(sum, largest);
        }
    }
    largest_of(s, largest, sums.1)
}
