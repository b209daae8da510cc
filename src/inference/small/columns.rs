//! The matrix of any operator.

use super::LEAST_FACTOR;
use crate::kernels::LIFT;
use crate::range::is_one;
use crate::transition::Transition;

/// A, column after column, by a product for each state. `None` if an entry is
/// too small, or the columns do not sum to one.
pub(super) fn of<A: Transition>(transition: &A, control: &A::Control) -> Option<Vec<f64>> {
    let n = transition.states();
    let (mut unit, mut columns) = (vec![0.0; n], vec![0.0; n * n]);
    for (from, column) in columns.chunks_exact_mut(n).enumerate() {
        // Lifted, so that an entry that is a product of small ones is not lost.
        unit[from] = LIFT;
        transition.apply(control, &unit, column);
        unit[from] = 0.0;
        column.iter_mut().for_each(|entry| *entry /= LIFT);
        let valid = |&entry: &f64| entry == 0.0 || entry >= LEAST_FACTOR;
        if !(column.iter().all(valid) && is_one(column.iter().sum())) {
            return None;
        }
    }
    Some(columns)
}
