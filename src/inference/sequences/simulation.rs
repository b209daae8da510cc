//! Simulation: states and observations drawn from the model ("Simulation" in section 8 of the
//! [formulas](crate::guide::formulas)).
//!
//! One recursion serves models and filters, with controls or autoregressive. It draws each state
//! before its observation and each in the order of steps, so that a generator gives the same drive
//! whichever method is called.

use std::borrow::Borrow;
use std::convert::Infallible;
use std::ops::Deref;

use rand::Rng;

use crate::error::HmmError;
use crate::hmm::Hmm;
use crate::inference::step::Step;
use crate::inference::streams::filter::Filter;
use crate::likelihood::{Likelihood, SampleNext, SampleObservation};
use crate::random::index;
use crate::transition::TransitionEntries;

/// A drive whose states are known, such as a [`Simulation`](crate::inference::Simulation).
#[derive(Debug, Clone, Copy)]
pub struct LabelledSequence<'a, S: ?Sized> {
    /// X_0 if known; otherwise the move to X_1 is not counted, and nothing is learned about the
    /// prior. Ignored under [`Prior::AtFirstObservation`](crate::Prior::AtFirstObservation), where
    /// no move leads to X_1.
    pub initial: Option<usize>,
    /// X_1 … X_T.
    pub states: &'a [usize],
    /// Observations, with controls if there are any.
    pub sequence: &'a S,
}

/// A simulated drive: its true states and its observations.
///
/// Made by [`Hmm::simulate`] and [`Filter::simulate`] or, for an autoregressive model, by
/// [`Hmm::simulate_after`] and [`Filter::simulate_after`].
#[derive(Debug, Clone, PartialEq)]
pub struct Simulation<Y> {
    initial: Option<usize>,
    states: Vec<usize>,
    observations: Vec<Y>,
}

impl<Y> Simulation<Y> {
    /// State before the first transition: X_0, or the present state of a filter; `None` if no
    /// transition leads to the first step.
    #[must_use]
    pub fn initial(&self) -> Option<usize> {
        self.initial
    }

    /// States X_1 … X_T.
    #[must_use]
    pub fn states(&self) -> &[usize] {
        &self.states
    }

    /// Observations y_1 … y_T.
    #[must_use]
    pub fn observations(&self) -> &[Y] {
        &self.observations
    }

    /// Returns the drive with its true states, for learning.
    #[must_use]
    pub fn labelled(&self) -> LabelledSequence<'_, [Y]> {
        LabelledSequence {
            initial: self.initial,
            states: &self.states,
            sequence: &self.observations,
        }
    }
}

impl<A: TransitionEntries, B: SampleObservation> Hmm<A, B> {
    /// Draws `steps` hidden states and their observations.
    ///
    /// The same generator in the same state gives the same drive. O(n) for the first state, then
    /// O(entries out of a state + the cost of an observation) a step. (Under an operator with
    /// [evidence](crate::Transition::evidence) and no control, moves are drawn with probabilities
    /// proportional to its entries.)
    ///
    /// ```
    /// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
    /// use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
    ///
    /// let hmm = Hmm::new(
    ///     Prior::BeforeFirstTransition(Belief::certain(2, 0)?),
    ///     DenseTransition::from_rows(&[[0.0, 1.0], [1.0, 0.0]])?,
    ///     TableLikelihood::from_rows(&[[1.0, 0.0], [0.0, 1.0]])?,
    /// )?;
    /// let drive = hmm.simulate(3, &mut ChaCha8Rng::seed_from_u64(1));
    /// assert_eq!(drive.initial(), Some(0));
    /// assert_eq!(drive.states(), [1, 0, 1]);
    /// assert_eq!(drive.observations(), [1, 0, 1]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn simulate<R: Rng + ?Sized>(&self, steps: usize, rng: &mut R) -> Simulation<B::Sample>
    where
        A: TransitionEntries<Control = ()>,
    {
        self.draw(self.prior().belief().as_slice(), 0, &vec![(); steps], rng)
    }

    /// Draws a drive under controls, one a step: `controls[k - 1]` drives the transition from k −
    /// 1 to k.
    ///
    /// # Errors
    ///
    /// [`HmmError::Control`] with the step whose control is not valid, or
    /// [`HmmError::SimulatedEvidence`] with the step whose control is not an input but a
    /// measurement of the move.
    pub fn simulate_with<R: Rng + ?Sized>(
        &self,
        controls: &[A::Control],
        rng: &mut R,
    ) -> Result<Simulation<B::Sample>, HmmError> {
        self.check_controls(0, controls)?;
        Ok(self.draw(self.prior().belief().as_slice(), 0, controls, rng))
    }

    /// Checks the controls of the steps after the first `steps_before`.
    fn check_controls(&self, steps_before: usize, controls: &[A::Control]) -> Result<(), HmmError> {
        for (number, control) in (steps_before + 1..).zip(controls) {
            if self.prior().moves_at(number) {
                let step = Step { hmm: self, number, control: Some(control) };
                // Evidence is measured on a move that has been made; it cannot be given before the
                // move is drawn.
                if step.evidence()?.is_some() {
                    return Err(HmmError::SimulatedEvidence { step: number });
                }
            }
        }
        Ok(())
    }

    fn draw<R: Rng + ?Sized>(
        &self,
        belief: &[f64],
        steps_before: usize,
        controls: &[A::Control],
        rng: &mut R,
    ) -> Simulation<B::Sample> {
        let sample = |_: usize, state: usize, _: Option<&B::Sample>, rng: &mut R| {
            Ok::<_, Infallible>(self.likelihood().sample(state, rng))
        };
        let Ok(drawn) = self.draw_with(belief, steps_before, controls, rng, sample);
        drawn
    }
}

impl<A: TransitionEntries<Control = ()>, B: SampleNext> Hmm<A, B> {
    /// Draws a sequence of an autoregressive model: `steps` hidden states, and observations that
    /// each depend on the one before. `before` precedes the first.
    ///
    /// The same generator in the same state gives the same sequence. The cost is that of
    /// [`simulate`](Self::simulate).
    ///
    /// ```
    /// use rand::{Rng, RngExt};
    /// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
    /// use wayfix::likelihood::SampleNext;
    /// use wayfix::{Belief, DenseTransition, Diagonal, Hmm, Likelihood, LikelihoodError, Prior, Scratch};
    ///
    /// /// Pairs of a symbol and the next one: kept in state 0, changed in state 1, nine times of ten.
    /// struct Keeps;
    ///
    /// impl Likelihood for Keeps {
    ///     type Observation = [bool; 2];
    ///     fn states(&self) -> usize {
    ///         2
    ///     }
    ///     fn diagonal<'a>(
    ///         &'a self, [before, now]: &[bool; 2], scratch: &'a mut Scratch,
    ///     ) -> Result<Diagonal<'a>, LikelihoodError> {
    ///         let b = scratch.values(2);
    ///         b.copy_from_slice(if before == now { &[0.9, 0.1] } else { &[0.1, 0.9] });
    ///         Ok(Diagonal::linear(b))
    ///     }
    /// }
    ///
    /// impl SampleNext for Keeps {
    ///     type Sample = [bool; 2];
    ///     fn sample_next<R: Rng + ?Sized>(
    ///         &self, state: usize, &[_, last]: &[bool; 2], rng: &mut R,
    ///     ) -> Result<[bool; 2], LikelihoodError> {
    ///         let usual = last == (state == 0);
    ///         Ok([last, if rng.random_bool(0.9) { usual } else { !usual }])
    ///     }
    /// }
    ///
    /// let moves = DenseTransition::from_rows(&[[0.95, 0.05], [0.05, 0.95]])?;
    /// let hmm = Hmm::new(Prior::AtFirstObservation(Belief::uniform(2)?), moves, Keeps)?;
    /// let drawn = hmm.simulate_after(&[true, true], 100, &mut ChaCha8Rng::seed_from_u64(1))?;
    /// for pair in drawn.observations().windows(2) {
    ///     assert_eq!(pair[0][1], pair[1][0]);
    /// }
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`HmmError::Likelihood`] with the step whose observation cannot be drawn: the first if
    /// `before` is not valid, or one at which values grow beyond the range of doubles.
    pub fn simulate_after<R: Rng + ?Sized>(
        &self,
        before: &B::Observation,
        steps: usize,
        rng: &mut R,
    ) -> Result<Simulation<B::Sample>, HmmError> {
        self.draw_after(self.prior().belief().as_slice(), 0, before, steps, rng)
    }

    fn draw_after<R: Rng + ?Sized>(
        &self,
        belief: &[f64],
        steps_before: usize,
        before: &B::Observation,
        steps: usize,
        rng: &mut R,
    ) -> Result<Simulation<B::Sample>, HmmError> {
        let sample = |step: usize, state: usize, last: Option<&B::Sample>, rng: &mut R| {
            // The first observation depends on the given previous one.
            let last = last.map_or(before, Borrow::borrow);
            let drawn = self.likelihood().sample_next(state, last, rng);
            drawn.map_err(|cause| HmmError::likelihood(step, cause))
        };
        self.draw_with(belief, steps_before, &vec![(); steps], rng, sample)
    }
}

impl<A: TransitionEntries, B: Likelihood> Hmm<A, B> {
    /// Draws states, and for each an observation by `sample`, which gets the step, the state, and
    /// the previous observation if there is one.
    fn draw_with<Y, E, R: Rng + ?Sized>(
        &self,
        belief: &[f64],
        steps_before: usize,
        controls: &[A::Control],
        rng: &mut R,
        sample: impl Fn(usize, usize, Option<&Y>, &mut R) -> Result<Y, E>,
    ) -> Result<Simulation<Y>, E> {
        let mut state = index(belief.iter().copied().enumerate(), 1.0, rng);
        // If no move leads to the first step, the state just drawn is that of the step itself.
        let initial = self.prior().moves_at(steps_before + 1).then_some(state);
        let mut states = Vec::with_capacity(controls.len());
        let mut observations = Vec::with_capacity(controls.len());
        for (step, control) in (steps_before + 1..).zip(controls) {
            if self.prior().moves_at(step) {
                let entries = || self.transition().outgoing(control, state);
                let evidence = self.transition().evidence(control).is_some();
                // Columns sum to one, except those of an operator without control that has evidence
                // (evidence in a control was refused): their entries are weights.
                let total = if evidence { entries().map(|entry| entry.1).sum() } else { 1.0 };
                state = index(entries(), total, rng);
            }
            states.push(state);
            observations.push(sample(step, state, observations.last(), rng)?);
        }
        Ok(Simulation { initial, states, observations })
    }
}

impl<M, A, B> Filter<M>
where
    M: Deref<Target = Hmm<A, B>>,
    A: TransitionEntries,
    B: SampleObservation,
{
    /// Draws a possible future: the present state from the belief, then states and observations of
    /// the next `steps` steps. `initial` of the result is the present state. The filter is
    /// unchanged.
    ///
    /// ```
    /// # use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
    /// # let hmm = wayfix::canberra::hmm(5, 1.0)?;
    /// let mut filter = hmm.filter();
    /// filter.step(&4)?;
    /// let ahead = filter.simulate(10, &mut ChaCha8Rng::seed_from_u64(1));
    /// assert_eq!(ahead.states().len(), 10);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn simulate<R: Rng + ?Sized>(&self, steps: usize, rng: &mut R) -> Simulation<B::Sample>
    where
        A: TransitionEntries<Control = ()>,
    {
        self.model().draw(self.belief().as_slice(), self.steps(), &vec![(); steps], rng)
    }

    /// Draws a possible future under controls, one a step.
    ///
    /// # Errors
    ///
    /// As [`Hmm::simulate_with`].
    pub fn simulate_with<R: Rng + ?Sized>(
        &self,
        controls: &[A::Control],
        rng: &mut R,
    ) -> Result<Simulation<B::Sample>, HmmError> {
        self.model().check_controls(self.steps(), controls)?;
        Ok(self.model().draw(self.belief().as_slice(), self.steps(), controls, rng))
    }
}

impl<M, A, B> Filter<M>
where
    M: Deref<Target = Hmm<A, B>>,
    A: TransitionEntries<Control = ()>,
    B: SampleNext,
{
    /// Draws a possible future of an autoregressive model after its last observation, `before`;
    /// otherwise as [`simulate`](Self::simulate).
    ///
    /// # Errors
    ///
    /// As [`Hmm::simulate_after`]; steps are counted from the filter's first.
    pub fn simulate_after<R: Rng + ?Sized>(
        &self,
        before: &B::Observation,
        steps: usize,
        rng: &mut R,
    ) -> Result<Simulation<B::Sample>, HmmError> {
        self.model().draw_after(self.belief().as_slice(), self.steps(), before, steps, rng)
    }
}
