//! Learning of independent components: the M step of section 9 of the formulas, one by one for each
//! state and component.

use std::error::Error;

use super::family::Independent;
use super::univariate::{Sums, Univariate};
use crate::check::at;
use wayfix::likelihood::LearnLikelihood;

impl<F: Univariate> LearnLikelihood for Independent<F> {
    /// Sums of component c in state i, at c n + i.
    type Statistics = Vec<F::Statistics>;

    fn statistics(&self) -> Vec<F::Statistics> {
        vec![F::Statistics::default(); self.parts.len()]
    }

    /// Adds one observation. If it is invalid, and so has no
    /// [`diagonal`](wayfix::Likelihood::diagonal), only the components before the first invalid one
    /// are added.
    fn add(&self, statistics: &mut Vec<F::Statistics>, observation: &[f64], posterior: &[f64]) {
        let n = self.states;
        let _ = self.visit(observation, |component, point, parts| {
            let sums = &mut statistics[component * n..];
            for ((sums, part), &weight) in sums.iter_mut().zip(parts).zip(posterior) {
                // Statistics may be infinite in a state that rules the observation out: 0 · ∞ is
                // NaN.
                if weight > 0.0 {
                    sums.add(weight, &part.statistics(&point));
                }
            }
        });
    }

    fn merge(&self, statistics: &mut Vec<F::Statistics>, other: &Vec<F::Statistics>) {
        for (sums, other) in statistics.iter_mut().zip(other) {
            sums.add(1.0, other);
        }
    }

    fn maximize(
        &self,
        statistics: &Vec<F::Statistics>,
        pseudo_count: f64,
    ) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let maximize = |(index, part): (usize, &F)| {
            let mut sums = statistics[index].clone();
            // The prior is exp(c E ln p): its term of Q is that of c observations with the expected
            // statistics.
            if let Some((prior, count)) = &self.prior {
                sums.add(*count, &part.expectations(&prior[index]));
            }
            part.add_pseudo_count(&mut sums, pseudo_count);
            // A state without observations or prior keeps its parameters.
            if sums.weight() < f64::MIN_POSITIVE {
                return Ok(part.clone());
            }
            let (component, state) = (index / self.states, index % self.states);
            part.maximize(&sums).map_err(|error| at(error, state, Some(component)))
        };
        let parts = self.parts.iter().enumerate().map(maximize).collect::<Result<_, _>>()?;
        Ok(Self { parts, prior: self.prior.clone(), ..*self })
    }

    fn log_prior(&self, pseudo_count: f64) -> f64 {
        let from_counts: f64 = self.parts.iter().map(|part| part.log_prior(pseudo_count)).sum();
        let prior = self.prior.iter().flat_map(|(prior, count)| {
            let parts = self.parts.iter().zip(prior);
            parts.map(move |(part, prior)| {
                count * part.expected_log_density(&part.expectations(prior))
            })
        });
        from_counts + prior.sum::<f64>()
    }

    fn free_parameters(&self) -> usize {
        self.parts.iter().map(Univariate::free_parameters).sum()
    }
}
