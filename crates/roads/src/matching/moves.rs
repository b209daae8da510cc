//! Moves between the states of two steps: the ways along roads that they take, and their weights
//! from the time and the distance between the points.
//!
//! Only the cheapest way between two states counts, with U-turns and choices at junctions priced as
//! the detours that are as improbable. It has one of three shapes ([`WayKind`]): along one edge, by
//! a U-turn between the ends of an edge, or over the end of the first edge.
//!
//! A weight is the likelihood of what was measured between the two points: evidence on moves in the
//! sense of section 2 of the guide's formulas, so weights are not normalised over the moves out of
//! a state. Densities of distances are relative to an even one over [`Interval::even_width`]
//! metres. All hypotheses (stationary, moving, in a queue, off the road) are densities of the same
//! displacement, so none of them wins merely by paying for less.

use super::candidates::{Candidate, deviation, metres_between, share_below, usual_deviation};
use super::receiver::{ByReception, RECEPTIONS, ROUGH_AT, Receiver};
use super::sighting::{Ahead, Fit, SLOPE};
use super::{MatchModel, TracePoint};
use crate::{Reached, RoadNetwork, RouteCosts, RouteMeasures, RouteSearch};
use wayfix::map::{Coordinates, RoadClass};
use wayfix_kernels::exp_in_place;

/// Fastest speed in metres per second that a density of distances spreads over.
pub(super) const FASTEST: f64 = 40.0;
/// Weight of the choices at junctions; 1 would mean that drivers choose by traffic alone, but those
/// with a destination choose less freely.
pub(super) const CHOICES: f64 = 0.7;
/// Largest total weight of the choices of one move: a driver with a destination makes few of them.
const MOST_CHOICES: f64 = 3.0;
/// Least time in seconds by which detours are scaled, however close two positions are in time.
const LEAST_SECONDS: f64 = 0.2;
/// Share of the fastest speed of a road up to which slower speeds are rarer.
const SLOW: f64 = 0.3;
/// Share of moves at a speed unrelated to the road's.
const ANY_SPEED: f64 = 0.1;
/// Share of moves in slow traffic, and its speed in metres per second. Without it, a queue of some
/// minutes would be taken for a stretch off the road.
const IN_QUEUE: f64 = 0.1;
const QUEUE_SPEED: f64 = 2.0;
/// Relative density of distances that neither speed nor noise explains: a floor, not a wall.
const ANY_DISTANCE: f64 = 1e-9;
/// Share of detours from a distribution ten times as wide.
const LONG_DETOURS: f64 = 0.05;
/// Seconds after which 1/e of what is known about a stop is left.
const STOP_LASTS: f64 = 20.0;
/// Largest probability of having been stationary that the next move starts from.
const MOST_STATIONARY: f64 = 0.999;
/// Scale, as a speed in metres per second, of the displacements of moving vehicles in
/// [`Interval::p_stationary`].
const MOVING: f64 = 8.0;
/// Typical speed off the road in metres per second over a short time, and the seconds after which a
/// path there bends.
const SPEED_OFF_ROAD: f64 = 16.0;
const BENDS_AFTER: f64 = 5.0;
/// Metres sideways for each metre of a path off the road, at first and, added to it, in the long
/// run, when it may lead in any direction: √(2π).
const ASTRAY: f64 = 0.3;
const ASTRAY_AT_LAST: f64 = 2.5;
/// Variance of the change of a stationary vehicle's error, as a share of the usual one: receivers
/// hold their position. On 19 recorded drives, the error changed by a median of 0.1 m over
/// displacements of less than 2 m, and by 0.4 m over others.
const HELD: f64 = 0.1;
/// Share of the steps of a stationary vehicle at which its error changes as in poor reception.
const UNSTEADY: f64 = 0.02;
/// Time constant in seconds with which positions off the road become independent of earlier ones.
const FORGETS: f64 = 10.0;
/// Width, in standard deviations of a position, over which positions off the road are spread in the
/// short run.
const THIN: f64 = 100.0;

/// Time and distance between two points of a drive.
#[derive(Debug, Clone, Copy)]
pub(super) struct Interval {
    /// Probability that the vehicle is stationary, given the displacements before this one.
    pub(super) p_stationary_before: f64,
    pub(super) seconds: f64,
    /// Straight distance between the two positions in metres.
    pub(super) metres: f64,
    /// Standard deviation of the difference of the errors of two positions, in each direction.
    pub(super) jitter: f64,
    /// The same if the errors were independent.
    pub(super) spread: f64,
    /// Density of the displacement of a stationary vehicle, times 2π.
    stationary_density: f64,
    /// Density of the displacement of a stationary vehicle, divided by its density if errors
    /// changed as much as those of a moving one; by reception.
    stationary_ratio: ByReception,
    /// Share of the lasting error that is left: κ.
    pub(super) kept: f64,
    /// Mean of the speeds that the receiver reports at both ends.
    pub(super) speed: Option<f64>,
}

/// Kind of a move, with the posterior quantities that learning counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Move {
    /// The vehicle comes onto the road, leaves it, or is off it.
    OffRoad,
    /// Along roads.
    Along {
        /// Probability that the vehicle was stationary.
        p_stationary: f64,
        /// Probability that the position after the move is an outlier.
        outlier: f64,
        /// Expected detour in metres per second, with long ones counted a tenth.
        detour: f64,
    },
}

/// Distance that a vehicle covered, and the standard deviation of its measurement, in metres.
#[derive(Debug, Clone, Copy)]
struct Distance {
    metres: f64,
    deviation: f64,
}

impl Interval {
    /// Interval between two points; `p_stationary` is the probability that the vehicle was
    /// stationary before, `rough` that its receiver is rough.
    pub(super) fn new<P: Coordinates>(
        model: &MatchModel,
        before: &TracePoint<P>,
        point: &TracePoint<P>,
        [p_stationary, rough]: [f64; 2],
    ) -> Self {
        let seconds = point.time - before.time;
        let spread = deviation(model, before).hypot(deviation(model, point));
        let kept = (-seconds / model.lasts).exp();
        // Two errors with the deviation σ have the covariance ρκσ², with ρ = `model.lasting` and κ
        // = `kept`. So their difference has the variance 2σ² (1 − ρκ), where √2 σ is `spread`.
        let jitter = spread * (1.0 - model.lasting * kept).sqrt();
        let speed = before.speed.zip(point.speed).map(|(a, b)| 0.5 * (a + b));
        let metres = before.position.metres_to(point.position);
        // Even a vehicle known to be stationary may move off, and knowledge of a stop decays
        // towards the model's share of stops.
        let p_stationary = p_stationary.min(MOST_STATIONARY);
        let p_stationary_before =
            model.stop + (p_stationary - model.stop) * (-seconds / STOP_LASTS).exp();
        // `usual` is √2 σ, the deviation of a difference. So `changes` gives the variance of the
        // change of an error: 2ρσ² (1 − κ) of the lasting part and all of the white part.
        let usual = usual_deviation(model, before).hypot(usual_deviation(model, point));
        let receiver = Receiver::new(model, usual);
        let [held, moving] = [HELD, 1.0].map(|share| receiver.changes(share * (1.0 - kept)));
        let squared = metres * metres;
        // Gaussian in two dimensions without its factor 1 / 2π, which `p_stationary` leaves out of
        // both hypotheses.
        let density = |variance: f64| (-0.5 * squared / variance).exp() / variance;
        let fine = (1.0 - UNSTEADY) * density(held[0]) + UNSTEADY * density(moving[1]);
        let stationary_density = (1.0 - rough) * fine + rough * density(held[ROUGH_AT]);
        // The quotient of two such densities as one exponential, since each density may underflow.
        let ratio = |held: f64, moving: f64| {
            (-0.5 * squared * (1.0 / held - 1.0 / moving)).exp() * moving / held
        };
        let stationary_ratio = [
            ratio(held[0], moving[0]),
            // In poor reception a stationary receiver holds its position as in usual reception,
            // apart from the share of unsteady steps, whose ratio is 1.
            (1.0 - UNSTEADY) * ratio(held[0], moving[1]) + UNSTEADY,
            ratio(held[ROUGH_AT], moving[ROUGH_AT]),
        ];
        Self {
            p_stationary_before,
            seconds,
            metres,
            jitter,
            spread,
            stationary_density,
            stationary_ratio,
            kept,
            speed,
        }
    }

    /// Longest route worth searching for.
    pub(super) fn longest(&self) -> f64 {
        let by_time = 1.2 * FASTEST * self.seconds + 100.0;
        let by_detour = 1.3 * self.metres + 10.0 * self.seconds.min(60.0) + 50.0;
        // Both bounds hold for the true positions, which may be `spread` away at either end.
        by_time.min(by_detour) + 2.0 * self.spread
    }

    /// Probability that the vehicle was stationary, from the displacements up to the end of the
    /// interval, whatever its state.
    pub(super) fn p_stationary(&self) -> f64 {
        let squared = self.metres * self.metres;
        let stationary = self.p_stationary_before * self.stationary_density;
        // Bayes' rule with the Gaussian of `new` for a stationary vehicle and, for a moving one, a
        // Cauchy density in two dimensions, (1 + r²/R²)^(-3/2) / 2πR², with R² = `reach`; both
        // times 2π. The tail of the latter keeps large displacements possible.
        let reach = (MOVING * self.seconds).powi(2) + self.jitter * self.jitter;
        let moves = (1.0 - self.p_stationary_before) * (1.0 + squared / reach).powf(-1.5) / reach;
        stationary / (stationary + moves)
    }

    /// Log weight of a move off the road, by the density of its end in the plane: the density of
    /// the distance, as on a road, times one sideways, which on a road is the density of the
    /// position. For points in quick succession it is a constant, since their displacements are
    /// hardly independent.
    pub(super) fn off_road(&self, model: &MatchModel) -> f64 {
        let (metres, deviation) = (self.metres, self.jitter);
        let speed = SPEED_OFF_ROAD / (1.0 + self.seconds / BENDS_AFTER);
        // A path that bends covers less straight distance than its speed and time suggest.
        let limit = 1.3 * speed * self.seconds + deviation;
        let rare = 1.0 / (1.0 + (metres / limit).powi(2));
        let moves = self.by_limit(Distance { metres, deviation }, limit, [0.0; 2]).0;
        let moves = (1.0 - ANY_SPEED) * moves + ANY_SPEED * rare;
        // As in `weight`, a mixture of stationary and moving, but without the queues and detours of
        // roads.
        let along = self.p_stationary_before
            * self.even_width()
            * Ahead::of(metres, deviation * deviation).stationary_density([1.0; RECEPTIONS])
            + (1.0 - self.p_stationary_before) * moves;
        // `independent` goes from 0, for points in quick succession, to 1. The logarithm goes with
        // it from a constant, that of a thin even density, to that of the density in the plane.
        let independent = -(-self.seconds / FORGETS).exp_m1();
        let across = deviation.hypot((ASTRAY + ASTRAY_AT_LAST * independent) * metres);
        let in_plane = (along / (std::f64::consts::TAU.sqrt() * across)).ln();
        independent * in_plane
            - (1.0 - independent) * (THIN * model.over_all_time(model.noise)).ln()
    }

    /// Width in metres of the even density that all densities of distances are relative to.
    fn even_width(&self) -> f64 {
        FASTEST * self.seconds + self.jitter
    }

    /// Mean detour in metres.
    pub(super) fn detour_scale(&self, model: &MatchModel) -> f64 {
        model.deviation * self.seconds.max(LEAST_SECONDS)
    }

    /// Log weight of a way to a state on a road, including the density of its position but not the
    /// probability of staying on the road: the density of the distance relative to an even one up
    /// to the fastest speed, the detour, the choices at junctions, and U-turns. Where the position
    /// is an outlier, the distance was not measured, and a move weighs at most its probability. The
    /// logarithm may be −∞; the rest is then unused.
    pub(super) fn weight(
        &self,
        model: &MatchModel,
        way: &Way,
        fastest: f64,
        fit: &Fit,
    ) -> (f64, Move) {
        let Fit { density, log_factor, inlier, on_edge, ref ahead, .. } = *fit;
        let [metres, deviation] = ahead.moments();
        let distance = Distance { metres, deviation };
        let detour = way.detour / self.detour_scale(model);
        let (moves, is_ahead, [short, long]) = match self.speed {
            None => {
                let limit = 1.3 * fastest * self.seconds + deviation;
                self.by_limit(distance, limit, [detour, 0.1 * detour])
            }
            Some(speed) => {
                // A receiver reports the speed at one moment, which says less about the mean over a
                // longer interval.
                let sigma = deviation.hypot(1.0 + 0.3 * speed * self.seconds);
                let z = (metres - speed * self.seconds) / sigma;
                let [density, short, long] = [-0.5 * z * z, -detour, -0.1 * detour].map(f64::exp);
                let density = density / (sigma * std::f64::consts::TAU.sqrt());
                (self.even_width() * density, share_below(metres / deviation), [short, long])
            }
        };
        // Densities are relative to an even one, which is therefore 1, but only ahead: a vehicle
        // does not move backwards.
        let moves = (1.0 - ANY_SPEED) * moves + ANY_SPEED * is_ahead;
        // Half a Cauchy density, 2 / (π R (1 + d²/R²)) for distances d > 0, with R = `reach`.
        let reach = QUEUE_SPEED * self.seconds + deviation;
        let rare = reach * (1.0 + (metres / reach).powi(2));
        let queues = std::f64::consts::FRAC_2_PI * self.even_width() / rare * is_ahead;
        let moves = (1.0 - IN_QUEUE) * moves + IN_QUEUE * queues;
        let moves = moves.max(ANY_DISTANCE);
        // Shares of a weight for a position that belongs to the road and for an outlier. An outlier
        // measures no distance, so a density above 1 must not count in its favour.
        let split_by_inlier = |weight: f64| [inlier * weight, (1.0 - inlier) * weight.min(1.0)];
        // A stationary vehicle is still on its edge, at the same place.
        let stationary = if way.is_same_edge() {
            let density = self.even_width() * ahead.stationary_density(self.stationary_ratio);
            split_by_inlier(density).map(|part| self.p_stationary_before * part)
        } else {
            [0.0; 2]
        };
        let mut moves = split_by_inlier(moves).map(|part| (1.0 - self.p_stationary_before) * part);
        // Only a moving vehicle gets a new place from its position, and that place must be on the
        // edge. The place of a stationary one already is.
        moves[0] *= on_edge;
        let unseen = stationary[1] + moves[1];
        let [stationary, moves] = [stationary, moves].map(|[seen, unseen]| seen + unseen);
        // Two exponential distributions of detours; the density of the one ten times as wide is a
        // tenth as high.
        let (short, long) = ((1.0 - LONG_DETOURS) * short, 0.1 * LONG_DETOURS * long);
        let total = density * (stationary + moves) * (short + long);
        let mut log = total.ln() + log_factor - (CHOICES * way.log_choices).min(MOST_CHOICES);
        if way.u_turns > 0 {
            log += f64::from(way.u_turns) * model.u_turn.ln();
        }
        // Expected detour for the M step of a mixture of exponentials with tied scales: one from
        // the wide distribution counts a tenth.
        let share = (short + 0.1 * long) / (short + long);
        let detour = share * way.detour / self.seconds.max(LEAST_SECONDS);
        let [p_stationary, outlier] = [stationary, unseen].map(|part| part / (stationary + moves));
        (log, Move::Along { p_stationary, outlier, detour })
    }

    /// Relative density of the distance of a moving vehicle, up to a limit; the probability that
    /// the distance is positive; and the exponentials e^−z of two more numbers. Few vehicles are
    /// slow: the density rises linearly up to a share of the limit and is flat from there, blurred
    /// by the noise of positions.
    fn by_limit(&self, distance: Distance, limit: f64, [z, w]: [f64; 2]) -> (f64, f64, [f64; 2]) {
        let (Distance { metres, deviation }, slow) = (distance, SLOW * limit);
        let ends = [metres / deviation, (metres - slow) / deviation];
        let left = (limit - metres) / deviation;
        let [normal, normal_slow] = ends.map(|z| -0.5 * z * z);
        let [below, below_slow, below_limit] = [ends[0], ends[1], left].map(|z| -SLOPE * z.abs());
        // Eight exponentials at once fill whole vectors: this is the inner loop of matching.
        let mut powers = [normal, normal_slow, below, below_slow, below_limit, -z, -w, 0.0];
        exp_in_place(&mut powers);
        let [normal, normal_slow, below, below_slow, below_limit, z, w, _] = powers;
        // The logistic function of z, from e = e^−|z|: 1 / (1 + e) for z > 0, and e / (1 + e)
        // otherwise.
        let share = |z: f64, e: f64| if z > 0.0 { 1.0 } else { e } / (1.0 + e);
        let is_ahead = share(ends[0], below);
        // For the distance d, E[max(d, 0)] = σ φ(d/σ) + d Φ(d/σ), with the logistic function for Φ.
        // The blurred ramp is the difference of two such terms, E[max(d, 0)] − E[max(d − slow, 0)],
        // over `slow`.
        let root = deviation / std::f64::consts::TAU.sqrt();
        let over = root * normal + metres * is_ahead;
        let over_slow = root * normal_slow + (metres - slow) * share(ends[1], below_slow);
        let ramp = ((over - over_slow) / slow).max(0.0);
        // A ramp up to SLOW times the limit and a plateau from there to the limit have the area
        // (1 − SLOW/2) times the limit.
        let density =
            ramp * share(left, below_limit) * self.even_width() / ((1.0 - 0.5 * SLOW) * limit);
        (density, is_ahead, [z, w])
    }
}

/// Typical speed of a road in metres per second, for roads without a posted one.
pub(super) fn speed_of(class: RoadClass) -> f64 {
    match class {
        RoadClass::Main => 30.0,
        RoadClass::Arterial => 24.0,
        RoadClass::Collector => 19.0,
        RoadClass::Street => 16.0,
    }
}

/// A way from one state to another along roads.
#[derive(Debug, Clone, Copy)]
pub(super) struct Way {
    /// Length in metres; below 0 if the second point lies behind the first.
    pub(super) metres: f64,
    /// Detour in metres relative to the straight line between both points.
    pub(super) detour: f64,
    pub(super) u_turns: u32,
    /// Choices at junctions: the sum of −ln p(turn).
    pub(super) log_choices: f64,
    /// Metres along the first edge at which the second would start; `None` for a U-turn between.
    pub(super) starts: Option<f64>,
}

impl Way {
    /// True if the way stays on its edge.
    pub(super) fn is_same_edge(&self) -> bool {
        self.starts == Some(0.0)
    }
}

/// Kind of a way between two states on roads.
#[derive(Debug, Clone, Copy)]
pub(super) enum WayKind {
    SameEdge,
    /// A U-turn from an edge onto its reverse, between their ends.
    Turn,
    /// Over the end of the first edge, usually with other edges in between.
    Edges(Reached),
}

/// True if a state is so far behind another on its edge that the vehicle must have driven around
/// the block. Anything less is the jitter of positions.
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
    /// Sets the states of the next point as targets.
    pub(super) fn set_targets(
        &mut self,
        to: &[Candidate],
        model: &MatchModel,
        interval: &Interval,
    ) {
        let edges = to.iter().filter(|to| !to.is_off_road()).map(|to| to.edge as usize);
        // The cheapest way is the most probable one: detours have density e^(−d / scale), so an
        // event of probability p costs −ln p times the scale in metres.
        let detour = interval.detour_scale(model);
        let costs = RouteCosts { u_turn: -model.u_turn.ln() * detour, choice: CHOICES * detour };
        self.search.set_targets(self.network, self.measures, edges, costs);
    }

    /// Searches from a state on a road for the targets.
    pub(super) fn search_from(&mut self, from: &Candidate, interval: &Interval) {
        let edge = from.edge as usize;
        let left = self.network.edges()[edge].metres - from.along;
        // The search counts metres from the end of the edge, so what is left of it comes off the
        // limit.
        self.search.run(self.network, self.measures, edge, interval.longest() - left);
    }

    /// Kind of the way between two states on roads after [`search_from`](Self::search_from); `None`
    /// if there is none.
    pub(super) fn kind(&self, from: &Candidate, to: &Candidate, jitter: f64) -> Option<WayKind> {
        let [edge, next] = [from.edge as usize, to.edge as usize];
        if edge == next && !is_behind(from, to, jitter) {
            return Some(WayKind::SameEdge);
        }
        let reached = self.search.reached(next);
        // A U-turn between the ends of the edge, unless the route by way of the ends needs none.
        let is_turn = reached.is_none_or(|reached| reached.u_turns > 0);
        if is_turn && self.network.reverse(edge) == Some(next) {
            return Some(WayKind::Turn);
        }
        reached.map(WayKind::Edges)
    }

    /// Way between two states on roads; `None` if there is none.
    pub(super) fn way(&self, from: &Candidate, to: &Candidate, jitter: f64) -> Option<Way> {
        let short = |metres, u_turns, starts| Way {
            metres,
            detour: 0.0,
            u_turns,
            log_choices: 0.0,
            starts,
        };
        Some(match self.kind(from, to, jitter)? {
            WayKind::SameEdge => short(to.along - from.along, 0, Some(0.0)),
            WayKind::Turn => {
                let here = self.network.edges()[from.edge as usize].metres - from.along;
                // `here` is the start of the way as measured along the reverse edge.
                short((to.along - here).abs(), 1, None)
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
        // The bends of a road are not a choice of the driver, so a detour is measured along the
        // chords of the edges.
        let straight_of = |edge| self.measures.straight_metres(edge);
        let chords = left * straight_of(edge) + reached.chords + done * straight_of(next);
        Way {
            metres,
            detour: (chords - straight).max(0.0),
            u_turns: reached.u_turns,
            log_choices: reached.log_choices,
            starts: Some(length(edge) + reached.metres),
        }
    }
}
