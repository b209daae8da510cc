//! Counts of several kinds in a number of trials: b_i(y) (section 1 of the formulas) and M step
//! (section 9).
//!
//! With few trials ln p(y) = ln N! − Σ ln y_c! + Σ y_c ln p_c is summed as it stands. With many, it
//! is the probability of independent Poisson counts of means N p_c given that their sum is N, whose
//! terms are distances from expected counts and do not cancel.

use std::error::Error;

use rand::Rng;
use rand_distr::{Binomial, Distribution};

use super::independent::{is_count, log_probability};
use super::special::{ln_factorial, log_excess};
use super::{EmissionError, Family, StartFromClusters};
use crate::error::{check, check_components, shape, with_place};
use wayfix::LikelihoodError;
use wayfix::ReorderStates;
use wayfix::inference::{Displacement, FreeParameters};
use wayfix::internal::SUM_TOLERANCE;
use wayfix::internal::shares;
use wayfix::likelihood::{LearnLikelihood, SampleObservation};
use wayfix::{Diagonal, Likelihood, Scratch};
use wayfix_kernels as kernels;

/// Number of trials at which log probabilities are computed from distances to the expected counts,
/// since the terms of the plain sum would cancel.
const MANY: f64 = 64.0;

/// Counts of d kinds of outcomes in the trials of a step, such as the words of a document.
///
/// p(y) = N! Π_c p_c^{y_c} / y_c!, of whole numbers y_c ≥ 0. The number of trials N = Σ y_c of a
/// row is at most 2^53 and may differ from row to row. Probabilities are relative to their sum,
/// which is one up to rounding. With one trial in each step it is a
/// [table](wayfix::TableLikelihood). Learning sets the probabilities to the weighted shares of the
/// counts.
///
/// The pseudo-count of the [sensor](wayfix::inference::LearningOptions::likelihood_pseudo_count) is
/// added to the count of each outcome, as in a table: a Dirichlet prior, under which
/// probabilities of 0 stay 0.
///
/// A single count cannot be missing, since the number of trials would be unknown; a whole row may
/// be ([`with_missing`](Self::with_missing)).
///
/// A step costs O(n d). Memory: O(n d).
///
/// ```
/// use wayfix_learn::Multinomial;
/// use wayfix::{Belief, DenseTransition, Hmm, Prior};
///
/// let hmm = Hmm::new(
///     Prior::AtFirstObservation(Belief::uniform(2)?),
///     DenseTransition::from_rows(&[[0.9, 0.1], [0.1, 0.9]])?,
///     // Cars, bicycles and lorries, in town and on the motorway.
///     Multinomial::new(&[[0.5, 0.4, 0.1], [0.7, 0.0, 0.3]])?,
/// )?;
/// let seen = [[5.0, 3.0, 1.0], [2.0, 1.0, 0.0], [9.0, 0.0, 4.0]];
/// assert_eq!(hmm.viterbi(&seen)?.states(), [0, 0, 1]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Multinomial {
    states: usize,
    missing: bool,
    trials: u64,
    /// Probability of outcome c in state i at c n + i.
    probabilities: Vec<f64>,
    /// Logarithms of the probabilities.
    logs: Vec<f64>,
    /// Sum of each state's probabilities, less 1.
    above_one: Vec<f64>,
    /// Logarithm of that sum.
    ln_sums: Vec<f64>,
}

impl Multinomial {
    /// Creates a family from one row for each state, with the probability of each outcome.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] for zero states or outcomes, rows of different lengths, a probability
    /// outside 0 to 1, or a row that does not sum to one within 1e-9.
    pub fn new<R: AsRef<[f64]>>(probabilities: &[R]) -> Result<Self, EmissionError> {
        let (states, components) = shape("list of probabilities", probabilities)?;
        let mut columns = vec![0.0; states * components];
        let mut above_one = Vec::with_capacity(states);
        for (i, row) in probabilities.iter().enumerate() {
            let row = row.as_ref();
            for (c, &value) in row.iter().enumerate() {
                let valid = (0.0..=1.0 + SUM_TOLERANCE).contains(&value);
                let value = check("probability", value, valid, "a value from 0 to 1");
                columns[c * states + i] = value.map_err(|error| with_place(error, i, Some(c)))?;
            }
            let value = kernels::sum(row);
            let valid = (value - 1.0).abs() <= SUM_TOLERANCE;
            check("sum of probabilities", value, valid, "1")
                .map_err(|error| with_place(error, i, None))?;
            above_one.push(value - 1.0);
        }
        Ok(Self::from_columns(columns, above_one))
    }

    /// Creates a family from valid probabilities, outcome by outcome.
    fn from_columns(probabilities: Vec<f64>, above_one: Vec<f64>) -> Self {
        let logs = probabilities.iter().map(|p| p.ln()).collect();
        let ln_sums = above_one.iter().map(|above| above.ln_1p()).collect();
        let states = above_one.len();
        Self { states, missing: false, trials: 1, probabilities, logs, above_one, ln_sums }
    }

    /// Returns the family with rows of all NaN taken as missing observations.
    #[must_use]
    pub fn with_missing(self) -> Self {
        Self { missing: true, ..self }
    }

    /// Returns the family with this number of trials in rows that are drawn, 1 by default.
    /// Observations may have any number.
    #[must_use]
    pub fn with_trials(self, trials: u32) -> Self {
        Self { trials: trials.into(), ..self }
    }

    /// True if a row of all NaN is a missing observation.
    #[must_use]
    pub fn takes_missing(&self) -> bool {
        self.missing
    }

    /// Number of trials of rows that are drawn.
    #[must_use]
    pub fn trials(&self) -> u32 {
        self.trials as u32
    }

    /// Returns one row for each state, as [`new`](Self::new) takes them.
    #[must_use]
    pub fn probabilities(&self) -> Vec<Vec<f64>> {
        let row = |i| self.probabilities[i..].iter().step_by(self.states).copied().collect();
        (0..self.states).map(row).collect()
    }

    /// Returns the number of trials of a valid row, or `None` if it is missing.
    fn check(&self, observation: &[f64]) -> Result<Option<f64>, EmissionError> {
        check_components(observation, self.components())?;
        if self.missing && observation.iter().all(|y| y.is_nan()) {
            return Ok(None);
        }
        // Whole numbers whose partial sums stay within 2^53 add without rounding.
        let mut trials = 0.0;
        let refused = observation.iter().position(|y| {
            trials += y;
            !is_count(*y) || !is_count(trials)
        });
        let Some(component) = refused else { return Ok(Some(trials)) };
        let value = observation[component];
        let expected = if is_count(value) {
            "counts with a sum of up to 2^53"
        } else {
            "a whole number from 0 to 2^53"
        };
        Err(EmissionError::Observation { component, value, expected })
    }
}

impl Likelihood for Multinomial {
    type Observation = [f64];

    fn states(&self) -> usize {
        self.states
    }

    fn diagonal<'a>(
        &'a self,
        observation: &'a [f64],
        scratch: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        let n = self.states;
        let logs = scratch.values(n);
        logs.fill(0.0);
        let Some(number) = self.check(observation)? else {
            return Ok(Diagonal::log(logs));
        };
        let (whole, rest) = ln_factorial(number);
        if number < MANY {
            // Terms without probabilities are the same for all states. The probabilities are
            // divided by their sum, N times.
            let of_counts: f64 = observation.iter().map(|value| ln_factorial(*value).0).sum();
            for (log, ln_sum) in logs.iter_mut().zip(&self.ln_sums) {
                *log = whole - of_counts - number * ln_sum;
            }
            for (value, ln_ps) in observation.iter().zip(self.logs.chunks_exact(n)) {
                // 0 · ln 0 is 0.
                if *value > 0.0 {
                    logs.iter_mut().zip(ln_ps).for_each(|(log, ln_p)| *log += value * ln_p);
                }
            }
            return Ok(Diagonal::log(logs));
        }
        // Π_c Pois(y_c; N p_c) / Pois(N; N), where −ln Pois(N; N) = ln N! − N (ln N − 1) = `rest`.
        let ln = number.ln();
        let parts = self.probabilities.chunks_exact(n).zip(self.logs.chunks_exact(n));
        for (&value, (ps, ln_ps)) in observation.iter().zip(parts) {
            let factorial = ln_factorial(value);
            for (log, (p, ln_p)) in logs.iter_mut().zip(ps.iter().zip(ln_ps)) {
                *log += log_probability((value, factorial), (number * p, ln + ln_p));
            }
        }
        // If the probabilities sum to 1 + ε, the total has the mean N (1 + ε), and
        // −ln Pois(N; N (1 + ε)) = rest + N (ε − ln(1 + ε)): rounding only enters as ε².
        let above = logs.iter_mut().zip(&self.above_one);
        above.for_each(|(log, above)| *log += rest + number * log_excess(*above));
        Ok(Diagonal::log(logs))
    }
}

impl Family for Multinomial {
    fn components(&self) -> usize {
        self.probabilities.len() / self.states
    }
}

impl SampleObservation for Multinomial {
    type Sample = Vec<f64>;

    fn sample<R: Rng + ?Sized>(&self, state: usize, rng: &mut R) -> Vec<f64> {
        let (mut trials, mut share) = (self.trials, 1.0 + self.above_one[state]);
        let row = || self.probabilities[state..].iter().step_by(self.states);
        // One binomial draw after the other, each among the trials that are left, with the share of
        // what is left of the probabilities. Rounding may leave a rest at the end, so the last
        // possible outcome takes all remaining trials.
        let last = row().rposition(|p| *p > 0.0);
        let draw = |(outcome, &p): (usize, &f64)| {
            let part = if Some(outcome) == last { 1.0 } else { (p / share).clamp(0.0, 1.0) };
            let count = Binomial::new(trials, part).map_or(0, |counts| counts.sample(rng));
            trials -= count;
            share = f64::max(share - p, 0.0);
            count as f64
        };
        row().enumerate().map(draw).collect()
    }
}

impl LearnLikelihood for Multinomial {
    /// Expected counts of outcome c in state i, at c n + i.
    type Statistics = Vec<f64>;

    fn statistics(&self) -> Vec<f64> {
        vec![0.0; self.probabilities.len()]
    }

    /// Adds one observation; nothing if it is invalid.
    fn add(&self, statistics: &mut Vec<f64>, observation: &[f64], posterior: &[f64]) {
        if let Ok(Some(_)) = self.check(observation) {
            for (sums, y) in statistics.chunks_exact_mut(self.states).zip(observation) {
                sums.iter_mut().zip(posterior).for_each(|(sum, p)| *sum += p * y);
            }
        }
    }

    fn merge(&self, statistics: &mut Vec<f64>, other: &Vec<f64>) {
        statistics.iter_mut().zip(other).for_each(|(sum, other)| *sum += other);
    }

    fn maximize(
        &self,
        statistics: &Vec<f64>,
        pseudo_count: f64,
    ) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let row = |(i, old): (usize, Vec<f64>)| {
            let counts = statistics[i..].iter().step_by(self.states).copied().collect::<Vec<f64>>();
            shares(&old, &counts, pseudo_count)
        };
        let rows: Vec<_> = self.probabilities().into_iter().enumerate().map(row).collect();
        Ok(Self { missing: self.missing, trials: self.trials, ..Self::new(&rows)? })
    }

    fn log_prior(&self, pseudo_count: f64) -> f64 {
        if pseudo_count == 0.0 {
            return 0.0;
        }
        let possible = self.logs.iter().filter(|log| **log > f64::NEG_INFINITY);
        pseudo_count * possible.sum::<f64>()
    }

    fn free_parameters(&self) -> usize {
        // Each state's probabilities sum to one, and those of 0 stay 0.
        self.probabilities.iter().filter(|p| **p > 0.0).count() - self.states
    }
}

impl StartFromClusters for Multinomial {}

impl ReorderStates for Multinomial {
    fn reordered(&self, order: &[usize]) -> Self {
        let columns = self.probabilities.chunks_exact(self.states);
        let columns = columns.flat_map(|column| order.iter().map(|&i| column[i])).collect();
        let above_one = order.iter().map(|&i| self.above_one[i]).collect();
        let (missing, trials) = (self.missing, self.trials);
        Self { missing, trials, ..Self::from_columns(columns, above_one) }
    }
}

/// Log-odds of the probabilities above 0 relative to the largest of the state, state by state.
/// Probabilities of 0 count as at a bound.
impl FreeParameters for Multinomial {
    fn displaced(&self, by: &mut Displacement<'_>) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let mut rows = self.probabilities();
        rows.iter_mut().for_each(|row| by.distribution(row));
        Ok(Self { missing: self.missing, trials: self.trials, ..Self::new(&rows)? })
    }
}

#[cfg(feature = "serde")]
wayfix::stored! {
    [] Multinomial: [], |family| {
        probabilities: Vec<Vec<f64>> = family.probabilities(),
        missing: bool = family.takes_missing(),
        trials: u32 = family.trials(),
    } => Self::new(&probabilities).map(|family| family.with_trials(trials))
        .map(|new| crate::family::when(missing, new, Self::with_missing));
}
