//! What makes the distances of one query comparable with those of another.

use super::ObservationError;
use crate::likelihood::Scratch;

/// How distances are brought to one scale before they become likelihoods.
///
/// Images differ in how much they differ from everything: a snowy frame is far
/// from all references, a dark one near to all. What tells places apart is the
/// distance in relation to the others.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Spread {
    /// In standard deviations from the mean of the query's own distances.
    Query,
    /// The same over the references at most `radius` away along the route
    /// (Milford and Wyeth 2012: local contrast enhancement). For references
    /// that are in order; it helps where light changes along the way, and hides
    /// stretches of alike references.
    Local {
        /// How many neighbours on either side, at least 1.
        radius: usize,
        /// Whether the last reference is a neighbour of the first.
        closed: bool,
    },
    /// From the mean of the query's own distances, in this unit: one for all
    /// queries, so that one that looks like nothing says little. See
    /// [`of`](Self::of).
    Fixed(f64),
}

impl Spread {
    /// A [fixed](Self::Fixed) unit from some rows of distances: the median, over
    /// the rows, of the range from the 2.5% to the 97.5% quantile divided by
    /// ln 5, so that at temperature 1 the likelihood changes fivefold over that
    /// range (Xu, Sünderhauf and Milford 2020 scale by their first query so).
    /// O(N log N) for N distances.
    ///
    /// # Errors
    ///
    /// [`ObservationError::NoSpread`] if there are no rows, or more than half of
    /// them have no range above 0, or one that is not finite.
    pub fn of<R: AsRef<[f32]>>(rows: &[R]) -> Result<Self, ObservationError> {
        let mut ranges: Vec<f64> = rows.iter().filter_map(|row| range(row.as_ref())).collect();
        ranges.sort_by(f64::total_cmp);
        match ranges.get(ranges.len() / 2) {
            Some(&range) if range > 0.0 && range.is_finite() => Ok(Self::Fixed(range / 5f64.ln())),
            _ => Err(ObservationError::NoSpread),
        }
    }

    pub(super) fn check(self) -> Result<(), ObservationError> {
        match self {
            Self::Local { radius: 0, .. } => Err(ObservationError::Parameter {
                what: "the radius of the local contrast",
                value: 0.0,
                expected: "at least 1",
            }),
            Self::Fixed(unit) if !(unit > 0.0 && unit.is_finite()) => {
                Err(ObservationError::Parameter {
                    what: "the unit of distance",
                    value: unit,
                    expected: "a finite value above 0",
                })
            }
            _ => Ok(()),
        }
    }

    /// Distances to scores: relative to the query's mean, in units of spread.
    /// Infinite ones stay so and take no part in mean and spread; where there is
    /// no spread, all scores are 0.
    pub(super) fn apply(self, distances: &[f32], out: &mut [f64], memory: &mut Scratch) {
        let (count, mean) = moments(distances);
        let centred = |d: f32| f64::from(d) - mean;
        match self {
            Self::Query => {
                let squares =
                    distances.iter().filter(|d| d.is_finite()).map(|&d| centred(d).powi(2));
                let deviation = (squares.sum::<f64>() / count).sqrt();
                let unit = if deviation > 0.0 { 1.0 / deviation } else { 0.0 };
                out.iter_mut().zip(distances).for_each(|(out, &d)| *out = scaled(centred(d), unit));
            }
            Self::Fixed(unit) => {
                out.iter_mut().zip(distances).for_each(|(out, &d)| *out = centred(d) / unit);
            }
            Self::Local { radius, closed } => {
                // A window that would lap itself is the whole loop.
                let radius = radius.min(distances.len());
                local(distances, mean, radius, closed, out, memory);
            }
        }
    }
}

/// An infinite distance stays infinite, even where there is no spread.
fn scaled(centred: f64, unit: f64) -> f64 {
    if centred.is_finite() { centred * unit } else { centred }
}

/// How many distances are finite, and their mean.
fn moments(distances: &[f32]) -> (f64, f64) {
    let finite = distances.iter().filter(|d| d.is_finite());
    let (count, sum) = finite.fold((0.0, 0.0), |(n, sum), &d| (n + 1.0, sum + f64::from(d)));
    (count, if count > 0.0 { sum / count } else { 0.0 })
}

/// Mean and deviation of each window from running sums of the centred
/// distances and their squares.
fn local(
    distances: &[f32],
    mean: f64,
    radius: usize,
    closed: bool,
    out: &mut [f64],
    memory: &mut Scratch,
) {
    let n = distances.len();
    let value = |i: usize| Some(f64::from(distances[i]) - mean).filter(|d| d.is_finite());
    let (sums, squares) = memory.values(2 * (n + 1)).split_at_mut(n + 1);
    (sums[0], squares[0]) = (0.0, 0.0);
    for i in 0..n {
        let d = value(i).unwrap_or(0.0);
        (sums[i + 1], squares[i + 1]) = (sums[i] + d, squares[i] + d * d);
    }
    let finite = distances.iter().all(|d| d.is_finite());
    let between = |from: usize, to: usize| -> [f64; 3] {
        let count = if finite {
            to - from
        } else {
            distances[from..to].iter().filter(|d| d.is_finite()).count()
        };
        [count as f64, sums[to] - sums[from], squares[to] - squares[from]]
    };
    for (i, out) in out.iter_mut().enumerate() {
        let [count, sum, squares] = if !closed {
            between(i.saturating_sub(radius), (i + radius + 1).min(n))
        } else if 2 * radius + 1 >= n {
            between(0, n)
        } else {
            let (low, high) = (i + n - radius, i + n + radius + 1); // n too far on
            let add = |a: [f64; 3], b: [f64; 3]| [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
            if low >= n && high <= 2 * n {
                between(low - n, high - n)
            } else if low < n {
                add(between(low, n), between(0, high - n))
            } else {
                add(between(low - n, n), between(0, high - 2 * n))
            }
        };
        *out = match value(i) {
            None => f64::INFINITY,
            Some(d) => {
                let centre = sum / count;
                let variance = squares / count - centre * centre;
                // Below this, rounding of the sums is all that there is.
                let noise = 1e-12 * squares / count;
                if variance > noise { (d - centre) / variance.sqrt() } else { 0.0 }
            }
        };
    }
}

/// From the 2.5% to the 97.5% quantile of the finite distances.
fn range(row: &[f32]) -> Option<f64> {
    let mut row: Vec<f32> = row.iter().copied().filter(|d| d.is_finite()).collect();
    row.sort_by(f32::total_cmp);
    let at = |level: f64| row.get(rank(level, row.len()));
    Some(f64::from(*at(0.975)?) - f64::from(*at(0.025)?))
}

/// The index of a quantile among so many values in order.
#[expect(clippy::cast_sign_loss, reason = "a level is from 0 to 1")]
pub(super) fn rank(level: f64, count: usize) -> usize {
    (level * count.saturating_sub(1) as f64).round() as usize
}
