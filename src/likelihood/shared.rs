//! Sensors behind pointers and wrappers. All methods are delegated, also those with a default: a
//! default would give the right values, but lose a fast path.

use std::rc::Rc;
use std::sync::Arc;

use rand::Rng;

use super::{Diagonal, Likelihood, LocalLikelihood, SampleNext, SampleObservation, Scratch};
use crate::error::LikelihoodError;
use crate::fixed::Fixed;
use crate::groups::Groups;

macro_rules! as_target {
    ($([$($generics:tt)*] $type:ty,)*) => {$(
        impl<$($generics)*> Likelihood for $type
        where
            B: Likelihood,
        {
            type Observation = B::Observation;

            fn states(&self) -> usize {
                (**self).states()
            }

            fn diagonal<'a>(
                &'a self,
                observation: &'a B::Observation,
                scratch: &'a mut Scratch,
            ) -> Result<Diagonal<'a>, LikelihoodError> {
                (**self).diagonal(observation, scratch)
            }

            fn by_groups<'a>(
                &'a self,
                observation: &'a B::Observation,
                scratch: &'a mut Scratch,
            ) -> Option<Result<(Diagonal<'a>, &'a Groups), LikelihoodError>> {
                (**self).by_groups(observation, scratch)
            }

            fn is_precomputed(&self) -> bool {
                (**self).is_precomputed()
            }
        }

        impl<$($generics)*> LocalLikelihood for $type
        where
            B: LocalLikelihood,
        {
            fn local<'a>(
                &'a self,
                observation: &'a B::Observation,
                states: &[usize],
                scratch: &'a mut Scratch,
            ) -> Result<(Diagonal<'a>, f64), LikelihoodError> {
                (**self).local(observation, states, scratch)
            }

            fn listed_states(&self, observation: &B::Observation, states: &mut Vec<usize>) {
                (**self).listed_states(observation, states);
            }
        }
    )*};
}

as_target! {
    [B: ?Sized] &B,
    [B: ?Sized] Box<B>,
    [B: ?Sized] Rc<B>,
    [B: ?Sized] Arc<B>,
    [B] Fixed<B>,
}

impl<B: SampleObservation> SampleObservation for Fixed<B> {
    type Sample = B::Sample;

    fn sample<R: Rng + ?Sized>(&self, state: usize, rng: &mut R) -> B::Sample {
        self.0.sample(state, rng)
    }
}

impl<B: SampleNext> SampleNext for Fixed<B> {
    type Sample = B::Sample;

    fn sample_next<R: Rng + ?Sized>(
        &self,
        state: usize,
        before: &B::Observation,
        rng: &mut R,
    ) -> Result<B::Sample, LikelihoodError> {
        self.0.sample_next(state, before, rng)
    }
}
