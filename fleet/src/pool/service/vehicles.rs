//! Pools with either operator behind one trait object, so that a run can replace a model by one of
//! the other kind.

use std::path::Path;
use std::sync::Arc;

use wayfix::Transition;

use crate::error::{FleetError, Outcome};
use crate::model::{Model, with_hmm};
use crate::pool::latest::Latest;
use crate::pool::{Pool, PoolOptions, Timing, Update, UpdateResult, Usage, VehicleId, Writing};
use crate::sensor::{Observation, Sensor};

/// What to do before a snapshot is renamed.
pub(super) type Before = Box<dyn FnOnce() -> Outcome<()> + Send>;

/// A pool with a model from a file.
pub(super) trait Vehicles {
    fn update_all(&mut self, updates: &[Update<Observation>]) -> Vec<UpdateResult>;
    fn remove(&mut self, vehicle: &VehicleId) -> bool;
    fn sensor(&self) -> &Sensor;
    fn usage(&self) -> Usage;
    fn set_timing(&mut self, timing: Timing, latest: Latest);
    fn latest(&self) -> Latest;
    fn forget(&mut self);
    fn take_spill_error(&mut self) -> Option<FleetError>;
    fn snapshot(&self, path: &Path, note: &[u8]) -> Outcome<u64>;
    fn begin_snapshot(&mut self, path: &Path, note: &[u8], before: Before) -> Outcome<Writing>;
    /// Continues with another model; leaves an unusable pool behind.
    fn exchange(&mut self, model: &Model, options: &PoolOptions) -> Outcome<Box<dyn Vehicles>>;
}

/// Opens a pool, with the vehicles of a snapshot if one is given.
pub(super) fn open(
    model: &Model,
    restore: Option<&Path>,
    options: &PoolOptions,
) -> Outcome<Box<dyn Vehicles>> {
    with_hmm!(model, hmm => {
        let hmm = Arc::new(hmm.clone());
        Ok(match restore {
            Some(path) => Box::new(Pool::restore(path, hmm, model.hash(), options)?),
            None => Box::new(Pool::new(hmm, model.hash(), options)?),
        })
    })
}

impl<A> Vehicles for Pool<A, Sensor>
where
    A: Transition<Control = ()> + Send + Sync + 'static,
{
    fn update_all(&mut self, updates: &[Update<Observation>]) -> Vec<UpdateResult> {
        Self::update_all(self, updates)
    }

    fn remove(&mut self, vehicle: &VehicleId) -> bool {
        Self::remove(self, vehicle)
    }

    fn sensor(&self) -> &Sensor {
        self.model().likelihood()
    }

    fn usage(&self) -> Usage {
        Self::usage(self)
    }

    fn set_timing(&mut self, timing: Timing, latest: Latest) {
        // The full state of the latest time, rather than its value alone, so that a restored run
        // forgets at the same moments.
        Self::set_timing(self, timing, None);
        self.set_latest(latest);
    }

    fn latest(&self) -> Latest {
        self.clone_latest()
    }

    fn forget(&mut self) {
        Self::forget(self);
    }

    fn take_spill_error(&mut self) -> Option<FleetError> {
        Self::take_spill_error(self)
    }

    fn snapshot(&self, path: &Path, note: &[u8]) -> Outcome<u64> {
        self.snapshot_with(path, note)
    }

    fn begin_snapshot(&mut self, path: &Path, note: &[u8], before: Before) -> Outcome<Writing> {
        self.begin_snapshot_with(path, note, before)
    }

    fn exchange(&mut self, model: &Model, options: &PoolOptions) -> Outcome<Box<dyn Vehicles>> {
        with_hmm!(model, hmm => {
            let hash = model.hash().to_owned();
            Ok(Box::new(self.take_with_model(Arc::new(hmm.clone()), hash, options)?))
        })
    }
}
