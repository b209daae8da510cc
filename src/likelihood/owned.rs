//! Observations that can be put into an `Option` or a pair.

/// Trait of all sized types. Its only purpose is its diagnostic, which tells how to own
/// observations that are borrowed slices.
#[diagnostic::on_unimplemented(
    message = "observations of type `{Self}` cannot be put into an `Option` or a pair",
    label = "the sensor takes borrowed observations, of type `{Self}`",
    note = "a `LikelihoodVector` takes owned ones, of type `Vec<f64>`, after `.owned()`: `LikelihoodVector::log(n).owned()`"
)]
pub trait Owned {}

#[diagnostic::do_not_recommend]
impl<T> Owned for T {}
