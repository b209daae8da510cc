//! A plain step of the filter, block by block: each block of the prediction is multiplied by its
//! likelihoods while it is in the first-level cache.
//!
//! It computes the same as the whole-vector step (section 2 of the
//! [formulas](crate::guide::formulas)) and is tried first. If anything is out of the ordinary it
//! gives up, and the whole-vector step finds out what.

use super::in_logs::BeliefRef;
use super::state::{BeliefForm, LiftedBelief, StepOutput};
use super::{Step, holds};
use crate::groups::Groups;
use crate::likelihood::{Diagonal, Likelihood};
use crate::transition::Transition;
use wayfix_kernels::limits;
use wayfix_kernels::{self as kernels, ForwardStep, ForwardSums, Product, Watch};

/// Number of states of one group that are multiplied at a time.
const REPEATED: usize = 512;

impl<A: Transition, B: Likelihood> Step<'_, A, B> {
    /// Takes the step with likelihoods of groups of states. Returns the normaliser, which includes
    /// the probability of evidence on the move, or `None` if belief or entries may be too small
    /// for a plain step, or if the results leave the range of `f64`.
    pub(super) fn advance_by_blocks(
        &self,
        (diagonal, groups): (&Diagonal<'_>, &Groups),
        has_evidence: bool,
        before: BeliefRef<'_>,
        lifted: &mut LiftedBelief,
        output: &mut StepOutput,
        rows: Option<&mut Vec<f64>>,
    ) -> Option<(f64, BeliefForm)> {
        let (transition, control) = (self.hmm.transition(), self.control?);
        let likelihoods = diagonal.linear_values()?;
        let largest = diagonal.check(groups.count()).ok()?;
        let fits = limits::is_unscaled(largest) && groups.as_slice().len() == before.linear.len();
        // Conditions of a plain step ("A plain step" in `limits`): no tiny belief is checked here,
        // no small entry below. There is no matrix to look at, so the operator has to report its
        // smallest.
        if !fits || before.logs.is_some() || lifted.is_needed() {
            return None;
        }
        if !limits::is_plain(transition.smallest_entry(control)) {
            return None;
        }
        // Watched even with rounded tails, since nothing is lifted here.
        let watch = Watch::Products;
        let after = &mut *output.lifted;
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
                // A run is either one group throughout, whose likelihood is repeated, or states of
                // consecutive groups, whose likelihoods are contiguous in memory already.
                if same {
                    let repeated = [likelihoods[group]; REPEATED];
                    let parts = predicted.chunks(REPEATED).zip(after.chunks_mut(REPEATED));
                    parts.for_each(|(p, after)| update(p, &repeated[..p.len()], after));
                } else {
                    update(predicted, &likelihoods[group..group + predicted.len()], after);
                }
            }
        });
        // Errors are left for the whole-vector step to report. An operator that passed too few
        // blocks breaks its contract: the output would keep values of an earlier step.
        if states != before.linear.len() || updated.negative_predicted || updated.small {
            if updated.small {
                lifted.lift_for_some_steps();
            }
            return None;
        }
        let predicted = updated.predicted;
        let is_valid = if has_evidence { limits::is_evidence_sum } else { limits::is_one };
        if !is_valid(predicted) || !holds(&updated, predicted) {
            return None;
        }
        let tiny = kernels::normalize_in_place(&mut output.lifted, updated.products, rows);
        Some((updated.products, BeliefForm::Plain { tiny }))
    }
}
