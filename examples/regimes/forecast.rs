//! Forecast of the coming days, by simulated futures.

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use wayfix::Filter;

use super::Model;

/// Number of futures that are simulated.
pub(crate) const FUTURES: usize = 20_000;
/// Fractions of futures below the four values of a day: the ends of their central 90%, and of
/// their central half.
const FRACTIONS: [f64; 4] = [0.05, 0.25, 0.75, 0.95];

/// Quantiles of each day, at [`FRACTIONS`].
pub(crate) struct Forecast {
    /// Return of the day, in percent.
    pub(crate) returns: Vec<[f64; 4]>,
    /// Return of all days up to this one, in percent.
    pub(crate) total: Vec<[f64; 4]>,
}

impl Forecast {
    pub(crate) fn new(filter: &Filter<&Model>, days: usize, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut returns = vec![Vec::with_capacity(FUTURES); days];
        let mut total = returns.clone();
        for _ in 0..FUTURES {
            let mut sum = 0.0;
            for (day, seen) in filter.simulate(days, &mut rng).observations().iter().enumerate() {
                sum += seen[0];
                returns[day].push(seen[0]);
                total[day].push(sum);
            }
        }
        let quantiles = |days: Vec<Vec<f64>>| days.into_iter().map(quantiles).collect();
        Self { returns: quantiles(returns), total: quantiles(total) }
    }
}

fn quantiles(mut values: Vec<f64>) -> [f64; 4] {
    values.sort_by(f64::total_cmp);
    #[expect(clippy::cast_sign_loss, reason = "fractions are positive")]
    FRACTIONS.map(|fraction| values[(fraction * values.len() as f64) as usize])
}
