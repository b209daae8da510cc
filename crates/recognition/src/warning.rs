//! Warnings about a fit or a recording, as texts that name a likely cause.

/// Number of labelled steps below which there are too few.
pub(super) const ENOUGH: usize = 30;

/// Mean probability of answers below which they are suspect: on 29 drives of eight kinds its
/// least over a quarter of the drive was 0.61 and more where seven answers of ten and more were
/// right, and 0.5 and less in the others.
pub(super) const UNSURE: f64 = 0.55;
/// Number of answers below which they are too few to say so.
pub(super) const FEWEST: u32 = 50;

/// A sign that a fit is wrong, or that it does not suit a recording.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Warning {
    /// The right reference is hardly nearer to a labelled query than others: perhaps the matrix is
    /// transposed, similarities were taken for distances, or labels belong to other steps.
    #[error("{:.0}% of references are nearer to a labelled query than a right one, where chance would give 50%: is the matrix transposed, are similarities mixed up with distances, or do the labels belong to other steps?", 100.0 * .rank)]
    Chance {
        /// Mean share of the other references that are nearer than a right one, ties counted
        /// half; 0.5 by chance.
        rank: f64,
    },
    /// The filter, with what it learned from one half of the labels, is sure of other places in most
    /// steps of the other half: perhaps labels are shifted by some steps or places.
    #[error("the filter gives less than 0.1 to {:.0}% of the labels that it was not fitted to: are labels shifted by some steps or places?", 100.0 * .share)]
    Contradicted {
        /// Share of labelled steps whose places have a probability below 0.1.
        share: f64,
    },
    /// Few steps are labelled.
    #[error("only {steps} steps are labelled; at least {} are needed", ENOUGH)]
    Short {
        /// Number of labelled steps.
        steps: usize,
    },
    /// What was learned from one half of the labels does worse on the other half than the parameters
    /// before, which stay.
    #[error(
        "the mean log score on labels that were not learned from is {learned:.2} after learning, and {present:.2} without: nothing was learned"
    )]
    Harm {
        /// Mean log score without learning.
        present: f64,
        /// Mean log score after learning from the other half.
        learned: f64,
    },
    /// Odometry disagrees with the labels: perhaps it is not in references, or from other steps.
    #[error(
        "odometry reads {scale:.3} for each reference driven, give or take {deviation:.2}: is it in references, and from the same steps?"
    )]
    Odometry {
        /// The learned scale, 1 if readings are in references.
        scale: f64,
        /// The learned deviation, in places.
        deviation: f64,
    },
    /// Steps labelled as off the map were not learned from, since the options do not model leaving
    /// it: set [`Options::off_map`](super::Options::off_map).
    #[error(
        "{steps} labelled steps are off the map and were not learned from: Options::off_map is None"
    )]
    OffMap {
        /// Number of steps labelled as off the map.
        steps: usize,
    },
    /// Odometry reads again and again that the vehicle stands, while the views change. Equal readings
    /// count less and less; if odometry is stuck, give `None`.
    #[error(
        "odometry reads {reading} in {steps} steps in a row, and the views contradict it: is it stuck?"
    )]
    Stuck {
        /// The reading, in references.
        reading: f64,
        /// The number of times in a row that it was read.
        steps: u32,
    },
    /// The nearest references move by more in a step than the vehicle may: give
    /// [`Options::speeds`](super::Options::speeds) that reach that far, or more frames.
    #[error(
        "the nearest reference moves by {moved} a step, but the fastest speed in the options is {fastest}: beliefs cannot follow"
    )]
    Fast {
        /// Median distance of the nearest references of two steps, in references.
        moved: f64,
        /// The fastest speed that is modelled.
        fastest: f64,
    },
    /// The filter's answers have a low mean probability over a part of the drive: a quarter of it,
    /// or 50 steps if that is more; live, the last 50. Perhaps the images match nothing, the vehicle
    /// is on another route or leaves this one, or odometry is wrong.
    #[error(
        "the answers of the {steps} steps up to step {step} have a mean probability of {mean:.2}: do the images show this route, and are odometry and Options::off_map right?"
    )]
    Unsure {
        /// Mean probability of the answers.
        mean: f64,
        /// The last step of the most unsure part, from 1.
        step: usize,
        /// The number of its steps.
        steps: usize,
    },
}
