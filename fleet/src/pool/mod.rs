//! Live vehicles: a filter for each of millions of vehicles, under one model.
//!
//! A [`Pool`] keeps the state of a filter for every vehicle, and steps it as observations arrive.
//! Answers are those of the library's [`Filter`], to the bit.
//!
//! Vehicles are spread over shards by the hash of their id. A thread locks one shard at a time and
//! steps its vehicles with a filter of its own, so updates of one vehicle keep their order and no
//! two threads share a state.
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

mod answers;
mod block;
mod file;
mod latest;
mod lines;
mod live;
mod service;
mod shard;
mod spill;
mod timing;
mod updates;
mod vehicle;
mod writing;

use std::fmt;
use std::hash::{BuildHasher, RandomState};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;

use wayfix::inference::FilterSnapshot;
use wayfix::{Filter, Hmm, Likelihood, Transition};

use latest::Latest;
pub use live::{LiveJob, LiveSummary, live};
pub use service::{Control, Notice, Position, ServiceJob, position, serve, signals};
use shard::Shard;
use spill::{Disk, Folder};
pub use timing::Timing;
pub use vehicle::{Answer, Update, UpdateError, VehicleId};
pub use writing::Writing;

use crate::error::{FleetError, Outcome};

/// Shards per thread: enough that threads seldom wait for the last shard.
const SHARDS: usize = 8;
/// Maximum length of the hash of a model, in bytes.
const LONGEST_HASH: usize = 1 << 16;
/// Maximum number of shards; each may have two files open.
const MOST_SHARDS: usize = 256;

/// Resources of a pool.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PoolOptions {
    /// Threads, at least one.
    pub threads: usize,
    /// Approximate memory for vehicles, in bytes. It is divided among the shards of the pool, and
    /// each keeps at least one vehicle in memory.
    pub memory: Option<usize>,
    /// Folder for the vehicles that do not fit into memory. Required with `memory`, and used by one
    /// pool at a time. Its files have no meaning without the pool.
    pub spill: Option<PathBuf>,
}

/// All cores, and no memory limit.
impl Default for PoolOptions {
    fn default() -> Self {
        let threads = thread::available_parallelism().map_or(1, Into::into);
        Self { threads, memory: None, spill: None }
    }
}

/// Number of vehicles, and the memory and disk space they take.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Usage {
    /// Number of vehicles.
    pub vehicles: usize,
    /// Number of vehicles whose state is in memory.
    pub in_memory: usize,
    /// Bytes of memory for all vehicles, not counting the model and the scratch space of threads.
    pub bytes: usize,
    /// Bytes of the files that hold the other states.
    pub file_bytes: u64,
}

/// Filters of many vehicles under one model.
///
/// For each vehicle, a pool keeps a [`FilterSnapshot`] and the time of the last update. Each thread
/// has one filter, which takes over the state of a vehicle for a step. So an update costs one step
/// of a filter and two copies of its state: O(E + n).
///
/// # Memory
///
/// A vehicle of n states takes 8 n bytes and some 200 more, or 16 n while its belief is held in
/// logarithms, which never happens in a model with [rounded tails](Hmm::with_rounded_tails);
/// [`usage`](Self::usage) reports it. With a limit, the least recently updated vehicles are kept in
/// files, and come back with their next update; some 70 bytes of each stay in memory. This changes
/// no answer, to the bit.
///
/// # Errors
///
/// A refused update changes nothing: see [`UpdateError`].
pub struct Pool<A: Transition, B: Likelihood> {
    model: Arc<Hmm<A, B>>,
    hash: String,
    hasher: RandomState,
    /// Shared with the thread that writes a snapshot.
    shards: Arc<[Mutex<Shard>]>,
    /// One for each thread.
    filters: Vec<Filter<Arc<Hmm<A, B>>>>,
    timing: Timing,
    latest: Latest,
    /// The latest time at the last sweep for forgotten vehicles, and the number of shards that this
    /// sweep has left to look through.
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

/// Answer to an update.
pub type UpdateResult = Result<Answer, UpdateError>;

impl<A: Transition, B: Likelihood> Pool<A, B> {
    /// Creates an empty pool. The hash identifies the model in [snapshots](Self::snapshot): that of
    /// [`Model::hash`](crate::model::Model::hash), or any text that changes with the model.
    ///
    /// # Errors
    ///
    /// [`FleetError`] if a limit is given without a folder, or the folder cannot be used.
    pub fn new(
        model: Arc<Hmm<A, B>>,
        hash: impl Into<String>,
        options: &PoolOptions,
    ) -> Outcome<Self> {
        let folder = match (options.memory, &options.spill) {
            (None, _) => None,
            (Some(_), Some(path)) => Some(Folder::open(path)?),
            (Some(_), None) => {
                let message = "a memory limit needs a folder for the vehicles beyond it";
                return Err(FleetError::Settings(message.to_owned()));
            }
        };
        let hash = hash.into();
        if hash.len() > LONGEST_HASH {
            let message =
                format!("the hash has {} bytes, expected at most {LONGEST_HASH}", hash.len());
            return Err(FleetError::Settings(message));
        }
        let threads = options.threads.max(1);
        // A power of two, so that `place` can take bits of the hash.
        let count = (SHARDS * threads).next_power_of_two().min(MOST_SHARDS);
        let (hasher, limit) = (RandomState::new(), options.memory.unwrap_or(0) / count);
        let shard = |number| {
            let disk = folder.as_ref().map(|folder| Disk::new(folder, number, model.states()));
            Mutex::new(Shard::new(hasher.clone(), limit, disk))
        };
        let shards: Arc<[_]> = (0..count).map(shard).collect();
        let filters = (0..threads).map(|_| Filter::new(Arc::clone(&model))).collect();
        let (timing, latest) = (Timing::default(), Latest::default());
        let (swept, to_sweep) = (i64::MIN, 0);
        Ok(Self { model, hash, hasher, shards, filters, timing, latest, swept, to_sweep })
    }

    /// The model.
    #[must_use]
    pub fn model(&self) -> &Hmm<A, B> {
        &self.model
    }

    /// Number of vehicles, and the memory and disk space they take. O(threads).
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

    /// State of a vehicle with its belief, to continue with in a filter of your own; `None` if
    /// the vehicle is unknown. Asking does not count as an update.
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

    /// Time of the last update of a vehicle, or `None` if it is unknown.
    #[must_use]
    pub fn time(&self, vehicle: &VehicleId) -> Option<i64> {
        let (hash, shard) = self.place(vehicle);
        let shard = lock(&self.shards[shard]);
        shard.find(hash, vehicle).map(|at| shard.time(at)).filter(|&time| self.is_kept(time))
    }

    /// Forgets a vehicle. Returns false if it is unknown.
    pub fn remove(&mut self, vehicle: &VehicleId) -> bool {
        let (hash, shard) = self.place(vehicle);
        let mut shard = lock(&self.shards[shard]);
        let time = shard.find(hash, vehicle).map(|at| shard.time(at));
        self.latest.remove(vehicle);
        shard.remove(hash, vehicle) && time.is_some_and(|time| self.is_kept(time))
    }

    /// First failure to move a vehicle to disk since the last call. Such vehicles stay in memory,
    /// beyond the limit; none is lost.
    pub fn take_spill_error(&mut self) -> Option<FleetError> {
        self.shards.iter().find_map(|shard| lock(shard).failure.take())
    }

    /// Hash and shard of a vehicle.
    fn place(&self, vehicle: &VehicleId) -> (u64, usize) {
        let hash = self.hasher.hash_one(vehicle);
        // The hash table of the shard uses the lowest bits and the top seven. Other bits must
        // choose the shard, or all of its vehicles would collide there.
        (hash, (hash >> 40) as usize & (self.shards.len() - 1))
    }
}

/// Locks a shard. Its invariants hold even if a sensor panicked in it, so a poisoned lock can be
/// used.
fn lock(shard: &Mutex<Shard>) -> MutexGuard<'_, Shard> {
    shard.lock().unwrap_or_else(PoisonError::into_inner)
}
