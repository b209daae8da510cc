//! Result of learning: options and usual scores. Warnings are neither stored nor compared.

use super::warning::Warning;
use super::{Options, RecognitionError};
use crate::observation::Standardizer;
use wayfix::error::OutOfRange;

/// Result of learning: the options of a [`Recognizer`](super::Recognizer), and what was learned
/// of each reference.
///
/// With the feature `serde` it can be stored, without [warnings](Self::warnings), which do not count
/// in comparisons either.
#[derive(Debug, Clone)]
pub struct Parameters {
    pub(crate) options: Options,
    pub(crate) standardizer: Option<Standardizer>,
    pub(super) warnings: Vec<Warning>,
}

impl PartialEq for Parameters {
    fn eq(&self, other: &Self) -> bool {
        self.options == other.options && self.standardizer == other.standardizer
    }
}

impl Parameters {
    pub(super) fn new(options: Options) -> Self {
        Self { options, standardizer: None, warnings: Vec::new() }
    }

    /// Creates a fit from parts read from storage, which it checks.
    #[cfg(feature = "serde")]
    pub(crate) fn from_parts(
        options: Options,
        standardizer: Option<Standardizer>,
    ) -> Result<Self, RecognitionError> {
        options.check()?;
        Ok(Self { standardizer, ..Self::new(options) })
    }

    /// Options, including the learned ones.
    #[must_use]
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// Replaces the options.
    #[must_use]
    pub fn with_options(self, options: Options) -> Self {
        Self { options, ..self }
    }

    /// Drops everything learned about single references, for use with another map.
    #[must_use]
    pub fn without_references(self) -> Self {
        Self { standardizer: None, ..self }
    }

    /// Warnings about the fit. Empty for one read from storage.
    #[must_use]
    pub fn warnings(&self) -> &[Warning] {
        &self.warnings
    }

    /// Checks the options, and drops learned references if their number differs.
    pub(super) fn checked(self, references: usize) -> Result<Self, RecognitionError> {
        self.options.check()?;
        if references == 0 {
            return Err(OutOfRange::none("the number of references").into());
        }
        let others = self.standardizer.as_ref().is_some_and(|s| s.references() != references);
        Ok(if others { self.without_references() } else { self })
    }
}

#[cfg(feature = "serde")]
wayfix::stored! {
    [] Fit for self::Parameters: [], |fit| {
        options: Options = fit.options,
        standardizer: Option<Standardizer> = fit.standardizer,
    } => Self::from_parts(options, standardizer);
}
