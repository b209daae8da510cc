//! Errors of recognition.

use std::error::Error;
use std::fmt;

use crate::error::{InferenceError, TransitionError};
use crate::observation::{DescriptorError, ObservationError};

/// An invalid recogniser, query, label or step. The message includes those of its causes.
#[derive(Debug)]
#[non_exhaustive]
pub enum RecognitionError {
    /// An option or another number is out of its range.
    Parameter {
        /// Name of the number.
        what: &'static str,
        /// The value given.
        value: f64,
        /// The valid range.
        expected: &'static str,
    },
    /// A collection has too few or too many elements.
    Count {
        /// Name of the elements.
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
        /// The cause.
        source: DescriptorError,
    },
    /// The descriptor of a query is not valid.
    Descriptor {
        /// The step, from 1.
        step: usize,
        /// The cause.
        source: DescriptorError,
    },
    /// The distances of a query are not valid.
    Query {
        /// The step, from 1.
        step: usize,
        /// The cause.
        source: ObservationError,
    },
    /// A label is empty, or names references that do not exist.
    Label {
        /// The labelled part, from 0.
        part: usize,
        /// The step in that part, from 0.
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
        /// The cause, with its step.
        source: Box<RecognitionError>,
    },
    /// Fewer than two steps in a row are labelled with places on the map.
    FewLabels {
        /// Number of labelled steps on the map.
        found: usize,
    },
    /// The model of motion is not valid.
    Motion(TransitionError),
    /// The filter or the smoother cannot take a step.
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
            Self::References { traverse, source } => {
                write!(f, "the references of traverse {traverse} are not valid: {source}")
            }
            Self::Descriptor { step, source } => {
                write!(f, "the descriptor of the query of step {step} is not valid: {source}")
            }
            Self::Query { step, source } => {
                write!(f, "the query of step {step} is not valid: {source}")
            }
            Self::Label { part, step, place, references } => write!(
                f,
                "step {step} of labelled part {part} shows references up to {place}, expected a range \
                 that is not empty, within 0 to {}",
                references.saturating_sub(1)
            ),
            Self::FewLabels { found } => {
                write!(f, "{found} labelled steps are on the map, expected at least two in a row")
            }
            Self::Part { part, source } => {
                write!(f, "labelled part {part} is not valid: {source}")
            }
            Self::Motion(source) => write!(f, "the model of motion is not valid: {source}"),
            Self::Inference(source) => write!(f, "a step cannot be taken: {source}"),
        }
    }
}

impl Error for RecognitionError {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        match self {
            Self::References { source, .. } | Self::Descriptor { source, .. } => source.source(),
            Self::Query { source, .. } => source.source(),
            Self::Part { source, .. } => source.source(),
            Self::Motion(source) => source.source(),
            Self::Inference(source) => source.source(),
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
