//! `SeqSLAM`: the straight line of least difference through the matrix of a
//! query and a map (Milford and Wyeth, ICRA 2012), with the uniqueness of
//! `OpenSeqSLAM` (Sünderhauf, Neubert and Protzel, 2013) as confidence.
//!
//! Differences to the two papers, where they leave a choice or do not suit a live answer:
//!
//! - At the ends of the query, a line has only the steps that exist, and its score is the mean
//!   over them. Where a line runs beyond an open map, the difference there is 0, the mean of
//!   every contrast window, so that neither short lines nor long ones are favoured. On a closed
//!   route it continues around the loop.
//! - Contrast windows that are flat become 0.
//! - Lines are read at the nearest reference, halves rounded up.
//! - `OpenSeqSLAM` shifts all enhanced differences so that the smallest is 0, and uses the ratio
//!   of the best score to the best one elsewhere. As a live vehicle does not know the smallest
//!   one yet, scores are shifted here by (m − 1) / √m, the most that one of m values can lie
//!   below their mean, in standard deviations. The confidence is 1 − best / second best: larger =
//!   surer, and 0 if the second is as good, or if there is none elsewhere.

use indicatif::ProgressBar;

use super::recording::{Answers, Recording};

/// Parameters of the method.
pub(crate) struct SeqSlam {
    /// Number of references on either side that contrast is relative to, and that do not count as
    /// another place.
    pub(crate) contrast: usize,
    /// Candidate lengths of a line, in steps; at least one.
    pub(crate) sequences: Vec<usize>,
    /// Slopes of a line, in references per step.
    pub(crate) velocities: Vec<f64>,
}

/// Position of a line relative to the step that it answers.
#[derive(Clone, Copy)]
enum Alignment {
    /// Ends at the answered step, as required for a live answer.
    Trailing,
    /// Centred on the answered step; with an even number of steps, the extra one is before it.
    Centred,
}

impl SeqSlam {
    /// Answers of both alignments, each with the length of a line that is best by a measure; ties
    /// go to the shortest.
    pub(crate) fn run(
        &self,
        recording: &Recording,
        measure: impl Fn(&Answers) -> f64,
    ) -> Vec<(usize, Answers)> {
        let enhanced = self.enhance(recording);
        let bar = super::bar("SeqSLAM", 2 * self.sequences.len() * recording.steps());
        let best = [Alignment::Trailing, Alignment::Centred].map(|alignment| {
            let tried = self.sequences.iter().map(|&sequence| {
                let answers = self.answers(recording, &enhanced, sequence, alignment, &bar);
                (measure(&answers), sequence, answers)
            });
            tried.reduce(|best, next| if next.0 > best.0 { next } else { best })
        });
        bar.finish_and_clear();
        best.into_iter().flatten().map(|(_, sequence, answers)| (sequence, answers)).collect()
    }

    /// Normalises each difference by those at the references around it: subtracts their mean and
    /// divides by their sample standard deviation. Infinite differences stay infinite and do not
    /// count. O(T × n × window).
    fn enhance(&self, recording: &Recording) -> Vec<f32> {
        let n = recording.references;
        let enhanced = |row: &[f32], i: usize| {
            if row[i] == f32::INFINITY {
                return f32::INFINITY;
            }
            let window = if recording.closed {
                // Each reference is in a window at most once.
                let reach = self.contrast.min((n - 1) / 2);
                i + n - reach..i + n + reach + 1
            } else {
                i.saturating_sub(self.contrast)
                    ..n.min(i.saturating_add(self.contrast).saturating_add(1))
            };
            let window = window.map(|j| f64::from(row[j % n])).filter(|d| d.is_finite());
            let (count, sum) = window.clone().fold((0.0, 0.0), |(n, sum), d| (n + 1.0, sum + d));
            let (value, mean) = (f64::from(row[i]), sum / count);
            let squares: f64 = window.clone().map(|d| (d - mean).powi(2)).sum();
            let flat = window.clone().all(|d| d == value);
            if flat { 0.0 } else { ((value - mean) / (squares / (count - 1.0)).sqrt()) as f32 }
        };
        let rows = recording.distances.chunks_exact(n);
        rows.flat_map(|row| (0..n).map(move |i| enhanced(row, i))).collect()
    }

    /// Returns, for each step, the place at the end or in the middle of the best line.
    /// O(T × n × velocities × sequence).
    fn answers(
        &self,
        recording: &Recording,
        enhanced: &[f32],
        sequence: usize,
        alignment: Alignment,
        bar: &ProgressBar,
    ) -> Answers {
        let (n, steps) = (recording.references, recording.steps());
        let (method, after) = match alignment {
            Alignment::Trailing => ("seqslam_trailing", 1),
            Alignment::Centred => ("seqslam_centred", sequence - sequence / 2),
        };
        let (mut scores, mut line) = (vec![0.0; n], vec![0.0; n]);
        let answers = (0..steps).map(|step| {
            let on = (step + after).saturating_sub(sequence)..steps.min(step.saturating_add(after));
            scores.fill(f32::INFINITY);
            for &velocity in &self.velocities {
                line.fill(0.0);
                for other in on.clone() {
                    let row = &enhanced[other * n..][..n];
                    let ahead = velocity * (other as f64 - step as f64);
                    add_shifted(row, (ahead + 0.5).floor() as isize, recording.closed, &mut line);
                }
                scores.iter_mut().zip(&line).for_each(|(score, sum)| *score = score.min(*sum));
            }
            bar.inc(1);
            let (place, unique) = self.best(&scores, on.len() as f64, recording.closed);
            (Some(place), unique)
        });
        let (places, confidence) = answers.unzip();
        Answers { method: method.into(), places, confidence, ..Answers::default() }
    }

    /// Returns the place with the lowest sum over `count` steps, and its uniqueness.
    fn best(&self, sums: &[f32], count: f64, closed: bool) -> (usize, f64) {
        let n = sums.len();
        let lowest = |best: (usize, f32), (i, &sum)| if sum < best.1 { (i, sum) } else { best };
        let (place, best) = sums.iter().enumerate().fold((0, f32::INFINITY), lowest);
        let apart = |i: usize| {
            let apart = i.abs_diff(place);
            if closed { apart.min(n - apart) } else { apart }
        };
        let elsewhere = sums.iter().enumerate().filter(|(i, _)| apart(*i) > self.contrast);
        let (_, second) = elsewhere.fold((0, f32::INFINITY), lowest);
        let window = self.contrast.saturating_mul(2).saturating_add(1).min(n) as f64;
        let shift = (window - 1.0) / window.sqrt();
        let shifted = |sum: f32| f64::from(sum) / count + shift;
        let unique = if second.is_finite() && shifted(second) > 0.0 {
            1.0 - shifted(best) / shifted(second)
        } else {
            0.0
        };
        (place, unique)
    }
}

/// Adds to each place the value of the row at `by` places further on.
fn add_shifted(row: &[f32], by: isize, closed: bool, to: &mut [f32]) {
    let add = |to: &mut [f32], row: &[f32]| to.iter_mut().zip(row).for_each(|(to, x)| *to += x);
    let n = row.len();
    if closed {
        let by = by.rem_euclid(n.cast_signed()).cast_unsigned();
        add(&mut to[..n - by], &row[by..]);
        add(&mut to[n - by..], &row[..by]);
    } else {
        let beyond = by.unsigned_abs().min(n);
        if by < 0 {
            add(&mut to[beyond..], row);
        } else {
            add(to, &row[beyond..]);
        }
    }
}

#[cfg(test)]
mod tests {
    #![expect(clippy::cast_possible_wrap, clippy::cast_sign_loss, reason = "small numbers")]

    use proptest::prelude::*;

    use super::*;

    fn recording(distances: Vec<f32>, references: usize, closed: bool) -> Recording {
        let truth = vec![None; distances.len() / references];
        Recording { references, distances, truth, closed, ..Recording::default() }
    }

    /// Recordings of whole numbers, whose sums are exact; of few values, so that there are ties.
    fn recordings() -> impl Strategy<Value = Recording> {
        (1_usize..12, 1_usize..14, any::<bool>()).prop_flat_map(|(steps, references, closed)| {
            proptest::collection::vec((0_i8..20).prop_map(f32::from), steps * references)
                .prop_map(move |distances| recording(distances, references, closed))
        })
    }

    /// Reference on a line, if the map has one there.
    fn passed(recording: &Recording, place: usize, ahead: i64) -> Option<usize> {
        let (n, at) = (recording.references as i64, place as i64 + ahead);
        let at = if recording.closed { at.rem_euclid(n) } else { at };
        (0..n).contains(&at).then_some(at as usize)
    }

    proptest! {
        #[test]
        fn contrast_is_that_of_the_window(recording in recordings(), contrast in 0_usize..5) {
            let seqslam = SeqSlam { contrast, sequences: vec![1], velocities: vec![1.0] };
            let enhanced = seqslam.enhance(&recording);
            let n = recording.references;
            for (at, found) in enhanced.iter().enumerate() {
                let (step, place) = (at / n, at % n);
                let reach = contrast as i64;
                let reach = if recording.closed { reach.min((n as i64 - 1) / 2) } else { reach };
                let around = (-reach..=reach).filter_map(|by| passed(&recording, place, by));
                let window: Vec<f64> =
                    around.map(|i| f64::from(recording.row(step)[i])).collect();
                let count = window.len() as f64;
                let mean = window.iter().sum::<f64>() / count;
                let square = window.iter().map(|d| (d - mean) * (d - mean)).sum::<f64>();
                let expected = if square == 0.0 {
                    0.0
                } else {
                    (f64::from(recording.row(step)[place]) - mean) / (square / (count - 1.0)).sqrt()
                };
                prop_assert!((expected - f64::from(*found)).abs() < 1e-5);
                prop_assert!(f64::from(found.abs()) <= (count - 1.0) / count.sqrt() + 1e-5);
            }
        }

        /// Compares with the best of all lines, evaluated one by one.
        #[test]
        fn lines_are_the_best(
            recording in recordings(),
            contrast in 0_usize..3,
            sequence in 1_usize..9,
            velocities in proptest::collection::vec(-1.5..2.5, 1..4),
            centred in any::<bool>(),
        ) {
            let (n, steps) = (recording.references, recording.steps());
            let seqslam = SeqSlam { contrast, sequences: vec![sequence], velocities: velocities.clone() };
            let alignment = if centred { Alignment::Centred } else { Alignment::Trailing };
            let bar = ProgressBar::hidden();
            let answers =
                seqslam.answers(&recording, &recording.distances, sequence, alignment, &bar);
            for step in 0..steps {
                let back = if centred { sequence / 2 } else { sequence - 1 };
                let all = (0..sequence).map(|i| step as i64 - back as i64 + i as i64);
                let on: Vec<i64> = all.filter(|at| (0..steps as i64).contains(at)).collect();
                let score = |place: usize| {
                    let of_line = |velocity: &f64| {
                        let at = |other: i64| {
                            let ahead = (velocity * (other - step as i64) as f64 + 0.5).floor();
                            passed(&recording, place, ahead as i64)
                                .map_or(0.0, |i| f64::from(recording.row(other as usize)[i]))
                        };
                        on.iter().map(|other| at(*other)).sum::<f64>() / on.len() as f64
                    };
                    velocities.iter().map(of_line).fold(f64::INFINITY, f64::min)
                };
                let scores: Vec<f64> = (0..n).map(score).collect();
                let best = scores.iter().copied().fold(f64::INFINITY, f64::min);
                let place = scores.iter().position(|score| *score == best).unwrap();
                prop_assert_eq!(answers.places[step], Some(place));

                let apart = |i: usize| {
                    let around = (place + n - i).min(i + n - place);
                    if recording.closed { i.abs_diff(place).min(around) } else { i.abs_diff(place) }
                };
                let second = (0..n).filter(|i| apart(*i) > contrast).map(|i| scores[i]);
                let second = second.fold(f64::INFINITY, f64::min);
                let window = (2 * contrast + 1).min(n) as f64;
                let shift = (window - 1.0) / window.sqrt();
                let expected = if second == f64::INFINITY || second + shift == 0.0 {
                    0.0
                } else {
                    1.0 - (best + shift) / (second + shift)
                };
                prop_assert!((answers.confidence[step] - expected).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn a_clear_line_is_found() {
        let (steps, references) = (30, 40);
        let other = |step: usize, i: usize| 3.0 + ((step * 31 + i * 17) % 13) as f32;
        let cells = (0..steps).flat_map(|step| (0..references).map(move |i| (step, i)));
        let distances = cells.map(|(step, i)| if i == 5 + step { 0.0 } else { other(step, i) });
        let recording = recording(distances.collect(), references, false);
        let velocities = vec![0.8, 1.0, 1.2];
        let seqslam = SeqSlam { contrast: 5, sequences: vec![10, 12], velocities };
        for (sequence, answers) in seqslam.run(&recording, |_| 1.0) {
            assert_eq!(sequence, 10); // ties go to the shorter
            assert_eq!(answers.places, (5..5 + steps).map(Some).collect::<Vec<_>>());
            assert!(answers.confidence.iter().all(|c| (0.0..=1.0).contains(c)));
        }
    }
}
