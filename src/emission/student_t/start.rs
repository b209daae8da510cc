//! Starts of Student's t.

use std::error::Error;

use rand::Rng;

use super::StudentT;
use crate::emission::clustered::ROUNDS;
use crate::emission::{ClusteredObservations, Gaussian, StartFromClusters};

impl StartFromClusters for StudentT {
    /// Takes means and covariances from the clusters, as a Gaussian has them, and learns means and
    /// scales from these a few times. Degrees of freedom stay as they are: far from a mean, they
    /// would be learned from outliers alone.
    fn start<R: Rng + ?Sized>(
        &self,
        observations: &ClusteredObservations<'_>,
        _: &mut R,
    ) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let gaussian = observations.fit(&Gaussian::of(self.normals.clone(), self.prior.clone()))?;
        let first = Self::of_gaussian(&self.degrees, gaussian)?.with_fixed_degrees();
        let last = (0..ROUNDS).try_fold(first, |family, _| observations.round(&family))?;
        Ok(Self { fixed: self.fixed, ..last })
    }
}
