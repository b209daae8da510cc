//! Calibration of probabilities.

use super::EvaluationError;
use super::check::check_probabilities;

/// Predicted probabilities in bins, each with the observed frequency of the events: equal, if
/// the probabilities are calibrated.
///
/// Bin m of M holds probabilities of at least m / M and below (m + 1) / M, as doubles;
/// the last one holds 1, too. (Guo et al. close bins at the upper end.)
///
/// ```
/// use wayfix::evaluate::ReliabilityDiagram;
///
/// // The probability of each belief's mode, and whether the mode was right.
/// let forecasts = [(0.25, false), (0.25, false), (0.875, true), (1.0, false), (0.875, true)];
/// let diagram = ReliabilityDiagram::new(&forecasts, 2)?;
/// let bins = diagram.bins().iter();
/// let bins = bins.map(|bin| (bin.count(), bin.mean_probability(), bin.fraction_true()));
/// assert_eq!(bins.collect::<Vec<_>>(), [(2, 0.25, 0.0), (3, 2.75 / 3.0, 2.0 / 3.0)]);
/// assert!((diagram.expected_calibration_error() - 0.25).abs() < 1e-15); // (2/5) 1/4 + (3/5) 1/4
/// # Ok::<(), wayfix::evaluate::EvaluationError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct ReliabilityDiagram {
    bins: Vec<ReliabilityBin>,
    count: usize,
}

/// A bin of a [`ReliabilityDiagram`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReliabilityBin {
    lower: f64,
    upper: f64,
    count: usize,
    mean_probability: f64,
    fraction_true: f64,
}

impl ReliabilityDiagram {
    /// Sorts probabilities, each with whether its event happened, into `bins` bins of equal width.
    /// O(N log N), with any number of bins.
    ///
    /// A probability may lie above 1 by 1e-9, as the sum of a belief may.
    ///
    /// # Errors
    ///
    /// [`EvaluationError`] if there are no probabilities, if one is NaN or not
    /// from 0 to 1, or if `bins` is 0.
    pub fn new(forecasts: &[(f64, bool)], bins: usize) -> Result<Self, EvaluationError> {
        if bins == 0 {
            return Err(EvaluationError::NoBins);
        }
        if forecasts.is_empty() {
            return Err(EvaluationError::Missing { what: "probabilities" });
        }
        check_probabilities("probability", forecasts.iter().map(|forecast| forecast.0))?;
        let mut sorted = forecasts.to_vec();
        sorted.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let (mut rest, mut filled) = (sorted.as_slice(), Vec::new());
        while let Some(&(lowest, _)) = rest.first() {
            let bin = bin_of(lowest, bins);
            let (lower, upper) = (edge(bin, bins), edge(bin + 1, bins));
            let last = bin + 1 == bins;
            let (inside, above) =
                rest.split_at(rest.partition_point(|forecast| last || forecast.0 < upper));
            rest = above;
            let count = inside.len();
            let sum: f64 = inside.iter().map(|forecast| forecast.0).sum();
            let happened = inside.iter().filter(|forecast| forecast.1).count();
            let mean_probability = sum / count as f64;
            let fraction_true = happened as f64 / count as f64;
            filled.push(ReliabilityBin { lower, upper, count, mean_probability, fraction_true });
        }
        Ok(Self { bins: filled, count: forecasts.len() })
    }

    /// The bins that are not empty, lowest first.
    #[must_use]
    pub fn bins(&self) -> &[ReliabilityBin] {
        &self.bins
    }

    /// The expected calibration error (ECE): the mean gap of the bins, weighted by their counts,
    /// Σ (count / N) |fraction − mean probability|. From 0 to 1, lower is better. It depends on
    /// the number of bins (Naeini et al., 2015; Guo et al., 2017). O(bins).
    #[doc(alias = "ece")]
    #[must_use]
    pub fn expected_calibration_error(&self) -> f64 {
        let sum: f64 = self.bins.iter().map(|bin| bin.count as f64 * bin.gap()).sum();
        sum / self.count as f64
    }

    /// The maximum calibration error (MCE): the largest gap of a bin, however small its count
    /// (Naeini et al., 2015). O(bins).
    #[doc(alias = "mce")]
    #[must_use]
    pub fn maximum_calibration_error(&self) -> f64 {
        self.bins.iter().map(ReliabilityBin::gap).fold(0.0, f64::max)
    }
}

impl ReliabilityBin {
    /// The lower edge of the bin.
    #[must_use]
    pub fn lower(&self) -> f64 {
        self.lower
    }

    /// The upper edge of the bin, which belongs to it only if it is the last one.
    #[must_use]
    pub fn upper(&self) -> f64 {
        self.upper
    }

    /// The number of probabilities in the bin, at least one.
    #[must_use]
    pub fn count(&self) -> usize {
        self.count
    }

    /// The mean of the probabilities: the predicted frequency.
    #[must_use]
    pub fn mean_probability(&self) -> f64 {
        self.mean_probability
    }

    /// The observed frequency of the events.
    #[must_use]
    pub fn fraction_true(&self) -> f64 {
        self.fraction_true
    }

    fn gap(&self) -> f64 {
        (self.fraction_true - self.mean_probability).abs()
    }
}

fn edge(bin: usize, bins: usize) -> f64 {
    bin as f64 / bins as f64
}

/// The last bin whose lower edge is at most p, by bisection: the product of p and the number of
/// bins may round into the next one.
fn bin_of(p: f64, bins: usize) -> usize {
    let (mut bin, mut beyond) = (0, bins);
    while beyond - bin > 1 {
        let middle = bin + (beyond - bin) / 2;
        if edge(middle, bins) <= p {
            bin = middle;
        } else {
            beyond = middle;
        }
    }
    bin
}
