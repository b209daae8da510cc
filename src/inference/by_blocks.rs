//! A step of the filter in linear space, block by block: each block of the prediction is
//! multiplied by its likelihoods while it is in the first cache.

use super::evidence::SUMS;
use super::held::{Form, Held, Lifted, Results};
use super::step::{Step, UNSCALED, holds, is_one};
use crate::groups::Groups;
use crate::kernels::{self, ForwardStep, ForwardSums, Product, Watch};
use crate::likelihood::{Diagonal, Likelihood};
use crate::transition::Transition;

/// Smallest entry, 2^-100, whose products with probabilities that are not [tiny](kernels::TINY)
/// are normal `f64`s.
const LEAST_ENTRY: f64 = f64::from_bits((1023 - 100) << 52);
/// Number of likelihoods of one group that are multiplied at a time.
const REPEATED: usize = 512;

impl<A: Transition, B: Likelihood> Step<'_, A, B> {
    /// Takes the step with likelihoods of groups of states. Returns the normaliser, with the
    /// probability of evidence on the move in it, or `None` if belief or entries may be too small
    /// for that, or the results leave the range of `f64`.
    pub(super) fn advance_by_blocks(
        &self,
        (diagonal, groups): (&Diagonal<'_>, &Groups),
        has_evidence: bool,
        before: Held<'_>,
        lifted: &mut Lifted,
        results: &mut Results<'_>,
    ) -> Option<(f64, Form)> {
        let (transition, control) = (self.hmm.transition(), self.control?);
        let likelihoods = diagonal.linear_values()?;
        let largest = diagonal.check(groups.count()).ok()?;
        let fits = UNSCALED.contains(&largest) && groups.as_slice().len() == before.linear.len();
        if !fits || before.logs.is_some() || lifted.is_needed() {
            return None;
        }
        if transition.smallest_entry(control) < LEAST_ENTRY {
            return None;
        }
        let watch = if self.hmm.rounds_tails() { Watch::Nothing } else { Watch::Products };
        let after = &mut *results.lifted;
        let (mut updated, mut states) = (ForwardSums::NONE, 0);
        transition.apply_in_blocks(control, before.linear, &mut |first, predicted| {
            states += predicted.len();
            let after = &mut after[first..first + predicted.len()];
            for (run, group, same) in groups.runs(first..first + predicted.len()) {
                let run = run.start - first..run.end - first;
                let (predicted, after) = (&predicted[run.clone()], &mut after[run]);
                let mut update = |predicted, likelihoods, out| {
                    let prediction = Product::Computed(predicted);
                    let part = ForwardStep { prediction, lift: 1.0, likelihoods, watch, out };
                    updated = updated.and(kernels::forward_step(part));
                };
                if same {
                    let repeated = [likelihoods[group]; REPEATED];
                    let parts = predicted.chunks(REPEATED).zip(after.chunks_mut(REPEATED));
                    parts.for_each(|(p, after)| update(p, &repeated[..p.len()], after));
                } else {
                    update(predicted, &likelihoods[group..group + predicted.len()], after);
                }
            }
        });
        // Errors are reported by the step with all products at once.
        if states != before.linear.len() || updated.negative_predicted || updated.small {
            if updated.small {
                lifted.lift_for_some_steps();
            }
            return None;
        }
        let predicted = updated.predicted;
        let valid = if has_evidence { SUMS.contains(&predicted) } else { is_one(predicted) };
        if !valid || !holds(&updated, predicted) {
            return None;
        }
        let tiny = kernels::normalize_in_place(results.lifted, updated.products);
        Some((updated.products, Form::Plain { tiny }))
    }
}
