//! Parts of mixtures from clusters within the clusters of states.

use rand::Rng;

use super::fit::Outcome;
use super::k_means::{distance, k_means, standardize};
use super::observations::{Clusters, share};
use crate::EmissionError;
use wayfix::likelihood::LearnLikelihood;

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
        // Pooling twice: within the state all parts share its observations, whose weights already
        // include those pooled from other states.
        let pooled = self.pooled[state];
        let weight = |at: usize| pooled + f64::from(u8::from(self.assigned[at] == state));
        let total: f64 = (0..self.rows.len()).map(weight).sum();
        self.fit_by(family, |at, weights| {
            weights.fill(0.0);
            counts.iter().for_each(|&(part, count)| {
                weights[part] = share(count, total) * weight(at);
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
