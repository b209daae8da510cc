//! Results of a batch of drives, from the routines of the library.
//!
//! The `_all` routines of the library compute several drives at a time. They take the batch in
//! slices, whose results become rows before the next slice, so posteriors are not kept.

use std::ops::ControlFlow;
use std::sync::Arc;

use arrow_schema::Schema;
use wayfix::error::At;
use wayfix::inference::{Posteriors, SequenceError};
use wayfix::likelihood::LearnLikelihood;
use wayfix::transition::LearnTransition;
use wayfix::{Hmm, HmmError, Sequence};

use super::measures::Measures;
use super::rows::{Failure, Rows, kind};
use super::{Batch, Results, Table, Verb};
use crate::error::{FleetError, Outcome};
use crate::input::Drives;
use crate::model::{Model, with_hmm};
use crate::sensor::{Observation, Sensor};

/// Computes the results of drives, in their order: one row per step, drive or path.
///
/// A drive that the model rules out has its error in its row, and affects no other drive.
///
/// # Errors
///
/// [`FleetError::Value`] for an invalid observation, with its row.
pub fn results(
    model: &Model,
    results: &Results,
    schema: &Arc<Schema>,
    drives: &Drives,
) -> Outcome<Batch> {
    with_hmm!(model, hmm => compute(hmm, results, schema, drives))
}

fn compute<A>(
    hmm: &Hmm<A, Sensor>,
    results: &Results,
    schema: &Arc<Schema>,
    drives: &Drives,
) -> Outcome<Batch>
where
    A: LearnTransition<Control = ()> + Sync,
    Sensor: LearnLikelihood,
{
    let all = drives.observations()?;
    let sequences: Vec<&[Observation]> =
        drives.offsets.windows(2).map(|drive| &all[drive[0]..drive[1]]).collect();
    let mut out = Collector {
        rows: Rows::default(),
        results,
        drives,
        measures: Measures::new(hmm.states()),
        best: Vec::new(),
    };
    let stopped = match (results.verb, results.table) {
        (Verb::Smooth, Table::Steps | Table::Best(_)) => by_slices(
            &sequences,
            hmm.states(),
            |some| hmm.smooth_all(some),
            |drive, result| {
                out.take(drive, result, |out, smoothed| {
                    out.beliefs(drive, smoothed.posteriors(), smoothed.log_likelihood());
                })
            },
        ),
        (Verb::Filter, Table::Steps | Table::Best(_)) => by_slices(
            &sequences,
            hmm.states(),
            |some| hmm.forward_all(some),
            |drive, result| {
                out.take(drive, result, |out, filtered| {
                    if out.results.has_step_logs() {
                        out.rows.log_likelihood.extend_from_slice(filtered.log_likelihoods());
                    }
                    out.beliefs(drive, filtered.posteriors(), filtered.log_likelihood());
                })
            },
        ),
        // The first of the k best paths is the Viterbi path, which this finds with less work.
        (Verb::Decode, Table::Drives | Table::Paths(1)) => by_slices(
            &sequences,
            1,
            |some| hmm.viterbi_all(some),
            |drive, result| {
                out.take(drive, result, |out, path| {
                    out.path(drive, 1, path.states(), path.log_probability());
                })
            },
        ),
        (Verb::Decode, Table::Paths(count)) => {
            sequences.iter().enumerate().try_for_each(|(drive, sequence)| {
                out.take(drive, hmm.k_best(*sequence, count), |out, paths| {
                    for (rank, path) in (1..).zip(&paths) {
                        out.path(drive, rank, path.states(), path.log_probability());
                    }
                })
            })
        }
        // Tables of drives need no posteriors: a forward pass gives the same log-likelihood.
        _ => by_slices(
            &sequences,
            0,
            |some| hmm.log_likelihood_all(some),
            |drive, result| {
                out.take(drive, result, |out, log_likelihood| {
                    out.rows.end(drive, 1, out.steps(drive), log_likelihood);
                })
            },
        ),
    };
    match stopped {
        ControlFlow::Break(error) => Err(error),
        ControlFlow::Continue(()) => out.rows.finish(results, schema, drives),
    }
}

/// Numbers that results of a slice may hold: 32 MB, beside tables that take as much.
const SLICE: usize = 1 << 22;

/// Runs a routine on slices of the sequences and passes each result on, with the number of its
/// sequence. Results of a sequence hold `width` numbers a step; those of a slice are dropped before
/// the next slice, so that memory does not grow with the batch.
fn by_slices<S: Sequence<(), Observation>, R>(
    sequences: &[S],
    width: usize,
    routine: impl Fn(&[S]) -> Vec<Result<R, SequenceError>>,
    mut visit: impl FnMut(usize, Result<R, HmmError>) -> ControlFlow<FleetError>,
) -> ControlFlow<FleetError> {
    let mut start = 0;
    while start < sequences.len() {
        // At least one sequence, however long; after that as many as fit.
        let (mut end, mut held) = (start, 0);
        while end < sequences.len() && (end == start || held < SLICE) {
            held += width * sequences[end].steps();
            end += 1;
        }
        for (drive, result) in (start..).zip(routine(&sequences[start..end])) {
            visit(drive, result.map_err(|error| error.source))?;
        }
        start = end;
    }
    ControlFlow::Continue(())
}

/// Turns results into rows.
struct Collector<'a> {
    rows: Rows,
    results: &'a Results,
    drives: &'a Drives,
    measures: Measures,
    /// Scratch space for the best states of a step.
    best: Vec<usize>,
}

impl Collector<'_> {
    fn steps(&self, drive: usize) -> usize {
        self.drives.offsets[drive + 1] - self.drives.offsets[drive]
    }

    /// Takes the result of a drive, or its failure. An invalid observation is an error of the input
    /// and ends the batch.
    fn take<R>(
        &mut self,
        drive: usize,
        result: Result<R, HmmError>,
        put: impl FnOnce(&mut Self, R),
    ) -> ControlFlow<FleetError> {
        match result {
            Ok(result) => put(self, result),
            Err(HmmError::Likelihood(At { number: step, cause, .. })) => {
                // Errors count steps from 1.
                let element = self.drives.offsets[drive] + step - 1;
                return ControlFlow::Break(self.drives.refuse(element, &cause.to_string()));
            }
            Err(error) => {
                let (kind, step) = kind(&error);
                let step = step.map(|step| self.drives.step(drive, step - 1));
                let failure = Failure { kind, step, message: error.to_string() };
                self.rows.fail(drive, self.steps(drive), failure, self.results);
            }
        }
        ControlFlow::Continue(())
    }

    fn beliefs(&mut self, drive: usize, posteriors: &Posteriors, log_likelihood: f64) {
        let steps = self.steps(drive);
        if let Table::Best(count) = self.results.table {
            for (k, belief) in posteriors.iter().enumerate() {
                self.best_states(self.drives.step(drive, k), belief.as_slice(), count);
            }
        } else {
            let measures = self.measures;
            for belief in posteriors.iter() {
                let measured = measures.of(belief.as_slice());
                self.rows.state.push(measured.state as u32);
                self.rows.probability.push(measured.probability);
                self.rows.entropy.push(measured.entropy);
            }
            self.add_steps(drive, steps);
        }
        self.rows.end(drive, 1, steps, log_likelihood);
    }

    fn add_steps(&mut self, drive: usize, steps: usize) {
        let first = self.drives.offsets[drive];
        match &self.drives.steps {
            Some(all) => self.rows.step.extend_from_slice(&all.values()[first..first + steps]),
            None => self.rows.step.extend(1..=steps as i64),
        }
    }

    /// Adds the most probable states of a step; ties go to the lowest state.
    fn best_states(&mut self, step: i64, belief: &[f64], count: usize) {
        let order = |a: &usize, b: &usize| belief[*b].total_cmp(&belief[*a]).then(a.cmp(b));
        let best = &mut self.best;
        best.clear();
        best.extend(0..belief.len());
        // Selection is O(n), and only `count` states are sorted. The order is total (ties by
        // index), so both steps agree on it.
        if count < best.len() {
            best.select_nth_unstable_by(count, order);
            best.truncate(count);
        }
        best.sort_unstable_by(order);
        for (rank, &state) in (1..).zip(best.iter()) {
            self.rows.step.push(step);
            self.rows.rank.push(rank);
            self.rows.state.push(state as u32);
            self.rows.probability.push(belief[state]);
        }
    }

    fn path(&mut self, drive: usize, rank: u32, states: &[usize], log_probability: f64) {
        if self.results.table != Table::Drives {
            self.rows.state.extend(states.iter().map(|&state| state as u32));
            self.add_steps(drive, states.len());
        }
        self.rows.end(drive, rank, states.len(), log_probability);
    }
}
