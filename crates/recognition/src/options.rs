//! Options of a recogniser, each with its default and the reason.

use super::RecognitionError;
use crate::motion::{OdometryModel, OffMap, RouteTransition, Speeds, ViewChangeRates};
use crate::observation::MatchOdds;
use wayfix::error::Parameter;

/// Options of a [`Recognizer`](super::Recognizer).
///
/// The defaults were chosen on some recordings, descriptors and drives, and reported on
/// others; the docs' chapter [from descriptors to a
/// position](crate::guide::from_descriptors) has each, with what changes if it is halved or doubled.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
#[non_exhaustive]
pub struct Options {
    /// True if the references form a loop; false by default.
    pub closed: bool,
    /// The speeds of the vehicle, in references a step, how they change, and the noise of a step. From
    /// −2 to 3 by default; [fitting](super::Recognizer::fit) learns all but the grid.
    pub speeds: Speeds,
    /// Model of odometry. Fitting learns it.
    pub odometry: OdometryModel,
    /// Rates of leaving the map, or `None`, by default, if it is never left. Where the
    /// labelled part leaves it, fitting learns the rates.
    pub off_map: Option<OffMap>,
    /// Rates of losing the vehicle and finding it again, where [`off_map`](Self::off_map) is
    /// `None`: a lost vehicle turns up at any place. Answers are conditional on a vehicle that is
    /// not lost. Once in 100,000 steps by default, for ten steps: a place that was ruled out by a
    /// tunnel or a look-alike street then comes back after some twenty good frames.
    pub lost: OffMap,
    /// The odds of being lost at each step, against those of a wrong place, where
    /// [`off_map`](Self::off_map) is `None`. 0.6 by default, the odds that an uninformative frame
    /// gives to the right place on average: so the vehicle is not taken for lost in a tunnel.
    pub lost_odds: f64,
    /// The odds of being off the map at each step, against those of a wrong place, where
    /// [`off_map`](Self::off_map) is given. 0.85 by default: at 1, stretches of uninformative
    /// frames, such as dark ones, are taken for off the map, and at 0.75 detours are found late.
    pub off_map_odds: f64,
    /// Odds of a score. Their temperature, 1.8 by default, is for frames in sequence; fitting
    /// chooses another where labels are in favour of it.
    pub odds: MatchOdds,
    /// True if the usual scores of each reference are learned from the queries, so that
    /// references that look like everything do not win; true by default.
    pub standardize: bool,
    /// Rates of views that do not change; see [`ViewChangeRates`].
    pub views: ViewChangeRates,
    /// True if changes of the view count as evidence of moving or standing; true by default.
    pub use_views: bool,
    /// Rate f at which a run of changed, or of unchanged, views loses weight as evidence of moving or
    /// standing: the k-th counts 1 / (1 + (k − 1) f). 0.1 by default: all of them together grow as
    /// 10 ln k, since traffic may pass a vehicle that stands for minutes, and a wall one that moves.
    pub view_fades: f64,
    /// Least change of a view that counts as a new view, in units of the change from a reference to
    /// the next. 0.1 by default: smaller ones carry no evidence on the place.
    pub view_threshold: f64,
    /// Number of places on either side of an answer that count as the same: the answer is
    /// the middle of the most probable such window. 1 by default.
    pub window: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            closed: false,
            speeds: Speeds::default(),
            odometry: OdometryModel::default(),
            off_map: None,
            lost: OffMap { leave: 1e-5, back: 0.1, near: 0.0, within: 0 },
            lost_odds: 0.6,
            off_map_odds: 0.85,
            odds: MatchOdds::default(),
            standardize: true,
            views: ViewChangeRates::default(),
            use_views: true,
            view_fades: 0.1,
            view_threshold: 0.1,
            window: 1,
        }
    }
}

/// Largest share of time for which a vehicle may be lost: answers are of the rest.
const MOST_LOST: f64 = 0.99;

impl Options {
    pub(super) fn check(&self) -> Result<(), RecognitionError> {
        Parameter::check("view_fades", self.view_fades, 0.0..=1e6, "from 0 to 1e6")?;
        Parameter::check("lost_odds", self.lost_odds, 1e-6..=1.0, "from 1e-6 to 1")?;
        Parameter::check("off_map_odds", self.off_map_odds, 1e-6..=1.0, "from 1e-6 to 1")?;
        let (threshold, expected) = (self.view_threshold, "a finite value of at least 0");
        Parameter::check("view_threshold", threshold, 0.0..=f64::MAX, expected)?;
        let lost = self.lost.share();
        if self.off_map.is_none() && lost > MOST_LOST {
            let (what, expected) = ("the share of time for which it is lost", "at most 0.99");
            return Err(Parameter::new(what, lost, expected).into());
        }
        Ok(())
    }

    /// Motion along so many places.
    pub(super) fn motion(&self, places: usize) -> Result<RouteTransition, RecognitionError> {
        let motion = RouteTransition::new(places, self.closed, self.speeds.clone())?
            .with_odometry(self.odometry)?
            .with_views(self.views)?
            .with_off_map(self.off_map.unwrap_or(self.lost))?;
        Ok(motion)
    }
}
