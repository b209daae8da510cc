//! Forward through eight segments, one a lane: each belief, and its normaliser.

use super::abreast::Abreast;
use super::lanes::{Eight, Kernel, Lanes, run};
use super::segments::{Few, Running, ahead, all_near, sum};

/// The filtered distributions of all steps of each segment.
pub(crate) struct Filter<'a, const N: usize> {
    pub(crate) model: Few<'a, N>,
    /// x before the first step of each segment, of any scale near one.
    pub(crate) starts: &'a [Eight; N],
    pub(crate) likelihoods: &'a [[Abreast; N]],
    /// As many steps.
    pub(crate) out: &'a mut [[Abreast; N]],
    /// p(y_k | y_1 … y_{k-1}) of each step, up to what was taken out of likelihoods.
    pub(crate) normalisers: &'a mut [Abreast],
}

/// Filters. False if the range of a vector has become too wide.
pub(crate) fn filter<const N: usize>(work: Filter<'_, N>) -> bool {
    run(work)
}

impl<const N: usize> Kernel for Filter<'_, N> {
    type Output = bool;

    /// The recursion itself goes on as it is, and does not wait for a division.
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> bool {
        let Self { model, starts, likelihoods, out, normalisers } = self;
        let one = lanes.splat(1.0);
        let mut running = [Running::new(lanes, starts)];
        let mut factor = lanes.div(one, sum(lanes, &running[0].x));
        let places = out.chunks_mut(model.unlooked).zip(normalisers.chunks_mut(model.unlooked));
        for (steps, (out, normalisers)) in likelihoods.chunks(model.unlooked).zip(places) {
            for ((b, out), normalizer) in steps.iter().zip(out).zip(normalisers) {
                running[0].x = ahead(lanes, model.columns, b, &running[0].x);
                let total = sum(lanes, &running[0].x);
                lanes.store(lanes.mul(total, factor), normalizer);
                factor = lanes.div(one, total);
                for (x, out) in running[0].x.iter().zip(out) {
                    lanes.store(lanes.mul(*x, factor), out);
                }
            }
            if !all_near(lanes, &running) {
                if !running[0].rescale(lanes) {
                    return false;
                }
                factor = lanes.div(one, sum(lanes, &running[0].x));
            }
        }
        true
    }
}
