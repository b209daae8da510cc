//! [`OptionalLikelihood`], for observations that may be missing: a missing one has likelihood 1 in
//! every state, and changes nothing.

use rand::Rng;

use super::owned::Owned;
use super::{Diagonal, Likelihood, LocalLikelihood, SampleObservation, Scratch};
use crate::error::LikelihoodError;

/// A sensor whose observations may be missing: the observation is an `Option`, and `None` has
/// likelihood 1 in every state.
///
/// ```
/// use wayfix::{Belief, DenseTransition, Hmm, OptionalLikelihood, Prior, TableLikelihood};
///
/// let camera = TableLikelihood::from_rows(&[[0.9, 0.1], [0.2, 0.8]])?;
/// let prior = Prior::BeforeFirstTransition(Belief::certain(2, 0)?);
/// let transition = DenseTransition::from_rows(&[[0.5, 0.0], [0.5, 1.0]])?;
/// let hmm = Hmm::new(prior, transition, OptionalLikelihood::new(camera))?;
/// let mut filter = hmm.filter();
/// filter.step(&None)?;
/// assert_eq!(filter.belief().as_slice(), [0.5, 0.5]);
/// assert_eq!(filter.log_likelihood(), 0.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct OptionalLikelihood<B> {
    pub(crate) sensor: B,
    pub(crate) ones: Vec<f64>,
}

impl<B: Likelihood> OptionalLikelihood<B> {
    /// Wraps a sensor. Its observations must be owned, like those of
    /// `LikelihoodVector::log(n).owned()`.
    pub fn new(sensor: B) -> Self
    where
        B::Observation: Owned,
    {
        Self { ones: vec![1.0; sensor.states()], sensor }
    }

    /// Returns the wrapped sensor.
    #[must_use]
    pub fn sensor(&self) -> &B {
        &self.sensor
    }
}

impl<B: Likelihood<Observation: Sized>> Likelihood for OptionalLikelihood<B> {
    type Observation = Option<B::Observation>;

    fn states(&self) -> usize {
        self.sensor.states()
    }

    fn diagonal<'a>(
        &'a self,
        observation: &'a Option<B::Observation>,
        scratch: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        if let Some(observation) = observation {
            return self.sensor.diagonal(observation, scratch);
        }
        // Decoders take base-2 logarithms: those of 1 are kept in the scratch, not computed anew.
        if scratch.takes_log2() {
            return Ok(scratch.ones(self.ones.len()));
        }
        Ok(Diagonal::checked(&self.ones, 1.0, None))
    }

    fn is_precomputed(&self) -> bool {
        self.sensor.is_precomputed()
    }
}

impl<B: LocalLikelihood<Observation: Sized>> LocalLikelihood for OptionalLikelihood<B> {
    fn local<'a>(
        &'a self,
        observation: &'a Option<B::Observation>,
        states: &[usize],
        scratch: &'a mut Scratch,
    ) -> Result<(Diagonal<'a>, f64), LikelihoodError> {
        if let Some(observation) = observation {
            return self.sensor.local(observation, states, scratch);
        }
        // The bound is exact: all other states also have likelihood 1.
        Ok((Diagonal::checked(&self.ones[..states.len()], 1.0, None), 1.0))
    }

    fn listed_states(&self, observation: &Option<B::Observation>, states: &mut Vec<usize>) {
        if let Some(observation) = observation {
            self.sensor.listed_states(observation, states);
        }
    }
}

impl<Y, B> SampleObservation for OptionalLikelihood<B>
where
    B: SampleObservation<Observation = Y, Sample = Y>,
{
    type Sample = Option<Y>;

    /// Draws an observation of the sensor. It is never missing, since the model does not include
    /// the rate of missing ones.
    fn sample<R: Rng + ?Sized>(&self, state: usize, rng: &mut R) -> Option<Y> {
        Some(self.sensor.sample(state, rng))
    }
}

#[cfg(feature = "serde")]
crate::stored! {
    [B: Likelihood<Observation: Sized>] OptionalLikelihood<B>: [B], |optional| {
        sensor: B = optional.sensor,
    } => optional(sensor);
}

/// As [`OptionalLikelihood::new`], but with an error if so many states do not fit into memory.
#[cfg(feature = "serde")]
fn optional<B: Likelihood>(
    sensor: B,
) -> Result<OptionalLikelihood<B>, std::collections::TryReserveError> {
    let mut ones = Vec::new();
    ones.try_reserve_exact(sensor.states())?;
    ones.resize(sensor.states(), 1.0);
    Ok(OptionalLikelihood { sensor, ones })
}
