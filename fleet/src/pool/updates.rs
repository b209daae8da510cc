//! Updates of vehicles, one or many at a time.
//!
//! Many updates are sorted by shard first. A thread takes a shard at a time and works through its
//! updates in order, so those of one vehicle, which are all in one shard, keep their order whatever
//! the threads do.

use std::panic;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use wayfix::{Filter, Hmm, Likelihood, Transition};

use super::timing::Moment;
use super::{Pool, Update, UpdateResult, lock};

/// Below this number of updates, threads do not pay off.
const FEW: usize = 64;
/// Maximum number of updates in a round.
const ROUND: usize = 1 << 18;
/// Number of values, and of states, that a thread prefetches at a time.
const TOGETHER: usize = 1 << 11;
const MOST_TOGETHER: usize = 16;

impl<A, B> Pool<A, B>
where
    A: Transition<Control = ()>,
    B: Likelihood<Observation: Sized>,
{
    /// Applies an update of one vehicle: a step of its filter.
    ///
    /// # Errors
    ///
    /// [`UpdateError`] if the update is refused; the vehicle is then unchanged.
    pub fn update(&mut self, update: &Update<B::Observation>) -> UpdateResult {
        let (hash, shard) = self.place(&update.vehicle);
        self.latest.see(&update.vehicle, update.time, self.timing.agree());
        let latest = self.latest.time().unwrap_or(i64::MIN);
        let moment = Moment { timing: &self.timing, latest };
        let answer = lock(&self.shards[shard]).update(&mut self.filters[0], hash, update, &moment);
        self.forget_some();
        answer
    }

    /// Applies many updates with all threads. Those of one vehicle are applied in order, and
    /// answers are in the order of the updates.
    pub fn update_all(&mut self, updates: &[Update<B::Observation>]) -> Vec<UpdateResult>
    where
        A: Send + Sync,
        B: Likelihood<Observation: Sync> + Send + Sync,
    {
        let mut answers = Vec::with_capacity(updates.len());
        for round in updates.chunks(ROUND) {
            if round.len() < FEW {
                answers.extend(round.iter().map(|update| self.update(update)));
            } else {
                self.round(round, &mut answers);
            }
        }
        answers
    }

    /// Applies updates with all threads; each takes one shard after another.
    fn round(&mut self, updates: &[Update<B::Observation>], answers: &mut Vec<UpdateResult>)
    where
        A: Send + Sync,
        B: Likelihood<Observation: Sync> + Send + Sync,
    {
        let mut jobs: Vec<Vec<(u64, u32)>> = vec![Vec::new(); self.shards.len()];
        // Hashing spreads vehicles evenly; a quarter more makes growing rare.
        let room = updates.len() / jobs.len();
        jobs.iter_mut().for_each(|job| job.reserve(room + room / 4));
        // The latest time up to each update, in their order: shards are worked on in any order, and
        // what is forgotten must not depend on it.
        let forgets = self.timing.forget_after.is_some();
        let mut latests = Vec::with_capacity(if forgets { updates.len() } else { 0 });
        for (number, update) in (0..).zip(updates) {
            let (hash, shard) = self.place(&update.vehicle);
            jobs[shard].push((hash, number));
            self.latest.see(&update.vehicle, update.time, self.timing.agree());
            if forgets {
                latests.push(self.latest.time().unwrap_or(i64::MIN));
            }
        }
        let next = AtomicUsize::new(0);
        let together = (TOGETHER / self.model.states()).clamp(1, MOST_TOGETHER);
        let Self { shards, filters, timing, .. } = self;
        let moment = |number: u32| {
            let latest = latests.get(number as usize).copied().unwrap_or(i64::MIN);
            Moment { timing, latest }
        };
        let work = |filter: &mut Filter<Arc<Hmm<A, B>>>| {
            let mut answers = Vec::with_capacity(updates.len());
            loop {
                // `Relaxed` suffices: each number is given out once, and data is shared through
                // locks and `scope`.
                let shard = next.fetch_add(1, Ordering::Relaxed);
                let (Some(job), Some(shard)) = (jobs.get(shard), shards.get(shard)) else {
                    return answers;
                };
                let mut shard = lock(shard);
                for job in job.chunks(together) {
                    // Some states at a time: more would no longer be in the cache when their turn
                    // comes.
                    shard.warm(
                        job.iter().map(|&(hash, number)| (hash, &updates[number as usize].vehicle)),
                    );
                    answers.extend(job.iter().map(|&(hash, number)| {
                        let update = &updates[number as usize];
                        (number, shard.update(filter, hash, update, &moment(number)))
                    }));
                }
            }
        };
        let mut in_order: Vec<Option<UpdateResult>> = Vec::new();
        in_order.resize_with(updates.len(), || None);
        thread::scope(|scope| {
            let work = &work;
            let workers: Vec<_> =
                filters.iter_mut().map(|filter| scope.spawn(move || work(filter))).collect();
            for worker in workers {
                match worker.join() {
                    Ok(answers) => answers
                        .into_iter()
                        .for_each(|(number, answer)| in_order[number as usize] = Some(answer)),
                    Err(panic) => panic::resume_unwind(panic),
                }
            }
        });
        // Every update was the job of exactly one thread, so none is missing.
        answers.extend(in_order.into_iter().flatten());
        self.forget_some();
    }
}
