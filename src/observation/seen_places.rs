//! Confusion as a sensor: a sparse table with entries that can be learned.

use std::error::Error;

use rand::Rng;

use super::Confusion;
use crate::error::LikelihoodError;
use crate::free_parameters::{Displacement, FreeParameters};
use crate::likelihood::{
    Diagonal, LearnLikelihood, Likelihood, LocalLikelihood, SampleObservation, Scratch,
    SparseObservation,
};
use crate::random::index;

// `is_precomputed` stays false although the table inside answers true: the smoother would take
// another way back, and posteriors would differ in their last bits.
impl Likelihood for Confusion {
    type Observation = usize;

    fn states(&self) -> usize {
        self.places()
    }

    /// # Errors
    ///
    /// [`LikelihoodError::Symbol`] if the place does not exist.
    fn diagonal<'a>(
        &'a self,
        seen: &'a usize,
        scratch: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        self.by_seen.diagonal(seen, scratch)
    }
}

/// O(states asked for + places that may be seen as this one).
impl LocalLikelihood for Confusion {
    /// # Errors
    ///
    /// [`LikelihoodError::Symbol`] if the place does not exist.
    fn local<'a>(
        &'a self,
        seen: &'a usize,
        states: &[usize],
        scratch: &'a mut Scratch,
    ) -> Result<(Diagonal<'a>, f64), LikelihoodError> {
        self.by_seen.local(seen, states, scratch)
    }

    fn listed_states(&self, seen: &usize, states: &mut Vec<usize>) {
        self.by_seen.listed_states(seen, states);
    }
}

impl SampleObservation for Confusion {
    type Sample = usize;

    fn sample<R: Rng + ?Sized>(&self, state: usize, rng: &mut R) -> usize {
        index(self.line(state), 1.0, rng)
    }
}

/// Learns all entries above 0; entries of 0 stay 0.
impl LearnLikelihood for Confusion {
    /// Expected count of each entry, by the place that is seen.
    type Statistics = Vec<Vec<f64>>;

    fn statistics(&self) -> Vec<Vec<f64>> {
        self.symbols().map(|(_, places)| vec![0.0; places.len()]).collect()
    }

    fn add(&self, statistics: &mut Vec<Vec<f64>>, &seen: &usize, posterior: &[f64]) {
        // S(i, y) of section 9 of the guide: γ of each place that may be seen as this one.
        let places = self.by_seen.symbol(seen).into_iter().flat_map(SparseObservation::listed);
        let sums = statistics[seen].iter_mut();
        sums.zip(places).for_each(|(sum, &(place, _))| *sum += posterior[place]);
    }

    fn merge(&self, statistics: &mut Vec<Vec<f64>>, other: &Vec<Vec<f64>>) {
        let sums = statistics.iter_mut().flatten().zip(other.iter().flatten());
        sums.for_each(|(sum, other)| *sum += other);
    }

    fn maximize(
        &self,
        statistics: &Vec<Vec<f64>>,
        pseudo_count: f64,
    ) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let entries = self
            .symbols()
            .flat_map(|(seen, places)| places.iter().map(move |&(place, p)| (place, seen, p)));
        let counted = entries.zip(statistics.iter().flatten().map(|count| count + pseudo_count));
        let mut sums = vec![0.0; self.places()];
        counted.clone().for_each(|((place, ..), count)| sums[place] += count);
        let learned = counted.map(|((place, seen, p), count)| {
            // A place that no posterior visited keeps its row; `from_entries` refuses a NaN.
            let sum = sums[place];
            (place, seen, if sum < f64::MIN_POSITIVE { p } else { count / sum })
        });
        Ok(Self::from_entries(self.places(), learned)?)
    }

    fn log_prior(&self, pseudo_count: f64) -> f64 {
        if pseudo_count == 0.0 {
            return 0.0;
        }
        // c Σ ln b over the entries above 0 (guide, section 9, Pseudo-counts).
        let entries = self.symbols().flat_map(|(_, places)| places);
        pseudo_count * entries.map(|entry| entry.1.ln()).sum::<f64>()
    }

    // Each row sums to one, which fixes one of its entries.
    fn free_parameters(&self) -> usize {
        self.entries() - self.places()
    }
}

/// Log-odds of the entries above 0, place by place, relative to the largest of the place.
impl FreeParameters for Confusion {
    fn displaced(&self, by: &mut Displacement<'_>) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let mut entries = Vec::with_capacity(self.entries());
        for place in 0..self.places() {
            let (seen, mut shares): (Vec<usize>, Vec<f64>) = self.line(place).unzip();
            by.distribution(&mut shares);
            entries.extend(seen.into_iter().zip(shares).map(|(seen, p)| (place, seen, p)));
        }
        Ok(Self::from_entries(self.places(), entries)?)
    }
}
