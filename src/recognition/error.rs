//! Errors of recognition.

use std::error::Error;
use std::fmt;

use crate::error::{InferenceError, TransitionError};
use crate::observation::{DescriptorError, ObservationError};

/// Why a recogniser cannot be made, or a query not be recognised. Its text ends with that
/// of its causes.
#[derive(Debug)]
#[non_exhaustive]
pub enum RecognitionError {
    /// An option or another number is out of its range.
    Parameter {
        /// Which number.
        what: &'static str,
        /// What was found.
        value: f64,
        /// Its range.
        expected: &'static str,
    },
    /// Something has not as many elements as it should.
    Count {
        /// What has.
        what: &'static str,
        /// Elements found.
        found: usize,
        /// Elements expected.
        expected: usize,
    },
    /// The descriptors of references are not valid.
    References {
        /// The traverse, from 0.
        traverse: usize,
        /// Why.
        source: DescriptorError,
    },
    /// The descriptor of a query is not valid.
    Descriptor {
        /// The step, from 1.
        step: usize,
        /// Why.
        source: DescriptorError,
    },
    /// The distances of a query are not valid.
    Query {
        /// The step, from 1.
        step: usize,
        /// Why.
        source: ObservationError,
    },
    /// A label names references that do not exist.
    Label {
        /// The labelled part, from 0.
        part: usize,
        /// Its step, from 0.
        step: usize,
        /// The last reference of the label.
        place: usize,
        /// The number of references.
        references: usize,
    },
    /// A query or a reading of a labelled part is not valid.
    Part {
        /// The labelled part, from 0.
        part: usize,
        /// Why, with its step.
        source: Box<RecognitionError>,
    },
    /// Fewer than two steps in a row are labelled with places on the map.
    FewLabels {
        /// Number of labelled steps on the map.
        found: usize,
    },
    /// The model of motion is not valid.
    Motion(TransitionError),
    /// A step is not possible.
    Inference(InferenceError),
}

impl fmt::Display for RecognitionError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Parameter { what, value, expected } => {
                write!(f, "{what} is {value}, expected {expected}")
            }
            Self::Count { what, found, expected } => {
                write!(f, "{found} {what}, expected {expected}")
            }
            Self::References { traverse, .. } => {
                write!(f, "the references of traverse {traverse} are not valid")
            }
            Self::Descriptor { step, .. } => {
                write!(f, "the descriptor of the query of step {step} is not valid")
            }
            Self::Query { step, .. } => write!(f, "the query of step {step} is not valid"),
            Self::Label { part, step, place, references } => write!(
                f,
                "step {step} of labelled part {part} shows reference {place}, expected one from \
                 0 to {}",
                references.saturating_sub(1)
            ),
            Self::FewLabels { found } => {
                write!(f, "{found} labelled steps are on the map, expected at least two in a row")
            }
            Self::Part { part, .. } => write!(f, "labelled part {part} is not valid"),
            Self::Motion(_) => write!(f, "the model of motion is not valid"),
            Self::Inference(_) => write!(f, "a step cannot be taken"),
        }?;
        match self.source() {
            Some(cause) => write_causes(f, cause),
            None => Ok(()),
        }
    }
}

/// Writes a cause and its own causes, unless its text has them.
fn write_causes(f: &mut fmt::Formatter<'_>, cause: &(dyn Error + 'static)) -> fmt::Result {
    let (text, next) = (cause.to_string(), cause.source());
    write!(f, ": {text}")?;
    match next.filter(|next| !text.contains(&next.to_string())) {
        Some(next) => write_causes(f, next),
        None => Ok(()),
    }
}

impl Error for RecognitionError {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        match self {
            Self::References { source, .. } | Self::Descriptor { source, .. } => Some(source),
            Self::Query { source, .. } => Some(source),
            Self::Part { source, .. } => Some(&**source),
            Self::Motion(source) => Some(source),
            Self::Inference(source) => Some(source),
            _ => None,
        }
    }
}

impl From<TransitionError> for RecognitionError {
    fn from(source: TransitionError) -> Self {
        Self::Motion(source)
    }
}

impl From<InferenceError> for RecognitionError {
    fn from(source: InferenceError) -> Self {
        Self::Inference(source)
    }
}
