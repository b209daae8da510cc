//! Expected moves of a single sequence, summed for each entry of a stored matrix.
//!
//! ξ_k(j, i) = α_{k-1}(j) A\[i, j\] γ_k(i) / p_k(i) (section 4 of the
//! [formulas](crate::guide::formulas)) is added at the place of the entry, so that nothing is
//! looked up or compared for each move of each step.

use std::ops::Range;

use crate::hmm::Hmm;
use crate::inference::step::state::BeliefRef;
use crate::likelihood::LearnLikelihood;
use crate::transition::{LearnTransition, MoveCounts, constant_control};
use wayfix_kernels::{self as kernels, Lines, exp_in_place};

/// Sums of ξ over steps for each entry of a matrix.
pub(super) struct EntrySums<'m> {
    columns: Lines<'m>,
    states: usize,
    sums: Vec<f64>,
    /// Logarithms of all entries, computed at the first step in logarithms, and memory for its
    /// moves.
    logs: Vec<f64>,
    powers: Vec<f64>,
}

impl<'m> EntrySums<'m> {
    /// Creates sums of 0; `None` unless moves are counted by the entries of a stored matrix.
    pub(super) fn new<A: LearnTransition, B: LearnLikelihood>(
        hmm: &'m Hmm<A, B>,
        statistics: &mut A::Statistics,
    ) -> Option<Self> {
        let (transition, states) = (hmm.transition(), hmm.states());
        let control = constant_control::<A>()?;
        transition.counts(statistics, control)?;
        if transition.evidence(control).is_some() {
            return None;
        }
        let (_, columns) = transition.stored(control)?.lines();
        let sums = vec![0.0; columns.values().len()];
        Some(Self { columns, states, sums, logs: Vec::new(), powers: Vec::new() })
    }

    /// Places of the entries in the column of a state.
    fn column(&self, from: usize) -> Range<usize> {
        match self.columns {
            Lines::Sparse { starts, .. } => starts[from] as usize..starts[from + 1] as usize,
            Lines::Dense { values } | Lines::DenseTransposed { values } => {
                let begin = from * (values.len() / self.states);
                begin..begin + self.states
            }
        }
    }

    /// Adds a step with α before it, and with γ / p = `ratio` times `scale`.
    pub(super) fn add(&mut self, alpha: &[f64], ratio: &[f64], scale: f64) {
        for (from, alpha) in alpha.iter().enumerate() {
            // Skipped, since the ratio of a state that only impossible states lead to may be NaN.
            if *alpha == 0.0 {
                continue;
            }
            // Sums are in the order of the stored entries, so a column is one slice of both.
            let column = self.column(from);
            let (sums, values) = (&mut self.sums[column.clone()], self.columns.values());
            let sums = sums.iter_mut().zip(&values[column.clone()]);
            // A small belief may meet a large ratio: the entry times the ratio is computed first,
            // and the common scale is applied last.
            match self.columns {
                Lines::Sparse { indices, .. } => {
                    for ((sum, p), to) in sums.zip(&indices[column]) {
                        *sum += alpha * (p * ratio[*to as usize]) * scale;
                    }
                }
                Lines::Dense { .. } | Lines::DenseTransposed { .. } => {
                    for ((sum, p), ratio) in sums.zip(ratio) {
                        *sum += alpha * (p * ratio) * scale;
                    }
                }
            }
        }
    }

    /// Adds a step whose ratios are in logarithms. Its moves are normalised to sum to one, since
    /// logarithms near −1e15 round by whole tenths.
    pub(super) fn add_logs(&mut self, alpha: BeliefRef<'_>, ratio: &[f64]) {
        if self.logs.is_empty() {
            self.logs.extend(self.columns.values().iter().map(|p| p.ln()));
            self.powers.resize(self.logs.len(), 0.0);
        }
        // Columns of impossible states are skipped below, and keep −∞.
        self.powers.fill(f64::NEG_INFINITY);
        for from in 0..self.states {
            let log = alpha.log(from);
            if log == f64::NEG_INFINITY {
                continue;
            }
            let column = self.column(from);
            let powers = self.powers[column.clone()].iter_mut().zip(&self.logs[column.clone()]);
            match self.columns {
                Lines::Sparse { indices, .. } => {
                    for ((power, p), to) in powers.zip(&indices[column]) {
                        *power = log + (p + ratio[*to as usize]);
                    }
                }
                Lines::Dense { .. } | Lines::DenseTransposed { .. } => {
                    powers.zip(ratio).for_each(|((power, p), ratio)| *power = log + (p + ratio));
                }
            }
        }
        // Log-sum-exp: the largest becomes e^0, and what underflows next to it does not matter.
        let largest = self.powers.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        self.powers.iter_mut().for_each(|power| *power -= largest);
        exp_in_place(&mut self.powers);
        let factor = 1.0 / kernels::sum(&self.powers);
        let sums = self.sums.iter_mut().zip(&self.powers);
        sums.for_each(|(sum, power)| *sum += power * factor);
    }

    /// Writes p = A α to `out`.
    pub(super) fn predict(&self, alpha: &[f64], out: &mut [f64]) {
        out.fill(0.0);
        for (from, alpha) in alpha.iter().enumerate() {
            let column = self.column(from);
            let values = &self.columns.values()[column.clone()];
            match self.columns {
                Lines::Sparse { indices, .. } => {
                    for (to, p) in indices[column].iter().zip(values) {
                        out[*to as usize] += alpha * p;
                    }
                }
                Lines::Dense { .. } | Lines::DenseTransposed { .. } => {
                    out.iter_mut().zip(values).for_each(|(sum, p)| *sum += alpha * p);
                }
            }
        }
    }

    /// Adds the counts of all entries to the statistics of the operator.
    pub(super) fn finish<A: LearnTransition, B: LearnLikelihood>(
        &self,
        hmm: &Hmm<A, B>,
        statistics: &mut A::Statistics,
    ) {
        let control = constant_control::<A>();
        if let Some(counts) = control.and_then(|u| hmm.transition().counts(statistics, u)) {
            counts.merge(&MoveCounts::of_entries(self.columns, self.states, |at, _| self.sums[at]));
        }
    }
}
