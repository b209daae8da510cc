//! Bernoulli distribution: events that happen or not, ln p(y) = y ln p + (1 − y) ln(1 − p).

use rand::{Rng, RngExt};

use super::Independent;
use super::univariate::{Cumulative, Univariate};
use crate::error::check;
use crate::{EmissionError, Tails};

/// Bernoulli distribution of an event: 1 if it happens, otherwise 0.
///
/// A [family](Self::family) of d events has p(y) = Π_c p_c^{y_c} (1 − p_c)^{1 − y_c}. Learning sets
/// each probability to the weighted share of ones.
///
/// The pseudo-count of the [sensor](wayfix::inference::LearningOptions::likelihood_pseudo_count) is
/// added to the counts of 0 and of 1, as in a [table](wayfix::TableLikelihood): probabilities of 0
/// and 1 stay as they are. The [prior](Independent::with_prior) of c observations with probability
/// q is the beta density of p with parameters c q + 1 and c (1 − q) + 1.
///
/// ```
/// use wayfix_learn::Bernoulli;
/// use wayfix::{Belief, DenseTransition, Hmm, Prior};
///
/// let hmm = Hmm::new(
///     Prior::AtFirstObservation(Belief::uniform(2)?),
///     DenseTransition::from_rows(&[[0.9, 0.1], [0.1, 0.9]])?,
///     // Wipers and lights, on a dry day and in the rain.
///     Bernoulli::family(&[[0.01, 0.2], [0.9, 0.7]])?,
/// )?;
/// assert_eq!(hmm.viterbi(&[[0.0, 0.0], [0.0, 1.0], [1.0, 1.0]])?.states(), [0, 0, 1]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bernoulli {
    probability: f64,
    /// Logarithms of the probabilities of 0 and 1.
    logs: [f64; 2],
}

impl Bernoulli {
    /// Creates the distribution with this probability of 1.
    ///
    /// # Errors
    ///
    /// [`EmissionError::Parameter`] unless it is from 0 to 1.
    pub fn new(probability: f64) -> Result<Self, EmissionError> {
        let valid = (0.0..=1.0).contains(&probability);
        let p = check("probability", probability, valid, "a value from 0 to 1")?;
        Ok(Self { probability: p, logs: [(-p).ln_1p(), p.ln()] })
    }

    /// Creates a family from one row for each state, with the probability that each component
    /// is 1.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] for zero states or components, rows of different lengths, or a probability
    /// outside 0 to 1.
    pub fn family<R: AsRef<[f64]>>(
        probabilities: &[R],
    ) -> Result<Independent<Self>, EmissionError> {
        Independent::of_one("list of probabilities", probabilities, Self::new)
    }

    /// Probability of 1.
    #[must_use]
    pub fn probability(&self) -> f64 {
        self.probability
    }
}

impl Univariate for Bernoulli {
    const VALUES: &'static str = "0 or 1";
    const HAS_ZERO: bool = true;
    type Point = bool;
    /// Numbers of zeros and of ones.
    type Statistics = (f64, [f64; 1]);

    #[expect(
        clippy::needless_bitwise_bool,
        reason = "a branch at random costs more than a comparison"
    )]
    fn point(value: f64) -> Option<bool> {
        ((value == 0.0) | (value == 1.0)).then_some(value == 1.0)
    }

    fn log_density(&self, &happens: &bool) -> f64 {
        self.logs[usize::from(happens)]
    }

    #[inline]
    fn statistics(&self, &happens: &bool) -> (f64, [f64; 1]) {
        let one = f64::from(u8::from(happens));
        (1.0 - one, [one])
    }

    fn expectations(&self, of: &Self) -> (f64, [f64; 1]) {
        (1.0 - of.probability, [of.probability])
    }

    fn expected_log_density(&self, &(zeros, [ones]): &(f64, [f64; 1])) -> f64 {
        // 0 · ln 0 is 0.
        let shares = [zeros, ones].into_iter().zip(self.logs);
        shares.filter(|(share, _)| *share > 0.0).map(|(share, log)| share * log).sum()
    }

    fn add_pseudo_count(&self, (zeros, [ones]): &mut (f64, [f64; 1]), pseudo_count: f64) {
        // An outcome of probability 0 stays impossible.
        for (sum, log) in [zeros, ones].into_iter().zip(self.logs) {
            if log > f64::NEG_INFINITY {
                *sum += pseudo_count;
            }
        }
    }

    fn log_prior(&self, pseudo_count: f64) -> f64 {
        log_prior(&self.logs, pseudo_count)
    }

    fn maximize(&self, &(zeros, [ones]): &(f64, [f64; 1])) -> Result<Self, EmissionError> {
        Self::new(ones / (zeros + ones))
    }

    fn free_parameters(&self) -> usize {
        usize::from(0.0 < self.probability && self.probability < 1.0)
    }

    fn draw<R: Rng + ?Sized>(&self, rng: &mut R) -> f64 {
        f64::from(u8::from(rng.random::<f64>() < self.probability))
    }
}

/// Log density of the prior that a pseudo-count of two outcomes stands for, up to its constant.
pub(super) fn log_prior(logs: &[f64; 2], pseudo_count: f64) -> f64 {
    if pseudo_count == 0.0 {
        return 0.0;
    }
    pseudo_count * logs.iter().filter(|log| **log > f64::NEG_INFINITY).sum::<f64>()
}

impl Cumulative for Bernoulli {
    fn tails(&self, y: f64) -> Tails {
        let [zero, one] = [1.0 - self.probability, self.probability];
        match y {
            _ if y < 0.0 => Tails { below: 0.0, at: 0.0, above: 1.0 },
            0.0 => Tails { below: 0.0, at: zero, above: one },
            _ if y < 1.0 => Tails { below: zero, at: 0.0, above: one },
            1.0 => Tails { below: zero, at: one, above: 0.0 },
            _ => Tails { below: 1.0, at: 0.0, above: 0.0 },
        }
    }
}

#[cfg(feature = "serde")]
wayfix::stored! {
    [] Bernoulli for Independent<self::Bernoulli>: [], |family| {
        probabilities: Vec<Vec<f64>> = family.parameters(self::Bernoulli::probability),
        missing: bool = family.takes_missing(),
        prior: Option<(Independent<self::Bernoulli>, f64)> = family.prior(),
    } => self::Bernoulli::family(&probabilities).and_then(|new| crate::independent::with_settings(new, missing, prior));
}
