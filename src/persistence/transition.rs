//! Formats of transition operators.

use std::collections::BTreeMap;
use std::convert::Infallible;

use super::stored;
use crate::belief::SUM_TOLERANCE;
use crate::error::{Parameter, TransitionError};
use crate::transition::{
    DwellTransition, RestartTransition, SparseTransition, TiedTransition, Transition,
    TransitionEntries, check_probability,
};

stored! {
    [] DenseTransition: [], |a| {
        states: usize = a.states(),
        columns: Vec<f64> = a.values(),
    } => if states.checked_mul(states) == Some(columns.len()) {
        Self::from_fn(states, |to, from| columns[from * states + to])
    } else {
        Err(TransitionError::WrongLength { states, found: columns.len() })
    };

    [] SparseTransition: [], |a| {
        states: usize = a.states(),
        to: Vec<u32> = entries(a, |to, _, _| to as u32),
        from: Vec<u32> = entries(a, |_, from, _| from as u32),
        probability: Vec<f64> = entries(a, |_, _, p| p),
    } => sparse(states, &to, &from, &probability);

    [] TiedTransition in transition: [], |a| {
        transition: SparseTransition = a.transition,
        parameters: Vec<u32> = a.parameters.iter().map(|parameter| parameter.0).collect::<Vec<_>>(),
    } => tied(transition, &parameters);

    [A: Transition<Control = ()>] SwitchedTransition<A> in transition: [A], |a| {
        operators: Vec<A> = a.operators,
    } => Self::new(operators);

    [] WindowTransition in transition: [], |a| {
        states: usize = a.states(),
        first: isize = a.first,
        weights: Vec<f64> = {
            let mut weights = vec![0.0; a.window.last().map_or(0, |last| last.to + 1)];
            a.window.iter().for_each(|entry| weights[entry.to] = entry.value);
            weights
        },
        closed: bool = a.closed,
    } => Self::new(states, first, &weights, closed);

    [A: Transition] RestartTransition<A> in transition: [A], |a| {
        inner: A = a.inner,
        keep: f64 = a.keep,
        restart: Vec<f64> = a.restart,
        evidence: Option<f64> = a.evidence.given(),
    } => restarting(inner, keep, restart).and_then(|a| a.with_optional_evidence(evidence));

    [A1: Transition, A2: Transition<Control = A1::Control>]
    KroneckerTransition<A1, A2> in transition: [A1, A2], |a| {
        first: A1 = a.first,
        second: A2 = a.second,
    } => Self::new(first, second);

    [A: Transition] PowerTransition<A> in transition: [A], |a| {
        inner: A = a.inner,
        exponent: u32 = a.exponent(),
    } => Ok::<_, Infallible>(Self::new(inner, exponent));

    [A: Transition] DwellTransition<A> in transition: [A], |a| {
        moves: A = a.moves,
        ages: Vec<Vec<(f64, f64)>> = {
            let age = |state: usize| (a.leave[state], a.stay[state]);
            a.ranges().map(|(_, states)| states.map(age).collect()).collect::<Vec<Vec<_>>>()
        },
    } => dwelling(moves, ages);
}

/// Maps each entry (to, from, probability), column by column.
fn entries<T>(a: &SparseTransition, part: impl Fn(usize, usize, f64) -> T) -> Vec<T> {
    let columns = (0..a.states()).map(|from| (from, a.outgoing(&(), from)));
    let part = &part;
    columns.flat_map(|(from, column)| column.map(move |(to, p)| part(to, from, p))).collect()
}

fn sparse(
    states: usize,
    to: &[u32],
    from: &[u32],
    probability: &[f64],
) -> Result<SparseTransition, TransitionError> {
    for (what, found) in [("from", from.len()), ("probability", probability.len())] {
        if found != to.len() {
            let what = format!("the number of values in `{what}`");
            let expected = "as many as in `to`";
            return Err(Parameter::new(what, found as f64, expected).into());
        }
    }
    if to.len() < states {
        // Some state has no way out. An error before any allocation keeps a wrong number of
        // states from exhausting memory.
        let mut left = vec![false; to.len() + 1];
        for &from in from {
            if let Some(left) = left.get_mut(from as usize) {
                *left = true;
            }
        }
        let column = left.iter().position(|left| !left).unwrap_or(0);
        return Err(TransitionError::ColumnSum { column, sum: 0.0 });
    }
    let entries = to.iter().zip(from).zip(probability);
    SparseTransition::from_triplets(
        states,
        entries.map(|((&to, &from), &p)| (to as usize, from as usize, p)),
    )
}

/// Checks parameters for the invariants of [`TiedTransition::new`]: they are numbered without
/// gaps, have equal values up to rounding, and two states share all of theirs or none.
fn tied(transition: SparseTransition, numbers: &[u32]) -> Result<TiedTransition, String> {
    let (found, expected) = (numbers.len(), transition.entries());
    if found != expected {
        return Err(format!("{found} parameters for {expected} entries, expected one each"));
    }
    let mut used = numbers.to_vec();
    used.sort_unstable();
    used.dedup();
    if let Some((gap, _)) =
        used.iter().enumerate().find(|(number, used)| **used as usize != *number)
    {
        return Err(format!("no entry has parameter {gap}, though one has a higher one"));
    }
    let mut kinds = BTreeMap::new();
    let mut known: Vec<Option<(usize, f64)>> = vec![None; used.len()];
    let mut parameters = Vec::with_capacity(found);
    for from in 0..transition.states() {
        let column = &numbers[parameters.len()..];
        let column = &column[..transition.outgoing(&(), from).count()];
        let mut sorted = column.to_vec();
        sorted.sort_unstable();
        let next = kinds.len();
        let kind = *kinds.entry(sorted.clone()).or_insert(next);
        for (&number, (to, p)) in column.iter().zip(transition.outgoing(&(), from)) {
            let (its_kind, value) = *known[number as usize].get_or_insert((kind, p));
            if its_kind != kind || (p - value).abs() > SUM_TOLERANCE {
                return Err(format!(
                    "the transition from state {from} to state {to} has parameter {number}, which another state has with other parameters or another probability"
                ));
            }
            let after = sorted.partition_point(|other| *other <= number);
            let times = after - sorted.partition_point(|other| *other < number);
            parameters.push((number, times as u32));
        }
    }
    Ok(TiedTransition { transition, parameters })
}

fn restarting<A: Transition>(
    inner: A,
    keep: f64,
    restart: Vec<f64>,
) -> Result<RestartTransition<A>, TransitionError> {
    check_probability(keep, || "the probability of no restart".to_owned())?;
    let (found, expected) = (restart.len(), inner.states());
    if found != expected {
        return Err(TransitionError::PartStates { part: "restart belief", found, expected });
    }
    if let Some((state, &value)) = restart.iter().enumerate().find(|(_, p)| p.is_nan() || **p < 0.0)
    {
        let what = format!("the probability of a restart in state {state}");
        let expected = "a finite value of at least 0";
        return Err(Parameter::new(what, value, expected).into());
    }
    let sum = keep + restart.iter().sum::<f64>();
    check_one(sum, || "the probability of a restart or none".to_owned())?;
    Ok(RestartTransition::from_parts(inner, keep, restart))
}

fn dwelling<A: Transition>(
    moves: A,
    ages: Vec<Vec<(f64, f64)>>,
) -> Result<DwellTransition<A>, TransitionError> {
    for (place, ages) in ages.iter().enumerate() {
        if ages.is_empty() {
            let what = format!("the number of ages of place {place}");
            return Err(Parameter::new(what, 0.0, "at least 1").into());
        }
        for (&(leave, stay), steps) in ages.iter().zip(1..) {
            let what =
                |verb: &str| format!("the probability of {verb} place {place} after {steps} steps");
            check_probability(leave, || what("leaving"))?;
            check_probability(stay, || what("staying in"))?;
            check_one(leave + stay, || what("leaving or staying in"))?;
        }
    }
    DwellTransition::from_ages(moves, ages)
}

pub(super) fn check_one(value: f64, what: impl FnOnce() -> String) -> Result<(), TransitionError> {
    if (value - 1.0).abs() > SUM_TOLERANCE {
        return Err(Parameter::new(what(), value, "1").into());
    }
    Ok(())
}
