//! Formats of transition operators.

use std::collections::BTreeMap;
use std::convert::Infallible;

use super::stored;
use crate::belief::SUM_TOLERANCE;
use crate::error::{Parameter, TransitionError};
use crate::transition::{
    ConstrainedTransition, Durations, DwellTransition, FIXED, LogitTransition, RestartTransition,
    SparseTransition, Transition, TransitionEntries, check_probability,
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

    [] ConstrainedTransition in transition: [], |a| {
        transition: SparseTransition = a.transition,
        parameters: Vec<Option<u32>> = {
            let number = |parameter: &(u32, u32)| (parameter.0 != FIXED).then_some(parameter.0);
            a.parameters.iter().map(number).collect::<Vec<_>>()
        },
        pseudo_counts: Vec<f64> = a.pseudo_counts,
    } => constrained(transition, &parameters, &pseudo_counts);

    [A: Transition<Control = ()>] SwitchedTransition<A> in transition: [A], |a| {
        operators: Vec<A> = a.operators,
    } => Self::new(operators);

    [] LogitTransition in transition: [], |a| {
        states: usize = a.states(),
        inputs: usize = a.inputs(),
        to: Vec<u32> = a.moves().map(|(_, to)| to as u32).collect::<Vec<_>>(),
        from: Vec<u32> = a.moves().map(|(from, _)| from as u32).collect::<Vec<_>>(),
        intercept: Vec<f64> = a.intercepts(),
        group: Vec<Option<u32>> = {
            let group = |(from, to)| a.slope_group(from, to).map(|group| group as u32);
            a.moves().map(group).collect::<Vec<_>>()
        },
        slopes: Vec<Vec<f64>> = a.groups().collect::<Vec<_>>(),
        ridge: f64 = a.ridge(),
    } => logit(states, inputs, [&to, &from], (&intercept, &group, &slopes), ridge);

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
        inner: A = a.jumps.inner,
        keep: f64 = a.jumps.keep,
        restart: Vec<f64> = a.jumps.to,
        evidence: Option<f64> = a.jumps.evidence,
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

    [] GeneratorTransition in transition: [], |a| {
        rates: Vec<Vec<(usize, f64)>> = {
            let mut rates = vec![Vec::new(); a.states()];
            a.triplets().for_each(|(to, from, rate)| rates[from].push((to, rate)));
            rates
        },
    } => {
        let columns = rates.iter().enumerate();
        let moves = columns.flat_map(|(from, out)| out.iter().map(move |&(to, rate)| (to, from, rate)));
        Self::from_triplets(rates.len(), moves)
    };

    [A: Transition] DwellTransition<A> in transition: [A], |a| {
        moves: A = a.moves,
        ages: Vec<Vec<(f64, f64)>> = {
            let age = |state: usize| (a.leave[state], a.stay[state]);
            a.ranges().map(|(_, states)| states.map(age).collect()).collect::<Vec<Vec<_>>>()
        },
        durations: Vec<Durations> = a.durations,
    } => dwelling(moves, ages, &durations);
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

/// Checks parameters for the invariants of [`ConstrainedTransition`]: they are numbered without
/// gaps, have equal shares of what is not fixed up to rounding, and two states share all of theirs
/// or none.
fn constrained(
    transition: SparseTransition,
    numbers: &[Option<u32>],
    pseudo_counts: &[f64],
) -> Result<ConstrainedTransition, String> {
    let (found, expected) = (numbers.len(), transition.entries());
    if found != expected {
        return Err(format!("{found} parameters for {expected} entries, expected one each"));
    }
    let mut used: Vec<u32> = numbers.iter().flatten().copied().collect();
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
        let mut sorted: Vec<u32> = column.iter().flatten().copied().collect();
        sorted.sort_unstable();
        let next = kinds.len();
        let kind = *kinds.entry(sorted.clone()).or_insert(next);
        let entries = || column.iter().zip(transition.outgoing(&(), from));
        let rest: f64 = entries().filter(|entry| entry.0.is_some()).map(|entry| entry.1.1).sum();
        for (number, (to, p)) in entries() {
            let Some(number) = *number else {
                parameters.push((FIXED, 1));
                continue;
            };
            let share = p / rest;
            let (its_kind, value) = *known[number as usize].get_or_insert((kind, share));
            if its_kind != kind || (share - value).abs() > SUM_TOLERANCE {
                return Err(format!(
                    "the transition from state {from} to state {to} has parameter {number}, which another state has with other parameters or another probability"
                ));
            }
            let after = sorted.partition_point(|other| *other <= number);
            let times = after - sorted.partition_point(|other| *other < number);
            parameters.push((number, times as u32));
        }
    }
    let constrained = ConstrainedTransition { transition, parameters, pseudo_counts: Vec::new() };
    if pseudo_counts.is_empty() {
        return Ok(constrained);
    }
    if pseudo_counts.len() != found {
        let given = pseudo_counts.len();
        return Err(format!("{given} pseudo-counts for {found} entries, expected one each"));
    }
    let mut counts = pseudo_counts.iter().copied();
    let counted = constrained.with_pseudo_counts(|_, _| counts.next().unwrap_or_default());
    counted.map_err(|error| error.to_string())
}

/// Coefficients of moves: intercepts, numbers of slopes, and the slopes.
type Coefficients<'a> = (&'a [f64], &'a [Option<u32>], &'a [Vec<f64>]);

fn logit(
    states: usize,
    inputs: usize,
    [to, from]: [&[u32]; 2],
    (intercept, group, slopes): Coefficients<'_>,
    ridge: f64,
) -> Result<LogitTransition, TransitionError> {
    for (what, found) in
        [("from", from.len()), ("intercept", intercept.len()), ("group", group.len())]
    {
        if found != to.len() {
            let what = format!("the number of values in `{what}`");
            let expected = "as many as in `to`";
            return Err(Parameter::new(what, found as f64, expected).into());
        }
    }
    if states == 0 {
        return Err(TransitionError::Empty);
    }
    // Column by column: each move comes after the one before, and no state without a move is skipped.
    let mut last = None;
    for (&from, &to) in from.iter().zip(to) {
        let (to, from) = (to as usize, from as usize);
        if to >= states || from >= states {
            return Err(TransitionError::OutOfRange { to, from, states });
        }
        let next = last.map_or(0, |(before, _)| before + 1);
        match last {
            Some(before) if (from, to) == before => {
                return Err(TransitionError::Duplicate { to, from });
            }
            Some(before) if (from, to) < before => {
                let what = format!("the state left by a move from state {from} to state {to}");
                let expected = "moves column by column, in ascending order";
                return Err(Parameter::new(what, from as f64, expected).into());
            }
            _ if from > next => return Err(TransitionError::NoWeight { column: next }),
            _ => last = Some((from, to)),
        }
    }
    let left = last.map_or(0, |(from, _)| from + 1);
    if left < states {
        return Err(TransitionError::NoWeight { column: left });
    }
    let mut used = vec![false; slopes.len()];
    for &group in group.iter().flatten() {
        let used = used.get_mut(group as usize);
        *used.ok_or_else(|| {
            let expected = "the number of one of the rows of `slopes`, from 0";
            Parameter::new("a number of slopes in `group`", f64::from(group), expected)
        })? = true;
    }
    if let Some(unused) = used.iter().position(|used| !used) {
        let expected = "a number in `group`";
        return Err(
            Parameter::new("a row of `slopes` without a move", unused as f64, expected).into()
        );
    }
    if let Some(row) = slopes.iter().find(|row| row.len() != inputs) {
        let expected = "the number of inputs";
        return Err(
            Parameter::new("the number of slopes in a row", row.len() as f64, expected).into()
        );
    }
    let moves = from.iter().zip(to).zip(intercept.iter().zip(group));
    let moves = moves.map(|((&from, &to), (&a, group))| (from, to, a, group.map_or(0, |g| g + 1)));
    LogitTransition::from_parts(states, &moves.collect::<Vec<_>>(), slopes.concat(), inputs, ridge)
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
    durations: &[Durations],
) -> Result<DwellTransition<A>, TransitionError> {
    if let ([_, ..], Some(first)) = (durations, ages.first()) {
        let place = ages.iter().position(|ages| ages.len() != first.len());
        if let Some(place) = place.or((ages.len() != durations.len()).then_some(durations.len())) {
            let what = format!("the number of ages of place {place}");
            let found = ages.get(place).map_or(0, Vec::len);
            return Err(Parameter::new(what, found as f64, "the same in all places").into());
        }
        return DwellTransition::from_durations(moves, durations, first.len());
    }
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
