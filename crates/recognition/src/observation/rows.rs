//! What a row of distances says by itself, in loops that vectorise: scores within the row, which a few
//! references cannot move, and the change from one row to another (`guide::formulas`, Scores within a
//! row, and Views).

use std::f32::consts::{LN_2, LOG2_E};

use super::error::ViewError;
use wayfix_kernels::{Simd, WithSimd, run};

/// Ratio of the standard deviation of a normal distribution to its median deviation.
const NORMAL: f64 = 1.4826;
/// Deviations beyond which scores grow as a logarithm.
const LINEAR: f32 = 3.0;
/// Deviations beyond which they no longer grow: such a distance is broken, not near or far.
const MOST: f32 = 1000.0;
/// Scores count as at most this in a [`change`]. With less, the matches of a dense route with clear
/// images would no longer change; with more, a few broken references would hide the change of all
/// others.
const MOST_CHANGED: f32 = 5.0;
/// Number of values above which a sample narrows the search for their median, and the sample's
/// size.
const MANY: usize = 512;
const SAMPLE: usize = 128;

/// Scratch memory for [`row_scores`].
#[derive(Debug, Clone, Default)]
pub(crate) struct RowScratch {
    finite: Vec<f32>,
    middle: Vec<f32>,
}

/// Computes the score of each distance of a row: its difference from the median, in median
/// deviations scaled to a standard deviation of 1 for normal ones, and beyond three of them as a
/// logarithm, up to 1000. So no reference moves another's score by more than its rank does, nor
/// wins for ever by one broken value, and order is kept. Infinite distances stay infinite. Returns
/// the number of finite distances.
pub(crate) fn row_scores(
    distances: &[f32],
    out: &mut Vec<f32>,
    scratch: &mut RowScratch,
) -> Result<usize, ViewError> {
    // A fold without an early exit vectorises.
    let all_finite = distances.iter().fold(true, |all, d| all & d.is_finite());
    let invalid = |d: &f32| d.is_nan() || *d == f32::NEG_INFINITY;
    if !all_finite && let Some(reference) = distances.iter().position(invalid) {
        return Err(ViewError::Distance { reference, value: distances[reference] });
    }
    let RowScratch { finite, middle } = scratch;
    finite.clear();
    middle.clear();
    // Reserved in full, so that a later row with fewer infinite distances needs no more memory.
    finite.reserve(distances.len());
    middle.reserve(distances.len());
    if all_finite {
        finite.extend_from_slice(distances);
    } else {
        finite.extend(distances.iter().filter(|d| d.is_finite()));
    }
    let count = finite.len();
    out.clear();
    if count == 0 {
        out.resize(distances.len(), f32::INFINITY);
        return Ok(0);
    }
    let centre = median(finite, middle);
    // A difference of two finite floats may overflow. It can be bounded, since only its rank
    // matters.
    finite.iter_mut().for_each(|d| *d = (*d - centre).abs().min(f32::MAX));
    let mut deviation = NORMAL * f64::from(median(finite, middle));
    if deviation == 0.0 {
        // More than half of the distances are equal: take the median deviation of the others. If
        // all are equal, an infinite deviation makes all scores 0.
        finite.retain(|d| *d > 0.0);
        let others = !finite.is_empty();
        deviation = if others { f64::from(median(finite, middle)) } else { f64::INFINITY };
    }
    out.resize(distances.len(), 0.0);
    run(Score { distances, centre: f64::from(centre), unit: 1.0 / deviation, out });
    Ok(count)
}

/// Upper median of at least one value.
fn median(values: &[f32], middle: &mut Vec<f32>) -> f32 {
    let rank = values.len() / 2;
    let select = |of: &mut [f32], rank: usize| *of.select_nth_unstable_by(rank, f32::total_cmp).1;
    if values.len() > MANY {
        let mut sample = [0.0; SAMPLE];
        for (at, sampled) in sample.iter_mut().enumerate() {
            *sampled = values[at * values.len() / SAMPLE];
        }
        sample.sort_unstable_by(f32::total_cmp);
        // The median's rank in a sample of n has the deviation √n / 2, here 5.7; three deviations
        // are 17.
        let (low, high) = (sample[SAMPLE / 2 - 17], sample[SAMPLE / 2 + 17]);
        // `middle` only grows: with one slot for each value, the loop below writes without a
        // branch, and an entry that is not kept is overwritten by the next.
        if middle.len() < values.len() {
            middle.resize(values.len(), 0.0);
        }
        let (mut below, mut count) = (0, 0);
        for value in values {
            below += usize::from(*value < low);
            middle[count] = *value;
            count += usize::from((low..=high).contains(value));
        }
        // The value of this rank is among those kept: the search is exact, and the sample saved
        // time. Otherwise, as for sorted or periodic rows, all values are searched.
        if (below..below + count).contains(&rank) {
            return select(&mut middle[..count], rank - below);
        }
    }
    middle.clear();
    middle.extend_from_slice(values);
    select(middle, rank)
}

struct Score<'a> {
    distances: &'a [f32],
    centre: f64,
    unit: f64,
    out: &'a mut [f32],
}

impl WithSimd for Score<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Self { distances, centre, unit, out } = self;
        for (out, &d) in out.iter_mut().zip(distances) {
            let score = ((f64::from(d) - centre) * unit) as f32;
            let size = score.abs().min(MOST);
            let beyond = (size - LINEAR).max(0.0);
            let bent = (size.min(LINEAR) + ln_1p(beyond)).copysign(score);
            *out = if d == f32::INFINITY { f32::INFINITY } else { bent };
        }
    }
}

/// Score clipped to the range where it counts for a change.
#[inline(always)]
pub(crate) fn within(score: f32) -> f32 {
    score.clamp(-MOST_CHANGED, MOST_CHANGED)
}

/// Change between two rows of scores: Σ (a − b)² / Σ (a² + b²), over references with finite scores
/// in both, each within ±5, so that a few references at extreme distances do not hide the change of
/// all others. 0 for equal rows, about 1 for two that have nothing in common, and 1 if nothing can
/// be compared.
pub(crate) fn change(a: &[f32], b: &[f32]) -> f64 {
    match run(Compare { a, b }) {
        None => 1.0,
        // If all scores are 0, so is the size.
        Some([0.0, _]) => 0.0,
        Some([difference, size]) => difference / size,
    }
}

/// Sums of (a − b)² and of a² + b²; `None` if no reference has finite scores in both rows.
struct Compare<'a> {
    a: &'a [f32],
    b: &'a [f32],
}

impl WithSimd for Compare<'_> {
    type Output = Option<[f64; 2]>;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> Self::Output {
        let (mut difference, mut size) = ([0.0_f64; WIDTH], [0.0_f64; WIDTH]);
        let mut counts = [0_u32; WIDTH];
        let mut take = |l: usize, a: f32, b: f32| {
            // Selections instead of branches; each lane has sums of its own, so that they
            // vectorise.
            let both = a.is_finite() & b.is_finite();
            let (a, b) = (f64::from(within(a)), f64::from(within(b)));
            counts[l] |= u32::from(both);
            difference[l] += if both { (a - b) * (a - b) } else { 0.0 };
            size[l] += if both { a * a + b * b } else { 0.0 };
        };
        let ((a, a_rest), (b, b_rest)) = (self.a.as_chunks::<WIDTH>(), self.b.as_chunks::<WIDTH>());
        for (a, b) in a.iter().zip(b) {
            for l in 0..WIDTH {
                take(l, a[l], b[l]);
            }
        }
        a_rest.iter().zip(b_rest).enumerate().for_each(|(l, (a, b))| take(l, *a, *b));
        let compared = counts.iter().any(|any| *any > 0);
        compared.then(|| [difference.iter().sum(), size.iter().sum()])
    }
}

/// Number of scores handled side by side.
const WIDTH: usize = 16;

/// ln(1 + x), for x of at least 0.
#[inline(always)]
fn ln_1p(x: f32) -> f32 {
    single_log2((1.0 + x).min(f32::MAX)) * LN_2
}

/// log2 of a normal number above 0, to an absolute or relative error of 2e-7.
#[inline(always)]
fn single_log2(x: f32) -> f32 {
    // The bits of √½, the smallest mantissa: with mantissas from √½ to √2, the logarithm near 1
    // does not cancel with an exponent.
    const ROOT: i32 = 0x3f35_04f3;
    let bits = x.to_bits().cast_signed();
    let exponent = (bits - ROOT) >> 23;
    let mantissa = f32::from_bits((bits - (exponent << 23)).cast_unsigned());
    // ln m = 2 artanh((m − 1) / (m + 1)).
    let t = (mantissa - 1.0) / (mantissa + 1.0);
    let square = t * t;
    let series = 1.0 + square * (1.0 / 3.0 + square * (0.2 + square * (1.0 / 7.0)));
    exponent as f32 + t * series * (2.0 * LOG2_E)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scores(row: &[f32]) -> Vec<f32> {
        let (mut out, mut scratch) = (Vec::new(), RowScratch::default());
        row_scores(row, &mut out, &mut scratch).unwrap();
        out
    }

    #[test]
    fn medians_are_those_of_a_sort() {
        let mut middle = Vec::new();
        for n in [1, 2, 5, 513, 1000, 4001] {
            for kind in 0..4_u32 {
                let value = |i: usize| match kind {
                    0 => (i as f32 * 0.618_034).fract(),
                    1 => i as f32,
                    2 => (i % 3) as f32,
                    _ => {
                        if i.is_multiple_of(70) {
                            1e30
                        } else {
                            -(i as f32)
                        }
                    }
                };
                let values: Vec<f32> = (0..n).map(value).collect();
                let mut sorted = values.clone();
                sorted.sort_by(f32::total_cmp);
                assert_eq!(median(&values, &mut middle), sorted[n / 2], "{n} {kind}");
            }
        }
    }

    #[test]
    fn scores_are_those_of_the_definition() {
        let row: Vec<f32> = (0..33).map(|i| (i as f32 * 0.618_034).fract()).collect();
        let mut sorted = row.clone();
        sorted.sort_by(f32::total_cmp);
        let centre = sorted[16];
        let mut deviations: Vec<f32> = row.iter().map(|d| (d - centre).abs()).collect();
        deviations.sort_by(f32::total_cmp);
        let unit = 1.4826 * deviations[16];
        for (d, score) in row.iter().zip(scores(&row)) {
            assert!((score - (d - centre) / unit).abs() < 1e-5);
        }
        // Far ones as a logarithm, and without an influence on others.
        let mut broken = row.clone();
        broken[4] = 1e30;
        broken[5] = -1e30;
        let far = scores(&broken);
        assert!((far[4] - 9.906).abs() < 1e-3 && (far[5] + 9.906).abs() < 1e-3);
        assert!(
            (0..33).filter(|i| *i != 4 && *i != 5).all(|i| (far[i] - scores(&row)[i]).abs() < 0.2)
        );
        assert_eq!(scores(&[0.1; 20]), [0.0; 20]);
        assert_eq!(scores(&[0.0, 0.0, 0.0, 2.0])[3], 1.0);
        assert_eq!(scores(&[f32::INFINITY; 3]), [f32::INFINITY; 3]);
        assert!(scores(&[f32::MAX, f32::MIN, 0.0, 1e-45]).iter().all(|score| score.is_finite()));
    }

    #[test]
    fn changes_are_between_0_and_2() {
        let a: Vec<f32> = (0..40).map(|i| (i as f32 * 0.7).sin()).collect();
        let b: Vec<f32> = a.iter().map(|a| -a).collect();
        assert_eq!((change(&a, &a), change(&a, &b)), (0.0, 2.0));
        assert_eq!(change(&[f32::INFINITY; 3], &[0.0; 3]), 1.0);
        assert_eq!(change(&[0.0; 3], &[0.0; 3]), 0.0);
    }
}
