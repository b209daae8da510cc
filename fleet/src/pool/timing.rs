//! What the time of an update does.

use std::num::{NonZeroU64, NonZeroUsize};
use std::sync::Arc;

use wayfix::{Filter, Hmm, Likelihood, Transition};

use super::{Latest, Pool, PoolOptions, lock};
use crate::error::{FleetError, Outcome};

/// What the time of updates does, beside refusing those that are late or come twice.
///
/// Nothing by default: an update is a step of the model, and vehicles are kept for good.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Timing {
    /// A vehicle is forgotten as soon as the latest time is more than this above the time of its
    /// last update. Its next update begins at the prior.
    pub forget_after: Option<u64>,
    /// Units of time of a step of the model. An update takes as many transitions as multiples of
    /// this lie between it and the last update, none if there is none.
    pub step: Option<NonZeroU64>,
    /// Most transitions of an update; those beyond are left out. At least 1.
    pub most_steps: Option<NonZeroU64>,
    /// The latest time is the largest that so many vehicles have reached; that of all updates by
    /// default. So with 2 of them one clock that is far ahead forgets nobody, with 3 two.
    pub agree: Option<NonZeroUsize>,
}

impl Timing {
    pub(super) fn agree(&self) -> usize {
        self.agree.map_or(1, NonZeroUsize::get)
    }
}

/// Transitions of an update if no other number is given.
const MOST_STEPS: u64 = 1000;

/// The time at which an update is taken.
pub(super) struct Moment<'a> {
    pub(super) timing: &'a Timing,
    /// The latest time up to this update.
    pub(super) latest: i64,
}

impl Moment<'_> {
    /// Time before which vehicles are forgotten.
    pub(super) fn forgotten_before(&self) -> i64 {
        self.timing
            .forget_after
            .map_or(i64::MIN, |units| self.latest.checked_sub_unsigned(units).unwrap_or(i64::MIN))
    }

    pub(super) fn is_forgotten(&self, last: i64) -> bool {
        last < self.forgotten_before()
    }

    /// Transitions from the last update to this.
    pub(super) fn steps(&self, last: i64, time: i64) -> u64 {
        let Some(step) = self.timing.step else { return 1 };
        let place = |time: i64| i128::from(time).div_euclid(i128::from(step.get()));
        let between = (place(time) - place(last)).max(0) as u128;
        let most = self.timing.most_steps.map_or(MOST_STEPS, NonZeroU64::get);
        between.min(u128::from(most)) as u64
    }
}

impl<A: Transition, B: Likelihood> Pool<A, B> {
    /// Says what the time of updates does from now on. The latest time of updates so far is not
    /// in a snapshot: `latest` gives it, if it is known.
    pub fn set_timing(&mut self, timing: Timing, latest: Option<i64>) {
        self.timing = timing;
        if latest > self.latest.time() {
            self.latest = Latest::at(latest);
        }
    }

    /// The latest time, of updates that were refused, too; `None` before the first.
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
    /// without.
    pub fn forget(&mut self) {
        let moment = self.moment();
        let (latest, before) = (moment.latest, moment.forgotten_before());
        (self.swept, self.to_sweep) = (latest, 0);
        self.shards.iter().for_each(|shard| lock(shard).forget_before(before));
    }

    /// Removes some of them, so that no update waits for long.
    pub(super) fn forget_some(&mut self) {
        let Some(units) = self.timing.forget_after else { return };
        let moment = self.moment();
        let (latest, before) = (moment.latest, moment.forgotten_before());
        if self.to_sweep == 0 {
            let next = self.swept.checked_add_unsigned(units / 8 + 1);
            if next.is_none_or(|next| latest < next) {
                return;
            }
            (self.swept, self.to_sweep) = (latest, self.shards.len());
        }
        self.to_sweep -= 1;
        lock(&self.shards[self.to_sweep]).forget_before(before);
    }

    /// False for a vehicle that is to be forgotten, which may still be here.
    pub(super) fn is_kept(&self, last: i64) -> bool {
        !self.moment().is_forgotten(last)
    }

    /// The moment after the last update.
    pub(super) fn moment(&self) -> Moment<'_> {
        Moment { timing: &self.timing, latest: self.latest.time().unwrap_or(i64::MIN) }
    }

    /// Goes on with another model. Vehicles keep their belief if it has as many states, and begin
    /// anew otherwise: the pool is then empty.
    ///
    /// # Errors
    ///
    /// [`FleetError`] as [`new`](Self::new), or while a snapshot is being written; the pool is gone.
    pub fn with_model<C: Transition, D: Likelihood>(
        mut self,
        model: Arc<Hmm<C, D>>,
        hash: impl Into<String>,
        options: &PoolOptions,
    ) -> Outcome<Pool<C, D>> {
        self.take_with_model(model, hash.into(), options)
    }

    /// The same, which leaves a pool that is of no use.
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
                let message = "the model is exchanged while a snapshot is being written";
                return Err(FleetError::Settings(message.to_owned()));
            }
            // Its folder is for one at a time.
            drop(shards);
            let mut pool = Pool::new(model, hash, options)?;
            (pool.timing, pool.latest) = (timing, latest);
            return Ok(pool);
        }
        let filters = self.filters.iter().map(|_| Filter::new(Arc::clone(&model))).collect();
        Ok(Pool { model, hash, hasher, shards, filters, timing, latest, swept, to_sweep })
    }
}
