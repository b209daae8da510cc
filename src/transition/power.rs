//! [`PowerTransition`]: several steps in one, A^m, by m products. The power itself is never formed,
//! since it fills in.

use super::{Transition, TransitionEntries, best_of, buffers, delegate};
use crate::error::TransitionError;
use wayfix_kernels::log2;

/// An operator applied m times: A^m. For motion that is observed only at every m-th step.
///
/// Products cost m products with A. **Entries are not stored**: listing a row or column takes such
/// a product, and allocates. A step of Viterbi takes one for each state; to decode, store the
/// matrix once with [`SparseTransition::from_operator`](crate::SparseTransition::from_operator).
///
/// ```
/// use wayfix::transition::{PowerTransition, WindowTransition};
/// use wayfix::{SparseTransition, Transition};
///
/// let step = WindowTransition::new(8, 0, &[0.5, 0.5], true)?;
/// let twice = PowerTransition::new(step, 2);
/// let mut out = [0.0; 8];
/// twice.apply(&(), &[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], &mut out);
/// assert_eq!(out[..3], [0.25, 0.5, 0.25]);
///
/// let stored = SparseTransition::from_operator(&twice)?; // for Viterbi
/// assert_eq!(stored.entries(), 24);
/// # Ok::<(), wayfix::TransitionError>(())
/// ```
#[derive(Debug, Clone, Copy)]
pub struct PowerTransition<A> {
    pub(crate) inner: A,
    exponent: u32,
}

impl<A: Transition> PowerTransition<A> {
    /// Creates the operator of `exponent` steps of `inner` under one control; 0 steps are the
    /// identity.
    pub fn new(inner: A, exponent: u32) -> Self {
        Self { inner, exponent }
    }

    /// The operator of one step.
    #[must_use]
    pub fn inner(&self) -> &A {
        &self.inner
    }

    /// The number of steps, m.
    pub fn exponent(&self) -> u32 {
        self.exponent
    }

    fn repeat(&self, x: &[f64], out: &mut [f64], product: impl Fn(&[f64], &mut [f64])) {
        match self.exponent {
            0 => out.copy_from_slice(x),
            1 => product(x, out),
            times => buffers::with(x.len(), |buffer| {
                // Alternating, so that the last product ends in `out`.
                let (mut next, mut last) =
                    if times % 2 == 1 { (out, buffer) } else { (buffer, out) };
                product(x, next);
                for _ in 1..times {
                    (next, last) = (last, next);
                    product(last, next);
                }
            }),
        }
    }

    /// Lists the entries above 0 of a column, or of a row if `product` is that of the transpose.
    fn entries(
        &self,
        state: usize,
        product: &dyn Fn(&[f64], &mut [f64]),
    ) -> impl Iterator<Item = (usize, f64)> + use<A> {
        // The iterator outlives this call, so that its values can't be in a lent buffer.
        let mut line = vec![0.0; self.states()];
        buffers::with(line.len(), |unit| {
            unit.fill(0.0);
            unit[state] = 1.0;
            product(unit, &mut line);
        });
        line.into_iter().enumerate().filter(|entry| entry.1 > 0.0)
    }
}

impl<A: Transition> Transition for PowerTransition<A> {
    type Control = A::Control;

    fn states(&self) -> usize {
        self.inner.states()
    }

    delegate!(a, control => a.inner, control; no_control);

    fn apply(&self, control: &A::Control, x: &[f64], out: &mut [f64]) {
        self.repeat(x, out, |x, out| self.inner.apply(control, x, out));
    }

    fn apply_transpose(&self, control: &A::Control, x: &[f64], out: &mut [f64]) {
        self.repeat(x, out, |x, out| self.inner.apply_transpose(control, x, out));
    }

    fn apply_log(&self, control: &A::Control, x: &[f64], out: &mut [f64]) {
        self.repeat(x, out, |x, out| self.inner.apply_log(control, x, out));
    }

    fn apply_transpose_log(&self, control: &A::Control, x: &[f64], out: &mut [f64]) {
        self.repeat(x, out, |x, out| self.inner.apply_transpose_log(control, x, out));
    }

    fn check_control(&self, control: &A::Control) -> Result<(), TransitionError> {
        // One measurement would count m times.
        super::refuse_evidence(&self.inner, control, "PowerTransition")
    }
}

impl<A: Transition> TransitionEntries for PowerTransition<A> {
    fn incoming(&self, control: &A::Control, to: usize) -> impl Iterator<Item = (usize, f64)> {
        self.entries(to, &|x, out| self.apply_transpose(control, x, out))
    }

    fn outgoing(&self, control: &A::Control, from: usize) -> impl Iterator<Item = (usize, f64)> {
        self.entries(from, &|x, out| self.apply(control, x, out))
    }

    fn max_product(&self, control: &A::Control, x: &[f64], out: &mut [f64], from: &mut [u32]) {
        buffers::with_two(x.len(), |unit, row| {
            unit.fill(0.0);
            // Row i is A'^m e_i: a sum over paths, so that the maximum can't be taken step by step.
            for (i, (out, from)) in out.iter_mut().zip(from).enumerate() {
                unit[i] = 1.0;
                self.apply_transpose(control, unit, row);
                unit[i] = 0.0;
                (*out, *from) = best_of((0..).zip(row.iter().map(|&p| log2(p))), x);
            }
        });
    }
}

#[cfg(feature = "serde")]
crate::stored! {
    [A: Transition] PowerTransition<A>: [A], |a| {
        inner: A = a.inner,
        exponent: u32 = a.exponent(),
    } => Ok::<_, std::convert::Infallible>(Self::new(inner, exponent));
}
