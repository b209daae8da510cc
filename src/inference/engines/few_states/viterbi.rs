//! Viterbi over a whole sequence (section 7 of the [formulas](crate::guide::formulas)). Sums of
//! scores are exact, so that paths and their probabilities are those of the general routine to the
//! bit. That includes segments, since max-plus products are associative.

use super::control_of;
use super::likelihoods::{LikelihoodRows, SensorRows};
use super::pack_segments;
use crate::hmm::Hmm;
use crate::inference::engines::choice::{self, Engine, GATHERED};
use crate::inference::step::scores::{TakenOut, best};
use crate::inference::step::{SensorScratch, Step};
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::TransitionEntries;
use wayfix_kernels::limits::{LEAST_EXACT_SCORE, LEAST_SCORE, LEAST_SEGMENT_PRODUCT};
use wayfix_kernels::{
    Backpointers, ChainPointers, ChainState, Eight, LANES, MaxPlus, Packed, Scaled, SmallModel,
    chain_decode, decode_segments, in_large_pages, multiply_segments,
};

/// Decodes a sequence as [`Hmm::viterbi`] does: returns states and log-probability.
pub(crate) fn viterbi<A, B, S>(hmm: &Hmm<A, B>, sequence: &S) -> Option<(Vec<usize>, f64)>
where
    A: TransitionEntries,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation> + ?Sized,
{
    let (n, steps) = (hmm.states(), sequence.steps());
    let control = control_of(hmm)?;
    // log2 A, column after column.
    let mut columns = [Packed([f64::NEG_INFINITY; LANES]); LANES];
    let (mut one, mut from) = (vec![f64::NEG_INFINITY; n], vec![0; n]);
    for (j, column) in columns.iter_mut().enumerate().take(n) {
        // The max-product of a score of 0 in one state and −∞ elsewhere is a column of the
        // operator, in exactly the logarithms that it adds.
        one[j] = 0.0;
        hmm.transition().max_product(control, &one, &mut column[..n], &mut from);
        one[j] = f64::NEG_INFINITY;
    }
    // Step 1 is that of the general routine, which sums over X_0.
    let (mut first, mut taken_out) = (vec![0.0; n], TakenOut::default());
    let step = Step::of(hmm, sequence, 1);
    let mut scratch = SensorScratch::new(n);
    step.first_scores(&mut first, &mut taken_out).ok()?;
    step.observe(sequence.observation(1), &mut scratch, &mut first, &mut taken_out).ok()?;
    step.take_out_whole(&mut first, &mut taken_out).ok()?;
    let mut scores = ChainState::new(f64::NEG_INFINITY);
    scores.values[..n].copy_from_slice(&first);
    let source: &mut dyn LikelihoodRows = &mut SensorRows::new(hmm, sequence);
    let mut decoder = Decoder { states: n, columns, scores, taken_out, steps };
    let states = decoder.path(source)?;
    let Decoder { scores, mut taken_out, .. } = decoder;
    taken_out.whole += scores.exponent as f64;
    let score = scores.values.into_iter().fold(f64::NEG_INFINITY, f64::max);
    Some((states, taken_out.log_probability(score)))
}

/// Scores on their way through a sequence.
struct Decoder {
    states: usize,
    /// Logarithms, padded with −∞.
    columns: [Packed; LANES],
    scores: ChainState,
    taken_out: TakenOut,
    steps: usize,
}

/// Backpointers of eight segments, step by step.
type ForwardPass<const N: usize> = Vec<Backpointers<N>>;

impl Decoder {
    fn path(&mut self, source: &mut dyn LikelihoodRows) -> Option<Vec<usize>> {
        // Restored after a failed attempt, which must leave no trace in the scores or in what was
        // taken out.
        let start = (self.scores, self.taken_out.clone());
        if choice::for_sequence(self.states, self.steps) == Engine::Segments {
            let path = match self.states {
                2 => self.path_in_segments::<2>(source),
                3 => self.path_in_segments::<3>(source),
                _ => self.path_in_segments::<4>(source),
            };
            if path.is_some() {
                return path;
            }
            (self.scores, self.taken_out) = start;
        }
        self.path_in_blocks::<2>(source, 2, Vec::new())
    }

    fn path_in_segments<const N: usize>(
        &mut self,
        source: &mut dyn LikelihoodRows,
    ) -> Option<Vec<usize>> {
        if is_far(&self.scores.values) {
            return None;
        }
        let columns: [[f64; N]; N] =
            std::array::from_fn(|j| std::array::from_fn(|i| self.columns[j][i]));
        let entries = columns.as_flattened().iter().filter(|a| a.is_finite());
        // An entry and a likelihood together may lower a score by at most 50 a step (`limits`, "Few
        // states").
        let least = LEAST_SEGMENT_PRODUCT.log2() - entries.fold(0.0, |a: f64, b| a.min(*b));
        let model = SmallModel { columns, rows: columns, least };
        let (mut blocks, mut remaining) = (Vec::new(), 2..self.steps + 1);
        let (mut gathered, mut packed) = (Vec::new(), Vec::new());
        while let Some(steps) = choice::next_segments(&mut remaining) {
            gathered.resize(N * steps.len(), 0.0);
            source.scores(steps, &mut gathered, &mut self.taken_out)?;
            pack_segments(&gathered, &mut packed);
            let products = multiply_segments(MaxPlus, &model, &packed)?;
            // As in the filter: the products give the starts of all segments, and from there all
            // eight run at once.
            let starts = self.through(&products)?;
            let mut block: ForwardPass<N> = vec![[[0; 2]; N]; packed.len()];
            decode_segments(&model, &starts, &packed, &mut block)?;
            blocks.push(block);
        }
        self.path_in_blocks(source, remaining.start, blocks)
    }

    /// Takes the scores through eight segments. Returns them at the start of each.
    fn through<const N: usize>(&mut self, products: &[Scaled<N>; N]) -> Option<[Eight; N]> {
        let mut starts = [[0.0; LANES]; N];
        for segment in 0..LANES {
            let x = self.scores.values;
            starts.iter_mut().zip(x).for_each(|(start, x)| start[segment] = x);
            let exponents: [f64; N] = std::array::from_fn(|j| products[j].exponents[segment]);
            let used = (0..N).filter(|j| x[*j] > f64::NEG_INFINITY);
            let largest = used.map(|j| exponents[j]).fold(f64::NEG_INFINITY, f64::max);
            let mut out = [f64::NEG_INFINITY; LANES];
            for (j, column) in products.iter().enumerate() {
                // Exponents of max-plus products are whole numbers that are added, so these sums
                // are exact.
                let before = x[j] + (exponents[j] - largest);
                for (out, values) in out.iter_mut().zip(&column.values) {
                    let score = before + values[segment];
                    // Below this limit sums may round, and a tie might be decided differently than
                    // step by step.
                    if score > f64::NEG_INFINITY && score < LEAST_EXACT_SCORE {
                        return None;
                    }
                    *out = out.max(score);
                }
            }
            let best = out.into_iter().fold(f64::NEG_INFINITY, f64::max);
            if !best.is_finite() {
                return None;
            }
            let whole = best.floor();
            out.iter_mut().for_each(|score| *score -= whole);
            if is_far(&out) {
                return None;
            }
            let exponent = self.scores.exponent + (whole + largest) as i64;
            self.scores = ChainState { values: out, exponent };
        }
        Some(starts)
    }

    /// Takes the remaining steps as a chain, and goes back along all backpointers.
    fn path_in_blocks<const N: usize>(
        &mut self,
        source: &mut dyn LikelihoodRows,
        first: usize,
        blocks: Vec<ForwardPass<N>>,
    ) -> Option<Vec<usize>> {
        let n = self.states;
        let mut from: Vec<ChainPointers> = vec![[0; 3]; (self.steps + 1).saturating_sub(first)];
        let mut gathered = vec![0.0; n * GATHERED.min(from.len())];
        let mut remaining = first..self.steps + 1;
        for from in from.chunks_mut(GATHERED) {
            let steps = choice::next_steps(&mut remaining)?;
            let gathered = &mut gathered[..n * from.len()];
            source.scores(steps, gathered, &mut self.taken_out)?;
            chain_decode(&self.columns, &mut self.scores, n, gathered, from).then_some(())?;
        }
        let mut state = best(&self.scores.values);
        let mut states = in_large_pages(vec![state; self.steps]);
        let mut out = states[..self.steps - 1].iter_mut().rev();
        for (bits, out) in from.iter().rev().zip(&mut out) {
            // Eight pointers of three bits, in three bytes: byte b has bit b of each.
            state = bits.iter().rev().fold(0, |s, bit| s << 1 | usize::from(bit >> state & 1));
            *out = state;
        }
        for block in blocks.into_iter().rev() {
            for lane in (0..LANES).rev() {
                for (from, out) in block.iter().rev().zip(&mut out) {
                    // All N pointers are read and one is selected, so that no load has to wait for
                    // the previous state.
                    let predecessor = |i: usize| {
                        let [low, high] = from[i].map(|bits| usize::from(bits >> lane & 1));
                        low | high << 1
                    };
                    let mut next = predecessor(0);
                    for i in 1..N {
                        next = if state == i { predecessor(i) } else { next };
                    }
                    state = next;
                    *out = state;
                }
            }
        }
        Some(states)
    }
}

/// Returns true if a score above −∞ is too low for several steps without a check.
fn is_far(scores: &Eight) -> bool {
    scores.iter().any(|score| *score > f64::NEG_INFINITY && *score < LEAST_SCORE)
}
