//! Learning of dwell times: hazards from the numbers of vehicles that left and that stayed at each
//! age (guide, section 10, Dwell times).
//!
//! hazard = left / (left + stayed), the estimate of Kaplan and Meier (1958). Moves are counted
//! between places, not between pairs of states, so that a step costs O(states + entries of moves).

use std::error::Error;
use std::ops::Range;

use super::{Durations, DwellTransition};
use crate::error::TransitionError;
use crate::free_parameters::{Displacement, FreeParameters};
use crate::transition::{LearnTransition, Move, MoveCounts, Transition, buffers};

/// Re-estimates moves and dwell times.
impl<A: LearnTransition<Control = ()>> LearnTransition for DwellTransition<A> {
    /// Statistics of the moves between places; for each state the expected numbers of vehicles that
    /// left and that stayed; and moves between states that were counted one by one.
    type Statistics = (A::Statistics, Vec<[f64; 2]>, MoveCounts);

    fn statistics(&self) -> Self::Statistics {
        (self.moves.statistics(), vec![[0.0; 2]; self.states()], MoveCounts::default())
    }

    fn merge(&self, (moves, ages, listed): &mut Self::Statistics, other: &Self::Statistics) {
        self.moves.merge(moves, &other.0);
        for (sum, more) in ages.iter_mut().zip(&other.1) {
            sum.iter_mut().zip(more).for_each(|(sum, more)| *sum += more);
        }
        listed.merge(&other.2);
    }

    fn counts<'s>(
        &self,
        (.., listed): &'s mut Self::Statistics,
        (): &(),
    ) -> Option<&'s mut MoveCounts> {
        Some(listed)
    }

    fn add_step(
        &self,
        (moves, ages, _): &mut Self::Statistics,
        (): &(),
        before: &[f64],
        after: &[f64],
        scale: f64,
    ) -> Option<f64> {
        let mut sum = 0.0;
        // 0 times anything is 0: `after` may be NaN for a state that no move reaches.
        let times = |p: f64, after: f64| if p > 0.0 { p * after } else { 0.0 };
        buffers::with(self.places(), |left| {
            for (place, states) in self.ranges() {
                // Σ_i moves[i, place] after(first age of i): what leaving this place is worth, the
                // same at all of its ages.
                let mut leads_on = 0.0;
                for (to, p) in self.moves.outgoing(&(), place) {
                    leads_on += times(p, after[self.starts[to]]);
                }
                let last = states.end - 1;
                left[place] = 0.0;
                for state in states {
                    let leaves = before[state] * self.leave[state];
                    left[place] += leaves;
                    let stays = before[state] * self.stay[state];
                    let older = after[(state + 1).min(last)];
                    let expected = [times(leaves, leads_on), times(stays, older)];
                    for (sum_of, expected) in ages[state].iter_mut().zip(expected) {
                        *sum_of += expected * scale;
                        sum += expected * scale;
                    }
                }
            }
            // Moves between places, with the departures of all ages of a place taken together.
            if let Some(counts) = self.moves.counts(moves, &()) {
                counts.add((0..self.places()).filter(|from| left[*from] > 0.0).flat_map(|from| {
                    let left = left[from];
                    self.moves.counted(&(), from).map(move |(to, p)| {
                        let weight = left * times(p, after[self.starts[to]]) * scale;
                        Move { from, to, weight }
                    })
                }));
            }
        });
        Some(sum)
    }

    fn maximize(
        &self,
        (moves, ages, listed): &Self::Statistics,
        pseudo_count: f64,
    ) -> Result<Self, TransitionError> {
        let (found, expected) = (ages.len(), self.states());
        if found != expected {
            return Err(TransitionError::Statistics { found, expected });
        }
        let (mut moves, mut ages) = (moves.clone(), ages.clone());
        self.add_listed(&mut moves, &mut ages, listed)?;
        let moves = self.moves.maximize(&moves, pseudo_count)?;
        if self.durations.is_empty() {
            let age = |(state, &[left, stayed]): (usize, &[f64; 2])| {
                // What is impossible stays impossible, as entries of 0 do in all operators.
                let (leave, stay) = (self.leave[state], self.stay[state]);
                if leave == 0.0 || stay == 0.0 {
                    return (leave, stay);
                }
                let (left, stayed) = (left + pseudo_count, stayed + pseudo_count);
                let sum = left + stayed;
                if sum < f64::MIN_POSITIVE { (leave, stay) } else { (left / sum, stayed / sum) }
            };
            let learned: Vec<_> = ages.iter().enumerate().map(age).collect();
            let of_place = |(_, states): (_, Range<usize>)| learned[states].to_vec();
            return Self::from_ages(moves, self.ranges().map(of_place).collect());
        }
        let learned: Vec<Durations> = self
            .ranges()
            .zip(&self.durations)
            .map(|((_, states), durations)| {
                let (left, stayed): (Vec<f64>, Vec<f64>) =
                    ages[states].iter().map(|&[left, stayed]| (left, stayed)).unzip();
                durations.maximize(&left, &stayed)
            })
            .collect();
        // All places have the same number of ages, that of the first.
        Self::from_durations(moves, &learned, self.starts[1])
    }

    fn log_prior(&self, pseudo_count: f64) -> f64 {
        let moves = self.moves.log_prior(pseudo_count);
        if pseudo_count == 0.0 || !self.durations.is_empty() {
            return moves;
        }
        let logs = self.free_ages().map(|state| self.leave[state].ln() + self.stay[state].ln());
        moves + pseudo_count * logs.sum::<f64>()
    }

    /// Counts a parameter for each age at which a vehicle may either leave or stay, or those of the
    /// [`Durations`].
    fn free_parameters(&self) -> usize {
        let parameters = self.durations.iter().map(|durations| durations.parameters());
        let ages = if self.durations.is_empty() { self.free_ages().count() } else { 0 };
        self.moves.free_parameters() + ages + parameters.sum::<usize>()
    }
}

/// Parameters of the moves, then the odds of leaving at each age, or the parameters of the
/// [`Durations`].
impl<A: FreeParameters + Transition> FreeParameters for DwellTransition<A> {
    fn displaced(&self, by: &mut Displacement<'_>) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let moves = self.moves.displaced(by)?;
        if !self.durations.is_empty() {
            let durations = self.durations.iter().map(|durations| durations.displaced(by));
            let durations: Vec<Durations> = durations.collect();
            return Ok(Self::from_durations(moves, &durations, self.starts[1])?);
        }
        let mut ages = Vec::with_capacity(self.starts.len());
        for (_, states) in self.ranges() {
            let age = |state: usize| {
                let mut age = [self.leave[state], self.stay[state]];
                by.distribution(&mut age);
                (age[0], age[1])
            };
            ages.push(states.map(age).collect());
        }
        Ok(Self::from_ages(moves, ages)?)
    }
}

impl<A: LearnTransition<Control = ()>> DwellTransition<A> {
    /// States where a vehicle may either leave or stay.
    fn free_ages(&self) -> impl Iterator<Item = usize> {
        (0..self.leave.len()).filter(|&state| self.leave[state] > 0.0 && self.stay[state] > 0.0)
    }

    /// Adds moves between states that were counted one by one, to those of places and of ages.
    fn add_listed(
        &self,
        moves: &mut A::Statistics,
        ages: &mut [[f64; 2]],
        listed: &MoveCounts,
    ) -> Result<(), TransitionError> {
        let mut between = Vec::new();
        for Move { from, to, weight } in listed.moves() {
            let forbidden = TransitionError::Forbidden { to, from };
            if from.max(to) >= self.states() {
                return Err(forbidden);
            }
            let (place, last) = self.place(from);
            // The entry from → to is the sum of a move to the first age of a place (`again`) and a
            // stay that leads to the next age; the weight is shared between both in proportion.
            let target = self.groups.as_slice()[to];
            let again = if self.starts[target] == to {
                let entry = self.moves.outgoing(&(), place).find(|entry| entry.0 == target);
                entry.map_or(0.0, |entry| entry.1) * self.leave[from]
            } else {
                0.0
            };
            let stay = if to == if last { from } else { from + 1 } { self.stay[from] } else { 0.0 };
            // With one age, a stay and a move back to the same place are one entry.
            let sum = again + stay;
            if sum == 0.0 {
                return Err(forbidden);
            }
            ages[from][0] += weight * (again / sum);
            ages[from][1] += weight * (stay / sum);
            // Part of the entry of a move back may be a restart: only the rest is counted.
            let counted = self.moves.counted(&(), place).find(|entry| entry.0 == target);
            if let Some((_, p)) = counted.filter(|_| again > 0.0) {
                let weight = weight * (p * self.leave[from] / sum);
                between.push(Move { from: place, to: target, weight });
            }
        }
        if let Some(counts) = self.moves.counts(moves, &()) {
            counts.merge(&MoveCounts::from_moves(between));
        }
        Ok(())
    }
}
