//! Families from clusters of observations.

mod parts;

use std::borrow::Cow;
use std::error::Error;
use std::ops::Range;

use rand::Rng;

use super::{
    EmissionError, Gaussian, Independent, LinearRegression, Multinomial, Univariate, VonMisesFisher,
};
use crate::fixed::Fixed;
use crate::likelihood::{GroupedLikelihood, LearnLikelihood, Likelihood, Scratch};

/// Weight of all observations in the start of a state, as a part of that of its cluster, so that
/// a cluster of two observations has a covariance.
const POOLED: f64 = 0.1;

/// Rounds in which what is missing has its expectation, after one with the values of others.
pub(super) const ROUNDS: usize = 3;

/// Result of estimating a family.
pub(super) type Outcome<B> = Result<B, Box<dyn Error + Send + Sync>>;

/// A family that takes its parameters from clusters of observations, to begin learning there.
///
/// [`starts`](super::starts) asks for it. All families of this module have it; one of your own
/// needs a single line, if the way that its parameters are estimated from complete observations does
/// not depend on those that it has: `impl StartFromClusters for MyFamily {}`.
pub trait StartFromClusters: LearnLikelihood<Observation = [f64]> {
    /// Returns the family with parameters from the clusters, one for each state. By default they
    /// are [fitted](ClusteredObservations::fit) as in learning.
    ///
    /// # Errors
    ///
    /// Any error, if the clusters do not determine the parameters.
    fn start<R: Rng + ?Sized>(
        &self,
        observations: &ClusteredObservations<'_>,
        rng: &mut R,
    ) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let _ = rng;
        observations.fit(self)
    }
}

impl StartFromClusters for Gaussian {}
impl StartFromClusters for LinearRegression {}
impl<F: Univariate> StartFromClusters for Independent<F> {}
impl StartFromClusters for Multinomial {}
impl StartFromClusters for VonMisesFisher {}
impl<B: LearnLikelihood<Observation = [f64]>> StartFromClusters for GroupedLikelihood<B> {}
impl<B: Likelihood<Observation = [f64]> + Clone> StartFromClusters for Fixed<B> {}

/// Observations, each in the cluster of a state, from which a family takes its parameters.
///
/// Observations without any known component are left out.
#[derive(Debug, Clone)]
pub struct ClusteredObservations<'a> {
    rows: Vec<&'a [f64]>,
    clusters: Vec<usize>,
    /// Rows with values of others in place of missing ones; none if nothing is missing.
    completed: Vec<Cow<'a, [f64]>>,
    /// Weight of each observation in a state, in addition to that of one of its cluster.
    pooled: Vec<f64>,
}

impl<'a> ClusteredObservations<'a> {
    /// Takes observations of one length, with their clusters. Each component is known somewhere.
    pub(super) fn new(
        states: usize,
        observations: impl Iterator<Item = (&'a [f64], usize)>,
    ) -> Self {
        let known = observations.filter(|(row, _)| row.iter().any(|y| !y.is_nan()));
        let (rows, clusters): (Vec<&[f64]>, Vec<usize>) = known.unzip();
        let completed = if rows.iter().copied().flatten().any(|y| y.is_nan()) {
            completed(&rows, &clusters, states)
        } else {
            Vec::new()
        };
        let mut counts = vec![0; states];
        clusters.iter().for_each(|&cluster| counts[cluster] += 1);
        let total = rows.len() as f64;
        let pooled = counts.into_iter().map(|count| share(count, total)).collect();
        Self { rows, clusters, completed, pooled }
    }

    /// Observations, each with the state of its cluster.
    #[must_use]
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (&'a [f64], usize)> {
        self.rows.iter().copied().zip(self.clusters.iter().copied())
    }

    /// The same observations with the components of one of several families in a row.
    pub(super) fn columns(&self, components: Range<usize>) -> Self {
        let rows = self.iter().map(|(row, cluster)| (&row[components.clone()], cluster));
        Self::new(self.pooled.len(), rows)
    }

    /// Estimates a family from the observations of each state's cluster, with a tenth of the
    /// weight from all observations.
    ///
    /// Missing components have at first the values of other observations of the cluster; the
    /// family from these then expects them, three times, as in learning. So the parameters do not
    /// depend on those of `family`, if complete observations are added alike whatever they are.
    ///
    /// # Errors
    ///
    /// The error of [`LearnLikelihood::maximize`].
    pub fn fit<B>(&self, family: &B) -> Result<B, Box<dyn Error + Send + Sync>>
    where
        B: LearnLikelihood<Observation = [f64]>,
    {
        self.estimate_by(family, |at, weights| self.weights(at, weights))
    }

    /// Estimates a family in which each observation has weights that a function writes.
    pub(super) fn estimate_by<B>(
        &self,
        family: &B,
        weights: impl Fn(usize, &mut [f64]),
    ) -> Outcome<B>
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
    pub(super) fn round<B>(&self, family: &B) -> Outcome<B>
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
        weights[self.clusters[at]] += 1.0;
    }

    /// Adds the component that never changes to an error that it may explain.
    pub(super) fn explain(
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

/// Weight of each of all observations, whose weights have this sum, beside those of a cluster. One
/// without observations has the parameters of all.
fn share(count: usize, total: f64) -> f64 {
    if count == 0 { 1.0 / total } else { POOLED * count as f64 / total }
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

/// Rows in which missing components have the values of others of the cluster, one after the other,
/// or of all where the cluster has none. So they are values that the family takes, and vary as the
/// known ones.
fn completed<'a>(rows: &[&'a [f64]], clusters: &[usize], states: usize) -> Vec<Cow<'a, [f64]>> {
    let components = rows.first().map_or(0, |row| row.len());
    let mut known = vec![Vec::new(); (states + 1) * components];
    for (row, &cluster) in rows.iter().zip(clusters) {
        for (component, &y) in row.iter().enumerate().filter(|y| !y.1.is_nan()) {
            known[cluster * components + component].push(y);
            known[states * components + component].push(y);
        }
    }
    let mut used = vec![0; known.len()];
    let complete = |(&row, &cluster): (&&'a [f64], &usize)| {
        if row.iter().all(|y| !y.is_nan()) {
            return Cow::Borrowed(row);
        }
        let mut row = row.to_vec();
        for (component, y) in row.iter_mut().enumerate().filter(|y| y.1.is_nan()) {
            let own = cluster * components + component;
            let at = if known[own].is_empty() { states * components + component } else { own };
            *y = known[at][used[at] % known[at].len()];
            used[at] += 1;
        }
        Cow::Owned(row)
    };
    rows.iter().zip(clusters).map(complete).collect()
}
