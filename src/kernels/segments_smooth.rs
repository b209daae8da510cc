//! Forward and backward through eight segments, one a lane, from both ends of each
//! at once: neither recursion waits for the other.

use super::abreast::Abreast;
use super::lanes::{Eight, Kernel, Lanes, run};
use super::segments::{Few, Running, ahead, back, look_at, sum};

/// The smoothed distributions of all steps of each segment.
pub(crate) struct Smooth<'a, const N: usize> {
    pub(crate) model: Few<'a, N>,
    /// x before the first step of each segment, of any scale near one.
    pub(crate) starts: &'a [Eight; N],
    /// r after the last one.
    pub(crate) ends: &'a [Eight; N],
    pub(crate) likelihoods: &'a [[Abreast; N]],
    /// As many steps.
    pub(crate) out: &'a mut [[Abreast; N]],
}

/// Smooths. False if the range of a vector has become too wide.
pub(crate) fn smooth<const N: usize>(work: Smooth<'_, N>) -> bool {
    run(work)
}

impl<const N: usize> Kernel for Smooth<'_, N> {
    type Output = bool;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> bool {
        let Self { model: Few { columns, rows, unlooked }, starts, ends, likelihoods, out } = self;
        let steps = likelihoods.len();
        let out = &mut out[..steps];
        let mut both = [Running::new(lanes, starts), Running::new(lanes, ends)];
        let mut done = 0;
        while done < steps {
            let until = steps.min(done + unlooked);
            for k in done..until {
                let other = steps - 1 - k;
                both[0].x = ahead(lanes, columns, &likelihoods[k], &both[0].x);
                // Up to the middle each leaves its vector, which then the other meets. In
                // one loop: the recursions are most of the code.
                if k <= other {
                    put(lanes, &both[0].x, &mut out[k]);
                } else {
                    meet(lanes, &both[0].x, &mut out[k]);
                }
                if k < other {
                    put(lanes, &both[1].x, &mut out[other]);
                } else {
                    meet(lanes, &both[1].x, &mut out[other]);
                }
                both[1].x = back(lanes, rows, &likelihoods[other], &both[1].x);
            }
            if !look_at(lanes, &mut both) {
                return false;
            }
            done = until;
        }
        true
    }
}

#[inline(always)]
fn put<L: Lanes, const N: usize>(lanes: L, x: &[L::V; N], out: &mut [Abreast; N]) {
    for i in 0..N {
        lanes.store(x[i], &mut out[i]);
    }
}

/// x ∘ r, which sums to one, in place of one of them.
#[inline(always)]
fn meet<L: Lanes, const N: usize>(lanes: L, x: &[L::V; N], out: &mut [Abreast; N]) {
    let mut products = *x;
    for i in 0..N {
        products[i] = lanes.mul(products[i], lanes.load(&out[i]));
    }
    let factor = lanes.div(lanes.splat(1.0), sum(lanes, &products));
    for i in 0..N {
        lanes.store(lanes.mul(products[i], factor), &mut out[i]);
    }
}
