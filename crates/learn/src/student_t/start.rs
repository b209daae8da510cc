//! Student's t from clusters, to begin learning with.

use std::error::Error;

use rand::Rng;

use super::StudentT;
use crate::clusters::ROUNDS;
use crate::{Clusters, StartFromClusters};

impl StartFromClusters for StudentT {
    /// Takes means and covariances from the clusters, as a Gaussian has them, and learns means and
    /// scales from these a few times. Degrees of freedom stay as they are: far from a mean, they
    /// would be learned from outliers alone.
    fn start<R: Rng + ?Sized>(
        &self,
        clusters: &Clusters<'_>,
        _: &mut R,
    ) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let first = Self::of(clusters.fit(&self.gaussian)?, self.degrees.clone(), true)?;
        let last = (0..ROUNDS).try_fold(first, |family, _| clusters.round(&family))?;
        Ok(Self { fixed: self.fixed, ..last })
    }
}
