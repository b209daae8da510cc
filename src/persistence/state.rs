//! Formats of the states of filters.

use super::stored;
use crate::belief::{Belief, SUM_TOLERANCE};
use crate::inference::{FilterSnapshot, FixedLagSnapshot, LogSum, MOST_STEPS};

stored! {
    [] FilterSnapshot in inference: [], |state| {
        steps: usize = state.steps,
        belief: Belief = state.belief,
        logs: Option<Vec<Option<f64>>> = state.logs.as_ref().map(|logs| {
            logs.iter().map(|log| log.is_finite().then_some(*log)).collect::<Vec<_>>()
        }),
        log_likelihood: [f64; 2] = [state.log_likelihood.sum, state.log_likelihood.lost],
    } => filter_state(steps, belief, logs, log_likelihood);

    [U] FixedLagSnapshot<U> in inference: [U], |state| {
        lag: usize = state.lag,
        present: FilterSnapshot = state.present,
        past: Vec<(FilterSnapshot, U)> = state.past,
    } => fixed_lag_state(lag, present, past);
}

fn check_finite([sum, lost]: [f64; 2]) -> Result<(), String> {
    if sum.is_finite() && lost.is_finite() {
        return Ok(());
    }
    Err(format!("the log-likelihood is the sum of {sum} and {lost}, expected finite values"))
}

fn filter_state(
    steps: usize,
    belief: Belief,
    logs: Option<Vec<Option<f64>>>,
    log_likelihood: [f64; 2],
) -> Result<FilterSnapshot, String> {
    if steps > MOST_STEPS {
        return Err(format!("{steps} steps, expected at most {MOST_STEPS}"));
    }
    let logs = logs.map(|logs| logs.into_iter().map(|log| log.unwrap_or(f64::NEG_INFINITY)));
    let logs: Option<Vec<f64>> = logs.map(Iterator::collect);
    if let Some(logs) = &logs {
        let (found, expected) = (logs.len(), belief.states());
        if found != expected {
            return Err(format!("{found} logarithms for a belief over {expected} states"));
        }
        for (state, (log, p)) in logs.iter().zip(belief.as_slice()).enumerate() {
            // False for NaN.
            let agree = (log.exp() - p).abs() <= SUM_TOLERANCE;
            if !agree {
                return Err(format!(
                    "state {state} has probability {p}, expected exp({log}) as its logarithm says"
                ));
            }
        }
    }
    check_finite(log_likelihood)?;
    let [sum, lost] = log_likelihood;
    Ok(FilterSnapshot { steps, belief, logs, log_likelihood: LogSum { sum, lost } })
}

fn fixed_lag_state<U>(
    lag: usize,
    present: FilterSnapshot,
    past: Vec<(FilterSnapshot, U)>,
) -> Result<FixedLagSnapshot<U>, String> {
    let (found, steps) = (past.len(), present.steps);
    if found != lag.min(steps) {
        return Err(format!(
            "{found} past states after {steps} steps with a lag of {lag}, expected {}",
            lag.min(steps)
        ));
    }
    for (index, (state, _)) in past.iter().enumerate() {
        let expected = steps - found + index;
        if state.steps != expected {
            let found = state.steps;
            return Err(format!("past state {index} is of step {found}, expected {expected}"));
        }
        let (found, expected) = (state.belief.states(), present.belief.states());
        if found != expected {
            return Err(format!(
                "past state {index} is over {found} states, expected {expected} as the present one"
            ));
        }
    }
    Ok(FixedLagSnapshot { lag, present, past })
}
