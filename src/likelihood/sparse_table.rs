//! [`SparseTableLikelihood`], observations from a finite set of symbols that each stand for a few
//! states. A symbol is stored as a [`SparseObservation`], so that a step costs what one of those
//! costs. Symbols, unlike observations, are checked against the number of states once.

use super::sparse::{ListError, SparseObservation};
use super::table::{check_size, invalid};
use super::{Diagonal, Likelihood, LocalLikelihood, Scratch};
use crate::error::{LikelihoodError, OutOfRange};

/// A table of likelihoods in sparse form: each symbol lists the states that it stands for, with
/// their likelihoods, and has one value for all others. The observation is the symbol, 0 to m − 1.
/// For maps of many places and sensors that name one of many things: a tag, a beacon, a sign, the
/// place that a classifier recognises.
///
/// The cost of a step depends on the number of states that the symbol lists, as with a
/// [`SparseLikelihood`](super::SparseLikelihood), whose observations are lists. It is lowest if all
/// symbols have the same value for unlisted states: where that changes from one step to the next,
/// all n states are written. Memory is 16 bytes for each state that a symbol lists; a
/// [`TableLikelihood`](super::TableLikelihood), whose rows sum to one, takes 16 n m bytes.
///
/// ```
/// use wayfix::likelihood::SparseTableLikelihood;
/// use wayfix::{Belief, Hmm, Prior, SparseTransition};
///
/// // A loop of three places: stay or move on by one. Of two tags, one stands at place 1, the
/// // other is seen from places 1 and 2; either is misread now and then.
/// let motion = SparseTransition::from_rows(&[[0.5, 0.0, 0.5], [0.5, 0.5, 0.0], [0.0, 0.5, 0.5]])?;
/// let tags = SparseTableLikelihood::from_lists(3, &[
///     (vec![(1, 0.9)], 0.01),
///     (vec![(2, 0.6), (1, 0.3)], 0.01),
/// ])?;
/// let hmm = Hmm::new(Prior::AtFirstObservation(Belief::uniform(3)?), motion, tags)?;
/// assert_eq!(hmm.viterbi(&[0, 1, 1])?.states(), [1, 2, 2]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct SparseTableLikelihood {
    pub(crate) states: usize,
    symbols: Vec<SparseObservation>,
}

impl SparseTableLikelihood {
    /// Creates a table of `states` states from one pair per symbol: the states that it lists, in
    /// any order, each with its likelihood, and the likelihood of every other state. All are finite
    /// and at least 0, of any scale that is common to all states of a symbol.
    /// O(listed log listed).
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] without states or symbols; and, with the symbol, if a value is NaN, negative
    /// or infinite, or a state does not exist or is listed twice.
    pub fn from_lists<L: AsRef<[(usize, f64)]>>(
        states: usize,
        symbols: &[(L, f64)],
    ) -> Result<Self, OutOfRange> {
        check_size(states, symbols.len())?;
        let of = |(symbol, (listed, elsewhere)): (usize, &(L, f64))| {
            // Listed states are checked once here, so that no step has to check them.
            let listed = listed.as_ref().to_vec();
            if let Some(&(state, _)) = listed.iter().find(|entry| entry.0 >= states) {
                let what = format!("a state that symbol {symbol} lists");
                return Err(OutOfRange::index(what, state, states));
            }
            SparseObservation::of(listed, *elsewhere).map_err(|error| match error {
                ListError::Value { state, value } => invalid(state, symbol, value),
                ListError::Elsewhere { value } => {
                    let what = format!("the probability of symbol {symbol} in unlisted states");
                    OutOfRange::new(what, value, "a finite value of at least 0")
                }
                ListError::Twice { state } => {
                    let what =
                        format!("the number of times that symbol {symbol} lists state {state}");
                    OutOfRange::count(what, 2, 1)
                }
            })
        };
        let symbols = symbols.iter().enumerate().map(of).collect::<Result<_, _>>()?;
        Ok(Self { states, symbols })
    }

    /// Number of symbols, m.
    #[must_use]
    pub fn symbols(&self) -> usize {
        self.symbols.len()
    }

    /// Returns the likelihoods of a symbol, or `None` if it does not exist.
    #[must_use]
    pub fn symbol(&self, symbol: usize) -> Option<&SparseObservation> {
        self.symbols.get(symbol)
    }

    /// Returns the likelihood of a symbol in a state, or `None` if the state or symbol does not
    /// exist. O(log listed).
    #[must_use]
    pub fn likelihood(&self, state: usize, symbol: usize) -> Option<f64> {
        let seen = self.symbol(symbol).filter(|_| state < self.states)?;
        let found = seen.listed.binary_search_by_key(&state, |entry| entry.0);
        Some(found.map_or(seen.elsewhere, |at| seen.listed[at].1))
    }

    /// Returns the pairs, as [`from_lists`](Self::from_lists) takes them, with ascending states.
    #[must_use]
    pub fn to_lists(&self) -> Vec<(Vec<(usize, f64)>, f64)> {
        self.symbols.iter().map(|seen| (seen.listed.to_vec(), seen.elsewhere)).collect()
    }

    /// Creates a table from valid likelihoods of states that exist.
    pub(crate) fn from_valid(states: usize, symbols: Vec<SparseObservation>) -> Self {
        Self { states, symbols }
    }

    fn seen(&self, symbol: usize) -> Result<&SparseObservation, LikelihoodError> {
        let symbols = self.symbols();
        self.symbol(symbol).ok_or(LikelihoodError::Symbol { symbol, symbols })
    }
}

impl Likelihood for SparseTableLikelihood {
    type Observation = usize;

    fn states(&self) -> usize {
        self.states
    }

    /// # Errors
    ///
    /// [`LikelihoodError::Symbol`] for a symbol that does not exist.
    fn diagonal<'a>(
        &'a self,
        &symbol: &'a usize,
        scratch: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        let seen = self.seen(symbol)?;
        Ok(scratch.sparse(self.states, &seen.listed, seen.elsewhere))
    }

    fn is_precomputed(&self) -> bool {
        true
    }
}

/// O(states asked + states listed by the symbol).
impl LocalLikelihood for SparseTableLikelihood {
    /// # Errors
    ///
    /// [`LikelihoodError::Symbol`] for a symbol that does not exist.
    fn local<'a>(
        &'a self,
        &symbol: &'a usize,
        states: &[usize],
        scratch: &'a mut Scratch,
    ) -> Result<(Diagonal<'a>, f64), LikelihoodError> {
        Ok(self.seen(symbol)?.local(self.states, states, scratch))
    }

    fn listed_states(&self, &symbol: &usize, states: &mut Vec<usize>) {
        self.symbol(symbol).into_iter().for_each(|seen| seen.listed_states(self.states, states));
    }
}

#[cfg(feature = "serde")]
crate::stored! {
    [] SparseTableLikelihood: [], |table| {
        states: usize = table.states,
        symbols: Vec<(Vec<(usize, f64)>, f64)> = table.to_lists(),
    } => Self::from_lists(states, &symbols);
}
