//! Sensors behind pointers and wrappers.

use std::rc::Rc;
use std::sync::Arc;

use rand::Rng;

use super::{SampleNext, SampleObservation};
use crate::error::LikelihoodError;
use crate::fixed::Fixed;

/// Implements [`Likelihood`] and [`LocalLikelihood`] by those of a sensor within.
macro_rules! sensor_within {
    ($([$($generics:tt)*] $type:ty => $inner:ty, $a:ident => $sensor:expr;)*) => {$(
        impl<$($generics)*> $crate::likelihood::Likelihood for $type
        where
            $inner: $crate::likelihood::Likelihood,
        {
            type Observation = <$inner as $crate::likelihood::Likelihood>::Observation;

            fn states(&self) -> usize {
                let $a = self;
                $sensor.states()
            }

            fn diagonal<'a>(
                &'a self,
                observation: &'a Self::Observation,
                scratch: &'a mut $crate::likelihood::Scratch,
            ) -> Result<$crate::likelihood::Diagonal<'a>, $crate::error::LikelihoodError> {
                let $a = self;
                $sensor.diagonal(observation, scratch)
            }

            fn by_groups<'a>(
                &'a self,
                observation: &'a Self::Observation,
                scratch: &'a mut $crate::likelihood::Scratch,
            ) -> Option<Result<($crate::likelihood::Diagonal<'a>, &'a $crate::groups::Groups), $crate::error::LikelihoodError>> {
                let $a = self;
                $sensor.by_groups(observation, scratch)
            }

            fn is_precomputed(&self) -> bool {
                let $a = self;
                $sensor.is_precomputed()
            }
        }

        impl<$($generics)*> $crate::likelihood::LocalLikelihood for $type
        where
            $inner: $crate::likelihood::LocalLikelihood,
        {
            fn local<'a>(
                &'a self,
                observation: &'a Self::Observation,
                states: &[usize],
                scratch: &'a mut $crate::likelihood::Scratch,
            ) -> Result<($crate::likelihood::Diagonal<'a>, f64), $crate::error::LikelihoodError>
            {
                let $a = self;
                $sensor.local(observation, states, scratch)
            }

            fn listed_states(&self, observation: &Self::Observation, states: &mut Vec<usize>) {
                let $a = self;
                $sensor.listed_states(observation, states);
            }
        }
    )*};
}

#[cfg(feature = "places")]
pub(crate) use sensor_within;

sensor_within! {
    [B: ?Sized] &B => B, a => (**a);
    [B: ?Sized] Box<B> => B, a => (**a);
    [B: ?Sized] Rc<B> => B, a => (**a);
    [B: ?Sized] Arc<B> => B, a => (**a);
    [B] Fixed<B> => B, a => a.0;
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
