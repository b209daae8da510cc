//! Prediction from many states at once, by products with the whole matrix.

use super::advance::Sums;
use super::envelope::{Envelope, PRUNED_LIFT};
use super::moves::{Bounds, Moves};
use crate::inference::pruned::active_set::ActiveSet;
use crate::transition::Transition;
use wayfix_kernels::Aligned;

/// Share of all states above which products go through the whole matrix: at this share they take
/// about as long as listing the states and looking up each entry, on 27,143 places with five
/// entries each; with all states active, half as long.
pub(crate) const WIDE: f64 = 0.2;
/// Smallest entry whose products with the kept parts of a belief are above 0.
pub(crate) const LEAST_ENTRY: f64 = 1e-200;
/// Limit on the excess for sums over all states not to overflow.
const LARGEST_EXCESS: f64 = 1e20;

/// Memory for wide predictions, and the results of the last one.
#[derive(Debug, Clone, Default)]
pub(crate) struct Wide {
    memory: Option<Box<Memory>>,
}

#[derive(Debug, Clone)]
struct Memory {
    before: Aligned,
    estimate: Aligned,
    lower: Aligned,
    excess: Aligned,
    /// Sums of the entries out of inactive states.
    beyond: Aligned,
}

impl Wide {
    /// Returns true if a step uses products: from many states, by a stored matrix that is the
    /// same at all steps and without evidence, whose products are then the sums over its entries,
    /// of any order.
    pub(crate) fn is_for<A: Transition>(
        before: &Envelope,
        transition: &A,
        control: Option<&A::Control>,
        constant: Option<&Bounds>,
    ) -> bool {
        let (Some(control), Some(bounds)) = (control, constant) else { return false };
        before.states.len() as f64 > WIDE * transition.states() as f64
            && bounds.smallest >= LEAST_ENTRY
            && before.excess.iter().all(|excess| *excess < LARGEST_EXCESS)
            && transition.stored(control).is_some()
    }

    /// Computes the products, and lists the states to which the step leads.
    pub(crate) fn predict<A: Transition>(
        &mut self,
        before: &Envelope,
        (transition, control): (&A, &A::Control),
        wanted: &[usize],
        active_set: &mut ActiveSet,
    ) {
        let new = || {
            let zeros = Aligned::new(transition.states(), 0.0);
            let (estimate, lower) = (zeros.clone(), zeros.clone());
            let (excess, beyond) = (zeros.clone(), zeros.clone());
            Box::new(Memory { before: zeros, estimate, lower, excess, beyond })
        };
        let memory = self.memory.get_or_insert_with(new);
        let Memory { before: x, estimate, lower, excess, beyond } = &mut **memory;
        let products =
            [(&before.estimate, estimate), (&before.lower, lower), (&before.excess, excess)];
        for (values, out) in products {
            // Without excess, as at first, a product is saved.
            if values.iter().all(|value| *value == 0.0) {
                out.fill(0.0);
                continue;
            }
            x.fill(0.0);
            for (&state, value) in before.states.iter().zip(values) {
                x[state] = value * PRUNED_LIFT;
            }
            transition.apply(control, x, out);
        }
        if before.is_open() {
            // One in each inactive state: the product is the sum of the entries out of them.
            x.fill(1.0);
            before.states.iter().for_each(|&state| x[state] = 0.0);
            transition.apply(control, x, beyond);
        } else {
            beyond.fill(0.0);
        }
        // An active state has an estimate or an excess above 1e-290, or is of the prior: no
        // product with an entry has become 0.
        let leads = memory.estimate.iter().zip(&*memory.excess);
        let leads = leads.map(|(estimate, excess)| *estimate > 0.0 || *excess > 0.0);
        active_set.list_reached(leads, wanted);
    }

    /// Returns the sums over the entries into a state, of the last prediction.
    pub(crate) fn sums<A: Transition>(
        &self,
        moves: Option<&Moves<'_, A>>,
    ) -> impl FnMut(usize) -> Sums {
        let (memory, terms) = (self.memory.as_deref(), moves.map_or(1, |moves| moves.bounds.terms));
        move |i| match memory {
            Some(memory) => Sums {
                estimate: memory.estimate[i],
                lower: memory.lower[i],
                excess: memory.excess[i],
                beyond: memory.beyond[i],
                terms,
            },
            None => Sums::default(),
        }
    }
}
