//! Learning from several starts, since expectation–maximisation ends at a local maximum (section 9
//! of the [formulas](crate::guide::formulas)).
//!
//! All starts are learned for some iterations; then only the better ones continue.

use std::cmp::Ordering;
use std::ops::ControlFlow::Continue;

use super::baum_welch::LearningRun;
use super::learned_model::{LearnedModel, LearningOptions};
use crate::error::LearnError;
use crate::hmm::Hmm;
use crate::inference::engines::parallel;
use crate::likelihood::LearnLikelihood;
use crate::sequence::Sequence;
use crate::transition::LearnTransition;

/// Re-estimations from each start before only the better ones continue. (With ten starts, this
/// missed the best end in 4 of 100 random problems, and saved a fifth of the iterations.)
const SHORT: usize = 30;
/// Least number of starts that continue.
const FEWEST: usize = 3;

impl<A: LearnTransition, B: LearnLikelihood> Hmm<A, B> {
    /// Learns from each of several starts, and returns the model with the highest objective:
    /// expectation–maximisation ends at a local maximum, which depends on the start. If several
    /// objectives are within the [tolerance](LearningOptions::tolerance) of the highest, the first
    /// of these models is returned. Models whose learning [failed](LearnedModel::failed) rank after
    /// all others, since their likelihood may be unbounded; if one of them is returned, all failed.
    ///
    /// Learning runs for 30 iterations from each start, and then continues from the better half of
    /// the starts (at least three), or from more if all of these fail. The others are
    /// [stopped](LearnedModel::stopped), and seldom the best.
    ///
    /// [`LearnedModel::start`] is the index of the start, and [`LearnedModel::ends`] the number of
    /// different ends. `done` is called with the index and the result of each start as it ends, in
    /// any order. It may clone the result; all but the best are dropped. Runs in parallel with the
    /// feature `rayon`. Costs at most one call of [`learn`](Self::learn) for each start; the models
    /// and expectations of all starts are in memory.
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
    /// The [`LearnError`] of the first start if all fail; [`LearnError::Nothing`] without starts.
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
        let kept = starts.len().div_ceil(2).max(FEWEST);
        let starts = starts.iter().enumerate().collect();
        let short = |(index, start): (usize, &Self), (): &mut ()| {
            let run = LearningRun::begin(start, sequences, learning).and_then(|mut run| {
                run.best.start = index;
                run.run_until(learning, SHORT.min(learning.iterations), &mut |_| Continue(()))?;
                Ok(run)
            });
            (index, run)
        };
        let long = |(index, run): Attempt<'_, A, B, S>, (): &mut ()| {
            let learned = run.and_then(|mut run| {
                run.run_until(learning, learning.iterations, &mut |_| Continue(()))?;
                Ok(run.best)
            });
            done(index, &learned);
            (index, learned)
        };
        let mut waiting = parallel::map(starts, short);
        let mut ends: Vec<(usize, End<A, B>)> = Vec::new();
        // More than one round only if every start so far has failed.
        while !waiting.is_empty() && ends.iter().flat_map(|(_, end)| end).all(LearnedModel::failed)
        {
            let [next, left] = divide(waiting, kept, learning);
            ends.extend(parallel::map(next, long));
            waiting = left;
        }
        for (index, run) in waiting {
            let left = run.map(|run| LearnedModel { stopped: true, ..run.best });
            done(index, &left);
            ends.push((index, left));
        }
        ends.sort_by_key(|(index, _)| *index);
        let ends = ends.into_iter().map(|(_, end)| end).collect();
        best(ends, learning).unwrap_or_else(|| Err(LearnError::nothing(sequences.len(), None)))
    }
}

/// Learning from one start, with the index of the start.
type Attempt<'s, A, B, S> = (usize, Result<LearningRun<'s, A, B, S>, LearnError>);

type End<A, B> = Result<LearnedModel<A, B>, LearnError>;

/// Divides attempts in two: those that have ended together with the best `kept` of the others, and
/// the rest.
fn divide<'s, A: LearnTransition, B: LearnLikelihood, S>(
    attempts: Vec<Attempt<'s, A, B, S>>,
    kept: usize,
    learning: &LearningOptions,
) -> [Vec<Attempt<'s, A, B, S>>; 2] {
    let objective = |attempt: &Attempt<'s, A, B, S>| {
        let model = &attempt.1.as_ref().ok()?.best;
        let has_ended = model.converged || model.cause.is_some();
        let may_go_on = model.iterations() < learning.iterations;
        (may_go_on && !has_ended).then(|| model.objective())
    };
    let (mut rest, mut next): (Vec<_>, Vec<_>) =
        attempts.into_iter().partition(|attempt| objective(attempt).is_some());
    // A stable sort: of equal attempts, the first continue.
    rest.sort_by(|a, b| objective(b).partial_cmp(&objective(a)).unwrap_or(Ordering::Equal));
    next.extend(rest.drain(..kept.min(rest.len())));
    [next, rest]
}

/// Returns the first end whose objective is within the tolerance of the highest, with the number of
/// different ends, or the first error if all are errors.
fn best<A, B>(ends: Vec<End<A, B>>, learning: &LearningOptions) -> Option<End<A, B>> {
    let all = || ends.iter().flatten();
    // Failed ends are ranked only if all have failed.
    let succeeded = all().any(|end| !end.failed());
    let ranked = || all().filter(|end| end.failed() != succeeded);
    let highest = ranked().map(LearnedModel::objective).fold(f64::NEG_INFINITY, f64::max);
    let mut different: Vec<f64> =
        ranked().filter(|end| !end.stopped).map(LearnedModel::objective).collect();
    // Sorted, ends are different where the gap to the next exceeds the tolerance.
    different.sort_by(f64::total_cmp);
    let gaps = different.windows(2).filter(|pair| pair[1] - pair[0] > learning.tolerance).count();
    let first = ranked().find(|end| end.objective() >= highest - learning.tolerance);
    let at = first.map_or(0, |first| first.start);
    let best = ends.into_iter().nth(at)?;
    Some(best.map(|best| LearnedModel { ends: gaps + 1, ..best }))
}
