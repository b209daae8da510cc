//! Settings that the families on [`Normals`](super::Normals) share.

/// Choices that learning leaves as they are.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(in super::super) struct Settings {
    /// True if NaN is a missing component.
    pub(in super::super) missing: bool,
    /// True if learning keeps the means.
    pub(in super::super) fixed_means: bool,
    /// True if learning keeps the covariances.
    pub(in super::super) fixed_covariances: bool,
}

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

        /// Returns the family with means that learning keeps.
        #[must_use]
        pub fn with_fixed_means(self) -> Self {
            Self { normals: self.normals.with_fixed_means(), ..self }
        }

        /// Returns the family with covariances (or scales) that learning keeps.
        #[must_use]
        pub fn with_fixed_covariances(self) -> Self {
            Self { normals: self.normals.with_fixed_covariances(), ..self }
        }

        /// Number of components of an observation, d.
        #[must_use]
        pub fn components(&self) -> usize {
            self.normals.components()
        }

        /// True if NaN is a missing component.
        #[must_use]
        pub fn takes_missing(&self) -> bool {
            self.normals.settings().missing
        }

        /// True if learning keeps the means.
        #[must_use]
        pub fn has_fixed_means(&self) -> bool {
            self.normals.settings().fixed_means
        }

        /// True if learning keeps the covariances (or scales).
        #[must_use]
        pub fn has_fixed_covariances(&self) -> bool {
            self.normals.settings().fixed_covariances
        }

        /// Returns the family as it was stored.
        #[cfg(feature = "serde")]
        pub(crate) fn restored(
            self,
            [missing, fixed_means, fixed_covariances]: [bool; 3],
            prior: Option<$crate::emission::GaussianPrior>,
        ) -> Result<Self, $crate::emission::EmissionError> {
            let family = if missing { self.with_missing() } else { self };
            let family = if fixed_means { family.with_fixed_means() } else { family };
            let family = if fixed_covariances { family.with_fixed_covariances() } else { family };
            prior.into_iter().try_fold(family, Self::with_prior)
        }

        /// The prior of learning, if there is one.
        #[must_use]
        pub fn prior(&self) -> Option<&$crate::emission::GaussianPrior> {
            self.prior.as_ref()
        }
    };
}

pub(in super::super) use settings;
