//! Expected sufficient statistics of drives: the E-step of Baum–Welch (formulas, section 9).
//!
//! They are sums over drives, so batches, threads and processes can compute them apart and
//! [`merge`](Expected::merge) them. Floating-point addition is not associative: callers merge in a
//! fixed order if the result must not depend on the number of threads.

use wayfix::error::At;
use wayfix::inference::{Expectations, LearningOptions};
use wayfix::transition::{LearnTransition, MoveCounts};
use wayfix::{Hmm, HmmError};
#[cfg(feature = "sql")]
use wayfix::{likelihood::LearnLikelihood, transition::Move};

use crate::error::{FleetError, Outcome};
use crate::input::Drives;
use crate::sensor::Sensor;

/// Expectations of some drives, as processes exchange them.
#[cfg(feature = "sql")]
#[derive(Debug, serde::Serialize, serde::Deserialize)]
pub(crate) struct Sums {
    first: Vec<f64>,
    /// Moves: the state left, the state reached, and the weight.
    moves: Vec<(usize, usize, f64)>,
    sensor: Vec<f64>,
    log_likelihood: f64,
    drives: u64,
    left_out: u64,
}

/// Expectations of some drives under a model.
#[derive(Debug)]
pub(crate) struct Expected {
    sum: Expectations<Sensor>,
    /// Number of drives.
    pub(crate) drives: u64,
    /// Number of drives that the model rules out; they are not in the sum.
    pub(crate) left_out: u64,
}

impl Expected {
    /// Expectations of no drives, the neutral element of `merge`.
    pub(crate) fn nothing<A>(hmm: &Hmm<A, Sensor>) -> Self
    where
        A: LearnTransition<Control = (), Statistics = MoveCounts>,
    {
        Self { sum: hmm.no_expectations(), drives: 0, left_out: 0 }
    }

    /// Expectations of a batch. Drives that the model rules out are left out; an invalid
    /// observation is an error.
    pub(crate) fn of<A>(hmm: &Hmm<A, Sensor>, drives: &Drives) -> Outcome<Self>
    where
        A: LearnTransition<Control = (), Statistics = MoveCounts> + Sync,
    {
        let all = drives.observations()?;
        let each: Vec<_> =
            drives.offsets.windows(2).map(|drive| &all[drive[0]..drive[1]]).collect();
        let (sum, failed) = hmm.expectations(&each);
        for error in &failed {
            if let HmmError::Likelihood(At { number: step, cause, .. }) = &error.source {
                // Errors count steps from 1.
                let element = drives.offsets[error.sequence] + step - 1;
                return Err(drives.refuse(element, &cause.to_string()));
            }
        }
        Ok(Self { sum, drives: each.len() as u64, left_out: failed.len() as u64 })
    }

    /// Returns the sums.
    #[cfg(feature = "sql")]
    pub(crate) fn sums(&self) -> Sums {
        let moves = self.sum.moves().moves();
        Sums {
            first: self.sum.first().to_vec(),
            moves: moves.map(|m| (m.from, m.to, m.weight)).collect(),
            sensor: self.sum.sensor().clone(),
            log_likelihood: self.sum.log_likelihood(),
            drives: self.drives,
            left_out: self.left_out,
        }
    }

    /// Expectations with these sums, which must belong to this model.
    #[cfg(feature = "sql")]
    pub(crate) fn from_sums<A>(hmm: &Hmm<A, Sensor>, sums: Sums) -> Outcome<Self>
    where
        A: LearnTransition<Control = (), Statistics = MoveCounts>,
    {
        let Sums { first, moves, sensor, log_likelihood, drives, left_out } = sums;
        // Sums of another model would otherwise be added up silently, or index out of bounds in the
        // M-step.
        let known = hmm.likelihood().statistics().len();
        if (first.len(), sensor.len()) != (hmm.states(), known) {
            let message = "the expectations of two models cannot be added up".to_owned();
            return Err(FleetError::Learning(message));
        }
        let moves = moves.into_iter().map(|(from, to, weight)| Move { from, to, weight });
        let moves = MoveCounts::from_moves(moves);
        let sum = Expectations::new(first, moves, sensor, log_likelihood);
        Ok(Self { sum, drives, left_out })
    }

    /// Adds the expectations of other drives.
    pub(crate) fn merge<A>(&mut self, hmm: &Hmm<A, Sensor>, other: &Self)
    where
        A: LearnTransition<Control = (), Statistics = MoveCounts>,
    {
        self.sum.merge(hmm, &other.sum);
        self.drives += other.drives;
        self.left_out += other.left_out;
    }

    /// Size of the sums in numbers, a move counted as three.
    #[cfg(feature = "sql")]
    pub(crate) fn numbers(&self) -> usize {
        self.sum.first().len() + self.sum.sensor().len() + 3 * self.sum.moves().moves().len()
    }

    /// Log-likelihood of all drives that are not left out.
    pub(crate) fn log_likelihood(&self) -> f64 {
        self.sum.log_likelihood()
    }

    /// Returns the model that maximises the expected log-likelihood: the M-step.
    pub(crate) fn maximize<A>(
        &self,
        hmm: &Hmm<A, Sensor>,
        keep_prior: bool,
    ) -> Outcome<Hmm<A, Sensor>>
    where
        A: LearnTransition<Control = (), Statistics = MoveCounts>,
    {
        let options = LearningOptions::default().with_keep_prior(keep_prior);
        let learned = hmm.maximize(&self.sum, &options);
        learned.map_err(|error| FleetError::Learning(error.to_string()))
    }
}
