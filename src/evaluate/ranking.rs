//! Samples by falling score, ties together, for the curves.

use super::EvaluationError;

/// The samples whose score is at least the threshold.
pub(super) struct Cut {
    pub(super) threshold: f64,
    /// The number of samples labelled true.
    pub(super) positives: usize,
    /// The number of samples labelled false.
    pub(super) negatives: usize,
}

/// Cuts at each score, highest first. O(N log N).
pub(super) fn cuts(
    what: &'static str,
    samples: &[(f64, bool)],
) -> Result<Vec<Cut>, EvaluationError> {
    if let Some(index) = samples.iter().position(|(score, _)| score.is_nan()) {
        let (value, expected) = (f64::NAN, "a number");
        return Err(EvaluationError::Value { what, index, value, expected });
    }
    let mut sorted = samples.to_vec();
    sorted.sort_unstable_by(|a, b| b.0.total_cmp(&a.0));
    let (mut positives, mut negatives) = (0, 0);
    let cut = |ties: &[(f64, bool)]| {
        let labelled_true = ties.iter().filter(|(_, label)| *label).count();
        positives += labelled_true;
        negatives += ties.len() - labelled_true;
        Cut { threshold: ties[0].0, positives, negatives }
    };
    Ok(sorted.chunk_by(|a, b| a.0 == b.0).map(cut).collect())
}
