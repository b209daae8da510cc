//! The k most probable paths: Viterbi with a list for each state (Seshadri and
//! Sundberg 1994).

use super::viterbi::ViterbiPath;
use crate::error::InferenceError;
use crate::hmm::Hmm;
use crate::inference::step::scores::TakenOut;
use crate::inference::step::{Step, Workspace};
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::TransitionEntries;

/// A path to a state: its score, the state before, and the rank of the path to that state that it
/// extends.
#[derive(Debug, Clone, Copy)]
struct Way {
    score: f64,
    from: u32,
    rank: u32,
}

impl<A: TransitionEntries, B: Likelihood> Hmm<A, B> {
    /// Returns the `count` most probable paths x_1 … x_T, the best first; fewer, if the model
    /// allows fewer. They are distinct, and the first is that of [`viterbi`](Self::viterbi) (to
    /// the last digit but one, where an operator adds the logarithms of several factors).
    ///
    /// Equally probable paths are in the order of their last state, then of the last but one, and
    /// so on; [`viterbi`](Self::viterbi) says which paths count as equal. As there, X_0 is summed
    /// over. An empty sequence has one path, the empty one. A `count` of 0 gives no path.
    ///
    /// O(E K + n K log K) a step for K paths; 16 n K T bytes for the backpointers, and 24 n T.
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
    pub fn k_best<S>(&self, sequence: &S, count: usize) -> Result<Vec<ViterbiPath>, InferenceError>
    where
        S: Sequence<A::Control, B::Observation> + ?Sized,
    {
        let (n, steps) = (self.states(), sequence.steps());
        if steps == 0 {
            let empty = ViterbiPath { states: Vec::new(), log_probability: 0.0 };
            return Ok(vec![empty; count.min(1)]);
        }
        let mut work = Workspace::new(n);
        let mut taken_out = TakenOut::default();
        // Paths to each state of each step, best first.
        let mut lists: Vec<Vec<Vec<Way>>> = Vec::with_capacity(steps);
        let mut added = vec![0.0; n];
        for number in 1..=steps {
            let step = Step::of(self, sequence, number);
            let mut list = match lists.last() {
                None => step.first_ways(&mut added, &mut taken_out)?,
                // At least one, to detect impossible observations.
                Some(before) => step.best_ways(before, count.max(1), &mut taken_out)?,
            };
            added.fill(0.0);
            let observation = sequence.observation(number);
            step.observe(observation, &mut work, &mut added, &mut taken_out)?;
            let mut best: Vec<f64> = (list.iter().zip(&added))
                .map(|(ways, added)| ways.first().map_or(f64::NEG_INFINITY, |w| w.score + added))
                .collect();
            let floor = step.settle(&mut best, &mut taken_out)?;
            for ((ways, best), added) in list.iter_mut().zip(&best).zip(&added) {
                if *best == f64::NEG_INFINITY {
                    ways.clear();
                }
                ways.iter_mut().for_each(|way| way.score = (way.score + added) - floor);
            }
            lists.push(list);
        }
        let last = lists.last().into_iter().flatten().enumerate();
        let mut ends: Vec<Way> = last
            .flat_map(|(i, ways)| {
                (0..).zip(ways).map(move |(rank, w)| Way { score: w.score, from: i as u32, rank })
            })
            .collect();
        keep_best(&mut ends, count);
        let path = |end: &Way| {
            let mut states = vec![0; steps];
            let mut at = *end;
            for (state, list) in states.iter_mut().zip(&lists).rev() {
                *state = at.from as usize;
                at = list[*state][at.rank as usize];
            }
            ViterbiPath { states, log_probability: taken_out.log_probability(end.score) }
        };
        Ok(ends.iter().map(path).collect())
    }
}

impl<A: TransitionEntries, B: Likelihood> Step<'_, A, B> {
    /// Returns the only path to each state of step 1.
    fn first_ways(
        &self,
        scores: &mut [f64],
        taken_out: &mut TakenOut,
    ) -> Result<Vec<Vec<Way>>, InferenceError> {
        self.first_scores(scores, taken_out)?;
        let way = |&score: &f64| Way { score, from: 0, rank: 0 };
        let possible = |way: &Way| way.score > f64::NEG_INFINITY;
        Ok(scores
            .iter()
            .map(|score| Some(way(score)).filter(possible).into_iter().collect())
            .collect())
    }

    /// Extends the paths to the states before to the best paths to each state.
    fn best_ways(
        &self,
        before: &[Vec<Way>],
        count: usize,
        taken_out: &mut TakenOut,
    ) -> Result<Vec<Vec<Way>>, InferenceError> {
        let Some(control) = self.control else { return Ok(Vec::new()) }; // only step 1 has none
        let evidence = self.take_out_evidence(taken_out)?;
        let into = |i: usize| {
            let mut ways = Vec::new();
            for (j, log2) in self.hmm.transition().incoming_log2(control, i) {
                ways.extend((0..).zip(&before[j]).map(|(rank, way)| Way {
                    score: way.score + log2,
                    from: j as u32,
                    rank,
                }));
            }
            keep_best(&mut ways, count);
            ways
        };
        let lists: Vec<Vec<Way>> = (0..before.len()).map(into).collect();
        if evidence {
            let first = lists.iter().filter_map(|ways| Some(ways.first()?.score));
            self.check_best_way(first.fold(f64::NEG_INFINITY, f64::max))?;
        }
        Ok(lists)
    }
}

/// Keeps the best, in order; ties go to the lowest state before, then to the best rank among its
/// paths.
fn keep_best(ways: &mut Vec<Way>, count: usize) {
    let order = |a: &Way, b: &Way| {
        b.score.total_cmp(&a.score).then((a.from, a.rank).cmp(&(b.from, b.rank)))
    };
    if count < ways.len() {
        ways.select_nth_unstable_by(count, order);
        ways.truncate(count);
    }
    ways.sort_unstable_by(order);
    ways.shrink_to_fit();
}
