//! Errors of likelihood operators.

use std::error::Error;
use std::sync::Arc;

use super::{Disagreement, Failed, Number, OutOfRange};

/// A likelihood that could not be computed or is invalid.
#[derive(Debug, Clone, thiserror::Error)]
#[non_exhaustive]
pub enum LikelihoodError {
    /// A likelihood (or log-likelihood) is out of range.
    #[error("state {state} has {kind} {value}, expected {expected}", value = Number(*.value))]
    Value {
        /// The state, from 0.
        state: usize,
        /// "likelihood" or "log-likelihood".
        kind: &'static str,
        /// Value found.
        value: f64,
        /// Valid values, in words.
        expected: &'static str,
    },
    /// The common log factor is NaN, or above 1e300 in magnitude.
    #[error(transparent)]
    Parameter(#[from] OutOfRange),
    /// The diagonal, or a vector given as an observation, does not have one value per state.
    #[error("the likelihood has {found} values, expected one for each of {expected} states")]
    WrongLength {
        /// Number of values found.
        found: usize,
        /// Number of states.
        expected: usize,
    },
    /// The table does not have the symbol.
    #[error("symbol {symbol} does not exist, the table has {symbols} symbols (0 to {})", .symbols.saturating_sub(1))]
    Symbol {
        /// The symbol, from 0.
        symbol: usize,
        /// Number of symbols.
        symbols: usize,
    },
    /// The bound on the likelihoods of unlisted states is out of range.
    #[error(
        "the {kind} of unlisted states is bounded by {value}, expected {expected}",
        value = Number(*.value)
    )]
    Bound {
        /// "likelihood" or "log-likelihood".
        kind: &'static str,
        /// Value found.
        value: f64,
        /// Valid values, in words.
        expected: &'static str,
    },
    /// A state is listed twice in an observation.
    #[error("state {state} is listed twice")]
    Twice {
        /// The state, from 0.
        state: usize,
    },
    /// An observation lists a state that does not exist.
    #[error("the observation lists state {state}, but there are {states} states (0 to {})", .states.saturating_sub(1))]
    Listed {
        /// The state, from 0.
        state: usize,
        /// Number of states.
        states: usize,
    },
    /// A sensor failed. Sensors defined outside this crate create this error by
    /// [`sensor`](Self::sensor).
    #[error(transparent)]
    Sensor(Failed<Arc<dyn Error + Send + Sync>>),
    /// Two methods of a sensor do not agree, as [`kit`](crate::likelihood::kit) found.
    #[error(transparent)]
    Disagreement(#[from] Disagreement),
    /// A sensor draws observations that are impossible in the state they are drawn in, as
    /// [`kit`](crate::likelihood::kit) found.
    #[error("an observation drawn in state {state} is impossible there")]
    ImpossibleSample {
        /// The state, from 0.
        state: usize,
    },
}

impl LikelihoodError {
    /// Creates the error of a user-defined sensor, from an error or a message.
    ///
    /// ```
    /// use wayfix::LikelihoodError;
    ///
    /// let error = LikelihoodError::sensor("the image has no pixels");
    /// assert_eq!(error.to_string(), "the sensor failed: the image has no pixels");
    /// ```
    pub fn sensor(error: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self::Sensor(Failed { what: "the sensor failed", cause: Arc::from(error.into()) })
    }
}
