//! The way back in lock-step: see [`backward`](crate::inference::backward).

use super::{Group, Memory, Plan};
use crate::kernels::lockstep::{self, Abreast, Retreat};
use crate::kernels::{BACK_LIFT, Eight, LANES};
use crate::likelihood::Likelihood;
use crate::range::is_one;
use crate::transition::Transition;

/// What a step back leaves to the next.
pub(super) struct Carried {
    /// Σ γ_k of each lane.
    sums: Eight,
}

impl Carried {
    /// At the end of all sequences. Lanes that begin later must not find what other
    /// sequences left in `memory`.
    pub(super) fn new(memory: &mut Memory) -> Self {
        memory.q.fill(Abreast::default());
        Self { sums: [1.0; LANES] }
    }
}

impl<A: Transition, B: Likelihood> Plan<'_, A, B> {
    /// From γ_k to γ_{k-1} in all lanes that have a step k; α in the others. The
    /// lanes whose last step it is start here. Lanes that do not hold any more
    /// are marked.
    pub(super) fn retreat<S>(
        &self,
        group: &Group<'_, S>,
        step: usize,
        memory: &mut Memory,
        carried: &mut Carried,
        held: &mut [bool; LANES],
    ) {
        let n = self.ones.len();
        let Memory { alpha, likelihoods, inverse, q, ratio, gamma, .. } = memory;
        let mut factors = [0.0; LANES];
        for l in 0..LANES {
            if step == group.steps[l] {
                q.iter_mut().for_each(|q| q[l] = BACK_LIFT);
                carried.sums[l] = 1.0;
            }
            if step <= group.steps[l] && held[l] {
                factors[l] = inverse[step - 1][l] / carried.sums[l];
            }
        }
        carried.sums = lockstep::retreat(Retreat {
            matrix: self.columns,
            likelihoods: &likelihoods[(step - 1) * n..][..n],
            factors,
            alpha: &alpha[(step - 1) * n..][..n],
            q,
            ratio,
            gamma,
        });
        for (l, held) in held.iter_mut().enumerate() {
            if *held && step <= group.steps[l] && !is_one(carried.sums[l]) {
                *held = false;
                q.iter_mut().for_each(|q| q[l] = 0.0);
            }
        }
    }
}
