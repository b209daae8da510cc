//! Results of each method on a recording with and without disturbances.

use std::error::Error;
use std::io::{self, Write};
use std::ops::{Range, RangeInclusive};
use std::path::Path;

use rand::RngExt;
use rand::seq::SliceRandom;

use crate::hard::{Disturbed, KINDS, Pass, generator};
use crate::vpr::arguments::Common;
use crate::vpr::recording::Recording;
use crate::vpr::{
    Outcome, cannot_write, chain, counted, decimals, figures, measures, outcome, print, tables,
};

/// Lengths of a disturbance, in steps.
const LENGTHS: [usize; 5] = [10, 20, 30, 45, 60];
/// Number of clear steps before each disturbance.
const CLEAR: RangeInclusive<usize> = 15..=40;

const HEADER: [&str; 9] = [
    "disturbance",
    "method",
    "tolerance",
    "recall",
    "recall_in_stretches",
    "calibration_error",
    "log_score",
    "worst_minute",
    "stretch_steps",
];

/// Measures of a method under a disturbance, at one tolerance.
struct Line {
    disturbance: &'static str,
    method: String,
    tolerance: usize,
    /// Recall on all reported steps and in the disturbed stretches, calibration error, log score,
    /// and recall of the worst minute.
    numbers: [Option<f64>; 5],
    /// Number of disturbed steps.
    steps: usize,
}

fn lines(
    disturbance: &'static str,
    recording: &Recording,
    Outcome { estimates, measured }: &Outcome,
    steps: &[usize],
) -> Vec<Line> {
    let mut lines = Vec::new();
    for (answers, method) in estimates.answers.iter().zip(measured) {
        lines.extend(method.scores.iter().map(|score| {
            let tolerance = score.tolerance;
            let disturbed = measures::recall(recording, &answers.places, tolerance, steps);
            let numbers = [
                Some(score.recall),
                Some(disturbed).filter(|recall| !recall.is_nan()),
                score.calibration_error(),
                score.log_score.map(|score| score.mean),
                Some(score.worst_minute),
            ];
            let method = method.method.clone();
            Line { disturbance, method, tolerance, numbers, steps: steps.len() }
        }));
    }
    lines
}

/// Draws stretches of all lengths among the given steps, with clear steps before each.
fn stretches(steps: &[usize], seed: u64) -> Vec<Range<usize>> {
    let mut rng = generator(seed, 2);
    let (mut stretches, mut lengths) = (Vec::new(), Vec::new());
    for run in steps.chunk_by(|a, b| a + 1 == *b) {
        let (mut at, end) = (run[0], run[0] + run.len());
        loop {
            if lengths.is_empty() {
                lengths = LENGTHS.to_vec();
                lengths.shuffle(&mut rng);
            }
            at += rng.random_range(CLEAR).min(run.len() / 3);
            if at + LENGTHS[0] > end {
                break;
            }
            let stretch = at..end.min(at + lengths.pop().unwrap_or(LENGTHS[0]));
            at = stretch.end;
            stretches.push(stretch);
        }
    }
    stretches
}

/// Disturbs the reported steps of a pass by each kind and by all in turn; writes and prints the
/// measures of all methods. Takes the function that creates a recording.
pub(crate) fn run(
    pass: &Pass<'_>,
    undisturbed: (&Recording, &Outcome),
    common: &Common,
    out: &Path,
    record: impl Fn(&Disturbed) -> Result<Recording, String>,
) -> Result<(), Box<dyn Error>> {
    let settings = common.settings(undisturbed.0.steps())?;
    let stretches = stretches(&settings.report_on, common.seed);
    if stretches.is_empty() {
        return Err("--hard: expected at least 15 steps in a row to report on".into());
    }
    let steps: Vec<usize> = stretches.iter().cloned().flatten().collect();
    let mut table = lines("none", undisturbed.0, undisturbed.1, &steps);
    let single = KINDS.map(|(kind, name)| (name, vec![kind]));
    let all = ("all", KINDS.map(|kind| kind.0).to_vec());
    for (number, (name, kinds)) in (1..).zip(single.into_iter().chain([all])) {
        // Standard error may be closed.
        let _ = writeln!(io::stderr(), "{name}: disturbance {number} of {}", KINDS.len() + 1);
        let disturbed = pass.disturbed(&stretches, &kinds, common.seed);
        let recording = record(&disturbed)?;
        let outcome = outcome(&recording, &disturbed.settings(&settings), &common.seqslam())
            .map_err(|error| format!("{name}: {}", chain(&*error)))?;
        table.extend(lines(name, &recording, &outcome, &disturbed.steps()));
    }
    let records = table.iter().map(|line| {
        let mut record = [line.disturbance, &line.method, &line.tolerance.to_string()]
            .map(String::from)
            .to_vec();
        record.extend(line.numbers.map(tables::optional));
        record.push(line.steps.to_string());
        record
    });
    let written = tables::write(&out.join("hard.csv"), &HEADER, records);
    written.map_err(|error| cannot_write(out, &error))?;

    let first = settings.tolerances[0];
    let mut text = format!(
        "\n{} of {} disturbed, recall {}\n{:<12} {:<19}  recall  of disturbed  calibr. error  \
         log score  worst minute\n",
        steps.len(),
        counted(settings.report_on.len(), "step"),
        figures::within(first),
        "disturbance",
        "method",
    );
    for line in table.iter().filter(|line| line.tolerance == first) {
        let or_dash = |number: Option<f64>| number.map_or("-".into(), |number| decimals(number, 4));
        let [recall, disturbed, calibration, log, minute] = line.numbers.map(or_dash);
        text += &format!(
            "{:<12} {:<19}  {recall:>6}  {disturbed:>12}  {calibration:>13}  {log:>9}  \
             {minute:>12}\n",
            line.disturbance, line.method
        );
    }
    Ok(print(&text)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stretches_are_apart_and_of_all_lengths() {
        let steps: Vec<usize> = (100..1000).chain(1200..1210).chain(1300..1330).collect();
        let all = stretches(&steps, 1);
        assert!(all.iter().all(|s| s.len() >= 10 && s.clone().all(|step| steps.contains(&step))));
        assert!(all.windows(2).all(|pair| pair[0].end + 10 <= pair[1].start));
        assert!(LENGTHS.iter().all(|length| all.iter().any(|s| s.len() == *length)));
        assert!(all.last().unwrap().start > 1300 && all != stretches(&steps, 2));
        assert_eq!((stretches(&steps, 1), stretches(&[1, 2, 3], 1)), (all, vec![]));
    }
}
