//! Formats of moving vehicles.

use super::stored;
use super::transition::check_one;
use crate::error::{Parameter, TransitionError};
use crate::motion::{
    DistanceTransition, OdometryModel, OffMap, OffMapTransition, RouteTransition, Speeds,
    ViewChangeRates,
};
use crate::transition::{SparseTransition, Transition, check_probability};

stored! {
    [A: Transition] OffMapTransition<A> in motion: [A], |a| {
        inner: A = a.inner,
        leave: f64 = a.leave,
        stay: f64 = a.stay,
        back: Vec<f64> = a.back,
        evidence: Option<f64> = a.evidence.given(),
    } => off_map(inner, leave, stay, back).and_then(|a| a.with_optional_evidence(evidence));

    [] DistanceTransition in motion: [], |a| {
        base: SparseTransition = a.base,
        lengths: Vec<f64> = a.ways.iter().map(|way| way.length).collect::<Vec<_>>(),
    } => distances(base, &lengths);

    [] Speeds in motion: [], |speeds| {
        values: Vec<f64> = speeds.values(),
        shares: Vec<f64> = speeds.shares(),
        nearby: f64 = speeds.changes().0,
        anywhere: f64 = speeds.changes().1,
        slack: f64 = speeds.slack(),
    } => Self::new(&values)
        .and_then(|speeds| speeds.with_shares(&shares))
        .and_then(|speeds| speeds.with_changes(nearby, anywhere))
        .and_then(|speeds| speeds.with_slack(slack));

    [] RouteTransition in motion: [], |route| {
        places: usize = route.places(),
        closed: bool = route.is_closed(),
        speeds: Speeds = route.speeds(),
        odometry: OdometryModel = route.odometry(),
        views: Option<ViewChangeRates> = route.views(),
        off_map: Option<OffMap> = route.off_map(),
    } => Self::new(places, closed, speeds)
        .and_then(|route| route.with_odometry(odometry))
        .and_then(|route| optional(route, views, crate::motion::RouteTransition::with_views))
        .and_then(|route| optional(route, off_map, crate::motion::RouteTransition::with_off_map));
}

/// Adds an optional part to a route.
fn optional<T>(
    route: RouteTransition,
    part: Option<T>,
    with: impl FnOnce(RouteTransition, T) -> Result<RouteTransition, TransitionError>,
) -> Result<RouteTransition, TransitionError> {
    match part {
        Some(part) => with(route, part),
        None => Ok(route),
    }
}

fn off_map<A: Transition>(
    inner: A,
    leave: f64,
    stay: f64,
    back: Vec<f64>,
) -> Result<OffMapTransition<A>, TransitionError> {
    check_probability(leave, || "the rate of leaving".to_owned())?;
    check_probability(stay, || "the probability of no return".to_owned())?;
    for (state, &p) in back.iter().enumerate() {
        check_probability(p, || format!("the probability of a return to state {state}"))?;
    }
    let sum = stay + back.iter().sum::<f64>();
    check_one(sum, || "the probability of a return or none".to_owned())?;
    OffMapTransition::from_parts(inner, leave, stay, back)
}

fn distances(
    base: SparseTransition,
    lengths: &[f64],
) -> Result<DistanceTransition, TransitionError> {
    let (found, expected) = (lengths.len(), base.entries());
    if found != expected {
        let what = "the number of lengths".to_owned();
        let expected = "one for each entry of the base";
        return Err(Parameter::new(what, found as f64, expected).into());
    }
    let mut lengths = lengths.iter().copied();
    DistanceTransition::build(base, |_, _| Ok(lengths.next().unwrap_or(f64::NAN)))
}
