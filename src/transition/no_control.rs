//! [`NoControl`], the trait bound of methods that take no control, and the same at run time for
//! code that takes any operator.

use std::any::Any;

use super::Transition;

/// The type `()` as a trait, so that compiler errors name the method that takes a control.
#[diagnostic::on_unimplemented(
    message = "this model takes a control of type `{Self}` at each step",
    label = "call the method whose name ends in `_with`, which takes the control",
    note = "`step_with(&control, &observation)`, `predict_with(&control)`, `forecast_with(&controls)`"
)]
pub trait NoControl: Copy {
    /// The only value.
    const NONE: Self;
}

impl NoControl for () {
    const NONE: Self = ();
}

/// The only control of an operator that is the same at every step, by its type; `None` if the
/// operator depends on a control.
pub(crate) fn constant_control<A: Transition + ?Sized>() -> Option<&'static A::Control> {
    (&() as &'static dyn Any).downcast_ref()
}
