//! [`Groups`], a partition of the states.
//!
//! States of a group are usually neighbours, or neighbouring states are in neighbouring groups. So
//! sums and copies go by runs of either kind, in contiguous loops without an index for each state.

use std::ops::Range;
use std::sync::OnceLock;

use crate::belief::Belief;
use crate::error::OutOfRange;

/// Partition of the states into groups, such as the states of one place where places are expanded
/// by age ([`DwellTransition`](crate::transition::DwellTransition)) or by weather
/// ([`KroneckerTransition`](crate::transition::KroneckerTransition)), or the places of a district.
///
/// It maps beliefs and paths to groups;
/// [`GroupedLikelihood`](crate::likelihood::GroupedLikelihood) is a sensor that observes only
/// groups. Memory: 8 bytes a state, and as many again once [`states`](Self::states) is called.
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
#[derive(Debug, Clone)]
pub struct Groups {
    /// Group of each state.
    of: Vec<usize>,
    count: usize,
    /// Runs of states that have the same group, or consecutive groups.
    runs: Vec<Run>,
    sorted: OnceLock<Sorted>,
}

/// States sorted by group; those of group g end before `ends[g]`.
#[derive(Debug, Clone)]
struct Sorted {
    states: Vec<usize>,
    ends: Vec<usize>,
}

impl PartialEq for Groups {
    fn eq(&self, other: &Self) -> bool {
        self.of == other.of
    }
}

impl Eq for Groups {}

#[derive(Debug, Clone, PartialEq, Eq)]
struct Run {
    states: Range<usize>,
    /// Group of the first state.
    group: usize,
    single_group: bool,
}

impl Run {
    fn all(of: &[usize]) -> Vec<Self> {
        // Greedy: a state extends the last run if it fits its kind. A run of one state has no kind
        // yet (`single_group` is false), and takes that of its second state.
        let mut runs: Vec<Self> = Vec::new();
        for (state, &group) in of.iter().enumerate() {
            if let Some(run) = runs.last_mut() {
                let count = run.states.len();
                let (single_group, next) = (group == run.group, group == run.group + count);
                if (single_group && (run.single_group || count == 1)) || (next && !run.single_group)
                {
                    run.single_group = single_group;
                    run.states.end = state + 1;
                    continue;
                }
            }
            runs.push(Self { states: state..state + 1, group, single_group: false });
        }
        runs
    }
}

impl Groups {
    /// Creates a grouping from the group of each state; groups are numbered from 0 without gaps.
    /// O(n).
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] without states, or for an empty group.
    pub fn new(of: Vec<usize>) -> Result<Self, OutOfRange> {
        let last =
            *of.iter().max().ok_or_else(|| OutOfRange::none("the number of grouped states"))?;
        // With more groups than states, one of the first n groups is empty: looking at those is
        // enough, and a huge number allocates nothing.
        let mut seen = vec![false; of.len().min(last.saturating_add(1))];
        for &group in &of {
            if let Some(seen) = seen.get_mut(group) {
                *seen = true;
            }
        }
        match seen.iter().position(|seen| !seen) {
            Some(group) => {
                let what = format!("the number of states in group {group}");
                let expected = format!("at least 1, as groups are numbered up to {last}");
                Err(OutOfRange::new(what, 0.0, expected))
            }
            None => Ok(Self::numbered(of, last + 1)),
        }
    }

    /// Creates a grouping from groups that are known to be numbered without gaps.
    #[doc(hidden)]
    #[must_use]
    pub fn numbered(of: Vec<usize>, count: usize) -> Self {
        let runs = Run::all(&of);
        Self { of, count, runs, sorted: OnceLock::new() }
    }

    fn sorted(&self) -> &Sorted {
        self.sorted.get_or_init(|| {
            // A counting sort, stable, so that the states of a group ascend.
            let mut ends = vec![0; self.count];
            self.of.iter().for_each(|&group| ends[group] += 1);
            let mut start = 0;
            for end in &mut ends {
                (*end, start) = (start, start + *end); // the start; filling moves it to the end
            }
            let mut states = vec![0; self.of.len()];
            for (state, &group) in self.of.iter().enumerate() {
                states[ends[group]] = state;
                ends[group] += 1;
            }
            Sorted { states, ends }
        })
    }

    /// Number of groups.
    #[must_use]
    pub fn count(&self) -> usize {
        self.count
    }

    /// Group of each state.
    #[must_use]
    pub fn as_slice(&self) -> &[usize] {
        &self.of
    }

    /// Group of a state, or `None` if the state does not exist.
    #[must_use]
    pub fn group_of(&self, state: usize) -> Option<usize> {
        self.of.get(state).copied()
    }

    /// States of a group in ascending order; none if the group does not exist. The first call sorts
    /// the states, O(n).
    #[must_use]
    pub fn states(&self, group: usize) -> impl ExactSizeIterator<Item = usize> + Clone {
        let Sorted { states, ends } = self.sorted();
        let end = ends.get(group).copied().unwrap_or(0);
        let start = if end > 0 && group > 0 { ends[group - 1] } else { 0 };
        states[start..end].iter().copied()
    }

    /// Marginal distribution over the groups: the sum over the states of each. O(n).
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] if the belief has a different number of states.
    pub fn marginal<S: AsRef<[f64]>>(&self, belief: &Belief<S>) -> Result<Belief, OutOfRange> {
        let mut sums = vec![0.0; self.count()];
        self.marginal_into(belief, &mut sums)?;
        Ok(Belief::from_valid(sums))
    }

    /// Writes the [marginal distribution](Self::marginal) over the groups to a slice with one
    /// value per group. Allocates nothing, for use at each step of a stream. O(n).
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
    /// [`OutOfRange`] if the belief has a different number of states, or the slice has another
    /// length. The slice is then unchanged.
    pub fn marginal_into<S: AsRef<[f64]>>(
        &self,
        belief: &Belief<S>,
        out: &mut [f64],
    ) -> Result<(), OutOfRange> {
        let (found, expected) = (belief.states(), self.of.len());
        if found != expected {
            return Err(OutOfRange::count("the number of states of the belief", found, expected));
        }
        let (found, expected) = (out.len(), self.count());
        if found != expected {
            return Err(OutOfRange::count("the length of the slice", found, expected));
        }
        out.fill(0.0);
        self.add_group_sums(belief.values(), out);
        Ok(())
    }

    /// Adds to each sum the values of the group's states, in the order of the states.
    pub(crate) fn add_group_sums(&self, values: &[f64], sums: &mut [f64]) {
        for Run { states, group, single_group } in &self.runs {
            let values = &values[states.clone()];
            if *single_group {
                values.iter().for_each(|value| sums[*group] += value);
            } else {
                let sums = sums[*group..].iter_mut();
                sums.zip(values).for_each(|(sum, value)| *sum += value);
            }
        }
    }

    /// Writes to each state the value of its group.
    pub(crate) fn expand(&self, groups: &[f64], out: &mut [f64]) {
        for Run { states, group, single_group } in &self.runs {
            let out = &mut out[states.clone()];
            if *single_group {
                out.fill(groups[*group]);
            } else {
                out.copy_from_slice(&groups[*group..][..out.len()]);
            }
        }
    }

    /// Iterates over the runs within a range of states, each of one group or of consecutive groups.
    /// Items are (states, first group, true if it is the only group).
    pub(crate) fn runs(
        &self,
        states: Range<usize>,
    ) -> impl Iterator<Item = (Range<usize>, usize, bool)> {
        // Runs are in the order of the states. The first and the last one are cut to the range.
        let first = self.runs.partition_point(|run| run.states.end <= states.start);
        let runs = self.runs[first..].iter().take_while(move |run| run.states.start < states.end);
        runs.map(move |run| {
            let start = run.states.start.max(states.start);
            let group =
                if run.single_group { run.group } else { run.group + start - run.states.start };
            (start..run.states.end.min(states.end), group, run.single_group)
        })
    }

    /// Groups along a path of states, one per step.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] for a state that does not exist.
    pub fn map_path(&self, path: &[usize]) -> Result<Vec<usize>, OutOfRange> {
        let states = self.of.len();
        let group = |&state: &usize| {
            self.group_of(state).ok_or_else(|| OutOfRange::index("the state", state, states))
        };
        path.iter().map(group).collect()
    }
}

#[cfg(feature = "serde")]
impl serde::Serialize for Groups {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.as_slice().serialize(serializer)
    }
}

#[cfg(feature = "serde")]
impl<'de> serde::Deserialize<'de> for Groups {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Self::new(Vec::deserialize(deserializer)?).map_err(crate::stored::refused)
    }
}
