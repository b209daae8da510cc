//! Random small models and observations.

use wayfix::{Belief, Hmm, LikelihoodVector, OptionalLikelihood, Prior, Transition};

use crate::draw::Draw;

/// `matrix[to][from]`.
pub(crate) type Matrix = Vec<Vec<f64>>;
/// Likelihoods or their logarithms, or nothing.
pub(crate) type Observation = Option<Vec<f64>>;
pub(crate) type Sensor = OptionalLikelihood<LikelihoodVector<Vec<f64>>>;

/// Range of the numbers of a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Range {
    /// Zeros and ordinary numbers, which the fast routines hold.
    Plain,
    /// Also numbers outside that range.
    Wide,
}

/// A model without its transitions.
#[derive(Debug)]
pub(crate) struct Scene {
    pub(crate) states: usize,
    pub(crate) range: Range,
    pub(crate) at_first: bool,
    pub(crate) prior: Vec<f64>,
    /// True if observations are logarithms.
    pub(crate) logs: bool,
    pub(crate) drives: Vec<Vec<Observation>>,
}

/// A weight of a distribution.
pub(crate) fn weight(draw: &mut Draw<'_>, range: Range) -> f64 {
    match (draw.below(8), range) {
        (0..=3, _) | (7, Range::Plain) => draw.unit(),
        (4..=6, _) => 0.0,
        (_, Range::Wide) => draw.pick(&[1e-300, 1e-150, 1e-30, 1e-9, 1e-12, 1e-200]),
        (_, Range::Plain) => 1.0,
    }
}

impl Scene {
    pub(crate) fn draw(draw: &mut Draw<'_>, states: usize) -> Self {
        let range = draw.pick(&[Range::Plain, Range::Wide]);
        let (at_first, logs) = (draw.one_in(2), draw.one_in(2));
        let prior = draw.distribution(states, |draw| weight(draw, range));
        // Few different observations, so that bytes last for long drives.
        let pool: Vec<Observation> =
            (0..=draw.below(8)).map(|_| observation(draw, states, range, logs)).collect();
        let drives = (0..draw.below(21)).map(|_| {
            let steps = match draw.below(16) {
                15 => draw.below(260),
                12..=14 => draw.below(40),
                _ => draw.below(12),
            };
            (0..steps).map(|_| pool[draw.below(pool.len())].clone()).collect()
        });
        let drives = drives.collect();
        Self { states, range, at_first, prior, logs, drives }
    }

    pub(crate) fn prior(&self) -> Prior {
        let belief = Belief::new(self.prior.clone()).expect("a distribution");
        if self.at_first {
            Prior::AtFirstObservation(belief)
        } else {
            Prior::BeforeFirstTransition(belief)
        }
    }

    pub(crate) fn sensor(&self) -> Sensor {
        let sensor = if self.logs { LikelihoodVector::log } else { LikelihoodVector::linear };
        OptionalLikelihood::new(sensor(self.states).owned())
    }

    pub(crate) fn hmm<A: Transition>(&self, transition: A) -> Hmm<A, Sensor> {
        Hmm::new(self.prior(), transition, self.sensor()).expect("a valid model")
    }

    /// The log-likelihoods of an observation, or `None` if it is not valid.
    pub(crate) fn logs(&self, observation: &Observation) -> Option<Vec<f64>> {
        let Some(values) = observation else { return Some(vec![0.0; self.states]) };
        let valid = |value: &f64| {
            if self.logs { *value <= 1e300 } else { (0.0..=f64::MAX).contains(value) }
        };
        let log = |value: &f64| if self.logs { *value } else { value.ln() };
        (values.len() == self.states && values.iter().all(valid))
            .then(|| values.iter().map(log).collect())
    }
}

fn observation(draw: &mut Draw<'_>, states: usize, range: Range, logs: bool) -> Observation {
    let kind = draw.below(32);
    if kind == 31 {
        return None;
    }
    let mut values: Vec<f64> = if logs {
        let shift = draw.pick(&[0.0, 0.0, -400.0, -1e5, 700.0]);
        (0..states).map(|_| log_likelihood(draw, range) + shift).collect()
    } else {
        let scale = draw.pick(&[1.0, 1.0, 1e-200, 1e-100, 1e200]);
        (0..states).map(|_| likelihood(draw, range) * scale).collect()
    };
    match kind {
        30 => values.fill(if logs { f64::NEG_INFINITY } else { 0.0 }),
        29 if range == Range::Wide => {
            let at = draw.below(states);
            values[at] = draw.pick(&[f64::NAN, f64::INFINITY]);
        }
        28 if range == Range::Wide => values.truncate(states - 1),
        _ => {}
    }
    Some(values)
}

fn log_likelihood(draw: &mut Draw<'_>, range: Range) -> f64 {
    match (draw.below(8), range) {
        (6, _) => f64::NEG_INFINITY,
        (7, Range::Wide) => match draw.below(3) {
            0 => draw.unit() * 4000.0 - 2000.0,
            1 => draw.pick(&[-746.0, -740.0, -800.0, -1500.0, 750.0, -709.0]),
            _ => -1000.0 * draw.unit(),
        },
        _ => draw.unit().ln(),
    }
}

fn likelihood(draw: &mut Draw<'_>, range: Range) -> f64 {
    match (draw.below(8), range) {
        (6, _) => 0.0,
        (7, Range::Wide) => {
            draw.pick(&[1e-300, 1e-290, f64::MIN_POSITIVE, 5e-324, 1e-310, 1e-160, 1e-30, 1e100])
        }
        _ => draw.unit(),
    }
}
