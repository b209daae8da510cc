//! Formats of motion along a route.

use super::stored;
use crate::error::TransitionError;
use crate::motion::{OdometryModel, OffMap, RouteTransition, Speeds, ViewChangeRates};

stored! {
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
