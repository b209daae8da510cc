//! [`DwellTransition`], explicit durations of stays (semi-Markov), by hazards for each age (guide,
//! section 10, Dwell times).
//!
//! States are pairs of place and age. Products go through places, not pairs of states: all that
//! leave a place are added up, moved by the operator of moves, and arrive at the first age of
//! theirs; all others grow older by a step.

mod build;
mod durations;
mod entries;
mod learn;

use std::ops::Range;

pub use durations::Durations;

use super::{Transition, buffers, check_slices, log};
use crate::belief::Belief;
use crate::error::{OutOfRange, TransitionError};
use crate::groups::Groups;
use wayfix_kernels as kernels;

/// A semi-Markov operator: dwell times in each place have any distribution, while those of a plain
/// operator are geometric.
///
/// A state is a place and an age, the number of steps already spent there; states are numbered
/// place by place, ages ascending. After each step the vehicle leaves the place with a probability
/// that depends on the age, and moves by the operator `moves`; a move to the same place resets the
/// age.
///
/// Products and steps of Viterbi cost O(states), plus one product or step of `moves`. There are as
/// many states as ages in all places: 600 a place for stays of up to ten minutes in steps of a
/// second. For each state the operator takes 48 bytes, a filter seven numbers or more, and a
/// snapshot 8 bytes; [`expected_moves`](crate::Hmm::expected_moves) takes 24 bytes for each move of
/// a state, to the next age and to every neighbouring place.
/// [`GroupedLikelihood`](crate::likelihood::GroupedLikelihood) lifts sensors of places to states,
/// and [`groups`](Self::groups) brings results back to places.
///
/// # Learning
///
/// Durations are learned with the moves: of [`Durations`] the parameters, otherwise the probability
/// of leaving at each age, as the share of vehicles that left among those that reached it (Kaplan
/// and Meier, 1958). So a stay that is cut off by the end of a sequence counts for what it shows. A
/// stay before the first step is as old as the prior says. An iteration takes
/// O(states + entries of `moves`) a step. Learning without labels needs an operator `moves` without
/// a control. [`path`](Self::path) turns labels of places into labels of states.
///
/// ```
/// use wayfix::likelihood::GroupedLikelihood;
/// use wayfix::transition::DwellTransition;
/// use wayfix::{Belief, Hmm, Prior};
/// use wayfix::{SparseTransition, TableLikelihood};
///
/// // Around two places, with two or three steps in the first, and one in the other.
/// let moves = SparseTransition::from_rows(&[[0.0, 1.0], [1.0, 0.0]])?;
/// let bus = DwellTransition::new(moves, &[vec![0.0, 0.5, 0.5], vec![1.0]])?;
/// let places = bus.groups().clone();
/// let prior = Prior::AtFirstObservation(bus.arriving(&Belief::certain(2, 0)?)?);
/// let camera = TableLikelihood::from_rows(&[[0.75, 0.25], [0.25, 0.75]])?;
/// let hmm = Hmm::new(prior, bus, GroupedLikelihood::new(camera, places)?)?;
///
/// let path = hmm.viterbi(&[0, 1, 0, 1])?; // it can't have left after one step
/// let places = hmm.transition().groups();
/// assert_eq!(places.map_path(path.states())?, [0, 0, 0, 1]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct DwellTransition<A> {
    pub(crate) moves: A,
    groups: Groups,
    /// The first state of each place, and the end.
    starts: Vec<usize>,
    /// The probabilities of leaving and of staying, and their logarithms.
    pub(crate) leave: Vec<f64>,
    pub(crate) stay: Vec<f64>,
    log2_leave: Vec<f64>,
    log2_stay: Vec<f64>,
    /// Distribution in each place; empty if hazards were given.
    pub(crate) durations: Vec<Durations>,
}

impl<A: Transition> DwellTransition<A> {
    /// Distribution of the durations in a place, as given to
    /// [`from_durations`](Self::from_durations) or learned from such a start; otherwise `None`.
    #[must_use]
    pub fn durations(&self, place: usize) -> Option<Durations> {
        self.durations.get(place).copied()
    }

    /// Probability that a place is left after `steps` steps, given that it is not left before;
    /// `None` if the place does not exist, or for 0 steps.
    #[must_use]
    pub fn leaving(&self, place: usize, steps: usize) -> Option<f64> {
        let range = self.starts.get(place).copied()?..self.starts.get(place + 1).copied()?;
        // The hazard of the oldest age holds for all later steps.
        let state = range.start + steps.checked_sub(1)?.min(range.len() - 1);
        Some(self.leave[state])
    }

    /// States of a path of places, for learning from labels: a stay begins at the first step, and
    /// wherever the place changes.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Parameter`] for a place that does not exist.
    pub fn path(&self, places: &[usize]) -> Result<Vec<usize>, TransitionError> {
        let mut states: Vec<usize> = Vec::with_capacity(places.len());
        for (step, &place) in places.iter().enumerate() {
            let Some(first) = self.arrival(place) else {
                let what = format!("the place at step {}", step + 1);
                return Err(OutOfRange::new(what, place as f64, "a place of the operator").into());
            };
            let stays = step > 0 && places[step - 1] == place;
            let last = self.starts[place + 1] - 1;
            let older = states.last().map(|state| (state + 1).min(last));
            states.push(older.filter(|_| stays).unwrap_or(first));
        }
        Ok(states)
    }

    /// The operator of the moves made on leaving a place.
    #[must_use]
    pub fn moves(&self) -> &A {
        &self.moves
    }

    /// The place of each state.
    pub fn groups(&self) -> &Groups {
        &self.groups
    }

    /// The state of a vehicle that has just arrived at a place, or `None` if the place does not
    /// exist.
    pub fn arrival(&self, place: usize) -> Option<usize> {
        (place < self.places()).then(|| self.starts[place])
    }

    /// Lifts a belief over places to states, for a vehicle that has just arrived.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] if the belief is over another number of places.
    pub fn arriving<S: AsRef<[f64]>>(&self, places: &Belief<S>) -> Result<Belief, OutOfRange> {
        let (found, expected) = (places.states(), self.places());
        if found != expected {
            return Err(OutOfRange::count("the number of places of the belief", found, expected));
        }
        let mut states = vec![0.0; self.states()];
        self.starts.iter().zip(places.values()).for_each(|(&state, &p)| states[state] = p);
        Ok(Belief::from_valid(states))
    }

    fn places(&self) -> usize {
        self.starts.len() - 1
    }

    /// The places, each with the range of its states.
    pub(crate) fn ranges(&self) -> impl Iterator<Item = (usize, Range<usize>)> {
        self.starts.windows(2).map(|pair| pair[0]..pair[1]).enumerate()
    }

    /// Product in linear space or in logarithms: departures from each place, their arrivals, and
    /// stays.
    fn forward(
        &self,
        x: &[f64],
        out: &mut [f64],
        leaving: impl Fn(Range<usize>) -> f64,
        moves: impl Fn(&[f64], &mut [f64]),
        times: impl Fn(f64, f64) -> f64,
        plus: impl Fn(f64, f64) -> f64,
    ) {
        check_slices(self.states(), x, out);
        buffers::with_two(self.places(), |left, arrived| {
            self.ranges().for_each(|(place, range)| left[place] = leaving(range));
            moves(left, arrived);
            for (place, range) in self.ranges() {
                // Ages shift by one, into the slots after the first, which takes the arrivals. The
                // oldest age has no next one: its stays add to it. With one age, `out[last]` is the
                // arrivals; with more, the stays of the previous age. So it has been set in either
                // case.
                let last = range.end - 1;
                out[range.start] = arrived[place];
                for state in range.start..last {
                    out[state + 1] = times(self.stay[state], x[state]);
                }
                out[last] = plus(out[last], times(self.stay[last], x[last]));
            }
        });
    }

    /// Product with the transpose, in linear space or in logarithms.
    fn backward(
        &self,
        x: &[f64],
        out: &mut [f64],
        moves: impl Fn(&[f64], &mut [f64]),
        times: impl Fn(f64, f64) -> f64,
        plus: impl Fn(f64, f64) -> f64,
    ) {
        check_slices(self.states(), x, out);
        buffers::with_two(self.places(), |arrived, left| {
            // A move out of a place leads only to the first age of another place, so one product
            // over places gives the value of leaving, which is the same at all ages.
            self.ranges().for_each(|(place, range)| arrived[place] = x[range.start]);
            moves(arrived, left);
            for (place, range) in self.ranges() {
                for state in range.clone() {
                    let stay = times(self.stay[state], x[(state + 1).min(range.end - 1)]);
                    out[state] = plus(times(self.leave[state], left[place]), stay);
                }
            }
        });
    }
}

impl<A: Transition> Transition for DwellTransition<A> {
    type Control = A::Control;

    fn states(&self) -> usize {
        self.leave.len()
    }

    fn has_restarts(&self) -> bool {
        self.moves.has_restarts()
    }

    fn apply(&self, control: &A::Control, x: &[f64], out: &mut [f64]) {
        let leaving = |range: Range<usize>| kernels::dot(&self.leave[range.clone()], &x[range]);
        let moves = |x: &[f64], out: &mut [f64]| self.moves.apply(control, x, out);
        self.forward(x, out, leaving, moves, |p, x| p * x, |a, b| a + b);
    }

    fn apply_transpose(&self, control: &A::Control, x: &[f64], out: &mut [f64]) {
        let moves = |x: &[f64], out: &mut [f64]| self.moves.apply_transpose(control, x, out);
        self.backward(x, out, moves, |p, x| p * x, |a, b| a + b);
    }

    fn apply_log(&self, control: &A::Control, x: &[f64], out: &mut [f64]) {
        let leaving = |range: Range<usize>| {
            let leave = range.map(|state| (state, self.leave[state]));
            log::sum(leave.filter(|entry| entry.1 > 0.0), x)
        };
        let moves = |x: &[f64], out: &mut [f64]| self.moves.apply_log(control, x, out);
        self.forward(x, out, leaving, moves, |p, x| p.ln() + x, log::add);
    }

    fn apply_transpose_log(&self, control: &A::Control, x: &[f64], out: &mut [f64]) {
        let moves = |x: &[f64], out: &mut [f64]| self.moves.apply_transpose_log(control, x, out);
        self.backward(x, out, moves, |p, x| p.ln() + x, log::add);
    }

    fn check_control(&self, control: &A::Control) -> Result<(), TransitionError> {
        super::refuse_evidence(&self.moves, control, "DwellTransition")
    }
}

#[cfg(feature = "serde")]
crate::stored! {
    [A: Transition] DwellTransition<A>: [A], |a| {
        moves: A = a.moves,
        ages: Vec<Vec<(f64, f64)>> = {
            let age = |state: usize| (a.leave[state], a.stay[state]);
            a.ranges().map(|(_, states)| states.map(age).collect()).collect::<Vec<Vec<_>>>()
        },
        durations: Vec<Durations> = a.durations,
    } => dwelling(moves, ages, &durations);
}

#[cfg(feature = "serde")]
fn dwelling<A: Transition>(
    moves: A,
    ages: Vec<Vec<(f64, f64)>>,
    durations: &[Durations],
) -> Result<DwellTransition<A>, TransitionError> {
    if let ([_, ..], Some(first)) = (durations, ages.first()) {
        let place = ages.iter().position(|ages| ages.len() != first.len());
        if let Some(place) = place.or((ages.len() != durations.len()).then_some(durations.len())) {
            let what = format!("the number of ages of place {place}");
            let found = ages.get(place).map_or(0, Vec::len);
            return Err(OutOfRange::new(what, found as f64, "the same in all places").into());
        }
        return DwellTransition::from_durations(moves, durations, first.len());
    }
    for (place, ages) in ages.iter().enumerate() {
        if ages.is_empty() {
            let what = format!("the number of ages of place {place}");
            return Err(OutOfRange::new(what, 0.0, "at least 1").into());
        }
        for (&(leave, stay), steps) in ages.iter().zip(1..) {
            let what =
                |verb: &str| format!("the probability of {verb} place {place} after {steps} steps");
            crate::transition::check_probability(leave, || what("leaving"))?;
            crate::transition::check_probability(stay, || what("staying in"))?;
            crate::transition::check::check_one(leave + stay, || what("leaving or staying in"))?;
        }
    }
    DwellTransition::from_ages(moves, ages)
}
