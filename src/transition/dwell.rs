//! Explicit durations of stays (semi-Markov).

use std::iter::once;
use std::ops::{Add, Range};

use super::{Transition, TransitionEntries, best_of, buffers, check_count, check_slices};
use super::{check_probability, check_sum, log, merge};
use crate::belief::Belief;
use crate::error::{BeliefError, Parameter, TransitionError};
use crate::groups::Groups;
use crate::kernels::{self, log2};

/// A semi-Markov operator: dwell times in each place have any distribution, where those of a
/// plain operator are geometric.
///
/// A state is a place and an age, the number of steps already spent there;
/// states are numbered place by place, ages ascending. After each step the
/// vehicle leaves the place with a probability that depends on the age, and
/// moves by the operator `moves`; a move to the same place resets the age.
///
/// Products and steps of Viterbi cost O(states) and one of `moves`. There are as many states as
/// ages in all places, 600 for each place with stays of up to ten minutes in steps of a second:
/// the operator has 48 bytes for each, a filter seven numbers or more, a snapshot 8 bytes, and
/// [`expected_moves`](crate::Hmm::expected_moves) 24 for each of its moves, to an older age and to
/// every place beside. Place
/// sensors are lifted to states by
/// [`GroupedLikelihood`](crate::likelihood::GroupedLikelihood), results brought back to
/// places by [`groups`](Self::groups).
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
}

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
            let end = dwell.iter().rposition(|p| *p > 0.0).map_or(0, |last| last + 1);
            let mut ages = vec![(1.0, 0.0); end];
            let mut longer = 0.0; // the probability of more steps than these
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

    /// Creates the operator from hazards: `leaving[i][c]` = p(place i is left
    /// after c + 1 steps, given that it is not left before). The last value holds for all later
    /// steps: a single value is a geometric dwell time, and a last value of 0
    /// keeps the vehicle in the place. O(states).
    ///
    /// # Errors
    ///
    /// As [`new`](Self::new); probabilities of leaving are from 0 to 1, and
    /// each place has at least one.
    pub fn from_leaving<D: AsRef<[f64]>>(moves: A, leaving: &[D]) -> Result<Self, TransitionError> {
        let split = |(place, leaving): (usize, &D)| {
            let leaving = leaving.as_ref();
            if leaving.is_empty() {
                let what = format!("the number of leaving probabilities of place {place}");
                return Err(Parameter::new(what, 0.0, "at least 1").into());
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

    /// The operator of moves on leaving a place.
    #[must_use]
    pub fn moves(&self) -> &A {
        &self.moves
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
        Ok(Self { moves, groups, starts, leave, stay, log2_leave, log2_stay })
    }

    /// The place of each state.
    pub fn groups(&self) -> &Groups {
        &self.groups
    }

    /// The state of a vehicle that has just arrived at a place, or `None` if there
    /// is no such place.
    pub fn arrival(&self, place: usize) -> Option<usize> {
        (place < self.places()).then(|| self.starts[place])
    }

    /// Lifts a belief over places to states, for a vehicle that has just arrived.
    ///
    /// # Errors
    ///
    /// [`BeliefError::StateCount`] if the belief is over another number of places.
    pub fn arriving<S: AsRef<[f64]>>(&self, places: &Belief<S>) -> Result<Belief, BeliefError> {
        let (found, expected) = (places.states(), self.places());
        if found != expected {
            return Err(BeliefError::StateCount { found, expected });
        }
        let mut states = vec![0.0; self.states()];
        self.starts.iter().zip(places.values()).for_each(|(&state, &p)| states[state] = p);
        Ok(Belief::known(states))
    }

    fn places(&self) -> usize {
        self.starts.len() - 1
    }

    /// The places, each with the range of its states.
    pub(crate) fn ranges(&self) -> impl Iterator<Item = (usize, Range<usize>)> {
        self.starts.windows(2).map(|pair| pair[0]..pair[1]).enumerate()
    }

    /// Product in linear space or in logarithms: departures of each place, their arrivals, and
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

    /// The place of a state, and true if the state is of the oldest age there.
    fn place(&self, state: usize) -> (usize, bool) {
        let place = self.groups.as_slice()[state];
        (place, state + 1 == self.starts[place + 1])
    }
}

impl<A: Transition> Transition for DwellTransition<A> {
    type Control = A::Control;

    fn states(&self) -> usize {
        self.leave.len()
    }

    fn no_control(&self) -> Option<&'static A::Control> {
        self.moves.no_control()
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

impl<A: TransitionEntries> TransitionEntries for DwellTransition<A> {
    fn incoming(&self, control: &A::Control, to: usize) -> impl Iterator<Item = (usize, f64)> {
        let (place, last) = self.place(to);
        let arrives = self.starts[place] == to;
        let moves = arrives.then(|| self.moves.incoming(control, place)).into_iter().flatten();
        let arrivals = moves.flat_map(move |(j, p)| {
            (self.starts[j]..self.starts[j + 1]).map(move |state| (state, p * self.leave[state]))
        });
        let younger = (!arrives).then(|| to - 1).into_iter();
        let stays = younger.chain(last.then_some(to)).map(move |state| (state, self.stay[state]));
        merge(arrivals, stays, f64::add).filter(|entry| entry.1 > 0.0)
    }

    fn outgoing(&self, control: &A::Control, from: usize) -> impl Iterator<Item = (usize, f64)> {
        let (place, last) = self.place(from);
        let older = if last { from } else { from + 1 };
        let moves = self.moves.outgoing(control, place);
        let moves = moves.map(move |(i, p)| (self.starts[i], p * self.leave[from]));
        merge(moves, once((older, self.stay[from])), f64::add).filter(|entry| entry.1 > 0.0)
    }

    fn incoming_log2(&self, control: &A::Control, to: usize) -> impl Iterator<Item = (usize, f64)> {
        let (place, last) = self.place(to);
        let arrives = self.starts[place] == to;
        let moves = arrives.then(|| self.moves.incoming_log2(control, place)).into_iter().flatten();
        let arrivals = moves.flat_map(move |(j, log2)| {
            (self.starts[j]..self.starts[j + 1])
                .map(move |state| (state, log2 + self.log2_leave[state]))
        });
        let younger = (!arrives).then(|| to - 1).into_iter();
        let stays = younger.chain(last.then_some(to)).map(|state| (state, self.log2_stay[state]));
        merge(arrivals, stays, add_log2).filter(|entry| entry.1 > f64::NEG_INFINITY)
    }

    fn max_product(&self, control: &A::Control, x: &[f64], out: &mut [f64], from: &mut [u32]) {
        check_slices(self.states(), x, out);
        buffers::with_two(self.places(), |leaving, arriving| {
            buffers::with_two(self.places(), |leaver, origin| {
                for (place, range) in self.ranges() {
                    let leave = self.log2_leave[range.clone()].iter().copied();
                    let states = range.start as u32..range.end as u32;
                    (leaving[place], leaver[place]) = best_of(states.zip(leave), x);
                }
                self.moves.max_product(control, leaving, arriving, origin);
                for (place, range) in self.ranges() {
                    let (first, last) = (range.start, range.end - 1);
                    // An unreachable place has no predecessor.
                    let reached = arriving[place] > f64::NEG_INFINITY;
                    out[first] = arriving[place];
                    from[first] = if reached { leaver[origin[place] as usize] } else { 0 };
                    for state in first..last {
                        out[state + 1] = self.log2_stay[state] + x[state];
                        from[state + 1] = state as u32;
                    }
                    let mut stay = self.log2_stay[last];
                    if first == last && self.stay[last] > 0.0 {
                        // The state leads to itself by a stay and by a move: its entry is the sum.
                        let mut moves = self.moves.incoming_log2(control, place);
                        if let Some((_, again)) = moves.find(|entry| entry.0 == place) {
                            stay = add_log2(again + self.log2_leave[last], stay);
                        }
                    }
                    let (value, state) = (stay + x[last], last as u32);
                    if value > out[last] || (value == out[last] && state < from[last]) {
                        (out[last], from[last]) = (value, state);
                    }
                }
            });
        });
    }
}

/// log2(2^a + 2^b), rounded to the grid of scores.
pub(super) fn add_log2(a: f64, b: f64) -> f64 {
    let (high, low) = if a > b { (a, b) } else { (b, a) };
    if low == f64::NEG_INFINITY { high } else { high + log2(1.0 + (low - high).exp2()) }
}
