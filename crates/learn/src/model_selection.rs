//! Choice among models, by information criteria and by the likelihood of held-out sequences
//! (cross-validation).

use std::fmt;

use wayfix::HmmError;
use wayfix::Sequence;
use wayfix::inference::{Criteria, LearnedModel};
use wayfix::inference::{LearnError, SequenceError};
use wayfix::internal::LogSum;
use wayfix::internal::parallel;
use wayfix::likelihood::LearnLikelihood;
use wayfix::transition::LearnTransition;

/// Candidates for a model, each with its criteria, as a table.
///
/// ```
/// use wayfix::inference::{LearnError, LearnedModel, LearningOptions};
/// use wayfix_learn::ModelSelection;
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
    /// Log-likelihood of the held-out sequences of each fold, under the model learned from the
    /// others; −∞ if that model rules one out. Empty without folds.
    pub held_out: Vec<f64>,
    /// Number of held-out observations of each fold.
    pub held_out_observations: Vec<usize>,
    /// Number of models, from all sequences and from each fold, whose learning
    /// [failed](LearnedModel::failed). The likelihood of such a model may be unbounded (a state
    /// has shrunk to one observation), so that its criteria mean little.
    pub failed: usize,
}

impl<C> Candidate<C> {
    /// Log-likelihood of all sequences, each under a model that was learned without it; `None`
    /// without folds.
    #[must_use]
    pub fn held_out_log_likelihood(&self) -> Option<f64> {
        (!self.held_out.is_empty()).then(|| self.held_out.iter().sum())
    }

    /// Held-out log-likelihood per observation: the mean log score, in nats.
    #[must_use]
    pub fn held_out_score(&self) -> Option<f64> {
        self.held_out_log_likelihood().map(|sum| sum / self.criteria.observations as f64)
    }
}

impl<C> ModelSelection<C> {
    /// Learns a model for each candidate by `learn`, from all sequences and, if `folds` is at least
    /// 2, once for each fold from all sequences outside it (sequence s is in fold s modulo
    /// `folds`). With 0 or 1, cross-validation is skipped. A single long sequence may be cut into
    /// pieces, such as `values.chunks(500)`, that are much longer than a state lasts.
    ///
    /// Let `learn` return a [`LearnError`], to which `?` converts the errors of all parts of a
    /// model, or an error of your own; a `Box<dyn Error>` is not `Send`. The models are not kept:
    /// learn the chosen one again.
    ///
    /// Folds run in parallel with the feature `rayon`. The cost is that of all the learning.
    ///
    /// # Errors
    ///
    /// The first error of `learn`; also, converted to its type, [`LearnError::Nothing`] without
    /// candidates, [`LearnError::Groups`] for fewer sequences than folds, and
    /// [`LearnError::Sequence`] if a model learned from all sequences rules one out.
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
            // The likelihood is that of all sequences, so one left out of learning is an error. The
            // parameters are those of the model that learning started from.
            let criteria = Criteria { parameters, ..learned.model().criteria(&all)? };
            // One fold would leave nothing to learn from.
            let folds = if folds < 2 { 0 } else { folds };
            let without = |fold, (): &mut ()| {
                log_likelihood_of_fold(sequences, fold, folds, |some| learn(&candidate, some))
            };
            let found = parallel::map((0..folds).collect(), without);
            let found = found.into_iter().collect::<Result<Vec<(f64, usize, bool)>, E>>()?;
            let failed = found.iter().filter(|fold| fold.2).count() + usize::from(learned.failed());
            let (held_out, held_out_observations) =
                found.into_iter().map(|fold| (fold.0, fold.1)).unzip();
            rows.push(Candidate { candidate, criteria, held_out, held_out_observations, failed });
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

    /// Returns the candidate with the lowest value; candidates with a failed model rank last.
    fn best_by(&self, value: impl Fn(&Candidate<C>) -> f64) -> &C {
        let rank = |row: &Candidate<C>| (row.failed > 0, value(row));
        // Ordered by failure, then by value. Strictly better only: ties go to the first.
        let better = |best, row| if rank(row) < rank(best) { row } else { best };
        &self.rows.iter().skip(1).fold(&self.rows[0], better).candidate
    }

    /// The candidate with the lowest BIC, the first in a tie. Here and below, candidates with a
    /// [failed](Candidate::failed) model rank after all others.
    #[must_use]
    pub fn best_by_bic(&self) -> &C {
        self.best_by(|row| row.criteria.bic())
    }

    /// The candidate with the lowest AIC, the first in a tie.
    #[must_use]
    pub fn best_by_aic(&self) -> &C {
        self.best_by(|row| row.criteria.aic())
    }

    /// The candidate with the highest likelihood of held-out sequences, the first in a tie; `None`
    /// without folds.
    #[must_use]
    pub fn best_held_out(&self) -> Option<&C> {
        let minus =
            |row: &Candidate<C>| row.held_out_log_likelihood().map_or(f64::INFINITY, |log| -log);
        // `best_by` takes the lowest, hence the minus.
        self.rows.iter().all(|row| !row.held_out.is_empty()).then(|| self.best_by(minus))
    }
}

impl<C: fmt::Display> fmt::Display for ModelSelection<C> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{:>12} {:>10} {:>14} {:>12} {:>12}",
            "model", "parameters", "log-likelihood", "AIC", "BIC"
        )?;
        if self.rows.iter().any(|row| !row.held_out.is_empty()) {
            write!(f, " {:>14}", "held out")?;
        }
        for row in &self.rows {
            let Candidate { candidate, criteria, failed, .. } = row;
            let (p, l) = (criteria.parameters, criteria.log_likelihood);
            let name = candidate.to_string();
            write!(
                f,
                "\n{name:>12} {p:>10} {l:>14.2} {:>12.2} {:>12.2}",
                criteria.aic(),
                criteria.bic()
            )?;
            if let Some(held_out) = row.held_out_log_likelihood() {
                write!(f, " {held_out:>14.2}")?;
            }
            if *failed > 0 {
                write!(f, "  {failed} failed")?;
            }
        }
        Ok(())
    }
}

/// Returns the log-likelihood of the sequences of a fold under a model learned from the others,
/// their number of observations, and true if learning failed.
fn log_likelihood_of_fold<A, B, S, E>(
    sequences: &[S],
    fold: usize,
    folds: usize,
    learn: impl Fn(&[&S]) -> Result<LearnedModel<A, B>, E>,
) -> Result<(f64, usize, bool), E>
where
    E: From<LearnError>,
    A: LearnTransition,
    B: LearnLikelihood,
    S: Sequence<A::Control, B::Observation>,
{
    let (held, others): (Vec<_>, Vec<_>) =
        // Folds are interleaved, so each has sequences from all times.
        sequences.iter().enumerate().partition(|(sequence, _)| sequence % folds == fold);
    let learned = learn(&others.into_iter().map(|(_, s)| s).collect::<Vec<_>>())?;
    let (mut sum, mut observations) = (LogSum::default(), 0);
    for (sequence, observed) in held {
        observations += observed.steps();
        match learned.model().log_likelihood(observed) {
            Ok(log) => sum.add(log),
            // A model that rules out a held-out sequence gets the lowest possible score.
            Err(HmmError::Impossible { .. } | HmmError::ImpossibleMove { .. }) => {
                sum.add(f64::NEG_INFINITY);
            }
            Err(source) => return Err(LearnError::from(SequenceError { sequence, source }).into()),
        }
    }
    Ok((sum.value(), observations, learned.failed()))
}
