//! Timing and names of routines.

use std::hint::black_box;

use criterion::{Criterion, Throughput};

pub(crate) const POSSIBLE: &str = "the observation is possible";

/// The routines with one model.
pub(crate) struct Group<'c> {
    criterion: &'c mut Criterion,
    model: String,
}

impl<'c> Group<'c> {
    pub(crate) fn new(criterion: &'c mut Criterion, model: impl Into<String>) -> Self {
        Self { criterion, model: model.into() }
    }

    /// One sequence, or one step of a stream.
    pub(crate) fn single<W: FnMut() -> R, R>(
        &mut self,
        routine: &str,
        steps: usize,
        prepare: impl Fn() -> W,
    ) {
        self.bench(routine, "single", steps, prepare);
    }

    /// Many sequences.
    pub(crate) fn batch<W: FnMut() -> R, R>(
        &mut self,
        routine: &str,
        steps: usize,
        prepare: impl Fn() -> W,
    ) {
        self.bench(routine, "batch", steps, prepare);
    }

    /// Nothing is prepared for a name that the filter excludes.
    fn bench<W: FnMut() -> R, R>(
        &mut self,
        routine: &str,
        way: &str,
        steps: usize,
        prepare: impl Fn() -> W,
    ) {
        let mut group = self.criterion.benchmark_group(format!("{}/{routine}", self.model));
        group.throughput(Throughput::Elements(steps as u64));
        group.bench_function(way, |bencher| {
            let mut work = prepare();
            bencher.iter(|| black_box(work()));
        });
        group.finish();
    }
}
