//! Scores of estimates.
//!
//! Scores take plain slices, such as pairs of a number and whether it was right, and
//! know nothing of models: they score answers from anywhere. Indices are from
//! 0; anything unknown or absent is `None`.
//!
//! - **States** against true ones: [`accuracy`], [`mean_error`], and
//!   [`illegal_moves`] of a path.
//! - **Places** recognised: [`recall_within`] a tolerance. With a confidence for each
//!   answer, a [`PrecisionRecallCurve`] shows the recall at each precision; a [`RocCurve`],
//!   how well a score tells places on the map from others.
//! - **Probabilities** against outcomes: [`ReliabilityDiagram`] with the
//!   calibration errors, [`brier_score`], [`binary_log_score`], and
//!   [`log_score`] for beliefs over places.
//! - **Localisation**: [`steps_to_localize`], [`steps_to_localize_correctly`].
//!
//! ```
//! use wayfix::evaluate::{PrecisionRecallCurve, self};
//!
//! // The true places of four pictures, of which the third shows a new place; and a
//! // recogniser's answers, each with its confidence.
//! let truth = [Some(3..=5), Some(9..=9), None, Some(20..=22)];
//! let answers = [(4, 0.9), (30, 0.2), (7, 0.4), (23, 0.8)];
//!
//! let places = answers.map(|(place, _)| Some(place));
//! assert_eq!(evaluate::recall_within(&truth, &places, 1)?, 2.0 / 3.0);
//!
//! let mut judged = Vec::new();
//! for (truth, (place, confidence)) in truth.iter().zip(answers) {
//!     let right = match truth {
//!         Some(places) => evaluate::is_within(places, place, 1)?,
//!         None => false,
//!     };
//!     judged.push((confidence, right));
//! }
//! let curve = PrecisionRecallCurve::new(&judged, 3)?; // 3 have a right answer
//! assert_eq!(curve.recall_at_precision(1.0)?, 2.0 / 3.0);
//! # Ok::<(), evaluate::EvaluationError>(())
//! ```

mod check;
mod error;
mod illegal_moves;
mod localisation;
mod precision_recall;
mod ranking;
mod recall;
mod reliability;
mod roc;
mod scores;
mod states;

pub use error::EvaluationError;
pub use illegal_moves::{illegal_moves, illegal_moves_with};
pub use localisation::{steps_to_localize, steps_to_localize_correctly};
pub use precision_recall::{PrecisionRecallCurve, PrecisionRecallPoint};
pub use recall::{is_within, recall_within};
pub use reliability::{ReliabilityBin, ReliabilityDiagram};
pub use roc::{RocCurve, RocPoint};
pub use scores::{binary_log_score, brier_score, log_score};
pub use states::{accuracy, mean_error};
