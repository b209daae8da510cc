//! What is printed, and the tables as CSV.

use std::fmt::Write;
use std::ops::{Range, RangeInclusive};
use std::path::Path;

use wayfix::evaluate::{ReliabilityDiagram, RocCurve};

use super::counted;
use super::estimate::Settings;
use super::measures::Measured;
use super::recording::{Answers, Recording};

/// The report that is printed: what was located, and how well.
pub(crate) fn report(
    recording: &Recording,
    settings: &Settings,
    report_on: &[usize],
    notes: &[String],
    measured: &[Measured],
) -> String {
    let steps = recording.steps();
    let on_map = recording.truth.iter().filter(|truth| truth.is_some()).count();
    let learned: usize = settings.fit_on.iter().map(Range::len).sum();
    let mut text = format!(
        "{}\n{}, {on_map} of them on the map of {}{}.\n{learned} steps are \
         learned from, {} reported on.\n",
        recording.name,
        counted(steps, "step"),
        counted(recording.references, "reference"),
        if recording.closed { ", a closed route" } else { "" },
        if report_on.len() == 1 { "1 is".into() } else { format!("{} are", report_on.len()) },
    );
    let mut put = |line: std::fmt::Arguments<'_>| {
        text.write_fmt(line).expect("a String takes all that is written");
    };
    notes.iter().for_each(|note| put(format_args!("{note}\n")));
    put(format_args!(
        "\n{:<19}  tolerance  recall  calibr.   log score   recall at precision  PR area\n{:<19}  \
         {:9}  {:6}  error     {:10}  {:>9} {:>9}\n",
        "method", "", "", "", "", "100%", "99%"
    ));
    for Measured { method, scores, .. } in measured {
        for score in scores {
            let at = |level| score.curve.recall_at_precision(level).unwrap_or(0.0);
            let error =
                score.reliability.as_ref().map(ReliabilityDiagram::expected_calibration_error);
            put(format_args!(
                "{method:<19}  {:9}  {:6.4}  {:>7}  {:>10}  {:9.4} {:9.4}  {:7.4}\n",
                score.tolerance,
                score.recall,
                error.map_or(String::from("-"), |error| super::decimals(error, 4)),
                score.log_score.map_or(String::from("-"), |score| super::decimals(score, 4)),
                at(1.0),
                at(0.99),
                score.curve.average_precision(),
            ));
        }
    }
    if measured.iter().any(|method| method.roc.is_some()) {
        put(format_args!("\nOn the map or not: area under the ROC curve\n"));
        for Measured { method, roc, .. } in measured {
            if let Some(roc) = roc {
                put(format_args!("{method:<19}  {:.4}\n", roc.area()));
            }
        }
    }
    text
}

fn decimals(value: f64) -> String {
    super::decimals(value, 6)
}

/// Recall, calibration and log score of each method, to each tolerance.
pub(crate) fn write_table(file: &Path, measured: &[Measured]) -> Result<(), csv::Error> {
    let mut file = csv::Writer::from_path(file)?;
    file.write_record(["method", "tolerance", "recall", "calibration_error", "log_score"])?;
    for Measured { method, scores, .. } in measured {
        for score in scores {
            let error =
                score.reliability.as_ref().map(ReliabilityDiagram::expected_calibration_error);
            file.write_record([
                method.clone(),
                score.tolerance.to_string(),
                decimals(score.recall),
                error.map_or(String::new(), decimals),
                score.log_score.map_or(String::new(), decimals),
            ])?;
        }
    }
    Ok(file.flush()?)
}

/// What each method says at each step, reported or not.
pub(crate) fn write_answers(
    file: &Path,
    recording: &Recording,
    tolerances: &[usize],
    answers: &[Answers],
) -> Result<(), csv::Error> {
    let mut file = csv::Writer::from_path(file)?;
    let mut header = ["step", "truth_first", "truth_last"].map(String::from).to_vec();
    for Answers { method, probability, .. } in answers {
        header.push(format!("{method}_place"));
        if probability.is_some() {
            header.extend(tolerances.iter().map(|within| format!("{method}_probability_{within}")));
        }
    }
    file.write_record(header)?;
    let place = |place: Option<usize>| place.map_or(String::new(), |place| place.to_string());
    for (step, truth) in recording.truth.iter().enumerate() {
        let ends = |end: fn(&RangeInclusive<usize>) -> &usize| {
            place(truth.as_ref().map(|truth| *end(truth)))
        };
        let mut line = vec![step.to_string(), ends(|t| t.start()), ends(|t| t.end())];
        for Answers { places, probability, .. } in answers {
            line.push(place(places[step]));
            line.extend(probability.iter().flatten().map(|p| decimals(p[step])));
        }
        file.write_record(line)?;
    }
    Ok(file.flush()?)
}

/// Precision and recall at each threshold.
pub(crate) fn write_precision_recall(file: &Path, measured: &[Measured]) -> Result<(), csv::Error> {
    let mut file = csv::Writer::from_path(file)?;
    file.write_record(["method", "tolerance", "threshold", "precision", "recall"])?;
    for Measured { method, scores, .. } in measured {
        for score in scores {
            for point in score.curve.points() {
                file.write_record([
                    method.clone(),
                    score.tolerance.to_string(),
                    point.threshold().to_string(),
                    decimals(point.precision()),
                    decimals(point.recall()),
                ])?;
            }
        }
    }
    Ok(file.flush()?)
}

/// How often answers of some probability are right.
pub(crate) fn write_reliability(file: &Path, measured: &[Measured]) -> Result<(), csv::Error> {
    let mut file = csv::Writer::from_path(file)?;
    file.write_record([
        "method",
        "tolerance",
        "lower",
        "upper",
        "count",
        "mean_probability",
        "fraction_right",
    ])?;
    for Measured { method, scores, .. } in measured {
        for score in scores {
            for bin in score.reliability.iter().flat_map(ReliabilityDiagram::bins) {
                file.write_record([
                    method.clone(),
                    score.tolerance.to_string(),
                    bin.lower().to_string(),
                    bin.upper().to_string(),
                    bin.count().to_string(),
                    decimals(bin.mean_probability()),
                    decimals(bin.fraction_true()),
                ])?;
            }
        }
    }
    Ok(file.flush()?)
}

/// How well each method knows whether it is on the map.
pub(crate) fn write_roc(file: &Path, measured: &[Measured]) -> Result<(), csv::Error> {
    let mut file = csv::Writer::from_path(file)?;
    file.write_record(["method", "threshold", "false_positive_rate", "true_positive_rate"])?;
    for Measured { method, roc, .. } in measured {
        for point in roc.iter().flat_map(RocCurve::points) {
            file.write_record([
                method.clone(),
                point.threshold().to_string(),
                decimals(point.false_positive_rate()),
                decimals(point.true_positive_rate()),
            ])?;
        }
    }
    Ok(file.flush()?)
}

/// Recall against lag: a recall for each tolerance.
pub(crate) fn write_lags(
    file: &Path,
    tolerances: &[usize],
    lags: &[(usize, Vec<f64>)],
) -> Result<(), csv::Error> {
    let mut file = csv::Writer::from_path(file)?;
    let recalls = tolerances.iter().map(|tolerance| format!("recall_{tolerance}"));
    file.write_record(std::iter::once(String::from("lag")).chain(recalls))?;
    for (lag, recalls) in lags {
        let recalls = recalls.iter().map(|recall| decimals(*recall));
        file.write_record(std::iter::once(lag.to_string()).chain(recalls))?;
    }
    Ok(file.flush()?)
}
