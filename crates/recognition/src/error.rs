//! Errors of recognition, each with the query, step or labelled part that it is about.

use crate::observation::ViewError;
use wayfix::error::{At, Failed, OutOfRange};
use wayfix::{HmmError, TransitionError};

/// An invalid recogniser, query, label or step. The message includes those of its causes.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecognitionError {
    /// An option, the size of a collection, or another number is out of its range.
    #[error(transparent)]
    Parameter(#[from] OutOfRange),
    /// The descriptors of references are not valid.
    #[error(transparent)]
    References(At<ViewError>),
    /// The descriptor of a query is not valid.
    #[error(transparent)]
    Descriptor(At<ViewError>),
    /// The distances of a query are not valid.
    #[error(transparent)]
    Query(At<ViewError>),
    /// A label is empty, or names references that do not exist.
    #[error("step {step} of labelled part {part} shows references up to {place}, expected a non-empty range within 0 to {}", .references.saturating_sub(1))]
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
    #[error(transparent)]
    Part(At<Box<RecognitionError>>),
    /// Fewer than two steps in a row are labelled with places on the map.
    #[error("{found} labelled steps are on the map, expected at least two in a row")]
    FewLabels {
        /// Number of labelled steps on the map.
        found: usize,
    },
    /// The model of motion is not valid.
    #[error("the model of motion is not valid: {0}")]
    Motion(TransitionError),
    /// The filter or the smoother cannot take a step.
    #[error(transparent)]
    Inference(Failed<HmmError>),
}

impl From<TransitionError> for RecognitionError {
    fn from(source: TransitionError) -> Self {
        Self::Motion(source)
    }
}

impl From<HmmError> for RecognitionError {
    fn from(source: HmmError) -> Self {
        Self::Inference(Failed { what: "a step cannot be taken", cause: source })
    }
}

impl RecognitionError {
    /// Invalid descriptors of the references of a traverse, from 0.
    pub(super) fn references(traverse: usize, cause: ViewError) -> Self {
        let words = &["the references of traverse ", " are not valid"];
        Self::References(At::new(words, traverse, cause))
    }

    /// An invalid descriptor of the query of a step, from 1.
    pub(super) fn descriptor(step: usize, cause: ViewError) -> Self {
        let words = &["the descriptor of the query of step ", " is not valid"];
        Self::Descriptor(At::new(words, step, cause))
    }

    /// Invalid distances of the query of a step, from 1.
    pub(super) fn query(step: usize, cause: ViewError) -> Self {
        Self::Query(At::new(&["the query of step ", " is not valid"], step, cause))
    }

    /// An error of a labelled part, from 0.
    pub(super) fn of_part(self, part: usize) -> Self {
        Self::Part(At::new(&["labelled part ", " is not valid"], part, Box::new(self)))
    }
}
