//! [`NoControl`], the trait bound of methods that take no control.

/// The type `()` as a trait, so that compiler errors name the method that takes a control.
///
/// It is about types alone. That an operator is the same at all steps is declared by
/// [`Transition::no_control`](super::Transition::no_control).
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
