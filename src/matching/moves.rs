//! Weights of moves between states of two steps.

use super::candidates::{Candidate, OUTLIER_SPREAD, deviation, far, metres_between, share_below};
use super::{MatchModel, TracePoint};
use crate::map::{Coordinates, Reached, RoadClass, RoadNetwork, RouteMeasures, RouteSearch};

/// Fastest speed in metres per second that a density of distances spreads over.
pub(super) const FASTEST: f64 = 40.0;
/// Weight of the choices at junctions, where 1 would be drivers who choose by the traffic alone:
/// those who want to get somewhere choose less.
const CHOICES: f64 = 0.7;
/// Most that the choices of one move weigh: a driver who wants to get somewhere makes few on the
/// way.
const MOST_CHOICES: f64 = 3.0;
/// Seconds for which a detour is possible at least, however short the time between two positions.
const LEAST_SECONDS: f64 = 0.2;
/// Share of the fastest speed of a road up to which slower speeds are rarer.
const SLOW: f64 = 0.3;
/// Fastest speed off the road that is not rare, in metres per second.
const FASTEST_OFF_ROAD: f64 = 20.0;
/// Share of moves at a speed that the road does not tell.
const ANY_SPEED: f64 = 0.1;
/// Relative density of distances that neither speed nor noise explains.
const ANY_DISTANCE: f64 = 1e-9;
/// Share of detours from a distribution ten times as wide.
const LONG_DETOURS: f64 = 0.05;

/// Time and distance between two points of a drive.
#[derive(Debug, Clone, Copy)]
pub(super) struct Interval {
    pub(super) seconds: f64,
    /// Straight distance between the two positions in metres.
    pub(super) metres: f64,
    /// Standard deviation of the difference of two positions along a road.
    pub(super) jitter: f64,
    /// Mean of the speeds that the receiver tells at both ends.
    pub(super) speed: Option<f64>,
}

/// A way from one state to another along roads.
#[derive(Debug, Clone, Copy)]
pub(super) struct Way {
    /// Length in metres; below 0 if the second point lies behind the first.
    pub(super) metres: f64,
    /// Metres of the detour against the straight line between both points.
    pub(super) detour: f64,
    pub(super) u_turns: u32,
    log_choices: f64,
}

/// Kind of a way between two states on roads.
#[derive(Debug, Clone, Copy)]
pub(super) enum WayKind {
    SameEdge,
    /// A U-turn from an edge onto its reverse, between their ends.
    Turn,
    /// Over the end of the first edge, and others between as a rule.
    Edges(Reached),
}

/// Kind of a move, beside its weight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Move {
    /// The vehicle comes onto the road, leaves it, or is off it.
    OffRoad,
    /// Along roads.
    Along {
        /// Probability that the vehicle stood.
        stood: f64,
        /// Probability that the position after the move says nothing.
        outlier: f64,
        /// Expected detour in metres a second, with long ones scaled down.
        detour: f64,
    },
}

impl Interval {
    pub(super) fn new<P: Coordinates>(
        model: &MatchModel,
        before: &TracePoint<P>,
        point: &TracePoint<P>,
    ) -> Self {
        let jitter = deviation(model, before).hypot(deviation(model, point));
        let speed = before.speed.zip(point.speed).map(|(a, b)| 0.5 * (a + b));
        let metres = before.position.metres_to(point.position);
        Self { seconds: point.time - before.time, metres, jitter, speed }
    }

    /// Longest route worth looking for.
    fn longest(&self) -> f64 {
        let by_time = 1.2 * FASTEST * self.seconds + 100.0;
        let by_detour = 1.3 * self.metres + 10.0 * self.seconds.min(60.0) + 50.0;
        by_time.min(by_detour) + 4.0 * self.jitter
    }

    /// Mean of what a distance that is measured with noise exceeds 0, from the bell curve at the
    /// distance in deviations, and the share below it.
    fn above(&self, metres: f64, bell: f64, share: f64) -> f64 {
        self.jitter * bell / std::f64::consts::TAU.sqrt() + metres * share
    }

    /// Weight of a move that begins or ends off the road, by its speed.
    pub(super) fn off_road(&self) -> f64 {
        let limit = FASTEST_OFF_ROAD * self.seconds;
        let spread = FASTEST * self.seconds + OUTLIER_SPREAD * self.jitter;
        ANY_SPEED * far(self.metres / spread)
            + (1.0 - ANY_SPEED) * share_below((limit - self.metres) / self.jitter)
    }

    /// Distance over which an even density spreads.
    fn most(&self) -> f64 {
        FASTEST * self.seconds + self.jitter
    }

    /// Scale of detours.
    fn detour_scale(&self, model: &MatchModel) -> f64 {
        model.deviation * self.seconds.max(LEAST_SECONDS)
    }

    /// Weight of a way to a state on a road, without the share that leaves the road: density of
    /// the distance, relative to an even one up to the fastest speed, the detour, the choices at
    /// junctions, and U-turns. `inlier` is the probability that the position there belongs to the
    /// road; where it does not, nothing was measured of the distance, and a move weighs at most its
    /// probability. The logarithm may be −∞, and the rest is then unused.
    pub(super) fn weight(
        &self,
        model: &MatchModel,
        way: &Way,
        fastest: f64,
        inlier: f64,
    ) -> (f64, Move) {
        let (z, most) = (way.metres / self.jitter, self.most());
        let peak = most / (self.jitter * std::f64::consts::TAU.sqrt());
        let (bell, ahead) = ((-0.5 * z * z).exp(), share_below(z));
        let moves = match self.speed {
            None => {
                let above = self.above(way.metres, bell, ahead);
                self.by_limit(way.metres, above, 1.3 * fastest * self.seconds + self.jitter)
            }
            Some(speed) => {
                // A receiver's speed is that of a moment.
                let sigma = self.jitter.hypot(1.0 + 0.3 * speed * self.seconds);
                let z = (way.metres - speed * self.seconds) / sigma;
                most / (sigma * std::f64::consts::TAU.sqrt()) * (-0.5 * z * z).exp()
            }
        };
        let moves = (1.0 - ANY_SPEED) * moves + ANY_SPEED * ahead;
        let moves = moves.max(ANY_DISTANCE);
        // Where the position belongs to the road, and where it says nothing.
        let parts = |weight: f64| [inlier * weight, (1.0 - inlier) * weight.min(1.0)];
        let stands = parts(peak).map(|part| model.stop * bell * part);
        let moves = parts(moves).map(|part| (1.0 - model.stop) * part);
        let unseen = stands[1] + moves[1];
        let [stands, moves] = [stands, moves].map(|[seen, unseen]| seen + unseen);
        let scaled = way.detour / self.detour_scale(model);
        let [short, long] = match scaled {
            0.0 => [1.0 - LONG_DETOURS, 0.1 * LONG_DETOURS],
            _ => {
                [(1.0 - LONG_DETOURS) * (-scaled).exp(), 0.1 * LONG_DETOURS * (-0.1 * scaled).exp()]
            }
        };
        let total = (stands + moves) * (short + long);
        let mut log = total.ln() - (CHOICES * way.log_choices).min(MOST_CHOICES);
        if way.u_turns > 0 {
            log += f64::from(way.u_turns) * model.u_turn.ln();
        }
        let share = (short + 0.1 * long) / (short + long);
        let detour = share * way.detour / self.seconds.max(LEAST_SECONDS);
        let [stood, outlier] = [stands, unseen].map(|part| part / (stands + moves));
        (log, Move::Along { stood, outlier, detour })
    }

    /// Relative density of the distance of a vehicle that moves, up to a limit. Few go slowly: the
    /// density grows up to a part of the limit, blurred by the noise of positions. `above` is that
    /// of the distance.
    fn by_limit(&self, metres: f64, above: f64, limit: f64) -> f64 {
        let slow = SLOW * limit;
        let z = (metres - slow) / self.jitter;
        let ramp = above - self.above(metres - slow, (-0.5 * z * z).exp(), share_below(z));
        let below = share_below((limit - metres) / self.jitter);
        (ramp / slow).max(0.0) * below * self.most() / ((1.0 - 0.5 * SLOW) * limit)
    }
}

/// Typical speed of a road in metres per second, where none is posted.
pub(super) fn speed_of(class: RoadClass) -> f64 {
    match class {
        RoadClass::Main => 30.0,
        RoadClass::Arterial => 24.0,
        RoadClass::Collector => 19.0,
        RoadClass::Street => 16.0,
    }
}

/// True if a state is so far behind another on its edge that a vehicle drove around the block; less
/// than that, positions jitter.
fn is_behind(from: &Candidate, to: &Candidate, jitter: f64) -> bool {
    to.along - from.along < -6.0 * jitter
}

/// Finds the ways from one state to others.
pub(super) struct Ways<'a, P> {
    pub(super) network: &'a RoadNetwork<P>,
    pub(super) measures: &'a RouteMeasures,
    pub(super) search: &'a mut RouteSearch,
}

impl<P: Coordinates> Ways<'_, P> {
    /// Searches from a state on a road for the edges of the next states.
    pub(super) fn from(
        &mut self,
        from: &Candidate,
        to: &[Candidate],
        model: &MatchModel,
        interval: &Interval,
    ) {
        let left = self.network.edges()[from.edge as usize].metres - from.along;
        let others = to.iter().filter(|to| !to.is_off_road());
        let others =
            others.filter(|to| to.edge != from.edge || is_behind(from, to, interval.jitter));
        let others = others.map(|to| to.edge as usize);
        let most = interval.longest() - left;
        // Metres that a U-turn counts as in a search for routes.
        let u_turn = -model.u_turn.ln() * interval.detour_scale(model);
        self.search.run(self.network, self.measures, from.edge as usize, others, most, u_turn);
    }

    /// Kind of the way between two states on roads after [`from`](Self::from); `None` if there is
    /// none.
    pub(super) fn kind(&self, from: &Candidate, to: &Candidate, jitter: f64) -> Option<WayKind> {
        let [edge, next] = [from.edge as usize, to.edge as usize];
        if edge == next && !is_behind(from, to, jitter) {
            return Some(WayKind::SameEdge);
        }
        let reached = self.search.reached(next);
        // A U-turn on the way, unless the route by the ends of the edges has none.
        let is_turn = reached.is_none_or(|reached| reached.u_turns > 0);
        if is_turn && self.network.reverse(edge) == Some(next) {
            return Some(WayKind::Turn);
        }
        reached.map(WayKind::Edges)
    }

    /// Way between two states on roads; `None` if there is none.
    pub(super) fn way(&self, from: &Candidate, to: &Candidate, jitter: f64) -> Option<Way> {
        let short = |metres, u_turns| Way { metres, detour: 0.0, u_turns, log_choices: 0.0 };
        Some(match self.kind(from, to, jitter)? {
            WayKind::SameEdge => short(to.along - from.along, 0),
            WayKind::Turn => {
                let here = self.network.edges()[from.edge as usize].metres - from.along;
                short((to.along - here).abs(), 1)
            }
            WayKind::Edges(reached) => self.along(from, to, reached),
        })
    }

    fn along(&self, from: &Candidate, to: &Candidate, reached: Reached) -> Way {
        let straight = metres_between::<P>(from.point, to.point);
        let [edge, next] = [from.edge as usize, to.edge as usize];
        let length = |edge: usize| self.network.edges()[edge].metres;
        let left = 1.0 - from.along / length(edge);
        let done = to.along / length(next);
        let metres = left * length(edge) + reached.metres + to.along;
        // Bends of a road are no choice of the driver: a detour is one of straight pieces.
        let straight_of = |edge| self.measures.straight_metres(edge);
        let chords = left * straight_of(edge) + reached.chords + done * straight_of(next);
        Way {
            metres,
            detour: (chords - straight).max(0.0),
            u_turns: reached.u_turns,
            log_choices: reached.log_choices,
        }
    }
}
