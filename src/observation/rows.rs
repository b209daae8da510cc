//! Loops along a row of distances, with the widest instructions of the machine.

use crate::kernels::{Simd, WithSimd, run};

/// Number of distances handled side by side, and of partial sums.
const WIDTH: usize = 16;

/// Moments of the finite distances of a row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct RowMoments {
    /// The number of finite distances.
    pub(crate) count: f64,
    /// Their mean; 0 if there are none.
    pub(crate) mean: f64,
    /// The sum of their squared differences from the mean.
    pub(crate) squares: f64,
    /// False if a distance is NaN or −∞.
    pub(crate) valid: bool,
}

impl RowMoments {
    pub(crate) fn of(distances: &[f32]) -> Self {
        let Sums { count, sum, valid } = run(SumUp(distances));
        let mean = if count > 0.0 { sum / count } else { 0.0 };
        Self { count, mean, squares: run(Squares { distances, mean }), valid }
    }

    /// 1 over the standard deviation; 0 if that is 0.
    pub(crate) fn inverse_deviation(&self) -> f64 {
        let deviation = (self.squares / self.count).sqrt();
        if deviation > 0.0 { 1.0 / deviation } else { 0.0 }
    }
}

/// Score of the nearest reference, in standard deviations of a query's own distances; `None` if
/// all are infinite or equal.
pub(crate) fn nearest(distances: &[f32]) -> Option<f64> {
    let moments = RowMoments::of(distances);
    let least = distances.iter().copied().fold(f32::INFINITY, f32::min);
    let score = (f64::from(least) - moments.mean) / (moments.squares / moments.count).sqrt();
    score.is_finite().then_some(score)
}

/// Scales a difference; an infinite one stays infinite, even if the deviation is 0.
pub(super) fn scaled(centred: f64, unit: f64) -> f64 {
    if centred.is_finite() { centred * unit } else { centred }
}

struct Sums {
    count: f64,
    sum: f64,
    valid: bool,
}

struct SumUp<'a>(&'a [f32]);

impl WithSimd for SumUp<'_> {
    type Output = Sums;

    #[expect(clippy::needless_bitwise_bool, reason = "lanes do not branch")]
    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> Sums {
        let (mut counts, mut sums, mut invalid) = ([0_u32; WIDTH], [0.0; WIDTH], [0_u32; WIDTH]);
        let (chunks, rest) = self.0.as_chunks::<WIDTH>();
        let mut take = |l: usize, d: f32| {
            let finite = d.is_finite();
            counts[l] += u32::from(finite);
            sums[l] += f64::from(if finite { d } else { 0.0 });
            invalid[l] |= u32::from(d.is_nan() | (d == f32::NEG_INFINITY));
        };
        for chunk in chunks {
            for (l, d) in chunk.iter().enumerate() {
                take(l, *d);
            }
        }
        rest.iter().enumerate().for_each(|(l, d)| take(l, *d));
        let valid = invalid.iter().all(|invalid| *invalid == 0);
        let count = counts.iter().map(|count| f64::from(*count)).sum();
        Sums { count, sum: sums.iter().sum(), valid }
    }
}

struct Squares<'a> {
    distances: &'a [f32],
    mean: f64,
}

impl WithSimd for Squares<'_> {
    type Output = f64;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> f64 {
        let Self { distances, mean } = self;
        let mut sums = [0.0; WIDTH];
        let (chunks, rest) = distances.as_chunks::<WIDTH>();
        let mut take = |l: usize, d: f32| {
            let centred = f64::from(d) - mean;
            sums[l] += if d.is_finite() { centred * centred } else { 0.0 };
        };
        for chunk in chunks {
            for (l, d) in chunk.iter().enumerate() {
                take(l, *d);
            }
        }
        rest.iter().enumerate().for_each(|(l, d)| take(l, *d));
        sums.iter().sum()
    }
}

/// Mean absolute difference of two rows over the distances finite in both, in standard
/// deviations of the second row; infinite if there are none, or they do not vary. `moments`
/// are those of the second row.
pub(super) fn change(before: &[f32], now: &[f32], moments: &RowMoments) -> f64 {
    let compare = |mean| run(Compare { before, now, mean });
    let mut changes = compare(moments.mean);
    if changes.count < moments.count {
        // About the mean of the compared distances: sums of singles are exact in doubles, so that
        // equal ones have a deviation of exactly 0.
        let both = before.iter().zip(now).filter(|(a, b)| a.is_finite() && b.is_finite());
        let sum: f64 = both.map(|pair| f64::from(*pair.1)).sum();
        changes = compare(sum / changes.count);
    }
    let Changes { count, moved, squares } = changes;
    let deviation = (squares / count).sqrt();
    match count {
        0.0 => f64::INFINITY,
        _ if moved == 0.0 => 0.0,
        _ => moved / count / deviation,
    }
}

struct Changes {
    count: f64,
    moved: f64,
    squares: f64,
}

struct Compare<'a> {
    before: &'a [f32],
    now: &'a [f32],
    mean: f64,
}

impl WithSimd for Compare<'_> {
    type Output = Changes;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> Changes {
        let Self { before, now, mean } = self;
        let mut counts = [0_u32; WIDTH];
        let (mut moved, mut squares) = ([0.0; WIDTH], [0.0; WIDTH]);
        let ((a, a_rest), (b, b_rest)) = (before.as_chunks::<WIDTH>(), now.as_chunks::<WIDTH>());
        let mut take = |l: usize, a: f32, b: f32| {
            let finite = a.is_finite() & b.is_finite();
            counts[l] += u32::from(finite);
            let (a, b) = (f64::from(a), f64::from(b));
            moved[l] += if finite { (a - b).abs() } else { 0.0 };
            squares[l] += if finite { (b - mean) * (b - mean) } else { 0.0 };
        };
        for (a, b) in a.iter().zip(b) {
            for l in 0..WIDTH {
                take(l, a[l], b[l]);
            }
        }
        a_rest.iter().zip(b_rest).enumerate().for_each(|(l, (a, b))| take(l, *a, *b));
        Changes {
            count: counts.iter().map(|count| f64::from(*count)).sum(),
            moved: moved.iter().sum(),
            squares: squares.iter().sum(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(n: usize, factor: f32) -> Vec<f32> {
        (1..=n).map(|i| (i as f32 * factor).fract()).collect()
    }

    #[test]
    fn moments_are_those_of_the_definition() {
        for n in [0, 1, 5, 16, 33, 100] {
            let mut row = row(n, 0.618_034);
            row.iter_mut().skip(3).step_by(7).for_each(|d| *d = f32::INFINITY);
            let finite: Vec<f64> =
                row.iter().filter(|d| d.is_finite()).map(|d| f64::from(*d)).collect();
            let mean = finite.iter().sum::<f64>() / f64::max(finite.len() as f64, 1.0);
            let squares: f64 = finite.iter().map(|d| (d - mean).powi(2)).sum();
            let moments = RowMoments::of(&row);
            assert_eq!(moments.count, finite.len() as f64);
            assert!((moments.mean - mean).abs() < 1e-12 && moments.valid);
            assert!((moments.squares - squares).abs() < 1e-12);
            for at in 0..n {
                for invalid in [f32::NAN, f32::NEG_INFINITY] {
                    let mut row = row.clone();
                    row[at] = invalid;
                    assert!(!RowMoments::of(&row).valid);
                }
            }
        }
        assert_eq!(RowMoments::of(&[0.5; 20]).inverse_deviation(), 0.0);
        assert_eq!(RowMoments::of(&[f32::INFINITY; 20]).inverse_deviation(), 0.0);
    }

    #[test]
    fn a_change_is_that_of_the_definition() {
        for n in [1, 5, 16, 33, 100] {
            let (mut a, mut b) = (row(n, 0.618_034), row(n, 0.414_213_5));
            a.iter_mut().skip(4).step_by(7).for_each(|d| *d = f32::INFINITY);
            b.iter_mut().skip(5).step_by(9).for_each(|d| *d = f32::NAN);
            let pairs = a.iter().zip(&b).map(|(a, b)| (f64::from(*a), f64::from(*b)));
            let pairs: Vec<_> = pairs.filter(|(a, b)| a.is_finite() && b.is_finite()).collect();
            let count = pairs.len() as f64;
            let mean = pairs.iter().map(|pair| pair.1).sum::<f64>() / count;
            let squares: f64 = pairs.iter().map(|pair| (pair.1 - mean).powi(2)).sum();
            let moved: f64 = pairs.iter().map(|(a, b)| (a - b).abs()).sum();
            let expected = moved / count / (squares / count).sqrt();
            let found = change(&a, &b, &RowMoments::of(&b));
            assert!(n == 1 || (found / expected - 1.0).abs() < 1e-9, "{n}: {found} {expected}");
            let same = &b[..4.min(n)];
            assert_eq!(change(same, same, &RowMoments::of(same)), 0.0);
        }
        let equal = RowMoments::of(&[0.1; 37]);
        assert_eq!(change(&[f32::INFINITY; 37], &[0.1; 37], &equal), f64::INFINITY);
        assert_eq!(change(&[0.2; 37], &[0.1; 37], &equal), f64::INFINITY);
    }
}
