//! Learning from several starts.

use super::baum_welch::{LearnedModel, LearningOptions, StopReason};
use crate::error::LearnError;
use crate::hmm::Hmm;
use crate::inference::engines::parallel;
use crate::likelihood::LearnLikelihood;
use crate::sequence::Sequence;
use crate::transition::LearnTransition;

/// Results of learning from several starts.
///
/// Made by [`Hmm::learn_best`].
#[derive(Debug)]
pub struct Restarts<A, B> {
    attempts: Vec<Result<LearnedModel<A, B>, LearnError>>,
    best: usize,
}

impl<A, B> Restarts<A, B> {
    /// The results of all starts, in their order.
    pub fn attempts(&self) -> &[Result<LearnedModel<A, B>, LearnError>] {
        &self.attempts
    }

    /// Index of the start with the highest objective, the lowest of several. Those that ended as
    /// [`StopReason::Failed`] come after all others, since theirs may have no bound; if one of
    /// them is best, all others failed too.
    #[must_use]
    pub fn best_index(&self) -> usize {
        self.best
    }

    /// Returns the [best](Self::best_index) learned model, whose
    /// [`reason`](LearnedModel::reason) tells whether it failed. The others are dropped.
    #[must_use]
    pub fn into_best(mut self) -> LearnedModel<A, B> {
        match self.attempts.swap_remove(self.best) {
            Ok(learned) => learned,
            Err(_) => unreachable!("the best start did not fail"),
        }
    }
}

impl<A: LearnTransition, B: LearnLikelihood> Hmm<A, B> {
    /// Learns from each of several starts, and tells which came to the highest objective:
    /// expectation–maximisation ends at a local maximum, which depends on the start. Attempts
    /// that end as [`StopReason::Failed`] are kept, but rank last.
    ///
    /// `done` is called with the index and the result of each start as it ends, in any order.
    /// Runs in parallel with the feature `rayon`. The cost is that of as many calls of
    /// [`learn`](Self::learn).
    ///
    /// ```
    /// use rand::RngExt;
    /// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
    /// use wayfix::inference::LearningOptions;
    /// use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
    ///
    /// let mut rng = ChaCha8Rng::seed_from_u64(1);
    /// let mut start = || {
    ///     let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
    ///     let [stay, p, q]: [f64; 3] = rng.random();
    ///     let transition = DenseTransition::from_rows(&[[stay, 1.0 - stay], [1.0 - stay, stay]])?;
    ///     let table = TableLikelihood::from_rows(&[[p, 1.0 - p], [q, 1.0 - q]])?;
    ///     Ok::<_, Box<dyn std::error::Error>>(Hmm::new(prior, transition, table)?)
    /// };
    /// let starts = [start()?, start()?, start()?];
    /// let seen = [[0, 0, 0, 1, 1, 1, 1], [1, 1, 1, 1, 0, 0, 0]];
    /// let restarts = Hmm::learn_best(&starts, &seen, &LearningOptions::default(), |start, learned| {
    ///     if let Ok(learned) = learned {
    ///         println!("start {start}: {}", learned.objective());
    ///     }
    /// })?;
    /// let best = restarts.into_best();
    /// assert!(best.log_likelihood() > -8.0);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// The first start's [`LearnError`] if all fail; [`LearnError::Nothing`] without a start.
    pub fn learn_best<S>(
        starts: &[Self],
        sequences: &[S],
        learning: &LearningOptions,
        done: impl Fn(usize, &Result<LearnedModel<A, B>, LearnError>) + Sync,
    ) -> Result<Restarts<A, B>, LearnError>
    where
        Self: Clone + Sync,
        A: Send,
        B: Send,
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        let starts = starts.iter().enumerate().collect();
        let attempts = parallel::map(starts, |(index, start): (usize, &Self), (): &mut ()| {
            let learned = start.learn(sequences, learning);
            done(index, &learned);
            learned
        });
        let mut best: Option<(usize, (bool, f64))> = None;
        for (index, learned) in attempts.iter().enumerate() {
            let Ok(learned) = learned else { continue };
            let rank = (learned.reason() != StopReason::Failed, learned.objective());
            if best.is_none_or(|best| rank > best.1) {
                best = Some((index, rank));
            }
        }
        let Some((best, _)) = best else {
            let nothing = LearnError::nothing(sequences.len(), None);
            return Err(attempts.into_iter().find_map(Result::err).unwrap_or(nothing));
        };
        Ok(Restarts { attempts, best })
    }
}
