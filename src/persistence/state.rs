//! Formats of the states of filters.

use super::stored;
use crate::belief::Belief;
use crate::inference::{Envelope, FilterSnapshot, LogSum, Node, Pruning, TakenOut};

stored! {
    [] FilterSnapshot in inference: [], |state| {
        steps: usize = state.steps,
        steps_in_logs: usize = state.steps_in_logs,
        belief: Belief = state.belief,
        logs: Option<Vec<Option<f64>>> = state.logs.as_ref().map(|logs| {
            logs.iter().map(|log| log.is_finite().then_some(*log)).collect::<Vec<_>>()
        }),
        log_likelihood: [f64; 2] = [state.log_likelihood.sum, state.log_likelihood.lost],
    } => {
        let logs = logs.map(|logs: Vec<Option<f64>>| {
            logs.into_iter().map(|log| log.unwrap_or(f64::NEG_INFINITY)).collect()
        });
        let [sum, lost] = log_likelihood;
        Self::checked([steps, steps_in_logs], belief, logs, LogSum { sum, lost })
    };

    [U] FixedLagSnapshot<U> in inference: [U], |state| {
        lag: usize = state.lag,
        present: FilterSnapshot = state.present,
        past: Vec<(FilterSnapshot, U)> = state.past,
    } => Self::checked(lag, present, past);

    [] PrunedFilterSnapshot in inference: [], |state| {
        states: usize = state.states,
        steps: usize = state.steps,
        tolerance: Option<f64> = match state.pruning.tolerance {
            // NaN and −∞ mean the same as any value below 0.
            tolerance if tolerance < f64::INFINITY => Some(tolerance.max(f64::MIN)),
            tolerance => Some(-1.0).filter(|_| tolerance.is_nan()),
        },
        most_active: Option<usize> =
            Some(state.pruning.most_active).filter(|most| *most < usize::MAX),
        active: Vec<usize> = state.belief.states,
        estimate: Vec<f64> = state.belief.estimate,
        lower: Vec<f64> = state.belief.lower,
        excess: Vec<Option<f64>> = state.belief.excess.iter().copied().map(finite).collect::<Vec<_>>(),
        others: [Option<f64>; 2] =
            [finite(state.belief.elsewhere), finite(state.belief.outside)],
        bound: f64 = state.bound,
        log_likelihood: [f64; 2] = [state.log.sum, state.log.lost],
        log_excess: [Option<f64>; 2] =
            [finite(state.log_excess.sum), finite(state.log_excess.lost)],
        log_lost: bool = state.log_lost,
        share: f64 = state.share,
    } => {
        let or_infinite = |value: Option<f64>| value.unwrap_or(f64::INFINITY);
        let [elsewhere, outside] = others.map(or_infinite);
        let excess = excess.into_iter().map(or_infinite).collect();
        let belief = Envelope { states: active, estimate, lower, excess, elsewhere, outside };
        let most_active = most_active.unwrap_or(usize::MAX);
        let log = LogSum { sum: log_likelihood[0], lost: log_likelihood[1] };
        let [sum, lost] = log_excess.map(or_infinite);
        Self {
            states,
            steps,
            pruning: Pruning { tolerance: or_infinite(tolerance), most_active },
            belief,
            bound,
            log,
            log_excess: LogSum { sum, lost },
            log_lost,
            share,
        }
        .checked()
    };

    [] OnlineViterbiSnapshot in inference: [], |state| {
        steps: usize = state.steps,
        scores: Vec<Option<f64>> = state.scores.iter().copied().map(finite).collect::<Vec<_>>(),
        taken_out: [f64; 3] = {
            let TakenOut { whole, factors } = &state.taken_out;
            [*whole, factors.sum, factors.lost]
        },
        undecided: Vec<Vec<(u32, u32)>> = {
            let pairs = |nodes: &Vec<Node>| -> Vec<_> {
                nodes.iter().map(|node| (node.state, node.from)).collect()
            };
            state.levels.iter().map(pairs).collect::<Vec<_>>()
        },
    } => {
        let scores = scores.into_iter().map(|score| score.unwrap_or(f64::NEG_INFINITY));
        let [whole, sum, lost] = taken_out;
        let taken_out = TakenOut { whole, factors: LogSum { sum, lost } };
        let nodes = |pairs: Vec<(u32, u32)>| {
            pairs.into_iter().map(|(state, from)| Node { state, from }).collect()
        };
        let levels = undecided.into_iter().map(nodes).collect();
        Self::checked(steps, scores.collect(), taken_out, levels)
    };
}

/// A finite value, or `None`, for formats without infinity.
fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}
