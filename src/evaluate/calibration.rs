//! Calibration of probabilities: predicted against observed frequencies, in bins of equal width.

use super::check_probabilities;
use crate::error::OutOfRange;

/// Bin of predicted probabilities with the observed frequency of their events; the two are equal if
/// the probabilities are calibrated. Made by [`reliability`].
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct ReliabilityBin {
    /// Lower edge of the bin.
    pub lower: f64,
    /// Upper edge of the bin, which belongs to the bin only if it is the last one.
    pub upper: f64,
    /// Number of probabilities in the bin, at least one.
    pub count: usize,
    /// Mean of the probabilities: the predicted frequency.
    pub mean_probability: f64,
    /// Observed frequency of the events.
    pub fraction_true: f64,
}

/// Sorts probabilities, each with whether its event happened, into `bins` bins of equal width, and
/// returns the non-empty ones, the lowest first: a reliability diagram. O(N log N), for any number
/// of bins.
///
/// Bin m of M holds probabilities of at least m / M and below (m + 1) / M, as doubles; the last one
/// also holds 1. (Guo et al. close bins at the upper end.) A probability may exceed 1 by 1e-9, as
/// the sum of a belief may.
///
/// ```
/// use wayfix::evaluate;
///
/// // The probability of each belief's mode, and whether the mode was right.
/// let forecasts = [(0.25, false), (0.25, false), (0.875, true), (1.0, false), (0.875, true)];
/// let bins = evaluate::reliability(&forecasts, 2)?;
/// let found = bins.iter().map(|bin| (bin.count, bin.mean_probability, bin.fraction_true));
/// assert_eq!(found.collect::<Vec<_>>(), [(2, 0.25, 0.0), (3, 2.75 / 3.0, 2.0 / 3.0)]);
/// // (2/5) 1/4 + (3/5) 1/4
/// assert!((evaluate::expected_calibration_error(&bins) - 0.25).abs() < 1e-15);
/// # Ok::<(), wayfix::error::OutOfRange>(())
/// ```
///
/// # Errors
///
/// [`OutOfRange`] if `forecasts` is empty, a probability is NaN or not from 0 to 1, or `bins`
/// is 0.
pub fn reliability(
    forecasts: &[(f64, bool)],
    bins: usize,
) -> Result<Vec<ReliabilityBin>, OutOfRange> {
    if bins == 0 {
        return Err(OutOfRange::none("the number of bins"));
    }
    if forecasts.is_empty() {
        return Err(OutOfRange::none("the number of probabilities"));
    }
    check_probabilities("probability", forecasts.iter().map(|forecast| forecast.0))?;
    let mut sorted = forecasts.to_vec();
    sorted.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let (mut rest, mut filled) = (sorted.as_slice(), Vec::new());
    // Each iteration takes the bin of the lowest probability left. Empty bins cost nothing, so
    // there may be any number of them.
    while let Some(&(lowest, _)) = rest.first() {
        let bin = bin_of(lowest, bins);
        let (lower, upper) = (edge(bin, bins), edge(bin + 1, bins));
        let last = bin + 1 == bins;
        // The edge that the bin is named by also cuts it: a probability that equals it goes to the
        // next bin, unless this is the last.
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
    Ok(filled)
}

/// Expected calibration error (ECE) of the bins of [`reliability`]: their mean gap, weighted by
/// their counts, Σ (count / N) |fraction − mean probability|. From 0 to 1, lower is better. It
/// depends on the number of bins (Naeini et al., 2015; Guo et al., 2017). O(bins).
#[doc(alias = "ece")]
#[must_use]
pub fn expected_calibration_error(bins: &[ReliabilityBin]) -> f64 {
    let sum = bins.iter().fold(0.0, |sum, bin| sum + bin.count as f64 * bin.gap());
    let count: usize = bins.iter().map(|bin| bin.count).sum();
    sum / count.max(1) as f64
}

/// Maximum calibration error (MCE) of the bins of [`reliability`]: the largest gap of a bin,
/// however small its count (Naeini et al., 2015). O(bins).
#[doc(alias = "mce")]
#[must_use]
pub fn maximum_calibration_error(bins: &[ReliabilityBin]) -> f64 {
    bins.iter().map(ReliabilityBin::gap).fold(0.0, f64::max)
}

impl ReliabilityBin {
    fn gap(&self) -> f64 {
        (self.fraction_true - self.mean_probability).abs()
    }
}

fn edge(bin: usize, bins: usize) -> f64 {
    bin as f64 / bins as f64
}

/// Last bin whose lower edge is at most p, by bisection on the edges: p times the number of bins
/// could round into the next bin.
fn bin_of(p: f64, bins: usize) -> usize {
    let (mut bin, mut beyond) = (0, bins);
    // Invariant: edge(bin) ≤ p, and `beyond` is past the last bin or edge(beyond) > p.
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
