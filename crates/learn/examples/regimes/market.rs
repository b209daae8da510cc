//! A made-up market with three regimes.

use std::error::Error;

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use wayfix::{Belief, DenseTransition, Hmm, Prior, Sequence};
use wayfix_learn::Gaussian;

/// Days of a year: the return in percent and the logarithm of the volume, with the true regimes.
#[derive(Clone)]
pub(crate) struct Year {
    pub(crate) days: Vec<Vec<f64>>,
    pub(crate) regimes: Vec<usize>,
}

impl Sequence<(), [f64]> for Year {
    fn steps(&self) -> usize {
        self.days.len()
    }

    fn control(&self, _: usize) -> &() {
        &()
    }

    fn observation(&self, step: usize) -> &[f64] {
        &self.days[step - 1]
    }
}

/// Draws years of a market that is calm, nervous or in panic, for 60, 25 and 8 days at a time on
/// average.
pub(crate) fn simulate(years: usize, days: usize, seed: u64) -> Result<Vec<Year>, Box<dyn Error>> {
    // Rows are the next regime, columns the present one. Between calm and panic the market is
    // nervous.
    let moves = [
        [1.0 - 1.0 / 60.0, 0.8 / 25.0, 0.0],
        [1.0 / 60.0, 1.0 - 1.0 / 25.0, 1.0 / 8.0],
        [0.0, 0.2 / 25.0, 1.0 - 1.0 / 8.0],
    ];
    // Return and log volume: volatility, volume and their negative correlation grow with the
    // regime.
    let means = [[0.06, 0.0], [-0.02, 0.25], [-0.4, 0.7]];
    let covariances =
        [[0.36, 0.0, 0.0, 0.04], [1.44, -0.06, -0.06, 0.05], [9.0, -0.36, -0.36, 0.09]];
    let truth = Hmm::new(
        Prior::AtFirstObservation(Belief::new(vec![0.7, 0.25, 0.05])?),
        DenseTransition::from_rows(&moves)?,
        Gaussian::full(&means, &covariances)?,
    )?;
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let year = |_| {
        let drawn = truth.simulate(days, &mut rng);
        Year { days: drawn.observations().to_vec(), regimes: drawn.states().to_vec() }
    };
    Ok((0..years).map(year).collect())
}
