//! Tools for authors of operators: memory, checks, sums of logarithms, and [`check`], which compares
//! all methods of an operator with one another.
//!
//! | for | take |
//! |---|---|
//! | constructors: counts, probabilities, distributions | [`check_count`], [`check_probability`], [`check_sum`] |
//! | products: the lengths of slices, and memory between two passes | [`check_slices`], [`with_scratch`] |
//! | products in logarithms | [`log_add`], [`log_sum`] |
//! | lists of entries: adding two of them, and their logarithms for decoders | [`merge`], [`log2`], [`log2_add`] |
//! | the step of Viterbi | [`best_of`] |
//! | tests | [`check`] |
//!
//! Inference trusts an operator: it takes products from one method, entries from another, and the
//! step of Viterbi from a third. If these are not those of one matrix, answers are wrong, and nobody
//! notices. So each operator of one's own deserves a test like the last line of this example, a mixture of a
//! given operator and of jumps that reach every state with the same probability:
//!
//! ```
//! use wayfix::transition::kit::{self, check_probability, check_slices, log_add, log_sum, merge};
//! use wayfix::{SparseTransition, Transition, TransitionEntries, TransitionError};
//!
//! struct Jumping<A> {
//!     moves: A,
//!     rate: f64,
//! }
//!
//! impl<A: Transition> Jumping<A> {
//!     fn new(moves: A, rate: f64) -> Result<Self, TransitionError> {
//!         check_probability(rate, || "the rate of jumps".into())?;
//!         Ok(Self { moves, rate })
//!     }
//!     fn jump(&self) -> f64 {
//!         self.rate / self.moves.states() as f64
//!     }
//!     /// Adds the jumps to a line of entries.
//!     fn line(&self, moves: impl Iterator<Item = (usize, f64)>) -> impl Iterator<Item = (usize, f64)> {
//!         let moves = moves.map(|(state, p)| (state, (1.0 - self.rate) * p));
//!         let jumps = (0..self.moves.states()).map(|state| (state, self.jump()));
//!         merge(moves, jumps, |p, q| p + q).filter(|entry| entry.1 > 0.0)
//!     }
//! }
//!
//! impl<A: Transition<Control = ()>> Transition for Jumping<A> {
//!     type Control = ();
//!     fn states(&self) -> usize {
//!         self.moves.states()
//!     }
//!     fn apply(&self, _: &(), x: &[f64], out: &mut [f64]) {
//!         check_slices(self.states(), x, out);
//!         self.moves.apply(&(), x, out);
//!         let jumping = self.jump() * x.iter().sum::<f64>();
//!         out.iter_mut().for_each(|out| *out = (1.0 - self.rate) * *out + jumping);
//!     }
//!     fn apply_transpose(&self, _: &(), x: &[f64], out: &mut [f64]) {
//!         check_slices(self.states(), x, out);
//!         self.moves.apply_transpose(&(), x, out);
//!         let jumping = self.jump() * x.iter().sum::<f64>();
//!         out.iter_mut().for_each(|out| *out = (1.0 - self.rate) * *out + jumping);
//!     }
//!     fn apply_log(&self, _: &(), x: &[f64], out: &mut [f64]) {
//!         self.moves.apply_log(&(), x, out);
//!         let jumping = log_sum((0..x.len()).map(|j| (j, self.jump())), x);
//!         out.iter_mut().for_each(|out| *out = log_add((1.0 - self.rate).ln() + *out, jumping));
//!     }
//! }
//!
//! impl<A: TransitionEntries<Control = ()>> TransitionEntries for Jumping<A> {
//!     fn incoming(&self, _: &(), to: usize) -> impl Iterator<Item = (usize, f64)> {
//!         self.line(self.moves.incoming(&(), to))
//!     }
//!     fn outgoing(&self, _: &(), from: usize) -> impl Iterator<Item = (usize, f64)> {
//!         self.line(self.moves.outgoing(&(), from))
//!     }
//! }
//!
//! let drive = SparseTransition::from_rows(&[[0.5, 0.0, 1.0], [0.5, 0.5, 0.0], [0.0, 0.5, 0.0]])?;
//! kit::check(&Jumping::new(drive, 0.1)?, &())?;
//! # Ok::<(), TransitionError>(())
//! ```

mod check;

pub use super::buffers::with_scratch;
pub use super::check::{check_count, check_probability, check_slices, check_sum};
pub use super::entries::{best_of, merge};
pub use super::log::{add as log_add, add_log2 as log2_add, sum as log_sum};
pub use check::check;

/// Base-2 logarithm of an entry for decoders, rounded to a multiple of 2^-45, so that sums of such
/// logarithms are exact and paths with the same factors tie; −∞ for 0.
///
/// ```
/// use wayfix::transition::kit::log2;
///
/// assert_eq!((log2(0.25), log2(0.0)), (-2.0, f64::NEG_INFINITY));
/// assert_eq!(log2(0.3) + log2(0.7) + log2(0.1), log2(0.1) + log2(0.7) + log2(0.3));
/// ```
#[must_use]
pub fn log2(p: f64) -> f64 {
    wayfix_kernels::log2(p)
}
