//! [`KroneckerTransition`]: two independent chains side by side, A₁ ⊗ A₂.
//!
//! (A₁ ⊗ A₂) x is A₁ X A₂', with x written as a matrix X of n₁ rows and n₂ columns: a product with
//! A₂ for each row, then one with A₁ for each column. The same two passes serve the transpose,
//! logarithms and the max-product, since the parts are independent in all of them.

use super::log::LARGEST_LINEAR_ENTRY;
use super::{Transition, TransitionEntries, buffers, check_count, check_slices};
use crate::error::TransitionError;
use crate::groups::Groups;

/// The operator of pairs of states that move independently, A₁ ⊗ A₂, without its matrix: place ×
/// weather, place × fault of the camera, or two vehicles.
///
/// Moves of the parts are independent; only observations couple them. If the heading determines the
/// way out of a place, pairs of place and heading need an operator of their own, such as a
/// [`SparseTransition`](crate::SparseTransition).
///
/// The pair (i₁, i₂) is state i₁ n₂ + i₂, and A\[(i₁, i₂), (j₁, j₂)\] =
/// A₁\[i₁, j₁\] A₂\[i₂, j₂\]. Both factors have the same control. Nested operators
/// make triples.
///
/// A product takes one with A₂ for each i₁ and one with A₁ for each i₂: O(n (e₁ + e₂)) for e
/// entries a state, where the matrix has n e₁ e₂ entries. The same holds for a step of Viterbi.
///
/// ```
/// use wayfix::transition::{KroneckerTransition, WindowTransition};
/// use wayfix::{SparseTransition, Transition};
///
/// let place = WindowTransition::closed(4, 1, &[1.0])?; // one on
/// let lane = SparseTransition::from_rows(&[[0.75, 0.25], [0.25, 0.75]])?;
/// let a = KroneckerTransition::new(place, lane)?;
/// let mut out = [0.0; 8];
/// a.apply(&(), &[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], &mut out);
/// assert_eq!(out, [0.0, 0.0, 0.75, 0.25, 0.0, 0.0, 0.0, 0.0]);
/// assert_eq!(a.index(1, 0), Some(2));
/// # Ok::<(), wayfix::TransitionError>(())
/// ```
#[derive(Debug, Clone, Copy)]
pub struct KroneckerTransition<A1, A2> {
    pub(crate) first: A1,
    pub(crate) second: A2,
}

impl<A1: Transition, A2: Transition<Control = A1::Control>> KroneckerTransition<A1, A2> {
    /// Creates the operator of pairs of states of two operators.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Empty`] without pairs, or [`TransitionError::TooMany`] if there are more
    /// than 2^32 − 1.
    pub fn new(first: A1, second: A2) -> Result<Self, TransitionError> {
        let count = first.states().saturating_mul(second.states());
        if count == 0 {
            return Err(TransitionError::Empty);
        }
        check_count("states", count)?;
        Ok(Self { first, second })
    }

    /// The operator of the first part.
    #[must_use]
    pub fn first(&self) -> &A1 {
        &self.first
    }

    /// The operator of the second part.
    #[must_use]
    pub fn second(&self) -> &A2 {
        &self.second
    }

    /// The state of a pair, or `None` if the pair does not exist.
    pub fn index(&self, first: usize, second: usize) -> Option<usize> {
        let (n1, n2) = (self.first.states(), self.second.states());
        (first < n1 && second < n2).then(|| first * n2 + second)
    }

    /// The pair of a state, or `None` if the state does not exist.
    pub fn parts(&self, state: usize) -> Option<(usize, usize)> {
        (state < self.states()).then(|| self.split(state))
    }

    /// The states grouped by their first part: for the probabilities of places, say, or a sensor
    /// that sees only places.
    pub fn first_groups(&self) -> Groups {
        let first = (0..self.states()).map(|state| self.split(state).0);
        Groups::numbered(first.collect(), self.first.states())
    }

    /// The states grouped by their second part.
    pub fn second_groups(&self) -> Groups {
        let second = (0..self.states()).map(|state| self.split(state).1);
        Groups::numbered(second.collect(), self.second.states())
    }

    fn split(&self, state: usize) -> (usize, usize) {
        let n2 = self.second.states();
        (state / n2, state % n2)
    }

    /// Product with A₂ for each row of pairs, then with A₁ for each column.
    fn product(
        &self,
        x: &[f64],
        out: &mut [f64],
        second: impl Fn(&[f64], &mut [f64]),
        first: impl Fn(&[f64], &mut [f64]),
    ) {
        check_slices(self.states(), x, out);
        let (n1, n2) = (self.first.states(), self.second.states());
        x.chunks_exact(n2).zip(out.chunks_exact_mut(n2)).for_each(|(x, out)| second(x, out));
        // Columns are strided: each is copied out, multiplied, and copied back in place.
        buffers::with_two(n1, |column, result| {
            for i2 in 0..n2 {
                gather(&out[i2..], n2, column);
                first(column, result);
                scatter(result, &mut out[i2..], n2);
            }
        });
    }
}

/// Copies every n₂-th value out of `x`.
fn gather<T: Copy>(x: &[T], n2: usize, out: &mut [T]) {
    out.iter_mut().zip(x.iter().step_by(n2)).for_each(|(out, x)| *out = *x);
}

fn scatter<T: Copy>(x: &[T], out: &mut [T], n2: usize) {
    out.iter_mut().step_by(n2).zip(x).for_each(|(out, x)| *out = *x);
}

impl<A1: Transition, A2: Transition<Control = A1::Control>> Transition
    for KroneckerTransition<A1, A2>
{
    type Control = A1::Control;

    fn states(&self) -> usize {
        self.first.states() * self.second.states()
    }

    fn has_restarts(&self) -> bool {
        self.first.has_restarts() || self.second.has_restarts()
    }

    fn apply(&self, control: &A1::Control, x: &[f64], out: &mut [f64]) {
        let second = |x: &[f64], out: &mut [f64]| self.second.apply(control, x, out);
        self.product(x, out, second, |x, out| self.first.apply(control, x, out));
    }

    fn apply_transpose(&self, control: &A1::Control, x: &[f64], out: &mut [f64]) {
        let second = |x: &[f64], out: &mut [f64]| self.second.apply_transpose(control, x, out);
        self.product(x, out, second, |x, out| self.first.apply_transpose(control, x, out));
    }

    fn apply_log(&self, control: &A1::Control, x: &[f64], out: &mut [f64]) {
        let second = |x: &[f64], out: &mut [f64]| self.second.apply_log(control, x, out);
        self.product(x, out, second, |x, out| self.first.apply_log(control, x, out));
    }

    fn apply_transpose_log(&self, control: &A1::Control, x: &[f64], out: &mut [f64]) {
        let second = |x: &[f64], out: &mut [f64]| self.second.apply_transpose_log(control, x, out);
        self.product(x, out, second, |x, out| self.first.apply_transpose_log(control, x, out));
    }

    fn evidence(&self, control: &A1::Control) -> Option<f64> {
        // Factors multiply, so their logarithms add. A part without evidence has factor 1.
        match (self.first.evidence(control), self.second.evidence(control)) {
            (None, None) => None,
            (first, second) => Some(first.unwrap_or(0.0) + second.unwrap_or(0.0)),
        }
    }

    fn needs_logs(&self, control: &A1::Control) -> bool {
        self.first.needs_logs(control) || self.second.needs_logs(control)
    }

    fn check_control(&self, control: &A1::Control) -> Result<(), TransitionError> {
        self.first.check_control(control)?;
        self.second.check_control(control)
    }
}

impl<A1: TransitionEntries, A2: TransitionEntries<Control = A1::Control>> TransitionEntries
    for KroneckerTransition<A1, A2>
{
    fn incoming(&self, control: &A1::Control, to: usize) -> impl Iterator<Item = (usize, f64)> {
        let ((i1, i2), n2) = (self.split(to), self.second.states());
        // Ascending, since j₁ n₂ + j₂ is ordered by j₁ first.
        let pairs = self.first.incoming(control, i1).flat_map(move |(j1, p1)| {
            let second = self.second.incoming(control, i2);
            second.map(move |(j2, p2)| (j1 * n2 + j2, p1 * p2))
        });
        pairs.filter(|entry| entry.1 > 0.0) // a product may underflow
    }

    fn outgoing(&self, control: &A1::Control, from: usize) -> impl Iterator<Item = (usize, f64)> {
        let ((j1, j2), n2) = (self.split(from), self.second.states());
        let pairs = self.first.outgoing(control, j1).flat_map(move |(i1, p1)| {
            let second = self.second.outgoing(control, j2);
            second.map(move |(i2, p2)| (i1 * n2 + i2, p1 * p2))
        });
        pairs.filter(|entry| entry.1 > 0.0)
    }

    fn incoming_log2(
        &self,
        control: &A1::Control,
        to: usize,
    ) -> impl Iterator<Item = (usize, f64)> {
        let ((i1, i2), n2) = (self.split(to), self.second.states());
        self.first.incoming_log2(control, i1).flat_map(move |(j1, log1)| {
            let second = self.second.incoming_log2(control, i2);
            second.map(move |(j2, log2)| (j1 * n2 + j2, log1 + log2))
        })
    }

    fn outgoing_log2(
        &self,
        control: &A1::Control,
        from: usize,
    ) -> impl Iterator<Item = (usize, f64)> {
        let ((j1, j2), n2) = (self.split(from), self.second.states());
        self.first.outgoing_log2(control, j1).flat_map(move |(i1, log1)| {
            let second = self.second.outgoing_log2(control, j2);
            second.map(move |(i2, log2)| (i1 * n2 + i2, log1 + log2))
        })
    }

    fn entries_need_logs(&self, control: &A1::Control) -> bool {
        let parts_do =
            self.first.entries_need_logs(control) || self.second.entries_need_logs(control);
        parts_do || {
            // Every entry of one part is multiplied by every entry of the other, so the extremes of
            // the products are the products of the extremes.
            let ((least1, most1), (least2, most2)) =
                (extremes(&self.first, control), extremes(&self.second, control));
            least1 * least2 < f64::MIN_POSITIVE || most1 * most2 > LARGEST_LINEAR_ENTRY
        }
    }

    fn max_product(&self, control: &A1::Control, x: &[f64], out: &mut [f64], from: &mut [u32]) {
        check_slices(self.states(), x, out);
        let (n1, n2) = (self.first.states(), self.second.states());
        // max over (j₁, j₂) of a₁ + a₂ + x is max over j₁ of (a₁ + max over j₂ of (a₂ + x)). Scores
        // are on a grid, so sums in any order are exact.
        let rows = out.chunks_exact_mut(n2).zip(from.chunks_exact_mut(n2));
        for (x, (out, from)) in x.chunks_exact(n2).zip(rows) {
            self.second.max_product(control, x, out, from);
        }
        buffers::with_two(n1, |column, result| {
            buffers::with_two(n1, |second, first| {
                for i2 in 0..n2 {
                    gather(&out[i2..], n2, column);
                    gather(&from[i2..], n2, second);
                    self.first.max_product(control, column, result, first);
                    scatter(result, &mut out[i2..], n2);
                    // The lowest j₁ of a tie, and the lowest j₂ for it: the lowest pair. An
                    // unreachable state has no predecessor.
                    for (best, j1) in result.iter().zip(&mut *first) {
                        let j = *j1 as usize;
                        *j1 =
                            if *best > f64::NEG_INFINITY { *j1 * n2 as u32 + second[j] } else { 0 };
                    }
                    scatter(first, &mut from[i2..], n2);
                }
            });
        });
    }
}

/// The least and the largest entry above 0, or 1 and 0 if there are none. O(entries).
pub(super) fn extremes<A: TransitionEntries>(a: &A, control: &A::Control) -> (f64, f64) {
    let entries = (0..a.states()).flat_map(|from| a.outgoing(control, from));
    entries.fold((1.0, 0.0), |(least, most), (_, p)| (p.min(least), p.max(most)))
}

#[cfg(feature = "serde")]
crate::stored! {
    [A1: Transition, A2: Transition<Control = A1::Control>]
    KroneckerTransition<A1, A2>: [A1, A2], |a| {
        first: A1 = a.first,
        second: A2 = a.second,
    } => Self::new(first, second);
}
