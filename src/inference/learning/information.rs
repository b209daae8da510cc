//! Standard errors of learned parameters, from the observed information: the negative Hessian of
//! the log-likelihood at its maximum (Efron and Hinkley 1978).

use super::curvature::{Fault, Information, Objective, extrapolated};
use super::learned_model::LearningOptions;
use super::standard_errors::StandardErrors;
use crate::belief::Belief;
use crate::error::{LearnError, Parameter};
use crate::free_parameters::{Displacement, FreeParameters};
use crate::hmm::{Hmm, Prior};
use crate::inference::engines::parallel;
use crate::likelihood::LearnLikelihood;
use crate::sequence::Sequence;
use crate::transition::LearnTransition;

impl<A, B> Hmm<A, B>
where
    A: LearnTransition + FreeParameters + Sync,
    B: LearnLikelihood + FreeParameters + Sync,
{
    /// Returns standard errors of numbers that `read` takes from this model, which was learned
    /// from these sequences with these options, from the observed information.
    ///
    /// The information is minus the second derivative of the log-likelihood of all sequences in the
    /// free parameters of the model: those of the prior (unless it is
    /// [kept](LearningOptions::keep_prior) or [stationary](Prior::Stationary)), then those of the
    /// operator and the sensor, as [`FreeParameters`] takes them. Its inverse is their covariance,
    /// and the errors of the numbers follow by the delta method, with derivatives of `read`. So the
    /// order of states and the choice of parameters do not matter, and a function of what was
    /// learned has an error too: a mean stay, a share of time, a ratio.
    ///
    /// One long sequence is enough (Bickel, Ritov and Rydén 1998), where the
    /// [jackknife](Self::jackknife) needs many; but errors hold only if the model is true, and its
    /// log-likelihood nearly quadratic over some standard errors, as with much data. Where the
    /// model is wrong, take the jackknife. The prior of one sequence is known from a single draw:
    /// learn it with `keep_prior`.
    ///
    /// Parameters at a bound have no standard error. Those that are there exactly, such as
    /// probabilities of 0, and those on the way (of which an observation more would tell less than
    /// of any other, while the log-likelihood still rises as they go) are taken as known, and
    /// [counted](StandardErrors::at_bound).
    ///
    /// With pseudo-counts, or parts that have priors, the objective of learning takes the place of
    /// the log-likelihood: the errors are then deviations of the posterior, if it is normal
    /// (Laplace's approximation). Without any, which is the usual choice, they are those of maximum
    /// likelihood.
    ///
    /// Derivatives are central differences with extrapolation; where the errors are known in closed
    /// form, they are right within some 1e-7 of their size, with 250 parameters within 1e-5. Of the
    /// options, only `keep_prior` and the pseudo-counts count. The cost, for p parameters, is that
    /// of 2 p² calls of [`log_likelihood_all`](Self::log_likelihood_all), in parallel with the
    /// feature `rayon`, of 4 p calls of `read`, and O(p³). Memory: O(p²), and O(p) for each number
    /// that `read` returns.
    ///
    /// ```
    /// use wayfix::inference::LearningOptions;
    /// # use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
    /// # use wayfix::{Belief, DenseTransition, Fixed, Hmm, Prior, TableLikelihood};
    /// # let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
    /// # let camera = TableLikelihood::from_rows(&[[0.9, 0.1], [0.2, 0.8]])?;
    /// # let truth = Hmm::new(prior, DenseTransition::from_rows(&[[0.9, 0.3], [0.1, 0.7]])?, camera)?;
    /// # let mut rng = ChaCha8Rng::seed_from_u64(1);
    /// # let sequence = truth.simulate(2000, &mut rng).observations().to_vec();
    /// let options = LearningOptions { tolerance: 1e-6, keep_prior: true, ..LearningOptions::default() };
    /// let learned = truth.learn(&[&sequence], &options)?.into_model();
    /// let stays = |hmm: &Hmm<DenseTransition, TableLikelihood>| {
    ///     let a = hmm.transition();
    ///     vec![a.get(0, 0), a.get(1, 1), 1.0 / (1.0 - a.get(0, 0))] // and a mean stay
    /// };
    /// let errors = learned.standard_errors(&[&sequence], &options, stays)?;
    /// for (value, (low, high)) in errors.values().iter().zip(errors.intervals(0.95)?) {
    ///     println!("{value:.3}, between {low:.3} and {high:.3}");
    /// }
    /// # assert!((errors.values()[0] - 0.9).abs() < 3.0 * errors.errors()[0]);
    /// # assert!((errors.values()[1] - 0.7).abs() < 3.0 * errors.errors()[1]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// - [`LearnError::NotDetermined`] for a parameter that the sequences do not determine, such as
    /// a move out of a state that is never visited, or those of two states that are alike, also at
    /// a saddle where learning left them so;
    /// - [`LearnError::NotAtMaximum`] for a model that is further from the maximum than a standard
    ///   error, which is checked: the model was learned from other sequences, or not to the end;
    /// - [`LearnError::Sequence`] for a sequence that the model rules out or that is not valid, and
    ///   [`LearnError::Nothing`] without observations;
    /// - [`LearnError::Displaced`] for a part that is not valid a small step from here, though it is
    ///   at other steps;
    /// - [`LearnError::Parameter`] for an option that is not valid, or numbers from `read` that are
    ///   not finite or not always as many.
    pub fn standard_errors<S>(
        &self,
        sequences: &[S],
        learning: &LearningOptions,
        read: impl Fn(&Self) -> Vec<f64> + Sync,
    ) -> Result<StandardErrors, LearnError>
    where
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        learning.check()?;
        let logs = self.log_likelihood_all(sequences).into_iter().collect::<Result<Vec<_>, _>>()?;
        if sequences.iter().all(|sequence| sequence.steps() == 0) {
            return Err(LearnError::nothing(sequences.len(), None));
        }
        let log_prior = self.log_prior(learning);
        let difference = |by: &[f64]| {
            let model = self.displaced(&mut Displacement::new(by), learning)?.0;
            let mut sum = model.log_prior(learning) - log_prior;
            // Sequence by sequence, so that their sum does not round the differences.
            for (found, log) in model.log_likelihood_all(sequences).into_iter().zip(&logs) {
                sum += found? - log;
            }
            Ok(sum)
        };
        let mut all = Displacement::new(&[]);
        let ends = self.displaced(&mut all, learning)?.1;
        let at_bound = all.at_bound();
        let seen = all.into_seen();
        let objective = Objective {
            difference,
            scales: seen.iter().map(|seen| seen.scale).collect(),
            size: logs.iter().map(|log| log.abs()).sum::<f64>() + log_prior.abs(),
        };
        let name = |at: usize| {
            let parts = ["prior", "transition operator", "sensor"];
            let part = ends.iter().filter(|end| at >= **end).count();
            let first = if part == 0 { 0 } else { ends[part - 1] };
            (parts[part], at - first, seen[at].value)
        };
        let information = objective.information().map_err(|fault| match fault {
            Fault::Failed(error) => error,
            Fault::Flat(at) => {
                let (part, number, value) = name(at);
                LearnError::NotDetermined { part, number, value }
            }
            Fault::Rises(at) => {
                let (part, number, value) = name(at);
                LearnError::NotAtMaximum { part, number, value }
            }
        })?;
        let at_bound = at_bound + seen.len() - information.coordinates.len();
        let values = checked(read(self), None)?;
        let spread = self.spread(&information, [seen.len(), values.len()], learning, |model| {
            checked(read(model), Some(values.len()))
        })?;
        Ok(StandardErrors::new(values, spread, at_bound))
    }

    /// The model with its free parameters moved, and the numbers of them that end with the prior
    /// and with the operator.
    fn displaced(
        &self,
        by: &mut Displacement<'_>,
        learning: &LearningOptions,
    ) -> Result<(Self, [usize; 2]), LearnError> {
        let belief = self.prior().belief();
        let is_stationary = matches!(self.prior(), Prior::Stationary(_));
        let belief = if learning.keep_prior || is_stationary {
            belief.clone()
        } else {
            let mut weights = belief.as_slice().to_vec();
            by.distribution(&mut weights);
            Belief::from_weights(weights)?
        };
        let of_prior = by.count();
        let transition = self.transition().displaced(by).map_err(LearnError::displaced)?;
        let of_transition = by.count();
        let prior = match self.prior() {
            // Kept as learning keeps it: the same numbers above another operator.
            Prior::Stationary(_) if learning.keep_prior => Prior::AtFirstObservation(belief),
            Prior::Stationary(_) => {
                Prior::stationary(&transition).map_err(LearnError::displaced)?
            }
            prior => prior.with_belief(belief),
        };
        let likelihood = self.likelihood().displaced(by).map_err(LearnError::displaced)?;
        let model = Self::new(prior, transition, likelihood).map_err(LearnError::displaced)?;
        Ok((model.rounding_tails(self.rounds_tails()), [of_prior, of_transition]))
    }

    /// A vector for each number that `read` takes, whose products are the covariances: derivatives
    /// along the coordinates, times the root of the inverse information. `count` coordinates lead
    /// to so many numbers.
    fn spread(
        &self,
        information: &Information,
        [count, numbers]: [usize; 2],
        learning: &LearningOptions,
        read: impl Fn(&Self) -> Result<Vec<f64>, LearnError> + Sync,
    ) -> Result<Vec<Vec<f64>>, LearnError> {
        let derivatives = |at: usize, (): &mut ()| {
            let step = information.steps[at];
            let read_at = |h: f64| {
                let mut by = vec![0.0; count];
                by[information.coordinates[at]] = h;
                read(&self.displaced(&mut Displacement::new(&by), learning)?.0)
            };
            let ends = |h: f64| Ok::<_, LearnError>((read_at(h)?, read_at(-h)?, 2.0 * h));
            let (whole, half) = (ends(step)?, ends(step / 2.0)?);
            let slope = |(up, down, width): &(Vec<f64>, Vec<f64>, f64), number: usize| {
                (up[number] - down[number]) / width
            };
            let each = (0..whole.0.len())
                .map(|number| extrapolated([slope(&whole, number), slope(&half, number)]));
            Ok(each.collect())
        };
        let columns = parallel::map((0..information.coordinates.len()).collect(), derivatives);
        let columns = columns.into_iter().collect::<Result<Vec<Vec<f64>>, LearnError>>()?;
        let row = |number: usize| {
            let mut row: Vec<f64> = columns.iter().map(|column| column[number]).collect();
            information.solve(&mut row);
            row
        };
        Ok((0..numbers).map(row).collect())
    }
}

/// Numbers that a function of the caller's has read, if they are finite and as many as expected.
fn checked(values: Vec<f64>, expected: Option<usize>) -> Result<Vec<f64>, LearnError> {
    if let Some(at) = values.iter().position(|value| !value.is_finite()) {
        let what = format!("number {at} that `read` returns");
        return Err(Parameter::new(what, values[at], "a finite value").into());
    }
    if expected.is_some_and(|expected| expected != values.len()) {
        let (what, found) = ("the number of values that `read` returns", values.len() as f64);
        return Err(Parameter::new(what, found, "as many as for the model itself").into());
    }
    Ok(values)
}
