//! x
use crate::hmm::Hmm;
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::error::InferenceError;
use crate::inference::posteriors::Posteriors;
use crate::transition::Transition;
pub(in super::super) fn forward<A, B, S>(_: &Hmm<A, B>, _: &S) -> Option<Result<(Posteriors, Vec<f64>, f64), InferenceError>>
where
    A: Transition,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation> + ?Sized,
{
    None
}
