//! Standard errors of numbers that a model determines, with their covariances and intervals.
//!
//! Covariances are stored in factored form: one vector for each number, whose products with each
//! other are the covariances. So they are always a valid covariance matrix, whichever method made
//! them.

use wayfix::error::OutOfRange;
use wayfix::inference::{Displacement, FreeParameters, LearnError, LearningOptions};
use wayfix::internal::parallel;
use wayfix::likelihood::LearnLikelihood;
use wayfix::transition::LearnTransition;
use wayfix::{Belief, Hmm, Prior, Sequence};

use crate::curvature::{Fault, Information, Objective, extrapolated};
use crate::tails::normal_quantile;

/// Parameters of a learned model, or any other numbers that it determines, with their standard
/// errors.
///
/// Made by [`from_likelihood`](Self::from_likelihood), from the curvature of the likelihood, and by
/// [`from_jackknife`](Self::from_jackknife), from learning without some of the sequences.
#[derive(Debug, Clone, PartialEq)]
pub struct StandardErrors {
    values: Vec<f64>,
    errors: Vec<f64>,
    /// One vector for each number, whose products with each other are the covariances.
    spread: Vec<Vec<f64>>,
    at_bound: usize,
}

impl StandardErrors {
    pub(super) fn new(values: Vec<f64>, spread: Vec<Vec<f64>>, at_bound: usize) -> Self {
        let errors = spread.iter().map(|own| dot(own, own).sqrt()).collect();
        Self { values, errors, spread, at_bound }
    }

    /// The numbers, read from the model that was learned from all sequences.
    #[must_use]
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Standard error of each number.
    #[must_use]
    pub fn errors(&self) -> &[f64] {
        &self.errors
    }

    /// Covariance of the errors of two of the numbers, given by index: the square of the standard
    /// error for a number with itself, `None` if one does not exist. O(parameters), or O(groups)
    /// for the jackknife.
    #[must_use]
    pub fn covariance(&self, number: usize, other: usize) -> Option<f64> {
        Some(dot(self.spread.get(number)?, self.spread.get(other)?))
    }

    /// Number of parameters that were at a bound, such as probabilities of 0, and were treated as
    /// known; 0 for the jackknife, where they stay 0.
    ///
    /// Zeros of a prior, a dense operator or a table count, whether they were learned or given;
    /// moves that a sparse operator does not store don't.
    #[must_use]
    pub fn at_bound(&self) -> usize {
        self.at_bound
    }

    /// Returns the confidence interval of each number, (low, high), at a level such as 0.95: the
    /// number plus and minus the matching multiple of its standard error, which is right if errors
    /// are normal.
    ///
    /// An interval may exceed the range of its number. For a probability near 0 read the logit, for
    /// a positive number the logarithm, and transform the ends of the interval back:
    ///
    /// ```
    /// # use wayfix::inference::LearningOptions;
    /// # use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
    /// # use wayfix_learn::StandardErrors;
    /// // Seen twice in twelve hours: how probable is it in an hour?
    /// let hours = [0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0];
    /// let table = TableLikelihood::from_rows(&[[10.0 / 12.0, 2.0 / 12.0]])?;
    /// # let one = DenseTransition::from_rows(&[[1.0]])?;
    /// let hmm = Hmm::new(Prior::AtFirstObservation(Belief::uniform(1)?), one, table)?;
    /// let seen = |hmm: &Hmm<_, TableLikelihood>| hmm.likelihood().probability(0, 1).unwrap_or(0.0);
    /// let options = LearningOptions::default();
    /// let plain = StandardErrors::from_likelihood(&hmm, &[hours], &options, |hmm| vec![seen(hmm)])?;
    /// let (low, high) = plain.intervals(0.95)?[0];
    /// assert!(low < 0.0 && (high - 0.378).abs() < 1e-3); // 1/6 ± 1.96 √(5/36 / 12)
    ///
    /// let logit = |p: f64| (p / (1.0 - p)).ln();
    /// let logits = StandardErrors::from_likelihood(&hmm, &[hours], &options, |hmm| vec![logit(seen(hmm))])?;
    /// let (low, high) = logits.intervals(0.95)?[0];
    /// let probability = |logit: f64| 1.0 / (1.0 + (-logit).exp());
    /// assert!((probability(low) - 0.042).abs() < 1e-3 && (probability(high) - 0.477).abs() < 1e-3);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`LearnError::Parameter`] for a level that is not between 0 and 1.
    pub fn intervals(&self, level: f64) -> Result<Vec<(f64, f64)>, LearnError> {
        if !(level > 0.0 && level < 1.0) {
            let expected = "a value between 0 and 1";
            return Err(OutOfRange::new("the level of intervals", level, expected).into());
        }
        let width = -normal_quantile(0.5 * (1.0 - level));
        let each = self.values.iter().zip(&self.errors);
        Ok(each.map(|(value, error)| (value - width * error, value + width * error)).collect())
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    // Folded from 0, since `sum` of nothing is −0.
    a.iter().zip(b).fold(0.0, |sum, (a, b)| sum + a * b)
}

// Standard errors of learned parameters from the observed information, the negative Hessian of the
// log-likelihood at its maximum (Efron and Hinkley 1978; "Standard errors" in section 9 of the
// [formulas](wayfix::guide::formulas)).
//
// A model is displaced along its free parameters, and the objective evaluated there; `curvature`
// takes the differences.

impl StandardErrors {
    /// Returns standard errors, from the observed information, of numbers that `read` takes from
    /// a model, which was learned from these sequences with these options.
    ///
    /// The information is the negative second derivative of the log-likelihood of all sequences
    /// with respect to the free parameters of the model: those of the prior (unless it is
    /// [kept](LearningOptions::keep_prior) or [stationary](Prior::Stationary)), then those of the
    /// operator and the sensor, as defined by [`FreeParameters`]. Its inverse is their covariance,
    /// and the errors of the numbers follow by the delta method, with derivatives of `read`. So the
    /// order of states and the choice of parameters do not matter, and functions of what was
    /// learned have errors too: a mean stay, a share of time, a ratio.
    ///
    /// One long sequence is sufficient (Bickel, Ritov and Rydén 1998), whereas the
    /// [jackknife](Self::from_jackknife) needs many. But the errors are valid only if the model is true
    /// and its log-likelihood nearly quadratic over a few standard errors, as it is with much data.
    /// If the model may be wrong, use the jackknife. One sequence is a single draw from the prior,
    /// which cannot be learned from it: use `keep_prior`.
    ///
    /// Parameters at a bound have no standard error. Those exactly there, such as probabilities of
    /// 0, and those on their way there (the log-likelihood still rises along them, and their
    /// information is less than that of one observation) are treated as known, and
    /// [counted](StandardErrors::at_bound).
    ///
    /// With pseudo-counts, or parts that have priors, the objective of learning takes the place of
    /// the log-likelihood. The errors are then standard deviations of the posterior, if that is
    /// normal (Laplace's approximation). Without either, which is the usual choice, they are those
    /// of maximum likelihood.
    ///
    /// Derivatives are central differences with extrapolation. Compared with errors known in closed
    /// form, they are right within some 1e-7 of their size, with 250 parameters within 1e-5. Of the
    /// options, only `keep_prior` and the pseudo-counts matter. The cost for p parameters is that
    /// of 2 p² calls of [`Hmm::log_likelihood_all`] (in parallel with the
    /// feature `rayon`), 4 p calls of `read`, and O(p³). Memory: O(p²), and O(p) for each number
    /// that `read` returns.
    ///
    /// ```
    /// use wayfix::inference::LearningOptions;
    /// use wayfix_learn::StandardErrors;
    /// # use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
    /// # use wayfix::{Belief, DenseTransition, Fixed, Hmm, Prior, TableLikelihood};
    /// # let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
    /// # let camera = TableLikelihood::from_rows(&[[0.9, 0.1], [0.2, 0.8]])?;
    /// # let truth = Hmm::new(prior, DenseTransition::from_rows(&[[0.9, 0.3], [0.1, 0.7]])?, camera)?;
    /// # let mut rng = ChaCha8Rng::seed_from_u64(1);
    /// # let sequence = truth.simulate(2000, &mut rng).observations().to_vec();
    /// let options = LearningOptions::default().with_tolerance(1e-6).with_keep_prior(true);
    /// let learned = truth.learn(&[&sequence], &options)?.into_model();
    /// let stays = |hmm: &Hmm<DenseTransition, TableLikelihood>| {
    ///     let a = hmm.transition();
    ///     vec![a.get(0, 0), a.get(1, 1), 1.0 / (1.0 - a.get(0, 0))] // and a mean stay
    /// };
    /// let errors = StandardErrors::from_likelihood(&learned, &[&sequence], &options, stays)?;
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
    ///   a move out of a state that is never visited, or one of two states that are alike
    ///   (including a saddle point where learning left them alike);
    /// - [`LearnError::NotAtMaximum`] for a model that is further than a standard error from the
    ///   maximum, because it was learned from other sequences, or not to the end;
    /// - [`LearnError::Sequence`] for a sequence that the model rules out or that is not valid, and
    ///   [`LearnError::Nothing`] without observations;
    /// - [`LearnError::Displaced`] for a part that is not valid a small step away from this model,
    ///   although it is at other steps;
    /// - [`LearnError::Parameter`] for an option that is not valid, or if `read` returns numbers
    ///   that are not finite, or a varying number of them.
    pub fn from_likelihood<A, B, S>(
        hmm: &Hmm<A, B>,
        sequences: &[S],
        learning: &LearningOptions,
        read: impl Fn(&Hmm<A, B>) -> Vec<f64> + Sync,
    ) -> Result<Self, LearnError>
    where
        A: LearnTransition + FreeParameters + Sync,
        B: LearnLikelihood + FreeParameters + Sync,
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        learning.check()?;
        let logs = hmm.log_likelihood_all(sequences).into_iter().collect::<Result<Vec<_>, _>>()?;
        if sequences.iter().all(|sequence| sequence.steps() == 0) {
            return Err(LearnError::nothing(sequences.len(), None));
        }
        let log_prior = hmm.log_prior(learning);
        let difference = |by: &[f64]| {
            let model = displaced(hmm, &mut Displacement::new(by), learning)?.0;
            let mut sum = model.log_prior(learning) - log_prior;
            // Differences are taken for each sequence, before their total could round them away.
            for (found, log) in model.log_likelihood_all(sequences).into_iter().zip(&logs) {
                sum += found? - log;
            }
            Ok(sum)
        };
        // A displacement by nothing lists the free parameters, and counts those at a bound.
        let mut all = Displacement::new(&[]);
        let ends = displaced(hmm, &mut all, learning)?.1;
        let at_bound = all.at_bound();
        let seen = all.into_seen();
        let objective = Objective {
            difference,
            scales: seen.iter().map(|seen| seen.1).collect(),
            size: logs.iter().map(|log| log.abs()).sum::<f64>() + log_prior.abs(),
        };
        // Parameters are numbered across all parts: `ends` tells the part and the number within the
        // part.
        let name = |at: usize| {
            let parts = ["prior", "transition operator", "sensor"];
            let part = ends.iter().filter(|end| at >= **end).count();
            let first = if part == 0 { 0 } else { ends[part - 1] };
            (parts[part], at - first, seen[at].0)
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
        let values = checked(read(hmm), None)?;
        let spread = spread(hmm, &information, [seen.len(), values.len()], learning, |model| {
            checked(read(model), Some(values.len()))
        })?;
        Ok(Self::new(values, spread, at_bound))
    }
}

/// Returns the model with its free parameters displaced, and the number of parameters up to the
/// end of the prior and up to that of the operator.
fn displaced<A, B>(
    hmm: &Hmm<A, B>,
    by: &mut Displacement<'_>,
    learning: &LearningOptions,
) -> Result<(Hmm<A, B>, [usize; 2]), LearnError>
where
    A: LearnTransition + FreeParameters,
    B: LearnLikelihood + FreeParameters,
{
    let belief = hmm.prior().belief();
    let is_stationary = matches!(hmm.prior(), Prior::Stationary(_));
    let belief = if learning.keep_prior || is_stationary {
        belief.clone()
    } else {
        let mut weights = belief.as_slice().to_vec();
        by.distribution(&mut weights);
        Belief::from_weights(weights).map_err(LearnError::Prior)?
    };
    let of_prior = by.count();
    let transition = hmm.transition().displaced(by).map_err(LearnError::displaced)?;
    let of_transition = by.count();
    let prior = match hmm.prior() {
        // Kept in the same way as in learning: the same numbers with another operator.
        Prior::Stationary(_) if learning.keep_prior => Prior::AtFirstObservation(belief),
        Prior::Stationary(_) => Prior::stationary(&transition).map_err(LearnError::displaced)?,
        prior => prior.with_belief(belief),
    };
    let likelihood = hmm.likelihood().displaced(by).map_err(LearnError::displaced)?;
    let model = Hmm::new(prior, transition, likelihood).map_err(LearnError::displaced)?;
    Ok((model.rounding_tails(hmm.rounds_tails()), [of_prior, of_transition]))
}

/// Returns one vector for each number that `read` takes, whose products are the covariances
/// g' I⁻¹ h: the derivatives g along the coordinates, times a root of the inverse information.
/// `count` is the number of all coordinates.
fn spread<A, B>(
    hmm: &Hmm<A, B>,
    information: &Information,
    [count, numbers]: [usize; 2],
    learning: &LearningOptions,
    read: impl Fn(&Hmm<A, B>) -> Result<Vec<f64>, LearnError> + Sync,
) -> Result<Vec<Vec<f64>>, LearnError>
where
    A: LearnTransition + FreeParameters + Sync,
    B: LearnLikelihood + FreeParameters + Sync,
{
    // Central differences at ± the step and ± half of it, extrapolated, for one coordinate and
    // all numbers.
    let derivatives = |at: usize, (): &mut ()| {
        let step = information.steps[at];
        let read_at = |h: f64| {
            let mut by = vec![0.0; count];
            by[information.coordinates[at]] = h;
            read(&displaced(hmm, &mut Displacement::new(&by), learning)?.0)
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

/// Returns the numbers from the caller's function, if they are finite and as many as expected.
fn checked(values: Vec<f64>, expected: Option<usize>) -> Result<Vec<f64>, LearnError> {
    if let Some(at) = values.iter().position(|value| !value.is_finite()) {
        let what = format!("number {at} that `read` returns");
        return Err(OutOfRange::new(what, values[at], "a finite value").into());
    }
    if expected.is_some_and(|expected| expected != values.len()) {
        let (what, found) = ("the number of values that `read` returns", values.len() as f64);
        return Err(OutOfRange::new(what, found, "as many as for the model itself").into());
    }
    Ok(values)
}

// Standard errors of learned parameters by the grouped jackknife (Tukey 1958; Efron and Stein
// 1981): learning again without each group of sequences.
//
// For G groups and a number v, with v_g learned without group g and m the mean of the v_g, the
// variance is (G − 1) / G · Σ (v_g − m)².

impl StandardErrors {
    /// Returns standard errors, by the jackknife (Tukey 1958; Efron and Stein 1981), of numbers
    /// that `read` takes from a model, which was learned from these sequences.
    ///
    /// The model is learned again, starting from itself, without each of `groups` groups of
    /// sequences (sequence s is in group s modulo `groups`). The errors measure the spread of the
    /// results: for G groups, the root of (G − 1) / G times the sum of squares about their mean.
    ///
    /// With one group for each sequence and many sequences, this estimates the same as the sandwich
    /// of derivatives (White 1982), so that it also holds for models that are not true. But the
    /// sequences must be independent of each other, and the parameters not at a bound. A single
    /// long sequence may be cut into pieces that are much longer than a state lasts. Learn to a
    /// small tolerance: differences that unfinished learning leaves count as errors.
    ///
    /// Runs in parallel with the feature `rayon`. The cost is that of learning G times from a good
    /// start. For one sequence, or a few, see [`from_likelihood`](Self::from_likelihood).
    ///
    /// ```
    /// use wayfix::inference::LearningOptions;
    /// use wayfix_learn::StandardErrors;
    /// # use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
    /// # use wayfix::{Belief, DenseTransition, Fixed, Hmm, Prior, TableLikelihood};
    /// # let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
    /// # let camera = TableLikelihood::from_rows(&[[0.9, 0.1], [0.2, 0.8]])?;
    /// # let truth = Hmm::new(prior, DenseTransition::from_rows(&[[0.9, 0.3], [0.1, 0.7]])?, Fixed(camera))?;
    /// # let mut rng = ChaCha8Rng::seed_from_u64(1);
    /// # let sequences: Vec<Vec<usize>> = (0..60).map(|_| truth.simulate(30, &mut rng).observations().to_vec()).collect();
    /// let options = LearningOptions::default().with_tolerance(1e-6).with_keep_prior(true);
    /// let learned = truth.learn(&sequences, &options)?.into_model();
    /// let stay = |hmm: &Hmm<_, _>| -> Vec<f64> {
    ///     let a: &DenseTransition = hmm.transition();
    ///     vec![a.get(0, 0), a.get(1, 1)]
    /// };
    /// let errors = StandardErrors::from_jackknife(&learned, &sequences, 20, &options, stay)?;
    /// for (value, error) in errors.values().iter().zip(errors.errors()) {
    ///     println!("{value:.3} ± {error:.3}");
    /// }
    /// # assert!((errors.values()[0] - 0.9).abs() < 3.0 * errors.errors()[0]);
    /// # assert!((errors.values()[1] - 0.7).abs() < 3.0 * errors.errors()[1]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`LearnError::Groups`] for fewer than two groups, or fewer sequences than groups;
    /// [`LearnError::Sequence`] for a sequence that the model rules out or that is not valid; and
    /// the first error of learning.
    pub fn from_jackknife<A, B, S>(
        hmm: &Hmm<A, B>,
        sequences: &[S],
        groups: usize,
        learning: &LearningOptions,
        read: impl Fn(&Hmm<A, B>) -> Vec<f64> + Sync,
    ) -> Result<Self, LearnError>
    where
        A: LearnTransition,
        B: LearnLikelihood,
        Hmm<A, B>: Clone + Sync,
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        if groups < 2 || sequences.len() < groups {
            return Err(LearnError::Groups { groups, sequences: sequences.len() });
        }
        let all: Vec<(usize, &S)> = sequences.iter().enumerate().collect();
        // A sequence that learning would leave out would still count as part of its group.
        if let Some(error) = hmm.expectations_of(&all).1.into_iter().next() {
            return Err(error.into());
        }
        // Groups are interleaved, so that all of them share any trend along the list.
        let without = |group: usize, (): &mut ()| {
            let all = sequences.iter().enumerate();
            let others: Vec<&S> = all.filter(|(s, _)| s % groups != group).map(|s| s.1).collect();
            hmm.learn(&others, learning).map(|learned| read(learned.model()))
        };
        let results = parallel::map((0..groups).collect(), without);
        let results = results.into_iter().collect::<Result<Vec<Vec<f64>>, LearnError>>()?;
        let count = groups as f64;
        let values = read(hmm);
        let spread = |number: usize| -> Vec<f64> {
            let found = || results.iter().filter_map(|values| values.get(number));
            // About the mean of the results, not the values of this model, so that the bias of
            // learning, which is common to all, does not count. The sum of squares of this vector
            // is the variance, its product with another the covariance.
            let mean = found().sum::<f64>() / count;
            found().map(|v| (v - mean) * ((count - 1.0) / count).sqrt()).collect()
        };
        let spread = (0..values.len()).map(spread).collect();
        Ok(Self::new(values, spread, 0))
    }
}
