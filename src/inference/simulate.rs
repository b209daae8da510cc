//! Simulation: states and observations drawn from the model.

use rand::Rng;

use crate::error::InferenceError;
use crate::hmm::{Hmm, Prior};
use crate::likelihood::SampleObservation;
use crate::random::index;
use crate::transition::TransitionEntries;

/// A drive drawn from a model: what was true, and what was seen.
///
/// Made by [`Hmm::simulate`].
#[derive(Debug, Clone, PartialEq)]
pub struct Simulation<Y> {
    initial: Option<usize>,
    states: Vec<usize>,
    observations: Vec<Y>,
}

impl<Y> Simulation<Y> {
    /// X_0, if the prior is of the state before the first transition.
    #[must_use]
    pub fn initial(&self) -> Option<usize> {
        self.initial
    }

    /// X_1 … X_T.
    #[must_use]
    pub fn states(&self) -> &[usize] {
        &self.states
    }

    /// y_1 … y_T.
    #[must_use]
    pub fn observations(&self) -> &[Y] {
        &self.observations
    }
}

impl<A: TransitionEntries, B: SampleObservation> Hmm<A, B> {
    /// Draws T steps of hidden states and their observations.
    ///
    /// The same generator in the same state gives the same drive. O(n) for the
    /// first state, then O(ways out of a state + what an observation costs) a
    /// step.
    ///
    /// ```
    /// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
    /// use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
    ///
    /// let hmm = Hmm::new(
    ///     Prior::BeforeFirstTransition(Belief::certain(2, 0)?),
    ///     DenseTransition::from_rows(2, &[0.0, 1.0, 1.0, 0.0])?,
    ///     TableLikelihood::from_rows(&[[1.0, 0.0], [0.0, 1.0]])?,
    /// )?;
    /// let drive = hmm.simulate(3, &mut ChaCha8Rng::seed_from_u64(1));
    /// assert_eq!(drive.initial(), Some(0));
    /// assert_eq!(drive.states(), [1, 0, 1]);
    /// assert_eq!(drive.observations(), [1, 0, 1]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn simulate<R: Rng + ?Sized>(&self, steps: usize, rng: &mut R) -> Simulation<B::Observation>
    where
        A: TransitionEntries<Control = ()>,
    {
        self.draw(&vec![(); steps], rng)
    }

    /// The same under controls, one a step: `controls[k - 1]` drives the
    /// transition from k − 1 to k.
    ///
    /// # Errors
    ///
    /// [`InferenceError::Control`] with the step whose control is not valid.
    pub fn simulate_with<R: Rng + ?Sized>(
        &self,
        controls: &[A::Control],
        rng: &mut R,
    ) -> Result<Simulation<B::Observation>, InferenceError> {
        for (step, control) in (1..).zip(controls) {
            if self.prior().moves_at(step) {
                self.transition()
                    .check_control(control)
                    .map_err(|source| InferenceError::Control { step, source })?;
            }
        }
        Ok(self.draw(controls, rng))
    }

    fn draw<R: Rng + ?Sized>(
        &self,
        controls: &[A::Control],
        rng: &mut R,
    ) -> Simulation<B::Observation> {
        let first = index(self.prior().belief().as_slice().iter().copied().enumerate(), rng);
        let before = matches!(self.prior(), Prior::BeforeFirstTransition(_));
        let mut state = first;
        let mut states = Vec::with_capacity(controls.len());
        let mut observations = Vec::with_capacity(controls.len());
        for (step, control) in (1..).zip(controls) {
            if self.prior().moves_at(step) {
                state = index(self.transition().outgoing(control, state), rng);
            }
            states.push(state);
            observations.push(self.likelihood().sample(state, rng));
        }
        Simulation { initial: before.then_some(first), states, observations }
    }
}
