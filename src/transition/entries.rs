//! [`TransitionEntries`]: single entries of a transition operator, for decoding, drawing and
//! learning, and the max-product of Viterbi.

use super::Transition;
use wayfix_kernels::log2;

/// A transition operator whose entries can be listed.
///
/// Only entries above 0 are listed, each state at most once, in ascending order, so that ties in
/// decoding go to the lowest state. Entries must agree with the products: if they do not, results
/// are wrong, or an error where pairs do not sum to one; listing a state that does not exist causes
/// a panic. Inference asks only for states below [`states`](Transition::states); for others the
/// operators of this crate panic. A test by [`kit::check`](crate::transition::kit::check) shows that
/// they agree.
///
/// # Implement it yourself
///
/// ```
/// use wayfix::{Transition, TransitionEntries};
/// # struct Around(usize);
/// # impl Transition for Around {
/// #     type Control = ();
/// #     fn states(&self) -> usize { self.0 }
/// #     fn apply(&self, _: &(), x: &[f64], out: &mut [f64]) {}
/// #     fn apply_transpose(&self, _: &(), x: &[f64], out: &mut [f64]) {}
/// # }
///
/// // The loop of the example at `Transition`.
/// impl TransitionEntries for Around {
///     fn incoming(&self, _: &(), to: usize) -> impl Iterator<Item = (usize, f64)> {
///         let mut from = [((to + self.0 - 1) % self.0, 0.9), (to, 0.1)];
///         from.sort_by_key(|entry| entry.0);
///         from.into_iter()
///     }
///     fn outgoing(&self, _: &(), from: usize) -> impl Iterator<Item = (usize, f64)> {
///         let mut to = [((from + 1) % self.0, 0.9), (from, 0.1)];
///         to.sort_by_key(|entry| entry.0);
///         to.into_iter()
///     }
/// }
///
/// assert_eq!(Around(4).outgoing(&(), 3).collect::<Vec<_>>(), [(0, 0.9), (3, 0.1)]);
/// ```
pub trait TransitionEntries: Transition {
    /// Lists the entries into a state, row `to` of A: pairs (from, probability).
    fn incoming(&self, control: &Self::Control, to: usize) -> impl Iterator<Item = (usize, f64)>;

    /// Lists the entries out of a state, column `from` of A: pairs (to, probability).
    fn outgoing(&self, control: &Self::Control, from: usize) -> impl Iterator<Item = (usize, f64)>;

    /// Lists the entries into a state for decoders: pairs (from, log2 p). An operator whose entries
    /// are products adds the logarithms of their factors.
    fn incoming_log2(
        &self,
        control: &Self::Control,
        to: usize,
    ) -> impl Iterator<Item = (usize, f64)> {
        self.incoming(control, to).map(|(from, p)| (from, log2(p)))
    }

    /// Lists the entries out of a state for decoders, as [`incoming_log2`](Self::incoming_log2)
    /// does: pairs (to, log2 p).
    fn outgoing_log2(
        &self,
        control: &Self::Control,
        from: usize,
    ) -> impl Iterator<Item = (usize, f64)> {
        self.outgoing(control, from).map(|(to, p)| (to, log2(p)))
    }

    /// True if single entries of a step with [evidence](Transition::evidence) are out of the range
    /// of doubles, so that routines that list them have to take their logarithms.
    ///
    /// The default returns [`needs_logs`](Transition::needs_logs), and no operator may return false
    /// where that is true. The converse may differ: an entry that is a product may leave the range
    /// though no factor does, while products with a belief, which take one factor after the other,
    /// are still exact. Called a few times a step; O(entries of the factors).
    fn entries_need_logs(&self, control: &Self::Control) -> bool {
        self.needs_logs(control)
    }

    /// Computes the max-product, the step of Viterbi: `out[i]` = max over j of
    /// log2 A\[i, j\] + `x[j]`, and `from[i]` the lowest j that attains it. Here and in the
    /// operators of this crate, logarithms are rounded to multiples of 2^-45: their sums are then
    /// exact, and paths with the same factors tie.
    ///
    /// If no state leads to i, or only states at −∞ do, `out[i]` is −∞ and `from[i]` is
    /// unspecified. O(entries), unless an operator has a faster way.
    fn max_product(&self, control: &Self::Control, x: &[f64], out: &mut [f64], from: &mut [u32]) {
        for (i, (out, from)) in out.iter_mut().zip(from).enumerate() {
            let entries = self.incoming_log2(control, i).map(|(j, log2)| (j as u32, log2));
            (*out, *from) = best_of(entries, x);
        }
    }
}

/// Maximum of `log2 A[i, j] + x[j]` over the entries (j, `log2 A[i, j]`) of a row, and the first j
/// that attains it: what [`max_product`](TransitionEntries::max_product) returns for a state.
#[inline]
pub fn best_of(entries: impl Iterator<Item = (u32, f64)>, x: &[f64]) -> (f64, u32) {
    let mut best = (f64::NEG_INFINITY, 0);
    for (j, log2) in entries {
        let value = log2 + x[j as usize];
        // Strictly above: entries ascend, so the lowest state keeps a tie.
        if value > best.0 {
            best = (value, j);
        }
    }
    best
}

/// Merges two ascending lists of entries; `plus` adds entries of the same state.
pub fn merge(
    a: impl Iterator<Item = (usize, f64)>,
    b: impl Iterator<Item = (usize, f64)>,
    plus: impl Fn(f64, f64) -> f64,
) -> impl Iterator<Item = (usize, f64)> {
    let (mut a, mut b) = (a.peekable(), b.peekable());
    // The lower head goes first, so the merged list also ascends. The last arm covers a head of `a`
    // that is lower or alone, and the end of both.
    std::iter::from_fn(move || match (a.peek(), b.peek()) {
        (Some(x), Some(y)) if x.0 == y.0 => Some((x.0, plus(a.next()?.1, b.next()?.1))),
        (Some(x), Some(y)) if x.0 > y.0 => b.next(),
        (None, _) => b.next(),
        _ => a.next(),
    })
}
