//! Operators of any type as one type, so that generic code is compiled once.

use std::fmt::Debug;

use wayfix::transition::Stored;
use wayfix::{Transition, TransitionEntries, TransitionError};

/// The methods of an operator with the controls of some steps.
pub trait Steps {
    fn states(&self) -> usize;
    fn check_control(&self, step: usize) -> Result<(), TransitionError>;
    fn evidence(&self, step: usize) -> Option<f64>;
    fn needs_logs(&self, step: usize) -> bool;
    fn stored(&self, step: usize) -> Option<Stored<'_>>;
    fn apply(&self, step: usize, x: &[f64], out: &mut [f64]);
    fn smallest_entry(&self, step: usize) -> f64;
    fn apply_in_blocks(&self, step: usize, x: &[f64], take: &mut dyn FnMut(usize, &[f64]));
    fn entries_need_logs(&self, step: usize) -> bool;
    fn apply_transpose(&self, step: usize, x: &[f64], out: &mut [f64]);
    fn apply_log(&self, step: usize, x: &[f64], out: &mut [f64]);
    fn apply_transpose_log(&self, step: usize, x: &[f64], out: &mut [f64]);
    fn incoming(&self, step: usize, to: usize) -> Vec<(usize, f64)>;
    fn outgoing(&self, step: usize, from: usize) -> Vec<(usize, f64)>;
    fn incoming_log2(&self, step: usize, to: usize) -> Vec<(usize, f64)>;
    fn outgoing_log2(&self, step: usize, from: usize) -> Vec<(usize, f64)>;
    fn max_product(&self, step: usize, x: &[f64], out: &mut [f64], from: &mut [u32]);
}

#[derive(Debug)]
pub struct WithControls<A: Transition<Control: Debug>> {
    pub operator: A,
    pub controls: Vec<A::Control>,
}

impl<A: TransitionEntries<Control: Debug>> Steps for WithControls<A> {
    fn states(&self) -> usize {
        self.operator.states()
    }
    fn check_control(&self, step: usize) -> Result<(), TransitionError> {
        self.operator.check_control(&self.controls[step])
    }
    fn evidence(&self, step: usize) -> Option<f64> {
        self.operator.evidence(&self.controls[step])
    }
    fn needs_logs(&self, step: usize) -> bool {
        self.operator.needs_logs(&self.controls[step])
    }
    fn stored(&self, step: usize) -> Option<Stored<'_>> {
        self.operator.stored(&self.controls[step])
    }
    fn apply(&self, step: usize, x: &[f64], out: &mut [f64]) {
        self.operator.apply(&self.controls[step], x, out);
    }
    fn smallest_entry(&self, step: usize) -> f64 {
        self.operator.smallest_entry(&self.controls[step])
    }
    fn apply_in_blocks(&self, step: usize, x: &[f64], take: &mut dyn FnMut(usize, &[f64])) {
        self.operator.apply_in_blocks(&self.controls[step], x, take);
    }
    fn entries_need_logs(&self, step: usize) -> bool {
        self.operator.entries_need_logs(&self.controls[step])
    }
    fn apply_transpose(&self, step: usize, x: &[f64], out: &mut [f64]) {
        self.operator.apply_transpose(&self.controls[step], x, out);
    }
    fn apply_log(&self, step: usize, x: &[f64], out: &mut [f64]) {
        self.operator.apply_log(&self.controls[step], x, out);
    }
    fn apply_transpose_log(&self, step: usize, x: &[f64], out: &mut [f64]) {
        self.operator.apply_transpose_log(&self.controls[step], x, out);
    }
    fn incoming(&self, step: usize, to: usize) -> Vec<(usize, f64)> {
        self.operator.incoming(&self.controls[step], to).collect()
    }
    fn outgoing(&self, step: usize, from: usize) -> Vec<(usize, f64)> {
        self.operator.outgoing(&self.controls[step], from).collect()
    }
    fn incoming_log2(&self, step: usize, to: usize) -> Vec<(usize, f64)> {
        self.operator.incoming_log2(&self.controls[step], to).collect()
    }
    fn outgoing_log2(&self, step: usize, from: usize) -> Vec<(usize, f64)> {
        self.operator.outgoing_log2(&self.controls[step], from).collect()
    }
    fn max_product(&self, step: usize, x: &[f64], out: &mut [f64], from: &mut [u32]) {
        self.operator.max_product(&self.controls[step], x, out, from);
    }
}

/// The operator of one step, without a control.
#[derive(Clone, Copy)]
pub struct AtStep<'a> {
    pub operator: &'a dyn Steps,
    pub step: usize,
}

/// The operators of all steps, by their number.
#[derive(Clone, Copy)]
pub struct EachStep<'a>(pub &'a dyn Steps);

/// Implements both traits by those of the inner operator.
macro_rules! delegate {
    ($type:ident, $control:ty, |$self:ident, $u:ident| $operator:expr, $step:expr) => {
        impl Transition for $type<'_> {
            type Control = $control;
            fn states(&$self) -> usize {
                $operator.states()
            }
            fn check_control(&$self, $u: &$control) -> Result<(), TransitionError> {
                $operator.check_control($step)
            }
            fn evidence(&$self, $u: &$control) -> Option<f64> {
                $operator.evidence($step)
            }
            fn needs_logs(&$self, $u: &$control) -> bool {
                $operator.needs_logs($step)
            }
            fn stored(&$self, $u: &$control) -> Option<Stored<'_>> {
                $operator.stored($step)
            }
            fn apply(&$self, $u: &$control, x: &[f64], out: &mut [f64]) {
                $operator.apply($step, x, out);
            }
            fn smallest_entry(&$self, $u: &$control) -> f64 {
                $operator.smallest_entry($step)
            }
            fn apply_in_blocks(
                &$self,
                $u: &$control,
                x: &[f64],
                take: &mut dyn FnMut(usize, &[f64]),
            ) {
                $operator.apply_in_blocks($step, x, take);
            }
            fn apply_transpose(&$self, $u: &$control, x: &[f64], out: &mut [f64]) {
                $operator.apply_transpose($step, x, out);
            }
            fn apply_log(&$self, $u: &$control, x: &[f64], out: &mut [f64]) {
                $operator.apply_log($step, x, out);
            }
            fn apply_transpose_log(&$self, $u: &$control, x: &[f64], out: &mut [f64]) {
                $operator.apply_transpose_log($step, x, out);
            }
        }
        impl TransitionEntries for $type<'_> {
            fn entries_need_logs(&$self, $u: &$control) -> bool {
                $operator.entries_need_logs($step)
            }
            fn incoming(&$self, $u: &$control, to: usize) -> impl Iterator<Item = (usize, f64)> {
                $operator.incoming($step, to).into_iter()
            }
            fn outgoing(&$self, $u: &$control, from: usize) -> impl Iterator<Item = (usize, f64)> {
                $operator.outgoing($step, from).into_iter()
            }
            fn incoming_log2(
                &$self,
                $u: &$control,
                to: usize,
            ) -> impl Iterator<Item = (usize, f64)> {
                $operator.incoming_log2($step, to).into_iter()
            }
            fn outgoing_log2(
                &$self,
                $u: &$control,
                from: usize,
            ) -> impl Iterator<Item = (usize, f64)> {
                $operator.outgoing_log2($step, from).into_iter()
            }
            fn max_product(&$self, $u: &$control, x: &[f64], out: &mut [f64], from: &mut [u32]) {
                $operator.max_product($step, x, out, from);
            }
        }
    };
}

delegate!(AtStep, (), |self, _u| self.operator, self.step);
delegate!(EachStep, usize, |self, u| self.0, *u);
