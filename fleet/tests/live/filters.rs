//! Filters of single vehicles, for comparison with pools.

use std::collections::HashMap;
use std::fs;
use std::path::Path;
use std::sync::Arc;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use tempfile::TempDir;
use wayfix::{Filter, Hmm, HmmError, Likelihood, Transition};
use wayfix_fleet::FleetError;
use wayfix_fleet::pool::{Pool, PoolOptions, Update, UpdateResult, VehicleId};

use crate::kit::*;

/// Filters of single vehicles.
pub(crate) struct Filters<'a, A: Transition, B: Likelihood> {
    hmm: &'a Hmm<A, B>,
    pub(crate) vehicles: HashMap<VehicleId, Seen<'a, A, B>>,
}

/// Time of the last update, and the filter.
pub(crate) type Seen<'a, A, B> = (i64, Filter<&'a Hmm<A, B>>);

/// State, and the bits of its probability and of the log-likelihood; or the kind of an error.
pub(crate) type Expected = Result<(usize, u64, u64), &'static str>;

impl<'a, A, B> Filters<'a, A, B>
where
    A: Transition<Control = ()>,
    B: Likelihood<Observation: Sized>,
{
    pub(crate) fn new(hmm: &'a Hmm<A, B>) -> Self {
        Self { hmm, vehicles: HashMap::new() }
    }

    pub(crate) fn take(&mut self, update: &Update<B::Observation>) -> Expected {
        let known = self.vehicles.get(&update.vehicle);
        if known.is_some_and(|known| update.time <= known.0) {
            return Err("time");
        }
        let known = known.filter(|_| !update.restart);
        let mut filter = known.map_or_else(|| self.hmm.filter(), |known| known.1.clone());
        let log = filter.step(&update.observation).map_err(|error| match error {
            HmmError::Impossible { .. } => "impossible",
            HmmError::Likelihood(_) => "likelihood",
            other => panic!("{other}"),
        })?;
        let (state, probability) = filter.belief().peak();
        self.vehicles.insert(update.vehicle.clone(), (update.time, filter));
        Ok((state, probability.to_bits(), log.to_bits()))
    }
}

pub(crate) fn bits(answer: &UpdateResult) -> Expected {
    let bits = |number: f64| number.to_bits();
    match answer {
        Ok(answer) => Ok((answer.state, bits(answer.probability), bits(answer.log_likelihood))),
        Err(error) => Err(error.kind()),
    }
}

/// Random updates of vehicles, some of them late or repeated, some restarting from the prior.
pub(crate) fn updates<Y>(
    rng: &mut ChaCha8Rng,
    count: usize,
    mut see: impl FnMut(&mut ChaCha8Rng) -> Y,
) -> Vec<Update<Y>> {
    let mut times: HashMap<i64, i64> = HashMap::new();
    let mut update = |_| {
        let vehicle = rng.random_range(0..60);
        let time = times.entry(vehicle).or_insert(rng.random_range(-5..5));
        *time += if rng.random_bool(0.1) { -1 } else { rng.random_range(0..4) };
        let (time, seen) = (*time, see(rng));
        let mut update = match vehicle {
            0..30 => Update::new(vehicle, time, seen),
            _ => Update::new(format!("vehicle {vehicle}"), time, seen),
        };
        update.restart = rng.random_bool(0.02);
        update
    };
    (0..count).map(&mut update).collect()
}

/// Opens a pool as soon as its folder is free: a command that another test is starting inherits all
/// locks of this process for a moment.
fn open<T>(pool: impl Fn() -> Result<T, FleetError>) -> T {
    loop {
        match pool() {
            Err(FleetError::Settings(text)) if text.contains("another pool") => {}
            pool => return pool.unwrap(),
        }
    }
}

/// Runs a pool over updates in batches, and compares all answers and states. With `stops`, it
/// continues from a snapshot several times.
pub(crate) fn compare<A, B>(
    hmm: Hmm<A, B>,
    updates: &[Update<B::Observation>],
    options: &PoolOptions,
    stops: bool,
) where
    A: Transition<Control = ()> + Send + Sync,
    B: Likelihood<Observation: Sized + Sync> + Send + Sync,
{
    let mut rng = rng(updates.len() as u64);
    let folder = TempDir::new().unwrap();
    let hmm = Arc::new(hmm);
    let mut filters = Filters::new(&hmm);
    let mut pool = open(|| Pool::new(Arc::clone(&hmm), "model", options));
    let mut refused = 0;
    let mut rest = updates;
    while !rest.is_empty() {
        let (batch, others) = rest.split_at(rng.random_range(1..=400).min(rest.len()));
        rest = others;
        let answers = match batch {
            [one] => vec![pool.update(one)],
            _ => pool.update_all(batch),
        };
        let found: Vec<Expected> = answers.iter().map(bits).collect();
        let expected: Vec<Expected> = batch.iter().map(|update| filters.take(update)).collect();
        assert_eq!(found, expected);
        refused += found.iter().filter(|found| found.is_err()).count();
        if stops {
            let file = folder.path().join("pool.bin");
            let length = pool.snapshot(&file).unwrap();
            assert_eq!(fs::metadata(&file).unwrap().len(), length);
            drop(pool); // one pool at a time may use the folder
            pool = open(|| Pool::restore(&file, Arc::clone(&hmm), "model", options));
        }
        assert!(pool.take_spill_error().is_none());
    }
    assert!(refused > updates.len() / 20 && refused < updates.len() / 2, "{refused}");
    assert_eq!(pool.usage().vehicles, filters.vehicles.len());
    for (vehicle, (time, filter)) in &filters.vehicles {
        assert_eq!(pool.time(vehicle), Some(*time));
        assert_eq!(pool.state(vehicle).unwrap(), Some(filter.snapshot()));
    }
}

pub(crate) fn threads(threads: usize) -> PoolOptions {
    PoolOptions { threads, memory: None, spill: None }
}

/// Memory for one vehicle in each shard of the pool.
pub(crate) fn tiny(folder: &Path) -> PoolOptions {
    PoolOptions { threads: 2, memory: Some(1), spill: Some(folder.join("spill")) }
}

/// Logarithms beyond the range of doubles, so that beliefs have to be kept as logarithms; with
/// impossible states.
pub(crate) fn wide(rng: &mut ChaCha8Rng) -> Vec<f64> {
    let scale = [1.0, 30.0, 2000.0][rng.random_range(0..3)];
    let nearly_none = rng.random_bool(0.1);
    let never = if nearly_none { 0.95 } else { 0.1 };
    let value = |_| {
        if rng.random_bool(never) { f64::NEG_INFINITY } else { scale * rng.random_range(-1.0..0.0) }
    };
    (0..STATES).map(value).collect()
}

pub(crate) fn all_ways<A, B>(hmm: &Hmm<A, B>, updates: &[Update<B::Observation>])
where
    A: Transition<Control = ()> + Send + Sync + Clone,
    B: Likelihood<Observation: Sized + Sync> + Send + Sync + Clone,
{
    for count in 1..4 {
        compare(hmm.clone(), updates, &threads(count), false);
    }
    compare(hmm.clone(), updates, &threads(2), true);
    let folder = TempDir::new().unwrap();
    compare(hmm.clone(), updates, &tiny(folder.path()), false);
    compare(hmm.clone(), updates, &tiny(folder.path()), true);
}
