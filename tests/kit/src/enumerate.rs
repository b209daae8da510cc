//! Answers by enumeration of all paths.

use std::collections::HashMap;

use super::{Matrix, Model, NEVER, log_add};

/// Exact answers by enumeration.
#[derive(Debug)]
pub struct Answer {
    pub log_likelihood: f64,
    /// For k = 0 … T.
    pub filtered: Vec<Vec<f64>>,
    pub smoothed: Vec<Vec<f64>>,
    /// ln of the probability of the best path x_1 … x_T, X_0 summed over.
    pub viterbi: f64,
    /// The first step at which nothing is possible.
    pub impossible_at: Option<usize>,
}

impl Model {
    /// The largest log-likelihood of a step, from 1. It is left out of the sums over paths, so that
    /// shifts of 1e5 do not cost digits.
    fn largest(&self, step: usize) -> f64 {
        let logs = self.logs[step - 1].iter().flatten();
        let largest = logs.copied().fold(NEVER, f64::max);
        if largest.is_finite() { largest } else { 0.0 }
    }

    /// The log-likelihood of state i at step k, less the largest.
    fn log_b(&self, step: usize, i: usize) -> f64 {
        self.logs[step - 1].as_ref().map_or(0.0, |logs| logs[i] - self.largest(step))
    }

    /// The evidence on the move to a step, if any, and its largest logarithm.
    fn measured_at(&self, step: usize) -> Option<(&Matrix, f64)> {
        let evidence = self.evidence.get(step - 1).filter(|_| step > 1 || !self.at_first)?;
        let largest = evidence.logs.iter().flatten().copied().fold(NEVER, f64::max);
        Some((&evidence.logs, if largest.is_finite() { largest } else { 0.0 }))
    }

    /// ln A_k[to, from], with evidence less its largest; the identity at steps without a move.
    fn log_a(&self, step: usize, to: usize, from: usize) -> f64 {
        if step == 1 && self.at_first {
            return if to == from { 0.0 } else { NEVER };
        }
        let evidence =
            self.measured_at(step).map_or(0.0, |(logs, largest)| logs[to][from] - largest);
        self.matrices[step - 1][to][from].ln() + evidence
    }

    /// Sum of the terms left out of the sums over paths of this many steps.
    fn left_out(&self, steps: usize) -> f64 {
        let moves = |step| self.measured_at(step).map_or(0.0, |(_, largest)| largest);
        (1..=steps).map(|step| self.largest(step) + moves(step)).sum()
    }

    /// Every path x_0 … x_T, in logarithms.
    pub fn enumerate(&self) -> Answer {
        let (n, steps) = (self.states, self.steps());
        let mut sums = vec![vec![NEVER; n]; steps + 1];
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
                    if log > NEVER {
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
            let mut sum = NEVER;
            logs.iter().for_each(|log| log_add(&mut sum, *log));
            sum
        };
        let mut smoothed = vec![vec![NEVER; n]; steps + 1];
        let mut tails = HashMap::new();
        for (path, log) in &paths {
            for (row, &i) in smoothed.iter_mut().zip(path) {
                log_add(&mut row[i], *log);
            }
            log_add(tails.entry(path[1..].to_vec()).or_insert(NEVER), *log);
        }
        let distribution = |logs: &Vec<f64>| -> Vec<f64> {
            let sum = total(logs);
            logs.iter().map(|log| (log - sum).exp()).collect()
        };
        let filtered = sums.iter().map(distribution).collect();
        let smoothed = smoothed.iter().map(distribution).collect();
        let left_out = self.left_out(steps);
        Answer {
            log_likelihood: total(&sums[steps]) + left_out,
            impossible_at: sums.iter().position(|s| total(s) == NEVER),
            filtered,
            smoothed,
            viterbi: tails.values().copied().fold(NEVER, f64::max) + left_out,
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
            paths.retain(|path| path.1 > NEVER);
        }
        let mut total = NEVER;
        paths.iter().for_each(|path| log_add(&mut total, path.1));
        paths.iter_mut().for_each(|path| path.1 -= total);
        paths.retain(|path| path.1 > NEVER);
        paths
    }

    /// ln of the probability of one path x_1 … x_T, X_0 summed over.
    pub fn log_probability(&self, path: &[usize]) -> f64 {
        let mut first = NEVER;
        for (i, p) in self.prior.iter().enumerate() {
            log_add(&mut first, p.ln() + self.log_a(1, path[0], i));
        }
        let rest: f64 = (2..=path.len())
            .map(|k| self.log_a(k, path[k - 1], path[k - 2]) + self.log_b(k, path[k - 1]))
            .sum();
        first + self.log_b(1, path[0]) + rest + self.left_out(path.len())
    }
}
