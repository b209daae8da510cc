//! Errors of families, and the checks that return them. A distribution's errors name no state; the family adds the state and the
//! component, a mixture the part, and a product shifts components to those of the whole row.

use std::ops::Range;

use wayfix::LikelihoodError;
use wayfix::inference::LearnError;
use wayfix::internal::Number;

/// An invalid parameter or observation of a family, statistics that do not determine the
/// parameters, or data that is not a series of observations.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EmissionError {
    /// No states, or observations without components.
    #[error(
        "a family needs at least one state and one component, found {states} states and {components} components"
    )]
    Empty {
        /// Number of states.
        states: usize,
        /// Number of components of an observation, d.
        components: usize,
    },
    /// A list of parameters has the wrong length.
    #[error("the {what}{} has {found} values, expected {expected}", of_state(*.state))]
    Length {
        /// Name of the parameter.
        what: &'static str,
        /// The state, from 0, unless the list is common to all.
        state: Option<usize>,
        /// Number of values found.
        found: usize,
        /// Number of values expected.
        expected: usize,
    },
    /// A parameter is out of its range.
    #[error(
        "the {what}{}{} is {value}, expected {expected}",
        of_state(*.state),
        at(*.component),
        value = Number(*.value)
    )]
    Parameter {
        /// Name of the parameter.
        what: &'static str,
        /// The state, from 0, unless the parameter is common to all.
        state: Option<usize>,
        /// The component, from 0, unless the parameter belongs to the whole vector.
        component: Option<usize>,
        /// Value found.
        value: f64,
        /// Valid values, in words.
        expected: &'static str,
    },
    /// A covariance is not positive definite.
    #[error("the covariance{} is not positive definite, at component {component}", of_state(*.state))]
    NotPositiveDefinite {
        /// The state, from 0, unless the covariance is common to all.
        state: Option<usize>,
        /// The component at which its factorisation fails, from 0.
        component: usize,
    },
    /// The observations behind a state do not determine its parameters.
    #[error("the {what}{}{} cannot be estimated from {} expected observations: {reason}", of_state(*.state), at(*.component), rounded(*.weight))]
    TooFew {
        /// The state, from 0, unless the parameter is common to all.
        state: Option<usize>,
        /// The component, from 0, unless the parameter belongs to the whole vector.
        component: Option<usize>,
        /// Name of the parameter.
        what: &'static str,
        /// Expected number of observations behind the state.
        weight: f64,
        /// Reason, with a remedy.
        reason: &'static str,
    },
    /// An observation has the wrong number of components.
    #[error("the observation has {found} components, expected {expected}")]
    Components {
        /// Number of components found.
        found: usize,
        /// Number of components expected.
        expected: usize,
    },
    /// Observations have no such component.
    #[error("there is no component {component}, observations have {components}")]
    NoComponent {
        /// The component asked for, from 0.
        component: usize,
        /// Number of components of an observation.
        components: usize,
    },
    /// A direction does not have length one.
    #[error("the observation has length {value}, expected 1 within 1e-6", value = Number(*.value))]
    Norm {
        /// Length found.
        value: f64,
    },
    /// A component of an observation is out of its range.
    #[error(
        "component {component} of the observation is {value}, expected {expected}",
        value = Number(*.value)
    )]
    Observation {
        /// The component, from 0.
        component: usize,
        /// Value found.
        value: f64,
        /// Valid values, in words.
        expected: &'static str,
    },
    /// No observations were given.
    #[error("there are no observations")]
    NoObservations,
    /// A component is missing in all observations, so that nothing can be learned about it.
    #[error("component {component} is missing in all observations")]
    AllMissing {
        /// The component, from 0.
        component: usize,
    },
    /// There are fewer distinct observations than clusters.
    #[error("{found} different observations cannot start {expected} {what}")]
    TooFewDifferent {
        /// Number of distinct observations, by their known components.
        found: usize,
        /// Number of clusters.
        expected: usize,
        /// Name of the clusters, such as "states".
        what: &'static str,
    },
    /// A component has the same value in all observations, which leaves the family undetermined.
    #[error(
        "component {component} is always {value}; leave it out, or give a prior: {cause}",
        value = Number(*.value)
    )]
    Constant {
        /// The component of the observation, from 0.
        component: usize,
        /// The value.
        value: f64,
        /// Error of the family, which names the parameter.
        cause: Box<EmissionError>,
    },
    /// An observation of several sequences is invalid.
    #[error("sequence {sequence}, step {step}: {cause}")]
    Step {
        /// The sequence, from 0.
        sequence: usize,
        /// The step, from 1.
        step: usize,
        /// Error of the observation.
        cause: Box<EmissionError>,
    },
    /// A part of a state's mixture has an error.
    #[error("part {part} of a mixture: {cause}")]
    Part {
        /// The part, from 0.
        part: usize,
        /// Error of the part, with the state.
        cause: Box<EmissionError>,
    },
    /// A factor of a [`Product`](crate::Product) has an error that concerns its own components.
    #[error("{} of the row: {cause}", components(*.from, *.to))]
    Factor {
        /// First component of the row that belongs to the factor, from 0.
        from: usize,
        /// One past the last component that belongs to it.
        to: usize,
        /// Error of the factor, which counts its components from 0.
        cause: Box<EmissionError>,
    },
    /// Observations must have at least one component.
    #[error("observations have 0 components, expected at least 1")]
    NoComponents,
    /// The last row is not complete.
    #[error("{values} values do not divide into observations of {components} components")]
    Incomplete {
        /// Number of values.
        values: usize,
        /// Number of components of an observation.
        components: usize,
    },
    /// There are too few rows for an observation with its predecessors.
    #[error("{rows} rows are too few for observations with {order} predecessors")]
    TooFewRows {
        /// Number of rows.
        rows: usize,
        /// Number of predecessors.
        order: usize,
    },
    /// A file cannot be opened or read.
    #[error("{file} cannot be read: {reason}")]
    Read {
        /// Name of the file.
        file: String,
        /// Cause, in words.
        reason: String,
    },
    /// A line is not valid.
    #[error("{file}, line {line}: {problem}")]
    Line {
        /// Name of the file.
        file: String,
        /// The line, from 1.
        line: u64,
        /// What is wrong, in words.
        problem: String,
    },
}

impl EmissionError {
    /// Converts an error of the family of components `from` to `to` into one of the whole row,
    /// where components of an observation count from the row's start.
    pub(super) fn in_factor(self, from: usize, to: usize) -> Self {
        match self {
            Self::Observation { component, value, expected } => {
                Self::Observation { component: from + component, value, expected }
            }
            Self::Factor { from: inner, to, cause } => {
                Self::Factor { from: from + inner, to: from + to, cause }
            }
            other => Self::Factor { from, to, cause: Box::new(other) },
        }
    }

    /// Converts an error of a Gaussian into one of a part of a mixture with m parts in each state.
    /// The Gaussian's number counts the parts of the `known` state, or else of all states.
    pub(super) fn in_part(mut self, known: Option<usize>, m: usize) -> Self {
        use EmissionError as E;
        let (E::Length { state, .. }
        | E::Parameter { state, .. }
        | E::NotPositiveDefinite { state, .. }
        | E::TooFew { state, .. }) = &mut self
        else {
            return self;
        };
        let Some(at) = *state else {
            return self;
        };
        // With a known state, the number `at` is below m and is itself the part.
        *state = Some(known.unwrap_or(at / m));
        Self::Part { part: at % m, cause: Box::new(self) }
    }

    /// Components of the family whose parameters are not determined by the observations, and the
    /// component at fault, if it is known. `all` are the components of the family with the error.
    pub(super) fn undetermined(&self, all: Range<usize>) -> Option<(Range<usize>, Option<usize>)> {
        match self {
            Self::TooFew { component, .. } => {
                let component = component.map(|component| all.start + component);
                Some((all, component))
            }
            Self::Part { cause, .. } => cause.undetermined(all),
            Self::Factor { from, to, cause } => {
                cause.undetermined(all.start + from..all.start + to)
            }
            _ => None,
        }
    }
}

/// " of state 3", or nothing.
fn of_state(state: Option<usize>) -> String {
    state.map_or_else(String::new, |state| format!(" of state {state}"))
}

/// ", component 2,", or nothing.
fn at(component: Option<usize>) -> String {
    component.map_or_else(String::new, |component| format!(", component {component},"))
}

/// "component 2", or "components 2 to 4".
fn components(from: usize, to: usize) -> String {
    if from + 1 >= to {
        format!("component {from}")
    } else {
        format!("components {from} to {}", to - 1)
    }
}

/// A weight rounded to six decimals, without the noise of its last digits.
fn rounded(weight: f64) -> f64 {
    if weight < 1e-3 { weight } else { (weight * 1e6).round() / 1e6 }
}

impl From<EmissionError> for LikelihoodError {
    fn from(source: EmissionError) -> Self {
        Self::sensor(source)
    }
}

impl From<EmissionError> for LearnError {
    fn from(source: EmissionError) -> Self {
        Self::likelihood(source)
    }
}

// Checks of parameters and observations, with the errors for invalid ones.

/// Floor for the log density of a possible observation, to tell it from −∞, an impossible one. It
/// is below what a diagonal may hold: an error, not a density of 0.
pub(super) const LOG_DENSITY_FLOOR: f64 = -1e301;

/// Variance relative to the mean square below which it is only rounding.
const ROUNDING: f64 = 16.0 * f64::EPSILON;

/// Returns a parameter if it is valid.
pub(super) fn check(
    what: &'static str,
    value: f64,
    valid: bool,
    expected: &'static str,
) -> Result<f64, EmissionError> {
    let (state, component) = (None, None);
    if valid {
        Ok(value)
    } else {
        Err(EmissionError::Parameter { what, state, component, value, expected })
    }
}

/// Checks the length of a list of parameters, for one state or common to all.
pub(super) fn check_length(
    what: &'static str,
    state: Option<usize>,
    found: usize,
    expected: usize,
) -> Result<(), EmissionError> {
    if found == expected {
        return Ok(());
    }
    Err(EmissionError::Length { what, state, found, expected })
}

/// Checks the number of components of an observation.
#[inline]
pub(super) fn check_components(row: &[f64], expected: usize) -> Result<(), EmissionError> {
    let found = row.len();
    if found == expected { Ok(()) } else { Err(EmissionError::Components { found, expected }) }
}

/// Checks the components of an observation.
pub(super) fn check_values(
    row: &[f64],
    is_valid: impl Fn(f64) -> bool,
    expected: &'static str,
) -> Result<(), EmissionError> {
    match row.iter().copied().enumerate().find(|(_, value)| !is_valid(*value)) {
        None => Ok(()),
        Some((component, value)) => Err(EmissionError::Observation { component, value, expected }),
    }
}

/// Returns the numbers of states and components of parameters with one row for each state.
pub(super) fn shape<R: AsRef<[T]>, T>(
    what: &'static str,
    rows: &[R],
) -> Result<(usize, usize), EmissionError> {
    let (states, components) = (rows.len(), rows.first().map_or(0, |row| row.as_ref().len()));
    if states == 0 || components == 0 {
        return Err(EmissionError::Empty { states, components });
    }
    check_shape(what, rows, (states, components)).map(|()| (states, components))
}

/// Checks the numbers of states and components of further parameters.
pub(super) fn check_shape<R: AsRef<[T]>, T>(
    what: &'static str,
    rows: &[R],
    (states, components): (usize, usize),
) -> Result<(), EmissionError> {
    check_length(what, None, rows.len(), states)?;
    let mut rows = rows.iter().enumerate();
    rows.try_for_each(|(state, row)| {
        check_length(what, Some(state), row.as_ref().len(), components)
    })
}

/// Checks that parameters are finite, and returns those of all states, one row after the other.
pub(super) fn flatten<R: AsRef<[f64]>>(
    what: &'static str,
    rows: &[R],
    components: usize,
) -> Result<Vec<f64>, EmissionError> {
    let mut all = Vec::with_capacity(rows.len() * components);
    for (state, row) in rows.iter().enumerate() {
        check_length(what, Some(state), row.as_ref().len(), components)?;
        for (component, &value) in row.as_ref().iter().enumerate() {
            let finite = check(what, value, value.is_finite(), "a finite value");
            all.push(finite.map_err(|error| with_place(error, state, Some(component)))?);
        }
    }
    Ok(all)
}

/// Adds the state and the component to the error of a distribution.
pub(super) fn with_place(mut error: EmissionError, at: usize, of: Option<usize>) -> EmissionError {
    if let EmissionError::Parameter { state, component, .. }
    | EmissionError::TooFew { state, component, .. } = &mut error
    {
        (*state, *component) = (Some(at), of);
    }
    error
}

/// Returns a variance, or another measure of spread, unless it is only rounding.
pub(super) fn check_spread(
    what: &'static str,
    weight: f64,
    variance: f64,
    square: f64,
) -> Result<f64, EmissionError> {
    // The variance is a difference of terms of the size of the mean square, each rounded: below a
    // few units in the last place of the mean square, it has no correct digit. NaN and infinity
    // fail as well.
    if variance > ROUNDING * square && square.is_finite() {
        return Ok(variance);
    }
    let reason = "they are all alike, which leaves the spread undetermined; give a prior";
    Err(EmissionError::TooFew { state: None, component: None, what, weight, reason })
}
