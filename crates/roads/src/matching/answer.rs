//! Answers: the road at a point of a drive, and stretches of road with a probability.
//!
//! Several states may lie on one edge, such as those that continued unseen. Answers are about
//! edges, so their probabilities are added up first.

use super::MatchError;
use super::candidates::{Candidate, OFF_ROAD};
use crate::RoadNetwork;
use wayfix::error::OutOfRange;
use wayfix::map::{Coordinates, Position};

/// The road that a vehicle was on at a point of its drive, with its probability.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RoadAnswer {
    /// Most probable edge; `None` off the road.
    pub edge: Option<usize>,
    /// Metres from the start of the edge, at the most probable point; 0 off the road.
    pub metres_along: f64,
    /// Probability of the edge, or of being off the road.
    pub probability: f64,
    /// Entropy of the distribution over edges and off the road, in nats.
    pub entropy: f64,
    /// Probability of being off the road.
    pub off_road: f64,
}

/// Probabilities of edges and of being off the road, as (edge, probability, metres along at the
/// most probable state, probability of that state).
pub(super) fn by_edge(states: &[Candidate], probabilities: &[f64]) -> Vec<(u32, f64, f64, f64)> {
    let mut edges: Vec<(u32, f64, f64, f64)> = Vec::with_capacity(states.len());
    for (state, &p) in states.iter().zip(probabilities) {
        // Linear search: there are at most some eighty states.
        match edges.iter_mut().find(|entry| entry.0 == state.edge) {
            Some(entry) => {
                entry.1 += p;
                if p > entry.3 {
                    (entry.2, entry.3) = (state.along, p);
                }
            }
            None => edges.push((state.edge, p, state.along, p)),
        }
    }
    edges
}

impl RoadAnswer {
    pub(super) fn new(states: &[Candidate], probabilities: &[f64]) -> Self {
        let edges = by_edge(states, probabilities);
        let mut best = (OFF_ROAD, f64::NEG_INFINITY, 0.0);
        let (mut entropy, mut off_road) = (0.0, 0.0);
        for &(edge, p, along, _) in &edges {
            if p > best.1 {
                best = (edge, p, along);
            }
            if p > 0.0 {
                entropy -= p * p.ln();
            }
            if edge == OFF_ROAD {
                off_road = p;
            }
        }
        let (edge, probability, metres_along) = best;
        let edge = (edge != OFF_ROAD).then_some(edge as usize);
        Self { edge, metres_along, probability, entropy, off_road }
    }
}

/// Part of a route: all or part of an edge, or a stretch off the road.
///
/// Stretches of a route on roads are longer than 0 m, with two exceptions: the route of a vehicle
/// that was stationary throughout, which is one edge, and an edge followed by its reverse in place
/// of a forbidden turn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stretch<P = Position> {
    /// The edge; `None` off the road.
    pub edge: Option<usize>,
    /// Metres from the start of the edge to where the stretch begins; 0 off the road.
    pub enter: f64,
    /// Metres from the start of the edge to where the stretch ends; off the road, the straight
    /// distance between both ends.
    pub exit: f64,
    /// Positions of both ends.
    pub ends: [P; 2],
}

impl<P> Stretch<P> {
    /// Length in metres; off the road, of the straight line.
    #[must_use]
    pub fn metres(&self) -> f64 {
        self.exit - self.enter
    }
}

/// Stretches of road with a probability: a route, or the stretches where a vehicle may be.
#[derive(Debug, Clone, PartialEq)]
pub struct Stretches<P = Position> {
    /// Stretches of a route, in order; or those that hold a vehicle, one per edge, starting with
    /// that of the most probable state.
    pub stretches: Vec<Stretch<P>>,
    /// Probability of each stretch that holds a vehicle; empty for a route.
    pub probabilities: Vec<f64>,
    /// Probability of the route, or that the vehicle is on one of the stretches.
    pub probability: f64,
}

/// Stretches of road that hold the vehicle with a probability of at least `mass`: those of the most
/// probable states, each as long as the noise along the road requires; all possible edges if the
/// roads hold less.
pub(super) fn credible<P: Coordinates>(
    network: &RoadNetwork<P>,
    states: &[Candidate],
    probabilities: &[f64],
    sigma: f64,
    mass: f64,
) -> Result<Stretches<P>, MatchError> {
    if !(mass > 0.0 && mass <= 1.0) {
        let expected = "a probability above 0 and at most 1";
        return Err(OutOfRange::new("the mass", mass, expected).into());
    }
    let states = states.iter().zip(probabilities);
    let is_possible = |(state, p): &(&Candidate, &f64)| !state.is_off_road() && **p > 0.0;
    let mut possible: Vec<(&Candidate, f64)> =
        states.filter(is_possible).map(|(state, p)| (state, *p)).collect();
    possible.sort_by(|a, b| b.1.total_cmp(&a.1));
    let on_road = possible.iter().map(|state| state.1).sum::<f64>();
    // The states taken hold `share` of the belief, and each stretch holds `mass_along` of its
    // state: together they hold share · mass_along = mass.
    let (share, mass_along) = if mass < on_road {
        // Relative to `on_road`, both factors are the same: half of the doubt is about the road,
        // half about the place along it.
        ((mass * on_road).sqrt(), (mass / on_road).sqrt())
    } else {
        (f64::INFINITY, 1.0)
    };
    // A logistic distribution of slope 1.702 / σ holds m within ±h if h =
    // σ / 1.702 · ln ((1 + m) / (1 − m)). For m = 1 this is infinite, and the stretch ends where
    // the edge does.
    let half = sigma * ((1.0 + mass_along) / (1.0 - mass_along)).ln() / 1.702;
    let (mut stretches, mut probabilities): (Vec<Stretch<P>>, Vec<f64>) = Default::default();
    let mut sum = 0.0;
    for (state, probability) in possible {
        if sum >= share {
            break;
        }
        sum += probability;
        let edge = state.edge as usize;
        let most = network.edges()[edge].metres;
        let along = state.along.min(most);
        let (mut enter, mut exit) = ((along - half).max(0.0), (along + half).min(most));
        let place = stretches.iter().position(|part| part.edge == Some(edge));
        if let Some(part) = place.map(|place| &stretches[place]) {
            (enter, exit) = (part.enter.min(enter), part.exit.max(exit));
        }
        let ends = [enter, exit].map(|along| network.position_along(edge, along));
        let stretch = Stretch { edge: Some(edge), enter, exit, ends };
        if let Some(place) = place {
            stretches[place] = stretch;
            probabilities[place] += probability;
        } else {
            stretches.push(stretch);
            probabilities.push(probability);
        }
    }
    let probability = (sum * mass_along).max(mass.min(on_road)).min(1.0);
    Ok(Stretches { stretches, probabilities, probability })
}

/// Edges with their probabilities, most probable first, without the state off the road.
pub(super) fn edges(states: &[Candidate], probabilities: &[f64]) -> Vec<(usize, f64)> {
    let edges = by_edge(states, probabilities);
    let on_road = edges.iter().filter(|entry| entry.0 != OFF_ROAD);
    let mut edges: Vec<_> = on_road.map(|entry| (entry.0 as usize, entry.1)).collect();
    edges.sort_by(|a, b| b.1.total_cmp(&a.1));
    edges
}
