//! Operators behind a pointer are operators.

use std::rc::Rc;
use std::sync::Arc;

use super::{Transition, TransitionEntries};
use crate::error::TransitionError;

macro_rules! behind_a_pointer {
    ($($pointer:ty),*) => {$(
        impl<A: Transition + ?Sized> Transition for $pointer {
            type Control = A::Control;

            fn states(&self) -> usize {
                (**self).states()
            }

            fn apply(&self, control: &A::Control, x: &[f64], out: &mut [f64]) {
                (**self).apply(control, x, out);
            }

            fn apply_transpose(&self, control: &A::Control, x: &[f64], out: &mut [f64]) {
                (**self).apply_transpose(control, x, out);
            }

            fn apply_log(&self, control: &A::Control, x: &[f64], out: &mut [f64]) {
                (**self).apply_log(control, x, out);
            }

            fn apply_transpose_log(&self, control: &A::Control, x: &[f64], out: &mut [f64]) {
                (**self).apply_transpose_log(control, x, out);
            }

            fn check_control(&self, control: &A::Control) -> Result<(), TransitionError> {
                (**self).check_control(control)
            }
        }

        impl<A: TransitionEntries> TransitionEntries for $pointer {
            fn incoming(
                &self,
                control: &A::Control,
                to: usize,
            ) -> impl Iterator<Item = (usize, f64)> {
                (**self).incoming(control, to)
            }

            fn outgoing(
                &self,
                control: &A::Control,
                from: usize,
            ) -> impl Iterator<Item = (usize, f64)> {
                (**self).outgoing(control, from)
            }

            fn max_product(
                &self,
                control: &A::Control,
                x: &[f64],
                out: &mut [f64],
                from: &mut [u32],
            ) {
                (**self).max_product(control, x, out, from);
            }
        }
    )*};
}

behind_a_pointer!(&A, Box<A>, Rc<A>, Arc<A>);
