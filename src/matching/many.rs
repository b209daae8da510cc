//! Many drives, in parallel with the feature `rayon`.

use std::ops::ControlFlow;

use super::{MatchError, MatchMemory, MatchedDrive, Matcher, TracePoint};
use crate::inference::engines::parallel::{self, MemoryPool};
use crate::map::Coordinates;

/// Drives for each thread that are under way or wait for the visitor.
const DRIVES_AHEAD: usize = 4;

impl<P: Coordinates> Matcher<P> {
    /// Matches any number of drives, and passes each with its index, from 0, to a visitor, in
    /// their order, until it breaks. A drive with an error costs the others nothing.
    ///
    /// In parallel with the feature `rayon`, with the same results; source and visitor run on the
    /// thread of the caller. Memory: four drives for each thread, with their results.
    ///
    /// ```
    /// # use wayfix::map::{NetworkBuilder, PlanePosition, RoadClass};
    /// # let mut builder = NetworkBuilder::new();
    /// # builder.node(1, PlanePosition { x: 0.0, y: 0.0 })?;
    /// # builder.node(2, PlanePosition { x: 2000.0, y: 0.0 })?;
    /// # builder.both_ways(1, 2, RoadClass::Street)?;
    /// # let network = builder.build()?;
    /// use std::ops::ControlFlow;
    ///
    /// use wayfix::matching::{Matcher, TracePoint};
    ///
    /// let matcher = Matcher::new(network);
    /// let point = |k: u32| {
    ///     TracePoint::new(f64::from(k), PlanePosition { x: 10.0 * f64::from(k), y: 3.0 })
    /// };
    /// // The second has no points.
    /// let drives: Vec<Vec<_>> = vec![(0..100).map(point).collect(), Vec::new()];
    /// let (mut metres, mut failed) = (0.0, Vec::new());
    /// let _ = matcher.match_map_all(&drives, |index, drive| {
    ///     match drive {
    ///         Ok(drive) => metres += drive.metres(),
    ///         Err(_) => failed.push(index),
    ///     }
    ///     ControlFlow::<()>::Continue(())
    /// });
    /// assert!((metres - 990.0).abs() < 1.0);
    /// assert_eq!(failed, [1]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn match_map_all<D: AsRef<[TracePoint<P>]> + Send, T>(
        &self,
        drives: impl IntoIterator<Item = D>,
        mut visit: impl FnMut(usize, Result<MatchedDrive<P>, MatchError>) -> ControlFlow<T>,
    ) -> ControlFlow<T> {
        let matched = |drive: D, memory: &mut MatchMemory| self.match_drive(drive.as_ref(), memory);
        let mut indices = 0..;
        in_order(drives.into_iter(), &mut MatchMemory::default(), matched, |drive| {
            indices.next().map_or(ControlFlow::Continue(()), |index| visit(index, drive))
        })
    }
}

/// Works on items with a memory for each thread, and takes the results in the order of the items,
/// on the thread of the caller, until `take` breaks.
pub(super) fn in_order<T: Send, R: Send, Stop>(
    items: impl Iterator<Item = T>,
    memory: &mut MatchMemory,
    work: impl Fn(T, &mut MatchMemory) -> R + Sync,
    take: impl FnMut(R) -> ControlFlow<Stop>,
) -> ControlFlow<Stop> {
    let spare = MemoryPool::default();
    spare.push(std::mem::take(memory));
    let work = |item| {
        let mut memory = spare.pop().unwrap_or_default();
        let result = work(item, &mut memory);
        spare.push(memory);
        result
    };
    let done = parallel::in_order(items, DRIVES_AHEAD, work, take);
    *memory = spare.pop().unwrap_or_default();
    done
}
