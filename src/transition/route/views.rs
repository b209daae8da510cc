//! Whether the camera sees what it saw a step before.

use std::collections::HashMap;

use super::RouteTransition;
use crate::error::TransitionError;

/// How a frame looks beside the one before.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum View {
    /// Unlike the last new view: the vehicle, or what it sees, has moved.
    Changed,
    /// Like the last new view.
    Unchanged,
}

/// The probabilities of a [`View::Unchanged`] after a step; that of a
/// [`View::Changed`] is the rest to one. A *stretch* is a run of references that
/// look alike ([`alike_stretches`](crate::observation::alike_stretches)). Where
/// nothing is known, 0.95, 0.8 and 0.02 will do.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct ViewRates {
    /// If the vehicle is where it was.
    pub standing: f64,
    /// If it is at another place of the same stretch.
    pub alike: f64,
    /// If it is elsewhere.
    pub moved: f64,
}

/// Probabilities of a view: of standing, of another place of the stretch, and
/// of other places.
pub(super) type Factors = [f64; 3];

/// What a route needs to know of views.
#[derive(Debug, Clone)]
pub(crate) struct Views {
    /// What it was made with, to be made of again.
    #[cfg(feature = "serde")]
    pub(crate) source: (Vec<usize>, ViewRates),
    /// The stretch of each place, numbered in the order of the route. As
    /// doubles, since SSE2 compares these as wide as it multiplies them.
    pub(super) stretches: Vec<f64>,
    /// By view: e, scaled so that the least is 1, which Z may then not be below;
    pub(super) factors: [Factors; 2],
    /// and 1 / Z for steps without odometry.
    pub(super) inverse: [Vec<f64>; 2],
}

impl Views {
    pub(super) fn new(stretches: &[usize], rates: ViewRates) -> Result<Self, TransitionError> {
        let ViewRates { standing, alike, moved } = rates;
        let named = [("standing", standing), ("in a stretch", alike), ("elsewhere", moved)];
        for (name, value) in named {
            if !(1e-30..1.0).contains(&value) {
                return Err(TransitionError::Parameter {
                    what: format!("the probability of an unchanged view {name}"),
                    value,
                    expected: "a value of at least 1e-30 and below 1",
                });
            }
        }
        let mut numbers = HashMap::new();
        let number = |stretch: &usize| {
            let next = numbers.len() as f64;
            *numbers.entry(*stretch).or_insert(next)
        };
        let numbered = stretches.iter().map(number).collect();
        let unchanged = [standing, alike, moved];
        let factors = [unchanged.map(|p| 1.0 - p), unchanged].map(|e| {
            let least = e.into_iter().fold(1.0, f64::min);
            e.map(|p| p / least)
        });
        Ok(Self {
            #[cfg(feature = "serde")]
            source: (stretches.to_vec(), rates),
            stretches: numbered,
            factors,
            inverse: [Vec::new(), Vec::new()],
        })
    }
}

impl View {
    pub(super) fn index(self) -> usize {
        match self {
            Self::Changed => 0,
            Self::Unchanged => 1,
        }
    }
}

impl RouteTransition {
    /// Works out 1 / Z of each view without odometry. O(n k (k + w)).
    pub(super) fn look(&mut self) {
        let inverse = [View::Changed, View::Unchanged].map(|view| {
            let Some(views) = &self.views else { return Vec::new() };
            let factors = views.factors[view.index()];
            let mut inverse = vec![0.0; self.count()];
            self.with_tables(None, false, &mut |tables| tables.invert(factors, &mut inverse));
            inverse
        });
        if let Some(views) = &mut self.views {
            views.inverse = inverse;
        }
    }
}
