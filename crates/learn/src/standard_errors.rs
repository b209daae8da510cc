//! Standard errors of numbers that a model determines, with their covariances and intervals.
//!
//! Covariances are stored in factored form: one vector for each number, whose products with each
//! other are the covariances. So they are always a valid covariance matrix, whichever method made
//! them.

use crate::standard_normal::normal_quantile;
use wayfix::error::Parameter;
use wayfix::inference::LearnError;

/// Parameters of a learned model, or any other numbers that it determines, with their standard
/// errors.
///
/// Made by [`Hmm::standard_errors`](wayfix::Hmm::standard_errors), from the curvature of the
/// likelihood, and by [`Hmm::jackknife`](wayfix::Hmm::jackknife), from learning without some of the
/// sequences.
#[derive(Debug, Clone, PartialEq)]
pub struct StandardErrors {
    values: Vec<f64>,
    errors: Vec<f64>,
    /// One vector for each number, whose products with each other are the covariances.
    spread: Vec<Vec<f64>>,
    at_bound: usize,
}

impl StandardErrors {
    pub(super) fn new(values: Vec<f64>, spread: Vec<Vec<f64>>, at_bound: usize) -> Self {
        let errors = spread.iter().map(|own| dot(own, own).sqrt()).collect();
        Self { values, errors, spread, at_bound }
    }

    /// The numbers, read from the model that was learned from all sequences.
    #[must_use]
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Standard error of each number.
    #[must_use]
    pub fn errors(&self) -> &[f64] {
        &self.errors
    }

    /// Covariance of the errors of two of the numbers, given by index: the square of the standard
    /// error for a number with itself, `None` if one does not exist. O(parameters), or O(groups)
    /// for the jackknife.
    #[must_use]
    pub fn covariance(&self, number: usize, other: usize) -> Option<f64> {
        Some(dot(self.spread.get(number)?, self.spread.get(other)?))
    }

    /// Number of parameters that were at a bound, such as probabilities of 0, and were treated as
    /// known; 0 for the jackknife, in which they stay 0.
    ///
    /// Zeros of a prior, a dense operator or a table count, whether they were learned or given;
    /// moves that a sparse operator does not store don't.
    #[must_use]
    pub fn at_bound(&self) -> usize {
        self.at_bound
    }

    /// Returns the confidence interval of each number, (low, high), at a level such as 0.95: the
    /// number plus and minus the matching multiple of its standard error, which is right if errors
    /// are normal.
    ///
    /// An interval may exceed the range of its number. For a probability near 0 read the logit, for
    /// a positive number the logarithm, and transform the ends of the interval back:
    ///
    /// ```
    /// # use wayfix::inference::LearningOptions;
    /// # use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
    /// // Seen twice in twelve hours: how probable is it in an hour?
    /// let hours = [0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0];
    /// let table = TableLikelihood::from_rows(&[[10.0 / 12.0, 2.0 / 12.0]])?;
    /// # let one = DenseTransition::from_rows(&[[1.0]])?;
    /// let hmm = Hmm::new(Prior::AtFirstObservation(Belief::uniform(1)?), one, table)?;
    /// let seen = |hmm: &Hmm<_, TableLikelihood>| hmm.likelihood().probability(0, 1).unwrap_or(0.0);
    /// let options = LearningOptions::default();
    /// let plain = StandardErrors::from_likelihood(&hmm, &[hours], &options, |hmm| vec![seen(hmm)])?;
    /// let (low, high) = plain.intervals(0.95)?[0];
    /// assert!(low < 0.0 && (high - 0.378).abs() < 1e-3); // 1/6 ± 1.96 √(5/36 / 12)
    ///
    /// let logit = |p: f64| (p / (1.0 - p)).ln();
    /// let logits = StandardErrors::from_likelihood(&hmm, &[hours], &options, |hmm| vec![logit(seen(hmm))])?;
    /// let (low, high) = logits.intervals(0.95)?[0];
    /// let probability = |logit: f64| 1.0 / (1.0 + (-logit).exp());
    /// assert!((probability(low) - 0.042).abs() < 1e-3 && (probability(high) - 0.477).abs() < 1e-3);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`LearnError::Parameter`] for a level that is not between 0 and 1.
    pub fn intervals(&self, level: f64) -> Result<Vec<(f64, f64)>, LearnError> {
        if !(level > 0.0 && level < 1.0) {
            let expected = "a value between 0 and 1";
            return Err(Parameter::new("the level of intervals", level, expected).into());
        }
        let width = -normal_quantile(0.5 * (1.0 - level));
        let each = self.values.iter().zip(&self.errors);
        Ok(each.map(|(value, error)| (value - width * error, value + width * error)).collect())
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    // Folded from 0, since `sum` of nothing is −0.
    a.iter().zip(b).fold(0.0, |sum, (a, b)| sum + a * b)
}
