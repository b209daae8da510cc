//! Settings that the families on [`Normals`](super::Normals) share.

/// Methods of a family with the fields `normals` and `prior`.
macro_rules! settings {
    () => {
        /// Returns the family with missing components, given as NaN. They are integrated out: of
        /// the density, and in learning by their expectation, given the others. Without this, a
        /// NaN is an error.
        #[must_use]
        pub fn with_missing(self) -> Self {
            Self { normals: self.normals.with_missing(), ..self }
        }

        /// Returns the family with a prior of each mean and covariance (or scale), for learning.
        /// By default there is none: learning maximises the likelihood.
        ///
        /// # Errors
        ///
        /// [`EmissionError::Length`](crate::emission::EmissionError::Length) if the prior has
        /// another number of components.
        pub fn with_prior(
            self,
            prior: $crate::emission::GaussianPrior,
        ) -> Result<Self, $crate::emission::EmissionError> {
            prior.check_components(self.components())?;
            Ok(Self { prior: Some(prior), ..self })
        }

        /// Number of components of an observation, d.
        #[must_use]
        pub fn components(&self) -> usize {
            self.normals.components()
        }

        /// True if NaN is a missing component.
        #[must_use]
        pub fn takes_missing(&self) -> bool {
            self.normals.takes_missing()
        }

        /// The prior of learning, if there is one.
        #[must_use]
        pub fn prior(&self) -> Option<&$crate::emission::GaussianPrior> {
            self.prior.as_ref()
        }
    };
}

pub(in super::super) use settings;
