//! Published fits of data that are written out here: likelihoods at the published parameters, and
//! learning that reaches them.

#![expect(clippy::unreadable_literal, reason = "figures as they are printed")]

mod earthquakes;
mod federal_funds;
mod filardo;
mod gnp;

use wayfix_learn::LinearRegression;

/// Number of states of the chain of the present state (bit 0) and those of the four steps before
/// (bits 1 to 4).
const STATES: usize = 32;

/// The state after another, if the chain moves to `to`, 0 or 1.
fn after(from: usize, to: usize) -> usize {
    ((from << 1) % STATES) | to
}

/// A mean that switches, and four lags: the deviation from the mean of each step's state is that of
/// the four steps before by the coefficients (of the last step first), and noise.
fn lagged(means: [f64; 2], lags: [f64; 4], variance: f64) -> LinearRegression {
    let mean = |state: usize, lag: usize| means[state >> lag & 1];
    let intercept = |state: usize| {
        let before: f64 = (0..4).map(|k| lags[k] * mean(state, k + 1)).sum();
        [mean(state, 0) - before]
    };
    let intercepts: Vec<[f64; 1]> = (0..STATES).map(intercept).collect();
    let oldest_first = [lags[3], lags[2], lags[1], lags[0]];
    LinearRegression::diagonal(&[oldest_first; STATES], &intercepts, &[[variance]; STATES]).unwrap()
}

/// Sum over the states whose present is `state`.
fn present(p: &[f64], state: usize) -> f64 {
    p.iter().skip(state).step_by(2).sum()
}
