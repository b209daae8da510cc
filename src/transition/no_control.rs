//! The control of operators without one.

/// The type `()` as a trait, so that compiler errors name the method to call with a control.
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
