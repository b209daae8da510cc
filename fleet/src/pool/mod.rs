//! Live vehicles: a filter for each of millions, with one model.
//!
//! A [`Pool`] keeps the state of a filter for every vehicle, and steps them as observations come.
//! Answers are those of the library's [`Filter`], to the bit.
//!
//! ```
//! use std::sync::Arc;
//! use wayfix::canberra;
//! use wayfix_fleet::pool::{Pool, PoolOptions, Update};
//!
//! let model = Arc::new(canberra::hmm(5, 1.0)?);
//! let mut pool = Pool::new(Arc::clone(&model), "canberra, σ = 1", &PoolOptions::default())?;
//! let updates = [
//!     Update::new(7, 100, 4),
//!     Update::new("bus 12", 100, 80),
//!     Update::new(7, 101, 5),
//!     Update::new(7, 101, 5), // twice
//! ];
//! let answers = pool.update_all(&updates);
//! let answer = answers[2].as_ref().map_err(ToString::to_string)?;
//! assert_eq!(answers[3].as_ref().map_err(|error| error.kind()), Err("time"));
//!
//! let mut filter = model.filter();
//! filter.step(&4)?;
//! assert_eq!(answer.log_likelihood, filter.step(&5)?);
//! assert_eq!((answer.state, answer.probability), filter.belief().peak());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod block;
mod file;
mod lines;
mod live;
mod service;
mod shard;
mod spill;
mod timing;
mod vehicle;
mod writing;

use std::fmt;
use std::hash::{BuildHasher, RandomState};
use std::panic;
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;

use wayfix::inference::FilterSnapshot;
use wayfix::{Filter, Hmm, Likelihood, Transition};

pub use live::{LiveJob, LiveSummary, live};
pub use service::{Control, Notice, Position, ServiceJob, position, serve, signals};
use shard::Shard;
use spill::{Disk, Folder};
use timing::Moment;
pub use timing::Timing;
pub use vehicle::{Answer, Update, UpdateError, VehicleId};
pub use writing::Writing;

use crate::error::{FleetError, Outcome};

/// Updates for which threads are not worth while.
const FEW: usize = 64;
/// Updates that threads take at a time.
const ROUND: usize = 1 << 18;
/// Numbers of the states that a thread asks memory for at once, and most such states.
const TOGETHER: usize = 1 << 11;
const MOST_TOGETHER: usize = 16;
/// Shards for each thread, so that none waits long for the others.
const SHARDS: usize = 8;
/// Longest hash of a model, in bytes.
const LONGEST_HASH: usize = 1 << 16;
/// Most shards, each of which may open two files.
const MOST_SHARDS: usize = 256;

/// Resources of a pool.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PoolOptions {
    /// Threads, at least one.
    pub threads: usize,
    /// Bytes of memory for vehicles, about. It is divided among parts of the pool, each of which
    /// keeps at least one vehicle in memory.
    pub memory: Option<usize>,
    /// Folder for the vehicles that memory has no room for. Needed with `memory`, and used by one
    /// pool at a time. Its files are nothing without the pool.
    pub spill: Option<PathBuf>,
}

/// All cores, and no limit.
impl Default for PoolOptions {
    fn default() -> Self {
        let threads = thread::available_parallelism().map_or(1, Into::into);
        Self { threads, memory: None, spill: None }
    }
}

/// Number of vehicles, and what they take.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Usage {
    /// Number of vehicles.
    pub vehicles: usize,
    /// Number of those whose state is in memory.
    pub in_memory: usize,
    /// Bytes of memory for all of them, without the model and what threads compute with.
    pub bytes: usize,
    /// Bytes of the files with the others.
    pub file_bytes: u64,
}

/// Filters of many vehicles, with one model.
///
/// For each vehicle a pool keeps a [`FilterSnapshot`] and the time of the last update; threads
/// have a filter each, which takes over the state of a vehicle for a step. So an update costs a
/// step of a filter and two copies of its state, in all O(E + n).
///
/// # Memory
///
/// A vehicle of n states takes 8 n bytes and some 200 more, or 16 n while its belief is held in
/// logarithms, which a model with [rounded tails](Hmm::with_rounded_tails) never does;
/// [`usage`](Self::usage) counts it. With a limit, those that were not seen for longest are kept
/// in files and come back with their next update; some 70 bytes of each stay in memory. Nothing
/// else is seen of it: all answers are the same to the bit.
///
/// # Errors
///
/// An update that is refused changes nothing: [`UpdateError`].
pub struct Pool<A: Transition, B: Likelihood> {
    model: Arc<Hmm<A, B>>,
    hash: String,
    hasher: RandomState,
    /// Shared with a snapshot that is being written.
    shards: Arc<[Mutex<Shard>]>,
    /// One for each thread.
    filters: Vec<Filter<Arc<Hmm<A, B>>>>,
    timing: Timing,
    /// Largest time of all updates.
    latest: i64,
    /// That when forgotten vehicles were last removed, and the shards that are left to look
    /// through.
    swept: i64,
    to_sweep: usize,
}

impl<A: Transition, B: Likelihood> fmt::Debug for Pool<A, B> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let usage = self.usage();
        f.debug_struct("Pool")
            .field("hash", &self.hash)
            .field("usage", &usage)
            .finish_non_exhaustive()
    }
}

/// What an update comes to.
pub type UpdateResult = Result<Answer, UpdateError>;

impl<A: Transition, B: Likelihood> Pool<A, B> {
    /// Creates an empty pool. The hash names the model in [snapshots](Self::snapshot): that of
    /// [`Model::hash`](crate::model::Model::hash), or any text that changes with the model.
    ///
    /// # Errors
    ///
    /// [`FleetError`] if there is a limit without a folder, or if the folder cannot be used.
    pub fn new(
        model: Arc<Hmm<A, B>>,
        hash: impl Into<String>,
        options: &PoolOptions,
    ) -> Outcome<Self> {
        let folder = match (options.memory, &options.spill) {
            (None, _) => None,
            (Some(_), Some(path)) => Some(Folder::open(path)?),
            (Some(_), None) => {
                let message = "a limit of memory needs a folder for what is beyond it";
                return Err(FleetError::Settings(message.to_owned()));
            }
        };
        let hash = hash.into();
        if hash.len() > LONGEST_HASH {
            let message = format!("a hash of {} bytes, at most {LONGEST_HASH}", hash.len());
            return Err(FleetError::Settings(message));
        }
        let threads = options.threads.max(1);
        let count = (SHARDS * threads).next_power_of_two().min(MOST_SHARDS);
        let (hasher, limit) = (RandomState::new(), options.memory.unwrap_or(0) / count);
        let shard = |number| {
            let disk = folder.as_ref().map(|folder| Disk::new(folder, number, model.states()));
            Mutex::new(Shard::new(hasher.clone(), limit, disk))
        };
        let shards: Arc<[_]> = (0..count).map(shard).collect();
        let filters = (0..threads).map(|_| Filter::new(Arc::clone(&model))).collect();
        let (timing, latest) = (Timing::default(), i64::MIN);
        let (swept, to_sweep) = (i64::MIN, 0);
        Ok(Self { model, hash, hasher, shards, filters, timing, latest, swept, to_sweep })
    }

    /// The model.
    #[must_use]
    pub fn model(&self) -> &Hmm<A, B> {
        &self.model
    }

    /// Number of vehicles, and what they take. O(threads).
    #[must_use]
    pub fn usage(&self) -> Usage {
        let mut usage = Usage { vehicles: 0, in_memory: 0, bytes: 0, file_bytes: 0 };
        for shard in self.shards.iter() {
            let shard = lock(shard);
            usage.vehicles += shard.vehicles();
            usage.in_memory += shard.in_memory();
            usage.bytes += shard.bytes();
            usage.file_bytes += shard.file_bytes();
        }
        usage
    }

    /// State of a vehicle, with its belief, to go on with in a filter of one's own; `None` if there
    /// is no such vehicle. It does not count as seen.
    ///
    /// # Errors
    ///
    /// [`FleetError`] if it cannot be read back from the disk.
    pub fn state(&self, vehicle: &VehicleId) -> Outcome<Option<FilterSnapshot>> {
        let (hash, shard) = self.place(vehicle);
        let mut shard = lock(&self.shards[shard]);
        let found = shard.find(hash, vehicle).filter(|&at| self.is_kept(shard.time(at)));
        found.map(|at| shard.state(at)).transpose()
    }

    /// Time of the last update of a vehicle, or `None` if there is no such vehicle.
    #[must_use]
    pub fn time(&self, vehicle: &VehicleId) -> Option<i64> {
        let (hash, shard) = self.place(vehicle);
        let shard = lock(&self.shards[shard]);
        shard.find(hash, vehicle).map(|at| shard.time(at)).filter(|&time| self.is_kept(time))
    }

    /// Forgets a vehicle. Returns false if there is none of the id.
    pub fn remove(&mut self, vehicle: &VehicleId) -> bool {
        let (hash, shard) = self.place(vehicle);
        let mut shard = lock(&self.shards[shard]);
        let time = shard.find(hash, vehicle).map(|at| shard.time(at));
        shard.remove(hash, vehicle) && time.is_some_and(|time| self.is_kept(time))
    }

    /// First failure to move a vehicle to the disk since the last call. Such vehicles stay in
    /// memory, beyond the limit; none is lost.
    pub fn take_spill_error(&mut self) -> Option<FleetError> {
        self.shards.iter().find_map(|shard| lock(shard).failure.take())
    }

    /// Hash and shard of a vehicle.
    fn place(&self, vehicle: &VehicleId) -> (u64, usize) {
        let hash = self.hasher.hash_one(vehicle);
        // Other bits than those by which a shard finds it.
        (hash, (hash >> 40) as usize & (self.shards.len() - 1))
    }
}

impl<A, B> Pool<A, B>
where
    A: Transition<Control = ()>,
    B: Likelihood<Observation: Sized>,
{
    /// Takes an update of one vehicle: a step of its filter.
    ///
    /// # Errors
    ///
    /// [`UpdateError`] if the update is refused; the vehicle is as it was.
    pub fn update(&mut self, update: &Update<B::Observation>) -> UpdateResult {
        let (hash, shard) = self.place(&update.vehicle);
        self.latest = self.latest.max(update.time);
        let moment = Moment { timing: &self.timing, latest: self.latest };
        let answer = lock(&self.shards[shard]).update(&mut self.filters[0], hash, update, &moment);
        self.forget_some();
        answer
    }

    /// Takes many updates with all threads. Those of a vehicle are taken in their order, and answers
    /// are in the order of the updates.
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

    /// Takes updates with all threads, each of which takes one shard after the other.
    fn round(&mut self, updates: &[Update<B::Observation>], answers: &mut Vec<UpdateResult>)
    where
        A: Send + Sync,
        B: Likelihood<Observation: Sync> + Send + Sync,
    {
        let mut jobs: Vec<Vec<(u64, u32)>> = vec![Vec::new(); self.shards.len()];
        let room = updates.len() / jobs.len();
        jobs.iter_mut().for_each(|job| job.reserve(room + room / 4));
        // The largest time up to each update, if it matters.
        let forgets = self.timing.forget_after.is_some();
        let mut latests = Vec::with_capacity(if forgets { updates.len() } else { 0 });
        for (number, update) in (0..).zip(updates) {
            let (hash, shard) = self.place(&update.vehicle);
            jobs[shard].push((hash, number));
            self.latest = self.latest.max(update.time);
            if forgets {
                latests.push(self.latest);
            }
        }
        let next = AtomicUsize::new(0);
        let together = (TOGETHER / self.model.states()).clamp(1, MOST_TOGETHER);
        let Self { shards, filters, timing, latest, .. } = self;
        let moment = |number: u32| {
            let latest = latests.get(number as usize).copied().unwrap_or(*latest);
            Moment { timing, latest }
        };
        let work = |filter: &mut Filter<Arc<Hmm<A, B>>>| {
            let mut answers = Vec::with_capacity(updates.len());
            loop {
                let shard = next.fetch_add(1, Ordering::Relaxed);
                let (Some(job), Some(shard)) = (jobs.get(shard), shards.get(shard)) else {
                    return answers;
                };
                let mut shard = lock(shard);
                for job in job.chunks(together) {
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
        // Every update is a job of one thread.
        answers.extend(in_order.into_iter().flatten());
        self.forget_some();
    }
}

/// A shard keeps its invariants if a sensor panics in it.
fn lock(shard: &Mutex<Shard>) -> MutexGuard<'_, Shard> {
    shard.lock().unwrap_or_else(PoisonError::into_inner)
}
