//! Expected moves of a sequence by itself, through a stored matrix.
//!
//! ξ_k(j, i) = α_{k-1}(j) A\[i, j\] γ_k(i) / p_k(i) (section 9 of the
//! [formulas](crate::guide::formulas)), added to the place of the entry, so that nothing is looked
//! up or compared for each move of each step.

use std::ops::Range;

use crate::hmm::Hmm;
use crate::inference::step::in_logs::BeliefRef;
use crate::kernels::{self, Lines, exp_in_place};
use crate::likelihood::LearnLikelihood;
use crate::transition::{LearnTransition, MoveCounts};

/// Sums of ξ over steps, for each entry of a matrix.
pub(super) struct EntrySums<'m> {
    columns: Lines<'m>,
    states: usize,
    sums: Vec<f64>,
    /// Logarithms of all entries, once a step is in logarithms, and room for its moves.
    logs: Vec<f64>,
    powers: Vec<f64>,
}

impl<'m> EntrySums<'m> {
    /// `None` if moves are not counted, or not by the entries of a stored matrix.
    pub(super) fn new<A: LearnTransition, B: LearnLikelihood>(
        hmm: &'m Hmm<A, B>,
        statistics: &mut A::Statistics,
    ) -> Option<Self> {
        let (transition, states) = (hmm.transition(), hmm.states());
        let control = transition.no_control()?;
        transition.counts(statistics, control)?;
        if transition.evidence(control).is_some() {
            return None;
        }
        let (_, columns) = transition.stored(control)?.lines()?;
        let sums = vec![0.0; columns.values().len()];
        Some(Self { columns, states, sums, logs: Vec::new(), powers: Vec::new() })
    }

    /// Entries of the column of a state, by their places.
    fn column(&self, from: usize) -> Range<usize> {
        match self.columns {
            Lines::Sparse { starts, .. } => starts[from] as usize..starts[from + 1] as usize,
            Lines::Dense { values } | Lines::DenseTransposed { values } => {
                let begin = from * (values.len() / self.states);
                begin..begin + self.states
            }
        }
    }

    /// Adds a step: α before it, and the ratios γ / p times a scale.
    pub(super) fn add(&mut self, alpha: &[f64], ratio: &[f64], scale: f64) {
        for (from, alpha) in alpha.iter().enumerate() {
            // The ratio of a state that is not predicted may be NaN: nothing possible leads there.
            if *alpha == 0.0 {
                continue;
            }
            let column = self.column(from);
            let (sums, values) = (&mut self.sums[column.clone()], self.columns.values());
            let sums = sums.iter_mut().zip(&values[column.clone()]);
            // A small belief with a large ratio: the entry times the ratio comes first, and the
            // common scale last.
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

    /// Adds a step whose ratios are in logarithms. Its moves are made to sum to one, since the
    /// logarithms of likely ones may differ by the rounding of log-likelihoods of −1e15.
    pub(super) fn add_logs(&mut self, alpha: BeliefRef<'_>, ratio: &[f64]) {
        if self.logs.is_empty() {
            self.logs.extend(self.columns.values().iter().map(|p| p.ln()));
            self.powers.resize(self.logs.len(), 0.0);
        }
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
        let largest = self.powers.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        self.powers.iter_mut().for_each(|power| *power -= largest);
        exp_in_place(&mut self.powers);
        let factor = 1.0 / kernels::sum(&self.powers);
        let sums = self.sums.iter_mut().zip(&self.powers);
        sums.for_each(|(sum, power)| *sum += power * factor);
    }

    /// Writes p = A α.
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
        let control = hmm.transition().no_control();
        if let Some(counts) = control.and_then(|u| hmm.transition().counts(statistics, u)) {
            counts.merge(&MoveCounts::of_entries(self.columns, self.states, |at, _| self.sums[at]));
        }
    }
}
