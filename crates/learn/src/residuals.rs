//! Pseudo-residuals: the positions of observations in the distributions that a model predicts.
//!
//! Both kinds mix the states' tails P(Y ≤ y_k | X_k = i). For forecast residuals the weights are
//! p(X_k = i | y_1 … y_{k−1}), for ordinary ones p(X_k = i | all but y_k), which is proportional to
//! the prediction times the backward probability.

use super::{Marginals, Tails};
use crate::family::check_component;
use wayfix::Hmm;
use wayfix::HmmError;
use wayfix::Sequence;
use wayfix::Transition;
use wayfix::internal::left_out;

/// Two kinds of pseudo-residuals of a sequence. Those of step k are at index k − 1, `None` where
/// the observation is missing.
///
/// Made by [`new`](Self::new).
#[derive(Debug, Clone, PartialEq)]
pub struct PseudoResiduals {
    forecast: Vec<Option<Tails>>,
    ordinary: Vec<Option<Tails>>,
}

impl PseudoResiduals {
    /// Returns the pseudo-residuals of a component of the observations (0 where they are single
    /// numbers): the probabilities below, at and above each number, given the observations before
    /// it and given all others (Zucchini, MacDonald and Langrock, *Hidden Markov Models for Time
    /// Series*, 2016, section 6.2).
    ///
    /// As [uniform](Tails::uniform) or [normal](Tails::normal) values they show what a model gets
    /// wrong: a QQ plot of the normal values shows the shape of its distributions, their course
    /// over time a change, and their autocorrelation what the states do not remember. For counts
    /// use [segments](Tails::segment) or [randomised](Tails::randomized) values.
    ///
    /// If observations have several components, none of the step itself is known, and all of the
    /// other steps are. Evidence on moves is known as well, for forecast residuals up to the step.
    ///
    /// Each step costs a product with A, one with A' in logarithms, which takes some ten times as
    /// long, and the [tails](Marginals::tails) in n states. Memory: 2 n T numbers.
    ///
    /// ```
    /// use wayfix_learn::{Poisson, PseudoResiduals, Tails};
    /// use wayfix::{Belief, DenseTransition, Hmm, Prior};
    ///
    /// let hmm = Hmm::new(
    ///     Prior::AtFirstObservation(Belief::uniform(2)?),
    ///     DenseTransition::from_rows(&[[0.9, 0.1], [0.1, 0.9]])?,
    ///     Poisson::family(&[[2.0], [10.0]])?,
    /// )?;
    /// let counts = [[3.0], [1.0], [2.0], [9.0], [40.0], [11.0]];
    /// let residuals = PseudoResiduals::new(&hmm, &counts, 0)?;
    /// let normal: Vec<f64> = residuals.forecast().iter().flatten().map(Tails::normal).collect();
    /// assert!(normal[4] > 6.0); // the model does not expect 40
    /// assert!(normal.iter().filter(|z| z.abs() > 2.0).count() == 1);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`HmmError`] with the step at which an observation is impossible or invalid, or a
    /// control is invalid; with step 1 if the component does not exist.
    pub fn new<A, B, S>(hmm: &Hmm<A, B>, sequence: &S, component: usize) -> Result<Self, HmmError>
    where
        A: Transition,
        B: Marginals,
        S: Sequence<A::Control, B::Observation> + ?Sized,
    {
        let likelihood = hmm.likelihood();
        check_component(likelihood, component)
            .map_err(|error| HmmError::likelihood(1, error.into()))?;
        let (n, steps) = (hmm.states(), sequence.steps());
        let beliefs = left_out(hmm, sequence)?;
        let rows = beliefs.predicted.chunks_exact(n).zip(beliefs.others.chunks_exact(n));
        let mut found = [Vec::with_capacity(steps), Vec::with_capacity(steps)];
        for (step, (predicted, others)) in (1..).zip(rows) {
            let number = likelihood.number(sequence.observation(step), component);
            let number = number.map_err(|error| HmmError::likelihood(step, error))?;
            let mixed = number.map(|y| {
                let mut mixed = [Tails::default(); 2];
                for (state, shares) in predicted.iter().zip(others).enumerate() {
                    // Tails cost far more than this test, and a state with neither share adds
                    // nothing.
                    if *shares.0 > 0.0 || *shares.1 > 0.0 {
                        let tails = likelihood.tails(state, component, y);
                        mixed[0].add(*shares.0, tails);
                        mixed[1].add(*shares.1, tails);
                    }
                }
                mixed
            });
            found[0].push(mixed.map(|mixed| mixed[0]));
            found[1].push(mixed.map(|mixed| mixed[1]));
        }
        let [forecast, ordinary] = found;
        Ok(Self { forecast, ordinary })
    }

    /// Forecast residuals, one step ahead: P(Y_k ≤ y_k | y_1 … y_{k-1}). If the model is right,
    /// they are independent, and their normal values are standard normal.
    #[must_use]
    pub fn forecast(&self) -> &[Option<Tails>] {
        &self.forecast
    }

    /// Ordinary residuals, given all other observations:
    /// P(Y_k ≤ y_k | y_1 … y_{k-1}, y_{k+1} … y_T). If the model is right, each is uniform by
    /// itself, but neighbours are dependent. They find outliers, which contradict the observations
    /// on both sides.
    #[must_use]
    pub fn ordinary(&self) -> &[Option<Tails>] {
        &self.ordinary
    }
}
