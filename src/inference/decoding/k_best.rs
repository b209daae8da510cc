//! The k most probable paths: Viterbi with a list of paths for each state (Seshadri and Sundberg
//! 1994; section 7 of the [formulas](crate::guide::formulas)).
//!
//! The k best paths to a state extend paths that are among the k best to the states before it, so
//! that none is missed. Scores are those of [`Hmm::viterbi`], so that the first path is the same.
//!
//! The invariant: a list is in descending order of scores, and paths with equal scores are in
//! ascending order of the previous state, then of rank. So ties go to the lowest states.

use super::viterbi::ViterbiPath;
use crate::error::HmmError;
use crate::hmm::Hmm;
use crate::inference::step::scores::TakenOut;
use crate::inference::step::{SensorScratch, Step};
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::{TransitionEntries, constant_control};

impl<A: TransitionEntries, B: Likelihood> Hmm<A, B> {
    /// Returns the `count` most probable paths x_1 … x_T, the best first; fewer if the model
    /// allows fewer. They are distinct, and the first is that of [`viterbi`](Self::viterbi) (up to
    /// the last digit but one of its probability, for an operator that adds the logarithms of
    /// several factors).
    ///
    /// Equally probable paths are ordered by their last state, then the last but one, and so on;
    /// [`viterbi`](Self::viterbi) says which paths count as equal. As there, X_0 is summed over. An
    /// empty sequence has one path, the empty one. A `count` of 0 gives no paths.
    ///
    /// O(E K + n K log K) a step for K paths; 16 n K T bytes for the backpointers and 16 n T for
    /// the lists, and 16 E for a matrix that is the same at all steps.
    ///
    /// ```
    /// # use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
    /// # let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
    /// # let table = TableLikelihood::from_rows(&[[0.9, 0.1], [0.2, 0.8]])?;
    /// # let hmm = Hmm::new(prior, DenseTransition::from_rows(&[[0.7, 0.3], [0.3, 0.7]])?, table)?;
    /// let paths = hmm.k_best(&[0, 0, 1, 0, 0], 3)?;
    /// assert_eq!(paths[0].states(), [0, 0, 1, 0, 0]);
    /// assert_eq!(paths[1].states(), [0; 5]);
    /// assert!(paths[1].log_probability() > paths[2].log_probability());
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// As [`viterbi`](Self::viterbi), also for a `count` of 0.
    pub fn k_best<S>(&self, sequence: &S, count: usize) -> Result<Vec<ViterbiPath>, HmmError>
    where
        S: Sequence<A::Control, B::Observation> + ?Sized,
    {
        let (n, steps) = (self.states(), sequence.steps());
        if steps == 0 {
            let empty = ViterbiPath { states: Vec::new(), log_probability: 0.0 };
            return Ok(vec![empty; count.min(1)]);
        }
        let mut scratch = SensorScratch::new(n);
        let mut taken_out = TakenOut::default();
        let logs = EntryLogs::new(self, steps);
        // Paths to each state of each step, best first.
        let mut lists: Vec<Lists> = Vec::with_capacity(steps);
        let (mut added, mut best) = (vec![0.0; n], vec![0.0; n]);
        for number in 1..=steps {
            let step = Step::of(self, sequence, number);
            let mut list = match lists.last() {
                None => step.first_paths(&mut added, &mut taken_out)?,
                // At least one path is kept, to detect impossible observations.
                Some(before) => step.best_paths(before, &logs, count.max(1), &mut taken_out)?,
            };
            added.fill(0.0);
            let observation = sequence.observation(number);
            step.observe(observation, &mut scratch, &mut added, &mut taken_out)?;
            for ((best, paths), added) in best.iter_mut().zip(list.iter()).zip(&added) {
                *best = paths.first().map_or(f64::NEG_INFINITY, |path| path.score + added);
            }
            // As in Viterbi, the best path to each state decides the whole number to take out, so
            // both take out the same.
            let floor = step.take_out_whole(&mut best, &mut taken_out)?;
            for (state, (best, added)) in best.iter().zip(&added).enumerate() {
                if *best == f64::NEG_INFINITY {
                    list.clear(state);
                }
                // The whole number is subtracted last, without rounding, as in Viterbi, so that the
                // scores are the same.
                for path in list.of_mut(state) {
                    path.score = (path.score + added) - floor;
                }
            }
            lists.push(list);
        }
        let ends = lists.last().map_or_else(Vec::new, |last| best_ends(last.iter(), count));
        let path = |end: RankedPath| ViterbiPath {
            states: states(end, steps, |step, state| lists[step].of(state)),
            log_probability: taken_out.log_probability(end.score),
        };
        Ok(ends.into_iter().map(path).collect())
    }
}

/// Logarithms of the entries of a matrix that is the same at all steps, by the state that they lead
/// to. Computing one takes longer than extending a path. (Viterbi keeps them too, but in the order
/// of its slots.)
struct EntryLogs {
    /// Start of the entries into each state; empty if the operator has to be asked at each step.
    starts: Vec<usize>,
    entries: Vec<(usize, f64)>,
}

impl EntryLogs {
    fn new<A: TransitionEntries, B: Likelihood>(hmm: &Hmm<A, B>, steps: usize) -> Self {
        let mut logs = Self { starts: Vec::new(), entries: Vec::new() };
        // Storing the logarithms pays off with two moves or more. An operator without a matrix may
        // have n² entries.
        if let (Some(control), 3..) = (constant_control::<A>(), steps)
            && hmm.transition().stored(control).is_some()
        {
            for state in 0..hmm.states() {
                logs.starts.push(logs.entries.len());
                logs.entries.extend(hmm.transition().incoming_log2(control, state));
            }
            logs.starts.push(logs.entries.len());
        }
        logs
    }

    /// Entries into a state, if they are known.
    #[inline]
    fn into(&self, state: usize) -> Option<&[(usize, f64)]> {
        let (start, end) = (self.starts.get(state)?, self.starts.get(state + 1)?);
        Some(&self.entries[*start..*end])
    }
}

impl<A: TransitionEntries, B: Likelihood> Step<'_, A, B> {
    /// Returns the lists of step 1, with a single path to each possible state; X_0 is summed over.
    fn first_paths(&self, scores: &mut [f64], taken_out: &mut TakenOut) -> Result<Lists, HmmError> {
        self.first_scores(scores, taken_out)?;
        let mut lists = Lists::with_capacity(scores.len(), scores.len());
        for score in scores {
            let path = RankedPath::start(*score);
            lists.push(if *score > f64::NEG_INFINITY { std::slice::from_ref(&path) } else { &[] });
        }
        Ok(lists)
    }

    /// Returns the best paths to each state, which extend those to the states before.
    fn best_paths(
        &self,
        before: &Lists,
        logs: &EntryLogs,
        count: usize,
        taken_out: &mut TakenOut,
    ) -> Result<Lists, HmmError> {
        let Some(control) = self.control else { return Ok(Lists::default()) }; // only step 1 has none
        let evidence = self.take_out_evidence(taken_out)?;
        let states = self.hmm.states();
        let mut lists = Lists::with_capacity(states, states * count.min(64));
        let mut best = Best::new(count);
        for state in 0..states {
            best.paths.clear();
            let extend = |(from, log2): (usize, f64)| best.extend(from, before.of(from), log2);
            match logs.into(state) {
                Some(entries) => entries.iter().copied().for_each(extend),
                None => self.hmm.transition().incoming_log2(control, state).for_each(extend),
            }
            best.finish();
            lists.push(&best.paths);
        }
        if evidence {
            // Only evidence can rule out every path here, or have an infinite entry.
            let first = lists.iter().filter_map(|paths| Some(paths.first()?.score));
            self.check_best_path(first.fold(f64::NEG_INFINITY, f64::max))?;
        }
        Ok(lists)
    }
}

/// A path to a state: its score, the previous state, and the rank, in the list of that state, of
/// the path that it extends.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RankedPath {
    pub(crate) score: f64,
    pub(crate) from: u32,
    rank: u32,
}

impl RankedPath {
    /// Creates a path of one step.
    pub(crate) fn start(score: f64) -> Self {
        Self { score, from: 0, rank: 0 }
    }
}

/// Largest number of paths that are kept sorted while others are added; longer lists are sorted at
/// the end.
const FEW: usize = 16;

/// Best paths to each state of a step.
#[derive(Debug, Clone, Default)]
pub(crate) struct Lists {
    paths: Vec<RankedPath>,
    /// Index of the first path to each state, and their number.
    ranges: Vec<(usize, u32)>,
}

impl Lists {
    pub(crate) fn with_capacity(states: usize, paths: usize) -> Self {
        Self { paths: Vec::with_capacity(paths), ranges: Vec::with_capacity(states) }
    }

    /// Appends the paths to the next state.
    #[inline]
    pub(crate) fn push(&mut self, paths: &[RankedPath]) {
        self.ranges.push((self.paths.len(), paths.len() as u32));
        self.paths.extend_from_slice(paths);
    }

    /// Paths to a state, best first.
    #[inline]
    pub(crate) fn of(&self, state: usize) -> &[RankedPath] {
        let (start, count) = self.ranges[state];
        &self.paths[start..start + count as usize]
    }

    /// Paths to a state. Their scores may be changed only in ways that keep their order.
    #[inline]
    pub(crate) fn of_mut(&mut self, state: usize) -> &mut [RankedPath] {
        let (start, count) = self.ranges[state];
        &mut self.paths[start..start + count as usize]
    }

    /// Removes the paths to a state.
    pub(crate) fn clear(&mut self, state: usize) {
        self.ranges[state].1 = 0;
    }

    /// Lists of all states, in the order of the states.
    pub(crate) fn iter(&self) -> impl Iterator<Item = &[RankedPath]> {
        (0..self.ranges.len()).map(|state| self.of(state))
    }
}

/// Collector of the best paths to one state, while moves into it are added.
#[derive(Debug)]
pub(crate) struct Best {
    pub(crate) paths: Vec<RankedPath>,
    count: usize,
}

impl Best {
    pub(crate) fn new(count: usize) -> Self {
        Self { paths: Vec::new(), count }
    }

    /// Adds the paths to the state `from`, best first, each extended by a move with this score.
    #[inline]
    pub(crate) fn extend(&mut self, from: usize, before: &[RankedPath], added: f64) {
        let extended = |(rank, path): (u32, &RankedPath)| RankedPath {
            score: path.score + added,
            from: from as u32,
            rank,
        };
        let all = (0..).zip(before).map(extended);
        // Many paths are collected now, then selected and sorted in `finish`.
        if self.count > FEW {
            return self.paths.extend(all);
        }
        for path in all {
            // Insertion sort from the end of a short list.
            let worse = |other: &RankedPath| order(&path, other).is_lt();
            let after = self.paths.iter().rev().take_while(|other| worse(other)).count();
            let place = self.paths.len() - after;
            // The list is full of better paths, and later paths from the same state are worse
            // still.
            if place == self.count {
                break;
            }
            if self.paths.len() == self.count {
                self.paths.pop();
            }
            self.paths.insert(place, path);
        }
    }

    /// Keeps only the best paths, sorted, once all moves are added. The order is total, so that
    /// unstable selection and sorting, which are faster, give the same as sorted insertion.
    pub(crate) fn finish(&mut self) {
        if self.count <= FEW {
            return;
        }
        if self.count < self.paths.len() {
            // Selection first, since only `count` of the paths have to be sorted.
            self.paths.select_nth_unstable_by(self.count, order);
            self.paths.truncate(self.count);
        }
        self.paths.sort_unstable_by(order);
    }
}

/// Compares paths: best first; ties go to the lowest `from`, then to the best rank. A total order.
fn order(a: &RankedPath, b: &RankedPath) -> std::cmp::Ordering {
    b.score.total_cmp(&a.score).then((a.from, a.rank).cmp(&(b.from, b.rank)))
}

/// Returns the best of the paths to all states of the last step.
pub(crate) fn best_ends<'a>(
    last: impl Iterator<Item = &'a [RankedPath]>,
    count: usize,
) -> Vec<RankedPath> {
    let mut ends = Best::new(count);
    last.enumerate().for_each(|(state, paths)| ends.extend(state, paths, 0.0));
    ends.finish();
    ends.paths
}

/// Returns the states of a path by going back from its end; `paths` returns the list of a state at
/// a step, counted from 0.
pub(crate) fn states<'a>(
    end: RankedPath,
    steps: usize,
    paths: impl Fn(usize, usize) -> &'a [RankedPath],
) -> Vec<usize> {
    // An end comes from `best_ends`: its `from` is the last state itself, and its `rank` a place in
    // that state's list. From there each path names its predecessor in the same way.
    let (mut states, mut path) = (vec![0; steps], end);
    for step in (0..steps).rev() {
        states[step] = path.from as usize;
        path = paths(step, states[step])[path.rank as usize];
    }
    states
}
