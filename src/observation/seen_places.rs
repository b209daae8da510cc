//! Confusion as a sensor of its own.

use std::error::Error;

use rand::Rng;

use super::Confusion;
use crate::error::LikelihoodError;

use crate::likelihood::{
    Diagonal, LearnLikelihood, Likelihood, LocalLikelihood, SampleObservation, Scratch, Unlisted,
};
use crate::random::index;

impl Confusion {
    /// Places that may be seen as this one, with their probabilities.
    fn seen_as(
        &self,
        symbol: usize,
    ) -> Result<impl Iterator<Item = (usize, f64)> + Clone, LikelihoodError> {
        let symbols = self.places();
        if symbol >= symbols {
            return Err(LikelihoodError::Symbol { symbol, symbols });
        }
        Ok(self.by_seen.line(symbol))
    }
}

/// A sensor whose observation is the index of the place that is seen.
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
        &seen: &'a usize,
        scratch: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        let entries = self.seen_as(seen)?;
        let values = scratch.values(self.places());
        values.fill(0.0);
        entries.for_each(|(place, p)| values[place] = p);
        Ok(Diagonal::checked(values, self.largest[seen], None))
    }
}

/// Costs O(states asked + places that may be seen as this one).
impl LocalLikelihood for Confusion {
    /// # Errors
    ///
    /// [`LikelihoodError::Symbol`] if the place does not exist.
    fn local(
        &self,
        &seen: &usize,
        states: &[usize],
        out: &mut [f64],
        _: &mut Scratch,
    ) -> Result<Unlisted, LikelihoodError> {
        let mut entries = self.seen_as(seen)?.peekable();
        let mut others: f64 = 0.0;
        for (&state, out) in states.iter().zip(out) {
            while let Some((_, passed)) = entries.next_if(|entry| entry.0 < state) {
                others = others.max(passed);
            }
            *out = entries.next_if(|entry| entry.0 == state).map_or(0.0, |entry| entry.1);
        }
        Ok(Unlisted::at_most(entries.fold(others, |others, entry| others.max(entry.1))))
    }

    fn listed_states(&self, &seen: &usize, states: &mut Vec<usize>) {
        states.extend(self.seen_as(seen).into_iter().flatten().map(|entry| entry.0));
    }
}

impl SampleObservation for Confusion {
    type Sample = usize;

    fn sample<R: Rng + ?Sized>(&self, state: usize, rng: &mut R) -> usize {
        index(self.by_place.line(state), 1.0, rng)
    }
}

/// Learns all entries above 0; entries of 0 stay 0.
impl LearnLikelihood for Confusion {
    /// Expected count of each entry.
    type Statistics = Vec<f64>;

    fn statistics(&self) -> Vec<f64> {
        vec![0.0; self.entries()]
    }

    fn add(&self, statistics: &mut Vec<f64>, &seen: &usize, posterior: &[f64]) {
        let sums = &mut statistics[self.by_seen.starts()[seen] as usize..];
        let places = self.by_seen.indices(seen);
        sums.iter_mut().zip(places).for_each(|(sum, &place)| *sum += posterior[place as usize]);
    }

    fn merge(&self, statistics: &mut Vec<f64>, other: &Vec<f64>) {
        statistics.iter_mut().zip(other).for_each(|(sum, other)| *sum += other);
    }

    fn maximize(
        &self,
        statistics: &Vec<f64>,
        pseudo_count: f64,
    ) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let lines = (0..self.places())
            .flat_map(|seen| self.by_seen.line(seen).map(move |(place, p)| (place, seen, p)));
        let counted = lines.zip(statistics.iter().map(|count| count + pseudo_count));
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
        let entries = (0..self.places()).flat_map(|seen| self.by_seen.line(seen));
        pseudo_count * entries.map(|entry| entry.1.ln()).sum::<f64>()
    }

    fn free_parameters(&self) -> usize {
        self.entries() - self.places()
    }
}
