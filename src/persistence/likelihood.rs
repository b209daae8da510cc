//! Formats of sensors.

use std::collections::TryReserveError;
use std::convert::Infallible;
use std::marker::PhantomData;

use super::stored;
use crate::groups::Groups;
use crate::likelihood::{Likelihood, OptionalLikelihood};

stored! {
    [] TableLikelihood: [], |table| {
        rows: Vec<Vec<f64>> = table.to_rows(),
    } => Self::from_rows(&rows);

    [Y: AsRef<[f64]> + ?Sized] LikelihoodVector<Y>: [], |vector| {
        states: usize = vector.states,
        log: bool = vector.log,
    } => Ok::<_, Infallible>(Self { states, log, observation: PhantomData });

    [] SparseLikelihood: [], |sparse| {
        states: usize = sparse.states,
    } => Ok::<_, Infallible>(Self::new(states));

    [] SparseTableLikelihood in likelihood: [], |table| {
        states: usize = table.states,
        symbols: Vec<(Vec<(usize, f64)>, f64)> = table.to_lists(),
    } => Self::from_lists(states, &symbols);

    [B: Likelihood<Observation: Sized>] OptionalLikelihood<B>: [B], |optional| {
        sensor: B = optional.sensor,
    } => optional(sensor);

    [B1: Likelihood<Observation: Sized>, B2: Likelihood<Observation: Sized>] FusedLikelihood<B1, B2>: [B1, B2], |fused| {
        first: B1 = fused.first,
        second: B2 = fused.second,
    } => Self::new(first, second);

    [B: Likelihood] GroupedLikelihood<B> in likelihood: [B], |grouped| {
        sensor: B = grouped.sensor,
        groups: Groups = grouped.groups(),
    } => Self::new(sensor, groups);

    [B: Likelihood] PooledLikelihood<B> in likelihood: [B], |pooled| {
        sensor: B = pooled.sensor,
        groups: Groups = pooled.groups(),
    } => Self::new(sensor, groups);
}

/// As [`OptionalLikelihood::new`], but with an error if there is no memory for so many states.
fn optional<B: Likelihood>(sensor: B) -> Result<OptionalLikelihood<B>, TryReserveError> {
    let mut ones = Vec::new();
    ones.try_reserve_exact(sensor.states())?;
    ones.resize(sensor.states(), 1.0);
    Ok(OptionalLikelihood { sensor, ones })
}
