//! A sensor for `sequences::expectations` that records the smoothed beliefs: the forward-backward
//! pass hands them to the sensor's statistics step by step, and Python's families want them all.

use std::error::Error;
use std::sync::atomic::{AtomicU64, Ordering};

use wayfix::Likelihood;
use wayfix::error::LikelihoodError;
use wayfix::likelihood::{Diagonal, LearnLikelihood, Scratch};

/// Sensor whose observations are rows of log-likelihoods, and whose statistics are the
/// probabilities of all states at each row.
#[derive(Debug)]
pub(crate) struct Recorder<'a> {
    states: usize,
    values: &'a [f64],
    /// Bits of the probabilities, one for each of `values`; each is written once, by the thread
    /// that has its sequence.
    posteriors: &'a [AtomicU64],
}

impl<'a> Recorder<'a> {
    /// Creates the sensor from the values whose rows are its observations, and room for as many
    /// probabilities.
    pub(crate) fn new(states: usize, values: &'a [f64], posteriors: &'a [AtomicU64]) -> Self {
        Self { states, values, posteriors }
    }
}

impl Likelihood for Recorder<'_> {
    type Observation = [f64];

    fn states(&self) -> usize {
        self.states
    }

    fn diagonal<'a>(
        &'a self,
        observation: &'a [f64],
        _: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        Ok(Diagonal::log(observation))
    }

    fn is_precomputed(&self) -> bool {
        // On the way back the smoother then asks for the row again, which saves a product with A.
        true
    }
}

impl LearnLikelihood for Recorder<'_> {
    type Statistics = ();

    fn statistics(&self) {}

    fn add(&self, (): &mut (), observation: &[f64], posterior: &[f64]) {
        // An observation is a slice of `values` itself, never a copy: the sequences are made over
        // them, and `diagonal` returns its argument. So its address tells the row.
        let bytes = observation.as_ptr().addr() - self.values.as_ptr().addr();
        let place = bytes / size_of::<f64>();
        let out = &self.posteriors[place..place + self.states];
        // Relaxed is enough: the caller reads only after the threads have been joined.
        out.iter().zip(posterior).for_each(|(out, p)| out.store(p.to_bits(), Ordering::Relaxed));
    }

    fn merge(&self, (): &mut (), (): &()) {}

    fn maximize(&self, (): &(), _: f64) -> Result<Self, Box<dyn Error + Send + Sync>> {
        Err("the caller re-estimates".into())
    }

    fn free_parameters(&self) -> usize {
        0
    }
}
