//! Families from clusters of observations.

use std::error::Error;

use rand::Rng;

use super::observations::Clusters;
use crate::EmissionError;
use wayfix::Fixed;
use wayfix::HmmError;
use wayfix::likelihood::{GroupedLikelihood, LearnLikelihood};
use wayfix::{Likelihood, Scratch};

/// Rounds in which what is missing has its expectation, after one with the values of others.
pub(crate) const ROUNDS: usize = 3;

/// Result of estimating a family.
pub(crate) type Outcome<B> = Result<B, Box<dyn Error + Send + Sync>>;

/// A family that takes its parameters from clusters of observations, to begin learning there.
///
/// [`starts`](crate::starts) asks for it. All families of this module have it; one of
/// your own needs a single line, if the way that its parameters are estimated from complete
/// observations does not depend on those that it has: `impl StartFromClusters for MyFamily {}`.
pub trait StartFromClusters: LearnLikelihood<Observation = [f64]> + Clone + Send + Sync {
    /// Returns the family with parameters from the clusters, one for each state. By default they
    /// are [fitted](Clusters::fit) as in learning.
    ///
    /// # Errors
    ///
    /// Any error, if the clusters do not determine the parameters.
    fn start<R: Rng + ?Sized>(
        &self,
        clusters: &Clusters<'_>,
        rng: &mut R,
    ) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let _ = rng;
        clusters.fit(self)
    }
}

impl<B> StartFromClusters for GroupedLikelihood<B> where
    B: LearnLikelihood<Observation = [f64]> + Clone + Send + Sync
{
}
impl<B: Likelihood<Observation = [f64]> + Clone + Send + Sync> StartFromClusters for Fixed<B> {}

impl Clusters<'_> {
    /// Fits a family to the observations of each state's cluster, with a tenth of the
    /// weight from all observations.
    ///
    /// Missing components have at first the values of other observations of the cluster; the
    /// family from these then expects them, three times, as in learning. So the parameters do not
    /// depend on those of `family`, if complete observations are added alike whatever they are.
    ///
    /// # Errors
    ///
    /// The error of [`LearnLikelihood::maximize`]; [`HmmError::StateCount`] unless there is a cluster
    /// for each state, and the family's error if it does not take the first observation.
    pub fn fit<B>(&self, family: &B) -> Result<B, Box<dyn Error + Send + Sync>>
    where
        B: LearnLikelihood<Observation = [f64]>,
    {
        self.check(family)?;
        self.fit_by(family, |at, weights| self.weights(at, weights))
    }

    /// Checks that a family has a state for each cluster, and takes the components of observations.
    pub(crate) fn check<B>(&self, family: &B) -> Outcome<()>
    where
        B: Likelihood<Observation = [f64]>,
    {
        let (found, expected) = (family.states(), self.pooled.len());
        if found != expected {
            let (part, first) = ("family", "clusters");
            return Err(HmmError::StateCount { part, found, first, expected }.into());
        }
        if let Some(row) = self.rows.first() {
            // All rows have as many components as the first.
            family.diagonal(row, &mut Scratch::default())?;
        }
        Ok(())
    }

    /// Estimates a family in which each observation has weights that a function writes.
    pub(super) fn fit_by<B>(&self, family: &B, weights: impl Fn(usize, &mut [f64])) -> Outcome<B>
    where
        B: LearnLikelihood<Observation = [f64]>,
    {
        if self.completed.is_empty() {
            return self.round_by(family, weights);
        }
        // A value of another row may be impossible beside the rest of this one.
        let mut scratch = Scratch::default();
        let rows = self.completed.iter().map(|row| &**row).enumerate();
        let valid = rows.filter(|(_, row)| family.diagonal(row, &mut scratch).is_ok());
        let first = round(family, valid, &weights)?;
        (1..ROUNDS).try_fold(self.round_by(&first, &weights)?, |family, _| {
            self.round_by(&family, &weights)
        })
    }

    /// Estimates a family once more, with what it expects of missing components.
    pub(crate) fn round<B>(&self, family: &B) -> Outcome<B>
    where
        B: LearnLikelihood<Observation = [f64]>,
    {
        self.round_by(family, |at, weights| self.weights(at, weights))
    }

    fn round_by<B>(&self, family: &B, weights: impl Fn(usize, &mut [f64])) -> Outcome<B>
    where
        B: LearnLikelihood<Observation = [f64]>,
    {
        round(family, self.rows.iter().copied().enumerate(), weights)
    }

    /// Writes the weights of an observation in all states.
    fn weights(&self, at: usize, weights: &mut [f64]) {
        weights.copy_from_slice(&self.pooled);
        weights[self.assigned[at]] += 1.0;
    }

    /// Adds the component that never changes to an error that it may explain.
    pub(crate) fn explain(
        &self,
        error: Box<dyn Error + Send + Sync>,
    ) -> Box<dyn Error + Send + Sync> {
        let cause = match error.downcast::<EmissionError>() {
            Ok(cause) => cause,
            Err(error) => return error,
        };
        let constant = |component: usize| {
            let mut known = self.rows.iter().filter_map(|row| row.get(component));
            let value = *known.clone().find(|y| !y.is_nan())?;
            known.all(|y| y.is_nan() || *y == value).then_some((component, value))
        };
        let components = self.rows.first().map_or(0, |row| row.len());
        let found = cause.undetermined(0..components).and_then(|(mut all, component)| {
            component.and_then(constant).or_else(|| all.find_map(constant))
        });
        match found {
            None => cause,
            Some((component, value)) => {
                Box::new(EmissionError::Constant { component, value, cause })
            }
        }
    }
}

/// Estimates a family from rows with their numbers.
fn round<'r, B>(
    family: &B,
    rows: impl Iterator<Item = (usize, &'r [f64])>,
    weights: impl Fn(usize, &mut [f64]),
) -> Outcome<B>
where
    B: LearnLikelihood<Observation = [f64]>,
{
    let mut statistics = family.statistics();
    let mut posterior = vec![0.0; family.states()];
    for (at, row) in rows {
        weights(at, &mut posterior);
        family.add(&mut statistics, row, &posterior);
    }
    family.maximize(&statistics, 0.0)
}
