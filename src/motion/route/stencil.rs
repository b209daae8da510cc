//! The moves of a speed as sums of shifted vectors. Places in a run have the same terms, so that a
//! product is one loop for each run; on an open route all but a few places at the ends are one run.

use std::ops::Range;

use super::geometry::Line;

/// Terms of the sums at runs of places, without the ends of an open route, where several moves
/// stop.
#[derive(Debug, Clone, Default)]
pub(super) struct Stencil(Vec<Run>);

#[derive(Debug, Clone)]
struct Run {
    places: Range<usize>,
    taps: Vec<Tap>,
}

/// A term of a sum.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Tap {
    /// Offset from the place; around a loop, it may lead beyond the ends.
    offset: isize,
    /// Index of the weight in the window.
    weight: usize,
    /// True for a move that ends where it began.
    stays: bool,
}

/// Direction of a stencil.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Direction {
    /// Sums at the targets of moves, over their sources.
    Into,
    /// Sums at the sources of moves, over their targets.
    OutOf,
}

impl Stencil {
    /// Builds the stencil of moves from `first` on.
    pub(super) fn new(line: Line, first: isize, count: usize, direction: Direction) -> Self {
        let mut runs: Vec<Run> = Vec::new();
        for place in 0..line.places {
            let mut taps = Vec::new();
            for (weight, m) in (0..count).zip(first..) {
                let shift = if direction == Direction::Into { -m } else { m };
                let Some(other) = line.moved(place, shift) else { continue };
                let to = if direction == Direction::Into { place } else { other };
                if line.ends().any(|end| end == to) {
                    continue;
                }
                taps.push(Tap { offset: shift, weight, stays: other == place });
            }
            match runs.last_mut() {
                Some(run) if run.taps == taps => run.places.end = place + 1,
                _ => runs.push(Run { places: place..place + 1, taps }),
            }
        }
        Self(runs)
    }

    /// Visits the runs among some places: the places, and for each tap the first place that it
    /// reads, its weight, and whether the move ends where it began.
    pub(super) fn runs(
        &self,
        places: Range<usize>,
    ) -> impl Iterator<Item = (Range<usize>, impl Iterator<Item = (isize, usize, bool)> + Clone)>
    {
        let first = self.0.partition_point(|run| run.places.end <= places.start);
        let runs = self.0[first..].iter().take_while(move |run| run.places.start < places.end);
        runs.map(move |run| {
            let start = run.places.start.max(places.start);
            let from = start.cast_signed();
            let taps = run.taps.iter().map(move |tap| (from + tap.offset, tap.weight, tap.stays));
            (start..run.places.end.min(places.end), taps)
        })
    }
}
