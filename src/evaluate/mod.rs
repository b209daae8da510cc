//! Scores of estimates: states, places and probabilities against the truth.
//!
//! Scores take plain slices, such as pairs of a number and whether it was right, and know nothing
//! of models, so they can score answers from anywhere. Indices start at 0; anything unknown or
//! absent is `None`.
//!
//! - **States** against true ones: [`accuracy`], [`mean_error`], and
//!   [`illegal_moves`] of a path.
//! - **Places** recognised: [`recall_within`] a tolerance. (Curves over thresholds of a confidence
//!   are in wayfix-recognition.)
//! - **Probabilities** against outcomes: [`reliability`] by bins, with the
//!   calibration errors, [`brier_score`], [`binary_log_score`], and
//!   [`log_score`] for beliefs over places.
//! - **Localisation**: [`steps_to_localize`], [`steps_to_localize_correctly`].
//!
//! ```
//! use wayfix::evaluate;
//!
//! // The true places of four pictures (the third shows a new place), and a
//! // recogniser's answers, each with the probability that it is right.
//! let truth = [Some(3..=5), Some(9..=9), None, Some(20..=22)];
//! let answers = [(4, 0.9), (30, 0.2), (7, 0.4), (23, 0.8)];
//!
//! let places = answers.map(|(place, _)| Some(place));
//! assert_eq!(evaluate::recall_within(&truth, &places, 1)?, 2.0 / 3.0);
//!
//! let mut judged = Vec::new();
//! for (truth, (place, probability)) in truth.iter().zip(answers) {
//!     let right = match truth {
//!         Some(places) => evaluate::is_within(places, place, 1)?,
//!         None => false,
//!     };
//!     judged.push((probability, right));
//! }
//! assert!(evaluate::brier_score(&judged)? < 0.1);
//! # Ok::<(), wayfix::error::OutOfRange>(())
//! ```

mod calibration;
mod places;
mod scores;
mod states;

pub use calibration::{
    ReliabilityBin, expected_calibration_error, maximum_calibration_error, reliability,
};
pub use places::{is_within, recall_within, steps_to_localize, steps_to_localize_correctly};
pub use scores::{binary_log_score, brier_score, log_score};
pub use states::{accuracy, illegal_moves, illegal_moves_with, mean_error};

use crate::belief::SUM_TOLERANCE;
use crate::error::OutOfRange;

fn check_lengths<T, E>(truth: &[T], estimates: &[E]) -> Result<(), OutOfRange> {
    let (truth, estimated) = (truth.len(), estimates.len());
    if truth == estimated {
        return Ok(());
    }
    Err(OutOfRange::count("the number of estimates or controls", estimated, truth))
}

/// Checks probabilities. As in beliefs, a sum may exceed one by rounding.
fn check_probabilities(
    what: &'static str,
    values: impl IntoIterator<Item = f64>,
) -> Result<(), OutOfRange> {
    // NaN is in no range.
    let valid = 0.0..=1.0 + SUM_TOLERANCE;
    match values.into_iter().enumerate().find(|(_, p)| !valid.contains(p)) {
        Some((index, value)) => {
            Err(OutOfRange::new(format!("{what} {index}"), value, "a value from 0 to 1"))
        }
        None => Ok(()),
    }
}
