//! Rates from expected moves and times: q\[i, j\] = moves from j to i / time in j, the M-step of
//! Hobolth and Jensen (2011).

use std::collections::BTreeMap;

use super::GeneratorTransition;
use wayfix::Transition;
use wayfix::TransitionError;
use wayfix::error::Parameter;
use wayfix::internal::buffers;
use wayfix::transition::{LearnTransition, Move, MoveCounts};
use wayfix_kernels::limits::LIFT;

/// Expected moves and times in states, from which [`GeneratorTransition`] is learned.
#[derive(Debug, Clone, PartialEq)]
pub struct GeneratorStatistics {
    /// Number of each legal move, by the state that is left.
    moves: Vec<f64>,
    times: Vec<f64>,
    /// Moves between two observations, by the bits of the time between them (whose order is that of
    /// the times, as these are not negative). Not yet in the sums.
    between: BTreeMap<u64, MoveCounts>,
}

impl GeneratorStatistics {
    /// Expected time in each state, over all steps but those whose moves were counted one by one:
    /// steps of labelled drives, and steps in logarithms.
    #[must_use]
    pub fn times(&self) -> &[f64] {
        &self.times
    }

    /// Expected number of each legal move over the same steps, in the order of
    /// [`triplets`](GeneratorTransition::triplets).
    #[must_use]
    pub fn moves(&self) -> &[f64] {
        &self.moves
    }
}

impl GeneratorTransition {
    /// Adds the expected moves and times of a step, and returns Σ b(j) A\[i, j\] a(i) scale.
    fn add_expected(
        &self,
        sums: &mut GeneratorStatistics,
        time: f64,
        ends: (&[f64], &[f64]),
        scale: f64,
    ) -> f64 {
        let mean = self.mean_steps(time);
        // Entries of the chain come column by column. Each column has one stay; its other entries
        // are the legal moves in the order of `sums.moves`, so that `at` counts those.
        let (mut at, mut from) = (0, 0);
        self.expected(mean, ends, scale, |entry, share| {
            let columns = self.chain.columns();
            while entry >= columns.starts()[from + 1] as usize {
                from += 1;
            }
            let (to, p) = columns.entry(entry);
            // A share is P[i, j] times the mean of the product of both ends over the time. Without
            // P it is the part of the time spent in j; times Λ Δt it is the number of moves.
            if to == from {
                sums.times[from] += share / p * time;
            } else {
                sums.moves[at] += share * mean;
                at += 1;
            }
        })
    }

    /// Adds the expected moves and times between pairs of known states, each pair weighted by its
    /// count.
    fn add_between(
        &self,
        sums: &mut GeneratorStatistics,
        time: f64,
        counts: &MoveCounts,
    ) -> Result<(), TransitionError> {
        let moves: Vec<Move> = counts.moves().collect();
        for some in moves.chunk_by(|a, b| a.from == b.from) {
            let (n, from) = (self.states(), some[0].from);
            if from >= n {
                return Err(TransitionError::Forbidden { to: some[0].to, from });
            }
            // All moves out of one state are one step: it starts there (b is a unit vector) and
            // ends in each state as often as counted, a(i) = count / A[i, from]. A is lifted, so
            // that tiny entries have all their digits; the last argument takes the lift out.
            buffers::with_two(n, |unit, after| {
                unit.fill(0.0);
                unit[from] = LIFT;
                self.apply(&time, unit, after);
                unit[from] = 1.0;
                let mut moves = some.iter().peekable();
                for (to, after) in after.iter_mut().enumerate() {
                    let weight = moves.next_if(|m| m.to == to).map_or(0.0, |m| m.weight);
                    if weight > 0.0 && *after == 0.0 {
                        return Err(TransitionError::Forbidden { to, from });
                    }
                    *after = if weight > 0.0 { weight / *after } else { 0.0 };
                }
                if let Some(m) = moves.next() {
                    return Err(TransitionError::Forbidden { to: m.to, from });
                }
                self.add_expected(sums, time, (unit, after), LIFT);
                Ok(())
            })?;
        }
        Ok(())
    }
}

impl LearnTransition for GeneratorTransition {
    type Statistics = GeneratorStatistics;

    fn statistics(&self) -> GeneratorStatistics {
        let (moves, times) = (vec![0.0; self.rates.entries()], vec![0.0; self.states()]);
        GeneratorStatistics { moves, times, between: BTreeMap::new() }
    }

    fn merge(&self, sums: &mut GeneratorStatistics, other: &GeneratorStatistics) {
        sums.moves.iter_mut().zip(&other.moves).for_each(|(sum, moves)| *sum += moves);
        sums.times.iter_mut().zip(&other.times).for_each(|(sum, time)| *sum += time);
        for (time, counts) in &other.between {
            sums.between.entry(*time).or_default().merge(counts);
        }
    }

    fn counts<'s>(
        &self,
        sums: &'s mut GeneratorStatistics,
        time: &f64,
    ) -> Option<&'s mut MoveCounts> {
        // −0 and 0 are the same time.
        Some(sums.between.entry(time.abs().to_bits()).or_default())
    }

    fn add_step(
        &self,
        sums: &mut GeneratorStatistics,
        &time: &f64,
        before: &[f64],
        after: &[f64],
        scale: f64,
    ) -> Option<f64> {
        Some(self.add_expected(sums, time, (before, after), scale))
    }

    /// A rate that underflows beside the largest becomes 0, which makes the move illegal.
    fn maximize(
        &self,
        statistics: &GeneratorStatistics,
        pseudo_count: f64,
    ) -> Result<Self, TransitionError> {
        let found = (statistics.times.len(), statistics.moves.len());
        if found != (self.states(), self.rates.entries()) {
            let what = "the number of states and moves in the statistics";
            let expected = "as many as the operator has";
            return Err(Parameter::new(what, (found.0 + found.1) as f64, expected).into());
        }
        let mut sums = statistics.clone();
        for (time, counts) in &statistics.between {
            self.add_between(&mut sums, f64::from_bits(*time), counts)?;
        }
        let mut rates = Vec::with_capacity(sums.moves.len());
        let mut largest: f64 = 0.0;
        let mut moves = sums.moves.iter();
        for (from, time) in sums.times.iter().enumerate() {
            let mut exit = 0.0;
            for ((to, old), moves) in self.rates.line(from).zip(&mut moves) {
                let rate =
                    if *time < f64::MIN_POSITIVE { old } else { (moves + pseudo_count) / time };
                exit += rate;
                rates.push((to, from, rate));
            }
            largest = largest.max(exit);
        }
        // Rates that `from_triplets` would refuse, below 2.2e-308 of Λ, become 0.
        let least = largest * super::build::MARGIN * f64::MIN_POSITIVE * (1.0 + f64::EPSILON);
        rates.iter_mut().filter(|entry| entry.2 < least).for_each(|entry| entry.2 = 0.0);
        Self::from_triplets(self.states(), rates)
    }

    fn log_prior(&self, pseudo_count: f64) -> f64 {
        if pseudo_count == 0.0 {
            return 0.0;
        }
        pseudo_count * self.triplets().map(|entry| entry.2.ln()).sum::<f64>()
    }

    fn free_parameters(&self) -> usize {
        self.rates.entries()
    }
}

/// Rates of the legal moves.
impl wayfix::inference::FreeParameters for GeneratorTransition {
    fn displaced(
        &self,
        by: &mut wayfix::inference::Displacement<'_>,
    ) -> Result<Self, Box<dyn std::error::Error + Send + Sync>> {
        let moved = self.triplets().map(|(to, from, rate)| (to, from, by.positive(rate)));
        let moved: Vec<_> = moved.collect();
        Ok(Self::from_triplets(self.states(), moved)?)
    }
}
