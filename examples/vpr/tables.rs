//! Printed report, and tables as CSV.

use std::ops::{Range, RangeInclusive};
use std::path::Path;

use wayfix::evaluate::{ReliabilityDiagram, RocCurve};

use super::counted;
use super::measures::{Measured, Scores};
use super::recording::{Answers, Recording};
use super::settings::Settings;

/// Report of what was located, and how well.
pub(crate) fn report(
    recording: &Recording,
    settings: &Settings,
    notes: &[String],
    measured: &[Measured],
) -> String {
    let steps = recording.steps();
    let on_map = recording.truth.iter().filter(|truth| truth.is_some()).count();
    let learned: usize = settings.fit_on.iter().map(Range::len).sum();
    let reported = settings.report_on.len();
    let mut text = format!(
        "{}\n{}, {on_map} of them on the map of {}{}.\n{learned} steps are learned from, {reported} \
         {} reported on.\n",
        recording.name,
        counted(steps, "step"),
        counted(recording.references, "reference"),
        if recording.closed { ", a closed route" } else { "" },
        if reported == 1 { "is" } else { "are" },
    );
    notes.iter().for_each(|note| text += &format!("{note}\n"));
    text += &format!(
        "\n{:<19}  tolerance  recall  calibr.   log score   recall at precision  PR area\n{:<19}  \
         {:9}  {:6}  error     {:10}  {:>9} {:>9}\n",
        "method", "", "", "", "", "100%", "99%"
    );
    let or_dash = |value: Option<f64>| value.map_or("-".into(), |value| super::decimals(value, 4));
    for Measured { method, scores, .. } in measured {
        for score in scores {
            let at = |level| score.curve.recall_at_precision(level).unwrap_or(0.0);
            text += &format!(
                "{method:<19}  {:9}  {:6.4}  {:>7}  {:>10}  {:9.4} {:9.4}  {:7.4}\n",
                score.tolerance,
                score.recall,
                or_dash(score.calibration_error()),
                or_dash(score.log_score.map(|score| score.mean)),
                at(1.0),
                at(0.99),
                score.curve.average_precision(),
            );
        }
    }
    if measured.iter().any(|method| method.roc.is_some()) {
        text += "\nOn the map or not: area under the ROC curve\n";
        for Measured { method, roc, .. } in measured {
            let area = roc.as_ref().map(|roc| format!("{method:<19}  {:.4}\n", roc.area()));
            text += &area.unwrap_or_default();
        }
    }
    text
}

fn decimals(value: f64) -> String {
    super::decimals(value, 6)
}

/// Formats a number, or nothing.
pub(crate) fn optional(value: Option<f64>) -> String {
    value.map_or(String::new(), decimals)
}

/// Writes a table: its header, then its lines.
pub(crate) fn write(
    file: &Path,
    header: &[impl AsRef<[u8]>],
    lines: impl IntoIterator<Item = Vec<String>>,
) -> Result<(), csv::Error> {
    let mut file = csv::Writer::from_path(file)?;
    file.write_record(header)?;
    lines.into_iter().try_for_each(|line| file.write_record(line))?;
    Ok(file.flush()?)
}

/// Each method at each tolerance, with the first cells of its line.
fn methods(measured: &[Measured]) -> impl Iterator<Item = (&Measured, &Scores, Vec<String>)> {
    measured.iter().flat_map(|method| {
        let line = |score: &Scores| vec![method.method.clone(), score.tolerance.to_string()];
        method.scores.iter().map(move |score| (method, score, line(score)))
    })
}

/// Writes recall, calibration, log score and time of each method at each tolerance.
pub(crate) fn write_table(file: &Path, measured: &[Measured]) -> Result<(), csv::Error> {
    let header = [
        "method",
        "tolerance",
        "recall",
        "calibration_error",
        "log_score",
        "roc_area",
        "worst_log_score",
        "worst_step",
        "step_ms",
        "worst_minute",
    ];
    let lines = methods(measured).map(|(method, score, line)| {
        let worst = score.log_score.map(|score| score.worst);
        let rest = [
            decimals(score.recall),
            optional(score.calibration_error()),
            optional(score.log_score.map(|score| score.mean)),
            optional(method.roc.as_ref().map(RocCurve::area)),
            optional(worst.map(|worst| worst.0)),
            worst.map_or(String::new(), |worst| worst.1.to_string()),
            optional(method.step_ms),
            decimals(score.worst_minute),
        ];
        [line, rest.to_vec()].concat()
    });
    write(file, &header, lines)
}

/// Writes the answer of each method at each step, reported or not.
pub(crate) fn write_answers(
    file: &Path,
    recording: &Recording,
    tolerances: &[usize],
    answers: &[Answers],
) -> Result<(), csv::Error> {
    let mut header = ["step", "truth_first", "truth_last"].map(String::from).to_vec();
    for Answers { method, probability, .. } in answers {
        header.push(format!("{method}_place"));
        if probability.is_some() {
            header.extend(tolerances.iter().map(|within| format!("{method}_probability_{within}")));
        }
    }
    let place = |place: Option<usize>| place.map_or(String::new(), |place| place.to_string());
    let lines = recording.truth.iter().enumerate().map(|(step, truth)| {
        let ends = |end: fn(&RangeInclusive<usize>) -> &usize| {
            place(truth.as_ref().map(|truth| *end(truth)))
        };
        let mut line = vec![step.to_string(), ends(|t| t.start()), ends(|t| t.end())];
        for Answers { places, probability, .. } in answers {
            line.push(place(places[step]));
            line.extend(probability.iter().flatten().map(|p| decimals(p[step])));
        }
        line
    });
    write(file, &header, lines)
}

/// Writes precision and recall at each threshold.
pub(crate) fn write_precision_recall(file: &Path, measured: &[Measured]) -> Result<(), csv::Error> {
    let lines = methods(measured).flat_map(|(_, score, line)| {
        score.curve.points().iter().map(move |point| {
            let numbers = [decimals(point.precision()), decimals(point.recall())];
            [&line[..], &[point.threshold().to_string()], &numbers].concat()
        })
    });
    write(file, &["method", "tolerance", "threshold", "precision", "recall"], lines)
}

/// Writes the fraction of right answers in each bin of probability.
pub(crate) fn write_reliability(file: &Path, measured: &[Measured]) -> Result<(), csv::Error> {
    let lines = methods(measured).flat_map(|(_, score, line)| {
        let bins = score.reliability.iter().flat_map(ReliabilityDiagram::bins);
        bins.map(move |bin| {
            let edges = [bin.lower(), bin.upper()].map(|edge| edge.to_string());
            let numbers = [bin.mean_probability(), bin.fraction_true()].map(decimals);
            [&line[..], &edges, &[bin.count().to_string()], &numbers].concat()
        })
    });
    let header =
        ["method", "tolerance", "lower", "upper", "count", "mean_probability", "fraction_right"];
    write(file, &header, lines)
}

/// Writes the ROC curve of each method for being on the map.
pub(crate) fn write_roc(file: &Path, measured: &[Measured]) -> Result<(), csv::Error> {
    let lines = measured.iter().flat_map(|Measured { method, roc, .. }| {
        roc.iter().flat_map(RocCurve::points).map(|point| {
            let rates = [point.false_positive_rate(), point.true_positive_rate()].map(decimals);
            [&[method.clone(), point.threshold().to_string()], &rates[..]].concat()
        })
    });
    let header = ["method", "threshold", "false_positive_rate", "true_positive_rate"];
    write(file, &header, lines)
}

/// Writes recall against lag, at each tolerance.
pub(crate) fn write_lags(
    file: &Path,
    tolerances: &[usize],
    lags: &[(usize, Vec<f64>)],
) -> Result<(), csv::Error> {
    let recalls = tolerances.iter().map(|tolerance| format!("recall_{tolerance}"));
    let header: Vec<String> = std::iter::once(String::from("lag")).chain(recalls).collect();
    let lines = lags.iter().map(|(lag, recalls)| {
        std::iter::once(lag.to_string()).chain(recalls.iter().copied().map(decimals)).collect()
    });
    write(file, &header, lines)
}
