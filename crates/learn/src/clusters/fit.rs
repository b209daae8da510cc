//! Families from clusters of observations: an M step where each cluster stands for the posterior
//! of its state, smoothed by a tenth of the weight from all observations.

use std::error::Error;

use rand::Rng;
use wayfix::likelihood::{GroupedLikelihood, LearnLikelihood};
use wayfix::{Fixed, HmmError, Likelihood, Scratch};

use super::k_means::{distance, k_means, standardize};
use super::{Clusters, pooled_weight_of};
use crate::EmissionError;

/// Rounds with expected values in place of missing ones, after a round with values of other rows.
pub(crate) const ROUNDS: usize = 3;

/// Result of estimating a family.
pub(crate) type Outcome<B> = Result<B, Box<dyn Error + Send + Sync>>;

/// A family that can take its parameters from clusters of observations, to begin learning there.
///
/// [`starts`](crate::starts) requires it. All families of this crate implement it. One
/// of your own needs a single line, `impl StartFromClusters for MyFamily {}`, if its estimates from
/// complete observations do not depend on its present parameters.
pub trait StartFromClusters: LearnLikelihood<Observation = [f64]> + Clone + Send + Sync {
    /// Returns the family with parameters from the clusters, one for each state.
    /// By default they are [fitted](Clusters::fit) as in learning.
    ///
    /// # Errors
    ///
    /// Any error if the clusters do not determine the parameters.
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
    /// Missing components first have the values of other observations in the cluster. The family
    /// fitted to these then supplies their expectations, in three rounds as in learning. So the
    /// result does not depend on the parameters of `family`, provided that its statistics of
    /// complete observations do not.
    ///
    /// # Errors
    ///
    /// The error of [`LearnLikelihood::maximize`]; [`HmmError::StateCount`] unless there is a
    /// cluster for each state, and the family's error if it does not take the first observation.
    pub fn fit<B>(&self, family: &B) -> Result<B, Box<dyn Error + Send + Sync>>
    where
        B: LearnLikelihood<Observation = [f64]>,
    {
        self.check(family)?;
        self.fit_by(family, |at, weights| self.weights(at, weights))
    }

    /// Checks that a family has a state for each cluster, and accepts the first observation.
    pub(crate) fn check<B>(&self, family: &B) -> Outcome<()>
    where
        B: Likelihood<Observation = [f64]>,
    {
        let (found, expected) = (family.states(), self.pooled_weight.len());
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

    /// Estimates a family from all observations, with weights that a function writes for each.
    pub(super) fn fit_by<B>(&self, family: &B, weights: impl Fn(usize, &mut [f64])) -> Outcome<B>
    where
        B: LearnLikelihood<Observation = [f64]>,
    {
        if self.completed.is_empty() {
            return self.round_by(family, weights);
        }
        // A value filled in from another row may be invalid together with the rest of its new row,
        // such as a direction that no longer has length one.
        let mut scratch = Scratch::default();
        let rows = self.completed.iter().map(|row| &**row).enumerate();
        let valid = rows.filter(|(_, row)| family.diagonal(row, &mut scratch).is_ok());
        let first = m_step(family, valid, &weights)?;
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
        m_step(family, self.rows.iter().copied().enumerate(), weights)
    }

    /// Writes the weights of an observation in all states: the pooled one, and 1 more in its own.
    fn weights(&self, at: usize, weights: &mut [f64]) {
        weights.copy_from_slice(&self.pooled_weight);
        weights[self.assigned[at]] += 1.0;
    }

    /// Names a component that never changes, if that may be the cause of an error.
    pub(crate) fn explain(
        &self,
        error: Box<dyn Error + Send + Sync>,
    ) -> Box<dyn Error + Send + Sync> {
        let cause = match error.downcast::<EmissionError>() {
            Ok(cause) => cause,
            Err(error) => return error,
        };
        // The component with its value, if all known values of the component are the same.
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

/// Estimates a family from rows and their indices by one M step, without pseudo-counts.
fn m_step<'r, B>(
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

// Parts of mixtures from clusters within the clusters of states.

/// Division of a state's observations into parts.
pub(crate) struct Division {
    /// Part of each observation, or `None` if it does not take part.
    parts: Vec<Option<usize>>,
    /// Each part with the number of its observations.
    pub(crate) counts: Vec<(usize, usize)>,
}

impl Clusters<'_> {
    /// Estimates a family whose states are the parts of a state, from the observations that the
    /// division assigns to each, with a tenth of the weight from all observations of the state.
    pub(crate) fn fit_parts<B>(
        &self,
        family: &B,
        state: usize,
        Division { parts, counts }: &Division,
    ) -> Outcome<B>
    where
        B: LearnLikelihood<Observation = [f64]>,
    {
        // Weights are pooled twice: within the state all parts share its observations, whose
        // weights already include those pooled from other states.
        let pooled = self.pooled_weight[state];
        let weight = |at: usize| pooled + f64::from(u8::from(self.assigned[at] == state));
        let total: f64 = (0..self.rows.len()).map(weight).sum();
        self.fit_by(family, |at, weights| {
            weights.fill(0.0);
            counts.iter().for_each(|&(part, count)| {
                weights[part] = pooled_weight_of(count, total) * weight(at);
            });
            parts[at].iter().for_each(|&part| weights[part] += 1.0);
        })
    }

    /// Divides the observations of a state among these parts. If too few of them are distinct, the
    /// nearest observations of other states are added.
    pub(crate) fn divide<R: Rng + ?Sized>(
        &self,
        state: usize,
        parts: &[usize],
        rng: &mut R,
    ) -> Result<Division, EmissionError> {
        let is_own = |at: &usize| self.assigned[*at] == state;
        let mut members: Vec<usize> = (0..self.rows.len()).filter(is_own).collect();
        let (own, mut further) = (members.len(), 0);
        loop {
            let rows: Vec<&[f64]> = members.iter().map(|&at| self.rows[at]).collect();
            let found = if rows.is_empty() { Err(0) } else { k_means(&rows, parts.len(), rng) };
            match found {
                Ok(nearest) => {
                    let mut counts: Vec<_> = parts.iter().map(|&part| (part, 0)).collect();
                    let mut own = vec![None; self.rows.len()];
                    for (at, cluster) in members.into_iter().zip(nearest) {
                        own[at] = Some(parts[cluster]);
                        counts[cluster].1 += 1;
                    }
                    return Ok(Division { parts: own, counts });
                }
                Err(found) if further >= self.rows.len() => {
                    let (expected, what) = (parts.len(), "parts of a state");
                    return Err(EmissionError::TooFewDifferent { found, expected, what });
                }
                // The number of further observations doubles until there are enough, or none is
                // left.
                Err(_) => {
                    members.truncate(own);
                    further = if further == 0 { parts.len() } else { 2 * further };
                    members.extend(self.nearest(&members).into_iter().take(further));
                }
            }
        }
    }

    /// Observations that are not members, in ascending order of their distance from the members'
    /// mean.
    fn nearest(&self, members: &[usize]) -> Vec<usize> {
        let components = self.rows.first().map_or(1, |row| row.len());
        let mut scaled = self.rows.concat();
        standardize(&mut scaled, components);
        let row = |at: usize| &scaled[at * components..][..components];
        let mean = |component: usize| {
            let known = members.iter().map(|&at| row(at)[component]).filter(|y| !y.is_nan());
            let (sum, count) = known.fold((0.0, 0.0), |(sum, count), y| (sum + y, count + 1.0));
            // 0 is the mean of all observations.
            if count > 0.0 { sum / count } else { 0.0 }
        };
        let centre: Vec<f64> = (0..components).map(mean).collect();
        let mut is_member = vec![false; self.rows.len()];
        members.iter().for_each(|&at| is_member[at] = true);
        let others = (0..self.rows.len()).filter(|&at| !is_member[at]);
        let mut order: Vec<(f64, usize)> =
            others.map(|at| (distance(&centre, row(at)), at)).collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        order.into_iter().map(|(_, at)| at).collect()
    }
}
