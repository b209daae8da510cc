//! [`WindowTransition`], a banded operator along a route: the same moves from every place.
//!
//! Places whose whole window stays on the route share one list of entries, so that a product is w
//! contiguous loops. The few places near an end have columns of their own.

use std::ops::Range;

use super::{Transition, TransitionEntries, check_count, check_slices, check_sum, log};
use crate::error::TransitionError;
use wayfix_kernels::log2;

/// A banded matrix that stores only its window: the places of a route in order, with one
/// distribution of the number of places moved in a step.
///
/// On a [closed](Self::closed) route, a loop, the first place follows the last; on an
/// [open](Self::open) one, moves beyond an end stop there.
///
/// Products cost O(n w) for w weights, in contiguous loops. Memory is O(w), plus O(w) for each of
/// the e places whose window reaches beyond an end. Listing the entries *into* a state
/// costs O(w + e log w).
///
/// ```
/// use wayfix::transition::WindowTransition;
/// use wayfix::Transition;
///
/// // One place back, a stay, or one place ahead; the route ends after four places.
/// let a = WindowTransition::open(4, -1, &[0.125, 0.25, 0.625])?;
/// let mut out = [0.0; 4];
/// a.apply(&(), &[0.0, 0.0, 0.0, 1.0], &mut out);
/// assert_eq!(out, [0.0, 0.0, 0.125, 0.875]);
/// # Ok::<(), wayfix::TransitionError>(())
/// ```
#[derive(Debug, Clone)]
pub struct WindowTransition {
    states: usize,
    /// True if the first place follows the last.
    #[cfg(feature = "serde")]
    pub(crate) closed: bool,
    /// Offset of the window: a place j in `interior` leads to j + `first` + `to` for each entry.
    pub(crate) first: isize,
    pub(crate) window: Vec<Entry>,
    /// Places whose whole window stays on the route.
    interior: Range<usize>,
    /// Columns of the places before and after `interior`.
    start_columns: Vec<Vec<Entry>>,
    end_columns: Vec<Vec<Entry>>,
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct Entry {
    pub(crate) to: usize,
    pub(crate) value: f64,
    log2: f64,
}

/// Number of places handled at a time: 16 KB of x and as much of sums, which stay in the cache
/// while the loop over the window passes over them again and again.
const BLOCK: usize = 2048;

impl WindowTransition {
    /// Creates an operator on an open route that moves from place j to j + `first` + d with
    /// probability `weights[d]`; moves beyond an end stop there. O(w log w) for each place near an
    /// end.
    ///
    /// # Errors
    ///
    /// [`TransitionError`] for no states or more than 2^32 − 1 of them, for a
    /// weight that is NaN, negative or infinite, and for weights that do not sum to
    /// one within 1e-9.
    pub fn open(states: usize, first: isize, weights: &[f64]) -> Result<Self, TransitionError> {
        Self::new(states, first, weights, false)
    }

    /// Creates an operator on a closed route, a loop, whose first place follows the last, as
    /// [`open`](Self::open) does. Moves to the same place add up, so the window may be longer than
    /// the route.
    ///
    /// # Errors
    ///
    /// As [`open`](Self::open).
    pub fn closed(states: usize, first: isize, weights: &[f64]) -> Result<Self, TransitionError> {
        Self::new(states, first, weights, true)
    }

    fn new(
        states: usize,
        first: isize,
        weights: &[f64],
        closed: bool,
    ) -> Result<Self, TransitionError> {
        if states == 0 {
            return Err(TransitionError::Empty);
        }
        check_count("states", states)?;
        check_sum(weights, "the sum of the weights".into(), |d| {
            format!("the weight of offset {}", first.saturating_add_unsigned(d))
        })?;
        let n = states.cast_signed();
        // The window starts at its first weight above 0.
        let leading = weights.iter().take_while(|w| **w == 0.0).count();
        // On a loop, an offset counts modulo n. The representative nearest to 0 leaves the fewest
        // places near an end.
        let around = (first.rem_euclid(n) + (leading % states).cast_signed()) % n;
        let first = match closed {
            true if around > n / 2 => around - n,
            true => around,
            false => first.saturating_add_unsigned(leading),
        };
        let moves = weights[leading..].iter().enumerate().filter(|(_, w)| **w > 0.0);
        let window: Vec<_> = moves.map(|(to, &value)| Entry::new(to, value)).collect();
        // Place j stays on the route with its whole window if j + first ≥ 0 and j + last < n.
        // Without such a place, all columns are in `start_columns`.
        let last = window.last().map_or(first, |entry| first.saturating_add_unsigned(entry.to));
        let start = first.min(0).unsigned_abs();
        let end = states.saturating_sub(last.max(0).unsigned_abs());
        let interior = if start < end { start..end } else { states..states };
        let column = |from: usize| {
            let to = |entry: &Entry| {
                from.cast_signed().saturating_add(first).saturating_add_unsigned(entry.to)
            };
            let reached = window.iter().map(|entry| {
                let to = to(entry);
                let to = if closed { to.rem_euclid(n) } else { to.clamp(0, n - 1) };
                (to.cast_unsigned(), entry.value)
            });
            let mut column: Vec<_> = reached.collect();
            // Moves around the loop, or stopped at an end, may share a target: those are added.
            column.sort_by_key(|entry| entry.0);
            column.dedup_by(|next, kept| {
                let same = next.0 == kept.0;
                kept.1 += if same { next.1 } else { 0.0 };
                same
            });
            column.into_iter().map(|(to, value)| Entry::new(to, value)).collect::<Vec<_>>()
        };
        let start_columns = (0..interior.start).map(column).collect();
        let end_columns = (interior.end..states).map(column).collect();
        Ok(Self {
            states,
            #[cfg(feature = "serde")]
            closed,
            first,
            window,
            interior,
            start_columns,
            end_columns,
        })
    }

    /// Places near the start, with their columns.
    fn start_columns(&self) -> impl Iterator<Item = (usize, &Vec<Entry>)> + Clone {
        (0..).zip(&self.start_columns)
    }

    fn end_columns(&self) -> impl Iterator<Item = (usize, &Vec<Entry>)> + Clone {
        (self.interior.end..).zip(&self.end_columns)
    }

    /// Blocks of the places whose whole window stays on the route.
    fn blocks(&self) -> impl Iterator<Item = Range<usize>> {
        let starts = self.interior.clone().step_by(BLOCK);
        starts.map(|start| start..self.interior.end.min(start + BLOCK))
    }

    /// The places that an entry of the window leads to from a block.
    fn target(&self, block: &Range<usize>, entry: &Entry) -> Range<usize> {
        // Does not wrap: places of a block lie in `interior`, where j + first ≥ 0.
        let start = block.start.wrapping_add_signed(self.first) + entry.to;
        start..start + block.len()
    }

    fn column(&self, from: usize) -> impl Iterator<Item = (usize, f64)> + Clone {
        assert!(from < self.states, "there is no state {from}");
        let (base, entries) = if self.interior.contains(&from) {
            (from.wrapping_add_signed(self.first), &self.window)
        } else {
            let after = from.checked_sub(self.interior.end).map(|at| &self.end_columns[at]);
            (0, after.unwrap_or_else(|| &self.start_columns[from]))
        };
        entries.iter().map(move |entry| (base + entry.to, entry.value))
    }
}

impl Entry {
    fn new(to: usize, value: f64) -> Self {
        Self { to, value, log2: log2(value) }
    }
}

/// Adds two entries at once, so that sums are read and written half as often. `out` begins with the
/// targets of the first entry, and ends with those of the second.
fn add_two(out: &mut [f64], x: &[f64], first: &Entry, second: &Entry) {
    // The targets of the second are those of the first, shifted. Up to the shift only the first
    // entry contributes, then both, then only the second. If the two do not overlap, the middle
    // loop is empty, and what lies between them stays.
    let shift = (second.to - first.to).min(x.len());
    let (start, rest) = out.split_at_mut(shift);
    start.iter_mut().zip(x).for_each(|(out, x)| *out += first.value * x);
    let both = rest.iter_mut().zip(x[shift..].iter().zip(x));
    // Added in the same order as entry by entry, so that sums are the same to the bit.
    both.for_each(|(out, (a, b))| *out = (*out + first.value * a) + second.value * b);
    let end = out.len() - shift;
    let alone = &x[x.len() - shift..];
    out[end..].iter_mut().zip(alone).for_each(|(out, x)| *out += second.value * x);
}

impl Transition for WindowTransition {
    type Control = ();

    fn states(&self) -> usize {
        self.states
    }

    fn apply(&self, (): &(), x: &[f64], out: &mut [f64]) {
        check_slices(self.states, x, out);
        out.fill(0.0);
        // Columns are added into `out`, which starts at 0: a place may be reached both from
        // `interior` and from places near an end.
        for block in self.blocks() {
            let x = &x[block.clone()];
            let (pairs, last) = self.window.as_chunks::<2>();
            for [first, second] in pairs {
                let start = self.target(&block, first).start;
                let end = self.target(&block, second).end;
                add_two(&mut out[start..end], x, first, second);
            }
            for entry in last {
                let out = &mut out[self.target(&block, entry)];
                out.iter_mut().zip(x).for_each(|(out, x)| *out += entry.value * x);
            }
        }
        for (from, column) in self.start_columns().chain(self.end_columns()) {
            column.iter().for_each(|entry| out[entry.to] += entry.value * x[from]);
        }
    }

    fn apply_transpose(&self, (): &(), x: &[f64], out: &mut [f64]) {
        check_slices(self.states, x, out);
        for block in self.blocks() {
            let out = &mut out[block.clone()];
            out.fill(0.0);
            for entry in &self.window {
                let x = &x[self.target(&block, entry)];
                out.iter_mut().zip(x).for_each(|(out, x)| *out += entry.value * x);
            }
        }
        for (from, column) in self.start_columns().chain(self.end_columns()) {
            out[from] = column.iter().map(|entry| entry.value * x[entry.to]).sum();
        }
    }

    fn apply_log(&self, (): &(), x: &[f64], out: &mut [f64]) {
        check_slices(self.states, x, out);
        out.fill(f64::NEG_INFINITY);
        for (from, &x) in x.iter().enumerate() {
            self.column(from).for_each(|(to, value)| out[to] = log::add(out[to], value.ln() + x));
        }
    }

    fn apply_transpose_log(&self, (): &(), x: &[f64], out: &mut [f64]) {
        check_slices(self.states, x, out);
        for (from, out) in out.iter_mut().enumerate() {
            *out = log::sum(self.column(from), x);
        }
    }
}

impl TransitionEntries for WindowTransition {
    fn incoming(&self, (): &(), to: usize) -> impl Iterator<Item = (usize, f64)> {
        assert!(to < self.states, "there is no state {to}");
        let find = move |(from, column): (usize, &Vec<Entry>)| {
            let at = column.binary_search_by_key(&to, |entry| entry.to).ok()?;
            Some((from, column[at].value))
        };
        // The farther the move, the lower its source: reversed, sources ascend, and all lie between
        // those of `start_columns` and `end_columns`. A source below 0 or beyond `interior` is
        // skipped.
        let interior = self.window.iter().rev().filter_map(move |entry| {
            let from = to.checked_add_signed(self.first.checked_neg()?)?.checked_sub(entry.to)?;
            self.interior.contains(&from).then_some((from, entry.value))
        });
        self.start_columns()
            .filter_map(find)
            .chain(interior)
            .chain(self.end_columns().filter_map(find))
    }

    fn outgoing(&self, (): &(), from: usize) -> impl Iterator<Item = (usize, f64)> {
        self.column(from)
    }

    fn max_product(&self, (): &(), x: &[f64], out: &mut [f64], from: &mut [u32]) {
        check_slices(self.states, x, out);
        out.fill(f64::NEG_INFINITY);
        from.fill(0);
        // Each state is offered its predecessors in ascending order (places before `interior`,
        // blocks in order, far moves before near ones, places after), so the lowest wins ties.
        let offer = |out: &mut f64, from: &mut u32, value: f64, place: usize| {
            let better = value > *out;
            *out = if better { value } else { *out };
            *from = if better { place as u32 } else { *from };
        };
        let offer_column =
            |(place, column): (usize, &Vec<Entry>), out: &mut [f64], from: &mut [u32]| {
                for entry in column {
                    offer(&mut out[entry.to], &mut from[entry.to], entry.log2 + x[place], place);
                }
            };
        self.start_columns().for_each(|column| offer_column(column, out, from));
        for block in self.blocks() {
            for entry in self.window.iter().rev() {
                let target = self.target(&block, entry);
                let best = out[target.clone()].iter_mut().zip(&mut from[target]);
                for ((out, from), place) in best.zip(block.clone()) {
                    offer(out, from, entry.log2 + x[place], place);
                }
            }
        }
        self.end_columns().for_each(|column| offer_column(column, out, from));
    }
}

#[cfg(feature = "serde")]
crate::stored! {
    [] WindowTransition: [], |a| {
        states: usize = a.states(),
        first: isize = a.first,
        weights: Vec<f64> = {
            let mut weights = vec![0.0; a.window.last().map_or(0, |last| last.to + 1)];
            a.window.iter().for_each(|entry| weights[entry.to] = entry.value);
            weights
        },
        closed: bool = a.closed,
    } => Self::new(states, first, &weights, closed);
}
