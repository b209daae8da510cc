//! Printed report, and tables as CSV.

use std::{ops::Range, path::Path};

use wayfix::evaluate::expected_calibration_error;
use wayfix_recognition::Answer;

use super::{Measured, Recording, Task, number};

/// Baselines that are live, like the filter, and those that know all images, like the smoother.
const LIVE: [&str; 5] = ["nearest", "single", "seqslam_trailing", "plain_hmm", "simple_filter"];
const AFTERWARDS: [&str; 3] = ["seqslam_centred", "plain_hmm_smoothed", "simple_smoother"];
pub(crate) const TABLE: &str = "method,tolerance,recall,worst_minute,calibration_error,log_score,\
    worst_log_score,worst_step,recall_at_precision_1,average_precision,off_map_roc_area";

/// Reports what was located, and how well. If a baseline is better, the first line says so.
pub(crate) fn report(task: Task<'_>, notes: &[String], measured: &[Measured]) -> String {
    let Task { recording: Recording { name, references, truth, .. }, split, .. } = task;
    let steps = task.recording.steps();
    let mut text = beaten(measured) + &format!("{name}: {references} references, {steps} steps");
    if let Some(truth) = truth {
        let learned: usize = split.fit_on.iter().map(Range::len).sum();
        let (on_map, reported) = (truth.iter().flatten().count(), split.report_on.len());
        text += &format!(", {on_map} on the map; {learned} learned from, {reported} reported on");
    }
    text += &format!("\n{}\n", notes.join("\n"));
    let rows: Vec<_> = measured.iter().map(cells).collect();
    if rows.is_empty() { text } else { text + &aligned(TABLE, &rows) }
}

/// Line that names the baselines with a better recall at the first tolerance, if there are any.
fn beaten(measured: &[Measured]) -> String {
    // The first score of a method is that at the first tolerance.
    let recall = |name: &str| Some(measured.iter().find(|of| of.name == name)?.recall);
    let live = LIVE.map(|name| (name, "filter")).into_iter();
    let gains =
        live.chain(AFTERWARDS.map(|name| (name, "smoother"))).filter_map(|(name, model)| {
            let gain = recall(name)? - recall(model)?;
            // Smaller differences are noise.
            (gain > 0.005).then(|| format!("{name} than the {model} by {}", number(gain)))
        });
    let better = gains.collect::<Vec<_>>().join(", ");
    if better.is_empty() { better } else { format!("BASELINES ARE BETTER in recall: {better}\n") }
}

/// Cells of a line of the table.
pub(crate) fn cells(score: &Measured) -> Vec<String> {
    let optional = |value: Option<f64>| value.map_or(String::new(), number);
    vec![
        score.name.to_owned(),
        score.tolerance.to_string(),
        number(score.recall),
        number(score.worst_minute),
        optional(score.reliability.as_deref().map(expected_calibration_error)),
        optional(score.log_score.map(|score| score.0)),
        optional(score.log_score.map(|score| score.1)),
        score.log_score.map_or(String::new(), |score| score.2.to_string()),
        optional(score.curve.recall_at_precision(1.0).ok()),
        number(score.curve.average_precision()),
        optional(score.roc_area),
    ]
}

/// Aligns the cells of a table; each word of a header has its own line.
pub(crate) fn aligned(header: &str, rows: &[Vec<String>]) -> String {
    let names: Vec<Vec<&str>> = header.split(',').map(|name| name.split('_').collect()).collect();
    let depth = names.iter().map(Vec::len).max().unwrap_or(0);
    let word = |name: &Vec<&str>, line: usize| {
        (line + name.len()).checked_sub(depth).map_or(String::new(), |word| name[word].to_owned())
    };
    let head = (0..depth).map(|line| names.iter().map(|name| word(name, line)).collect());
    let all: Vec<Vec<String>> = head.chain(rows.iter().cloned()).collect();
    let wide = |column: usize| all.iter().map(|row| row[column].len()).max().unwrap_or(0);
    let cell = |(column, cell): (usize, &String)| match column {
        0 => format!("{cell:<wide$}", wide = wide(0)),
        _ => format!("  {cell:>wide$}", wide = wide(column)),
    };
    let line = |row: &Vec<String>| row.iter().enumerate().map(cell).collect::<String>() + "\n";
    format!("\n{}", all.iter().map(line).collect::<String>())
}

/// Writes a table: its header, then its lines.
pub(crate) fn write(file: &Path, header: &str, lines: &[Vec<String>]) -> Result<(), csv::Error> {
    let mut file = csv::Writer::from_path(file)?;
    file.write_record(header.split(','))?;
    lines.iter().try_for_each(|line| file.write_record(line))?;
    Ok(file.flush()?)
}

/// Writes the answer at each step, reported on or not.
pub(crate) fn write_answers(file: &Path, answers: &[Answer]) -> Result<(), csv::Error> {
    let mut file = csv::WriterBuilder::new().has_headers(false).from_path(file)?;
    let header = "step,place,probability,around_from,around_to,off_map,log_likelihood";
    file.write_record(header.split(','))?;
    for (step, of) in answers.iter().enumerate() {
        let (from, to) = (of.around.start(), of.around.end());
        file.serialize((step, of.place, of.probability, from, to, of.off_map, of.log_likelihood))?;
    }
    Ok(file.flush()?)
}
