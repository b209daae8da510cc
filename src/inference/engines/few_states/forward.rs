//! The vector x_k of the forward recursion, on its way through a sequence.
//!
//! The invariant: x, times two to its exponent, times everything taken out of the likelihoods, is
//! p(X_k, y_1 … y_k). It is never divided by its sum, so that only powers of two are taken out.

use std::ops::Range;

use super::likelihoods::LikelihoodRows;
use super::segments::{SegmentProducts, pack_segments};
use super::{FewStatesModel, rescale};
use crate::inference::LogSum;
use wayfix_kernels::{ChainState, Eight, LANES, Packed, SmallModel, chain_forward};

/// The vector, and the scales that were taken out of the likelihoods.
pub(crate) struct Forward<'m> {
    model: &'m FewStatesModel,
    source: &'m mut dyn LikelihoodRows,
    pub(crate) x: ChainState,
    logs: LogSum,
    /// Logarithm of the scale taken out of each of the steps that were gathered last.
    pub(crate) scales: Vec<f64>,
}

impl<'m> Forward<'m> {
    /// Starts from the prior. If no transition leads to the first observation, this also takes step
    /// 1. Returns the number of the next step too.
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
        // Step 1 has no transition: its likelihoods multiply the prior.
        let any = start.gather(1..2, true, &mut b[..model.states])?;
        start.take_out(any);
        start.x.values.iter_mut().zip(b).for_each(|(x, b)| *x *= b);
        rescale(&mut start.x)?;
        Some((start, 2))
    }

    /// Copies the likelihoods of some steps. Returns true if they were scaled.
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
        // Σ_i p(X_k = i, y_1 … y_k) = p(y_1 … y_k).
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
        // The kernel may fail after some steps. The second attempt starts from the same vector.
        let before = self.x;
        // First without scaling, which takes time and is seldom needed.
        for scaled in [false, true] {
            let any = self.gather(steps.clone(), scaled, likelihoods)?;
            let FewStatesModel { columns, states, .. } = self.model;
            self.x = before;
            if chain_forward(columns, &mut self.x, *states, likelihoods, rows, normalizers) {
                self.take_out(any);
                return Some(());
            }
            // They were scaled already: their range is too wide.
            if any {
                break;
            }
        }
        None
    }

    /// Takes x through eight segments, after copying and packing their likelihoods. Returns the
    /// products of the segments, and x at the start of each.
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
