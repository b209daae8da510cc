//! Choice among models: information criteria and the likelihood of held-out sequences.

use std::fmt;

use super::baum_welch::{LearnedModel, StopReason};
use crate::error::{InferenceError, LearnError, SequenceError};
use crate::hmm::Hmm;
use crate::inference::LogSum;
use crate::inference::engines::parallel;
use crate::likelihood::LearnLikelihood;
use crate::sequence::Sequence;
use crate::transition::LearnTransition;

/// Information criteria of a model that was learned from sequences: lower is better.
///
/// Made by [`LearnedModel::criteria`], and for models from elsewhere by [`Hmm::criteria`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Criteria {
    /// Log-likelihood of the observations, L.
    pub log_likelihood: f64,
    /// Number of free parameters, p.
    pub parameters: usize,
    /// Number of observations (steps of all sequences), T.
    pub observations: usize,
}

impl Criteria {
    /// Akaike's criterion, 2 p − 2 L (Akaike 1974).
    #[must_use]
    pub fn aic(&self) -> f64 {
        2.0 * self.parameters as f64 - 2.0 * self.log_likelihood
    }

    /// The Bayesian criterion, p ln T − 2 L (Schwarz 1978).
    #[must_use]
    pub fn bic(&self) -> f64 {
        self.parameters as f64 * (self.observations as f64).ln() - 2.0 * self.log_likelihood
    }
}

/// Log-likelihood of sequences that a model was not learned from.
#[derive(Debug, Clone, PartialEq)]
pub struct HeldOut {
    /// Log-likelihood of the held-out sequences of each fold; −∞ if the learned model rules one
    /// of them out.
    pub folds: Vec<f64>,
    /// Number of observations of each fold.
    pub observations: Vec<usize>,
}

impl HeldOut {
    /// Log-likelihood of all sequences, each under a model that was not learned from it.
    #[must_use]
    pub fn log_likelihood(&self) -> f64 {
        self.folds.iter().sum()
    }

    /// The same per observation: the mean log score, in nats.
    #[must_use]
    pub fn score(&self) -> f64 {
        self.log_likelihood() / self.observations.iter().sum::<usize>() as f64
    }
}

/// Candidates for a model, each with its criteria, as a table.
///
/// ```
/// use wayfix::inference::{LearnError, LearnedModel, LearningOptions, ModelSelection};
/// use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
///
/// // One or two kinds of days? Umbrellas come in spells here.
/// let day = |k: usize, year: usize| usize::from((k + year) / 20 % 2 == 1);
/// let years: Vec<Vec<usize>> = (0..6).map(|year| (0..60).map(|k| day(k, year)).collect()).collect();
/// // Errors of all parts of a model become a `LearnError`.
/// fn learn(
///     states: usize,
///     years: &[&Vec<usize>],
/// ) -> Result<LearnedModel<DenseTransition, TableLikelihood>, LearnError> {
///     let prior = Prior::AtFirstObservation(Belief::uniform(states)?);
///     let (rows, table) = match states {
///         1 => (vec![vec![1.0]], vec![[0.5, 0.5]]),
///         _ => (vec![vec![0.9, 0.1], vec![0.1, 0.9]], vec![[0.7, 0.3], [0.4, 0.6]]),
///     };
///     let (a, b) = (DenseTransition::from_rows(&rows)?, TableLikelihood::from_rows(&table)?);
///     Hmm::new(prior, a, b)?.learn(years, &LearningOptions::default())
/// }
///
/// let selection = ModelSelection::new([1, 2], &years, 3, |states, years| learn(*states, years))?;
/// assert_eq!(selection.best_by_bic(), &2);
/// assert_eq!(selection.best_held_out(), Some(&2));
/// println!("{selection}"); // a line for each: parameters, log-likelihood, AIC, BIC, held out
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct ModelSelection<C> {
    rows: Vec<Candidate<C>>,
}

/// A candidate of a [`ModelSelection`].
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate<C> {
    /// The candidate, as it was given.
    pub candidate: C,
    /// Criteria of the model that was learned from all sequences.
    pub criteria: Criteria,
    /// Likelihood of held-out sequences, if there were folds.
    pub held_out: Option<HeldOut>,
    /// Number of models, of all sequences and of each fold, whose learning ended as
    /// [`StopReason::Failed`]. The likelihood of such a model may have no bound (a state has shrunk
    /// to one observation), so that its criteria mean little.
    pub failed: usize,
}

impl<C> ModelSelection<C> {
    /// Learns a model for each candidate by `learn`, from all sequences and, for `folds` of at
    /// least 2, as often from all sequences but those of a fold (sequence s is in fold s modulo
    /// `folds`). `folds` of 0 or 1 leave that out. A single long sequence may be cut into pieces,
    /// such as `values.chunks(500)`, much longer than a state lasts.
    ///
    /// Let `learn` return a [`LearnError`], which the errors of all parts of a model become by `?`,
    /// or an error of your own; a `Box<dyn Error>` is not `Send`. The models are not kept: learn
    /// the chosen one again.
    ///
    /// Folds run in parallel with the feature `rayon`. The cost is that of all the learning.
    ///
    /// # Errors
    ///
    /// The first error of `learn`; as one of its kind, [`LearnError::Nothing`] for no candidate,
    /// [`LearnError::Groups`] for fewer sequences than folds, and [`LearnError::Sequence`] if a
    /// model learned from all sequences rules one out.
    pub fn new<A, B, S, E>(
        candidates: impl IntoIterator<Item = C>,
        sequences: &[S],
        folds: usize,
        learn: impl Fn(&C, &[&S]) -> Result<LearnedModel<A, B>, E> + Sync,
    ) -> Result<Self, E>
    where
        C: Sync,
        E: From<LearnError> + Send,
        A: LearnTransition + Sync,
        B: LearnLikelihood + Sync,
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        if folds > sequences.len() {
            return Err(LearnError::Groups { groups: folds, sequences: sequences.len() }.into());
        }
        let mut rows = Vec::new();
        for candidate in candidates {
            let all: Vec<&S> = sequences.iter().collect();
            let learned = learn(&candidate, &all)?;
            let parameters = learned.free_parameters();
            let criteria = Criteria { parameters, ..learned.model().criteria(&all)? };
            let (held_out, failed) = match folds {
                0 | 1 => (None, 0),
                _ => {
                    let (found, failed) =
                        held_out(sequences, folds, |some| learn(&candidate, some))?;
                    (Some(found), failed)
                }
            };
            let failed = failed + usize::from(learned.reason() == StopReason::Failed);
            rows.push(Candidate { candidate, criteria, held_out, failed });
        }
        if rows.is_empty() {
            let nothing = LearnError::nothing(sequences.len(), None);
            return Err(nothing.into());
        }
        Ok(Self { rows })
    }

    /// Candidates with their criteria, in the order given.
    #[must_use]
    pub fn rows(&self) -> &[Candidate<C>] {
        &self.rows
    }

    /// The lowest value, of candidates of which no model failed before any others.
    fn best_by(&self, value: impl Fn(&Candidate<C>) -> f64) -> &C {
        let rank = |row: &Candidate<C>| (row.failed > 0, value(row));
        let better = |best, row| if rank(row) < rank(best) { row } else { best };
        &self.rows.iter().skip(1).fold(&self.rows[0], better).candidate
    }

    /// The candidate with the lowest BIC, the first of several. One with a
    /// [failed](Candidate::failed) model comes after all others, here and below.
    #[must_use]
    pub fn best_by_bic(&self) -> &C {
        self.best_by(|row| row.criteria.bic())
    }

    /// The candidate with the lowest AIC, the first of several.
    #[must_use]
    pub fn best_by_aic(&self) -> &C {
        self.best_by(|row| row.criteria.aic())
    }

    /// The candidate with the highest likelihood of held-out sequences, the first of several;
    /// `None` without folds.
    #[must_use]
    pub fn best_held_out(&self) -> Option<&C> {
        let minus = |row: &Candidate<C>| {
            row.held_out.as_ref().map_or(f64::INFINITY, |found| -found.log_likelihood())
        };
        self.rows.iter().all(|row| row.held_out.is_some()).then(|| self.best_by(minus))
    }
}

impl<C: fmt::Display> fmt::Display for ModelSelection<C> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{:>12} {:>10} {:>14} {:>12} {:>12}",
            "model", "parameters", "log-likelihood", "AIC", "BIC"
        )?;
        let folds = self.rows.iter().any(|row| row.held_out.is_some());
        if folds {
            write!(f, " {:>14}", "held out")?;
        }
        for Candidate { candidate, criteria, held_out, failed } in &self.rows {
            let (p, l) = (criteria.parameters, criteria.log_likelihood);
            let name = candidate.to_string();
            write!(
                f,
                "\n{name:>12} {p:>10} {l:>14.2} {:>12.2} {:>12.2}",
                criteria.aic(),
                criteria.bic()
            )?;
            held_out.iter().try_for_each(|h| write!(f, " {:>14.2}", h.log_likelihood()))?;
            if *failed > 0 {
                write!(f, "  {failed} failed")?;
            }
        }
        Ok(())
    }
}

/// Likelihood of the sequences of each fold under a model learned from the others, and the number
/// of these models whose learning failed.
fn held_out<A, B, S, E>(
    sequences: &[S],
    folds: usize,
    learn: impl Fn(&[&S]) -> Result<LearnedModel<A, B>, E> + Sync,
) -> Result<(HeldOut, usize), E>
where
    E: From<LearnError> + Send,
    A: LearnTransition + Sync,
    B: LearnLikelihood + Sync,
    S: Sequence<A::Control, B::Observation> + Sync,
{
    let results = parallel::map((0..folds).collect(), |fold: usize, (): &mut ()| {
        let of = |held: bool| {
            let all = sequences.iter().enumerate();
            all.filter(move |(s, _)| (s % folds == fold) == held).map(|(_, s)| s)
        };
        let learned = learn(&of(false).collect::<Vec<_>>())?;
        let failed = usize::from(learned.reason() == StopReason::Failed);
        let hmm = learned.model();
        let mut sum = LogSum::default();
        for (sequence, source) in of(true).map(|s| hmm.log_likelihood(s)).enumerate() {
            match source {
                Ok(log) => sum.add(log),
                Err(InferenceError::Impossible { .. } | InferenceError::ImpossibleMove { .. }) => {
                    sum.add(f64::NEG_INFINITY);
                }
                Err(source) => {
                    let sequence = fold + sequence * folds;
                    return Err(LearnError::Sequence(SequenceError { sequence, source }).into());
                }
            }
        }
        Ok((sum.value(), of(true).map(Sequence::steps).sum::<usize>(), failed))
    });
    let results = results.into_iter().collect::<Result<Vec<_>, E>>()?;
    let failed = results.iter().map(|fold| fold.2).sum();
    let (folds, observations) = results.into_iter().map(|fold| (fold.0, fold.1)).unzip();
    Ok((HeldOut { folds, observations }, failed))
}

impl<A: LearnTransition, B: LearnLikelihood> Hmm<A, B> {
    /// Number of parameters that learning from this model may change: those of the prior (its
    /// states above 0 less one), of the transition operator and of the sensor. Parts that are
    /// [`Fixed`](crate::Fixed) have none.
    ///
    /// For a model that was learned, [`LearnedModel::free_parameters`] gives the number: here,
    /// probabilities that learning has taken to 0 would be missing.
    #[must_use]
    pub fn free_parameters(&self) -> usize {
        self.free_in_prior()
            + self.transition().free_parameters()
            + self.likelihood().free_parameters()
    }

    pub(crate) fn free_in_prior(&self) -> usize {
        self.prior().belief().as_slice().iter().filter(|p| **p > 0.0).count() - 1
    }

    /// Returns the information criteria of a model that does not come from [`learn`](Self::learn),
    /// such as one from [labels](Self::fit) or from a file, for these sequences.
    ///
    /// After learning, call [`LearnedModel::criteria`] instead. The parameters counted here are the
    /// [free ones of this model](Self::free_parameters): if its probabilities were learned, and
    /// some have become 0, they are too few, and the fewer the longer it was learned. Replace them
    /// by those of the model that learning started from:
    ///
    /// ```
    /// use wayfix::inference::Criteria;
    /// # use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
    /// # let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
    /// # let camera = TableLikelihood::from_rows(&[[0.7, 0.3], [0.3, 0.7]])?;
    /// # let start = Hmm::new(prior, DenseTransition::from_rows(&[[0.6, 0.4], [0.4, 0.6]])?, camera)?;
    /// # let hmm = start.clone();
    /// let seen = [[0, 0, 1, 1], [0, 1, 0, 1]];
    /// let criteria = Criteria { parameters: start.free_parameters(), ..hmm.criteria(&seen)? };
    /// assert_eq!((criteria.parameters, criteria.observations), (1 + 2 + 2, 8));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// The cost is that of [`log_likelihood_all`](Self::log_likelihood_all).
    ///
    /// # Errors
    ///
    /// [`LearnError::Sequence`] for the first sequence that the model rules out or that is not
    /// valid; [`LearnError::Nothing`] without observations.
    pub fn criteria<S>(&self, sequences: &[S]) -> Result<Criteria, LearnError>
    where
        A: Sync,
        B: Sync,
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        let mut sum = LogSum::default();
        for log in self.log_likelihood_all(sequences) {
            sum.add(log?);
        }
        let observations = sequences.iter().map(Sequence::steps).sum();
        if observations == 0 {
            return Err(LearnError::nothing(sequences.len(), None));
        }
        let parameters = self.free_parameters();
        Ok(Criteria { log_likelihood: sum.value(), parameters, observations })
    }
}
