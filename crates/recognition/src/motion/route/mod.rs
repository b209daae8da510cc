//! A vehicle at hidden speeds along a route, with measurements as evidence on moves: the operator
//! A_u of `guide::formulas`, Route. Its columns are not normalised.

mod products;
mod shape;
mod step;

use self::shape::{Direction, RouteShape, Stencil};
use super::speeds::{OdometryModel, Speeds, Window};
use wayfix::Belief;
use wayfix::TransitionError;
use wayfix::error::OutOfRange;
use wayfix::likelihood::Groups;
use wayfix::transition::kit::{check_count, check_probability};

/// Evidence on a step of a [`RouteTransition`]; none by default.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct RouteControl {
    /// Distance driven by odometry, in places; `None` without a reading.
    pub odometry: Option<f64>,
    /// Change of the view; ignored without [views](RouteTransition::with_views).
    pub view: Option<ViewEvidence>,
    /// Motion before the step, which predicts readings off the map.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub before: Option<Driven>,
}

/// Motion of a vehicle up to a step, known from the measurements alone.
///
/// Speeds last: on the map the speed is part of the state, and a reading like the ones before comes
/// as expected. States off the map have no speed, so this predicts the readings there; without it
/// each step would count as a speed drawn anew, which is evidence against being off the map.
/// Updated step by step by [`RouteTransition::driven`].
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct Driven {
    /// Probability that the vehicle stood.
    pub standing: f64,
    /// Mean odometry reading since the vehicle set off or changed its speed, and the number of
    /// readings; `None` if there were none.
    pub odometry: Option<(f64, u32)>,
}

impl Driven {
    pub(crate) fn check(&self) -> Result<(), TransitionError> {
        if !(0.0..=1.0).contains(&self.standing) {
            let text = format!("a probability of having stood of {}", self.standing);
            return Err(TransitionError::Control(text));
        }
        match self.odometry {
            Some((_, 0)) => {
                let text = "a mean over 0 odometry readings, expected at least 1".into();
                Err(TransitionError::Control(text))
            }
            Some((mean, _)) => OdometryModel::check_reading(mean),
            None => Ok(()),
        }
    }
}

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

/// Likelihoods of a view for standing and for moving, relative to the larger of the two.
#[derive(Debug, Clone, Copy, PartialEq)]
struct ViewFactors {
    standing: f64,
    moved: f64,
}

impl ViewFactors {
    const NONE: Self = Self { standing: 1.0, moved: 1.0 };

    fn of(self, stays: bool) -> f64 {
        if stays { self.standing } else { self.moved }
    }
}

impl ViewChangeRates {
    fn check(self) -> Result<(), TransitionError> {
        let Self { standing, moved } = self;
        let named = [("standing", standing), ("elsewhere", moved)];
        for (name, value) in named {
            if !(1e-30..1.0).contains(&value) {
                return Err(OutOfRange::new(
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
    fn factors(self, evidence: ViewEvidence) -> (ViewFactors, f64) {
        let p = [self.standing, self.moved].map(|unchanged| match evidence.view {
            ViewChange::Changed => 1.0 - unchanged,
            ViewChange::Unchanged => unchanged,
        });
        // Above 0, since `check` keeps rates away from 0 and 1; so no step is ruled out by a view.
        let largest = p.into_iter().fold(0.0, f64::max);
        let [standing, moved] = p.map(|p| (p / largest).powf(evidence.weight));
        (ViewFactors { standing, moved }, evidence.weight * largest.ln())
    }
}

impl ViewEvidence {
    fn check(self) -> Result<(), TransitionError> {
        if (0.0..=1.0).contains(&self.weight) {
            return Ok(());
        }
        let text = format!("a view with a weight of {}, expected a value from 0 to 1", self.weight);
        Err(TransitionError::Control(text))
    }
}

/// Rates of leaving a route and coming back.
///
/// States off the map remember where the vehicle left, since a detour often ends near there. In a
/// step the vehicle leaves with probability `leave`; once off, it comes back with probability
/// `back`: with probability `near` to a place within `within` of where it left, else to any place,
/// at a speed by its share.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct OffMap {
    /// Probability of leaving the map in a step.
    pub leave: f64,
    /// Probability of coming back in a step.
    pub back: f64,
    /// Probability of coming back near where the vehicle left.
    pub near: f64,
    /// Number of places on either side that count as near.
    pub within: usize,
}

impl Default for OffMap {
    /// The vehicle leaves every 1,000 steps, for 33 steps, and comes back within ten places seven
    /// times out of ten.
    fn default() -> Self {
        Self { leave: 0.001, back: 0.03, near: 0.7, within: 10 }
    }
}

/// Smallest rate: 0 would rule out possible moves, and below this value products underflow.
const LEAST_RATE: f64 = 1e-30;

impl OffMap {
    /// Share of the time that a vehicle is off the map.
    #[must_use]
    pub fn share(&self) -> f64 {
        // Stationary probability of "off" in the chain between on and off.
        self.leave / (self.leave + self.back)
    }

    fn check(&self) -> Result<(), TransitionError> {
        check_probability(self.near, || "the probability of coming back near".into())?;
        for (what, value) in [("leaving the map", self.leave), ("coming back", self.back)] {
            if !(LEAST_RATE..=1.0).contains(&value) {
                let what = format!("the probability of {what}");
                return Err(OutOfRange::new(what, value, "from 1e-30 to 1").into());
            }
        }
        Ok(())
    }
}

/// A vehicle that drives along the places of a route, reference images in order, at one of several
/// hidden [speeds](Speeds), with odometry and changes of the view as
/// [evidence on moves](wayfix::Transition::evidence).
///
/// State g n + i is the speed g at place i, of n places; [off the map](Self::with_off_map), there
/// are n more states, one for each place where the vehicle may have left. In a step, the speed
/// changes to g' with probability G\[g', g\], and the place by a move m, with the weights w of the
/// **new** speed. The likelihood of the measurements u multiplies this:
///
/// A_u\[(g', i + m), (g, i)\] = G\[g', g\] Σ_v w_g'(m, v) p(odometry | v) p(view | i, i + m),
///
/// where v goes through the speeds that g' stands for. The columns are not normalised: a
/// measurement that contradicts all moves from a place is evidence against the place. On a closed
/// route, a loop, the first place follows the last. On an open one, moves beyond an end stop there;
/// the view is then as likely as in the less likely case of standing and moving on.
///
/// Products cost O(n k w), and steps of Viterbi O(n k (k + w)), for k speeds with windows of w
/// weights, in contiguous loops; steps of Viterbi cost n r more for r places near where the vehicle
/// left. Memory is O(k (k + w)). Listing the entries into or out of a state costs O(k w); to or
/// from off the map O(n k).
///
/// ```
/// use wayfix_recognition::motion::{RouteControl, RouteTransition, Speeds};
/// use wayfix::likelihood::GroupedLikelihood;
/// use wayfix::{Belief, Hmm, LikelihoodVector, Prior};
///
/// // 50 images of a route; the vehicle starts at the tenth.
/// let drive = RouteTransition::open(50, Speeds::default())?;
/// let speed = drive.speeds().nearest(2.0);
/// let start = drive.index(speed, 10).expect("there is such a place");
/// let prior = Prior::BeforeFirstTransition(Belief::certain(50 * 15, start)?);
/// let sensor = GroupedLikelihood::new(LikelihoodVector::linear(50), drive.place_groups())?;
/// let hmm = Hmm::new(prior, drive, sensor)?;
///
/// let mut filter = hmm.filter();
/// filter.predict_with(&RouteControl { odometry: Some(1.9), ..RouteControl::default() })?;
/// filter.predict_with(&RouteControl { odometry: Some(2.1), ..RouteControl::default() })?;
/// let places = hmm.transition().place_groups().marginal(&filter.belief())?;
/// assert_eq!(places.mode(), 14);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct RouteTransition {
    shape: RouteShape,
    speeds: Speeds,
    odometry: OdometryModel,
    views: Option<ViewChangeRates>,
    off_map: Option<OffMap>,
    /// G, row by row: `switching[to * k + from]`.
    switching: Vec<f64>,
    /// Start of each speed's weights among the weights of all speeds, and their end.
    starts: Vec<usize>,
    /// Probability of each place near a given one, for each place where the vehicle may leave.
    near_shares: Vec<f64>,
    /// Stencils of each speed: into places, and out of them.
    stencils: Vec<[Stencil; 2]>,
}

impl RouteTransition {
    /// Creates an open route, from one end to the other, for a vehicle at these speeds.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Empty`] for no places, or [`TransitionError::TooMany`] for more
    /// than 2^32 − 1 states.
    pub fn open(places: usize, speeds: Speeds) -> Result<Self, TransitionError> {
        Self::new(RouteShape { places, closed: false }, speeds)
    }

    /// Creates a closed route, a loop, for a vehicle at these speeds.
    ///
    /// # Errors
    ///
    /// As [`open`](Self::open).
    pub fn closed(places: usize, speeds: Speeds) -> Result<Self, TransitionError> {
        Self::new(RouteShape { places, closed: true }, speeds)
    }

    fn new(shape: RouteShape, speeds: Speeds) -> Result<Self, TransitionError> {
        let places = shape.places;
        let k = speeds.values().len();
        if places == 0 {
            return Err(TransitionError::Empty);
        }
        // With one more layer for off the map, whether it is added later or not.
        check_count("states", places.saturating_mul(k + 1))?;
        let mut starts = vec![0];
        starts.extend(speeds.windows.iter().scan(0, |end, window| {
            *end += window.weights.len();
            Some(*end)
        }));
        let route = Self {
            shape,
            switching: speeds.switching(),
            speeds,
            odometry: OdometryModel::default(),
            views: None,
            off_map: None,
            starts,
            near_shares: Vec::new(),
            stencils: Vec::new(),
        };
        Ok(route.with_stencils())
    }

    /// Sets the model of odometry.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Parameter`] for a scale that is not from 0.01 to 100, a bias
    /// beyond 1e6, or a deviation that is not from 0.001 to 1e6.
    pub fn with_odometry(self, odometry: OdometryModel) -> Result<Self, TransitionError> {
        odometry.check()?;
        Ok(Self { odometry, ..self })
    }

    /// Adds changes of the camera's view as evidence.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Parameter`] for a rate below 1e-30 or not below 1.
    pub fn with_views(self, rates: ViewChangeRates) -> Result<Self, TransitionError> {
        rates.check()?;
        Ok(Self { views: Some(rates), ..self })
    }

    /// Adds states off the map.
    ///
    /// A measurement there is as likely as at the speed [before](RouteControl::before) the step, or
    /// at another speed with the probability that speeds change; if the motion before is not given,
    /// as at speeds by their shares.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Parameter`] for rates that are not from 1e-30 to 1.
    pub fn with_off_map(self, off_map: OffMap) -> Result<Self, TransitionError> {
        off_map.check()?;
        let share = |left| off_map.near / self.shape.count_near(left, off_map.within) as f64;
        let near_shares = (0..self.shape.places).map(share).collect();
        Ok(Self { off_map: Some(off_map), near_shares, ..self })
    }

    /// Number of places, n.
    #[must_use]
    pub fn places(&self) -> usize {
        self.shape.places
    }

    /// True if the route is a loop.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        self.shape.closed
    }

    /// Speeds of the vehicle.
    #[must_use]
    pub fn speeds(&self) -> &Speeds {
        &self.speeds
    }

    /// Model of odometry.
    #[must_use]
    pub fn odometry(&self) -> &OdometryModel {
        &self.odometry
    }

    /// Rates of leaving the map, or `None` if the vehicle cannot leave it.
    #[must_use]
    pub fn off_map(&self) -> Option<&OffMap> {
        self.off_map.as_ref()
    }

    /// State of a speed at a place, or `None` if either does not exist.
    #[must_use]
    pub fn index(&self, speed: usize, place: usize) -> Option<usize> {
        let n = self.shape.places;
        (speed < self.k() && place < n).then(|| speed * n + place)
    }

    /// Index of a state's speed on the grid; `None` off the map, or if the state does not exist.
    #[must_use]
    pub fn speed_of(&self, state: usize) -> Option<usize> {
        Some(state / self.shape.places).filter(|speed| *speed < self.k())
    }

    /// Place of a state; off the map, the place where the vehicle left. `None` if the state
    /// does not exist.
    #[must_use]
    pub fn place_of(&self, state: usize) -> Option<usize> {
        (state < self.count()).then(|| state % self.shape.places)
    }

    /// States grouped by place, with a last group for off the map if that is modelled: for a sensor
    /// that sees only places, and for the probabilities of places.
    #[must_use]
    pub fn place_groups(&self) -> Groups {
        let n = self.shape.places;
        let group = |state| if state / n < self.k() { state % n } else { n };
        let groups = n + usize::from(self.off_map.is_some());
        Groups::numbered((0..self.count()).map(group).collect(), groups)
    }

    /// States grouped by speed, with a last group for off the map if that is modelled.
    #[must_use]
    pub fn speed_groups(&self) -> Groups {
        let groups = self.k() + usize::from(self.off_map.is_some());
        Groups::numbered((0..self.count()).map(|state| state / self.shape.places).collect(), groups)
    }

    /// Belief of a vehicle that may be anywhere: uniform over places, at speeds by their shares,
    /// and off the map by [its share](OffMap::share).
    #[must_use]
    pub fn anywhere(&self) -> Belief {
        let (n, off) = (self.shape.places, self.off_map.map_or(0.0, |off_map| off_map.share()));
        let on = self.speeds.shares().iter().map(|share| share * (1.0 - off) / n as f64);
        let layers = on.chain(self.off_map.map(|_| off / n as f64));
        // The shares sum to one, so on- and off-map mass sum to one without a division.
        Belief::from_valid(layers.flat_map(|p| std::iter::repeat_n(p, n)).collect())
    }

    fn with_stencils(self) -> Self {
        let stencil = |direction| {
            move |window: &Window, route: &Self| {
                Stencil::new(route.shape, window.first, window.weights.len(), direction)
            }
        };
        let (into, out_of) = (stencil(Direction::Into), stencil(Direction::OutOf));
        let windows = self.speeds.windows.iter();
        // The stencils do not depend on a step's evidence, which changes the weights only: they are
        // built once, and a step looks up its weights by index.
        let stencils = windows.map(|window| [into(window, &self), out_of(window, &self)]).collect();
        Self { stencils, ..self }
    }

    fn k(&self) -> usize {
        self.speeds.values().len()
    }

    fn count(&self) -> usize {
        self.shape.places * (self.k() + usize::from(self.off_map.is_some()))
    }
}

#[cfg(feature = "serde")]
wayfix::stored! {
    [] RouteTransition: [], |route| {
        places: usize = route.places(),
        closed: bool = route.is_closed(),
        speeds: Speeds = route.speeds(),
        odometry: OdometryModel = route.odometry(),
        views: Option<ViewChangeRates> = route.views,
        off_map: Option<OffMap> = route.off_map(),
    } => Self::new(RouteShape { places, closed }, speeds)
        .and_then(|route| route.with_odometry(odometry))
        .and_then(|route| optional(route, views, self::RouteTransition::with_views))
        .and_then(|route| optional(route, off_map, self::RouteTransition::with_off_map));
}

/// Adds an optional part to a route.
#[cfg(feature = "serde")]
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
