//! Answers for one point of a drive.

use super::MatchError;
use super::candidates::{Candidate, OFF_ROAD};
use crate::error::Parameter;
use crate::map::RoadNetwork;

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

/// Probabilities of edges, and off the road: (edge, probability, metres along at the most probable
/// state, probability of that state).
pub(super) fn by_edge(states: &[Candidate], probabilities: &[f64]) -> Vec<(u32, f64, f64, f64)> {
    let mut edges: Vec<(u32, f64, f64, f64)> = Vec::with_capacity(states.len());
    for (state, &p) in states.iter().zip(probabilities) {
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

/// Part of an edge where the vehicle may be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CredibleStretch {
    /// Index of the edge.
    pub edge: usize,
    /// Metres from the start of the edge to both ends of the part.
    pub metres: [f64; 2],
    /// Probability of the edge.
    pub probability: f64,
}

/// Stretches of roads that hold a vehicle with a probability.
#[derive(Debug, Clone, PartialEq)]
pub struct CredibleStretches {
    stretches: Vec<CredibleStretch>,
    probability: f64,
}

impl CredibleStretches {
    /// Stretches, one an edge, that of the most probable state first.
    #[must_use]
    pub fn stretches(&self) -> &[CredibleStretch] {
        &self.stretches
    }

    /// Probability that the vehicle is on one of the stretches: at least the mass that was asked
    /// for, or, if that is less, the probability that it is on a road at all.
    #[must_use]
    pub fn probability(&self) -> f64 {
        self.probability
    }
}

/// Stretches of roads that hold the vehicle with a probability of at least `mass`: those of the
/// most probable states, each as long as the noise along the road asks. Where the roads hold less,
/// all of their edges.
pub(super) fn credible<P>(
    network: &RoadNetwork<P>,
    states: &[Candidate],
    probabilities: &[f64],
    sigma: f64,
    mass: f64,
) -> Result<CredibleStretches, MatchError> {
    if !(mass > 0.0 && mass <= 1.0) {
        let expected = "a probability above 0 and at most 1";
        return Err(Parameter::new("the mass", mass, expected).into());
    }
    let is_possible = |&i: &usize| !states[i].is_off_road() && probabilities[i] > 0.0;
    let mut order: Vec<usize> = (0..states.len()).filter(is_possible).collect();
    order.sort_by(|&a, &b| probabilities[b].total_cmp(&probabilities[a]));
    let on_road = order.iter().map(|&i| probabilities[i]).sum::<f64>();
    let (share, mass_along) = if mass < on_road {
        // Half of the doubt is about the road, half about the place along it.
        ((mass * on_road).sqrt(), (mass / on_road).sqrt())
    } else {
        (f64::INFINITY, 1.0)
    };
    let half = sigma * ((1.0 + mass_along) / (1.0 - mass_along)).ln() / 1.702;
    let (mut stretches, mut sum): (Vec<CredibleStretch>, f64) = (Vec::new(), 0.0);
    for i in order {
        if sum >= share {
            break;
        }
        let (edge, probability) = (states[i].edge as usize, probabilities[i]);
        sum += probability;
        let most = network.edges()[edge].metres;
        let along = states[i].along.min(most);
        let metres = [(along - half).max(0.0), (along + half).min(most)];
        match stretches.iter_mut().find(|part| part.edge == edge) {
            Some(part) => {
                part.metres = [part.metres[0].min(metres[0]), part.metres[1].max(metres[1])];
                part.probability += probability;
            }
            None => stretches.push(CredibleStretch { edge, metres, probability }),
        }
    }
    let probability = (sum * mass_along).max(mass.min(on_road)).min(1.0);
    Ok(CredibleStretches { stretches, probability })
}

/// Edges with their probabilities, the most probable first, without those off the road.
pub(super) fn edges(states: &[Candidate], probabilities: &[f64]) -> Vec<(usize, f64)> {
    let edges = by_edge(states, probabilities);
    let on_road = edges.iter().filter(|entry| entry.0 != OFF_ROAD);
    let mut edges: Vec<_> = on_road.map(|entry| (entry.0 as usize, entry.1)).collect();
    edges.sort_by(|a, b| b.1.total_cmp(&a.1));
    edges
}
