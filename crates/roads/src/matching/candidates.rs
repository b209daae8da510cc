//! Candidates of a step, which are its states: points of roads near a position, points that
//! vehicles would have reached unseen, and one off the road.
//!
//! Every candidate on a road comes with a [`Sighting`], by which moves compute the density of the
//! position, and with the log-likelihood of the heading; both lists have the order of the
//! candidates.

use super::receiver::EdgeEstimate;
use super::sighting::{SLOPE, Sighting, logistic};
use super::{MatchModel, TracePoint};
use crate::{EdgeIndex, NearEdge, RoadNetwork};
use wayfix::map::Coordinates;

/// Largest number of edges near a point: the nearest are kept, since moves grow with its square.
const MOST_CANDIDATES: usize = 64;
/// Logarithm of the share of the belief above which a state continues where its road leads, even if
/// no position is near.
const LEAST_LOG_CARRIED: f64 = -3.5;
/// Largest number of ways of one state that continues, and of states added for all of them.
const CARRIED_WAYS: usize = 8;
const MOST_CARRIED: usize = 16;
/// Largest number of edges visited to find where the ways of a state lead.
const MOST_VISITED: usize = 200;

/// A point of an edge where the vehicle may be, or the state off the road.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(super) struct Candidate {
    /// Index of the edge; [`OFF_ROAD`] off the road.
    pub(super) edge: u32,
    /// Metres from the start of the edge.
    pub(super) along: f64,
    /// The point, in the plane of the network.
    pub(super) point: [f64; 2],
    /// Place along the edge and error of the receiver, given the drive so far.
    pub(super) place: EdgeEstimate,
    /// Probability that the position belongs to the road.
    pub(super) inlier: f64,
}

/// Widths, in standard deviations of a position, over which outliers and positions off the road are
/// spread. With these, one bad position is an outlier, and several in a row are a stretch off the
/// road.
pub(super) const OUTLIER_SPREAD: f64 = 30.0;
const OFF_ROAD_SPREAD: f64 = 450.0;

/// Edge of the state off the road.
pub(super) const OFF_ROAD: u32 = u32::MAX;

impl Candidate {
    pub(super) fn is_off_road(&self) -> bool {
        self.edge == OFF_ROAD
    }

    /// The state off the road, at a position.
    pub(super) fn off_road<P: Coordinates>(point: &TracePoint<P>) -> Self {
        let (point, place) = (point.position.to_plane(), EdgeEstimate::default());
        Self { edge: OFF_ROAD, along: 0.0, point, place, inlier: 0.0 }
    }
}

/// Log density of the first position of a drive off the road.
pub(super) fn log_density_off_road<P>(model: &MatchModel, point: &TracePoint<P>) -> f64 {
    -(OFF_ROAD_SPREAD * deviation(model, point)).ln()
}

/// Standard deviation of a point, averaged over usual and poor reception.
pub(super) fn deviation<P>(model: &MatchModel, point: &TracePoint<P>) -> f64 {
    model.over_all_time(usual_deviation(model, point))
}

/// Standard deviation of a point in usual reception.
pub(super) fn usual_deviation<P>(model: &MatchModel, point: &TracePoint<P>) -> f64 {
    point.accuracy.unwrap_or(model.noise)
}

/// Sigmoid close to the normal distribution function, with heavier tails.
pub(super) fn share_below(z: f64) -> f64 {
    logistic(SLOPE * z)
}

/// Search for the candidates of a point on roads, which appends their sightings and headings to
/// lists.
pub(super) struct CandidateSearch<'a, P> {
    pub(super) network: &'a RoadNetwork<P>,
    pub(super) model: &'a MatchModel,
    pub(super) point: &'a TracePoint<P>,
    pub(super) sightings: &'a mut Vec<Sighting>,
    pub(super) log_heading_likelihoods: &'a mut Vec<f64>,
}

impl<P: Coordinates> CandidateSearch<'_, P> {
    /// Returns the candidates on the edges near the point, in ascending order of the edges.
    pub(super) fn near(&mut self, index: &EdgeIndex, near: &mut Vec<NearEdge>) -> Vec<Candidate> {
        let reach = 4.0 * deviation(self.model, self.point) + 10.0;
        index.near(self.network, self.point.position, reach, near);
        if near.len() > MOST_CANDIDATES {
            let nearer = |a: &NearEdge, b: &NearEdge| {
                a.metres_off.total_cmp(&b.metres_off).then(a.edge.cmp(&b.edge))
            };
            // Ties go to the lower edge, so that the choice does not depend on the order of the
            // index.
            near.sort_unstable_by(nearer);
            near.truncate(MOST_CANDIDATES);
            near.sort_unstable_by_key(|near| near.edge);
        }
        let on_edge = |near: &NearEdge| self.on_edge(near, heading(near, self.point));
        near.iter().map(on_edge).collect()
    }

    /// Adds the points that vehicles would have reached after `metres` from the previous states,
    /// unless a state is near them already: the position may be far off. The previous states come
    /// with the logarithms of their probabilities.
    pub(super) fn carry(
        &mut self,
        (before, log_filtered): (&[Candidate], &[f64]),
        metres: f64,
        jitter: f64,
        states: &mut Vec<Candidate>,
    ) {
        let near_by = states.len();
        for (from, log) in before.iter().zip(log_filtered) {
            if from.is_off_road() || *log < LEAST_LOG_CARRIED {
                continue;
            }
            let mut ends = [(0, 0.0); CARRIED_WAYS];
            let count = self.ends_of_ways(from.edge as usize, from.along + metres, &mut ends);
            for &(edge, along) in &ends[..count] {
                // Within three standard deviations, the existing state already explains the same
                // positions.
                let is_near = |state: &Candidate| {
                    state.edge as usize == edge && (state.along - along).abs() < 3.0 * jitter
                };
                if !states.iter().any(is_near) && states.len() < near_by + MOST_CARRIED {
                    states.push(self.carried(edge, along));
                }
            }
        }
    }

    /// State at a point of an edge, wherever the position is.
    fn carried(&mut self, edge: usize, along: f64) -> Candidate {
        let place = self.network.position_along(edge, along).to_plane();
        let off = metres_between::<P>(place, self.point.position.to_plane());
        // The place is not the nearest point of its edge, so the whole offset counts as across. No
        // direction is known, so `piece` is zero.
        let near = NearEdge {
            edge,
            metres_along: along,
            metres_off: off,
            across: off,
            beyond: 0.0,
            point: place,
            piece: [0.0; 2],
        };
        self.on_edge(&near, 0.0)
    }

    /// Finds the points `metres` from the start of an edge along all ways without U-turns, as far
    /// as they fit into `ends`. Returns their number.
    fn ends_of_ways(&self, edge: usize, metres: f64, ends: &mut [(usize, f64)]) -> usize {
        let mut open = [(0, 0.0); CARRIED_WAYS];
        (open[0], ends[0]) = ((edge, metres), (edge, 0.0));
        let (mut waiting, mut found, mut visited) = (1, 0, 0);
        // Depth first. Every way in `open` yields at least one end, and ways are only added while
        // `found + waiting` leaves room. So no end of a way in `open` is lost.
        while waiting > 0 {
            waiting -= 1;
            let (edge, metres) = open[waiting];
            let left = metres - self.network.edges()[edge].metres;
            visited += 1;
            let reverse = self.network.reverse(edge);
            let mut next = self.network.next(edge).filter(|next| Some(*next) != reverse).peekable();
            // A way also ends on its present edge at a dead end, or once too many edges were
            // visited.
            if left <= 0.0 || next.peek().is_none() || visited > MOST_VISITED {
                if found < ends.len() {
                    ends[found] = (edge, metres.min(self.network.edges()[edge].metres));
                    found += 1;
                }
                continue;
            }
            for next in next {
                if found + waiting < open.len() {
                    open[waiting] = (next, left);
                    waiting += 1;
                }
            }
        }
        found
    }

    /// Returns the state on an edge near the position, and appends its sighting.
    fn on_edge(&mut self, near: &NearEdge, log_heading_likelihood: f64) -> Candidate {
        let sigma = deviation(self.model, self.point);
        let metres = self.network.edges()[near.edge].metres;
        let (position, scale) = (self.point.position.to_plane(), P::scale(near.point));
        let nearest = P::wrapped(near.point, position);
        let off = [0, 1].map(|axis| scale * (position[axis] - nearest[axis]));
        let length = off[0].hypot(off[1]);
        let tangent = near.direction();
        let is_beside = near.beyond == 0.0;
        // Beside the edge, the direction of the offset is the unit vector across. Beyond an end the
        // offset leans along the edge, and on the line it is zero: there the normal of the piece is
        // taken.
        let normal = if is_beside && length > 0.0 {
            off.map(|metres| metres / length)
        } else {
            [-tangent[1], tangent[0]]
        };
        // Largest probability that a place along is on the edge, namely if its distribution is
        // centred there. A logistic distribution has 2 F(x) − 1 = tanh(x/2) within ±x, here with x
        // = SLOPE · metres / 2σ. Fewer outliers belong to a short edge, just as fewer inliers do.
        let most = (0.25 * SLOPE * metres / sigma).tanh();
        let spread = OUTLIER_SPREAD * sigma;
        // No position is impossible, however far: (1 + r²/s²)^(-3/2), with r = `metres_off` and s =
        // `spread`, has the tail of Cauchy's density in two dimensions.
        let far = 1.0 + (near.metres_off / spread).powi(2);
        let log_outlier = self.model.outliers.ln() + most.ln() - spread.ln() - 1.5 * far.ln();
        self.log_heading_likelihoods.push(log_heading_likelihood);
        self.sightings.push(Sighting {
            normal,
            tangent,
            across: normal[0] * off[0] + normal[1] * off[1],
            along: near.metres_along + near.beyond,
            length: metres,
            is_beside,
            log_outlier,
            outlier: log_outlier.exp(),
        });
        Candidate {
            edge: near.edge as u32,
            along: near.metres_along,
            point: near.point,
            place: EdgeEstimate::default(),
            inlier: 0.0,
        }
    }
}

/// Log-likelihood of the direction of travel on an edge, up to a constant; 0 if it is unknown.
fn heading<P>(near: &NearEdge, point: &TracePoint<P>) -> f64 {
    /// Concentration of directions (von Mises): a standard deviation of 20°. One in ten is
    /// arbitrary.
    const CONCENTRATION: f64 = 8.2;
    const ANY: f64 = 0.1;
    /// Speed below which a receiver's direction carries no information.
    const LEAST_SPEED: f64 = 2.0;
    match point.heading {
        Some(degrees) if point.speed.is_none_or(|speed| speed >= LEAST_SPEED) => {
            let (x, y) = degrees.to_radians().sin_cos();
            let [dx, dy] = near.direction();
            let cosine = x * dx + y * dy;
            // Relative to the density along the road, so the largest value is 1 on every road.
            (ANY + (1.0 - ANY) * (CONCENTRATION * (cosine - 1.0)).exp()).ln()
        }
        _ => 0.0,
    }
}

/// Metres between two points of the plane.
pub(super) fn metres_between<P: Coordinates>(a: [f64; 2], b: [f64; 2]) -> f64 {
    let b = P::wrapped(b, a);
    let middle = [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])];
    let [x, y] = [a[0] - b[0], a[1] - b[1]];
    // Coordinates are below 1e9: squares are in range.
    (x * x + y * y).sqrt() * P::scale(middle)
}
