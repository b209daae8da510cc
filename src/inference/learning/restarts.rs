//! Learning from several starts: expectation–maximisation ends at a local maximum (section 9 of the
//! [formulas](crate::guide::formulas)).

use super::learned_model::{LearnedModel, LearningOptions};
use crate::error::LearnError;
use crate::hmm::Hmm;
use crate::inference::engines::parallel;
use crate::likelihood::LearnLikelihood;
use crate::sequence::Sequence;
use crate::transition::LearnTransition;

impl<A: LearnTransition, B: LearnLikelihood> Hmm<A, B> {
    /// Learns from each of several starts, and returns the model with the highest objective, the
    /// first of several: expectation–maximisation ends at a local maximum, which depends on the
    /// start. Models of which learning [failed](LearnedModel::failed) come after all others, since
    /// their likelihood may have no bound; if one of them is returned, all others failed too.
    ///
    /// [`LearnedModel::start`] is the index of its start. `done` is called with the index and the
    /// result of each start as it ends, in any order, and may clone it: the others are dropped.
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
    /// let best = Hmm::learn_best(&starts, &seen, &LearningOptions::default(), |start, learned| {
    ///     if let Ok(learned) = learned {
    ///         println!("start {start}: {}", learned.objective());
    ///     }
    /// })?;
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
    ) -> Result<LearnedModel<A, B>, LearnError>
    where
        Self: Clone + Sync,
        A: Send,
        B: Send,
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        let starts = starts.iter().enumerate().collect();
        let attempts = parallel::map(starts, |(index, start): (usize, &Self), (): &mut ()| {
            let learned = start.learn(sequences, learning);
            let learned = learned.map(|learned| LearnedModel { start: index, ..learned });
            done(index, &learned);
            learned
        });
        // A failed attempt comes last, then the objective decides; a NaN is never greater.
        let rank = |learned: &LearnedModel<A, B>| (!learned.failed(), learned.objective());
        let better = |best, learned| match (best, learned) {
            // Strictly greater: of equal ones the first stays, whatever the threads did.
            (Ok(best), Ok(learned)) if rank(&learned) > rank(&best) => Ok(learned),
            (Err(_), Ok(learned)) => Ok(learned),
            (best, _) => best,
        };
        let nothing = || Err(LearnError::nothing(sequences.len(), None));
        attempts.into_iter().reduce(better).unwrap_or_else(nothing)
    }
}
