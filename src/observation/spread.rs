//! The scale that makes the distances of different queries comparable.

use super::ObservationError;
use super::rows::RowMoments;
use crate::likelihood::Scratch;

/// Scale of distances, before they become likelihoods.
///
/// Images differ in how much they differ from everything: a snowy frame is far
/// from all references, a dark one near to all. Places are told apart by the
/// distance relative to the others.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Spread {
    /// Standard deviations from the mean of the query's own distances.
    Query,
    /// Standard deviations from the mean over the references at most `radius` away along the
    /// route (Milford and Wyeth 2012: local contrast enhancement). For references in order; it
    /// helps where light changes along the way, and hides stretches of alike references.
    Local {
        /// Number of neighbours on either side, at least 1.
        radius: usize,
        /// True if the last reference is a neighbour of the first.
        closed: bool,
    },
    /// Differences from the mean of the query's own distances, in this unit: one for all queries,
    /// so that a query unlike everything says little. See [`of`](Self::of). From 1e-100 to 1e100,
    /// so that no score overflows.
    Fixed(f64),
}

impl Spread {
    /// Estimates a [fixed](Self::Fixed) unit from rows of distances: the median, over
    /// the rows, of the range from the 2.5% to the 97.5% quantile divided by
    /// ln 5, so that at temperature 1 the likelihood changes fivefold over that
    /// range. Distances that are not finite are left out. Xu, Sünderhauf and Milford (2020) scale
    /// by their first query in this way. O(N log N) for N distances.
    ///
    /// # Errors
    ///
    /// [`ObservationError::NoSpread`] if there are no rows, or the finite distances of more than
    /// half of them have a range of 0.
    pub fn of<R: AsRef<[f32]>>(rows: &[R]) -> Result<Self, ObservationError> {
        let mut ranges: Vec<f64> = rows.iter().map(|row| range(row.as_ref())).collect();
        ranges.sort_by(f64::total_cmp);
        match ranges.get(ranges.len() / 2) {
            Some(&range) if range > 0.0 => Ok(Self::Fixed(range / 5f64.ln())),
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
            Self::Fixed(unit) if !(1e-100..=1e100).contains(&unit) => {
                Err(ObservationError::Parameter {
                    what: "the unit of distance",
                    value: unit,
                    expected: "from 1e-100 to 1e100",
                })
            }
            _ => Ok(()),
        }
    }

    /// Turns distances into scores: relative to the query's mean, in units of spread. Infinite
    /// distances stay infinite and take no part in mean and spread; if the spread is 0, so are all
    /// scores.
    pub(super) fn apply(self, distances: &[f32], out: &mut [f64], memory: &mut Scratch) {
        let moments = RowMoments::of(distances);
        let centred = |d: f32| f64::from(d) - moments.mean;
        match self {
            Self::Query => {
                let unit = moments.inverse_deviation();
                out.iter_mut().zip(distances).for_each(|(out, &d)| *out = scaled(centred(d), unit));
            }
            Self::Fixed(unit) => {
                out.iter_mut().zip(distances).for_each(|(out, &d)| *out = centred(d) / unit);
            }
            Self::Local { radius, closed } => local(distances, radius, closed, out, memory),
        }
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

/// Scales a difference; an infinite one stays infinite, even if the spread is 0.
pub(super) fn scaled(centred: f64, unit: f64) -> f64 {
    if centred.is_finite() { centred * unit } else { centred }
}

/// The number of finite distances, their mean, and the sum of their squared differences from
/// it.
#[derive(Clone, Copy)]
struct Moments([f64; 3]);

impl Moments {
    const NONE: Self = Self([0.0; 3]);

    fn of(distance: f32) -> Self {
        if distance.is_finite() { Self([1.0, f64::from(distance), 0.0]) } else { Self::NONE }
    }

    /// Moments of two sets together (Chan, Golub and LeVeque 1983). Nothing cancels: equal
    /// distances have squares of exactly 0.
    fn and(self, other: Self) -> Self {
        let (Self([count, mean, squares]), Self([more, other, further])) = (self, other);
        if more == 0.0 {
            return self;
        }
        let (share, apart) = (more / (count + more), other - mean);
        let squares = squares + further + apart * apart * count * share;
        Self([count + more, mean + apart * share, squares])
    }
}

/// Scores by the mean and deviation of a window about each reference. The row is cut into blocks
/// of the window's length (van Herk 1992, Gil and Werman 1993): each window is the end of one
/// block and the beginning of the next.
fn local(distances: &[f32], radius: usize, closed: bool, out: &mut [f64], memory: &mut Scratch) {
    let n = distances.len();
    let radius = radius.min(n);
    // A window that would overlap itself is the whole loop.
    let laps = closed && 2 * radius + 1 >= n;
    let (radius, closed) = if laps { (n, false) } else { (radius, closed) };
    let length = 2 * radius + 1;
    // The window of i is from i to i + 2 `radius`, shifted by `radius`.
    let at = |k: usize| {
        let i = if closed { Some((k + n - radius) % n) } else { k.checked_sub(radius) };
        i.and_then(|i| distances.get(i)).map_or(Moments::NONE, |d| Moments::of(*d))
    };
    let (ends, _) = memory.values(3 * length).as_chunks_mut::<3>();
    let mut beginning = Moments::NONE;
    for (i, out) in out.iter_mut().enumerate() {
        let in_block = i % length;
        if in_block == 0 {
            beginning = Moments::NONE;
            let mut end = Moments::NONE;
            for (k, stored) in ends.iter_mut().enumerate().rev() {
                end = at(i + k).and(end);
                *stored = end.0;
            }
        } else {
            beginning = beginning.and(at(i + length - 1));
        }
        let Moments([count, mean, squares]) = Moments(ends[in_block]).and(beginning);
        let deviation = (squares / count).sqrt();
        *out = match f64::from(distances[i]) - mean {
            centred if centred.is_finite() && deviation == 0.0 => 0.0,
            centred if centred.is_finite() => centred / deviation,
            _ => f64::INFINITY,
        };
    }
}

/// Range from the 2.5% to the 97.5% quantile of the finite distances; 0 if there are none.
fn range(row: &[f32]) -> f64 {
    let mut row: Vec<f32> = row.iter().copied().filter(|d| d.is_finite()).collect();
    row.sort_by(f32::total_cmp);
    let at = |level: f64| row.get(rank(level, row.len())).map_or(0.0, |d| f64::from(*d));
    at(0.975) - at(0.025)
}

/// Index of a quantile among so many sorted values.
#[expect(clippy::cast_sign_loss, reason = "a level is from 0 to 1")]
pub(super) fn rank(level: f64, count: usize) -> usize {
    (level * count.saturating_sub(1) as f64).round() as usize
}
