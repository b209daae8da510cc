//! Formats of a recogniser's fit and of the state of a track.

use super::stored;
use crate::inference::FilterSnapshot;
use crate::motion::{Driven, ViewChange};
use crate::observation::Standardizer;
use crate::recognition::{Options, Sensor, Tally, TrackSnapshot};

/// Names by which types are stored that have another one now.
pub(crate) mod names {
    pub(crate) use crate::recognition::Parameters as Fit;
}

stored! {
    [] Confusion in observation: [], |confusion| {
        places: usize = confusion.places(),
        place: Vec<u32> = confusion.entries_of(|place, _, _| place as u32),
        seen_as: Vec<u32> = confusion.entries_of(|_, seen_as, _| seen_as as u32),
        probability: Vec<f64> = confusion.entries_of(|_, _, p| p),
    } => Self::from_lists(places, &place, &seen_as, &probability);

    [] MatchOdds in observation: [], |odds| {
        slope: f64 = odds.slope,
        even: f64 = odds.even,
        nothing: f64 = odds.nothing,
        temperature: f64 = odds.temperature,
    } => Self { slope, even, nothing, temperature }.checked();

    [] Standardizer in observation: [], |known| {
        count: f64 = known.count,
        sums: Vec<f64> = known.sums,
        squares: Vec<f64> = known.squares,
        steps: Vec<f64> = known.steps,
    } => Self { count, sums, squares, steps }.checked();

    [] Fit in persistence::recognition::names: [], |fit| {
        options: Options = fit.options,
        standardizer: Option<Standardizer> = fit.standardizer,
        best_scores: Option<[f64; 2]> = fit.best_scores,
    } => Self::from_parts(options, standardizer, best_scores);

    [] TrackSnapshot in recognition: [], |state| {
        filter: FilterSnapshot = state.filter,
        standardizer: Standardizer = state.sensor.standardizer,
        last_view: Option<Vec<Option<f32>>> =
            state.sensor.last_view.as_ref().map(|row| row.iter().map(finite).collect::<Vec<_>>()),
        run: Option<(Option<ViewChange>, u32)> = state.sensor.run,
        still: f64 = state.sensor.still,
        lingering: f64 = state.sensor.lingering,
        driven: Option<Driven> = state.sensor.driven,
        tally: Tally = state.sensor.tally,
    } => track_state(filter, standardizer, last_view, run, [still, lingering], driven, tally);
}

/// A finite score, or `None`, since JSON has no infinity.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "an iterator gives it so")]
fn finite(distance: &f32) -> Option<f32> {
    Some(*distance).filter(|distance| distance.is_finite())
}

fn track_state(
    filter: FilterSnapshot,
    standardizer: Standardizer,
    last_view: Option<Vec<Option<f32>>>,
    run: Option<(Option<ViewChange>, u32)>,
    [still, lingering]: [f64; 2],
    driven: Option<Driven>,
    tally: Tally,
) -> Result<TrackSnapshot, String> {
    if !(0.0..=2.0).contains(&still) {
        return Err(format!("an unchanged view by up to {still}, expected from 0 to 2"));
    }
    if !(0.0..=1.0).contains(&lingering) {
        return Err(format!("a share of lingering views of {lingering}, expected from 0 to 1"));
    }
    if run.is_some_and(|(_, count)| count == 0) {
        return Err("a run of 0 views, expected at least 1".into());
    }
    let distance = |distance: Option<f32>| distance.unwrap_or(f32::INFINITY);
    let last_view: Option<Vec<f32>> = last_view.map(|row| row.into_iter().map(distance).collect());
    for value in last_view.iter().flatten() {
        if value.is_nan() || *value == f32::NEG_INFINITY {
            return Err(format!("a score of {value} in the last view, expected a number or null"));
        }
    }
    Ok(TrackSnapshot {
        filter,
        sensor: Sensor {
            standardizer,
            last_view,
            run,
            still,
            lingering,
            driven,
            tally: tally.checked()?,
        },
    })
}
