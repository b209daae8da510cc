//! Measures of the quality of answers, computed by the library.

use wayfix::evaluate::{self, ReliabilityBin};
use wayfix_recognition::ThresholdCurve;

use super::{Fallible, Method, Recording, Task};

/// Measures of a method on the reported steps, at one tolerance.
pub(crate) struct Measured {
    pub(crate) name: &'static str,
    pub(crate) tolerance: usize,
    /// Fraction of right answers among the steps on the map.
    pub(crate) recall: f64,
    /// Lowest recall over 60 consecutive reported steps; over all of them, if there are fewer.
    pub(crate) worst_minute: f64,
    pub(crate) curve: ThresholdCurve,
    pub(crate) reliability: Option<Vec<ReliabilityBin>>,
    /// Mean log score of the true places, the score of the worst step, and that step.
    pub(crate) log_score: Option<(f64, f64, usize)>,
    /// Area under the ROC curve for being on the map.
    pub(crate) roc_area: Option<f64>,
}

/// Measures a method at each tolerance; returns nothing without a truth.
pub(crate) fn measure(task: Task<'_>, method: &Method) -> Fallible<Vec<Measured>> {
    let (recording, steps) = (task.recording, &task.split.report_on);
    let Some(truth) = &recording.truth else { return Ok(Vec::new()) };
    let on_map = steps.iter().filter(|step| truth[**step].is_some()).count();
    let mut roc_area = None;
    if let Some(off) = method.off_map.as_ref().filter(|_| (1..steps.len()).contains(&on_map)) {
        // Positives are the steps on the map, so their score is minus the probability of being off
        // it.
        let samples: Vec<_> = steps.iter().map(|&at| (-off[at], truth[at].is_some())).collect();
        roc_area = Some(ThresholdCurve::roc(&samples)?.area());
    }
    let scores = task.common.tolerance.iter().enumerate().map(|(at, &tolerance)| {
        let right = |step: usize| recording.is_right(&truth[step], method.places[step], tolerance);
        // An answer "off the map" is not given: it is neither right nor wrong for precision.
        let given = steps.iter().filter(|step| method.places[**step].is_some());
        let given: Vec<_> = given.map(|&step| (method.confidence[step], right(step))).collect();
        let reliability = method.probability.get(at).map(|p| {
            let forecasts: Vec<_> = steps.iter().map(|&step| (p[step], right(step))).collect();
            evaluate::reliability(&forecasts, 10)
        });
        let log_score = method.truth_mass.get(at).map(|masses| {
            let of_steps: Vec<_> = steps.iter().map(|&step| masses[step]).collect();
            let worst = steps.iter().min_by(|a, b| masses[**a].total_cmp(&masses[**b]));
            let worst = worst.copied().unwrap_or(0);
            evaluate::log_score(&of_steps).map(|mean| (mean, masses[worst].ln(), worst))
        });
        let recall = |steps| recall(recording, &method.places, tolerance, steps);
        let minutes = steps.windows(60.min(steps.len()).max(1)).map(recall);
        Ok(Measured {
            name: method.name,
            tolerance,
            recall: recall(steps),
            // A minute that is off the map throughout has a recall of NaN, which `min` ignores.
            worst_minute: minutes.fold(f64::NAN, f64::min),
            curve: ThresholdCurve::precision_recall(&given, on_map)?,
            reliability: reliability.transpose()?,
            log_score: log_score.transpose()?,
            roc_area,
        })
    });
    scores.collect()
}

/// Fraction of right answers within a tolerance among the steps on the map; NaN if there are none.
pub(crate) fn recall(
    of: &Recording,
    places: &[Option<usize>],
    within: usize,
    steps: &[usize],
) -> f64 {
    let truth = of.truth.iter().flat_map(|truth| steps.iter().map(move |&at| (at, &truth[at])));
    let on_map: Vec<_> = truth.filter(|(_, label)| label.is_some()).collect();
    let right = on_map.iter().filter(|(at, label)| of.is_right(label, places[*at], within));
    right.count() as f64 / on_map.len() as f64
}
