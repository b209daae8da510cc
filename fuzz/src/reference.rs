//! Exact inference in the plainest way: dense, in logarithms, one definition after another. No
//! code is shared with the library.

use crate::model::{Matrix, Observation, Scene};

/// Reason for an early end of a sequence, and its step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Stop {
    Impossible(usize),
    Invalid(usize),
    /// An invalid observation after an impossible measurement of a move: either error is right.
    Either(usize),
}

impl Stop {
    /// True if the error "impossible observation or move" is right.
    pub(crate) fn is_impossible(self, step: usize) -> bool {
        matches!(self, Self::Impossible(at) | Self::Either(at) if at == step)
    }

    /// True if the error "invalid observation" is right.
    pub(crate) fn is_invalid(self, step: usize) -> bool {
        matches!(self, Self::Invalid(at) | Self::Either(at) if at == step)
    }
}

/// A sequence through a model, in logarithms.
#[derive(Debug)]
pub(crate) struct Chain {
    prior: Vec<f64>,
    /// `moves[k - 1][to][from]` leads to step k; the identity at steps without a move.
    moves: Vec<Matrix>,
    /// Log-likelihoods of each step, less the largest.
    seen: Vec<Vec<f64>>,
    largest: Vec<f64>,
    /// Log factors taken out of the evidence on moves.
    log_factors: Vec<f64>,
    /// The beliefs of steps 0 to the last possible one, normalised.
    pub(crate) filtered: Vec<Vec<f64>>,
    /// ln p(y_k | y_1 … y_{k-1}).
    pub(crate) steps: Vec<f64>,
    pub(crate) stop: Option<Stop>,
}

/// The logarithm of a sum.
pub(crate) fn sum(logs: &[f64]) -> f64 {
    let largest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if largest == f64::NEG_INFINITY {
        return largest;
    }
    largest + logs.iter().map(|log| (log - largest).exp()).sum::<f64>().ln()
}

fn normalized(logs: &[f64]) -> Vec<f64> {
    let total = sum(logs);
    logs.iter().map(|log| log - total).collect()
}

pub(crate) fn logarithms(matrix: &Matrix) -> Matrix {
    matrix.iter().map(|row| row.iter().map(|a| a.ln()).collect()).collect()
}

fn identity(n: usize) -> Matrix {
    let entry = |i, j| if i == j { 0.0 } else { f64::NEG_INFINITY };
    (0..n).map(|i| (0..n).map(|j| entry(i, j)).collect()).collect()
}

impl Chain {
    /// `moves(k)` is the logarithm of the matrix that leads to step k, with the log factor of the
    /// evidence on the move, if any.
    pub(crate) fn new<'a>(
        scene: &Scene,
        moves: impl Fn(usize) -> (&'a Matrix, Option<f64>),
        drive: &[Observation],
    ) -> Self {
        let n = scene.states;
        let prior: Vec<f64> = scene.prior.iter().map(|p| p.ln()).collect();
        let mut chain = Self {
            filtered: vec![normalized(&prior)],
            prior,
            moves: Vec::new(),
            seen: Vec::new(),
            largest: Vec::new(),
            log_factors: Vec::new(),
            steps: Vec::new(),
            stop: None,
        };
        for (step, observation) in (1..).zip(drive) {
            let still = step == 1 && scene.at_first;
            let (matrix, evidence) = if still {
                (identity(n), None)
            } else {
                let (matrix, evidence) = moves(step);
                (matrix.clone(), evidence)
            };
            let predicted = product(&matrix, &chain.filtered[step - 1]);
            let log_factor = evidence.unwrap_or(0.0);
            let evidence = evidence.map_or(0.0, |log_factor| sum(&predicted) + log_factor);
            let is_impossible = evidence == f64::NEG_INFINITY;
            let Some(mut seen) = scene.logs(observation) else {
                let stop = if is_impossible { Stop::Either } else { Stop::Invalid };
                chain.stop = Some(stop(step));
                break;
            };
            if is_impossible {
                chain.stop = Some(Stop::Impossible(step));
                break;
            }
            let largest = seen.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            if largest > f64::NEG_INFINITY {
                seen.iter_mut().for_each(|log| *log -= largest);
            }
            let predicted = normalized(&predicted);
            let joint: Vec<f64> = predicted.iter().zip(&seen).map(|(p, b)| p + b).collect();
            let normalizer = sum(&joint);
            if normalizer == f64::NEG_INFINITY {
                chain.stop = Some(Stop::Impossible(step));
                break;
            }
            chain.filtered.push(normalized(&joint));
            chain.steps.push(normalizer + largest + evidence);
            chain.log_factors.push(log_factor);
            chain.moves.push(matrix);
            chain.seen.push(seen);
            chain.largest.push(largest);
        }
        chain
    }

    pub(crate) fn len(&self) -> usize {
        self.steps.len()
    }

    pub(crate) fn log_likelihood(&self) -> f64 {
        self.steps.iter().sum()
    }

    /// Sum of the terms that are taken out of the logarithms of the first steps.
    fn left_out(&self, steps: usize) -> f64 {
        self.largest.iter().zip(&self.log_factors).take(steps).map(|(a, b)| a + b).sum()
    }

    /// Total size of the terms that a logarithm is a sum of. Each factor adds a little: decoders
    /// round its logarithm to a grid, by up to 1e-14, and in the same direction each time.
    pub(crate) fn size(&self) -> f64 {
        1.0 + 0.05 * self.steps.len() as f64
            + self.largest.iter().chain(&self.steps).map(|log| log.abs()).sum::<f64>()
    }

    /// The beliefs of steps 0 to `last` given y_1 … y_last, and the pairs of each
    /// step: `pairs[k - 1][to][from]`.
    pub(crate) fn smoothed(&self, last: usize) -> (Vec<Vec<f64>>, Vec<Matrix>) {
        let n = self.prior.len();
        let mut gamma = vec![Vec::new(); last + 1];
        let mut pairs = vec![Vec::new(); last];
        let mut beta = vec![0.0; n];
        for k in (0..=last).rev() {
            let joint: Vec<f64> = self.filtered[k].iter().zip(&beta).map(|(a, b)| a + b).collect();
            gamma[k] = normalized(&joint);
            if k == 0 {
                break;
            }
            let matrix = &self.moves[k - 1];
            let after: Vec<f64> = self.seen[k - 1].iter().zip(&beta).map(|(b, x)| b + x).collect();
            let before = &self.filtered[k - 1];
            let pair = |i: usize, j: usize| before[j] + matrix[i][j] + after[i];
            let all: Vec<f64> = (0..n * n).map(|at| pair(at / n, at % n)).collect();
            pairs[k - 1] = normalized(&all).chunks(n).map(<[f64]>::to_vec).collect();
            let back = |j: usize| (0..n).map(|i| matrix[i][j] + after[i]).collect::<Vec<_>>();
            beta = (0..n).map(|j| sum(&back(j))).collect();
            // Only ratios matter. For possible states they stay near 0, with all their digits;
            // for states that nothing leads to they may be far above.
            let joint: Vec<f64> = before.iter().zip(&beta).map(|(a, b)| a + b).collect();
            let total = sum(&joint);
            beta.iter_mut().for_each(|log| *log -= total);
        }
        (gamma, pairs)
    }

    /// ln p(x_1 … x_T, y_1 … y_T) of one path, X_0 summed over.
    pub(crate) fn log_probability(&self, path: &[usize]) -> f64 {
        let mut total = 0.0;
        for (k, &i) in path.iter().enumerate() {
            total += match k {
                0 => product(&self.moves[0], &self.prior)[i],
                _ => self.moves[k][i][path[k - 1]],
            };
            total += self.seen[k][i];
        }
        total + self.left_out(path.len())
    }

    /// The `count` largest log-probabilities of paths of the first `last` steps.
    pub(crate) fn best(&self, last: usize, count: usize) -> Vec<f64> {
        if last == 0 {
            return vec![0.0; count.min(1)];
        }
        let n = self.prior.len();
        let first = product(&self.moves[0], &self.prior);
        let mut lists: Vec<Vec<f64>> =
            first.iter().zip(&self.seen[0]).map(|(x, b)| vec![x + b]).collect();
        for k in 1..last {
            let into = |i: usize| {
                let ways = (0..n)
                    .flat_map(|j| lists[j].iter().map(move |s| s + self.moves[k][i][j]))
                    .map(|score| score + self.seen[k][i]);
                largest(ways.collect(), count)
            };
            lists = (0..n).map(into).collect();
        }
        let sum = self.left_out(last);
        largest(lists.concat(), count).iter().map(|score| score + sum).collect()
    }

    /// The entropy of the path x_1 … x_T given all observations.
    pub(crate) fn path_entropy(&self) -> f64 {
        if self.len() == 0 {
            return 0.0;
        }
        let (gamma, pairs) = self.smoothed(self.len());
        let first: f64 = gamma[1].iter().map(|&log| surprise(log, 0.0)).sum();
        let others = pairs.iter().zip(&gamma).skip(1).flat_map(|(pairs, before)| {
            pairs.iter().flat_map(move |row| row.iter().zip(before).map(|(&p, &g)| surprise(p, g)))
        });
        first + others.sum::<f64>()
    }
}

/// −p ln (p / q), from the logarithms of p and q.
fn surprise(p: f64, q: f64) -> f64 {
    if p.exp() > 0.0 { -p.exp() * (p - q) } else { 0.0 }
}

/// A x, in logarithms.
fn product(matrix: &Matrix, x: &[f64]) -> Vec<f64> {
    let row = |row: &Vec<f64>| sum(&row.iter().zip(x).map(|(a, x)| a + x).collect::<Vec<_>>());
    matrix.iter().map(row).collect()
}

/// The largest of these above −∞, in descending order.
fn largest(mut scores: Vec<f64>, count: usize) -> Vec<f64> {
    scores.retain(|score| *score > f64::NEG_INFINITY);
    scores.sort_by(|a, b| b.total_cmp(a));
    scores.truncate(count);
    scores
}
