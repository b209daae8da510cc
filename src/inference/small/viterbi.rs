//! Viterbi decoding: the same sums, comparisons and roundings as those of the
//! general routine, so the same path and probability to the bit.
//!
//! Scores are on a grid on which sums below 256 are exact, so that whole
//! numbers may as well be taken out every few steps, as long as no score falls
//! far behind. Where one does, they are taken out at every step.

use std::f64::consts::{LN_2, LOG2_E};
use std::ops::Range;

use super::chain::UNLOOKED;
use super::{MOST_STATES, control_of, filled_up, with_constant};
use crate::hmm::Hmm;
use crate::inference::scores::{TakenOut, best, likelihood_scores};
use crate::inference::step::{Step, Workspace};
use crate::kernels::{LARGEST_LOG, log2, on_grid};
use crate::likelihood::{Diagonal, Likelihood, Scratch, Values};
use crate::sequence::Sequence;
use crate::transition::TransitionEntries;

/// How many steps are gathered at a time.
const GATHERED: usize = 32 * UNLOOKED;
/// Scores from here on may go [`UNLOOKED`] steps unlooked at.
const NEAR: f64 = -50.0;
/// Sums of scores above this, and of what led to them, were exact.
const EXACT: f64 = -100.0;

/// [`Hmm::viterbi`], states and log-probability, or `None` where it takes the
/// general routine.
pub(in super::super) fn viterbi<A, B, S>(hmm: &Hmm<A, B>, sequence: &S) -> Option<(Vec<usize>, f64)>
where
    A: TransitionEntries,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation> + ?Sized,
{
    let (n, steps) = (hmm.states(), sequence.steps());
    let control = control_of(hmm, steps)?;
    // log2 A, column after column: what a path in one state becomes.
    let mut from = vec![0; n];
    let (mut one, mut columns) = (vec![f64::NEG_INFINITY; n], vec![0.0; n * n]);
    for (j, column) in columns.chunks_exact_mut(n).enumerate() {
        one[j] = 0.0;
        hmm.transition().max_product(control, &one, column, &mut from);
        one[j] = f64::NEG_INFINITY;
    }
    let (mut scores, mut taken_out) = (vec![0.0; n], TakenOut::default());
    let step = Step::of(hmm, sequence, 1);
    let mut work = Workspace::new(n);
    step.first_scores(&mut scores, &mut TakenOut::default()).ok()?;
    step.observe(sequence.observation(1), &mut work, &mut scores, &mut taken_out).ok()?;
    step.settle(&mut scores, &mut taken_out).ok()?;
    let mut source = Sensed { hmm, sequence, scratch: work.scratch, taken_out };
    let states = dispatch(&columns, &mut scores, steps, &mut source)?;
    let score = scores[best(&scores)];
    Some((states, source.taken_out.log_probability(score)))
}

/// Whatever gives scores of observations, without its type.
trait Scores {
    /// Gathers log2 B(y) of some steps, but for common parts.
    fn gather(&mut self, steps: Range<usize>, out: &mut [f64]) -> Option<()>;

    /// Notes a whole number that was taken out.
    fn take_out(&mut self, whole: f64);
}

struct Sensed<'m, A, B, S: ?Sized> {
    hmm: &'m Hmm<A, B>,
    sequence: &'m S,
    scratch: Scratch,
    taken_out: TakenOut,
}

impl<A, B, S> Sensed<'_, A, B, S>
where
    A: TransitionEntries,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation> + ?Sized,
{
    fn put<const N: usize>(&mut self, steps: Range<usize>, out: &mut [f64]) -> Option<()> {
        let states = self.hmm.states();
        for (step, out) in steps.zip(out.as_chunks_mut::<N>().0) {
            let observation = self.sequence.observation(step);
            let diagonal = self.hmm.likelihood().diagonal(observation, &mut self.scratch).ok()?;
            // Inlined for those of tables alone: others need a logarithm for each anyway.
            let left_out = match diagonal.values {
                Values::Checked { log2: Some(log2), .. } if diagonal.log_factor == 0.0 => {
                    match <&[f64; N]>::try_from(log2) {
                        Ok(log2) => put_log2(log2, out),
                        Err(_) => put_any(diagonal, out.get_mut(..states)?)?,
                    }
                }
                Values::Linear(b) if diagonal.log_factor == 0.0 => {
                    put_linear(b, out.get_mut(..states)?)?
                }
                _ => put_any(diagonal, out.get_mut(..states)?)?,
            };
            self.taken_out.factors.add(left_out);
        }
        Some(())
    }
}

impl<A, B, S> Scores for Sensed<'_, A, B, S>
where
    A: TransitionEntries,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation> + ?Sized,
{
    fn gather(&mut self, steps: Range<usize>, out: &mut [f64]) -> Option<()> {
        with_constant!(self.hmm.states(), N => self.put::<N>(steps, out))
    }

    fn take_out(&mut self, whole: f64) {
        self.taken_out.whole += whole;
    }
}

/// The scores of an observation. Gives the logarithm of what is taken out; `None` if the
/// likelihoods are not valid, or nothing is possible.
///
/// By value: a reference would have each diagonal written to memory, which is a tenth of
/// a step of two states.
#[inline(never)]
fn put_any(diagonal: Diagonal<'_>, out: &mut [f64]) -> Option<f64> {
    if diagonal.len() != out.len() {
        return None;
    }
    if diagonal.log_factor != 0.0 {
        let largest = diagonal.check(out.len()).ok()?;
        let mut values = [0.0; MOST_STATES];
        let values = values.get_mut(..out.len())?;
        let (scores, left_out) = likelihood_scores(&diagonal, largest, values)?;
        for (out, score) in out.iter_mut().zip(scores.scores) {
            *out = score - scores.shift;
        }
        return Some(left_out);
    }
    match diagonal.values {
        Values::Checked { log2: Some(log2), .. } => put_some(log2, out),
        Values::Linear(b) | Values::Checked { linear: b, .. } => put_linear(b, out),
        Values::Log(logs) => put_logs(logs, out),
    }
}

/// The same of likelihoods.
fn put_linear(b: &[f64], out: &mut [f64]) -> Option<f64> {
    match out.len() {
        2 => put_few(b, out.first_chunk_mut::<2>()?),
        3 => put_few(b, out.first_chunk_mut::<3>()?),
        4 => put_few(b, out.first_chunk_mut::<4>()?),
        _ => {
            let mut all = [0.0; MOST_STATES];
            all.get_mut(..b.len())?.copy_from_slice(b);
            let mut scores = [0.0; MOST_STATES];
            let whole = put_few(&all, &mut scores)?;
            (b.len() == out.len()).then(|| out.copy_from_slice(&scores[..b.len()]))?;
            Some(whole)
        }
    }
}

/// [`put_linear`], where the length is known for loops without a count.
#[inline(always)]
fn put_few<const N: usize>(b: &[f64], out: &mut [f64; N]) -> Option<f64> {
    let b: &[f64; N] = b.try_into().ok()?;
    if !b.iter().all(|b| (0.0..=f64::MAX).contains(b)) {
        return None;
    }
    Some(put_log2(&b.map(log2), out))
}

/// [`put_log2`] of any number of states.
fn put_some(log2: &[f64], out: &mut [f64]) -> Option<f64> {
    let (all, mut scores) = (filled_up(log2, f64::NEG_INFINITY)?, [0.0; MOST_STATES]);
    let whole = put_log2::<MOST_STATES>(&all, &mut scores);
    (log2.len() == out.len()).then(|| out.copy_from_slice(&scores[..log2.len()]))?;
    Some(whole)
}

/// Scores from logarithms to base 2. Gives the logarithm of what is taken out.
#[inline(always)]
fn put_log2<const N: usize>(log2: &[f64; N], out: &mut [f64; N]) -> f64 {
    // That of the largest, since rounding keeps order.
    let mut largest = f64::NEG_INFINITY;
    log2.iter().for_each(|&b| largest = if b > largest { b } else { largest });
    let whole = floor(largest);
    *out = log2.map(|b| b - whole);
    whole * LN_2
}

/// Scores from logarithms. Gives the largest of these, which is taken out; `None` if they
/// are not valid, or nothing is possible.
fn put_logs(logs: &[f64], out: &mut [f64]) -> Option<f64> {
    let (mut largest, mut valid) = (f64::NEG_INFINITY, true);
    for &log in logs {
        valid &= log.abs() <= LARGEST_LOG || log == f64::NEG_INFINITY;
        largest = if log > largest { log } else { largest };
    }
    for (out, log) in out.iter_mut().zip(logs) {
        *out = on_grid((log - largest) * LOG2_E);
    }
    (valid && largest > f64::NEG_INFINITY).then_some(largest)
}

fn dispatch(
    columns: &[f64],
    scores: &mut [f64],
    steps: usize,
    source: &mut dyn Scores,
) -> Option<Vec<usize>> {
    with_constant!(scores.len(), N => run::<N>(columns, scores, steps, source))
}

fn run<const N: usize>(
    columns: &[f64],
    scores: &mut [f64],
    steps: usize,
    source: &mut dyn Scores,
) -> Option<Vec<usize>> {
    let mut arrays = [[f64::NEG_INFINITY; N]; N];
    for (array, column) in arrays.iter_mut().zip(columns.chunks_exact(scores.len())) {
        *array = filled_up(column, f64::NEG_INFINITY)?;
    }
    let (columns, all) = (arrays, &mut *scores);
    let mut scores: [f64; N] = filled_up(all, f64::NEG_INFINITY)?;
    // The best way into each state of step k, at k − 2.
    let mut from = vec![[0_u8; N]; steps - 1];
    let mut gathered = [[f64::NEG_INFINITY; N]; GATHERED];
    for (index, from) in from.chunks_mut(GATHERED).enumerate() {
        let (first, gathered) = (2 + index * GATHERED, &mut gathered[..from.len()]);
        source.gather(first..first + from.len(), gathered.as_flattened_mut())?;
        for (b, from) in gathered.chunks(UNLOOKED).zip(from.chunks_mut(UNLOOKED)) {
            source.take_out(advance(&columns, b, &mut scores, from)?);
        }
    }
    all.copy_from_slice(&scores[..all.len()]);
    let mut state = best(all);
    let mut states = vec![state; steps];
    for (out, from) in states.iter_mut().zip(&from).rev() {
        state = usize::from(from[state]);
        *out = state;
    }
    Some(states)
}

/// Takes a few steps, and a whole number out of the scores. Returns that, or
/// `None` if nothing is possible any more.
#[inline]
fn advance<const N: usize>(
    columns: &[[f64; N]; N],
    diagonals: &[[f64; N]],
    scores: &mut [f64; N],
    from: &mut [[u8; N]],
) -> Option<f64> {
    let before = *scores;
    if !before.iter().any(|s| below(*s, NEAR)) {
        let mut far = false;
        for (b, from) in diagonals.iter().zip(&mut *from) {
            *scores = step(columns, b, scores, from);
            scores.iter().for_each(|s| far |= below(*s, EXACT));
        }
        if !far {
            return settle(scores);
        }
        *scores = before;
    }
    let mut whole = 0.0;
    for (b, from) in diagonals.iter().zip(from) {
        *scores = step(columns, b, scores, from);
        whole += settle(scores)?;
    }
    Some(whole)
}

/// Finite, but below a limit.
#[inline]
fn below(score: f64, limit: f64) -> bool {
    score < limit && score > f64::NEG_INFINITY
}

/// The best way into each state, of several from the lowest state; and the
/// observation.
#[inline]
fn step<const N: usize>(
    columns: &[[f64; N]; N],
    b: &[f64; N],
    scores: &[f64; N],
    from: &mut [u8; N],
) -> [f64; N] {
    let mut best = columns[0];
    best.iter_mut().for_each(|log2| *log2 += scores[0]);
    let mut which = [0_u8; N];
    for j in 1..N {
        for i in 0..N {
            let score = columns[j][i] + scores[j];
            which[i] = if score > best[i] { j as u8 } else { which[i] };
            best[i] = if score > best[i] { score } else { best[i] };
        }
    }
    *from = which;
    best.iter_mut().zip(b).for_each(|(best, b)| *best += b);
    best
}

/// Takes a whole number out of scores, so that the best is in [0, 1).
#[inline]
fn settle<const N: usize>(scores: &mut [f64; N]) -> Option<f64> {
    let mut best = f64::NEG_INFINITY;
    scores.iter().for_each(|&s| best = if s > best { s } else { best });
    if best == f64::NEG_INFINITY {
        return None;
    }
    let whole = floor(best);
    scores.iter_mut().for_each(|s| *s -= whole);
    Some(whole)
}

/// `x.floor()` without a call, for what fits 32 bits; −∞ gives a number.
#[inline]
fn floor(x: f64) -> f64 {
    let whole = f64::from(x as i32);
    if whole > x { whole - 1.0 } else { whole }
}
