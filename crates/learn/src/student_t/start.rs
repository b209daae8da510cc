//! Starts of Student's t from clusters.

use std::error::Error;

use rand::Rng;

use super::StudentT;
use crate::clusters::ROUNDS;
use crate::{Clusters, StartFromClusters};

impl StartFromClusters for StudentT {
    /// Takes means and covariances from the clusters as for a Gaussian, and improves them in a few
    /// rounds of learning. Degrees of freedom stay as they are: far from the right means they would
    /// be learned from outliers alone.
    fn start<R: Rng + ?Sized>(
        &self,
        clusters: &Clusters<'_>,
        _: &mut R,
    ) -> Result<Self, Box<dyn Error + Send + Sync>> {
        // Each round is an E and an M step with fixed degrees of freedom. The setting itself is
        // kept.
        let first = Self::of(clusters.fit(&self.gaussian)?, self.degrees.clone(), true)?;
        let last = (0..ROUNDS).try_fold(first, |family, _| clusters.round(&family))?;
        Ok(Self { fixed: self.fixed, ..last })
    }
}
