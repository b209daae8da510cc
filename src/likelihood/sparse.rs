//! [`SparseLikelihood`], likelihoods of a few states, and one value for all others.
//!
//! Invariant of [`SparseObservation`]: states ascend, each at most once, and all values are finite
//! and at least 0. That the states exist is checked at each step, since an observation does not
//! know the model.

use super::{Diagonal, Likelihood, LocalLikelihood, Scratch};
use crate::error::LikelihoodError;
use wayfix_kernels::Valid;

/// A sensor whose observation lists a few states with their likelihoods, and one value for all
/// others. For maps of millions of places, with a sensor that names candidates: the best matches
/// of an image retrieval, the roads near a position fix.
///
/// As a [`LocalLikelihood`], it costs O(states asked + states listed) a step. Otherwise a step
/// updates a diagonal that is kept: it writes the states listed now and at the previous step, and
/// all n states only if the value for the others changes. Observations that repeat can be stored
/// once, as the symbols of a [`SparseTableLikelihood`](super::SparseTableLikelihood).
///
/// ```
/// use wayfix::likelihood::SparseObservation;
/// use wayfix::{Belief, Hmm, Prior, SparseLikelihood, SparseTransition};
///
/// let motion = SparseTransition::from_rows(&[[0.5, 0.0, 0.5], [0.5, 0.5, 0.0], [0.0, 0.5, 0.5]])?;
/// let prior = Prior::AtFirstObservation(Belief::uniform(3)?);
/// let hmm = Hmm::new(prior, motion, SparseLikelihood::new(3))?;
/// let mut filter = hmm.filter();
/// filter.step(&SparseObservation::new(vec![(1, 0.75)], 0.125)?)?;
/// assert!((filter.belief().as_slice()[1] - 0.75).abs() < 1e-15);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SparseLikelihood {
    pub(crate) states: usize,
}

/// Likelihoods of some states and one value for all others, the observation of
/// [`SparseLikelihood`].
#[derive(Debug, Clone, PartialEq)]
pub struct SparseObservation {
    /// Pairs (state, likelihood), in ascending order of the states.
    pub(crate) listed: Box<[(usize, f64)]>,
    pub(crate) elsewhere: f64,
}

/// A defect in a list of likelihoods.
pub(super) enum ListError {
    Value { state: usize, value: f64 },
    Elsewhere { value: f64 },
    Twice { state: usize },
}

impl SparseObservation {
    /// Creates an observation from pairs (state, likelihood) in any order, and the likelihood of
    /// every other state; each finite and at least 0, of any common scale. O(pairs log pairs).
    ///
    /// # Errors
    ///
    /// [`LikelihoodError`] if a likelihood is NaN, negative or infinite, or a
    /// state is listed twice.
    pub fn new(listed: Vec<(usize, f64)>, elsewhere: f64) -> Result<Self, LikelihoodError> {
        let valid = Valid::Likelihoods;
        let (kind, expected) = (valid.kind(), valid.expected());
        Self::of(listed, elsewhere).map_err(|error| match error {
            ListError::Value { state, value } => {
                LikelihoodError::Value { state, kind, value, expected }
            }
            ListError::Elsewhere { value } => LikelihoodError::Bound { kind, value, expected },
            ListError::Twice { state } => LikelihoodError::Twice { state },
        })
    }

    pub(super) fn of(mut listed: Vec<(usize, f64)>, elsewhere: f64) -> Result<Self, ListError> {
        let valid = Valid::Likelihoods;
        if let Some(&(state, value)) = listed.iter().find(|(_, b)| !valid.is(*b)) {
            return Err(ListError::Value { state, value });
        }
        if !valid.is(elsewhere) {
            return Err(ListError::Elsewhere { value: elsewhere });
        }
        // Sorted, so that duplicates are neighbours, and lists can be merged.
        listed.sort_unstable_by_key(|entry| entry.0);
        if let Some(twice) = listed.windows(2).find(|pair| pair[0].0 == pair[1].0) {
            return Err(ListError::Twice { state: twice[0].0 });
        }
        Ok(Self { listed: listed.into_boxed_slice(), elsewhere })
    }

    /// Creates hard evidence for one state: all others have likelihood 0. For a fuel stop, a toll
    /// gate, a label.
    ///
    /// Fused with another sensor, and optional, it constrains filter, smoother and decoder:
    ///
    /// ```
    /// use wayfix::likelihood::SparseObservation;
    /// use wayfix::{Belief, FusedLikelihood, Hmm, OptionalLikelihood, Prior, SparseLikelihood, SparseTransition, TableLikelihood};
    ///
    /// // A loop of three places: stay or move on by one.
    /// let motion = SparseTransition::from_rows(&[[0.5, 0.0, 0.5], [0.5, 0.5, 0.0], [0.0, 0.5, 0.5]])?;
    /// let camera = TableLikelihood::from_rows(&[[0.8, 0.1, 0.1], [0.1, 0.8, 0.1], [0.1, 0.1, 0.8]])?;
    /// let known = OptionalLikelihood::new(SparseLikelihood::new(3));
    /// let sensor = FusedLikelihood::new(camera, known)?;
    /// let hmm = Hmm::new(Prior::AtFirstObservation(Belief::certain(3, 0)?), motion, sensor)?;
    ///
    /// let seen = [(0, None), (0, None), (1, None)];
    /// assert_eq!(hmm.viterbi(&seen)?.states(), [0, 0, 1]);
    /// let toll_gate = [(0, None), (0, None), (1, Some(SparseObservation::known(2)))];
    /// assert_eq!(hmm.viterbi(&toll_gate)?.states(), [0, 1, 2]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn known(state: usize) -> Self {
        Self { listed: Box::new([(state, 1.0)]), elsewhere: 0.0 }
    }

    /// Creates an observation from pairs that are known to be valid and in ascending order.
    #[doc(hidden)]
    #[must_use]
    pub fn from_sorted(listed: Vec<(usize, f64)>, elsewhere: f64) -> Self {
        Self { listed: listed.into(), elsewhere }
    }

    /// Listed states in ascending order, with their likelihoods.
    #[must_use]
    pub fn listed(&self) -> &[(usize, f64)] {
        &self.listed
    }

    /// Likelihood of every other state.
    #[must_use]
    pub fn elsewhere(&self) -> f64 {
        self.elsewhere
    }

    fn check(&self, states: usize) -> Result<(), LikelihoodError> {
        // States are sorted, so the last is the largest.
        match self.listed.last() {
            Some(&(state, _)) if state >= states => Err(LikelihoodError::Listed { state, states }),
            _ => Ok(()),
        }
    }

    /// Implements [`LocalLikelihood::local`], for states that exist.
    pub(super) fn local<'a>(
        &self,
        all: usize,
        states: &[usize],
        scratch: &'a mut Scratch,
    ) -> (Diagonal<'a>, f64) {
        let out = scratch.values(states.len());
        // A merge of the states asked for and those listed, both ascending. Whatever is listed but
        // not asked for raises the bound on the others; `elsewhere` counts only if some state is
        // not asked for.
        let mut next = self.listed.iter().peekable();
        let mut others = if states.len() < all { self.elsewhere } else { 0.0 };
        for (&state, b) in states.iter().zip(&mut *out) {
            while let Some(&(_, passed)) = next.next_if(|entry| entry.0 < state) {
                others = others.max(passed);
            }
            *b = next.next_if(|entry| entry.0 == state).map_or(self.elsewhere, |entry| entry.1);
        }
        let others = next.fold(others, |others, entry| others.max(entry.1));
        (Diagonal::linear(out), others)
    }

    /// Implements [`LocalLikelihood::listed_states`].
    pub(super) fn listed_states(&self, all: usize, states: &mut Vec<usize>) {
        // States listed below `elsewhere` do not raise the bound, so they need no look.
        let above = self.listed.iter().filter(|entry| entry.1 > self.elsewhere);
        states.extend(above.map(|entry| entry.0).filter(|&state| state < all));
    }
}

impl SparseLikelihood {
    /// Creates a sensor with `states` states.
    #[must_use]
    pub fn new(states: usize) -> Self {
        Self { states }
    }
}

impl Likelihood for SparseLikelihood {
    type Observation = SparseObservation;

    fn states(&self) -> usize {
        self.states
    }

    /// # Errors
    ///
    /// [`LikelihoodError::Listed`] for a state that does not exist.
    fn diagonal<'a>(
        &'a self,
        observation: &'a SparseObservation,
        scratch: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        observation.check(self.states)?;
        Ok(scratch.sparse(self.states, &observation.listed, observation.elsewhere))
    }

    fn is_precomputed(&self) -> bool {
        true
    }
}

impl LocalLikelihood for SparseLikelihood {
    /// # Errors
    ///
    /// [`LikelihoodError::Listed`] for a state that does not exist.
    fn local<'a>(
        &'a self,
        observation: &'a SparseObservation,
        states: &[usize],
        scratch: &'a mut Scratch,
    ) -> Result<(Diagonal<'a>, f64), LikelihoodError> {
        observation.check(self.states)?;
        Ok(observation.local(self.states, states, scratch))
    }

    fn listed_states(&self, observation: &SparseObservation, states: &mut Vec<usize>) {
        observation.listed_states(self.states, states);
    }
}

#[cfg(feature = "serde")]
crate::stored! {
    [] SparseLikelihood: [], |sparse| {
        states: usize = sparse.states,
    } => Ok::<_, std::convert::Infallible>(Self::new(states));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn says_what_is_wrong_with_a_list() {
        let text =
            |listed, elsewhere| SparseObservation::new(listed, elsewhere).unwrap_err().to_string();
        assert_eq!(
            text(vec![(3, 0.5), (1, f64::NAN)], 0.0),
            "state 1 has likelihood NaN, expected a finite value of at least 0"
        );
        assert_eq!(text(vec![(3, 0.5), (1, 1.0), (3, 0.5)], 0.0), "state 3 is listed twice");
        assert_eq!(
            text(vec![], -1.0),
            "the likelihood of unlisted states is bounded by -1, expected a finite value of at least 0"
        );
        let seen = SparseObservation::new(vec![(2, 0.5)], 0.0).unwrap();
        let (sensor, mut scratch) = (SparseLikelihood::new(2), Scratch::default());
        assert_eq!(
            sensor.local(&seen, &[], &mut scratch).unwrap_err().to_string(),
            "the observation lists state 2, but there are 2 states (0 to 1)"
        );
        assert!(SparseLikelihood::new(2).diagonal(&seen, &mut Scratch::default()).is_err());
    }

    #[test]
    fn the_bound_is_the_largest_of_what_was_not_asked() {
        let seen = SparseObservation::new(vec![(4, 0.5), (2, 0.25), (0, 0.0)], 0.125).unwrap();
        let ask = |states: &[usize]| {
            let (sensor, mut scratch) = (SparseLikelihood::new(5), Scratch::default());
            let (found, others) = sensor.local(&seen, states, &mut scratch).unwrap();
            (found.as_slice().to_vec(), others)
        };
        assert_eq!(ask(&[]), (vec![], 0.5));
        assert_eq!(ask(&[1, 4]), (vec![0.125, 0.5], 0.25));
        assert_eq!(ask(&[0, 2, 4]), (vec![0.0, 0.25, 0.5], 0.125));
        assert_eq!(ask(&[0, 1, 2, 3, 4]), (vec![0.0, 0.125, 0.25, 0.125, 0.5], 0.0));
        let mut states = Vec::new();
        SparseLikelihood::new(5).listed_states(&seen, &mut states);
        assert_eq!(states, [2, 4]);
    }
}
