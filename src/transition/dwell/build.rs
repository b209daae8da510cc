//! Construction from distributions of dwell times, hazards, or families of durations. All become
//! pairs (leave, stay) for each age, the hazard and its complement, each computed for itself, so
//! that neither loses digits where the other is near 1.

use super::{Durations, DwellTransition};
use crate::error::{OutOfRange, TransitionError};
use crate::groups::Groups;
use crate::transition::{Transition, check_count, check_probability, check_sum};
use wayfix_kernels::log2;

impl<A: Transition> DwellTransition<A> {
    /// Creates the operator from distributions of dwell times:
    /// `dwell[i][d - 1]` = p(d steps in place i). O(states).
    ///
    /// A place has as many states as its longest dwell time has steps.
    ///
    /// # Errors
    ///
    /// [`TransitionError::PartStates`] unless there is a distribution for each state of
    /// `moves`, [`TransitionError::Parameter`] for a probability that is NaN,
    /// negative or infinite, or for probabilities that do not sum to one within
    /// 1e-9, or [`TransitionError::TooMany`] for more than 2^32 − 1 states.
    pub fn new<D: AsRef<[f64]>>(moves: A, dwell: &[D]) -> Result<Self, TransitionError> {
        let split = |(place, dwell): (usize, &D)| {
            let dwell = dwell.as_ref();
            check_sum(dwell, format!("the sum of the dwell times of place {place}"), |at| {
                format!("the probability of {} steps in place {place}", at + 1)
            })?;
            // From the longest stay down, P(D > d) is a sum of positive terms. Computed as 1 less
            // the terms up to d, it would cancel. The last age has hazard p / p = 1.
            let end = dwell.iter().rposition(|p| *p > 0.0).map_or(0, |last| last + 1);
            let mut ages = vec![(1.0, 0.0); end];
            let mut longer = 0.0; // the probability of more steps
            for (age, p) in ages.iter_mut().zip(&dwell[..end]).rev() {
                let reached = p + longer;
                *age = (p / reached, longer / reached);
                longer = reached;
            }
            Ok(ages)
        };
        Self::from_ages(
            moves,
            dwell.iter().enumerate().map(split).collect::<Result<_, TransitionError>>()?,
        )
    }

    /// Creates the operator from hazards: `leaving[i][c]` = p(place i is left after c + 1 steps,
    /// given that it is not left before). The last value holds for all later steps: a single value
    /// is a geometric dwell time, and a last value of 0 keeps the vehicle in the place. O(states).
    ///
    /// # Errors
    ///
    /// As [`new`](Self::new), but probabilities of leaving must be from 0 to 1, and each place must
    /// have at least one.
    pub fn from_leaving<D: AsRef<[f64]>>(moves: A, leaving: &[D]) -> Result<Self, TransitionError> {
        let split = |(place, leaving): (usize, &D)| {
            let leaving = leaving.as_ref();
            if leaving.is_empty() {
                let what = format!("the number of leaving probabilities of place {place}");
                return Err(OutOfRange::new(what, 0.0, "at least 1").into());
            }
            let age = |(at, &leave): (usize, &f64)| {
                check_probability(leave, || {
                    format!("the probability of leaving place {place} after {} steps", at + 1)
                })?;
                Ok((leave, 1.0 - leave))
            };
            leaving.iter().enumerate().map(age).collect()
        };
        Self::from_ages(
            moves,
            leaving.iter().enumerate().map(split).collect::<Result<_, TransitionError>>()?,
        )
    }

    /// Creates the operator from a distribution of dwell times for each place, with an age for each
    /// step up to `longest`. Beyond it the ratio p(d + 1) / p(d) stays constant, a geometric tail,
    /// so choose `longest` such that hardly any stay is longer. O(states).
    ///
    /// # Errors
    ///
    /// As [`new`](Self::new), or [`TransitionError::Parameter`] for a parameter that is out of its
    /// range, or a `longest` that is 0 or not beyond the likeliest duration.
    pub fn from_durations(
        moves: A,
        durations: &[Durations],
        longest: usize,
    ) -> Result<Self, TransitionError> {
        if longest == 0 {
            let what = "the number of ages in each place";
            return Err(OutOfRange::new(what, 0.0, "at least 1").into());
        }
        // Checked before memory is allocated: a large `longest` may ask for too much.
        check_count("states", durations.len().saturating_mul(longest))?;
        let ages = |(place, durations): (usize, &Durations)| {
            durations.check(place, longest)?;
            let mut ages = vec![(0.0, 0.0); longest];
            durations.for_each_hazard(longest, |d, leave, stay| ages[d - 1] = (leave, stay));
            Ok(ages)
        };
        let ages =
            durations.iter().enumerate().map(ages).collect::<Result<_, TransitionError>>()?;
        Ok(Self { durations: durations.to_vec(), ..Self::from_ages(moves, ages)? })
    }

    /// Builds the operator from the probabilities of leaving and staying at each age, with at least
    /// one age for each place.
    pub(crate) fn from_ages(moves: A, ages: Vec<Vec<(f64, f64)>>) -> Result<Self, TransitionError> {
        let (found, expected) = (ages.len(), moves.states());
        if found != expected {
            return Err(TransitionError::PartStates { part: "dwell table", found, expected });
        }
        if found == 0 {
            return Err(TransitionError::Empty);
        }
        let mut starts = vec![0];
        ages.iter().for_each(|ages| starts.push(starts[starts.len() - 1] + ages.len()));
        check_count("states", starts[expected])?;
        let of = (0..expected).flat_map(|place| vec![place; ages[place].len()]).collect();
        let groups = Groups::numbered(of, expected);
        let (leave, stay): (Vec<_>, Vec<_>) = ages.into_iter().flatten().unzip();
        let log2_leave = leave.iter().map(|&p| log2(p)).collect();
        let log2_stay = stay.iter().map(|&p| log2(p)).collect();
        let durations = Vec::new();
        Ok(Self { moves, groups, starts, leave, stay, log2_leave, log2_stay, durations })
    }
}
