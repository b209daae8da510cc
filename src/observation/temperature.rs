//! Fitting the temperature: the weight of distances as evidence.

use std::error::Error;

use super::ObservationError;
use super::appearance::{AppearanceLikelihood, TEMPERATURES};
use crate::kernels;
use crate::likelihood::LearnLikelihood;
use crate::likelihood::Scratch;

/// Candidate factors of 1/τ in a re-estimation: coarse steps to come near, fine ones to arrive.
const FACTORS: [f64; 13] = [1.0, 0.99, 1.01, 0.96, 1.04, 0.9, 1.1, 0.8, 1.25, 0.5, 2.0, 0.25, 4.0];

impl AppearanceLikelihood {
    /// Learns the temperature that makes labelled queries most probable, each on
    /// its own: `places[k]` is the reference that `rows[k]` shows, or `None` for a row to be left
    /// out. It maximises Σ ln (b_place / Σ_i b_i), a concave function of 1/τ. O(n) a row and
    /// iteration, of which there are some 60.
    ///
    /// A state off the map takes no part.
    ///
    /// In sequence this is still too cold, since the errors of one frame repeat in the next;
    /// [`calibrate`](super::calibrate) accounts for that.
    ///
    /// # Errors
    ///
    /// [`ObservationError`] if a row is not valid, a place does not exist or is
    /// infinitely far, or nothing is labelled; and
    /// [`ObservationError::Unbounded`] if no temperature is best: every label is
    /// the best match, say, or none is better than the mean.
    pub fn with_learned_temperature<R: AsRef<[f32]>>(
        self,
        rows: &[R],
        places: &[Option<usize>],
    ) -> Result<Self, ObservationError> {
        let temperature = most_likely(&self, rows, places)?;
        self.with_temperature(temperature)
    }
}

/// The temperature of [`AppearanceLikelihood::with_learned_temperature`].
pub(super) fn most_likely<R: AsRef<[f32]>>(
    sensor: &AppearanceLikelihood,
    rows: &[R],
    places: &[Option<usize>],
) -> Result<f64, ObservationError> {
    if rows.len() != places.len() {
        return Err(ObservationError::Labels { labels: places.len(), rows: rows.len() });
    }
    let references = sensor.references();
    let mut memory = Scratch::default();
    let mut labelled = Vec::new();
    for (row, (distances, place)) in rows.iter().zip(places).enumerate() {
        let Some(place) = *place else { continue };
        let mut scores = vec![0.0; references];
        sensor.scores(distances.as_ref(), &mut scores, &mut memory)?;
        // Relative to the best score, which is then 0, so that ties with it stay ties.
        let least = scores.iter().copied().fold(f64::INFINITY, f64::min);
        scores.iter_mut().for_each(|z| *z -= least);
        match scores.get(place) {
            Some(score) if score.is_finite() => labelled.push((*score, scores)),
            _ => return Err(ObservationError::Label { row, place, references }),
        }
    }
    if labelled.is_empty() {
        return Err(ObservationError::Unlabelled { rows: rows.len() });
    }
    // d/dβ of Σ ln (exp(−β z_place) / Σ exp(−β z_i)) falls with β.
    let slope = |beta: f64| -> f64 {
        labelled.iter().map(|(label, scores)| moments(scores, beta)[0] - label).sum()
    };
    let (mut low, mut high) = TEMPERATURES.into_inner();
    if slope(low) < 0.0 {
        return Err(ObservationError::Unbounded { trend: "hotter" });
    }
    if slope(high) >= 0.0 {
        return Err(ObservationError::Unbounded { trend: "colder" });
    }
    loop {
        let middle = (low * high).sqrt();
        if middle <= low || middle >= high {
            return Ok(1.0 / middle);
        }
        if slope(middle) > 0.0 { low = middle } else { high = middle }
    }
}

/// Mean and variance of scores whose least is 0, under weights exp(−β z).
fn moments(scores: &[f64], beta: f64) -> [f64; 2] {
    let finite = scores.iter().filter(|z| z.is_finite());
    let [weights, sum, squares] = finite.fold([0.0; 3], |[weights, sum, squares], z| {
        let weight = (-beta * z).exp();
        [weights + weight, sum + weight * z, squares + weight * z * z]
    });
    let mean = sum / weights;
    [mean, squares / weights - mean * mean]
}

/// Learns the temperature alone: 1/τ maximises
/// Σ over rows of (−E\[z\]/τ − ln mean exp(−z/τ)), where E is under the posterior
/// of the places. Each re-estimation takes the best of 13 values about the old
/// one, or, if the old one is best, a short Newton step, so that the
/// likelihood never falls. The temperature stays within 1e-6 to 1e6.
///
/// Start hot: from a cold start the gains may be too small to go on for.
/// Consecutive frames that err together are evidence counted twice here, too: if
/// there are labels, [`calibrate`] is better.
impl LearnLikelihood for AppearanceLikelihood {
    /// Sums over rows, with scores z relative to the least of their row: Σ E\[z\]; Σ mean and
    /// Σ variance of z under the kernel, which are the first two derivatives of
    /// Σ ln mean exp(−β z) but for a sign; the largest z of any weight; and Σ ln mean exp(−β z)
    /// for each candidate.
    type Statistics = [f64; 4 + FACTORS.len()];

    fn statistics(&self) -> Self::Statistics {
        [0.0; 4 + FACTORS.len()]
    }

    fn add(&self, statistics: &mut Self::Statistics, distances: &Vec<f32>, posterior: &[f64]) {
        let n = self.references();
        let mut scores = vec![0.0; n];
        if self.scores(distances, &mut scores, &mut Scratch::default()).is_err() {
            return; // then there is no posterior of it
        }
        let least = scores.iter().copied().fold(f64::INFINITY, f64::min);
        if !least.is_finite() {
            return; // off the map at any temperature
        }
        // Relative to the least score, as the likelihood is.
        scores.iter_mut().for_each(|z| *z -= least);
        let [expected, mean, variance, most, log_means @ ..] = statistics;
        let finite = scores.iter().zip(posterior).filter(|(z, _)| z.is_finite());
        *expected += finite.map(|(z, p)| p * z).sum::<f64>();
        if let (Some(state), Some(z)) =
            (self.off_map_state(), self.off_map_score(&mut scores.clone()))
        {
            *expected += posterior[state] * z;
        }
        let beta = 1.0 / self.temperature();
        let weighty = scores.iter().filter(|z| (-beta * **z).exp() > 0.0);
        *most = weighty.fold(*most, |most, z| most.max(*z));
        let [first, second] = moments(&scores, beta);
        (*mean, *variance) = (*mean + first, *variance + second);
        for (sum, factor) in log_means.iter_mut().zip(FACTORS) {
            let total: f64 = scores.iter().map(|z| (-factor * beta * z).exp()).sum();
            *sum += (total / n as f64).ln();
        }
    }

    fn merge(&self, statistics: &mut Self::Statistics, other: &Self::Statistics) {
        let most = statistics[3].max(other[3]);
        statistics.iter_mut().zip(other).for_each(|(sum, other)| *sum += other);
        statistics[3] = most;
    }

    fn reestimate(
        &self,
        statistics: &Self::Statistics,
        _: f64,
    ) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let [expected, mean, variance, most, log_means @ ..] = statistics;
        let beta = 1.0 / self.temperature();
        let gain = |at: usize| -expected * beta * FACTORS[at] - log_means[at];
        let allowed = |factor: f64| TEMPERATURES.contains(&(self.temperature() / factor));
        let candidates = (1..FACTORS.len()).filter(|at| allowed(FACTORS[*at]));
        let best = candidates.fold(0, |best, at| if gain(at) > gain(best) { at } else { best });
        let mut factor = FACTORS[best];
        if best == 0 && *variance > 0.0 {
            // The slope falls by the variance, which over a step of 1 / `most` changes by a factor
            // of e at most: a Newton step no longer than that goes up.
            let limit = (1.0 / most).min(0.01 * beta);
            factor = 1.0 + ((mean - expected) / variance).clamp(-limit, limit) / beta;
        }
        let temperature = self.temperature() / if allowed(factor) { factor } else { 1.0 };
        Ok(self.clone().with_temperature(temperature)?)
    }

    /// Returns 1, the temperature.
    fn free_parameters(&self) -> usize {
        1
    }
}

/// Result of [`calibrate`].
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    chosen: usize,
    scores: Vec<f64>,
}

impl Calibration {
    /// Index of the chosen candidate.
    #[must_use]
    pub fn chosen(&self) -> usize {
        self.chosen
    }

    /// The mean log score of each candidate, in nats, over the steps that at least one candidate
    /// finds possible; −∞ for a candidate that rules one of them out.
    #[must_use]
    pub fn scores(&self) -> &[f64] {
        &self.scores
    }
}

/// Chooses a temperature, or any other setting, by the log score of labelled places **in
/// sequence**.
///
/// `log_scores` runs the model with a candidate, and returns for each labelled step the
/// log-probability of the true place (within a tolerance, say; −∞ if it is ruled out).
///
/// Give the most cautious candidates first: hot before cold, without a correction before with
/// it. Chosen is the first whose mean score is below the best by no more than `worth` nats, or
/// by one standard error of the differences step by step (the one-standard-error rule of
/// Breiman and others 1984). So a short labelled part without an error does not make the model
/// overconfident; a `worth` of 0.01, a hundredth of the probability, is a difference that few
/// would pay for. (If scores are low and fall from the hottest on, check that labels and
/// beliefs are of the same steps.)
///
/// A labelled part that never leaves the map is no evidence on a state off the map.
/// Make it leave: take the references of some of its steps off the map, by setting
/// their distances to infinity.
///
/// ```
/// use wayfix::observation::{AppearanceLikelihood, calibrate};
/// use wayfix::transition::WindowTransition;
/// use wayfix::{Belief, Hmm, Prior};
///
/// let rows = vec![vec![0.1_f32, 0.9, 0.8], vec![0.5, 0.4, 0.9], vec![0.7, 0.9, 0.6]];
/// let motion = WindowTransition::new(3, 0, &[0.1, 0.9], false)?;
/// let fitted = calibrate(&[2.0, 1.0, 0.5, 0.25], 0.01, |&temperature| {
///     let camera = AppearanceLikelihood::new(3)?.with_temperature(temperature)?;
///     let hmm = Hmm::new(Prior::AtFirstObservation(Belief::uniform(3)?), &motion, camera)?;
///     let smoothing = hmm.smooth(&rows)?;
///     let beliefs = smoothing.posteriors().iter();
///     let scores = beliefs.zip([0, 1, 2]).map(|(belief, place)| belief.as_slice()[place].ln());
///     Ok::<_, Box<dyn std::error::Error>>(scores.collect())
/// })?;
/// assert_eq!(fitted.chosen(), 2); // the colder one gains less than a hundredth
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
///
/// [`ObservationError`] (as `E`) if there are no candidates, if `worth` is not at
/// least 0, or if the scores are none, not log-probabilities or not as many for each candidate;
/// and any error of `log_scores`.
pub fn calibrate<C, E: From<ObservationError>>(
    candidates: &[C],
    worth: f64,
    mut log_scores: impl FnMut(&C) -> Result<Vec<f64>, E>,
) -> Result<Calibration, E> {
    if worth.is_nan() || worth < 0.0 {
        let (what, expected) = ("the worth of a difference", "at least 0");
        return Err(ObservationError::Parameter { what, value: worth, expected }.into());
    }
    let mut all: Vec<Vec<f64>> = Vec::new();
    for candidate in candidates {
        let scores = log_scores(candidate)?;
        if scores.is_empty() || all.first().is_some_and(|first| first.len() != scores.len()) {
            let what = "the number of log scores";
            let expected = "at least 1, and as many for each candidate";
            let value = scores.len() as f64;
            return Err(ObservationError::Parameter { what, value, expected }.into());
        }
        // A mass that rounding takes above 1 is allowed.
        if let Some(&value) = scores.iter().find(|&&log| log.is_nan() || log > 1e-9) {
            let (what, expected) = ("a log score", "at most 0");
            return Err(ObservationError::Parameter { what, value, expected }.into());
        }
        all.push(scores);
    }
    // A step that is impossible with every candidate tells none from another.
    let steps = all.first().map_or(0, Vec::len);
    let told: Vec<bool> =
        (0..steps).map(|step| all.iter().any(|scores| scores[step].is_finite())).collect();
    for scores in &mut all {
        let mut told = told.iter();
        scores.retain(|_| told.next() == Some(&true));
    }
    let mean = |scores: &[f64]| match scores.len() {
        0 => f64::NEG_INFINITY,
        count => kernels::sum(scores) / count as f64,
    };
    let scores: Vec<f64> = all.iter().map(|scores| mean(scores)).collect();
    let better = |best: Option<usize>, at: usize| match best {
        Some(best) if scores[at] <= scores[best] => Some(best),
        _ => Some(at),
    };
    let best = (0..all.len()).fold(None, better).ok_or(ObservationError::Parameter {
        what: "the number of candidates",
        value: 0.0,
        expected: "at least 1",
    })?;
    let alike = |at: &usize| {
        let pairs = all[best].iter().zip(&all[*at]);
        let differences: Vec<f64> = pairs.map(|(best, other)| best - other).collect();
        // Two means of −∞ are equal, though their difference is NaN.
        scores[*at] == scores[best] || mean(&differences) <= standard_error(&differences).max(worth)
    };
    let chosen = (0..best).find(alike).unwrap_or(best);
    Ok(Calibration { chosen, scores })
}

/// The standard error of the mean; NaN where a difference is not finite.
fn standard_error(values: &[f64]) -> f64 {
    let n = values.len() as f64;
    let mean = kernels::sum(values) / n;
    let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    (squares / (n * (n - 1.0).max(1.0))).sqrt()
}
