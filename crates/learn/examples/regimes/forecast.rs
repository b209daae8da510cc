//! Forecast of the coming days: the distribution of each day's return, and, by simulation, that of
//! the total return up to each day.

use std::error::Error;
use wayfix_learn::Predictive;

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use wayfix::Filter;

use super::Model;

/// Number of simulated futures.
const FUTURES: usize = 20_000;
/// Probabilities of the four quantiles of a day: the ends of the central 90% and of the central
/// half.
const FRACTIONS: [f64; 4] = [0.05, 0.25, 0.75, 0.95];

/// Quantiles of each day, at [`FRACTIONS`].
pub(crate) struct Forecast {
    /// Return of the day, in percent.
    pub(crate) returns: Vec<[f64; 4]>,
    /// Total return up to and including the day, in percent.
    pub(crate) total: Vec<[f64; 4]>,
}

impl Forecast {
    pub(crate) fn new(
        filter: &Filter<&Model>,
        days: usize,
        seed: u64,
    ) -> Result<Self, Box<dyn Error>> {
        // A single day's return is a mixture of normal ones, whose quantiles are exact.
        let mut returns = Vec::with_capacity(days);
        for day in 1..=days {
            let next = Predictive::ahead(filter, day, 0)?;
            let mut at = [0.0; 4];
            for (value, fraction) in at.iter_mut().zip(FRACTIONS) {
                *value = next.quantile(fraction)?;
            }
            returns.push(at);
        }
        // Sums of returns depend on the path of regimes, whose mixture has exponentially many
        // parts: simulated instead.
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut total = vec![Vec::with_capacity(FUTURES); days];
        for _ in 0..FUTURES {
            let mut sum = 0.0;
            for (day, seen) in filter.simulate(days, &mut rng).observations().iter().enumerate() {
                sum += seen[0];
                total[day].push(sum);
            }
        }
        Ok(Self { returns, total: total.into_iter().map(quantiles).collect() })
    }
}

/// Empirical quantiles at [`FRACTIONS`].
fn quantiles(mut values: Vec<f64>) -> [f64; 4] {
    values.sort_by(f64::total_cmp);
    #[expect(clippy::cast_sign_loss, reason = "fractions are positive")]
    FRACTIONS.map(|fraction| values[(fraction * values.len() as f64) as usize])
}
