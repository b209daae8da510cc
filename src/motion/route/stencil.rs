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
    /// Distance before or after the place; around a loop, with the whole of it.
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
                let offset = other.cast_signed() - place.cast_signed();
                taps.push(Tap { offset, weight, class: class(from, to) });
            }
            match runs.last_mut() {
                Some(run) if run.taps == taps => run.places.end = place + 1,
                _ => runs.push(Run { places: place..place + 1, taps }),
            }
        }
        Self(runs)
    }

    /// Goes through the runs: their places, and for each tap the first of the places that
    /// it takes, its move and its class.
    pub(super) fn runs(
        &self,
    ) -> impl Iterator<Item = (Range<usize>, impl Iterator<Item = (usize, usize, Class)> + Clone)>
    {
        self.0.iter().map(|run| {
            let taps = run.taps.iter().map(|tap| {
                (run.places.start.wrapping_add_signed(tap.offset), tap.weight, tap.class)
            });
            (run.places.clone(), taps)
        })
    }
}
