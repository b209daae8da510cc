//! Stand-in: single-image matching, with no model yet.

use std::error::Error;
use std::ops::Range;

use super::recording::{Answers, Recording};

/// What to learn from, and how to answer.
pub(crate) struct Settings {
    /// The steps whose truth may be used: in order, apart from each other.
    pub(crate) fit_on: Vec<Range<usize>>,
    /// How many steps later a fixed-lag answer is due.
    pub(crate) lag: usize,
    /// Model places that are not on the map.
    pub(crate) off_map: bool,
    /// In references.
    pub(crate) tolerances: Vec<usize>,
}

/// What the methods say.
pub(crate) struct Estimates {
    pub(crate) answers: Vec<Answers>,
    /// Smoothed, T × n.
    pub(crate) belief: Vec<f32>,
    /// For each lag, the place at each step.
    pub(crate) lags: Vec<(usize, Vec<Option<usize>>)>,
    /// What to print beside the results.
    pub(crate) notes: Vec<String>,
}

pub(crate) fn estimate(
    recording: &Recording,
    settings: &Settings,
) -> Result<Estimates, Box<dyn Error>> {
    let n = recording.references;
    let mut single = Answers {
        method: "single".into(),
        places: Vec::new(),
        confidence: Vec::new(),
        probability: Some(vec![Vec::new(); settings.tolerances.len()]),
        truth_mass: Some(vec![Vec::new(); settings.tolerances.len()]),
        on_map: settings.off_map.then(Vec::new),
    };
    let mut belief = Vec::with_capacity(recording.distances.len());
    for step in 0..recording.steps() {
        let row = recording.row(step);
        let mean = row.iter().sum::<f32>() / n as f32;
        let square = row.iter().map(|d| (d - mean).powi(2)).sum::<f32>() / n as f32;
        let scale = if square == 0.0 { 0.0 } else { 2.0 / square.sqrt() };
        let least = row.iter().copied().fold(f32::INFINITY, f32::min);
        let weights: Vec<f32> = row.iter().map(|d| (scale * (least - d)).exp()).collect();
        let sum: f32 = weights.iter().sum();
        let place = row.iter().position(|d| *d == least).ok_or("no references")?;
        single.places.push(Some(place));
        single.confidence.push(f64::from(-least));
        if let (Some(probability), Some(mass)) = (&mut single.probability, &mut single.truth_mass) {
            for (at, &tolerance) in settings.tolerances.iter().enumerate() {
                let near = |i: usize| i.abs_diff(place) <= tolerance;
                let sum_of = |right: &dyn Fn(usize) -> bool| {
                    let right = weights.iter().enumerate().filter(|(i, _)| right(*i));
                    f64::from(right.map(|(_, w)| w / sum).sum::<f32>())
                };
                probability[at].push(sum_of(&near));
                mass[at].push(sum_of(&|i| recording.is_right(step, Some(i), tolerance)));
            }
        }
        if let Some(on_map) = &mut single.on_map {
            on_map.push(f64::from((-least).exp()));
        }
        belief.extend(weights.iter().map(|w| w / sum));
    }
    let lags = [0, settings.lag].map(|lag| (lag, single.places.clone())).to_vec();
    let odometry = if recording.odometry.is_some() { "with" } else { "without" };
    let learned = &settings.fit_on;
    let notes =
        vec![format!("A stand-in: nothing is learned on {learned:?}, {odometry} odometry.")];
    Ok(Estimates { answers: vec![single], belief, lags, notes })
}
