//! Starts of Gaussian mixtures from clusters: the parts of a state are clusters within its own.

use std::error::Error;

use rand::Rng;

use super::GaussianMixture;
use crate::normal::{CovarianceType, Normals};
use crate::{Clusters, EmissionError, Family, Gaussian, StartFromClusters};
use wayfix::Likelihood;

impl StartFromClusters for GaussianMixture {
    /// Takes the parts of each state from clusters within the state's cluster. A part with a weight
    /// of 0 stays as it is. Fixed means divide the observations of a state between them.
    fn start<R: Rng + ?Sized>(
        &self,
        clusters: &Clusters<'_>,
        rng: &mut R,
    ) -> Result<Self, Box<dyn Error + Send + Sync>> {
        // Fixed means already decide which part an observation belongs to.
        if self.has_fixed_means() {
            return clusters.fit(self);
        }
        clusters.check(self)?;
        let m = self.parts;
        let mut weights = Vec::with_capacity(self.weights.len());
        let (mut means, mut covariances) = (Vec::new(), Vec::new());
        for state in 0..self.states() {
            let is_possible = |part: &usize| self.weights[state * m + part] > 0.0;
            let possible: Vec<usize> = (0..m).filter(is_possible).collect();
            let division = clusters.divide(state, &possible, rng)?;
            let parts: Vec<usize> = (state * m..(state + 1) * m).collect();
            let parts = Gaussian::of(self.normals.select(&parts));
            let parts = clusters.fit_parts(&parts, state, &division);
            let parts = parts.map_err(|error| match error.downcast::<EmissionError>() {
                Ok(error) => error.in_part(Some(state), m).into(),
                Err(error) => error,
            })?;
            means.extend(parts.means().concat());
            covariances.extend(parts.covariances().concat());
            // At least 1 each, since a weight of 0 would stay 0.
            let counts = division.counts.iter().map(|(part, count)| (*part, *count.max(&1) as f64));
            let total: f64 = counts.clone().map(|(_, count)| count).sum();
            weights.resize((state + 1) * m, 0.0);
            counts.for_each(|(part, count)| weights[state * m + part] = count / total);
        }
        let (kind, d) = (self.covariance_type(), self.components());
        let normals = Normals::new(kind, d, means, covariances, self.normals.settings().clone())
            .map_err(
                |error| if kind == CovarianceType::Tied { error } else { error.in_part(None, m) },
            )?;
        Ok(Self::of(normals, m, weights))
    }
}
