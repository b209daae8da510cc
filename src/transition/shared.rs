//! Operators behind pointers and in wrappers.

use std::rc::Rc;
use std::sync::Arc;

use super::{SparseTransition, Stored, TiedTransition, Transition, TransitionEntries};
use crate::error::TransitionError;
use crate::fixed::Fixed;

macro_rules! as_target {
    ($([$($generics:tt)*] $type:ty => $target:ty,)*) => {$(
        impl<$($generics)*> Transition for $type
        where
            $target: Transition,
        {
            type Control = <$target as Transition>::Control;

            fn states(&self) -> usize {
                (**self).states()
            }

            fn no_control(&self) -> Option<&'static Self::Control> {
                (**self).no_control()
            }

            fn apply(&self, control: &Self::Control, x: &[f64], out: &mut [f64]) {
                (**self).apply(control, x, out);
            }

            fn apply_transpose(&self, control: &Self::Control, x: &[f64], out: &mut [f64]) {
                (**self).apply_transpose(control, x, out);
            }

            fn apply_log(&self, control: &Self::Control, x: &[f64], out: &mut [f64]) {
                (**self).apply_log(control, x, out);
            }

            fn apply_transpose_log(&self, control: &Self::Control, x: &[f64], out: &mut [f64]) {
                (**self).apply_transpose_log(control, x, out);
            }

            fn evidence(&self, control: &Self::Control) -> Option<f64> {
                (**self).evidence(control)
            }

            fn needs_logs(&self, control: &Self::Control) -> bool {
                (**self).needs_logs(control)
            }

            fn apply_in_blocks(
                &self,
                control: &Self::Control,
                x: &[f64],
                take: &mut dyn FnMut(usize, &[f64]),
            ) {
                (**self).apply_in_blocks(control, x, take);
            }

            fn smallest_entry(&self, control: &Self::Control) -> f64 {
                (**self).smallest_entry(control)
            }

            fn stored(&self, control: &Self::Control) -> Option<Stored<'_>> {
                (**self).stored(control)
            }

            fn check_control(&self, control: &Self::Control) -> Result<(), TransitionError> {
                (**self).check_control(control)
            }
        }

        impl<$($generics)*> TransitionEntries for $type
        where
            $target: TransitionEntries,
        {
            fn incoming(
                &self,
                control: &Self::Control,
                to: usize,
            ) -> impl Iterator<Item = (usize, f64)> {
                (**self).incoming(control, to)
            }

            fn outgoing(
                &self,
                control: &Self::Control,
                from: usize,
            ) -> impl Iterator<Item = (usize, f64)> {
                (**self).outgoing(control, from)
            }

            fn incoming_log2(
                &self,
                control: &Self::Control,
                to: usize,
            ) -> impl Iterator<Item = (usize, f64)> {
                (**self).incoming_log2(control, to)
            }

            fn outgoing_log2(
                &self,
                control: &Self::Control,
                from: usize,
            ) -> impl Iterator<Item = (usize, f64)> {
                (**self).outgoing_log2(control, from)
            }

            fn entries_need_logs(&self, control: &Self::Control) -> bool {
                (**self).entries_need_logs(control)
            }

            fn max_product(
                &self,
                control: &Self::Control,
                x: &[f64],
                out: &mut [f64],
                from: &mut [u32],
            ) {
                (**self).max_product(control, x, out, from);
            }
        }
    )*};
}

as_target! {
    [A: ?Sized] &A => A,
    [A: ?Sized] Box<A> => A,
    [A: ?Sized] Rc<A> => A,
    [A: ?Sized] Arc<A> => A,
    [A] Fixed<A> => A,
    [] TiedTransition => SparseTransition,
}
