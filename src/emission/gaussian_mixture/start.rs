//! Starts of mixtures.

use std::error::Error;

use rand::Rng;

use super::GaussianMixture;
use crate::emission::{ClusteredObservations, EmissionError, Gaussian, StartFromClusters};
use crate::likelihood::Likelihood;

impl StartFromClusters for GaussianMixture {
    /// Takes the parts of each state from clusters within that of the state. A part with a weight
    /// of 0 stays as it is.
    fn start<R: Rng + ?Sized>(
        &self,
        observations: &ClusteredObservations<'_>,
        rng: &mut R,
    ) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let m = self.parts;
        let mut weights = Vec::with_capacity(self.weights.len());
        let (mut means, mut covariances) = (Vec::new(), Vec::new());
        for state in 0..self.states() {
            let is_possible = |part: &usize| self.weights[state * m + part] > 0.0;
            let possible: Vec<usize> = (0..m).filter(is_possible).collect();
            let division = observations.divide(state, &possible, rng)?;
            let parts: Vec<usize> = (state * m..(state + 1) * m).collect();
            let parts = Gaussian::of(self.normals.select(&parts), self.prior.clone());
            let parts = observations.estimate_parts(&parts, state, &division);
            let parts = parts.map_err(|error| match error.downcast::<EmissionError>() {
                Ok(error) => error.in_part(Some(state), m).into(),
                Err(error) => error,
            })?;
            means.push(parts.means());
            covariances.push(parts.covariances());
            // Every part has a weight, since one of 0 would stay so.
            let counts = division.counts.iter().map(|(part, count)| (*part, *count.max(&1) as f64));
            let total: f64 = counts.clone().map(|(_, count)| count).sum();
            let mut shares = vec![0.0; m];
            counts.for_each(|(part, count)| shares[part] = count / total);
            weights.push(shares);
        }
        let new = Self::new(self.covariance_type(), &weights, &means, &covariances)?;
        let normals = new.normals.with_settings(self.normals.settings());
        Ok(Self { normals, prior: self.prior.clone(), ..new })
    }
}
