//! Command-line options that both examples share.

use std::num::NonZeroUsize;
use std::ops::Range;
use std::path::PathBuf;

use super::seqslam::SeqSlam;
use super::settings::{Offsets, Settings};

/// Lengths of a line that `SeqSLAM` tries by default.
const SEQUENCES: [usize; 4] = [10, 20, 50, 100];

/// Options for learning, answering and reporting.
#[derive(Debug, clap::Args)]
pub(crate) struct Common {
    /// Labelled steps to learn from, as FIRST..END, several separated by commas [default: the
    /// first third].
    #[arg(long, value_name = "RANGES", value_delimiter = ',', value_parser = span, allow_hyphen_values = true)]
    fit_on: Vec<Range<usize>>,
    /// Steps to report results on [default: all that are not learned from].
    #[arg(long, value_name = "RANGES", value_delimiter = ',', value_parser = span, allow_hyphen_values = true)]
    report_on: Vec<Range<usize>>,
    /// Delay of fixed-lag answers, in steps.
    #[arg(long, value_name = "STEPS", default_value_t = 20, value_parser = whole, allow_negative_numbers = true)]
    lag: usize,
    /// Model places that are not on the map.
    #[arg(long)]
    pub(crate) off_map: bool,
    /// Number of references beside the right ones that still count as right.
    #[arg(long, value_name = "REFERENCES", default_value = "1,10", value_delimiter = ',', value_parser = whole, allow_negative_numbers = true)]
    tolerance: Vec<usize>,
    /// The references form a closed route.
    #[arg(long = "loop")]
    pub(crate) closed: bool,
    /// SeqSLAM: the length of a line, in steps [default: of 10, 20, 50 and 100, the one with the
    /// highest recall on the steps reported on, which favours SeqSLAM].
    #[arg(long, value_name = "STEPS", value_parser = count, allow_negative_numbers = true)]
    sequence: Option<NonZeroUsize>,
    /// SeqSLAM: the slopes of a line, in references per step.
    #[arg(long, value_name = "SPEEDS", default_value = "0.8,0.9,1,1.1,1.2", value_delimiter = ',', value_parser = speed, allow_hyphen_values = true)]
    velocities: Vec<f64>,
    /// SeqSLAM: the number of references on either side that contrast is relative to.
    #[arg(long, value_name = "REFERENCES", default_value_t = 10, value_parser = whole, allow_negative_numbers = true)]
    contrast: usize,
    /// Write what was learned to a file, as JSON (with the feature serde).
    #[arg(long, value_name = "FILE", conflicts_with = "fit")]
    save: Option<PathBuf>,
    /// Use a saved fit instead of learning; all steps are reported on by default (with the
    /// feature serde).
    #[arg(long, value_name = "FILE", conflicts_with_all = ["fit_on", "offsets", "speeds"])]
    fit: Option<PathBuf>,
    /// Temperature of the camera: likelihoods are raised to the power of 1 / T. Single images are
    /// taken at 1 [default: 2.5, or a value that is better in each part of the labelled steps].
    #[arg(long, value_name = "T", value_parser = temperature, allow_negative_numbers = true)]
    temperature: Option<f64>,
    /// Correct for references that resemble everything, by the mean and the deviation of each.
    /// The former value `hubs` no longer exists; `all` replaces it [default: all].
    #[arg(long, value_name = "WHICH")]
    offsets: Option<Offsets>,
    /// Speeds that the vehicle may have, in references per step; negative ones are reverse
    /// [default: 13 from -3 to 3].
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = speed, allow_hyphen_values = true)]
    speeds: Vec<f64>,
    /// Seed of all random numbers.
    #[arg(long, default_value_t = 1, allow_negative_numbers = true)]
    pub(crate) seed: u64,
    /// Folder for tables and pictures [default: target/ and the example's name].
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
}

/// Parses a whole number.
pub(crate) fn whole(text: &str) -> Result<usize, String> {
    text.trim().parse().map_err(|_| String::from("expected a whole number of at least 0"))
}

fn count(text: &str) -> Result<NonZeroUsize, String> {
    text.parse().map_err(|_| String::from("expected a whole number above 0"))
}

/// Parses FIRST..END, a range without its end that must not be empty.
pub(crate) fn span(text: &str) -> Result<Range<usize>, String> {
    let parse = || {
        let (first, end) = text.trim().split_once("..")?;
        let range: Range<usize> = first.parse().ok()?..end.parse().ok()?;
        (!range.is_empty()).then_some(range)
    };
    parse().ok_or_else(|| String::from("expected FIRST..END with FIRST below END, as in 0..600"))
}

fn speed(text: &str) -> Result<f64, String> {
    let value = text.trim().parse().ok().filter(|value: &f64| value.is_finite());
    value.ok_or_else(|| String::from("expected a finite number"))
}

fn temperature(text: &str) -> Result<f64, String> {
    let value = text.trim().parse().ok().filter(|t: &f64| (0.01..=1000.0).contains(t));
    value.ok_or_else(|| String::from("expected a number from 0.01 to 1000"))
}

/// Returns each value once, in the order of first occurrence.
fn distinct<T: Copy + PartialEq>(values: &[T]) -> Vec<T> {
    let mut kept = Vec::new();
    for value in values {
        if !kept.contains(value) {
            kept.push(*value);
        }
    }
    kept
}

impl Common {
    /// Returns the settings for a recording of this many steps.
    pub(crate) fn settings(&self, steps: usize) -> Result<Settings, String> {
        let third = 0..steps / 3;
        let fit_on = match &self.fit_on[..] {
            [] if self.fit.is_some() => Vec::new(),
            [] if third.len() < 2 => {
                return Err(format!(
                    "the first third of a recording of {steps} steps is too short to learn from, \
                     expected --fit-on or at least 6 steps"
                ));
            }
            [] => vec![third],
            spans => joined("--fit-on", spans, steps)?,
        };
        let learned = |step: &usize| fit_on.iter().any(|range| range.contains(step));
        let report_on: Vec<usize> = if self.report_on.is_empty() {
            (0..steps).filter(|step| !learned(step)).collect()
        } else {
            joined("--report-on", &self.report_on, steps)?.into_iter().flatten().collect()
        };
        if let Some(step) = report_on.iter().find(|step| learned(step)) {
            return Err(format!(
                "--report-on has step {step}, which is learned from, expected steps outside of \
                 --fit-on"
            ));
        }
        if report_on.is_empty() {
            return Err(format!(
                "all {steps} steps are learned from, expected --fit-on to leave some to report on"
            ));
        }
        let mut speeds = distinct(&self.speeds);
        speeds.sort_by(f64::total_cmp);
        Ok(Settings {
            fit_on,
            report_on,
            lag: self.lag,
            off_map: self.off_map,
            tolerances: distinct(&self.tolerance),
            save: self.save.clone(),
            fit: self.fit.clone(),
            temperature: self.temperature,
            offsets: self.offsets,
            speeds,
        })
    }

    pub(crate) fn seqslam(&self) -> SeqSlam {
        SeqSlam {
            contrast: self.contrast,
            sequences: self.sequence.map_or(SEQUENCES.to_vec(), |steps| vec![steps.get()]),
            velocities: self.velocities.clone(),
        }
    }
}

/// Checks and sorts ranges, and joins those that meet.
fn joined(option: &str, spans: &[Range<usize>], steps: usize) -> Result<Vec<Range<usize>>, String> {
    let mut ranges = spans.to_vec();
    if let Some(Range { start, end }) = ranges.iter().find(|range| range.end > steps) {
        return Err(format!(
            "{option} {start}..{end}: the recording has {steps} steps, expected an end up to \
             {steps}"
        ));
    }
    ranges.sort_by_key(|range| range.start);
    ranges.dedup_by(|next, kept| {
        let meet = next.start <= kept.end;
        if meet {
            kept.end = kept.end.max(next.end);
        }
        meet
    });
    Ok(ranges)
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        common: Common,
    }

    fn settings(steps: usize, line: &str) -> Result<Settings, String> {
        let line = Line::try_parse_from(std::iter::once("example").chain(line.split_whitespace()));
        line.map_err(|error| error.to_string())?.common.settings(steps)
    }

    #[test]
    fn ranges_are_joined_and_the_rest_is_reported() {
        let settings = settings(12, "--fit-on 5..7,0..2,6..9,9..10").unwrap();
        assert_eq!(settings.fit_on, [0..2, 5..10]);
        assert_eq!(settings.report_on, [2, 3, 4, 10, 11]);
        assert_eq!((settings.lag, settings.off_map), (20, false));
        assert_eq!(settings.tolerances, [1, 10]);
    }

    #[test]
    fn the_first_third_is_learned_from() {
        let settings = settings(11, "--report-on 9..11,4..6 --tolerance 3,0,3").unwrap();
        assert_eq!(settings.fit_on, vec![0..3; 1]);
        assert_eq!(settings.report_on, [4, 5, 9, 10]);
        assert_eq!(settings.tolerances, [3, 0]);
    }

    #[test]
    fn ranges_that_do_not_suit() {
        let error = |steps, line: &str| settings(steps, line).err().unwrap();
        let beyond = ": the recording has 10 steps, expected an end up to 10";
        assert_eq!(error(10, "--fit-on 2..4,8..11"), format!("--fit-on 8..11{beyond}"));
        assert_eq!(error(10, "--report-on 10..11"), format!("--report-on 10..11{beyond}"));
        assert_eq!(
            error(10, "--report-on 2..5"),
            "--report-on has step 2, which is learned from, expected steps outside of --fit-on"
        );
        assert_eq!(
            error(10, "--fit-on 0..10"),
            "all 10 steps are learned from, expected --fit-on to leave some to report on"
        );
        assert_eq!(
            error(5, ""),
            "the first third of a recording of 5 steps is too short to learn from, expected \
             --fit-on or at least 6 steps"
        );
        for wrong in ["5", "5..", "5..5", "6..5", "-1..5", "1..5,"] {
            let error = error(10, &format!("--fit-on={wrong}"));
            assert!(error.contains("FIRST..END"), "{error}");
        }
        for option in ["--tolerance", "--lag", "--contrast"] {
            let error = error(10, &format!("{option} -1"));
            assert!(
                error.contains("-1") && error.contains("whole number of at least 0"),
                "{error}"
            );
        }
        assert!(error(10, "--sequence -1").contains("a whole number above 0"));
        assert!(error(10, "--fit-on -1..5").contains("FIRST..END"));
        for wrong in ["--velocities nan", "--velocities=", "--sequence 0", "--tolerance -1"] {
            assert!(error(10, wrong).starts_with("error: "), "{wrong}");
        }
    }

    #[test]
    fn options_of_the_fit() {
        let given = settings(9, "").unwrap();
        assert!(given.speeds.is_empty() && given.offsets.is_none());
        let given = settings(9, "--save a --temperature 0.5 --offsets none").unwrap();
        assert_eq!((given.save, given.temperature), (Some("a".into()), Some(0.5)));
        assert_eq!(given.offsets, Some(Offsets::None));
        let given = settings(9, "--speeds 0.5,0,-1,0").unwrap();
        assert_eq!(given.speeds, [-1.0, 0.0, 0.5]);
        // With a saved fit nothing is learned, however short the recording.
        let given = settings(2, "--fit a").unwrap();
        assert_eq!(
            (given.fit, given.fit_on, given.report_on),
            (Some("a".into()), vec![], vec![0, 1])
        );

        let error = |line: &str| settings(9, line).unwrap_err();
        for wrong in ["0", "-1", "inf", "nan", "1e-3", "warm"] {
            let error = error(&format!("--temperature {wrong}"));
            assert!(error.contains("a number from 0.01 to 1000"), "{error}");
        }
        assert!(error("--offsets some").contains("[possible values: none, all]"));
        assert!(error("--speeds 1,fast").contains("expected a finite number"));
        for other in ["--fit-on 0..3", "--save b", "--offsets all", "--speeds 1"] {
            assert!(error(&format!("--fit a {other}")).contains("cannot be used with"), "{other}");
        }
    }
}
