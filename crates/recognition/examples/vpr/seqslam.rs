//! `SeqSLAM`: the straight line with the least difference through the matrix of a query and a map
//! (Milford and Wyeth, 2012). At the ends of the query a line has only the steps that exist. Beyond
//! an open map its difference is 0, the mean of a contrast window, which favours no length.

use super::{Common, Method, Recording, Task, recall};

/// Answers of lines that end at the answered step, as live, and of lines centred on it, each with
/// the length that has the best recall on the reported steps, the shortest one on ties.
pub(crate) fn run(Task { recording, split, common }: Task<'_>) -> Vec<(usize, Method)> {
    let Common { sequence, velocities, contrast, tolerance, .. } = common;
    let lengths = sequence.map_or(vec![10, 20, 50, 100], |steps| vec![steps.get()]);
    let bar = super::bar("SeqSLAM", 2 * lengths.len() * recording.steps());
    let enhanced = Recording { distances: enhance(recording, *contrast), ..recording.clone() };
    let best = [false, true].into_iter().filter_map(|centred| {
        let tried = lengths.iter().map(|&length| {
            let answers = answers(&enhanced, velocities, *contrast, length, centred);
            bar.inc(recording.steps() as u64);
            let recall = recall(recording, &answers.places, tolerance[0], &split.report_on);
            (recall, length, answers)
        });
        tried.reduce(|best, next| if next.0 > best.0 { next } else { best })
    });
    let best = best.map(|(_, length, answers)| (length, answers)).collect();
    bar.finish_and_clear();
    best
}

/// Normalises each difference by those at the references around it: subtracts their mean and
/// divides by their sample standard deviation; flat windows become 0. Infinite differences stay
/// infinite and do not count. O(T × n × window).
fn enhance(recording: &Recording, contrast: usize) -> Vec<f32> {
    let (n, closed) = (recording.references, recording.closed);
    // Around a loop, a window contains each reference at most once.
    let reach = contrast.min(if closed { (n - 1) / 2 } else { n });
    let enhanced = |row: &[f32], i: usize| {
        let window = (i + n - reach..=i + n + reach).filter(|j| closed || j / n == 1);
        let window = window.map(|j| f64::from(row[j % n])).filter(|d| d.is_finite());
        let (count, sum) = window.clone().fold((0.0, 0.0), |(n, sum), d| (n + 1.0, sum + d));
        let mean = sum / count;
        let variance = window.map(|d| (d - mean).powi(2)).sum::<f64>() / (count - 1.0);
        let value = (f64::from(row[i]) - mean) / variance.sqrt();
        if row[i].is_finite() && !value.is_finite() { 0.0 } else { value as f32 }
    };
    let rows = recording.distances.chunks_exact(n);
    rows.flat_map(|row| (0..n).map(move |i| enhanced(row, i))).collect()
}

/// Returns, for each step, the place at the end or in the middle of the best line of a length, with
/// the margin to the best line elsewhere as confidence. O(T × n × slopes × length).
fn answers(
    of: &Recording,
    slopes: &[f64],
    contrast: usize,
    length: usize,
    centred: bool,
) -> Method {
    let (n, steps) = (of.references, of.steps());
    let name = if centred { "seqslam_centred" } else { "seqslam_trailing" };
    let after = if centred { length - length / 2 } else { 1 };
    let (mut scores, mut line) = (vec![0.0; n], vec![0.0; n]);
    let answers = (0..steps).map(|step| {
        let on = (step + after).saturating_sub(length)..steps.min(step + after);
        scores.fill(f32::INFINITY);
        for slope in slopes {
            line.fill(0.0);
            for other in on.clone() {
                let row = &of.distances[other * n..][..n];
                // Where a line that passes place i at `step` is at the other step: i + ahead. All
                // places at once are a shift of the row.
                let ahead = (slope * (other as f64 - step as f64) + 0.5).floor() as isize;
                add_shifted(row, ahead, of.closed, &mut line);
            }
            scores.iter_mut().zip(&line).for_each(|(score, sum)| *score = score.min(*sum));
        }
        let lowest = |best: (usize, f32), (i, &sum)| if sum < best.1 { (i, sum) } else { best };
        let (place, best) = scores.iter().enumerate().fold((0, f32::INFINITY), lowest);
        // The runner-up must be outside the contrast window: the neighbours of the best place are
        // as good.
        let apart = |(i, _): &(usize, &f32)| of.gap(*i, &(place..=place)) > contrast;
        let (_, second) = scores.iter().enumerate().filter(apart).fold((0, f32::MAX), lowest);
        (Some(place), f64::from(second - best.min(f32::MAX)) / on.len() as f64)
    });
    let (places, confidence) = answers.unzip();
    Method { name, places, confidence, ..Method::default() }
}

/// Adds to each place the value of the row `by` places further on.
fn add_shifted(row: &[f32], by: isize, closed: bool, to: &mut [f32]) {
    let add = |to: &mut [f32], row: &[f32]| to.iter_mut().zip(row).for_each(|(to, x)| *to += x);
    let n = row.len();
    if closed {
        let by = by.rem_euclid(n.cast_signed()).cast_unsigned();
        add(&mut to[..n - by], &row[by..]);
        add(&mut to[n - by..], &row[..by]);
    } else if by < 0 {
        add(&mut to[by.unsigned_abs().min(n)..], row);
    } else {
        add(to, &row[by.unsigned_abs().min(n)..]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Compares with the best of all lines, evaluated one by one: sums of whole numbers are exact.
    #[test]
    fn lines_are_the_best() {
        let distances: Vec<f32> = (0..140_u32).map(|i| (i * i * 37 % 101 % 20) as f32).collect();
        let slopes = [-0.7, 0.5, 1.0, 2.2];
        for (length, closed, centred) in
            (1..20).flat_map(|i| [(i, i % 3 == 0, false), (i, i % 3 == 1, true)])
        {
            let (distances, references) = (distances.clone(), if length > 9 { 7 } else { 14 });
            let of = Recording { references, distances, closed, ..Recording::default() };
            let (n, rows) = (references.cast_signed(), of.rows());
            let found = answers(&of, &slopes, 2, length, centred).places;
            for (step, found) in found.into_iter().enumerate() {
                let end = step + if centred { length - length / 2 } else { 1 };
                let on = end.saturating_sub(length)..end.min(rows.len());
                let cell = |place: usize, slope: f64, other: usize| {
                    let ahead = slope * (other as f64 - step as f64) + 0.5;
                    let at = place.cast_signed() + ahead.floor() as isize;
                    let at = if closed { at.rem_euclid(n) } else { at };
                    *rows[other].get(at.cast_unsigned()).unwrap_or(&0.0)
                };
                let line = |i, slope| on.clone().map(|other| cell(i, slope, other)).sum::<f32>();
                let score =
                    |i| slopes.map(|slope| line(i, slope)).into_iter().fold(f32::MAX, f32::min);
                let best = (0..references).min_by(|a, b| score(*a).total_cmp(&score(*b)));
                assert_eq!(found, best, "step {step}, {length} steps, {closed}, {centred}");
            }
        }
    }
}
