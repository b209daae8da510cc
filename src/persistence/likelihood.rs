//! Sensors.

use std::collections::TryReserveError;
use std::convert::Infallible;
use std::marker::PhantomData;

use super::stored;
use crate::groups::Groups;
use crate::likelihood::{Likelihood, OptionalLikelihood};
use crate::observation::Spread;

stored! {
    [] TableLikelihood: [], |table| {
        rows: Vec<Vec<f64>> = {
            let states = table.states();
            let row = |state| table.columns[state..].iter().step_by(states).copied().collect();
            (0..states).map(row).collect::<Vec<Vec<_>>>()
        },
    } => Self::from_rows(&rows);

    [Y: AsRef<[f64]> + ?Sized] LikelihoodVector<Y>: [], |vector| {
        states: usize = vector.states,
        log: bool = vector.log,
    } => Ok::<_, Infallible>(Self { states, log, observation: PhantomData });

    [] AppearanceLikelihood in observation: [], |camera| {
        references: usize = camera.references(),
        spread: Spread = camera.spread(),
        offsets: Vec<f64> = camera.offsets().to_vec(),
        temperature: f64 = camera.temperature(),
        off_map_rank: Option<f64> = camera.off_map_rank(),
    } => Self::from_parts(references, spread, offsets, temperature, off_map_rank);

    [] SparseLikelihood: [], |sparse| {
        states: usize = sparse.states,
    } => Ok::<_, Infallible>(Self::new(states));

    [B: Likelihood<Observation: Sized>] OptionalLikelihood<B>: [B], |optional| {
        sensor: B = optional.sensor,
    } => optional(sensor);

    [B1: Likelihood<Observation: Sized>, B2: Likelihood<Observation: Sized>] FusedLikelihood<B1, B2>: [B1, B2], |fused| {
        first: B1 = fused.first,
        second: B2 = fused.second,
    } => Self::new(first, second);

    [B: Likelihood] GroupedLikelihood<B>: [B], |grouped| {
        sensor: B = grouped.sensor,
        groups: Groups = grouped.groups(),
    } => Self::new(sensor, groups);

    [B: Likelihood] PooledLikelihood<B>: [B], |pooled| {
        sensor: B = pooled.sensor,
        groups: Groups = pooled.groups(),
    } => Self::new(sensor, groups);
}

/// As the constructor, but a number of states that is beyond all memory is an
/// error.
fn optional<B: Likelihood>(sensor: B) -> Result<OptionalLikelihood<B>, TryReserveError> {
    let mut ones = Vec::new();
    ones.try_reserve_exact(sensor.states())?;
    ones.resize(sensor.states(), 1.0);
    Ok(OptionalLikelihood { sensor, ones })
}
