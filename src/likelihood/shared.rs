//! Sensors behind a pointer are sensors.

use std::rc::Rc;
use std::sync::Arc;

use super::{Diagonal, Likelihood, Scratch};
use crate::error::LikelihoodError;

macro_rules! behind_a_pointer {
    ($($pointer:ty),*) => {$(
        impl<B: Likelihood + ?Sized> Likelihood for $pointer {
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
        }
    )*};
}

behind_a_pointer!(&B, Box<B>, Rc<B>, Arc<B>);
