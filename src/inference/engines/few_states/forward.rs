//! A vector on its way forward through a sequence.

use std::ops::Range;

use super::likelihoods::LikelihoodRows;
use super::segments::{SegmentProducts, pack_segments};
use super::{FewStatesModel, rescale};
use crate::inference::LogSum;
use wayfix_kernels::{ChainState, Eight, LANES, Packed, SmallModel, chain_forward};

/// The vector, and what was taken out of likelihoods.
pub(crate) struct Forward<'m> {
    model: &'m FewStatesModel,
    source: &'m mut dyn LikelihoodRows,
    pub(crate) x: ChainState,
    logs: LogSum,
    /// Logarithms of what was taken out in each of the steps that were gathered last.
    pub(crate) scales: Vec<f64>,
}

impl<'m> Forward<'m> {
    /// Begins with the prior. If nothing moves before the first observation, it is updated by that,
    /// and the first step is done. Returns the first step that is left, too.
    pub(crate) fn start(
        model: &'m FewStatesModel,
        source: &'m mut dyn LikelihoodRows,
    ) -> Option<(Self, usize)> {
        let (x, logs) = (model.prior, LogSum::default());
        let mut start = Self { model, source, x, logs, scales: Vec::new() };
        if model.moves {
            return Some((start, 1));
        }
        let mut b = [0.0; LANES];
        // Step 1 has no move: its likelihoods multiply the prior.
        let any = start.gather(1..2, true, &mut b[..model.states])?;
        start.take_out(any);
        start.x.values.iter_mut().zip(b).for_each(|(x, b)| *x *= b);
        rescale(&mut start.x)?;
        Some((start, 2))
    }

    /// Copies the likelihoods of some steps. Returns true if something was taken out of them.
    fn gather(&mut self, steps: Range<usize>, scaled: bool, out: &mut [f64]) -> Option<bool> {
        self.scales.resize(steps.len(), 0.0);
        self.source.likelihoods(steps, scaled, out, &mut self.scales)
    }

    fn take_out(&mut self, any: bool) {
        if any {
            self.scales.iter().for_each(|log| self.logs.add(*log));
        } else {
            self.scales.fill(0.0);
        }
    }

    /// Returns ln Σ x, with the scales that were taken out of likelihoods.
    pub(crate) fn log_likelihood(&self) -> f64 {
        // x is never divided by its sum on the way: times its power of two it is p(x_k, y_1 … y_k),
        // up to what was taken out.
        let mut sum = self.logs;
        sum.add(self.x.values.iter().sum::<f64>().ln());
        sum.add(self.x.exponent as f64 * std::f64::consts::LN_2);
        sum.value()
    }

    /// Takes some steps one by one; see [`chain_forward`].
    pub(crate) fn chain(
        &mut self,
        steps: Range<usize>,
        likelihoods: &mut [f64],
        rows: &mut [f64],
        normalizers: &mut [f64],
    ) -> Option<()> {
        // The kernel may fail after some steps: the second attempt starts from the same vector.
        let before = self.x;
        // Scales take time, and are seldom needed.
        for scaled in [false, true] {
            let any = self.gather(steps.clone(), scaled, likelihoods)?;
            let FewStatesModel { columns, states, .. } = self.model;
            self.x = before;
            if chain_forward(columns, &mut self.x, *states, likelihoods, rows, normalizers) {
                self.take_out(any);
                return Some(());
            }
            // Scaled already: these likelihoods have too wide a range.
            if any {
                break;
            }
        }
        None
    }

    /// Takes x through eight segments, whose likelihoods are copied and packed. Returns their
    /// products, and x at the start of each.
    pub(crate) fn segments<const N: usize>(
        &mut self,
        model: &SmallModel<N>,
        steps: Range<usize>,
        likelihoods: &mut [f64],
        packed: &mut Vec<[Packed; N]>,
    ) -> Option<(SegmentProducts<N>, [Eight; N])> {
        let any = self.gather(steps, false, likelihoods)?;
        self.take_out(any);
        pack_segments(likelihoods, packed);
        let products = SegmentProducts::new(model, packed)?;
        let starts = products.forward(&mut self.x)?;
        Some((products, starts))
    }
}
