//! Smoother with checkpoints: sequences of any length in O(n √T) memory (section 5 of the
//! [formulas](crate::guide::formulas)), with the moves between steps given all observations (ξ_k of
//! section 4).
//!
//! The filter runs once over the sequence and leaves a snapshot at every boundary between
//! segments. Then each segment is filtered again from its snapshot, and smoothed backward:
//! checkpointing with one level (Griewank 1992 has several). A filter restored from a snapshot
//! continues with the same bits, so that the results equal those of one pass.
//!
//! ξ is never stored; it is enumerated over the entries of A. Its sum must be one, which every
//! routine that adds moves up checks.

use std::f64::consts::LN_2;
use std::fmt;
use std::ops::Range;

use crate::belief::{Belief, BeliefView};
use crate::error::HmmError;
use crate::hmm::Hmm;
use crate::inference::step::Step;
use crate::inference::step::forward_backward::{Backward, ForwardPass, Rows};
use crate::inference::step::state::{BeliefRef, FilterSnapshot, StepScratch};
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::{LearnTransition, Move, MoveCounts, Transition, TransitionEntries, log};
use wayfix_kernels as kernels;
use wayfix_kernels::limits;

/// Size, states times steps, below which a sequence is a single segment. A block of this size takes
/// half a megabyte, which fits into a cache.
const ONE_SEGMENT: usize = 1 << 16;

/// Order of visiting steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    /// From 0 to T. Takes one more backward pass than the other order.
    Forward,
    /// From T to 0.
    Backward,
}

/// Filtered and smoothed distributions of one step.
///
/// Handed out by [`Hmm::smooth_each`].
#[derive(Debug)]
pub struct SmoothedStep<'a, A: Transition> {
    step: usize,
    filtered: &'a [f64],
    smoothed: &'a [f64],
    pairs: Option<Pairs<'a, A>>,
}

impl<'a, A: Transition> SmoothedStep<'a, A> {
    /// Number of the step, k, from 0 to T.
    #[must_use]
    pub fn step(&self) -> usize {
        self.step
    }

    /// Filtered distribution p(X_k | y_1 … y_k).
    #[must_use]
    pub fn filtered(&self) -> BeliefView<'a> {
        Belief::view(self.filtered)
    }

    /// Smoothed distribution p(X_k | y_1 … y_T).
    #[must_use]
    pub fn smoothed(&self) -> BeliefView<'a> {
        Belief::view(self.smoothed)
    }

    /// Moves to this step with their probabilities p(X_{k-1}, X_k | y_1 … y_T), ordered by the
    /// state that they leave; `None` if no transition leads to step k: at 0, and at 1 under
    /// [`Prior::AtFirstObservation`](crate::Prior::AtFirstObservation).
    ///
    /// They sum to one, up to rounding (and up to entries below 1e-323 that an operator does not
    /// list as logarithms either). Moves out of states with probability 0 may be missing. O(E).
    #[must_use]
    pub fn moves(&self) -> Option<impl Iterator<Item = Move>>
    where
        A: TransitionEntries,
    {
        self.pairs().map(Pairs::moves)
    }

    /// Pairwise posterior of the move to this step.
    pub(crate) fn pairs(&self) -> Option<&Pairs<'a, A>> {
        self.pairs.as_ref()
    }
}

impl<A: Transition, B: Likelihood> Hmm<A, B> {
    /// Smooths a sequence of any length in O(n √T) memory, and passes each step to a visitor,
    /// with the pairwise posterior of the move to it. Returns ln p(y_1 … y_T).
    ///
    /// Results equal those of [`smooth`](Self::smooth) to the bit (up to rounding with up to eight
    /// states and no control, or where `smooth` cuts a long sequence). A step costs O(n) and three
    /// products with A or A' in backward order, five in forward order (two in either order if n T
    /// is below 65,536); more where the sensor has to compute its likelihoods.
    ///
    /// ```
    /// use wayfix::inference::Order;
    /// # use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
    /// # let prior = Prior::BeforeFirstTransition(Belief::uniform(2)?);
    /// # let table = TableLikelihood::from_rows(&[[0.9, 0.1], [0.2, 0.8]])?;
    /// # let hmm = Hmm::new(prior, DenseTransition::from_rows(&[[0.7, 0.3], [0.3, 0.7]])?, table)?;
    ///
    /// // How probable is it that the weather changed on the way to each day?
    /// let mut changed = Vec::new();
    /// hmm.smooth_each(&[0, 0, 1], Order::Forward, |step| {
    ///     if let Some(moves) = step.moves() {
    ///         changed.push(moves.filter(|m| m.from != m.to).map(|m| m.weight).sum::<f64>());
    ///     }
    /// })?;
    /// assert!(changed[2] > changed[1], "{changed:?}");
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// As [`smooth`](Self::smooth). No step has been visited then, unless the operator breaks
    /// its contract.
    pub fn smooth_each<S>(
        &self,
        sequence: &S,
        order: Order,
        mut visit: impl FnMut(&SmoothedStep<'_, A>),
    ) -> Result<f64, HmmError>
    where
        S: Sequence<A::Control, B::Observation> + ?Sized,
    {
        let (n, steps) = (self.states(), sequence.steps());
        // With segments of s steps, T / s checkpoints and s beliefs in a segment are fewest
        // together at s = √T.
        let length =
            if n.saturating_mul(steps) < ONE_SEGMENT { steps.max(1) } else { steps.isqrt() + 1 };
        let prior = self.prior().belief().as_slice();
        let mut segments = Segments {
            hmm: self,
            sequence,
            block: ForwardPass::new(n, length.min(steps), 0),
            smoothed: Rows::zeros(n, length.min(steps) + 1),
            ratios: vec![0.0; n * length.min(steps)],
            forms: vec![(false, 1.0); length.min(steps)],
            filtered_start: None,
            state: FilterSnapshot::start(prior),
            scratch: StepScratch::new(prior),
            backward: Backward::new(n),
        };
        let (checkpoints, log_likelihood) = segments.checkpoints(length)?;
        if order == Order::Forward {
            // A segment is smoothed from its end but visited from its start, so the γ at the end of
            // every segment is needed before the first visit. A first backward pass collects them,
            // each with the state of the pass, without which the bits would differ from those of
            // `smooth`.
            let last = segments.state.belief.to_vec();
            let mut ends = vec![(last, segments.backward.state())];
            for start in checkpoints[1..].iter().rev() {
                let end = ends[ends.len() - 1].0.clone();
                segments.run(start, length, &end)?;
                let first = segments.smoothed.row(0).to_vec();
                ends.push((first, segments.backward.state()));
            }
            for (start, (end, carried)) in checkpoints.iter().zip(ends.iter().rev()) {
                segments.backward.restore_state(carried);
                let rows = segments.run(start, length, end)?;
                // The first row of a segment is the last row of the previous segment.
                let first = usize::from(start.steps() > 0);
                (first..=rows).for_each(|row| visit(&segments.step(row, start)));
            }
        } else {
            let mut end = segments.state.belief.to_vec();
            for start in checkpoints.iter().rev() {
                let rows = segments.run(start, length, &end)?;
                let first = usize::from(start.steps() > 0);
                (first..=rows).rev().for_each(|row| visit(&segments.step(row, start)));
                end.copy_from_slice(segments.smoothed.row(0));
            }
        }
        Ok(log_likelihood)
    }

    /// Returns the expected number of moves between each pair of states, the sum over all steps
    /// of p(X_{k-1}, X_k | y_1 … y_T).
    ///
    /// Costs as much as [`smooth_each`](Self::smooth_each), and O(E) a step. The result takes 24
    /// bytes for each entry of A, not n × n for a sparse one. But where states are reached from all
    /// others, as by a [`RestartTransition`](crate::transition::RestartTransition), E is n²: 6 GB
    /// for 16,000 states. [Learning](Self::expectations) does not need the moves of restarts, and
    /// counts only those of the operator within.
    ///
    /// ```
    /// # use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
    /// # let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
    /// # let table = TableLikelihood::from_rows(&[[0.9, 0.1], [0.2, 0.8]])?;
    /// # let hmm = Hmm::new(prior, DenseTransition::from_rows(&[[0.7, 0.3], [0.3, 0.7]])?, table)?;
    /// let counts = hmm.expected_moves(&[0, 0, 1, 0, 0])?;
    /// assert!((counts.get(0, 0) - 2.080_186_188_659_151).abs() < 1e-12);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// As [`smooth`](Self::smooth).
    pub fn expected_moves<S>(&self, sequence: &S) -> Result<MoveCounts, HmmError>
    where
        A: TransitionEntries,
        S: Sequence<A::Control, B::Observation> + ?Sized,
    {
        let (mut counts, mut result) = (MoveCounts::default(), Ok(()));
        self.smooth_each(sequence, Order::Backward, |step| {
            // A visitor cannot stop the smoother: after an error it only skips.
            if let (Some(pairs), Ok(())) = (step.pairs(), &result) {
                result = pairs.add_to(&mut counts, step.step());
            }
        })?;
        result.map(|()| counts)
    }
}

/// Segments of a sequence, one in memory at a time.
struct Segments<'m, A: Transition, B, S: ?Sized> {
    hmm: &'m Hmm<A, B>,
    sequence: &'m S,
    /// Filtered beliefs of the segment that starts after `filtered_start` steps.
    block: ForwardPass,
    /// Number of steps before the segment in memory, if there is one.
    filtered_start: Option<usize>,
    smoothed: Rows,
    /// Ratio γ / p of each step, or its logarithm.
    ratios: Vec<f64>,
    /// For each step: true if its ratio is in logarithms, and the scale of a linear ratio.
    forms: Vec<(bool, f64)>,
    state: FilterSnapshot,
    scratch: StepScratch,
    backward: Backward,
}

impl<A, B, S> Segments<'_, A, B, S>
where
    A: Transition,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation> + ?Sized,
{
    /// Runs the filter over the whole sequence, and keeps a snapshot every `length` steps.
    fn checkpoints(&mut self, length: usize) -> Result<(Vec<FilterSnapshot>, f64), HmmError> {
        let mut checkpoints = Vec::new();
        loop {
            let start = self.state.clone();
            self.fill(start.steps(), length)?;
            checkpoints.push(start);
            if self.state.steps() == self.sequence.steps() {
                return Ok((checkpoints, self.state.log_likelihood()));
            }
        }
    }

    /// Filters a segment unless it is in memory already. Returns its number of steps.
    fn fill(&mut self, start: usize, length: usize) -> Result<usize, HmmError> {
        let rows = length.min(self.sequence.steps() - start);
        // The last segment is still in memory when the backward pass begins; if it is the only one,
        // it always is.
        if self.filtered_start.replace(start) != Some(start) {
            let memory = (&mut self.state, &mut self.scratch);
            self.block.fill(self.hmm, memory, self.sequence, rows, |_| ())?;
        }
        Ok(rows)
    }

    /// Filters a segment, and goes back through it from the γ at its end. Returns its number of
    /// steps.
    fn run(
        &mut self,
        start: &FilterSnapshot,
        length: usize,
        end: &[f64],
    ) -> Result<usize, HmmError> {
        let n = self.hmm.states();
        // Unnecessary, but harmless, if the segment is in memory.
        self.state.copy(start);
        self.scratch.lifted.reset(&self.state.belief);
        let rows = self.fill(start.steps(), length)?;
        self.smoothed.row_mut(rows).copy_from_slice(end);
        for row in (1..=rows).rev() {
            let step = Step::of(self.hmm, self.sequence, start.steps() + row);
            let seen = self.block.seen(row, self.sequence.observation(step.number));
            let (out, gamma) = self.smoothed.row_and_next(row - 1);
            self.backward.step_back_from(&step, &seen, self.block.belief(row - 1), gamma, out)?;
            // Copied, since the next backward step overwrites the ratio and pairs are read later.
            self.ratios[(row - 1) * n..row * n].copy_from_slice(&self.backward.ratio);
            self.forms[row - 1] = (self.backward.ratio_in_logs, self.backward.ratio_scale);
        }
        Ok(rows)
    }

    fn step(&self, row: usize, start: &FilterSnapshot) -> SmoothedStep<'_, A> {
        let (n, number) = (self.hmm.states(), start.steps() + row);
        let moves = row > 0 && self.hmm.prior().moves_at(number);
        let pairs = moves.then(|| Pairs {
            transition: self.hmm.transition(),
            control: self.sequence.control(number),
            alpha: self.block.belief(row - 1),
            ratio: &self.ratios[(row - 1) * n..row * n],
            in_logs: self.forms[row - 1].0,
            scale: self.forms[row - 1].1,
        });
        let (filtered, smoothed) = (self.block.rows.row(row), self.smoothed.row(row));
        SmoothedStep { step: number, filtered, smoothed, pairs }
    }
}

/// Pairwise posterior p(X_{k-1} = j, X_k = i | y_1 … y_T) of one step k, as a product that is
/// never stored: α_{k-1}(j) A\[i, j\] γ_k(i) / p_k(i).
pub(crate) struct Pairs<'a, A: Transition> {
    pub(crate) transition: &'a A,
    pub(crate) control: &'a A::Control,
    pub(crate) alpha: BeliefRef<'a>,
    /// γ_k / p_k divided by `scale`, or its logarithm.
    pub(crate) ratio: &'a [f64],
    pub(crate) in_logs: bool,
    pub(crate) scale: f64,
}

impl<A: Transition> fmt::Debug for Pairs<'_, A> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Pairs").field("states", &self.ratio.len()).finish_non_exhaustive()
    }
}

impl<A: TransitionEntries> Pairs<'_, A> {
    /// Returns the moves, as [`SmoothedStep::moves`](crate::inference::SmoothedStep::moves) does.
    pub(crate) fn moves(&self) -> impl Iterator<Item = Move> {
        let states = 0..self.ratio.len();
        // One iterator type for both forms: one of the two ranges is empty.
        let (linear, logs) = if self.in_logs { (0..0, states) } else { (states, 0..0) };
        let linear = linear.filter(|&from| self.alpha.linear[from] > 0.0).flat_map(move |from| {
            self.moves_out_of(from, self.transition.outgoing(self.control, from))
        });
        let list = |from| self.transition.outgoing_log2(self.control, from);
        let logs =
            self.log_moves(logs, list).map(|(from, to, log)| Move { from, to, weight: log.exp() });
        linear.chain(logs)
    }

    /// Moves out of a state along its entries, in linear space.
    fn moves_out_of(
        &self,
        from: usize,
        entries: impl Iterator<Item = (usize, f64)>,
    ) -> impl Iterator<Item = Move> {
        entries.map(move |(to, p)| {
            // A small belief may meet a large ratio: the entry times the ratio is computed first,
            // and the common scale is applied last.
            let weight = self.alpha.linear[from] * (p * self.ratio[to]) * self.scale;
            Move { from, to, weight }
        })
    }

    /// Adds the moves of this step to the counts. They must sum to one, which fails if an operator
    /// lists other entries than its products have.
    pub(crate) fn add_to(&self, counts: &mut MoveCounts, step: usize) -> Result<(), HmmError> {
        if !self.in_logs {
            return check_sums_to_one(counts.add(self.moves()), step);
        }
        let list = |from| self.transition.outgoing_log2(self.control, from);
        self.add_logs_to(counts, step, list, f64::NEG_INFINITY)
    }

    /// Moves out of these states along their entries, with the logarithms of their probabilities.
    fn log_moves<I: Iterator<Item = (usize, f64)>>(
        &self,
        states: Range<usize>,
        list: impl Fn(usize) -> I,
    ) -> impl Iterator<Item = (usize, usize, f64)> {
        states.flat_map(move |from| {
            let log = self.alpha.log(from);
            list(from).map(move |(to, log2)| (from, to, log + log2 * LN_2 + self.ratio[to]))
        })
    }

    /// Adds moves given by logarithms. Together with exp(`others`) they must sum to one, up to the
    /// rounding of the logarithms, which is large for log-likelihoods of −1e15.
    #[cold]
    fn add_logs_to<I: Iterator<Item = (usize, f64)>>(
        &self,
        counts: &mut MoveCounts,
        step: usize,
        list: impl Fn(usize) -> I,
        others: f64,
    ) -> Result<(), HmmError> {
        let logs = || self.log_moves(0..self.ratio.len(), &list);
        // Log-sum-exp: terms that underflow relative to the largest do not matter.
        let largest = logs().fold(others, |most, (_, _, log)| most.max(log));
        let sum: f64 = logs().map(|(_, _, log)| (log - largest).exp()).sum();
        let sum = largest + (sum + (others - largest).exp()).ln();
        // A sum of logarithms rounds relative to the largest of its terms.
        let terms = (0..self.ratio.len())
            .map(|state| self.alpha.log(state))
            .chain(self.ratio.iter().copied());
        let size =
            terms.filter(|log| log.is_finite()).fold(0.0, |size, log| f64::max(size, log.abs()));
        // Without a possible move, `sum` is NaN (−∞ minus −∞); the error then reports 0, since
        // `max` ignores a NaN.
        if sum.is_nan() || sum.abs() > limits::log_rounding(size) {
            return Err(HmmError::PredictedSum { step, sum: f64::max(sum.exp(), 0.0) });
        }
        // Normalised, so that this rounding does not accumulate in the counts.
        counts.add(logs().map(|(from, to, log)| Move { from, to, weight: (log - sum).exp() }));
        Ok(())
    }
}

impl<A: LearnTransition> Pairs<'_, A> {
    /// Adds the moves of this step that learning counts to its statistics, as
    /// [`add_to`](Self::add_to) does. Restarts, which may come from any state, are not counted but
    /// belong to the sum that is checked: they have (Σ_j α_{k-1}(j)) Σ_i ε r(i) γ_k(i) / p_k(i)
    /// ("Restart" in section 10 of the [formulas](crate::guide::formulas)).
    pub(crate) fn count_to(
        &self,
        statistics: &mut A::Statistics,
        step: usize,
    ) -> Result<(), HmmError> {
        let (transition, states) = (self.transition, 0..self.ratio.len());
        if !self.in_logs {
            let (before, after) = (self.alpha.linear, self.ratio);
            let added = transition.add_step(statistics, self.control, before, after, self.scale);
            // The operator has added the step itself, in one pass over its matrix.
            if let Some(sum) = added {
                return check_sums_to_one(sum, step);
            }
        }
        let Some(counts) = transition.counts(statistics, self.control) else { return Ok(()) };
        let restart = |to: usize| transition.restart_log2(self.control, to);
        if !self.in_logs {
            let from = states.clone().filter(|&from| self.alpha.linear[from] > 0.0);
            let sum =
                counts.add(from.flat_map(|from| {
                    self.moves_out_of(from, transition.counted(self.control, from))
                }));
            let into = |to: usize| match restart(to) {
                f64::NEG_INFINITY => 0.0,
                log2 => log2.exp2() * self.ratio[to],
            };
            // Restarts are equally likely from all states, so their mass is a product of two sums
            // instead of a sum over n² moves.
            let restarts: f64 = states.map(into).sum();
            let before = if restarts > 0.0 { kernels::sum(self.alpha.linear) } else { 0.0 };
            return check_sums_to_one(sum + before * restarts * self.scale, step);
        }
        let sum = |logs: &mut dyn Iterator<Item = f64>| logs.fold(f64::NEG_INFINITY, log::add);
        // The ratio of a state that no move leads to may be NaN, so states without a restart are
        // dropped before it is read.
        let restarted = states.clone().map(|to| (to, restart(to) * LN_2));
        let restarted = restarted.filter(|entry| entry.1 > f64::NEG_INFINITY);
        let restarts = sum(&mut restarted.map(|(to, log)| log + self.ratio[to]));
        let others = restarts + sum(&mut states.map(|from| self.alpha.log(from)));
        let list = |from| transition.counted_log2(self.control, from);
        self.add_logs_to(counts, step, list, others)
    }
}

/// Returns an error unless the moves of a step sum to one.
fn check_sums_to_one(sum: f64, step: usize) -> Result<(), HmmError> {
    if limits::is_one(sum) { Ok(()) } else { Err(HmmError::PredictedSum { step, sum }) }
}
