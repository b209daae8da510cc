//! x
use crate::hmm::Hmm;
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::TransitionEntries;
pub(in super::super) fn viterbi<A, B, S>(_: &Hmm<A, B>, _: &S) -> Option<(Vec<usize>, f64)>
where
    A: TransitionEntries,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation> + ?Sized,
{
    None
}
