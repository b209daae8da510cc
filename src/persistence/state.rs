//! Formats of the states of filters. Their fields are listed beside the states, for their bytes too.

use std::collections::VecDeque;

use super::stored;
use crate::belief::Belief;
use crate::inference::FilterSnapshot;
use crate::inference::stored_states::{
    BELIEF, COUNT, COUNT_OR_ANY, DOUBLE, DOUBLES, FLAG, LEVELS, LOGS, MAYBE_LOGS, OPEN_DOUBLES,
    OPEN_SUM, OTHERS, STATES, SUM, TAKEN_OUT, TOLERANCE, filter_fields, online_viterbi_fields,
    pruned_fields,
};

/// Stores a state with a list of fields.
macro_rules! with_names {
    (
        $state:ident, {$($name:ident: $data:ty = $codec:ident($($path:ident).+),)*}
        bytes: $($next:ident),*
    ) => {
        stored! {
            [] $state in inference: [], |state| {
                $($name: $data = ($codec.data)(&state.$($path).+),)*
            } => {
                let mut state = Self::blank();
                $(state.$($path).+ = ($codec.value)($name);)*
                state.checked()
            };
        }
    };
}
filter_fields!(with_names);
pruned_fields!(with_names);
online_viterbi_fields!(with_names);

stored! {
    [U] FixedLagSnapshot<U> in inference: [U], |state| {
        lag: usize = state.window.lag,
        present: FilterSnapshot = state.present,
        past: VecDeque<(FilterSnapshot, U)> = state.window.past,
    } => Self::checked(lag, present, past);
}
