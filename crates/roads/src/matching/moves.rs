//! Weights of moves between states of two steps, by the time and the metres between them.

use super::candidates::{deviation, share_below, usual_deviation};
use super::place::ByReception;
use super::receiver::{RECEPTIONS, ROUGH_AT, Receiver};
use super::sighting::{Ahead, Fit, SLOPE};
use super::ways::Way;
use super::{MatchModel, TracePoint};
use wayfix::map::{Coordinates, RoadClass};
use wayfix_kernels::exp_in_place;

/// Fastest speed in metres per second that a density of distances spreads over.
pub(super) const FASTEST: f64 = 40.0;
/// Weight of the choices at junctions, where 1 would be drivers who choose by the traffic alone:
/// those who want to get somewhere choose less.
pub(super) const CHOICES: f64 = 0.7;
/// Most that the choices of one move weigh: a driver who wants to get somewhere makes few on the
/// way.
const MOST_CHOICES: f64 = 3.0;
/// Seconds for which a detour is possible at least, however short the time between two positions.
const LEAST_SECONDS: f64 = 0.2;
/// Share of the fastest speed of a road up to which slower speeds are rarer.
const SLOW: f64 = 0.3;
/// Share of moves at a speed that the road does not tell.
const ANY_SPEED: f64 = 0.1;
/// Share of moves in slow traffic, and its speed in metres per second: without it a queue of some
/// minutes would rather be a stretch off the road.
const IN_QUEUE: f64 = 0.1;
const QUEUE_SPEED: f64 = 2.0;
/// Relative density of distances that neither speed nor noise explains.
const ANY_DISTANCE: f64 = 1e-9;
/// Share of detours from a distribution ten times as wide.
const LONG_DETOURS: f64 = 0.05;
/// Seconds after which 1/e of what is known of a stop is left.
const STOP_LASTS: f64 = 20.0;
/// Largest probability that the vehicle stood, as far as the next move counts.
const MOST_STOOD: f64 = 0.999;
/// Speed in metres per second of the displacements that speak against a stop.
const MOVING: f64 = 8.0;
/// Typical speed off the road in metres per second over a short time, and the seconds after which a
/// way there bends.
const SPEED_OFF_ROAD: f64 = 16.0;
const BENDS_AFTER: f64 = 5.0;
/// Metres across for each metre that a way off the road leads astray within a moment, and those in
/// the long run: in any direction, √(2π).
const ASTRAY: f64 = 0.3;
const ASTRAY_AT_LAST: f64 = 2.5;
/// Share of the usual change of an error that is left for a vehicle that stands, as a variance:
/// receivers hold their position. On 19 recorded drives, displacements of less than 2 m changed the
/// error by 0.1 m in the median, others by 0.4 m.
const HELD: f64 = 0.1;
/// Share of the steps of a vehicle that stands at which its error changes as in poor reception.
const UNSTEADY: f64 = 0.02;
/// Seconds after which positions off the road are independent of those before.
const FORGETS: f64 = 10.0;
/// Widths, in standard deviations of a position, over which positions off the road spread within a
/// moment.
const THIN: f64 = 100.0;

/// Time and distance between two points of a drive.
#[derive(Debug, Clone, Copy)]
pub(super) struct Interval {
    /// Probability that the vehicle stands, by the displacements before.
    pub(super) stop: f64,
    pub(super) seconds: f64,
    /// Straight distance between the two positions in metres.
    pub(super) metres: f64,
    /// Standard deviation of the difference of the errors of two positions, in each direction.
    pub(super) jitter: f64,
    /// The same if the errors were independent.
    pub(super) spread: f64,
    /// Density of the displacement of a vehicle that stands.
    stands: f64,
    /// Density of the displacement of a vehicle that stands over that with errors that change as
    /// much as those of one that moves, by reception.
    steadier: ByReception,
    /// Share of the error that lasts that is left.
    pub(super) kept: f64,
    /// Mean of the speeds that the receiver tells at both ends.
    pub(super) speed: Option<f64>,
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

/// Distance that a vehicle went, with the standard deviation of what was measured of it, in metres.
#[derive(Debug, Clone, Copy)]
struct Distance {
    metres: f64,
    deviation: f64,
}

impl Interval {
    /// Interval between two points; `stood` is the probability that the vehicle stood before,
    /// `rough` that the receiver is.
    pub(super) fn new<P: Coordinates>(
        model: &MatchModel,
        before: &TracePoint<P>,
        point: &TracePoint<P>,
        [stood, rough]: [f64; 2],
    ) -> Self {
        let seconds = point.time - before.time;
        let spread = deviation(model, before).hypot(deviation(model, point));
        let kept = (-seconds / model.lasts).exp();
        let jitter = spread * (1.0 - model.lasting * kept).sqrt();
        let speed = before.speed.zip(point.speed).map(|(a, b)| 0.5 * (a + b));
        let metres = before.position.metres_to(point.position);
        // A vehicle that stands may always go on.
        let stood = stood.min(MOST_STOOD);
        let stop = model.stop + (stood - model.stop) * (-seconds / STOP_LASTS).exp();
        let usual = usual_deviation(model, before).hypot(usual_deviation(model, point));
        let receiver = Receiver::new(model, usual);
        let [held, moving] = [HELD, 1.0].map(|share| receiver.changes(share * (1.0 - kept)));
        let squared = metres * metres;
        let density = |variance: f64| (-0.5 * squared / variance).exp() / variance;
        let fine = (1.0 - UNSTEADY) * density(held[0]) + UNSTEADY * density(moving[1]);
        let stands = (1.0 - rough) * fine + rough * density(held[ROUGH_AT]);
        let ratio = |held: f64, moving: f64| {
            (-0.5 * squared * (1.0 / held - 1.0 / moving)).exp() * moving / held
        };
        let steadier = [
            ratio(held[0], moving[0]),
            (1.0 - UNSTEADY) * ratio(held[0], moving[1]) + UNSTEADY,
            ratio(held[ROUGH_AT], moving[ROUGH_AT]),
        ];
        Self { stop, seconds, metres, jitter, spread, stands, steadier, kept, speed }
    }

    /// Longest route worth looking for.
    pub(super) fn longest(&self) -> f64 {
        let by_time = 1.2 * FASTEST * self.seconds + 100.0;
        let by_detour = 1.3 * self.metres + 10.0 * self.seconds.min(60.0) + 50.0;
        by_time.min(by_detour) + 2.0 * self.spread
    }

    /// Probability that the vehicle stood, by the displacements up to the end of the interval,
    /// wherever it was.
    pub(super) fn stood(&self) -> f64 {
        let squared = self.metres * self.metres;
        let stands = self.stop * self.stands;
        let reach = (MOVING * self.seconds).powi(2) + self.jitter * self.jitter;
        let moves = (1.0 - self.stop) * (1.0 + squared / reach).powf(-1.5) / reach;
        stands / (stands + moves)
    }

    /// Log weight of a way off the road, by the density of its end in the plane: that of the
    /// distance, as on a road, and that across, which on a road is the density of the position.
    /// For points in short succession it is a constant: their displacements are hardly independent.
    pub(super) fn off_road(&self, model: &MatchModel) -> f64 {
        let (metres, deviation) = (self.metres, self.jitter);
        let speed = SPEED_OFF_ROAD / (1.0 + self.seconds / BENDS_AFTER);
        let limit = 1.3 * speed * self.seconds + deviation;
        let rare = 1.0 / (1.0 + (metres / limit).powi(2));
        let moves = self.by_limit(Distance { metres, deviation }, limit, [0.0; 2]).0;
        let moves = (1.0 - ANY_SPEED) * moves + ANY_SPEED * rare;
        let along = self.stop
            * self.most()
            * Ahead::of(metres, deviation * deviation).standing([1.0; RECEPTIONS])
            + (1.0 - self.stop) * moves;
        let independent = -(-self.seconds / FORGETS).exp_m1();
        let across = deviation.hypot((ASTRAY + ASTRAY_AT_LAST * independent) * metres);
        let in_plane = (along / (std::f64::consts::TAU.sqrt() * across)).ln();
        independent * in_plane
            - (1.0 - independent) * (THIN * model.over_all_time(model.noise)).ln()
    }

    /// Distance over which an even density spreads.
    fn most(&self) -> f64 {
        FASTEST * self.seconds + self.jitter
    }

    /// Scale of detours.
    pub(super) fn detour_scale(&self, model: &MatchModel) -> f64 {
        model.deviation * self.seconds.max(LEAST_SECONDS)
    }

    /// Log weight of a way to a state on a road with the density of its position, without the share
    /// that leaves the road: density of the distance, relative to an even one up to the fastest
    /// speed, the detour, the choices at junctions, and U-turns. Where the position does not belong
    /// to the road, nothing was measured of the distance, and a move weighs at most its
    /// probability. The logarithm may be −∞, and the rest is then unused.
    pub(super) fn weight(
        &self,
        model: &MatchModel,
        way: &Way,
        fastest: f64,
        fit: &Fit,
    ) -> (f64, Move) {
        let Fit { density, log_factor, inlier, share, ref ahead, .. } = *fit;
        let [metres, deviation] = ahead.moments();
        let distance = Distance { metres, deviation };
        let detour = way.detour / self.detour_scale(model);
        let (moves, is_ahead, [short, long]) = match self.speed {
            None => {
                let limit = 1.3 * fastest * self.seconds + deviation;
                self.by_limit(distance, limit, [detour, 0.1 * detour])
            }
            Some(speed) => {
                // A receiver's speed is that of a moment.
                let sigma = deviation.hypot(1.0 + 0.3 * speed * self.seconds);
                let z = (metres - speed * self.seconds) / sigma;
                let [density, short, long] = [-0.5 * z * z, -detour, -0.1 * detour].map(f64::exp);
                let density = density / (sigma * std::f64::consts::TAU.sqrt());
                (self.most() * density, share_below(metres / deviation), [short, long])
            }
        };
        let moves = (1.0 - ANY_SPEED) * moves + ANY_SPEED * is_ahead;
        let reach = QUEUE_SPEED * self.seconds + deviation;
        let rare = reach * (1.0 + (metres / reach).powi(2));
        let queues = std::f64::consts::FRAC_2_PI * self.most() / rare * is_ahead;
        let moves = (1.0 - IN_QUEUE) * moves + IN_QUEUE * queues;
        let moves = moves.max(ANY_DISTANCE);
        // Where the position belongs to the road, and where it says nothing.
        let parts = |weight: f64| [inlier * weight, (1.0 - inlier) * weight.min(1.0)];
        // A vehicle that stands is on the edge on which it was, at the same place.
        let stands = if way.is_same_edge() {
            let density = self.most() * ahead.standing(self.steadier);
            parts(density).map(|part| self.stop * part)
        } else {
            [0.0; 2]
        };
        let mut moves = parts(moves).map(|part| (1.0 - self.stop) * part);
        moves[0] *= share;
        let unseen = stands[1] + moves[1];
        let [stands, moves] = [stands, moves].map(|[seen, unseen]| seen + unseen);
        let (short, long) = ((1.0 - LONG_DETOURS) * short, 0.1 * LONG_DETOURS * long);
        let total = density * (stands + moves) * (short + long);
        let mut log = total.ln() + log_factor - (CHOICES * way.log_choices).min(MOST_CHOICES);
        if way.u_turns > 0 {
            log += f64::from(way.u_turns) * model.u_turn.ln();
        }
        let share = (short + 0.1 * long) / (short + long);
        let detour = share * way.detour / self.seconds.max(LEAST_SECONDS);
        let [stood, outlier] = [stands, unseen].map(|part| part / (stands + moves));
        (log, Move::Along { stood, outlier, detour })
    }

    /// Relative density of the distance of a vehicle that moves, up to a limit, the probability
    /// that it is above 0, and the exponentials e^−z of two more numbers. Few go slowly: the
    /// density grows up to a part of the limit, blurred by the noise of positions.
    fn by_limit(&self, distance: Distance, limit: f64, [z, w]: [f64; 2]) -> (f64, f64, [f64; 2]) {
        let (Distance { metres, deviation }, slow) = (distance, SLOW * limit);
        let ends = [metres / deviation, (metres - slow) / deviation];
        let left = (limit - metres) / deviation;
        let [normal, normal_slow] = ends.map(|z| -0.5 * z * z);
        let [below, below_slow, below_limit] = [ends[0], ends[1], left].map(|z| -SLOPE * z.abs());
        let mut powers = [normal, normal_slow, below, below_slow, below_limit, -z, -w, 0.0];
        exp_in_place(&mut powers);
        let [normal, normal_slow, below, below_slow, below_limit, z, w, _] = powers;
        // A logistic function of z, of which e^−|z| is given.
        let share = |z: f64, e: f64| if z > 0.0 { 1.0 } else { e } / (1.0 + e);
        let is_ahead = share(ends[0], below);
        // Means of what the distance exceeds 0 and the slow part by.
        let root = deviation / std::f64::consts::TAU.sqrt();
        let over = root * normal + metres * is_ahead;
        let over_slow = root * normal_slow + (metres - slow) * share(ends[1], below_slow);
        let ramp = ((over - over_slow) / slow).max(0.0);
        let density = ramp * share(left, below_limit) * self.most() / ((1.0 - 0.5 * SLOW) * limit);
        (density, is_ahead, [z, w])
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
