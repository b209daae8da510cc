//! Expected statistics of the hidden states: the result of the E-step, and the input of the M-step
//! (section 9 of the [formulas](crate::guide::formulas)).
//!
//! They are sums over sequences, so that those of different parts of the data can be added.

use std::fmt;

use crate::hmm::Hmm;
use crate::inference::LogSum;
use crate::likelihood::LearnLikelihood;
use crate::transition::{LearnTransition, MoveCounts};

/// Expected statistics of the hidden states of sequences, given their observations: the E-step of
/// Baum–Welch.
///
/// Made by [`Hmm::expectations`]. Those of several parts of the data are
/// [added](Hmm::merge_expectations), and [`Hmm::maximize`] computes the next model from the sum.
///
/// To add those of several machines, send their fields, and reassemble them by
/// [`new`](Self::new). The fields are plain numbers if the statistics are. Those of tables, counts,
/// durations and directions are; those of the Gaussian families cannot be sent.
///
/// ```
/// use wayfix::inference::{Expectations, LearningOptions};
/// # use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
/// # let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
/// # let camera = TableLikelihood::from_rows(&[[0.7, 0.3], [0.3, 0.7]])?;
/// # let hmm = Hmm::new(prior, DenseTransition::from_rows(&[[0.6, 0.4], [0.4, 0.6]])?, camera)?;
///
/// let (mut sum, failed) = hmm.expectations(&[[0, 0, 0, 1], [0, 1, 1, 1]]);
/// assert!(failed.is_empty());
/// let (others, _) = hmm.expectations(&[[1, 1, 1, 1], [0, 0, 1, 1]]); // another part of the data
/// hmm.merge_expectations(&mut sum, &others);
/// assert!((sum.first().iter().sum::<f64>() - 4.0).abs() < 1e-12);
///
/// let options = LearningOptions::default();
/// let next = hmm.maximize(&sum, &options)?;
/// let (after, _) = next.expectations(&[[0, 0, 0, 1], [0, 1, 1, 1], [1, 1, 1, 1], [0, 0, 1, 1]]);
/// assert!(after.log_likelihood() > sum.log_likelihood());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Expectations<B: LearnLikelihood, M = MoveCounts> {
    /// Σ p(X_0 | y_1 … y_T), or of X_1, over the sequences.
    pub(crate) first: Vec<f64>,
    pub(crate) moves: M,
    pub(crate) sensor: B::Statistics,
    pub(crate) log_likelihood: LogSum,
}

impl<B: LearnLikelihood, M> fmt::Debug for Expectations<B, M> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut fields = f.debug_struct("Expectations");
        fields.field("log_likelihood", &self.log_likelihood()).finish_non_exhaustive()
    }
}

impl<B: LearnLikelihood, M> Expectations<B, M> {
    /// Creates expectations from their fields, which [`Hmm::maximize`] checks.
    #[must_use]
    pub fn new(first: Vec<f64>, moves: M, sensor: B::Statistics, log_likelihood: f64) -> Self {
        let log_likelihood = LogSum { sum: log_likelihood, lost: 0.0 };
        Self { first, moves, sensor, log_likelihood }
    }

    /// Expected number of sequences that start in each state: before the first transition or at
    /// the first observation, depending on the prior of the model.
    #[must_use]
    pub fn first(&self) -> &[f64] {
        &self.first
    }

    /// [Statistics](LearnTransition::Statistics) of the moves.
    #[must_use]
    pub fn moves(&self) -> &M {
        &self.moves
    }

    /// Statistics of the sensor.
    #[must_use]
    pub fn sensor(&self) -> &B::Statistics {
        &self.sensor
    }

    /// Log-likelihood of all observations.
    #[must_use]
    pub fn log_likelihood(&self) -> f64 {
        self.log_likelihood.value()
    }
}

impl<A: LearnTransition, B: LearnLikelihood> Hmm<A, B> {
    /// Expectations of no sequences, to start a sum with.
    #[must_use]
    pub fn no_expectations(&self) -> Expectations<B, A::Statistics> {
        Expectations {
            first: vec![0.0; self.states()],
            moves: self.transition().statistics(),
            sensor: self.likelihood().statistics(),
            log_likelihood: LogSum::default(),
        }
    }

    /// Adds expectations of other sequences. The caller must ensure that they were computed under
    /// this model: a sum over different models is meaningless, and [`maximize`](Self::maximize)
    /// detects only some of these. O(n + moves + statistics).
    pub fn merge_expectations(
        &self,
        sum: &mut Expectations<B, A::Statistics>,
        other: &Expectations<B, A::Statistics>,
    ) {
        sum.first.iter_mut().zip(&other.first).for_each(|(sum, p)| *sum += p);
        self.transition().merge(&mut sum.moves, &other.moves);
        self.likelihood().merge(&mut sum.sensor, &other.sensor);
        sum.log_likelihood.add(other.log_likelihood.value());
    }
}
