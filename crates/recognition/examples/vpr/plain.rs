//! A plain hidden Markov model of thirty lines as a baseline. Its states are the references.

use std::ops::Range;

use wayfix::transition::WindowTransition;
use wayfix::{Belief, Hmm, LikelihoodVector, Prior};

use super::{Fallible, Recording, Task};

/// Probabilities of moving by −1 to +3 references a step: one is usual if both passes were filmed
/// alike; the others keep the model from losing a vehicle that drives slower, faster or backwards.
const MOVES: (isize, [f64; 5]) = (-1, [0.05, 0.15, 0.5, 0.2, 0.1]);
/// Temperature without a labelled part, and those to try with one.
const TEMPERATURE: f64 = 0.5;
const TEMPERATURES: [f64; 11] = [4.0, 2.8, 2.0, 1.4, 1.0, 0.7, 0.5, 0.35, 0.25, 0.18, 0.12];
/// Log-likelihood of an infinite distance: finite, since a random walk that is ruled out everywhere
/// could not go on.
const NEVER: f64 = -700.0;

pub(crate) fn model(recording: &Recording) -> Fallible<Hmm<WindowTransition, LikelihoodVector>> {
    let n = recording.references;
    let window = if recording.closed { WindowTransition::closed } else { WindowTransition::open };
    let motion = window(n, MOVES.0, &MOVES.1)?;
    let prior = Prior::AtFirstObservation(Belief::uniform(n)?);
    Ok(Hmm::new(prior, motion, LikelihoodVector::log(n))?)
}

/// Log-likelihoods of each step: a softmax of the distances, standardised in each row.
pub(crate) fn log_likelihoods(recording: &Recording, temperature: f64) -> Vec<Vec<f64>> {
    let of_row = |row: &[f32]| -> Vec<f64> {
        let finite = row.iter().filter(|d| d.is_finite()).map(|d| f64::from(*d));
        let (count, sum) = finite.clone().fold((0.0, 0.0), |(n, sum), d| (n + 1.0, sum + d));
        let mean = sum / count;
        let scale = temperature * (finite.map(|d| (d - mean).powi(2)).sum::<f64>() / count).sqrt();
        let log = |d: &f32| ((mean - f64::from(*d)) / scale).max(NEVER);
        // A row of equal distances says nothing.
        row.iter().map(|d| if scale > 0.0 { log(d) } else { 0.0 }).collect()
    };
    recording.distances.chunks_exact(recording.references).map(of_row).collect()
}

/// Chooses the temperature with the best log score of the filter on the labelled part, over the
/// right places and those next to them; steps off the map do not count.
pub(crate) fn temperature(Task { recording, split, .. }: Task<'_>) -> Fallible<f64> {
    let (hmm, mut best) = (model(recording)?, (f64::NEG_INFINITY, TEMPERATURE));
    let labelled = recording.truth.iter().filter(|_| !split.fit_on.is_empty());
    for (truth, temperature) in labelled.flat_map(|truth| TEMPERATURES.map(|t| (truth, t))) {
        let (logs, mut score) = (log_likelihoods(recording, temperature), 0.0);
        for Range { start, end } in split.fit_on.clone() {
            let mut filter = hmm.filter();
            for (label, logs) in truth[start..end].iter().zip(&logs[start..end]) {
                filter.step(logs)?;
                let mass = recording.mass(filter.belief().as_slice(), label, 1);
                // Bounded below, so that one lost step does not rule a temperature out.
                score += label.as_ref().map_or(0.0, |_| mass.max(f64::MIN_POSITIVE).ln());
            }
        }
        best = if score > best.0 { (score, temperature) } else { best };
    }
    Ok(best.1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clear_drive_is_followed() {
        // A stop, and an image that matches nothing.
        let places = [3, 4, 5, 5, 6, 7, 8, 9];
        let seen = |at: usize| (at % 3) as f32 + if at % 12 == places[at / 12] { 0.0 } else { 9.0 };
        let mut distances: Vec<f32> = (0..96).map(seen).collect();
        distances[48..60].fill(f32::INFINITY);
        let recording = Recording { references: 12, distances, ..Recording::default() };
        let logs = log_likelihoods(&recording, TEMPERATURE);
        let smoothed = model(&recording).unwrap().smooth(&logs).unwrap();
        assert_eq!((&logs[4][..], smoothed.posteriors().modes()), (&[0.0; 12][..], places.into()));
    }
}
