//! A vehicle with gears along a route, driven by what is known of each step.

mod entries;
mod gear;
mod geometry;
mod products;
mod step;
mod tables;
mod views;

pub use gear::Gear;
use views::Views;
pub use views::{View, ViewRates};

use super::odometry::Odometry;
use super::{check_count, check_probability, check_sum};
use crate::error::TransitionError;
use crate::groups::Groups;

/// What is known of a step of a [`RouteTransition`] before its observation:
/// by default nothing.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct RouteControl {
    /// How far the vehicle has driven.
    pub odometry: Option<Odometry>,
    /// Whether the camera sees what it saw before; of use only
    /// [with views](RouteTransition::with_views).
    pub view: Option<View>,
}

/// A vehicle that drives along the places of a route, which are reference
/// images in order, in one of several hidden [gears](Gear); its control is what
/// odometry and camera say of a step.
///
/// State g n + i is the gear g at place i, of n places. In a step, the gear
/// changes to g' with probability G\[g', g\], and the place by a move m, drawn
/// from the weights w of the **new** gear. Moves are weighted by what the
/// control u says of them:
///
/// A_u\[(g', i + m), (g, i)\] = G\[g', g\] w_g'(m) o_u(m) e_u(i, i + m) / Z_g(i),
///
/// where Z_g(i), the sum of the numerators over g' and m, makes the column sum
/// to one. On a closed route, a loop, the first place follows the last. On an
/// open one, what would go beyond an end stops there; e is then of the place
/// where it stops, and o of the whole move.
///
/// - o is p(m | [odometry](Odometry)), or 1 without one. If the numerators
///   G w o of all moves from a gear are below 1e-250, as where the odometry
///   says what no gear does, the moves nearest to the distance take all of
///   them: o is 1 for these, and 0 for others.
/// - e is the probability of the [view](View), by [`ViewRates`]; or 1 if it is
///   not given, or the route is without views.
///
/// Where G w o of some moves is below 1e-290, but above 1e-250 of others, what
/// is left of it may have lost digits.
///
/// Products and steps of Viterbi cost O(n k (k + w)) for k gears with windows of
/// w weights, in contiguous loops; a step with odometry and a view costs twice as
/// much, since Z is to be worked out. Memory is O(k (k + w)), with views O(n k).
/// To list what leads out of a state costs O(k (k + w)), and into a state O(k w),
/// or w k times as much in a step with odometry and a view; more where many
/// places lead to an end of an open route.
///
/// ```
/// use wayfix::{Belief, Gear, GroupedLikelihood, Hmm, KnownState, Odometry, Prior};
/// use wayfix::{RouteControl, RouteTransition, Transition};
///
/// // Stand, or go on by about one image a step, along 50 of them.
/// let gears = vec![Gear::speed(0.0, 0.0)?, Gear::speed(1.0, 0.1)?];
/// let drive = RouteTransition::new(50, false, gears, 0.9)?;
/// let start = drive.index(1, 10).expect("there is such a place");
/// let prior = Prior::BeforeFirstTransition(Belief::certain(drive.states(), start)?);
/// let sensor = GroupedLikelihood::new(KnownState::new(50), drive.place_groups())?;
/// let hmm = Hmm::new(prior, drive, sensor)?;
///
/// let odometry = Some(Odometry { distance: 1.8, variance: 0.01 });
/// let mut filter = hmm.filter();
/// filter.predict_with(&RouteControl { odometry, view: None })?;
/// let places = hmm.transition().place_groups().marginal(&filter.belief())?;
/// assert_eq!(places.mode(), 11); // of gears that go on by 2 there is little
/// assert!(places.as_slice()[12] > 0.3 && places.as_slice()[10] < 0.01);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct RouteTransition {
    pub(crate) places: usize,
    pub(crate) closed: bool,
    pub(crate) gears: Vec<Gear>,
    /// Where the weights of each gear start among those of all, and their number.
    starts: Vec<usize>,
    /// G, row by row: `switching[to * k + from]`.
    pub(crate) switching: Vec<f64>,
    pub(crate) views: Option<Views>,
}

impl RouteTransition {
    /// A vehicle on `places` places, of a `closed` route or an open one, with
    /// these gears. It keeps its gear in a step with probability `keep`, and
    /// changes to each other one with an equal share of the rest; with one
    /// gear, it keeps it.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Empty`] for no places or no gears,
    /// [`TransitionError::TooMany`] for more than 2^32 − 1 states, or
    /// [`TransitionError::Parameter`] unless `keep` is from 0 to 1, or for a
    /// gear with more weights than a closed route has places.
    pub fn new(
        places: usize,
        closed: bool,
        gears: Vec<Gear>,
        keep: f64,
    ) -> Result<Self, TransitionError> {
        let k = gears.len();
        let states = places.saturating_mul(k);
        if states == 0 {
            return Err(TransitionError::Empty);
        }
        check_count("states", states)?;
        check_probability(keep, || "the probability of keeping the gear".to_owned())?;
        let mut starts = vec![0];
        for (g, gear) in gears.iter().enumerate() {
            let count = gear.weights().len();
            if closed && count > places {
                return Err(TransitionError::Parameter {
                    what: format!("the number of weights of gear {g}"),
                    value: count as f64,
                    expected: "at most the number of places of a closed route",
                });
            }
            starts.push(starts[g] + count);
        }
        let change = (1.0 - keep) / (k.max(2) - 1) as f64;
        let switching = (0..k * k).map(|at| match (k, at % (k + 1)) {
            (1, _) => 1.0,
            (_, 0) => keep,
            _ => change,
        });
        let switching = switching.collect();
        Ok(Self { places, closed, gears, starts, switching, views: None })
    }

    /// With other probabilities of changing gears: `rows` is G row by row, where
    /// G\[g', g\] = p(g' | g), so that **columns** sum to one.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Parameter`] unless there are as many as gears squared,
    /// all at least 0 and finite, of which each column sums to one within 1e-9.
    pub fn with_switching(mut self, rows: &[f64]) -> Result<Self, TransitionError> {
        let k = self.gears();
        if rows.len() != k * k {
            return Err(TransitionError::Parameter {
                what: "the number of switching probabilities".into(),
                value: rows.len() as f64,
                expected: "the number of gears squared",
            });
        }
        for from in 0..k {
            let column: Vec<f64> = (0..k).map(|to| rows[to * k + from]).collect();
            check_sum(&column, format!("the sum of the ways out of gear {from}"), |to| {
                format!("the probability of a change from gear {from} to gear {to}")
            })?;
        }
        self.switching = rows.to_vec();
        self.look();
        Ok(self)
    }

    /// With what the camera may say of a step: whether its view has changed.
    ///
    /// `stretches` has a number for each place; places with the same number
    /// look alike.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Parameter`] unless there is a stretch for each place,
    /// and each rate is at least 1e-30 and below 1: with a rate of 0 or 1, there
    /// might be no way out of a state.
    pub fn with_views(
        mut self,
        stretches: &[usize],
        rates: ViewRates,
    ) -> Result<Self, TransitionError> {
        if stretches.len() != self.places {
            return Err(TransitionError::Parameter {
                what: "the number of stretches".into(),
                value: stretches.len() as f64,
                expected: "one for each place",
            });
        }
        self.views = Some(Views::new(stretches, rates)?);
        self.look();
        Ok(self)
    }

    /// The number of places, n.
    #[must_use]
    pub fn places(&self) -> usize {
        self.places
    }

    /// The number of gears, k.
    #[must_use]
    pub fn gears(&self) -> usize {
        self.gears.len()
    }

    /// The state that is this gear at this place, or `None` if there is none.
    #[must_use]
    pub fn index(&self, gear: usize, place: usize) -> Option<usize> {
        (gear < self.gears() && place < self.places).then(|| gear * self.places + place)
    }

    /// The gear and the place that a state is, or `None` if there is no such
    /// state.
    #[must_use]
    pub fn parts(&self, state: usize) -> Option<(usize, usize)> {
        (state < self.count()).then(|| (state / self.places, state % self.places))
    }

    /// The states grouped by place: for a sensor that sees only places, and for
    /// their probabilities.
    #[must_use]
    pub fn place_groups(&self) -> Groups {
        let places = (0..self.count()).map(|state| state % self.places);
        Groups::numbered(places.collect(), self.places)
    }

    /// The states grouped by gear.
    #[must_use]
    pub fn gear_groups(&self) -> Groups {
        let gears = (0..self.count()).map(|state| state / self.places);
        Groups::numbered(gears.collect(), self.gears())
    }

    fn count(&self) -> usize {
        self.places * self.gears()
    }
}
