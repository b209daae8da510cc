//! Random small models, and their answers by enumeration of all paths.
#![allow(dead_code, unreachable_pub, reason = "each test file uses its part")]

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::{
    Belief, DenseTransition, Prior, Sequence, SparseTransition, SwitchedTransition, Transition,
    TransitionEntries,
};

/// A model with a matrix for each step.
#[derive(Debug, Clone)]
pub struct Model {
    pub states: usize,
    pub at_first: bool,
    pub prior: Vec<f64>,
    /// `matrices[k - 1][to][from]` drives k − 1 → k.
    pub matrices: Vec<Vec<Vec<f64>>>,
    /// ln `b_i` of each step, `None` where nothing is observed.
    pub logs: Vec<Option<Vec<f64>>>,
}

impl Sequence<usize, Option<Vec<f64>>> for Model {
    fn steps(&self) -> usize {
        self.logs.len()
    }
    fn control(&self, step: usize) -> &usize {
        &[0, 1, 2, 3, 4, 5][step - 1]
    }
    fn observation(&self, step: usize) -> &Option<Vec<f64>> {
        &self.logs[step - 1]
    }
}

/// What there is to know, by enumeration.
#[derive(Debug)]
pub struct Answer {
    pub log_likelihood: f64,
    /// For k = 0 … T.
    pub filtered: Vec<Vec<f64>>,
    pub smoothed: Vec<Vec<f64>>,
    /// ln of the probability of the best path x_1 … x_T, X_0 summed over.
    pub viterbi: f64,
    /// The smallest probability above 0 among the filtered and the smoothed,
    /// as a logarithm.
    pub least: f64,
    /// The first step at which nothing is possible.
    pub impossible_at: Option<usize>,
}

impl Model {
    pub fn steps(&self) -> usize {
        self.logs.len()
    }

    pub fn prior(&self) -> Prior {
        let belief = Belief::new(self.prior.clone()).unwrap();
        if self.at_first {
            Prior::AtFirstObservation(belief)
        } else {
            Prior::BeforeFirstTransition(belief)
        }
    }

    /// The number of the operator of each step.
    pub fn controls(&self) -> Vec<usize> {
        (0..self.steps()).collect()
    }

    pub fn dense(&self) -> SwitchedTransition<DenseTransition> {
        let n = self.states;
        self.switched(|m| DenseTransition::from_fn(n, |to, from| m[to][from]).unwrap())
    }

    pub fn sparse(&self) -> SwitchedTransition<SparseTransition> {
        let n = self.states;
        self.switched(|m| {
            let all = (0..n * n).map(|at| (at / n, at % n, m[at / n][at % n]));
            SparseTransition::from_triplets(n, all).unwrap()
        })
    }

    pub fn own(&self) -> SwitchedTransition<Own> {
        self.switched(|m| Own(m.clone()))
    }

    fn switched<A: Transition<Control = ()>>(
        &self,
        operator: impl Fn(&Vec<Vec<f64>>) -> A,
    ) -> SwitchedTransition<A> {
        // At T = 0 there is none, but a model needs one.
        let identity =
            (0..self.states).map(|i| (0..self.states).map(|j| f64::from(i == j)).collect());
        let spare = [identity.collect::<Vec<Vec<f64>>>()];
        let matrices = if self.matrices.is_empty() { &spare[..] } else { &self.matrices };
        SwitchedTransition::new(matrices.iter().map(operator).collect()).unwrap()
    }

    /// The largest log-likelihood of a step, from 1. It is left out of the sums
    /// over paths, so that shifts of 1e5 do not cost them digits.
    fn largest(&self, step: usize) -> f64 {
        let logs = self.logs[step - 1].iter().flatten();
        let largest = logs.copied().fold(f64::NEG_INFINITY, f64::max);
        if largest.is_finite() { largest } else { 0.0 }
    }

    /// The log-likelihood of state i at step k, but for the largest.
    fn log_b(&self, step: usize, i: usize) -> f64 {
        self.logs[step - 1].as_ref().map_or(0.0, |logs| logs[i] - self.largest(step))
    }

    /// ln A_k[to, from]; the identity where nothing moves.
    fn log_a(&self, step: usize, to: usize, from: usize) -> f64 {
        if step == 1 && self.at_first {
            return if to == from { 0.0 } else { f64::NEG_INFINITY };
        }
        self.matrices[step - 1][to][from].ln()
    }

    /// Every path x_0 … x_T, in logarithms.
    pub fn enumerate(&self) -> Answer {
        let (n, steps) = (self.states, self.steps());
        let mut sums = vec![vec![f64::NEG_INFINITY; n]; steps + 1];
        // Prefixes: joint with y_1 … y_k, summed by their last state.
        let mut paths: Vec<(Vec<usize>, f64)> =
            (0..n).map(|i| (vec![i], self.prior[i].ln())).collect();
        for (path, log) in &paths {
            log_add(&mut sums[0][path[0]], *log);
        }
        for step in 1..=steps {
            let mut longer = Vec::with_capacity(paths.len() * n);
            for (path, log) in &paths {
                let from = path[step - 1];
                for (to, sum) in sums[step].iter_mut().enumerate() {
                    let log = log + self.log_a(step, to, from) + self.log_b(step, to);
                    if log > f64::NEG_INFINITY {
                        log_add(sum, log);
                        let mut path = path.clone();
                        path.push(to);
                        longer.push((path, log));
                    }
                }
            }
            paths = longer;
        }
        let total = |logs: &[f64]| {
            let mut sum = f64::NEG_INFINITY;
            logs.iter().for_each(|log| log_add(&mut sum, *log));
            sum
        };
        let mut smoothed = vec![vec![f64::NEG_INFINITY; n]; steps + 1];
        let mut tails = std::collections::HashMap::new();
        for (path, log) in &paths {
            for (row, &i) in smoothed.iter_mut().zip(path) {
                log_add(&mut row[i], *log);
            }
            log_add(tails.entry(path[1..].to_vec()).or_insert(f64::NEG_INFINITY), *log);
        }
        let mut least = 0.0_f64;
        let mut distribution = |logs: &Vec<f64>| -> Vec<f64> {
            let sum = total(logs);
            let possible = logs.iter().filter(|log| **log > f64::NEG_INFINITY);
            least = possible.map(|log| log - sum).fold(least, f64::min);
            logs.iter().map(|log| (log - sum).exp()).collect()
        };
        let filtered = sums.iter().map(&mut distribution).collect();
        let smoothed = smoothed.iter().map(&mut distribution).collect();
        let left_out: f64 = (1..=steps).map(|step| self.largest(step)).sum();
        Answer {
            log_likelihood: total(&sums[steps]) + left_out,
            impossible_at: sums.iter().position(|s| total(s) == f64::NEG_INFINITY),
            filtered,
            smoothed,
            least,
            viterbi: tails.values().copied().fold(f64::NEG_INFINITY, f64::max) + left_out,
        }
    }

    /// Every possible path x_0 … x_T with ln p(path | all observations).
    pub fn posterior_paths(&self) -> Vec<(Vec<usize>, f64)> {
        let n = self.states;
        let mut paths: Vec<(Vec<usize>, f64)> =
            (0..n).map(|i| (vec![i], self.prior[i].ln())).collect();
        for step in 1..=self.steps() {
            let longer = |(path, log): &(Vec<usize>, f64)| {
                let (path, log) = (path.clone(), *log);
                (0..n).map(move |to| {
                    let log = log + self.log_a(step, to, path[step - 1]) + self.log_b(step, to);
                    ([&path[..], &[to]].concat(), log)
                })
            };
            paths = paths.iter().flat_map(|path| longer(path).collect::<Vec<_>>()).collect();
            paths.retain(|path| path.1 > f64::NEG_INFINITY);
        }
        let mut total = f64::NEG_INFINITY;
        paths.iter().for_each(|path| log_add(&mut total, path.1));
        paths.iter_mut().for_each(|path| path.1 -= total);
        paths.retain(|path| path.1 > f64::NEG_INFINITY);
        paths
    }

    /// ln of the probability of one path x_1 … x_T, X_0 summed over.
    pub fn log_probability(&self, path: &[usize]) -> f64 {
        let mut first = f64::NEG_INFINITY;
        for (i, p) in self.prior.iter().enumerate() {
            log_add(&mut first, p.ln() + self.log_a(1, path[0], i));
        }
        let rest: f64 = (2..=path.len())
            .map(|k| self.log_a(k, path[k - 1], path[k - 2]) + self.log_b(k, path[k - 1]))
            .sum();
        let left_out: f64 = (1..=path.len()).map(|k| self.largest(k)).sum();
        first + self.log_b(1, path[0]) + rest + left_out
    }
}

/// ln(e^sum + e^log), into the first.
pub fn log_add(sum: &mut f64, log: f64) {
    let (high, low) = if *sum > log { (*sum, log) } else { (log, *sum) };
    *sum = if low == f64::NEG_INFINITY { high } else { high + (low - high).exp().ln_1p() };
}

/// An operator as a user would write it: `matrix[to][from]`.
#[derive(Debug, Clone)]
pub struct Own(pub Vec<Vec<f64>>);

impl Transition for Own {
    type Control = ();
    fn states(&self) -> usize {
        self.0.len()
    }
    fn apply(&self, (): &(), x: &[f64], out: &mut [f64]) {
        for (out, row) in out.iter_mut().zip(&self.0) {
            *out = row.iter().zip(x).map(|(a, x)| a * x).sum();
        }
    }
    fn apply_transpose(&self, (): &(), x: &[f64], out: &mut [f64]) {
        for (j, out) in out.iter_mut().enumerate() {
            *out = self.0.iter().zip(x).map(|(row, x)| row[j] * x).sum();
        }
    }
}

impl TransitionEntries for Own {
    fn incoming(&self, (): &(), to: usize) -> impl Iterator<Item = (usize, f64)> {
        self.0[to].iter().copied().enumerate().filter(|entry| entry.1 > 0.0)
    }
    fn outgoing(&self, (): &(), from: usize) -> impl Iterator<Item = (usize, f64)> {
        self.0.iter().map(move |row| row[from]).enumerate().filter(|entry| entry.1 > 0.0)
    }
}

/// How numbers of a random model are drawn.
#[derive(Debug, Clone, Copy)]
pub enum Kind {
    /// Zeros among ordinary weights.
    Plain,
    /// The same, with log-likelihoods shifted by −400, −1e5 or 700 at some
    /// steps.
    Shifted,
    /// Also weights of 1e-300, and log-likelihoods hundreds apart.
    Extreme,
}

fn weight(kind: Kind) -> BoxedStrategy<f64> {
    match kind {
        Kind::Plain | Kind::Shifted => prop_oneof![2 => Just(0.0), 5 => 0.01..1.0].boxed(),
        Kind::Extreme => prop_oneof![
            2 => Just(0.0), 4 => 0.01..1.0, 2 => Just(1e-300), 1 => Just(1e-150)
        ]
        .boxed(),
    }
}

fn log_likelihood(kind: Kind) -> BoxedStrategy<f64> {
    let ordinary = prop_oneof![1 => Just(f64::NEG_INFINITY), 5 => (0.001..1.0).prop_map(f64::ln)];
    match kind {
        Kind::Plain | Kind::Shifted => ordinary.boxed(),
        Kind::Extreme => prop_oneof![4 => ordinary, 1 => -2000.0..2000.0].boxed(),
    }
}

/// A distribution in proportion to weights; certain at `spare` if all are 0.
fn distribution(mut weights: Vec<f64>, spare: usize) -> Vec<f64> {
    let sum: f64 = weights.iter().sum();
    if sum < 1e-6 {
        // Not to divide by next to nothing: a sum of tiny weights gets a large one.
        let spare = spare % weights.len();
        weights[spare] = 1.0;
    }
    let sum: f64 = weights.iter().sum();
    weights.iter().map(|w| w / sum).collect()
}

/// Random models of up to 5 states and 6 steps, with both conventions, zeros,
/// a matrix a step, and missing observations.
pub fn models(kind: Kind) -> impl Strategy<Value = Model> {
    (1..=5_usize, 0..=6_usize, any::<bool>()).prop_flat_map(move |(n, steps, at_first)| {
        let weights = move || vec(weight(kind), n);
        let shift = match kind {
            Kind::Plain => Just(0.0).boxed(),
            Kind::Shifted | Kind::Extreme => {
                prop_oneof![4 => Just(0.0), 1 => Just(-400.0), 1 => Just(-1e5), 1 => Just(700.0)]
                    .boxed()
            }
        };
        let logs = (vec(log_likelihood(kind), n), shift)
            .prop_map(|(logs, shift)| logs.iter().map(|log| log + shift).collect::<Vec<f64>>());
        let observed = prop_oneof![1 => Just(None), 5 => logs.prop_map(Some)];
        let matrices = vec(vec((weights(), 0..n), n), steps);
        (weights(), 0..n, matrices, vec(observed, steps)).prop_map(
            move |(prior, spare, matrices, logs)| {
                let matrices = matrices.into_iter().map(|columns| {
                    let columns: Vec<Vec<f64>> =
                        columns.into_iter().map(|(w, spare)| distribution(w, spare)).collect();
                    (0..n).map(|to| (0..n).map(|from| columns[from][to]).collect()).collect()
                });
                Model {
                    states: n,
                    at_first,
                    prior: distribution(prior, spare),
                    matrices: matrices.collect(),
                    logs,
                }
            },
        )
    })
}

/// Models whose numbers are all powers of two, so that products of doubles are
/// exact and many paths tie.
pub fn dyadic_models() -> impl Strategy<Value = Model> {
    const COLUMNS: [&[f64]; 4] = [&[1.0], &[0.5, 0.5], &[0.5, 0.25, 0.25], &[0.25; 4]];
    (1..=5_usize, 0..=5_usize, any::<bool>()).prop_flat_map(|(n, steps, at_first)| {
        // Where the shares of a distribution go: from a start, every so many.
        let column = move || {
            (0..4_usize, 0..n).prop_map(move |(which, start)| {
                let shares = COLUMNS[which.min(n - 1)];
                let mut column = vec![0.0; n];
                shares.iter().enumerate().for_each(|(d, p)| column[(start + d) % n] += p);
                column
            })
        };
        let likelihood =
            prop_oneof![1 => Just(f64::NEG_INFINITY), 4 => Just(0.0), 2 => Just(0.5_f64.ln())];
        let observed = prop_oneof![1 => Just(None), 5 => vec(likelihood, n).prop_map(Some)];
        (column(), vec(vec(column(), n), steps), vec(observed, steps)).prop_map(
            move |(prior, columns, logs)| {
                let matrix = |columns: Vec<Vec<f64>>| {
                    (0..n).map(|to| (0..n).map(|from| columns[from][to]).collect()).collect()
                };
                let matrices = columns.into_iter().map(matrix).collect();
                Model { states: n, at_first, prior, matrices, logs }
            },
        )
    })
}
