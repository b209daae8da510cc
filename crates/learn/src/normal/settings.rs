//! Settings that all families built on [`Normals`](super::Normals) share.

use super::prior::GaussianPrior;

/// Settings of a family, which learning does not change.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Settings {
    /// True if NaN stands for a missing component.
    pub(crate) missing: bool,
    /// True if learning keeps the means.
    pub(crate) fixed_means: bool,
    /// True if learning keeps the covariances.
    pub(crate) fixed_covariances: bool,
    /// Prior of learning, if there is one.
    pub(crate) prior: Option<GaussianPrior>,
}

/// Methods of a family with the field `normals`.
macro_rules! settings {
    () => {
        /// Returns the family with missing components allowed, given as NaN. They are integrated
        /// out of the density; learning takes their expectation given the others. Without this
        /// setting, NaN is an error.
        #[must_use]
        pub fn with_missing(mut self) -> Self {
            self.normals = self.normals.with(|settings| settings.missing = true);
            self
        }

        /// Returns the family with a prior of each state's mean and covariance, for learning.
        /// By default there is none, and learning maximises the likelihood.
        ///
        /// # Errors
        ///
        /// [`EmissionError::Length`](crate::EmissionError::Length) if the prior has
        /// another number of components.
        pub fn with_prior(
            mut self,
            prior: $crate::GaussianPrior,
        ) -> Result<Self, $crate::EmissionError> {
            self.normals = self.normals.with_prior(prior)?;
            Ok(self)
        }

        /// Returns the family with means that learning keeps.
        #[must_use]
        pub fn with_fixed_means(mut self) -> Self {
            self.normals = self.normals.with(|settings| settings.fixed_means = true);
            self
        }

        /// Returns the family with covariances that learning keeps.
        #[must_use]
        pub fn with_fixed_covariances(mut self) -> Self {
            self.normals = self.normals.with(|settings| settings.fixed_covariances = true);
            self
        }

        /// Type of the covariances.
        #[must_use]
        pub fn covariance_type(&self) -> $crate::CovarianceType {
            self.normals.kind()
        }

        /// True if NaN stands for a missing component.
        #[must_use]
        pub fn takes_missing(&self) -> bool {
            self.normals.settings().missing
        }

        /// True if learning keeps the means.
        #[must_use]
        pub fn has_fixed_means(&self) -> bool {
            self.normals.settings().fixed_means
        }

        /// True if learning keeps the covariances.
        #[must_use]
        pub fn has_fixed_covariances(&self) -> bool {
            self.normals.settings().fixed_covariances
        }

        /// The prior of learning, if there is one.
        #[must_use]
        pub fn prior(&self) -> Option<&$crate::GaussianPrior> {
            self.normals.settings().prior.as_ref()
        }
    };
}

pub(crate) use settings;
