//! States that belong together.

use std::error::Error;
use std::fmt;
use std::ops::Range;

use crate::belief::Belief;

/// Why states do not fall into groups, or a vector does not fit them.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum GroupError {
    /// There are no states at all.
    Empty,
    /// A number that no state has, below one that a state has.
    Gap {
        /// The empty group, from 0.
        group: usize,
        /// The highest number given.
        last: usize,
    },
    /// A state beyond the last one.
    State {
        /// The state asked for, from 0.
        state: usize,
        /// How many states there are.
        states: usize,
    },
    /// A belief of another size.
    Belief {
        /// Its states.
        found: usize,
        /// The states, or groups, that there are.
        expected: usize,
    },
    /// A slice for results that has not a place for each group.
    Output {
        /// Its length.
        found: usize,
        /// The groups that there are.
        expected: usize,
    },
}

impl fmt::Display for GroupError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Empty => write!(f, "groups need at least one state, found none"),
            Self::Gap { group, last } => {
                write!(f, "no state is in group {group}, though groups are numbered up to {last}")
            }
            Self::State { state, states } => write!(
                f,
                "state {state} does not exist, {states} states are grouped (0 to {})",
                states.saturating_sub(1)
            ),
            Self::Belief { found, expected } => {
                write!(f, "the belief has {found} states, expected {expected}")
            }
            Self::Output { found, expected } => {
                write!(f, "there is room for {found} groups, expected {expected}")
            }
        }
    }
}

impl Error for GroupError {}

/// A map from states to groups: places that were expanded into several states,
/// by age ([`DwellTransition`](crate::transition::DwellTransition)) or by weather
/// ([`KroneckerTransition`](crate::transition::KroneckerTransition)), or places of a
/// district.
///
/// It brings beliefs and paths back to groups;
/// [`GroupedLikelihood`](crate::likelihood::GroupedLikelihood) is a sensor that sees only
/// them. Memory: 16 bytes a state.
///
/// ```
/// use wayfix::likelihood::Groups;
/// use wayfix::Belief;
///
/// let districts = Groups::new(vec![0, 0, 1])?;
/// let belief = Belief::new(vec![0.25, 0.5, 0.25])?;
/// assert_eq!(districts.marginal(&belief)?.as_slice(), [0.75, 0.25]);
/// assert_eq!(districts.map_path(&[1, 2])?, [0, 1]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Groups {
    /// The group of each state.
    of: Vec<usize>,
    /// The states, group after group; group g ends before `ends[g]`.
    states: Vec<usize>,
    ends: Vec<usize>,
    /// Runs of states whose groups follow each other, or are the same.
    runs: Vec<Run>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
struct Run {
    states: Range<usize>,
    /// The group of the first.
    group: usize,
    same: bool,
}

impl Run {
    fn all(of: &[usize]) -> Vec<Self> {
        let mut runs: Vec<Self> = Vec::new();
        for (state, &group) in of.iter().enumerate() {
            if let Some(run) = runs.last_mut() {
                let count = run.states.len();
                let (same, next) = (group == run.group, group == run.group + count);
                if (same && (run.same || count == 1)) || (next && !run.same) {
                    run.same = same;
                    run.states.end = state + 1;
                    continue;
                }
            }
            runs.push(Self { states: state..state + 1, group, same: false });
        }
        runs
    }
}

impl Groups {
    /// From the group of each state; groups are numbered from 0 without gaps.
    /// O(n).
    ///
    /// # Errors
    ///
    /// [`GroupError`] for no states, or a number that is left out.
    pub fn new(of: Vec<usize>) -> Result<Self, GroupError> {
        let last = *of.iter().max().ok_or(GroupError::Empty)?;
        // Were there more groups than states, one of the first n would be empty.
        let mut seen = vec![false; of.len().min(last.saturating_add(1))];
        for &group in &of {
            if let Some(seen) = seen.get_mut(group) {
                *seen = true;
            }
        }
        match seen.iter().position(|seen| !seen) {
            Some(group) => Err(GroupError::Gap { group, last }),
            None => Ok(Self::numbered(of, last + 1)),
        }
    }

    /// For groups that are known to be numbered without gaps.
    pub(crate) fn numbered(of: Vec<usize>, count: usize) -> Self {
        let mut ends = vec![0; count];
        of.iter().for_each(|&group| ends[group] += 1);
        let mut start = 0;
        for end in &mut ends {
            (*end, start) = (start, start + *end); // the start, until filled
        }
        let mut states = vec![0; of.len()];
        for (state, &group) in of.iter().enumerate() {
            states[ends[group]] = state;
            ends[group] += 1;
        }
        let runs = Run::all(&of);
        Self { of, states, ends, runs }
    }

    /// The number of groups.
    #[must_use]
    pub fn count(&self) -> usize {
        self.ends.len()
    }

    /// The group of each state.
    #[must_use]
    pub fn as_slice(&self) -> &[usize] {
        &self.of
    }

    /// The group of a state, or `None` if there is no such state.
    #[must_use]
    pub fn group_of(&self, state: usize) -> Option<usize> {
        self.of.get(state).copied()
    }

    /// The states of a group in ascending order; none if there is no such group.
    #[must_use]
    pub fn states(&self, group: usize) -> impl ExactSizeIterator<Item = usize> + Clone {
        let end = self.ends.get(group).copied().unwrap_or(0);
        let start = if end > 0 && group > 0 { self.ends[group - 1] } else { 0 };
        self.states[start..end].iter().copied()
    }

    /// The probability of each group: the sum over its states. O(n).
    ///
    /// # Errors
    ///
    /// [`GroupError::Belief`] if the belief is not over these states.
    pub fn marginal<S: AsRef<[f64]>>(&self, belief: &Belief<S>) -> Result<Belief, GroupError> {
        let mut sums = vec![0.0; self.count()];
        self.marginal_into(belief, &mut sums)?;
        Ok(Belief::known(sums))
    }

    /// The same into a slice with a place for each group, which allocates nothing:
    /// for each step of a stream. O(n).
    ///
    /// ```
    /// use wayfix::likelihood::Groups;
    /// use wayfix::Belief;
    ///
    /// let districts = Groups::new(vec![0, 0, 1])?;
    /// let belief = Belief::new(vec![0.25, 0.5, 0.25])?;
    /// let mut probabilities = [0.0; 2];
    /// districts.marginal_into(&belief, &mut probabilities)?;
    /// assert_eq!(probabilities, [0.75, 0.25]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`GroupError::Belief`] if the belief is not over these states,
    /// [`GroupError::Output`] if the slice is of another length. It then is as
    /// before.
    pub fn marginal_into<S: AsRef<[f64]>>(
        &self,
        belief: &Belief<S>,
        out: &mut [f64],
    ) -> Result<(), GroupError> {
        let (found, expected) = (belief.states(), self.of.len());
        if found != expected {
            return Err(GroupError::Belief { found, expected });
        }
        let (found, expected) = (out.len(), self.count());
        if found != expected {
            return Err(GroupError::Output { found, expected });
        }
        out.fill(0.0);
        self.add_up(belief.values(), out);
        Ok(())
    }

    /// `sums[group] += Σ` of the values of its states, in the order of the states.
    pub(crate) fn add_up(&self, values: &[f64], sums: &mut [f64]) {
        for Run { states, group, same } in &self.runs {
            let values = &values[states.clone()];
            if *same {
                values.iter().for_each(|value| sums[*group] += value);
            } else {
                let sums = sums[*group..].iter_mut();
                sums.zip(values).for_each(|(sum, value)| *sum += value);
            }
        }
    }

    /// `out[state] =` the value of its group.
    pub(crate) fn expand(&self, groups: &[f64], out: &mut [f64]) {
        for Run { states, group, same } in &self.runs {
            let out = &mut out[states.clone()];
            if *same {
                out.fill(groups[*group]);
            } else {
                out.copy_from_slice(&groups[*group..][..out.len()]);
            }
        }
    }

    /// Goes through runs of some states: those of one group, or of groups that follow each
    /// other. For each the states, the first group, and whether it is the only one.
    pub(crate) fn runs(
        &self,
        states: Range<usize>,
    ) -> impl Iterator<Item = (Range<usize>, usize, bool)> {
        let first = self.runs.partition_point(|run| run.states.end <= states.start);
        let runs = self.runs[first..].iter().take_while(move |run| run.states.start < states.end);
        runs.map(move |run| {
            let start = run.states.start.max(states.start);
            let group = if run.same { run.group } else { run.group + start - run.states.start };
            (start..run.states.end.min(states.end), group, run.same)
        })
    }

    /// The groups that a path leads through, one a step.
    ///
    /// # Errors
    ///
    /// [`GroupError::State`] for a state that does not exist.
    pub fn map_path(&self, path: &[usize]) -> Result<Vec<usize>, GroupError> {
        let states = self.of.len();
        let group =
            |&state: &usize| self.group_of(state).ok_or(GroupError::State { state, states });
        path.iter().map(group).collect()
    }
}
