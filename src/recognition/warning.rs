//! Reasons to doubt a fit.

use std::fmt;

/// Fewer labelled steps than these are few.
pub(super) const ENOUGH: usize = 30;
/// A mean over so many new frames shows that they match nothing: on a railway in two seasons,
/// by pixels and by a network, those of genuine drives were above 0, and those of drives
/// elsewhere and of noise below −0.33, where −0.51 is of a vehicle that is surely lost.
pub(super) const SPAN: usize = 200;

/// A reason to doubt what was learned, or that it suits a recording.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Warning {
    /// The right reference is hardly nearer to a labelled query than others: perhaps the
    /// matrix is transposed, similarities were taken for distances, or labels are of other
    /// steps.
    Chance {
        /// The mean share of the other references that are nearer than a right one, those
        /// that are as near counted half; 0.5 by chance.
        rank: f64,
    },
    /// Few steps are labelled.
    Short {
        /// Number of them.
        steps: usize,
    },
    /// The best temperature is the last of those that were tried.
    Edge {
        /// It.
        temperature: f64,
    },
    /// Odometry is far from what the labels say: perhaps it is not in references, or of
    /// other steps.
    Odometry {
        /// The scale that was learned, 1 if a reading is in references.
        scale: f64,
        /// The deviation that was learned, in places.
        deviation: f64,
    },
    /// Steps are labelled as off the map, which the options do not model, so that they were
    /// not learned from: set [`Options::off_map`](super::Options::off_map).
    OffMap {
        /// Number of them.
        steps: usize,
    },
    /// The best scores of a recording are other than those of the labelled part, by more
    /// than is usual for it.
    Unlike {
        /// The mean best score of the labelled part.
        labelled: f64,
        /// That of the recording.
        recording: f64,
    },
    /// For 200 new frames the best explanation is that the vehicle is lost: the images
    /// match nothing, or only here and there. Perhaps it is another route, or leaves it.
    Nothing {
        /// The mean log-likelihood of these frames, given those before; 0 if they say
        /// nothing, and more if they match.
        mean: f64,
        /// The last step of these, from 1, of the worst such ones.
        step: usize,
    },
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Chance { rank } => write!(
                f,
                "{:.0}% of references are nearer to a labelled query than a right one is, and \
                 50% would be by chance: is the matrix transposed, are similarities and distances \
                 mixed up, or labels of other steps?",
                100.0 * rank
            ),
            Self::Short { steps } => {
                write!(f, "{steps} steps are labelled, and {ENOUGH} or more tell how it drives")
            }
            Self::Edge { temperature } => write!(
                f,
                "the best temperature, {temperature}, is the last of those that were tried"
            ),
            Self::Odometry { scale, deviation } => write!(
                f,
                "odometry reads {scale:.3} for each reference driven, give or take \
                 {deviation:.2}: is it in references, and of the same steps?"
            ),
            Self::OffMap { steps } => write!(
                f,
                "{steps} labelled steps are off the map and were not learned from: \
                 Options::off_map is None"
            ),
            Self::Unlike { labelled, recording } => write!(
                f,
                "the best match of a query scores {recording:.2} on average, and {labelled:.2} in \
                 the labelled part: they are unlike"
            ),
            Self::Nothing { mean, step } => write!(
                f,
                "the {SPAN} new images until step {step} match nothing: their mean log-likelihood \
                 is {mean:.2}; is it this route, and is Options::off_map None on purpose?"
            ),
        }
    }
}
