//! Binomial distribution: numbers of successes in n trials.
//!
//! For many trials the log probability is that of two Poisson counts given their sum, whose terms
//! measure distances from expected counts and do not cancel (Loader 2000).

use rand::Rng;
use rand_distr::Distribution;

use super::Independent;
use super::bernoulli::log_prior;
use super::poisson::tails;
use super::poisson::{MOST, is_count, log_probability};
use super::univariate::{Cumulative, Univariate};
use crate::error::{check, check_length, shape};
use crate::special::{Odds, ln_factorial};
use crate::{EmissionError, Tails};

/// Number of trials below which log probabilities are plain sums; above, these would lose digits.
const PLAIN: f64 = 64.0;

/// Binomial distribution of the number of successes in a known number of trials.
///
/// With n_c trials and probabilities p_c, a [family](Self::family) of d counts has
/// p(y) = Π_c (n_c over y_c) p_c^{y_c} (1 − p_c)^{n_c − y_c}; counts above n_c are impossible.
/// Learning sets each probability to the weighted share of successes. Where the number of trials
/// changes from row to row, use [`Multinomial`](crate::Multinomial) with successes and
/// failures.
///
/// The pseudo-count of the [sensor](wayfix::inference::LearningOptions::likelihood_pseudo_count) is
/// added to the numbers of successes and of failures: probabilities of 0 and 1 stay as they are.
/// The [prior](Independent::with_prior) of c observations with probability q is the beta density of
/// p with parameters c n q + 1 and c n (1 − q) + 1.
///
/// ```
/// use wayfix_learn::Binomial;
/// use wayfix::{Belief, DenseTransition, Hmm, Prior};
///
/// let hmm = Hmm::new(
///     Prior::AtFirstObservation(Belief::uniform(2)?),
///     DenseTransition::from_rows(&[[0.9, 0.1], [0.1, 0.9]])?,
///     // Seats taken in a minibus of twenty, by night and in the rush hour.
///     Binomial::family(&[20], &[[0.1], [0.8]])?,
/// )?;
/// assert_eq!(hmm.viterbi(&[[1.0], [3.0], [14.0], [19.0]])?.states(), [0, 0, 1, 1]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Binomial {
    trials: f64,
    probability: f64,
    /// Logarithms of the probabilities of success and failure in a trial.
    logs: [f64; 2],
    ln_trials: f64,
    /// ln(n!), and ln(n!) − n (ln n − 1).
    factorial: (f64, f64),
}

impl Binomial {
    /// Creates the distribution with this number of trials and this probability of success.
    ///
    /// # Errors
    ///
    /// [`EmissionError::Parameter`] unless there is a trial, and the probability is from 0 to 1.
    pub fn new(trials: u32, probability: f64) -> Result<Self, EmissionError> {
        Self::of(trials.into(), probability)
    }

    fn of(trials: f64, probability: f64) -> Result<Self, EmissionError> {
        let valid = trials >= 1.0 && trials <= u32::MAX.into() && is_count(trials);
        let trials = check("number of trials", trials, valid, "a whole number from 1 to 2^32 - 1")?;
        let valid = (0.0..=1.0).contains(&probability);
        let p = check("probability", probability, valid, "a value from 0 to 1")?;
        let (logs, factorial) = ([p.ln(), (-p).ln_1p()], ln_factorial(trials));
        Ok(Self { trials, probability: p, logs, ln_trials: trials.ln(), factorial })
    }

    /// Creates a family from the number of trials of each component, and one row for each state
    /// with the probability of success of each component.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] for zero states, components or trials, lists of different lengths, or a
    /// probability outside 0 to 1.
    pub fn family<R: AsRef<[f64]>>(
        trials: &[u32],
        probabilities: &[R],
    ) -> Result<Independent<Self>, EmissionError> {
        let shape = shape("list of probabilities", probabilities)?;
        check_length("list of numbers of trials", None, trials.len(), shape.1)?;
        Independent::build(shape, |state, c| Self::new(trials[c], probabilities[state].as_ref()[c]))
    }

    /// Creates a family from one row of numbers of trials and one of probabilities for each state.
    #[cfg(feature = "serde")]
    pub(crate) fn from_rows(
        trials: &[Vec<f64>],
        probabilities: &[Vec<f64>],
    ) -> Result<Independent<Self>, EmissionError> {
        let lists = ["list of probabilities", "list of numbers of trials"];
        Independent::of_two(lists, probabilities, trials, |p, n| Self::of(n, p))
    }

    /// Number of trials, n.
    #[must_use]
    #[expect(clippy::cast_sign_loss, reason = "it was a number of this type")]
    pub fn trials(&self) -> u32 {
        self.trials as u32
    }

    /// Probability of success in a trial, p.
    #[must_use]
    pub fn probability(&self) -> f64 {
        self.probability
    }
}

/// A number of events times the logarithm of their probability, with 0 · ln 0 = 0.
fn times(number: f64, log: f64) -> f64 {
    if number == 0.0 { 0.0 } else { number * log }
}

impl Univariate for Binomial {
    const VALUES: &'static str = "a whole number from 0 to 2^53";
    const HAS_ZERO: bool = true;
    /// The count y, with ln(y!) and ln(y!) − y (ln y − 1).
    type Point = (f64, (f64, f64));
    /// Numbers of observations, of successes and of failures.
    type Statistics = [f64; 3];

    fn point(value: f64) -> Option<Self::Point> {
        is_count(value).then(|| (value, ln_factorial(value)))
    }

    fn log_density(&self, &(y, factorial): &Self::Point) -> f64 {
        let (n, [ln_p, ln_q]) = (self.trials, self.logs);
        if y > n {
            return f64::NEG_INFINITY;
        }
        let others = n - y;
        if y == 0.0 || others == 0.0 {
            return times(y, ln_p) + times(others, ln_q);
        }
        let rest = ln_factorial(others);
        if n < PLAIN {
            return self.factorial.0 - factorial.0 - rest.0 + y * ln_p + others * ln_q;
        }
        // Pois(y; np) Pois(n − y; nq) / Pois(n; n), where −ln Pois(n; n) = ln n! − n (ln n − 1).
        let (p, q) = (self.probability, 1.0 - self.probability);
        log_probability((y, factorial), (n * p, self.ln_trials + ln_p))
            + log_probability((others, rest), (n * q, self.ln_trials + ln_q))
            + self.factorial.1
    }

    #[inline]
    fn statistics(&self, &(y, _): &Self::Point) -> [f64; 3] {
        [1.0, y, self.trials - y]
    }

    fn expectations(&self, of: &Self) -> [f64; 3] {
        [1.0, of.trials * of.probability, of.trials * (1.0 - of.probability)]
    }

    fn expected_log_density(&self, &[_, successes, failures]: &[f64; 3]) -> f64 {
        times(successes, self.logs[0]) + times(failures, self.logs[1])
    }

    fn add_pseudo_count(&self, sums: &mut [f64; 3], pseudo_count: f64) {
        for (outcome, log) in self.logs.iter().enumerate() {
            if *log > f64::NEG_INFINITY {
                sums[0] += pseudo_count;
                sums[1 + outcome] += pseudo_count;
            }
        }
    }

    fn log_prior(&self, pseudo_count: f64) -> f64 {
        log_prior(&self.logs, pseudo_count)
    }

    fn maximize(&self, &[_, successes, failures]: &[f64; 3]) -> Result<Self, EmissionError> {
        Self::of(self.trials, successes / (successes + failures))
    }

    fn free_parameters(&self) -> usize {
        usize::from(0.0 < self.probability && self.probability < 1.0)
    }

    fn draw<R: Rng + ?Sized>(&self, rng: &mut R) -> f64 {
        // rand_distr accepts the same probabilities, so the default is never used.
        let draw = rand_distr::Binomial::new(self.trials().into(), self.probability);
        draw.map_or(0.0, |counts| counts.sample(rng) as f64).min(MOST)
    }
}

impl Cumulative for Binomial {
    /// O(1): an incomplete beta function on either side, in some hundred evaluations each.
    fn tails(&self, y: f64) -> Tails {
        let (n, p) = (self.trials, self.probability);
        // P(Y ≤ y) = P(X ≤ 1 − p) for X ~ Beta(n − y, y + 1), whose mode has odds
        // (n − y) / (y + 1).
        tails(y, self, |y| {
            let failures = n - y;
            if failures <= 0.0 {
                return [1.0, 0.0];
            }
            let odds = (1.0 - p) / p * ((y + 1.0) / failures);
            Odds::beta(failures, y + 1.0).tail_probabilities(odds.ln())
        })
    }
}

#[cfg(feature = "serde")]
wayfix::stored! {
    [] Binomial for Independent<self::Binomial>: [], |family| {
        trials: Vec<Vec<f64>> = family.parameters(|part| part.trials().into()),
        probabilities: Vec<Vec<f64>> = family.parameters(self::Binomial::probability),
        missing: bool = family.takes_missing(),
        prior: Option<(Independent<self::Binomial>, f64)> = family.prior(),
    } => self::Binomial::from_rows(&trials, &probabilities).and_then(|new| crate::independent::with_settings(new, missing, prior));
}
