//! The stationary distribution of an operator, A π = π, and the derivatives of functions of it.
//!
//! States are eliminated one by one: what is left is the chain watched only while it is in the
//! other states (Grassmann, Taksar and Heyman 1985). That takes only sums, products and quotients
//! of numbers above 0, so that each probability has a small relative error, however slowly the
//! chain mixes. The state with the fewest pairs of moves into and out of it goes first (Markowitz
//! 1957), so that maps of places fill in little.

use std::collections::BTreeSet;

use super::{Transition, TransitionEntries, constant_control};
use crate::belief::Belief;
use crate::error::{OutOfRange, TransitionError};

/// Largest number of entries of an elimination: about 1 GB.
const MOST_ENTRIES: usize = 1 << 26;
/// If a weight exceeds this, all weights are scaled down.
const LARGE: f64 = 1e150;

/// The control of an operator that is the same at all steps and whose columns are distributions;
/// an error for other operators, which have no stationary distribution.
pub(crate) fn stationary_control<A: Transition>(
    transition: &A,
) -> Result<&'static A::Control, TransitionError> {
    let Some(control) = constant_control::<A>() else {
        let cause = "the operator has a control";
        return Err(TransitionError::Stationary(cause));
    };
    if transition.evidence(control).is_some() {
        return Err(TransitionError::Stationary("the operator has evidence on moves"));
    }
    Ok(control)
}

/// The closed class of a chain, with its states eliminated.
pub(crate) struct Stationary {
    states: usize,
    /// All states of the class but the last, in the order of elimination.
    eliminated: Vec<Eliminated>,
    last: usize,
}

/// An eliminated state, with the moves of the chain on it and on the states eliminated after it.
struct Eliminated {
    state: usize,
    /// Probability of leaving it.
    leaves: f64,
    /// Pairs (from, probability).
    into: Vec<(u32, f64)>,
    /// Pairs (to, share of the moves that leave).
    out: Vec<(u32, f64)>,
}

impl Stationary {
    /// Eliminates the states of the closed class. O(n³) for a full matrix, and for maps of places
    /// little more than O(n √n).
    pub(crate) fn of<A: TransitionEntries>(transition: &A) -> Result<Self, TransitionError> {
        let control = stationary_control(transition)?;
        let states = transition.states();
        // Only moves to other states. A stay changes nothing but the time, which `leaves` accounts
        // for.
        let column = |from: usize| {
            let others = transition.outgoing(control, from).filter(|entry| entry.0 != from);
            others.map(|(to, p)| (to as u32, p)).collect::<Vec<_>>()
        };
        let out: Vec<Vec<(u32, f64)>> = (0..states).map(column).collect();
        let mut into = vec![Vec::new(); states];
        for (from, column) in (0..).zip(&out) {
            column.iter().for_each(|(to, _)| into[*to as usize].push(from));
        }
        let class = closed_class(&out, &into)?;
        eliminate(states, &class, out, into)
    }

    /// The distribution π with A π = π; 0 outside the closed class.
    pub(crate) fn distribution(&self) -> Belief {
        // Back substitution, from the last state to the first that was eliminated: in the chain on
        // a state and those after it, flow in equals flow out, Σ_j π_j p(j → i) = π_i · leaves.
        let mut weights = vec![0.0; self.states];
        weights[self.last] = 1.0;
        for Eliminated { state, leaves, into, .. } in self.eliminated.iter().rev() {
            let mut flow: f64 = into.iter().map(|(from, p)| weights[*from as usize] * p).sum();
            // Relative to the last state, which may be rare, a weight may leave the doubles. What
            // scaling makes 0 is below 1e-308 of the whole.
            while flow / leaves > LARGE {
                flow /= LARGE;
                weights.iter_mut().for_each(|weight| *weight /= LARGE);
            }
            weights[*state] = flow / leaves;
        }
        let sum: f64 = weights.iter().sum();
        Belief::from_valid(weights.iter().map(|weight| weight / sum).collect())
    }

    /// Derivatives of Σ `rewards[i]` `π[i]`: to first order, moving probability ε in column j from
    /// state a to state b changes it by ε `π[j]` (h_b − h_a). Returns h = Z' `rewards`, with the
    /// fundamental matrix Z = (I − A + π 1')⁻¹ (Kemeny and Snell 1960; Schweitzer 1968), up to a
    /// constant; 0 outside the closed class.
    pub(crate) fn potentials(&self, rewards: &[f64]) -> Vec<f64> {
        // h_i = rewards_i − g + Σ_j p(j | i) h_j, with the mean reward g. So h_i is the expected
        // sum of reward − g until the chain meets the last state, where h is 0. g is not known yet:
        // rewards and times are summed separately. Each eliminated state passes its sums on to the
        // states that lead to it, by the expected number of visits, p / leaves.
        let mut sums: Vec<[f64; 2]> = rewards.iter().map(|reward| [*reward, 1.0]).collect();
        for Eliminated { state, leaves, into, .. } in &self.eliminated {
            let [reward, time] = sums[*state].map(|sum| sum / leaves);
            for (from, p) in into {
                let [of_reward, of_time] = &mut sums[*from as usize];
                *of_reward += p * reward;
                *of_time += p * time;
            }
        }
        // The last state has the reward and the time between two of its visits: their ratio is g
        // (renewal).
        let [reward, time] = sums[self.last];
        let mean = reward / time;
        let mut potentials = vec![0.0; self.states];
        for Eliminated { state, leaves, out, .. } in self.eliminated.iter().rev() {
            let [reward, time] = sums[*state];
            // The states that this state leads to were eliminated later, so their h are known.
            let next = out.iter().map(|(to, share)| share * potentials[*to as usize]);
            potentials[*state] = (reward - mean * time) / leaves + next.sum::<f64>();
        }
        potentials
    }

    /// States of the closed class.
    pub(crate) fn class(&self) -> impl Iterator<Item = usize> {
        self.eliminated.iter().map(|eliminated| eliminated.state).chain([self.last])
    }
}

/// Returns the states of the only closed class, ascending; an error if there are several.
fn closed_class(out: &[Vec<(u32, f64)>], into: &[Vec<u32>]) -> Result<Vec<u32>, TransitionError> {
    // Searches against the moves: all states that lead to state 0, then all that lead to the first
    // of the others, and so on. Suppose some state r is reached from all. The search that found r
    // found every state that leads to r and was not yet seen, that is all of them: it was the last,
    // and r leads to the state where it began. So that state is also reached from all.
    let mut seen = vec![false; out.len()];
    let mut last = 0;
    for state in 0..out.len() {
        if !seen[state] {
            last = state;
            search(state, &mut seen, |at| into[at].iter().copied());
        }
    }
    // If some state does not lead to `last`, no state is reached from all: there are several closed
    // classes.
    let mut seen = vec![false; out.len()];
    search(last, &mut seen, |at| into[at].iter().copied());
    if let Some(first) = seen.iter().position(|seen| !seen) {
        return Err(TransitionError::ClosedClasses { first, second: last });
    }
    // The class is what `last` leads to: everything leads back to it.
    seen.fill(false);
    search(last, &mut seen, |at| out[at].iter().map(|entry| entry.0));
    Ok((0..).zip(seen).filter(|(_, seen)| *seen).map(|(state, _)| state).collect())
}

/// Marks the states that can be reached from `from` by `next`, and `from` itself.
fn search<I: Iterator<Item = u32>>(from: usize, seen: &mut [bool], next: impl Fn(usize) -> I) {
    let mut waiting = vec![from];
    seen[from] = true;
    while let Some(state) = waiting.pop() {
        for to in next(state) {
            if !std::mem::replace(&mut seen[to as usize], true) {
                waiting.push(to as usize);
            }
        }
    }
}

fn eliminate(
    states: usize,
    class: &[u32],
    mut out: Vec<Vec<(u32, f64)>>,
    mut into: Vec<Vec<u32>>,
) -> Result<Stationary, TransitionError> {
    // No move leaves the class, but some may lead into it.
    let mut inside = vec![false; states];
    class.iter().for_each(|state| inside[*state as usize] = true);
    into.iter_mut().for_each(|into| into.retain(|from| inside[*from as usize]));
    // Eliminating a state joins each of its predecessors to each of its successors: the number of
    // pairs bounds the new entries.
    let cost = |out: &[Vec<_>], into: &[Vec<_>], at: u32| {
        out[at as usize].len().saturating_mul(into[at as usize].len())
    };
    let mut costs = vec![0; states];
    let mut queue = BTreeSet::new();
    for &state in class {
        costs[state as usize] = cost(&out, &into, state);
        queue.insert((costs[state as usize], state));
    }
    let mut eliminated = Vec::with_capacity(class.len() - 1);
    let mut entries = 0;
    while let Some((_, k)) = queue.pop_first() {
        let state = k as usize;
        if queue.is_empty() {
            return Ok(Stationary { states, eliminated, last: state });
        }
        // The probability of leaving is summed from the moves, not taken as 1 − p(stay): this is
        // how the method avoids subtractions.
        let mut shares = std::mem::take(&mut out[state]);
        let leaves: f64 = shares.iter().map(|entry| entry.1).sum();
        if leaves == 0.0 {
            let what = format!("the probability of leaving state {state}");
            return Err(OutOfRange::new(what, leaves, "a value in the range of doubles").into());
        }
        shares.iter_mut().for_each(|entry| entry.1 /= leaves);
        let mut from_others = Vec::new();
        for from in std::mem::take(&mut into[state]) {
            let column = std::mem::take(&mut out[from as usize]);
            let (column, p) = bypass(from, column, k, &shares, |to| into[to as usize].push(from));
            out[from as usize] = column;
            from_others.push((from, p));
        }
        shares.iter().for_each(|(to, _)| into[*to as usize].retain(|from| *from != k));
        // Only the neighbours have other lists now, so only their costs change.
        for other in shares.iter().map(|share| share.0).chain(from_others.iter().map(|m| m.0)) {
            let now = cost(&out, &into, other);
            let before = std::mem::replace(&mut costs[other as usize], now);
            if before != now {
                queue.remove(&(before, other));
                queue.insert((now, other));
            }
        }
        entries += shares.len() + from_others.len();
        if entries > MOST_ENTRIES {
            return Err(TransitionError::Elimination { states: class.len(), most: MOST_ENTRIES });
        }
        eliminated.push(Eliminated { state, leaves, into: from_others, out: shares });
    }
    Err(TransitionError::Empty)
}

/// Returns the moves out of a state after those to state k have been passed on to where k leads,
/// and the probability of the moves to k. Calls `new` for each state that was not reached before.
fn bypass(
    from: u32,
    column: Vec<(u32, f64)>,
    k: u32,
    shares: &[(u32, f64)],
    mut new: impl FnMut(u32),
) -> (Vec<(u32, f64)>, f64) {
    let p = column.iter().find(|entry| entry.0 == k).map_or(0.0, |entry| entry.1);
    // Both lists ascend, and so does the merged one. What k leads back to `from` is a stay, which
    // is left out as all stays are.
    let mut merged = Vec::with_capacity(column.len() + shares.len());
    let mut shares = shares.iter().filter(|share| share.0 != from).peekable();
    for (to, known) in column {
        while let Some((other, share)) = shares.next_if(|share| share.0 < to) {
            merged.push((*other, p * share));
            new(*other);
        }
        let more = shares.next_if(|share| share.0 == to).map_or(0.0, |share| p * share.1);
        if to != k {
            merged.push((to, known + more));
        }
    }
    for (other, share) in shares {
        merged.push((*other, p * share));
        new(*other);
    }
    (merged, p)
}
