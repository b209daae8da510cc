//! The moves of a speed as sums of shifted vectors.

use std::ops::Range;

use super::geometry::Line;
use super::views::Class;

/// For runs of places, what their sums are made of. The ends of an open route, where
/// several moves stop, are not among what is led to.
#[derive(Debug, Clone, Default)]
pub(super) struct Stencil(Vec<Run>);

#[derive(Debug, Clone)]
struct Run {
    places: Range<usize>,
    taps: Vec<Tap>,
}

/// A term of the sums.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Tap {
    /// Distance from the place; around a loop, it may lead beyond the ends.
    offset: isize,
    /// Which of the moves of the window.
    weight: usize,
    class: Class,
}

/// Which way a stencil goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Way {
    /// To each place, from where moves lead.
    Into,
    /// From each place, to where moves lead.
    OutOf,
}

impl Stencil {
    /// For moves from the first on.
    pub(super) fn new(
        line: Line,
        first: isize,
        count: usize,
        way: Way,
        class: impl Fn(usize, usize) -> Class,
    ) -> Self {
        let mut runs: Vec<Run> = Vec::new();
        for place in 0..line.places {
            let mut taps = Vec::new();
            for (weight, m) in (0..count).zip(first..) {
                let shift = if way == Way::Into { -m } else { m };
                let Some(other) = line.moved(place, shift) else { continue };
                let (from, to) = if way == Way::Into { (other, place) } else { (place, other) };
                if line.ends().any(|end| end == to) {
                    continue;
                }
                taps.push(Tap { offset: shift, weight, class: class(from, to) });
            }
            match runs.last_mut() {
                Some(run) if run.taps == taps => run.places.end = place + 1,
                _ => runs.push(Run { places: place..place + 1, taps }),
            }
        }
        Self(runs)
    }

    /// Goes through the runs of some places: the places, and for each tap the first of those
    /// that it takes, its move and its class.
    pub(super) fn runs(
        &self,
        places: Range<usize>,
    ) -> impl Iterator<Item = (Range<usize>, impl Iterator<Item = (isize, usize, Class)> + Clone)>
    {
        let first = self.0.partition_point(|run| run.places.end <= places.start);
        let runs = self.0[first..].iter().take_while(move |run| run.places.start < places.end);
        runs.map(move |run| {
            let start = run.places.start.max(places.start);
            let from = start.cast_signed();
            let taps = run.taps.iter().map(move |tap| (from + tap.offset, tap.weight, tap.class));
            (start..run.places.end.min(places.end), taps)
        })
    }
}
