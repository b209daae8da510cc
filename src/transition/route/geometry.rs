//! Which places a window reaches from where.

use std::iter::Chain;
use std::ops::Range;

use super::RouteTransition;

/// Places in ascending order: of a closed route, those before the first one are
/// the last ones.
pub(super) type Places = Chain<Range<usize>, Range<usize>>;

impl RouteTransition {
    /// Where a gear leads from a place.
    pub(super) fn targets(&self, gear: usize, from: usize) -> Places {
        let (moves, from) = (self.gears[gear].moves(), from.cast_signed());
        let (first, last) = (from + moves.start(), from + moves.end());
        if self.closed {
            return self.around(first, last);
        }
        let most = self.places.cast_signed() - 1;
        between(first.clamp(0, most), last.clamp(0, most))
    }

    /// Where a gear may come from to a place.
    pub(super) fn sources(&self, gear: usize, to: usize) -> Places {
        let (moves, to) = (self.gears[gear].moves(), to.cast_signed());
        let (first, last) = (to - moves.end(), to - moves.start());
        if self.closed {
            return self.around(first, last);
        }
        // At an end stops what would go farther.
        let most = self.places.cast_signed() - 1;
        between(
            if to == 0 { 0 } else { first.max(0) },
            if to == most { most } else { last.min(most) },
        )
    }

    /// The places of a closed route from one number to another.
    fn around(&self, first: isize, last: isize) -> Places {
        let n = self.places;
        let start = first.rem_euclid(n.cast_signed()).cast_unsigned();
        let end = start + last.abs_diff(first) + 1;
        (0..end.saturating_sub(n)).chain(start..end.min(n))
    }

    /// What a gear whose weights are `window` gives to the way between two
    /// places, in all moves that lead it.
    pub(super) fn way(&self, gear: usize, window: &[f64], from: usize, to: usize) -> f64 {
        let at = to.cast_signed() - from.cast_signed() - self.gears[gear].first();
        if self.closed {
            let at = at.rem_euclid(self.places.cast_signed()).cast_unsigned();
            return window.get(at).copied().unwrap_or(0.0);
        }
        let cut = |at: isize| at.max(0).cast_unsigned().min(window.len());
        let start = if to == 0 { 0 } else { cut(at) };
        let end = if to + 1 == self.places { window.len() } else { cut(at + 1) };
        window[start..end].iter().sum()
    }

    /// The ends of an open route, where several moves may lead; none of a closed
    /// one.
    pub(super) fn ends(&self) -> impl Iterator<Item = usize> + Clone {
        let last = self.places - 1;
        let first = (!self.closed).then_some(0).into_iter();
        first.chain((!self.closed && last > 0).then_some(last))
    }

    /// Whether a move leads from each place to itself; if not, it does so from
    /// none, but at the ends.
    pub(super) fn stands(&self, m: isize) -> bool {
        m == 0 || (self.closed && m % self.places.cast_signed() == 0)
    }

    /// The places from which a move leads between the ends, and the first to
    /// which it leads, in two pieces: of a closed route, the second is what it
    /// leads around.
    pub(super) fn pieces(&self, m: isize) -> [(Range<usize>, usize); 2] {
        let n = self.places.cast_signed();
        if self.closed {
            let m = m.rem_euclid(n).cast_unsigned();
            let turn = self.places - m;
            return [(0..turn, m), (turn..self.places, 0)];
        }
        let (start, end) = ((1 - m).max(0), (n - 1 - m).min(n));
        if start >= end {
            return [(0..0, 0), (0..0, 0)];
        }
        let from = start.cast_unsigned()..end.cast_unsigned();
        [(from, (start + m).cast_unsigned()), (0..0, 0)]
    }
}

/// The places of an open route from one to another, of which only the second
/// may be below 0.
fn between(first: isize, last: isize) -> Places {
    (first.cast_unsigned()..(last.max(-1) + 1).cast_unsigned()).chain(0..0)
}
