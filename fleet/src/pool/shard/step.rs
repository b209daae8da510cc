//! One update of a vehicle: a step of its filter.
//!
//! The state is loaded into the filter of the thread, stepped there, and stored only if that
//! succeeded: an error leaves the vehicle as it was.

use std::sync::Arc;

use wayfix::{Filter, Hmm, HmmError, Likelihood, Transition};

use super::{LINE, Shard};
use crate::pool::timing::Moment;
use crate::pool::vehicle::{Answer, Update, UpdateError};

impl Shard {
    /// Applies an update with the filter of a thread.
    pub(crate) fn update<A, B>(
        &mut self,
        filter: &mut Filter<Arc<Hmm<A, B>>>,
        hash: u64,
        update: &Update<B::Observation>,
        moment: &Moment<'_>,
    ) -> Result<Answer, UpdateError>
    where
        A: Transition<Control = ()>,
        B: Likelihood<Observation: Sized>,
    {
        let found = self.find(hash, &update.vehicle);
        let last = found.map(|at| self.entries[at as usize].time);
        // Sweeps come at their own pace, so a vehicle to be forgotten may or may not be here still.
        // Treat it as gone, or answers would depend on when the last sweep was.
        let last = last.filter(|&last| !moment.is_forgotten(last));
        // Also with `restart`: a line that comes twice must not make the vehicle forget what came
        // between.
        if let Some(last) = last
            && update.time <= last
        {
            return Err(UpdateError::Time { time: update.time, last });
        }
        let mut steps = 1;
        match (found, last) {
            (Some(at), Some(last)) if !update.restart => {
                let state = self.load(at).map_err(|error| UpdateError::Disk(Box::new(error)))?;
                filter.restore(state)?;
                steps = moment.steps(last, update.time);
            }
            _ => filter.restart(),
        }
        let log_likelihood = match take_steps(filter, steps, &update.observation) {
            Ok(log_likelihood) => log_likelihood,
            Err(error) => {
                // Loading the state may have exceeded the limit.
                self.evict();
                return Err(error.into());
            }
        };
        if let Some(at) = found {
            self.store(at, update.time, filter);
        } else {
            let state = Box::new(filter.snapshot());
            self.add(hash, update.vehicle.clone(), update.time, state);
        }
        self.evict();
        let (state, probability) = peak(filter.belief().as_slice());
        Ok(Answer { state, probability, log_likelihood })
    }
}

/// Advances a filter by `steps` transitions, and gives it the observation after the last. Without
/// any, the observation is one more of the same step.
fn take_steps<A, B>(
    filter: &mut Filter<Arc<Hmm<A, B>>>,
    steps: u64,
    observation: &B::Observation,
) -> Result<f64, HmmError>
where
    A: Transition<Control = ()>,
    B: Likelihood<Observation: Sized>,
{
    if steps == 0 {
        return filter.update(observation);
    }
    // Chapman–Kolmogorov: transitions without an observation in between are predictions.
    // `step_with` takes the last one.
    for _ in 1..steps {
        filter.predict_with(&())?;
    }
    filter.step_with(&(), observation)
}

/// Most probable state and its probability; ties go to the lowest state.
fn peak(belief: &[f64]) -> (usize, f64) {
    let greater = |a: f64, b: f64| if b > a { b } else { a };
    let (lines, rest) = belief.as_chunks::<LINE>();
    // First the maximum, in independent lanes that vectorise; then its first position, which
    // usually ends early.
    let mut lanes = [f64::NEG_INFINITY; LINE];
    for line in lines {
        for k in 0..LINE {
            lanes[k] = greater(lanes[k], line[k]);
        }
    }
    let best = lanes.iter().chain(rest).fold(f64::NEG_INFINITY, |best, &p| greater(best, p));
    let first = lines.iter().position(|line| line.contains(&best)).unwrap_or(lines.len()) * LINE;
    let within = belief[first..].iter().position(|&p| p == best).unwrap_or(0);
    (first + within, best)
}
