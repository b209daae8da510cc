//! Changes of the view as evidence on moves: p(view | i, i + m)^ω, which distinguishes only
//! standing and moving on. The larger of the two is taken out, so factors are at most 1.

use wayfix::TransitionError;
use wayfix::error::Parameter;

/// Comparison of a view with the last new one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum ViewChange {
    /// Unlike the last new view: the vehicle, or what it sees, has moved.
    Changed,
    /// Like the last new view.
    Unchanged,
}

/// Change of the view as evidence on a move, with a weight: the likelihood is raised to the power
/// of `weight`, from 0 (no evidence) to 1. Successive views are not independent: a tunnel looks the
/// same for minutes, though the vehicle moves.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct ViewEvidence {
    /// Changed or not.
    pub view: ViewChange,
    /// Weight of the evidence, from 0 to 1.
    pub weight: f64,
}

/// Probabilities of [`ViewChange::Unchanged`] after a step; [`ViewChange::Changed`] has the
/// complement.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct ViewChangeRates {
    /// Probability if the vehicle is at the same place.
    pub standing: f64,
    /// Probability if the vehicle is at another place.
    pub moved: f64,
}

impl Default for ViewChangeRates {
    /// 0.9 and 0.05, for views compared with a threshold that noise rarely reaches: traffic may
    /// pass a vehicle that stands, and a vehicle that moves may pass along a wall.
    fn default() -> Self {
        Self { standing: 0.9, moved: 0.05 }
    }
}

#[cfg(feature = "serde")]
impl super::RouteTransition {
    /// Rates of unchanged views.
    pub(crate) fn views(&self) -> Option<ViewChangeRates> {
        self.views
    }
}

/// Likelihoods of a view for standing and for moving, relative to the larger of the two.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Factors {
    pub(super) standing: f64,
    pub(super) moved: f64,
}

impl Factors {
    pub(super) const NONE: Self = Self { standing: 1.0, moved: 1.0 };

    pub(super) fn of(self, stays: bool) -> f64 {
        if stays { self.standing } else { self.moved }
    }
}

impl ViewChangeRates {
    pub(super) fn check(self) -> Result<(), TransitionError> {
        let Self { standing, moved } = self;
        let named = [("standing", standing), ("elsewhere", moved)];
        for (name, value) in named {
            if !(1e-30..1.0).contains(&value) {
                return Err(Parameter::new(
                    format!("the probability of an unchanged view {name}"),
                    value,
                    "a value of at least 1e-30 and below 1",
                )
                .into());
            }
        }
        Ok(())
    }

    /// Factors of a view, and the log factor taken out.
    pub(super) fn factors(self, evidence: ViewEvidence) -> (Factors, f64) {
        let p = [self.standing, self.moved].map(|unchanged| match evidence.view {
            ViewChange::Changed => 1.0 - unchanged,
            ViewChange::Unchanged => unchanged,
        });
        // Above 0, since `check` keeps rates away from 0 and 1; so no step is ruled out by a view.
        let largest = p.into_iter().fold(0.0, f64::max);
        let [standing, moved] = p.map(|p| (p / largest).powf(evidence.weight));
        (Factors { standing, moved }, evidence.weight * largest.ln())
    }
}

impl ViewEvidence {
    pub(super) fn check(self) -> Result<(), TransitionError> {
        if (0.0..=1.0).contains(&self.weight) {
            return Ok(());
        }
        let text = format!("a view with a weight of {}, expected a value from 0 to 1", self.weight);
        Err(TransitionError::Control(text))
    }
}
