//! Measures of the quality of answers, computed by the library.

use std::error::Error;

use wayfix::evaluate::{self, EvaluationError, PrecisionRecallCurve, ReliabilityDiagram, RocCurve};

use super::recording::{Answers, Recording};

const BINS: usize = 10;

/// Number of steps in a minute, at one step a second.
const MINUTE: usize = 60;

/// Measures of a method on the reported steps.
pub(crate) struct Measured {
    pub(crate) method: String,
    /// Scores, for each tolerance.
    pub(crate) scores: Vec<Scores>,
    /// ROC curve for being on the map; `None` unless there are steps both on and off it.
    pub(crate) roc: Option<RocCurve>,
    pub(crate) step_ms: Option<f64>,
}

/// Scores at one tolerance.
pub(crate) struct Scores {
    pub(crate) tolerance: usize,
    /// Fraction of right answers, of the steps on the map.
    pub(crate) recall: f64,
    /// Lowest recall of 60 consecutive reported steps; of all, if there are fewer.
    pub(crate) worst_minute: f64,
    pub(crate) curve: PrecisionRecallCurve,
    /// Reliability of the probability that the answer is right, including "not on the map".
    pub(crate) reliability: Option<ReliabilityDiagram>,
    /// Log score of the probability of the true places.
    pub(crate) log_score: Option<LogScore>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LogScore {
    pub(crate) mean: f64,
    /// Log score of the worst step, and its index in the recording.
    pub(crate) worst: (f64, usize),
}

impl Scores {
    pub(crate) fn calibration_error(&self) -> Option<f64> {
        self.reliability.as_ref().map(ReliabilityDiagram::expected_calibration_error)
    }
}

/// Measures a method on some steps.
pub(crate) fn measure(
    recording: &Recording,
    answers: &Answers,
    tolerances: &[usize],
    steps: &[usize],
) -> Result<Measured, Box<dyn Error>> {
    let scores = tolerances.iter().enumerate().map(|(at, &tolerance)| {
        let right = |step: usize| recording.is_right(step, answers.places[step], tolerance);
        let given = steps.iter().filter(|step| answers.places[**step].is_some());
        let given: Vec<_> = given.map(|&step| (answers.confidence[step], right(step))).collect();
        let curve = PrecisionRecallCurve::new(&given, on_map(recording, steps))?;
        let reliability = answers.probability.as_ref().map(|p| {
            let forecasts: Vec<_> = steps.iter().map(|&step| (p[at][step], right(step))).collect();
            ReliabilityDiagram::new(&forecasts, BINS)
        });
        let log_score = answers.truth_mass.as_ref().map(|all| log_score(&all[at], steps));
        let recall = |steps| recall(recording, &answers.places, tolerance, steps);
        let minutes = steps.windows(MINUTE.min(steps.len()).max(1)).map(recall);
        Ok(Scores {
            tolerance,
            recall: recall(steps),
            // A minute off the map has a recall of NaN, which `min` ignores.
            worst_minute: minutes.fold(f64::NAN, f64::min),
            curve,
            reliability: reliability.transpose()?,
            log_score: log_score.transpose()?,
        })
    });
    let scores = scores.collect::<Result<_, Box<dyn Error>>>()?;
    // Methods without a probability of being on the map are scored by their confidence.
    let score = answers.on_map.as_ref().unwrap_or(&answers.confidence);
    let samples = steps.iter().map(|&step| (score[step], recording.truth[step].is_some()));
    let samples: Vec<_> = samples.collect();
    let both = (1..steps.len()).contains(&on_map(recording, steps));
    let roc = both.then(|| RocCurve::new(&samples)).transpose()?;
    Ok(Measured { method: answers.method.clone(), scores, roc, step_ms: answers.step_ms })
}

fn log_score(masses: &[f64], steps: &[usize]) -> Result<LogScore, EvaluationError> {
    let of_steps: Vec<_> = steps.iter().map(|&step| masses[step]).collect();
    let mean = evaluate::log_score(&of_steps)?;
    let worst = steps.iter().min_by(|a, b| masses[**a].total_cmp(&masses[**b]));
    let worst = worst.map_or((mean, 0), |&step| (masses[step].ln(), step));
    Ok(LogScore { mean, worst })
}

fn on_map(recording: &Recording, steps: &[usize]) -> usize {
    steps.iter().filter(|step| recording.truth[**step].is_some()).count()
}

/// Fraction of right answers, of the steps on the map; NaN if there are none.
pub(crate) fn recall(
    recording: &Recording,
    places: &[Option<usize>],
    tolerance: usize,
    steps: &[usize],
) -> f64 {
    let found = steps.iter().filter(|step| {
        places[**step].is_some() && recording.is_right(**step, places[**step], tolerance)
    });
    found.count() as f64 / on_map(recording, steps) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_given_steps_count() {
        let recording = Recording {
            references: 9,
            truth: vec![Some(0..=0), Some(3..=4), Some(5..=5), None, None, Some(8..=8)],
            ..Recording::default()
        };
        let answers = Answers {
            method: "any".into(),
            places: vec![Some(7), Some(2), None, None, Some(1), Some(8)],
            confidence: vec![9.0, 3.0, 1.0, 0.5, 2.0, 4.0],
            probability: Some(vec![vec![0.0, 0.25, 1.0, 0.75, 0.75, 1.0]]),
            truth_mass: Some(vec![vec![0.0, 0.5, 0.5, 0.25, 1.0, 0.5]]),
            on_map: Some(vec![0.0, 0.9, 0.4, 0.3, 0.8, 0.7]),
            step_ms: Some(0.25),
        };
        let measured = measure(&recording, &answers, &[1], &[1, 2, 3, 4, 5]).unwrap();
        let scores = &measured.scores[0];
        // Step 2 has no answer, steps 1 and 5 have; step 4 is off the map.
        assert_eq!(scores.recall, 2.0 / 3.0);
        let points = scores.curve.points().iter().map(|p| (p.precision(), p.recall()));
        let expected = [(1.0, 1.0 / 3.0), (1.0, 2.0 / 3.0), (2.0 / 3.0, 2.0 / 3.0)];
        assert_eq!(points.collect::<Vec<_>>(), expected);
        // Steps 1, 3 and 5 are right.
        let bins = scores.reliability.as_ref().unwrap().bins().iter();
        let bins: Vec<_> = bins.map(|bin| (bin.count(), bin.fraction_true())).collect();
        assert_eq!(bins, [(1, 1.0), (2, 0.5), (2, 0.5)]);
        let LogScore { mean, worst } = scores.log_score.unwrap();
        assert!((mean - 0.5_f64.ln()).abs() < 1e-15);
        assert_eq!((worst, measured.step_ms), ((0.25_f64.ln(), 3), Some(0.25)));
        // Two of six pairs, (0.4, 0.8) and (0.7, 0.8), are in the wrong order.
        assert_eq!(measured.roc.unwrap().area(), 4.0 / 6.0);
        assert!(measure(&recording, &answers, &[1], &[1, 2]).unwrap().roc.is_none());
    }

    #[test]
    fn the_worst_minute_is_on_the_map() {
        let truth = |step: usize| (step < 200).then_some(0..=0);
        let truth = (0..300).map(truth).collect();
        let recording = Recording { references: 9, truth, ..Recording::default() };
        // Steps 100 to 129 are wrong.
        let place = |step: usize| Some(if (100..130).contains(&step) { 5 } else { 0 });
        let answers = Answers {
            places: (0..300).map(place).collect(),
            confidence: vec![1.0; 300],
            ..Answers::default()
        };
        let worst = |steps: std::ops::Range<usize>| {
            let steps: Vec<usize> = steps.collect();
            measure(&recording, &answers, &[1], &steps).unwrap().scores[0].worst_minute
        };
        assert_eq!((worst(0..300), worst(0..100), worst(110..135)), (0.5, 1.0, 0.2));
    }
}
