//! [`TableLikelihood`], observations from a finite set of symbols.
//!
//! Invariant: values are finite and at least 0, and the row of each state sums to one. All that a
//! step may need of a symbol (its column, logarithms, maximum, most probable states) is computed
//! when the table is built.

use rand::Rng;

use super::{Diagonal, Likelihood, LocalLikelihood, SampleObservation, Scratch};
use crate::belief::{Belief, SUM_TOLERANCE};
use crate::error::{LikelihoodError, OutOfRange};
use crate::random::index;
use crate::reorder::ReorderStates;
use wayfix_kernels as kernels;

/// A table p(symbol | state), also called emission matrix or confusion matrix. The observation is
/// the symbol, 0 to m − 1.
///
/// The diagonal of a symbol is borrowed from the table, without copying or further checks.
/// Memory is 16 n m bytes for the values and their logarithms, and 256 m bytes for the most
/// probable states of each symbol.
///
/// ```
/// use wayfix::TableLikelihood;
///
/// // One row per state: the probability of each symbol.
/// let umbrella = TableLikelihood::from_rows(&[[0.9, 0.1], [0.2, 0.8]])?;
/// assert_eq!(umbrella.probability(1, 0), Some(0.2));
/// # Ok::<(), wayfix::error::OutOfRange>(())
/// ```
#[derive(Debug, Clone)]
pub struct TableLikelihood {
    states: usize,
    /// p(y | i) at y n + i; `log2` holds base-2 logarithms in the same order.
    pub(crate) columns: Vec<f64>,
    log2: Vec<f64>,
    /// Maximum of each symbol's column.
    largest: Vec<f64>,
    /// States with the largest values of each symbol, in descending order of the values.
    listed_states: Vec<Vec<(usize, f64)>>,
}

/// Largest number of states stored in `listed_states` per symbol.
const LISTED_STATES: usize = 16;

impl TableLikelihood {
    /// Creates a table from one row per state, each a distribution over the symbols. O(n m).
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] for an empty table, rows of different lengths, a value
    /// that is NaN, negative or infinite, or a row that does not sum to one
    /// within 1e-9.
    pub fn from_rows<R: AsRef<[f64]>>(rows: &[R]) -> Result<Self, OutOfRange> {
        let states = rows.len();
        let symbols = rows.first().map_or(0, |row| row.as_ref().len());
        check_size(states, symbols)?;
        let mut columns = vec![0.0; states * symbols];
        for (state, row) in rows.iter().enumerate() {
            let row = row.as_ref();
            if row.len() != symbols {
                let (found, expected) = (row.len(), symbols);
                let what = format!("the length of the row of state {state}");
                return Err(OutOfRange::count(what, found, expected));
            }
            for (symbol, &value) in row.iter().enumerate() {
                if !(value >= 0.0 && value.is_finite()) {
                    return Err(invalid(state, symbol, value));
                }
                columns[symbol * states + state] = value;
            }
            let sum = kernels::sum(row);
            if (sum - 1.0).abs() > SUM_TOLERANCE {
                return Err(row_sum(state, sum));
            }
        }
        Ok(Self::from_columns(states, columns))
    }

    /// Creates a table from valid probabilities, symbol by symbol.
    fn from_columns(states: usize, columns: Vec<f64>) -> Self {
        let log2 = columns.iter().map(|&value| kernels::log2(value)).collect();
        let maximum = |column: &[f64]| column.iter().copied().fold(0.0, f64::max);
        let largest = columns.chunks_exact(states).map(maximum).collect();
        let listed_states = columns.chunks_exact(states).map(listed_states).collect();
        Self { states, columns, log2, largest, listed_states }
    }

    /// Creates a table from a faer view with one row per state. O(n m).
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] as [`from_rows`](Self::from_rows).
    #[cfg(feature = "faer")]
    pub fn from_faer(matrix: faer::MatRef<'_, f64>) -> Result<Self, OutOfRange> {
        let row = |i| (0..matrix.ncols()).map(|y| matrix[(i, y)]).collect::<Vec<_>>();
        Self::from_rows(&(0..matrix.nrows()).map(row).collect::<Vec<_>>())
    }

    /// Number of symbols, m.
    #[must_use]
    pub fn symbols(&self) -> usize {
        self.largest.len()
    }

    /// Distribution of the next symbol, given the belief over its state: p(y) = Σ_i p(i) p(y |
    /// i). O(n m).
    ///
    /// ```
    /// # use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
    /// # let prior = Prior::BeforeFirstTransition(Belief::uniform(2)?);
    /// # let table = TableLikelihood::from_rows(&[[0.9, 0.1], [0.2, 0.8]])?;
    /// # let hmm = Hmm::new(prior, DenseTransition::from_rows(&[[0.7, 0.3], [0.3, 0.7]])?, table)?;
    /// let filter = hmm.filter();
    /// let tomorrow = hmm.likelihood().predictive(&filter.forecast(1)?)?;
    /// assert!((tomorrow.as_slice()[0] - 0.55).abs() < 1e-15);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`LikelihoodError::WrongLength`] if the belief has another number of
    /// states.
    pub fn predictive<S: AsRef<[f64]>>(
        &self,
        belief: &Belief<S>,
    ) -> Result<Belief, LikelihoodError> {
        let (found, expected) = (belief.states(), self.states);
        if found != expected {
            return Err(LikelihoodError::WrongLength { found, expected });
        }
        let columns = self.columns.chunks_exact(self.states);
        Ok(Belief::from_valid(
            columns.map(|column| kernels::dot(column, belief.values())).collect(),
        ))
    }

    /// Returns the rows, as [`from_rows`](Self::from_rows) takes them. O(n m).
    #[must_use]
    pub fn to_rows(&self) -> Vec<Vec<f64>> {
        let row = |state| self.columns[state..].iter().step_by(self.states).copied().collect();
        (0..self.states).map(row).collect()
    }

    /// Returns p(symbol | state), or `None` if the state or symbol does not exist.
    #[must_use]
    pub fn probability(&self, state: usize, symbol: usize) -> Option<f64> {
        let column = self.columns.chunks_exact(self.states).nth(symbol)?;
        column.get(state).copied()
    }
}

impl Likelihood for TableLikelihood {
    type Observation = usize;

    fn states(&self) -> usize {
        self.states
    }

    #[inline]
    fn diagonal<'a>(
        &'a self,
        &symbol: &'a usize,
        _: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        let symbols = self.symbols();
        if symbol >= symbols {
            return Err(LikelihoodError::Symbol { symbol, symbols });
        }
        let column = symbol * self.states..(symbol + 1) * self.states;
        let (linear, log2) = (&self.columns[column.clone()], &self.log2[column]);
        Ok(Diagonal::checked(linear, self.largest[symbol], Some(log2)))
    }

    fn is_precomputed(&self) -> bool {
        true
    }
}

/// O(states asked). The 16 largest values of each symbol are stored, and the bound is the first of
/// them whose state is not asked for, or the last.
impl LocalLikelihood for TableLikelihood {
    fn local<'a>(
        &'a self,
        &symbol: &'a usize,
        states: &[usize],
        scratch: &'a mut Scratch,
    ) -> Result<(Diagonal<'a>, f64), LikelihoodError> {
        let symbols = self.symbols();
        if symbol >= symbols {
            return Err(LikelihoodError::Symbol { symbol, symbols });
        }
        let column = &self.columns[symbol * self.states..];
        let out = scratch.values(states.len());
        out.iter_mut().zip(states).for_each(|(out, &state)| *out = column[state]);
        if states.len() == self.states {
            return Ok((Diagonal::linear(out), 0.0));
        }
        let known = &self.listed_states[symbol];
        // Values descend: the first listed state that is not asked for has the largest likelihood
        // of those. If all 16 are asked for, the last of them bounds the others; with fewer than 16
        // listed, all others are 0.
        let other = known.iter().find(|entry| states.binary_search(&entry.0).is_err());
        let rest = known.last().filter(|_| known.len() == LISTED_STATES);
        Ok((Diagonal::linear(out), other.or(rest).map_or(0.0, |entry| entry.1)))
    }

    fn listed_states(&self, &symbol: &usize, states: &mut Vec<usize>) {
        let known = self.listed_states.get(symbol).into_iter().flatten();
        states.extend(known.map(|entry| entry.0));
    }
}

impl ReorderStates for TableLikelihood {
    fn reordered(&self, order: &[usize]) -> Self {
        let columns = self.columns.chunks_exact(self.states);
        let columns = columns.flat_map(|column| order.iter().map(|&state| column[state]));
        Self::from_columns(self.states, columns.collect())
    }
}

/// States with the largest values above 0 of a column, in descending order of the values.
fn listed_states(column: &[f64]) -> Vec<(usize, f64)> {
    // Insertion into a short sorted list. Of equal values the lower state comes first, as it was
    // inserted first.
    let mut known: Vec<(usize, f64)> = Vec::with_capacity(LISTED_STATES + 1);
    for (state, &value) in column.iter().enumerate().filter(|entry| *entry.1 > 0.0) {
        if known.len() < LISTED_STATES || known.last().is_some_and(|last| value > last.1) {
            let at = known.partition_point(|entry| entry.1 >= value);
            known.insert(at, (state, value));
            known.truncate(LISTED_STATES);
        }
    }
    known
}

impl SampleObservation for TableLikelihood {
    type Sample = usize;

    fn sample<R: Rng + ?Sized>(&self, state: usize, rng: &mut R) -> usize {
        // The row of a state: one value of each column.
        let row = self.columns[state..].iter().step_by(self.states).copied();
        index(row.enumerate(), 1.0, rng)
    }
}

/// Checks that a table has states and symbols.
pub(super) fn check_size(states: usize, symbols: usize) -> Result<(), OutOfRange> {
    for (what, count) in [("states", states), ("symbols", symbols)] {
        if count == 0 {
            return Err(OutOfRange::none(format!("the number of {what} of a table")));
        }
    }
    Ok(())
}

/// Error of a value that is NaN, negative or infinite.
pub(crate) fn invalid(state: usize, symbol: usize, value: f64) -> OutOfRange {
    let what = format!("the probability of symbol {symbol} in state {state}");
    OutOfRange::new(what, value, "a finite value of at least 0")
}

/// Error of a state whose probabilities of symbols do not sum to one.
pub(crate) fn row_sum(state: usize, sum: f64) -> OutOfRange {
    OutOfRange::new(format!("the sum of the symbol probabilities of state {state}"), sum, "1")
}

#[cfg(feature = "serde")]
crate::stored! {
    [] TableLikelihood: [], |table| {
        rows: Vec<Vec<f64>> = table.to_rows(),
    } => Self::from_rows(&rows);
}
