//! Places along a route, and loops along them. On an open route, moves beyond an end stop there;
//! around a loop, several moves of a long window may join the same two places, and their weights
//! add up. Moves of one size shift a vector, so that sums over moves are linear combinations of
//! shifted vectors, four of them in a pass; a stencil lists the shifts.

use std::iter::Chain;
use std::ops::Range;

use wayfix::internal::buffers;
use wayfix_kernels::{self as kernels, Eight, LANES, Simd, WithSimd, run};

/// Number of shifted vectors added in one pass.
pub(super) const TERMS: usize = 4;

/// Places in up to two ranges, ascending: a window on a closed route may wrap around.
pub(super) type Places = Chain<Range<usize>, Range<usize>>;

/// The shape of a route.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RouteShape {
    pub(super) places: usize,
    pub(super) closed: bool,
}

impl RouteShape {
    /// Places reached by a range of moves; on an open route, moves beyond an end stop there.
    pub(super) fn targets(self, moves: (isize, isize), from: usize) -> Places {
        let from = from.cast_signed();
        let (first, last) = (from + moves.0, from + moves.1);
        if self.closed {
            return self.around(first, last);
        }
        let most = self.places.cast_signed() - 1;
        between(first.clamp(0, most), last.clamp(0, most))
    }

    /// Places that reach a given one by a range of moves.
    pub(super) fn sources(self, moves: (isize, isize), to: usize) -> Places {
        let to = to.cast_signed();
        let (first, last) = (to - moves.1, to - moves.0);
        if self.closed {
            return self.around(first, last);
        }
        let most = self.places.cast_signed() - 1;
        // The inverse of the clamp in `targets`: an end is reached from every place whose move
        // would lead to it or beyond it, so its range of sources is open on that side.
        between(
            if to == 0 { 0 } else { first.max(0) },
            if to == most { most } else { last.min(most) },
        )
    }

    /// Places within a distance of a given one.
    pub(super) fn near(self, place: usize, within: usize) -> Places {
        let (place, within) = (place.cast_signed(), within.min(self.places).cast_signed());
        if self.closed {
            return self.around(place - within, place + within);
        }
        between((place - within).max(0), (place + within).min(self.places.cast_signed() - 1))
    }

    /// Number of places within a distance of a given one.
    pub(super) fn count_near(self, place: usize, within: usize) -> usize {
        // The size hint of two chained ranges is exact.
        let (a, b) = {
            let places = self.near(place, within);
            places.size_hint()
        };
        b.unwrap_or(a)
    }

    /// Places of a closed route from one index to another, modulo its length; each place once, also
    /// if the range is longer than the loop.
    fn around(self, first: isize, last: isize) -> Places {
        let n = self.places;
        let start = first.rem_euclid(n.cast_signed()).cast_unsigned();
        let count = (last.abs_diff(first) + 1).min(n);
        let end = start + count;
        // The part that wrapped around comes first, so that places ascend. Both parts together are
        // `count` ≤ n places.
        (0..end.saturating_sub(n)).chain(start..end.min(n))
    }

    /// The ends of an open route, which several moves may reach; none on a closed route.
    pub(super) fn ends(self) -> impl Iterator<Item = usize> + Clone {
        let last = self.places - 1;
        let first = (!self.closed).then_some(0).into_iter();
        first.chain((!self.closed && last > 0).then_some(last))
    }

    /// The place that a move leads to, or `None` beyond an end.
    pub(super) fn moved(self, from: usize, m: isize) -> Option<usize> {
        let to = from.cast_signed() + m;
        if self.closed {
            return Some(to.rem_euclid(self.places.cast_signed()).cast_unsigned());
        }
        usize::try_from(to).ok().filter(|to| *to < self.places)
    }

    /// Runs of places in a range that may extend beyond the ends of the route, each with its offset
    /// in the range. Around a loop, positions beyond an end are those from the other end.
    pub(super) fn spans(
        self,
        first: isize,
        count: usize,
    ) -> impl Iterator<Item = (Range<usize>, usize)> {
        let n = self.places;
        // On an open route, positions before the first place are skipped.
        let mut at = if self.closed { 0 } else { (-first).max(0).cast_unsigned() };
        std::iter::from_fn(move || {
            let place = first + at.cast_signed();
            let start = if self.closed { place.rem_euclid(n.cast_signed()) } else { place };
            let start = start.cast_unsigned();
            if at >= count || start >= n {
                return None;
            }
            let (before, end) = (at, n.min(start + count - at));
            at += end - start;
            Some((start..end, before))
        })
    }

    /// `out[j] = Σ` of x over the places within a distance of j. Sums over 1, 2, 4, … places are
    /// doubled and those at the binary digits of the width added: O(n log within), without
    /// subtractions, so nothing cancels.
    pub(super) fn sum_near(self, x: &[f64], within: usize, out: &mut [f64]) {
        let n = self.places;
        out.fill(0.0);
        let within = within.min(n);
        let width = 2 * within + 1;
        if self.closed && width >= n {
            return out.fill(kernels::sum(x));
        }
        // Padded with the other end of a loop, or with zeros beyond the ends.
        buffers::with_two(n + width - 1, |sums, next| {
            sums.fill(0.0);
            sums[within..within + n].copy_from_slice(x);
            if self.closed {
                sums[..within].copy_from_slice(&x[n - within..]);
                sums[within + n..].copy_from_slice(&x[..within]);
            }
            let (mut sums, mut next) = (sums, next);
            let (mut done, mut size) = (0, 1);
            // Invariant: sums[p] is the sum of `size` padded values from p on, and out[j] the sum
            // of the first `done` values in the window of j. What is left of the width are its
            // binary digits from `size` up.
            while done < width {
                if width & size != 0 {
                    add_linear_combination(out, &[(1.0, &sums[done..done + n])]);
                    done += size;
                }
                if done < width {
                    let count = sums.len() - size;
                    // Two neighbouring sums make one of twice the size. Near the end, sums that
                    // would reach beyond the padding are cut; no window reads them, since
                    // done + size ≤ width.
                    set_linear_combination(
                        &mut next[..count],
                        &[(1.0, &sums[..count]), (1.0, &sums[size..])],
                    );
                    next[count..].fill(0.0);
                    std::mem::swap(&mut sums, &mut next);
                    size *= 2;
                }
            }
        });
    }
}

/// Places of an open route from `first` to `last`, which is −1 or less for none.
fn between(first: isize, last: isize) -> Places {
    // `first` is at least 0 for all callers. With a `last` below it the range is empty.
    (first.cast_unsigned()..(last.max(-1) + 1).cast_unsigned()).chain(0..0)
}

/// Terms of the sums at runs of places, without the ends of an open route: several moves stop
/// there.
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
    /// Builds the stencil of `count` moves, starting with `first`.
    pub(super) fn new(shape: RouteShape, first: isize, count: usize, direction: Direction) -> Self {
        let mut runs: Vec<Run> = Vec::new();
        // Farther from both ends than the longest move, and one more for a move to an end, all
        // places have the same taps: one stands for them.
        let last = first + count.cast_signed();
        let reach = first.unsigned_abs().max(last.unsigned_abs()) + 1;
        let near = reach.min(shape.places);
        let far = shape.places.saturating_sub(reach).max(near);
        let alike = (near < far).then_some(near..far);
        let single = |place| place..place + 1;
        let ends = (0..near).map(single).chain(alike);
        for places in ends.chain((far..shape.places).map(single)) {
            let place = places.start;
            let mut taps = Vec::new();
            for (weight, m) in (0..count).zip(first..) {
                let shift = if direction == Direction::Into { -m } else { m };
                let Some(other) = shape.moved(place, shift) else { continue };
                let to = if direction == Direction::Into { place } else { other };
                if shape.ends().any(|end| end == to) {
                    continue;
                }
                taps.push(Tap { offset: shift, weight, stays: other == place });
            }
            match runs.last_mut() {
                Some(run) if run.taps == taps => run.places.end = places.end,
                _ => runs.push(Run { places, taps }),
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
        // Runs are ascending and cover the route without gaps: the first one that ends after the
        // start of the places is the first that meets them.
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

/// Sets `out` to the sum of factors times vectors of its length.
pub(super) fn set_linear_combination(out: &mut [f64], terms: &[(f64, &[f64])]) {
    run(LinearCombination { out, terms, accumulate: false });
}

/// Adds factors times vectors of its length to `out`.
pub(super) fn add_linear_combination(out: &mut [f64], terms: &[(f64, &[f64])]) {
    run(LinearCombination { out, terms, accumulate: true });
}

struct LinearCombination<'a> {
    out: &'a mut [f64],
    terms: &'a [(f64, &'a [f64])],
    /// True to add to what is in `out`.
    accumulate: bool,
}

impl WithSimd for LinearCombination<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Self { out, terms, mut accumulate } = self;
        let (fours, rest) = terms.as_chunks::<TERMS>();
        for terms in fours {
            // Only the first four may overwrite `out`.
            add(s, out, terms, accumulate);
            accumulate = true;
        }
        match *rest {
            [a, b, c] => add(s, out, &[a, b, c], accumulate),
            [a, b] => add(s, out, &[a, b], accumulate),
            [a] => add(s, out, &[a], accumulate),
            _ if accumulate => {}
            _ => out.fill(0.0),
        }
    }
}

#[inline(always)]
fn add<S: Simd, const C: usize>(
    s: S,
    out: &mut [f64],
    terms: &[(f64, &[f64]); C],
    accumulate: bool,
) {
    let count = out.len();
    let factors: [S::V; C] = std::array::from_fn(|c| s.splat(terms[c].0));
    let (outs, out_rest) = out.as_chunks_mut::<LANES>();
    // Cutting every vector to `outs.len()` lets the compiler drop the bounds checks of the loop.
    let whole: [&[Eight]; C] =
        std::array::from_fn(|c| &terms[c].1[..count].as_chunks::<LANES>().0[..outs.len()]);
    for (number, out) in outs.iter_mut().enumerate() {
        let mut sum = if accumulate { s.load(out) } else { s.splat(0.0) };
        for c in 0..C {
            sum = s.add(sum, s.mul(s.load(&whole[c][number]), factors[c]));
        }
        s.store(sum, out);
    }
    // The same operations in the same order as in the lanes, so that a place's value does not
    // depend on where its block ends.
    for (at, out) in (count - out_rest.len()..).zip(out_rest) {
        *out = if accumulate { *out } else { 0.0 };
        for (factor, x) in terms {
            *out += factor * x[at];
        }
    }
}
