//! Warnings about a fit or a recording, as texts that name a likely cause.

/// Number of labelled steps below which there are too few.
pub(super) const ENOUGH: usize = 30;

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
    /// The best scores of a recording differ from those of the labelled part, on average by more
    /// than 1.8 of their deviations there: the camera or season is another, or much of the drive is
    /// off the map.
    #[error(
        "the best match of a query scores {recording:.2} on average, but {labelled:.2} in the labelled part"
    )]
    Unlike {
        /// The mean best score of the labelled part.
        labelled: f64,
        /// The mean best score of the recording.
        recording: f64,
    },
    /// Most recent views hardly differ from the last new one, but their nearest references do: the
    /// vehicle moves, and its images carry no evidence. Perhaps the threshold for changes of the
    /// view is wrong for these images, or a few references outweigh all others.
    #[error("{:.0}% of recent views have hardly changed although other references are nearest, so they carry no evidence: is Options::view_threshold right for these images, or are a few references broken?{}", 100.0 * .unchanged, also_repeated(*.repeated))]
    Unchanged {
        /// Share of recent views that are unchanged, or not clearly changed, without being equal.
        unchanged: f64,
        /// Share of recent views that equal the last new one: the vehicle stands, or the camera is
        /// stuck.
        repeated: f64,
    },
    /// Odometry reads the same again and again, and the views contradict it: they change while it
    /// reads that the vehicle stands, or do not while it reads that it moves. Equal readings count
    /// less and less (`guide::formulas`, Equal readings); if odometry is stuck, give `None`.
    #[error(
        "odometry reads {reading} in {steps} steps in a row, and the views contradict it: is it stuck?"
    )]
    Stuck {
        /// The reading, in references.
        reading: f64,
        /// The number of times in a row that it was read.
        steps: u32,
    },
    /// The views do not change for long while odometry reads that the vehicle moves. Perhaps the
    /// camera is stuck, wheels spin, or the vehicle is in a tunnel.
    #[error(
        "the view has not changed for {steps} steps, and odometry reads {driven:.1} references meanwhile: is this a tunnel, or is the camera or the odometry stuck?"
    )]
    Still {
        /// The number of views without a change.
        steps: u32,
        /// The distance read meanwhile, in references.
        driven: f64,
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
    /// Over a quarter of the drive, and at least 50 steps, the filter's answers have a low mean
    /// probability: perhaps the images match nothing, the vehicle is on another route or leaves
    /// this one, or odometry is wrong.
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

/// The end of the text on unchanged views, if some are repeated.
fn also_repeated(repeated: f64) -> String {
    let all = 100.0 * repeated;
    if repeated > 0.0 {
        format!(" (Another {all:.0}% are repeated exactly.)")
    } else {
        String::new()
    }
}
