//! Options of a recogniser, each with its default and the reason.

use super::RecognitionError;
use crate::motion::{OdometryModel, OffMap, RouteTransition, Speeds, ViewChangeRates};
use crate::observation::MatchOdds;
use wayfix::error::OutOfRange;
use wayfix::transition::DistractionRates;

/// Declares the options, each with its default, a method that returns it and one that sets it.
macro_rules! options {
    ($($(#[$doc:meta])+ $([$reference:tt])? $name:ident: $type:ty = $default:expr, $with:ident;)+) => {
        /// Options of a [`Recognizer`](super::Recognizer).
        ///
        /// The chapter [from descriptors to a position](crate::guide::from_descriptors) has the effect of
        /// leaving parts out and of changing rates.
        ///
        /// ```
        /// use wayfix_recognition::Options;
        /// use wayfix_recognition::motion::OffMap;
        ///
        /// let options = Options::default().with_closed(true).with_off_map(Some(OffMap::default()));
        /// assert!(options.closed() && options.window() == 1);
        /// ```
        #[derive(Debug, Clone, PartialEq)]
        #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
        #[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
        pub struct Options {
            $(pub(crate) $name: $type,)+
        }

        impl Default for Options {
            fn default() -> Self {
                Self { $($name: $default,)+ }
            }
        }

        impl Options {
            $(
                $(#[$doc])+
                #[must_use]
                pub fn $name(&self) -> $($reference)? $type {
                    $($reference)? self.$name
                }

                #[doc = concat!("Sets [`", stringify!($name), "`](Self::", stringify!($name), ").")]
                #[must_use]
                pub fn $with(self, $name: $type) -> Self {
                    Self { $name, ..self }
                }
            )+
        }
    };
}

options! {
    /// True if the references form a loop; false by default.
    closed: bool = false, with_closed;
    /// Speeds of the vehicle, in references a step, how they change, and the noise of a step. From
    /// −2 to 3 by default; [fitting](super::Recognizer::fit) learns all but the grid.
    [&] speeds: Speeds = Speeds::default(), with_speeds;
    /// Model of odometry. Fitting learns it.
    odometry: OdometryModel = OdometryModel::default(), with_odometry;
    /// Rates of leaving the map, or `None`, the default, if it is never left. If the labelled part
    /// leaves it, fitting learns the rates.
    off_map: Option<OffMap> = None, with_off_map;
    /// Rates of losing the vehicle and finding it again, used if [`off_map`](Self::off_map) is
    /// `None`: a lost vehicle may be at any place, and turns up at any. By default it is lost once in
    /// 10,000 steps, for some thirty steps.
    lost: OffMap = OffMap { leave: 1e-4, back: 0.03, near: 0.0, within: 0 }, with_lost;
    /// Rates at which the camera begins to follow another place than the vehicle's, or to say
    /// nothing, and stops. By default it does so once in 333 steps, for twenty steps: snow, a
    /// tunnel or a street like another one is one error, not as many as it has frames.
    distractions: DistractionRates = DistractionRates { begin: 0.003, end: 0.05 }, with_distractions;
    /// Odds of a score before the first view, which count as ten views: the shares of views that
    /// match clearly, weakly or not at all are learned from the drive.
    odds: MatchOdds = MatchOdds::default(), with_odds;
    /// True if the usual scores of each reference are learned from the queries, so that
    /// references that look like everything do not win; true by default.
    standardize: bool = true, with_standardize;
    /// Rates of views that do not change; see [`ViewChangeRates`].
    views: ViewChangeRates = ViewChangeRates::default(), with_views;
    /// True if changes of the view count as evidence of moving or standing; true by default.
    use_views: bool = true, with_use_views;
    /// Rate f at which a run of changed, or of unchanged, views loses weight as evidence of moving or
    /// standing: the k-th counts 1 / (1 + (k − 1) f). 0.1 by default: their sum grows as 10 ln k,
    /// since traffic may pass a standing vehicle for minutes, and a moving one may pass a long wall.
    view_fades: f64 = 0.1, with_view_fades;
    /// Smallest change with which a view counts as new, in units of the change from reference to
    /// reference. 0.05 by default: smaller changes carry no evidence on the place.
    view_threshold: f64 = 0.05, with_view_threshold;
    /// Number of places on either side of an answer that count as the same place: the answer is the
    /// middle of the most probable such window. 1 by default.
    window: usize = 1, with_window;
}

impl Options {
    pub(super) fn check(&self) -> Result<(), RecognitionError> {
        OutOfRange::check("view_fades", self.view_fades, 0.0..=1e6, "from 0 to 1e6")?;
        let (threshold, expected) = (self.view_threshold, "a finite value of at least 0");
        OutOfRange::check("view_threshold", threshold, 0.0..=f64::MAX, expected)?;
        Ok(())
    }

    /// Motion along a route of this many places, which is never left.
    pub(super) fn motion(
        &self,
        places: usize,
        speeds: Speeds,
    ) -> Result<RouteTransition, RecognitionError> {
        let route = if self.closed { RouteTransition::closed } else { RouteTransition::open };
        Ok(route(places, speeds)?.with_odometry(self.odometry)?.with_views(self.views)?)
    }
}
