//! Effects of the time of updates: forgetting vehicles, and steps by the clock.
//!
//! Whether a vehicle is forgotten depends only on its time and the latest time ([`Moment`]).
//! Removing it from memory is a separate matter, done in small sweeps, and changes no answer.

use std::num::{NonZeroU64, NonZeroUsize};
use std::sync::Arc;

use wayfix::{Filter, Hmm, Likelihood, Transition};

use super::{Latest, Pool, PoolOptions, lock};
use crate::error::{FleetError, Outcome};

/// Effects of the time of updates, besides refusing those that are late or come twice.
///
/// None by default: an update is one step of the model, and vehicles are kept forever.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Timing {
    /// A vehicle is forgotten once the latest time is more than this above the time of its last
    /// update. Its next update starts from the prior.
    pub forget_after: Option<u64>,
    /// Duration of a step of the model, in units of time. An update makes one transition per
    /// multiple of this between the last update and itself, and none if there is none.
    pub step: Option<NonZeroU64>,
    /// Maximum transitions of an update; further ones are left out. At least 1.
    pub most_steps: Option<NonZeroU64>,
    /// The latest time is the largest that this many vehicles have reached; by default, the largest
    /// of all updates. With 2, a single clock that is far ahead makes nobody forgotten; with 3, nor
    /// do two.
    pub agree: Option<NonZeroUsize>,
}

impl Timing {
    pub(super) fn agree(&self) -> usize {
        self.agree.map_or(1, NonZeroUsize::get)
    }
}

/// Default maximum of transitions of an update.
const MOST_STEPS: u64 = 1000;

/// The moment at which an update is applied.
pub(super) struct Moment<'a> {
    pub(super) timing: &'a Timing,
    /// The latest time up to this update.
    pub(super) latest: i64,
}

impl Moment<'_> {
    /// Vehicles last updated before this time are forgotten.
    pub(super) fn forgotten_before(&self) -> i64 {
        self.timing
            .forget_after
            // Below the range of times nothing is forgotten.
            .map_or(i64::MIN, |units| self.latest.checked_sub_unsigned(units).unwrap_or(i64::MIN))
    }

    pub(super) fn is_forgotten(&self, last: i64) -> bool {
        last < self.forgotten_before()
    }

    /// Number of transitions from the last update to this one.
    pub(super) fn steps(&self, last: i64, time: i64) -> u64 {
        let Some(step) = self.timing.step else { return 1 };
        // Multiples of `step` in (last, time]: on a fixed grid, so splitting an interval does not
        // change the total. In 128 bits, since the difference of two times may not fit into 64.
        let place = |time: i64| i128::from(time).div_euclid(i128::from(step.get()));
        let between = (place(time) - place(last)).max(0) as u128;
        let most = self.timing.most_steps.map_or(MOST_STEPS, NonZeroU64::get);
        between.min(u128::from(most)) as u64
    }
}

impl<A: Transition, B: Likelihood> Pool<A, B> {
    /// Sets the effects of the time of all later updates. A snapshot does not contain the latest
    /// time; `latest` passes it on, if known.
    pub fn set_timing(&mut self, timing: Timing, latest: Option<i64>) {
        self.timing = timing;
        if latest > self.latest.time() {
            self.latest = Latest::at(latest);
        }
    }

    /// The latest time, also counting refused updates; `None` before the first.
    #[must_use]
    pub fn latest(&self) -> Option<i64> {
        self.latest.time()
    }

    pub(super) fn set_latest(&mut self, latest: Latest) {
        self.latest = latest;
    }

    pub(super) fn clone_latest(&self) -> Latest {
        self.latest.clone()
    }

    /// Removes all vehicles that are [to be forgotten](Timing::forget_after). Answers are the same
    /// without it.
    pub fn forget(&mut self) {
        let moment = self.moment();
        let (latest, before) = (moment.latest, moment.forgotten_before());
        (self.swept, self.to_sweep) = (latest, 0);
        self.shards.iter().for_each(|shard| lock(shard).forget_before(before));
    }

    /// Sweeps one shard at a time, so that no update waits for long.
    pub(super) fn forget_some(&mut self) {
        let Some(units) = self.timing.forget_after else { return };
        let moment = self.moment();
        let (latest, before) = (moment.latest, moment.forgotten_before());
        if self.to_sweep == 0 {
            // A sweep begins whenever the latest time has grown by an eighth of the interval: at
            // most about that share of forgotten vehicles is still in memory, at a small cost per
            // update.
            let next = self.swept.checked_add_unsigned(units / 8 + 1);
            if next.is_none_or(|next| latest < next) {
                return;
            }
            (self.swept, self.to_sweep) = (latest, self.shards.len());
        }
        self.to_sweep -= 1;
        lock(&self.shards[self.to_sweep]).forget_before(before);
    }

    /// False for a vehicle to be forgotten, even if it is still in memory.
    pub(super) fn is_kept(&self, last: i64) -> bool {
        !self.moment().is_forgotten(last)
    }

    /// The moment after the last update.
    pub(super) fn moment(&self) -> Moment<'_> {
        Moment { timing: &self.timing, latest: self.latest.time().unwrap_or(i64::MIN) }
    }

    /// Continues with another model. Vehicles keep their belief if it has the same number of
    /// states; otherwise all start anew, from an empty pool.
    ///
    /// # Errors
    ///
    /// [`FleetError`] as for [`new`](Self::new), or while a snapshot is being written; the pool is
    /// then lost.
    pub fn with_model<C: Transition, D: Likelihood>(
        mut self,
        model: Arc<Hmm<C, D>>,
        hash: impl Into<String>,
        options: &PoolOptions,
    ) -> Outcome<Pool<C, D>> {
        self.take_with_model(model, hash.into(), options)
    }

    /// The same; leaves an unusable pool behind.
    pub(super) fn take_with_model<C: Transition, D: Likelihood>(
        &mut self,
        model: Arc<Hmm<C, D>>,
        hash: String,
        options: &PoolOptions,
    ) -> Outcome<Pool<C, D>> {
        let shards = std::mem::replace(&mut self.shards, Arc::from([]));
        let (hasher, timing, latest) = (self.hasher.clone(), self.timing, self.latest.clone());
        let (swept, to_sweep) = (self.swept, self.to_sweep);
        let states = self.model.states();
        if model.states() != states {
            if Arc::strong_count(&shards) > 1 {
                let message = "the model cannot be replaced while a snapshot is being written";
                return Err(FleetError::Settings(message.to_owned()));
            }
            // Unlocks the folder, which only one pool at a time may use.
            drop(shards);
            let mut pool = Pool::new(model, hash, options)?;
            (pool.timing, pool.latest) = (timing, latest);
            return Ok(pool);
        }
        let filters = self.filters.iter().map(|_| Filter::new(Arc::clone(&model))).collect();
        Ok(Pool { model, hash, hasher, shards, filters, timing, latest, swept, to_sweep })
    }
}
