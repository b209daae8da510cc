//! How good answers are, by the measures of the library.

use std::error::Error;

use wayfix::evaluate::{self, EvaluationError, PrecisionRecallCurve, ReliabilityDiagram, RocCurve};

use super::recording::{Answers, Recording};

const BINS: usize = 10;

/// How many steps are a minute, at one a second.
const MINUTE: usize = 60;

/// A method, measured on the steps that are reported.
pub(crate) struct Measured {
    pub(crate) method: String,
    /// For each tolerance.
    pub(crate) scores: Vec<Scores>,
    /// How well it knows places that are on the map from those that are not;
    /// `None` unless there are both.
    pub(crate) roc: Option<RocCurve>,
    pub(crate) step_ms: Option<f64>,
}

/// To one tolerance.
pub(crate) struct Scores {
    pub(crate) tolerance: usize,
    /// Of the steps on the map, the fraction with a right answer.
    pub(crate) recall: f64,
    /// The lowest recall of 60 reported steps in a row; of all, if there are
    /// fewer.
    pub(crate) worst_minute: f64,
    pub(crate) curve: PrecisionRecallCurve,
    /// Of the probability that the answer is right, "not on the map" included.
    pub(crate) reliability: Option<ReliabilityDiagram>,
    /// The logarithm of the probability given to what is true.
    pub(crate) log_score: Option<LogScore>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LogScore {
    pub(crate) mean: f64,
    /// That of the worst step, and which step of the recording it is.
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
            // A minute off the map is NaN, which is no minimum.
            worst_minute: minutes.fold(f64::NAN, f64::min),
            curve,
            reliability: reliability.transpose()?,
            log_score: log_score.transpose()?,
        })
    });
    let scores = scores.collect::<Result<_, Box<dyn Error>>>()?;
    // A method without a probability of being on the map has its confidence.
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

/// Of the steps on the map, the fraction with a right answer; NaN if none is on
/// the map.
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
        // Of steps 1, 2 and 5, the second has no answer; step 4 needs none.
        assert_eq!(scores.recall, 2.0 / 3.0);
        let points = scores.curve.points().iter().map(|p| (p.precision(), p.recall()));
        let expected = [(1.0, 1.0 / 3.0), (1.0, 2.0 / 3.0), (2.0 / 3.0, 2.0 / 3.0)];
        assert_eq!(points.collect::<Vec<_>>(), expected);
        // Right: steps 1, 3 and 5.
        let bins = scores.reliability.as_ref().unwrap().bins().iter();
        let bins: Vec<_> = bins.map(|bin| (bin.count(), bin.fraction_true())).collect();
        assert_eq!(bins, [(1, 1.0), (2, 0.5), (2, 0.5)]);
        let LogScore { mean, worst } = scores.log_score.unwrap();
        assert!((mean - 0.5_f64.ln()).abs() < 1e-15);
        assert_eq!((worst, measured.step_ms), ((0.25_f64.ln(), 3), Some(0.25)));
        // Of six pairs, (0.4, 0.8) and (0.7, 0.8) are the wrong way round.
        assert_eq!(measured.roc.unwrap().area(), 4.0 / 6.0);
        assert!(measure(&recording, &answers, &[1], &[1, 2]).unwrap().roc.is_none());
    }

    #[test]
    fn the_worst_minute_is_on_the_map() {
        let truth = |step: usize| (step < 200).then_some(0..=0);
        let truth = (0..300).map(truth).collect();
        let recording = Recording { references: 9, truth, ..Recording::default() };
        // Wrong at steps 100 to 129.
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
