//! What the sensor is by definition, and what it is tried on.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::observation::{AppearanceLikelihood, Offsets, Spread};
use wayfix::{Belief, DenseTransition, Fixed, Hmm, InferenceError, Likelihood, Prior};

use crate::kit::{NEVER, log_sum};

pub(super) const INF: f32 = f32::INFINITY;

// ---- By definition.

pub(super) fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

pub(super) fn deviation(values: &[f64]) -> f64 {
    let mean = mean(values);
    let squares: Vec<f64> = values.iter().map(|v| (v - mean).powi(2)).collect();
    squares.iter().sum::<f64>().sqrt() / (values.len() as f64).sqrt()
}

/// Distances to scores, each with a window of its own.
pub(super) fn scores(spread: Spread, row: &[f32]) -> Vec<f64> {
    let n = row.len();
    let near = |i: usize, j: usize| match spread {
        Spread::Local { radius, closed } => {
            let apart = i.abs_diff(j);
            apart <= radius || (closed && n - apart <= radius)
        }
        _ => true,
    };
    let score = |i: usize| {
        if row[i].is_infinite() {
            return f64::INFINITY;
        }
        let window = (0..n).filter(|j| near(i, *j) && row[*j].is_finite());
        let window: Vec<f64> = window.map(|j| f64::from(row[j])).collect();
        let centred = f64::from(row[i]) - mean(&window);
        if window.iter().all(|d| *d == window[0]) {
            return 0.0;
        }
        match spread {
            Spread::Fixed(unit) => centred / unit,
            _ => centred / deviation(&window),
        }
    };
    (0..n).map(score).collect()
}

/// What a sensor is made of.
#[derive(Debug, Clone)]
pub(super) struct Plan {
    pub(super) spread: Spread,
    pub(super) temperature: f64,
    pub(super) off_map: Option<f64>,
    /// Rows for offsets, with their prior count, and which offsets.
    pub(super) seen: Option<(Vec<Vec<f32>>, f64, Offsets)>,
}

impl Plan {
    pub(super) fn new(spread: Spread) -> Self {
        Self { spread, temperature: 1.0, off_map: None, seen: None }
    }

    pub(super) fn sensor(&self, n: usize) -> AppearanceLikelihood {
        let sensor = AppearanceLikelihood::new(n).unwrap().with_spread(self.spread).unwrap();
        let sensor = match &self.seen {
            Some((rows, count, which)) => sensor.with_offsets(*which, rows, *count).unwrap(),
            None => sensor,
        };
        let sensor = sensor.with_temperature(self.temperature).unwrap();
        match self.off_map {
            Some(rank) => sensor.with_off_map(rank).unwrap(),
            None => sensor,
        }
    }

    /// Scores less offsets.
    pub(super) fn scores(&self, row: &[f32]) -> Vec<f64> {
        let mut z = scores(self.spread, row);
        if let Some((rows, count, which)) = &self.seen {
            for (i, z) in z.iter_mut().enumerate() {
                let seen = rows.iter().map(|row| scores(self.spread, row)[i]);
                let seen: Vec<f64> = seen.filter(|z| z.is_finite()).collect();
                let times = seen.len() as f64 + count;
                let offset = if times > 0.0 { seen.iter().sum::<f64>() / times } else { 0.0 };
                *z -= if *which == Offsets::Hubs && offset > 0.0 { 0.0 } else { offset };
            }
        }
        z
    }

    /// Scores of all states, with the rank of the last one rounded like this.
    pub(super) fn states(&self, row: &[f32], round: fn(f64) -> f64) -> Vec<f64> {
        let mut z = self.scores(row);
        if let Some(rank) = self.off_map {
            let mut order: Vec<f64> = z.clone();
            order.sort_by(f64::total_cmp);
            let finite = order.iter().filter(|z| z.is_finite()).count();
            let at = round(rank * (finite - 1) as f64) as usize;
            z.push(order[at]);
        }
        z
    }

    /// ln b of each state.
    pub(super) fn logs(&self, row: &[f32], round: fn(f64) -> f64) -> Vec<f64> {
        let references = row.len();
        if row.iter().all(|d| d.is_infinite()) {
            return [vec![NEVER; references], vec![0.0]].concat(); // off the map
        }
        let z = self.states(row, round);
        // From the best on, so that small differences of large scores stay.
        let best = z.iter().copied().fold(f64::INFINITY, f64::min);
        let logs: Vec<f64> = z.iter().map(|z| (best - z) / self.temperature).collect();
        let mean = log_sum(logs[..references].iter().copied()) - (references as f64).ln();
        logs.iter().map(|log| log - mean).collect()
    }
}

/// A model that stays where it is.
pub(super) fn stays<B: Likelihood>(prior: &[f64], sensor: B) -> Hmm<DenseTransition, B> {
    let n = prior.len();
    let stay = DenseTransition::from_fn(n, |to, from| f64::from(u8::from(to == from))).unwrap();
    let prior = Prior::AtFirstObservation(Belief::from_weights(prior.to_vec()).unwrap());
    Hmm::new(prior, stay, sensor).unwrap()
}

/// A model in which every step is independent of all others.
pub(super) fn independent<B: Likelihood>(p: &[f64], sensor: B) -> Hmm<Fixed<DenseTransition>, B> {
    let motion = DenseTransition::from_fn(p.len(), |to, _| p[to]).unwrap();
    let prior = Prior::AtFirstObservation(Belief::new(p.to_vec()).unwrap());
    Hmm::new(prior, Fixed(motion), sensor).unwrap()
}

pub(super) fn normalized(weights: &[f64]) -> Vec<f64> {
    let sum: f64 = weights.iter().sum();
    weights.iter().map(|w| w / sum).collect()
}

/// One step from this prior: whether ln p and posterior are these.
pub(super) fn agrees(
    found: &Result<(f64, Vec<f64>), InferenceError>,
    prior: &[f64],
    logs: &[f64],
) -> Result<(), String> {
    let joint: Vec<f64> = normalized(prior).iter().zip(logs).map(|(p, log)| p.ln() + log).collect();
    let sum = log_sum(joint.iter().copied());
    if sum == NEVER {
        return match found {
            Err(InferenceError::Impossible { step: 1 }) => Ok(()),
            other => Err(format!("{other:?}, expected impossible")),
        };
    }
    let (log, posterior) =
        found.as_ref().map_err(|error| format!("{error:?}, expected ln p {sum}"))?;
    let size =
        logs.iter().filter(|log| log.is_finite()).fold(1.0, |most: f64, log| most.max(log.abs()));
    let tolerance = 1e-9 + 1e-11 * size;
    let off = |by: f64, most: f64| by.is_nan() || by.abs() > most;
    if off(log - sum, tolerance) {
        return Err(format!("ln p {log}, expected {sum}"));
    }
    for (i, (p, joint)) in posterior.iter().zip(&joint).enumerate() {
        let expected = (joint - sum).exp();
        let wrong = off(p - expected, tolerance * expected.max(1e-300));
        let lost = joint - sum < -700.0 && *p < 1e-300; // rounded tails
        if (wrong && !lost) || (*joint == NEVER && *p != 0.0) {
            return Err(format!("p({i}) = {p}, expected {expected}"));
        }
    }
    Ok(())
}

pub(super) fn step<B: Likelihood>(
    prior: &[f64],
    sensor: B,
    y: &B::Observation,
) -> Result<(f64, Vec<f64>), InferenceError> {
    let hmm = stays(prior, sensor);
    let mut filter = hmm.filter();
    let log = filter.step(y)?;
    assert_eq!(log.to_bits(), filter.log_likelihood().to_bits());
    Ok((log, filter.belief().as_slice().to_vec()))
}

/// Distances of one row, of several kinds; infinite ones among them.
pub(super) fn row(n: usize) -> impl Strategy<Value = Vec<f32>> {
    let wild = (-38..38_i32, -9.9_f32..9.9).prop_map(|(e, m)| m * 10_f32.powi(e));
    let kind = prop_oneof![
        3 => vec(0.0_f32..1.0, n),
        2 => vec((0..3_u8).prop_map(f32::from), n),
        1 => (-1e6_f32..1e6).prop_map(move |d| vec![d; n]),
        1 => vec((0.0_f32..1.0).prop_map(|d| 1e3 + d), n),
        1 => vec(-1.0_f32..0.0, n),
        1 => vec(wild, n),
        // A few that stand out among equal ones.
        1 => vec(prop_oneof![5 => Just(0.1_f32), 1 => Just(0.7), 1 => Just(1e4)], n),
        1 => vec(prop_oneof![Just(f32::MAX), Just(f32::MIN), Just(1e-45_f32), Just(0.0)], n),
    ];
    let holes = prop_oneof![
        3 => Just(vec![false; n]),
        1 => vec(prop::bool::weighted(0.3), n),
    ];
    (kind, holes, 0..n).prop_map(|(mut row, holes, kept)| {
        for (i, hole) in holes.iter().enumerate() {
            if *hole && i != kept {
                row[i] = INF;
            }
        }
        row
    })
}

pub(super) fn spread() -> impl Strategy<Value = Spread> {
    prop_oneof![
        2 => Just(Spread::Query),
        3 => (1..15_usize, any::<bool>())
            .prop_map(|(radius, closed)| Spread::Local { radius, closed }),
        2 => (-3.0..3.0).prop_map(|e| Spread::Fixed(10_f64.powf(e))),
    ]
}

/// Either kind of offsets.
pub(super) fn offsets() -> impl Strategy<Value = Offsets> {
    prop_oneof![Just(Offsets::Hubs), Just(Offsets::All)]
}
