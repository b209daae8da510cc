//! Learning from several starts: expectation–maximisation ends at a local maximum (section 9 of the
//! [formulas](crate::guide::formulas)).

use std::cmp::Ordering;
use std::ops::ControlFlow::Continue;

use super::baum_welch::Course;
use super::learned_model::{LearnedModel, LearningOptions};
use crate::error::LearnError;
use crate::hmm::Hmm;
use crate::inference::engines::parallel;
use crate::likelihood::LearnLikelihood;
use crate::sequence::Sequence;
use crate::transition::LearnTransition;

/// Re-estimations from each start, before the better ones go on. (So ten starts lost the best of
/// their ends in 4 of 100 random problems, and a fifth of the iterations.)
const SHORT: usize = 30;
/// Fewest starts that go on.
const FEWEST: usize = 3;

impl<A: LearnTransition, B: LearnLikelihood> Hmm<A, B> {
    /// Learns from each of several starts, and returns the model with the highest objective:
    /// expectation–maximisation ends at a local maximum, which depends on the start. Of models
    /// whose objectives are within the [tolerance](LearningOptions::tolerance) of the highest, it
    /// is the first. Models of which learning [failed](LearnedModel::failed) come after all others,
    /// since their likelihood may have no bound; if one of them is returned, all others failed too.
    ///
    /// From each start it learns for 30 iterations; it then goes on from the better half of the
    /// starts, three at least, or from more if these all fail. The others are
    /// [stopped](LearnedModel::stopped), and seldom the best.
    ///
    /// [`LearnedModel::start`] is the index of the start, and [`LearnedModel::ends`] the number of
    /// different ends. `done` is called with the index and the result of each start as it ends, in
    /// any order, and may clone it: the others are dropped. Runs in parallel with the feature
    /// `rayon`. Costs no more than as many calls of [`learn`](Self::learn); the models and
    /// expectations of all starts are in memory.
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
        let kept = starts.len().div_ceil(2).max(FEWEST);
        let starts = starts.iter().enumerate().collect();
        let short = |(index, start): (usize, &Self), (): &mut ()| {
            let course = Course::begin(start, sequences, learning).and_then(|mut course| {
                course.best.start = index;
                course.go_on(learning, SHORT.min(learning.iterations), &mut |_| Continue(()))?;
                Ok(course)
            });
            (index, course)
        };
        let long = |(index, course): Attempt<'_, A, B, S>, (): &mut ()| {
            let learned = course.and_then(|mut course| {
                course.go_on(learning, learning.iterations, &mut |_| Continue(()))?;
                Ok(course.best)
            });
            done(index, &learned);
            (index, learned)
        };
        let mut waiting = parallel::map(starts, short);
        let mut ends: Vec<(usize, End<A, B>)> = Vec::new();
        // Further ones only if all before have failed.
        while !waiting.is_empty() && ends.iter().flat_map(|(_, end)| end).all(LearnedModel::failed)
        {
            let [next, left] = divide(waiting, kept, learning);
            ends.extend(parallel::map(next, long));
            waiting = left;
        }
        for (index, course) in waiting {
            let left = course.map(|course| LearnedModel { stopped: true, ..course.best });
            done(index, &left);
            ends.push((index, left));
        }
        ends.sort_by_key(|(index, _)| *index);
        let ends = ends.into_iter().map(|(_, end)| end).collect();
        best(ends, learning).unwrap_or_else(|| Err(LearnError::nothing(sequences.len(), None)))
    }
}

/// Learning from a start, with the index of this.
type Attempt<'s, A, B, S> = (usize, Result<Course<'s, A, B, S>, LearnError>);

type End<A, B> = Result<LearnedModel<A, B>, LearnError>;

/// Divides attempts into those that have ended or are the best of the others, so many of them, and
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
    // A stable order: of equal ones the first go on.
    rest.sort_by(|a, b| objective(b).partial_cmp(&objective(a)).unwrap_or(Ordering::Equal));
    next.extend(rest.drain(..kept.min(rest.len())));
    [next, rest]
}

/// Returns the first end whose objective is within the tolerance of the highest, with the number of
/// different ends; the first error if there is none.
fn best<A, B>(ends: Vec<End<A, B>>, learning: &LearningOptions) -> Option<End<A, B>> {
    let all = || ends.iter().flatten();
    let succeeded = all().any(|end| !end.failed());
    let ranked = || all().filter(|end| end.failed() != succeeded);
    let highest = ranked().map(LearnedModel::objective).fold(f64::NEG_INFINITY, f64::max);
    let mut different: Vec<f64> =
        ranked().filter(|end| !end.stopped).map(LearnedModel::objective).collect();
    different.sort_by(f64::total_cmp);
    let gaps = different.windows(2).filter(|pair| pair[1] - pair[0] > learning.tolerance).count();
    let first = ranked().find(|end| end.objective() >= highest - learning.tolerance);
    let at = first.map_or(0, |first| first.start);
    let best = ends.into_iter().nth(at)?;
    Some(best.map(|best| LearnedModel { ends: gaps + 1, ..best }))
}
