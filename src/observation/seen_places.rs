//! Confusion as a sensor: a sparse table, whose entries are learned.

use std::error::Error;

use rand::Rng;

use super::Confusion;
use crate::likelihood::{
    LearnLikelihood, SampleObservation, SparseObservation, SparseTableLikelihood, sensor_within,
};
use crate::random::index;

sensor_within! {
    [] Confusion => SparseTableLikelihood, confusion => confusion.by_seen;
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
            // `from_entries` refuses a NaN.
            let sum = sums[place];
            (place, seen, if sum < f64::MIN_POSITIVE { p } else { count / sum })
        });
        Ok(Self::from_entries(self.places(), learned)?)
    }

    fn log_prior(&self, pseudo_count: f64) -> f64 {
        if pseudo_count == 0.0 {
            return 0.0;
        }
        let entries = self.symbols().flat_map(|(_, places)| places);
        pseudo_count * entries.map(|entry| entry.1.ln()).sum::<f64>()
    }

    fn free_parameters(&self) -> usize {
        self.entries() - self.places()
    }
}
