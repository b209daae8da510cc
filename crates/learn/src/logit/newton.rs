//! The maximum of a concave objective by Newton's method, damped where a step would go too far
//! (Levenberg 1944, Marquardt 1963).
//!
//! **No step lowers the objective.** A step that changes the scores of each row by a range of at
//! most 1/2 raises it: along the step the information grows by a factor below e^{1/2} (its
//! derivative is a third cumulant, at most the range times the variance), and g · δ − e^{1/2} δ' H
//! δ / 2 > 0. A longer step is taken only if the objective is seen to rise; otherwise it is
//! shortened, then damped.

use super::expansion::{Expansion, Step};

/// A step that changes scores by at most this is the last: the next one would be its square.
const LAST: f64 = 1e-7;
/// Range of changes of scores up to which a step needs no test.
const SAFE: f64 = 0.5;
/// A predicted gain below this part of the expected number of steps is rounding.
const ROUNDING: f64 = 1e-14;
/// The same for the gain of a damped step.
const NOTHING: f64 = 1e-10;
/// A step that goes too far is tried again at this length.
const SHORTER: f64 = 0.25;
/// The least damping.
const DAMPING: f64 = 1e-3;
/// Largest number of steps tried. Newton's method takes about ten, inputs that separate moves 40.
const MOST: usize = 200;

/// One origin: its moves, and how often they were seen at each row of inputs.
#[derive(Debug)]
pub(super) struct Seen {
    /// Number of its first move among all moves.
    pub(super) first: usize,
    /// Groups of slopes of its moves, numbered within the part, ascending.
    pub(super) groups: Vec<usize>,
    /// The group of each move, numbered within the part.
    pub(super) group_of: Vec<Option<usize>>,
    /// The move that was seen most often, whose intercept stays: it is not rare, so that the
    /// intercepts of the others are well determined.
    pub(super) reference: usize,
    /// Numbers of rows, and for each row the weights of the moves.
    pub(super) rows: Vec<usize>,
    pub(super) weights: Vec<f64>,
}

impl Seen {
    pub(super) fn rows<'a>(
        &'a self,
        part: &'a Part<'_>,
    ) -> impl Iterator<Item = (&'a [f64], &'a [f64])> {
        let rows =
            self.rows.iter().map(|row| &part.inputs_of_rows[row * part.inputs..][..part.inputs]);
        rows.zip(self.weights.chunks_exact(self.group_of.len()))
    }

    /// Score of a move or, for the numbers of a step, its change by the step.
    #[inline]
    pub(super) fn score(&self, at: usize, intercepts: &[f64], slopes: &[f64], x: &[f64]) -> f64 {
        let slopes = match self.group_of[at] {
            Some(group) => &slopes[group * x.len()..(group + 1) * x.len()],
            None => &[],
        };
        intercepts[at] + slopes.iter().zip(x).map(|(b, x)| b * x).sum::<f64>()
    }
}

/// Origins that share slopes, directly or through others, and so are maximised together.
#[derive(Debug)]
pub(super) struct Part<'a> {
    pub(super) inputs: usize,
    /// Rows of inputs, one after another, for all parts.
    pub(super) inputs_of_rows: &'a [f64],
    /// Precision of the prior on the slopes of each input.
    pub(super) ridge: &'a [f64],
    pub(super) origins: Vec<Seen>,
    /// Its groups of slopes among all groups, ascending, from 0.
    pub(super) groups: Vec<usize>,
}

/// Coefficients of a part.
#[derive(Debug, Clone)]
pub(super) struct Point {
    /// By origin, then by move.
    pub(super) intercepts: Vec<Vec<f64>>,
    pub(super) slopes: Vec<f64>,
}

impl Point {
    fn zeros(&self) -> Self {
        Self {
            intercepts: self.intercepts.iter().map(|values| vec![0.0; values.len()]).collect(),
            slopes: vec![0.0; self.slopes.len()],
        }
    }

    fn after(&self, step: &Step) -> Self {
        let add = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a + b).collect();
        let pairs = self.intercepts.iter().zip(&step.intercepts);
        Self {
            intercepts: pairs.map(|(a, b)| add(a, b)).collect(),
            slopes: add(&self.slopes, &step.slopes),
        }
    }
}

/// Largest range, over all rows, of the changes of the scores of a row by a step.
fn reach(part: &Part<'_>, step: &Step) -> f64 {
    let mut reach = 0.0_f64;
    for (seen, intercepts) in part.origins.iter().zip(&step.intercepts) {
        for (x, _) in seen.rows(part) {
            let changes =
                (0..intercepts.len()).map(|at| seen.score(at, intercepts, &step.slopes, x));
            let (low, high) = changes.fold((f64::INFINITY, f64::NEG_INFINITY), |range, change| {
                (range.0.min(change), range.1.max(change))
            });
            reach = reach.max(high - low);
        }
    }
    reach
}

/// Climbs to the maximum. Returns `None` if the point is the maximum already, up to rounding.
pub(super) fn climb(part: &Part<'_>, start: &Point) -> Option<Point> {
    let (mut point, mut damping) = (None::<Point>, 0.0_f64);
    let mut now = Expansion::at(part, start);
    let mut gain_before = f64::INFINITY;
    for _ in 0..MOST {
        let step = now.step(part, damping);
        let (reach, rounding) = (reach(part, &step), ROUNDING * now.weight);
        // Numbers beyond doubles; or even a damped step, which follows any gradient there is, gains
        // nothing.
        if !step.gain.is_finite() || (damping > 0.0 && step.gain <= rounding) {
            break;
        }
        let after = |step: &Step| point.as_ref().unwrap_or(start).after(step);
        // Coefficients that run to infinity have long steps for hardly any gain. A gain that no
        // longer falls fourfold, where Newton's method squares it, is rounding.
        let flat = step.gain <= rounding && (reach > SAFE || step.gain > gain_before / 4.0);
        if damping == 0.0 && (flat || reach <= LAST) {
            // Where a probability is so near to 0 or 1 that the information underflows, there may
            // be a gradient all the same.
            let damped = now.step(part, DAMPING).gain;
            if damped > step.gain && damped > NOTHING * now.weight {
                // The scores may be farther out than steps can lead back from: coefficients of 0
                // may be better.
                let zeros = start.zeros();
                let at_zeros = Expansion::at(part, &zeros);
                if at_zeros.value > now.value {
                    (point, now, gain_before) = (Some(zeros), at_zeros, f64::INFINITY);
                } else {
                    damping = DAMPING;
                }
                continue;
            }
            let moves = step.gain > 0.0 && reach <= SAFE;
            return if moves { Some(after(&step)) } else { point };
        }
        // A step that goes too far is taken in part: coefficients that run to infinity rise by
        // small steps.
        let (mut step, mut left) = (step, reach);
        let found = loop {
            let next_point = after(&step);
            let next = Expansion::at(part, &next_point);
            if reach <= SAFE || next.value > now.value {
                break Some((next_point, next));
            }
            if damping > 0.0 || left <= SAFE {
                break None;
            }
            (step, left) = (step.scaled(SHORTER), left * SHORTER);
        };
        if let Some((next_point, next)) = found {
            (point, now, gain_before) = (Some(next_point), next, step.gain);
            damping = if damping > DAMPING { damping / 10.0 } else { 0.0 };
        } else {
            damping = (damping * 10.0).max(DAMPING);
        }
    }
    point
}

/// Moves whose probability a further step would lower by a factor of √e or more at some row, as
/// pairs (origin within the part, move of the origin).
pub(super) fn running(part: &Part<'_>, point: &Point) -> Vec<(usize, usize)> {
    let step = Expansion::at(part, point).step(part, 0.0);
    let mut found = Vec::new();
    for (origin, (seen, intercepts)) in part.origins.iter().zip(&point.intercepts).enumerate() {
        let mut falls = vec![false; intercepts.len()];
        for (x, _) in seen.rows(part) {
            let score = |at: usize| seen.score(at, intercepts, &point.slopes, x);
            let change = |at: usize| seen.score(at, &step.intercepts[origin], &step.slopes, x);
            let all = 0..intercepts.len();
            let largest = all.clone().map(score).fold(f64::NEG_INFINITY, f64::max);
            let weights = || all.clone().map(|at| (at, (score(at) - largest).exp()));
            // To first order, ln p of a move changes by the change of its score less the mean.
            let mean = weights().map(|(at, weight)| weight * change(at)).sum::<f64>()
                / weights().map(|entry| entry.1).sum::<f64>();
            let moves = falls.iter_mut().enumerate();
            moves.for_each(|(at, falls)| *falls |= change(at) - mean < -SAFE);
        }
        found.extend((0..falls.len()).filter(|at| falls[*at]).map(|at| (origin, at)));
    }
    found
}
