//! Learning of the model from the drives, on a sample of their points.

use std::time::{Duration, Instant};

use indicatif::ProgressBar;
use wayfix_roads::matching::{LearnedMatchModel, MatchError, Matcher, TracePoint};

use super::{Drive, roads};

/// Largest number of points to learn from, and of consecutive points in a piece.
const MOST_POINTS: usize = 5_000;
const PIECE: usize = 500;
/// Smallest number of points to learn from.
const FEWEST_POINTS: usize = 30;

const ITERATIONS: usize = 15;

/// Median interval in seconds above which points hardly show what happens between them.
const MOST_SECONDS: f64 = 15.0;

/// Pieces of all drives; an evenly spread sample if there are too many points.
fn pieces(drives: &[Drive]) -> Vec<&[TracePoint]> {
    let pieces: Vec<&[TracePoint]> =
        drives.iter().flat_map(|drive| drive.trace.points.chunks(PIECE)).collect();
    let points: usize = pieces.iter().map(|piece| piece.len()).sum();
    let share = (MOST_POINTS as f64 / points as f64).min(1.0);
    // A piece is taken whenever the running share passes a whole number: ⌊share · (k + 1)⌋ > ⌊share
    // · k⌋.
    let number = |at: usize| (share * at as f64).floor();
    let is_taken = |at: &usize| number(*at) < number(at + 1) || share == 1.0;
    (0..pieces.len()).filter(is_taken).map(|at| pieces[at]).collect()
}

/// Returns the matcher with the learned model, or unchanged if there is too little to learn from.
pub(crate) fn fit(
    matcher: Matcher,
    drives: &[Drive],
) -> Result<Matcher, Box<dyn std::error::Error>> {
    let points: usize = drives.iter().map(|drive| drive.trace.points.len()).sum();
    if points < FEWEST_POINTS {
        let noise = matcher.model().noise;
        roads::print(&format!(
            "{points} points are too few to learn from: default model, noise {noise} m (see --noise)\n"
        ))?;
        return Ok(matcher);
    }
    let spinner = ProgressBar::new_spinner().with_message("learning the model");
    spinner.enable_steady_tick(Duration::from_millis(100));
    let start = Instant::now();
    // Pieces count as drives: a gap between two of them teaches nothing.
    let fitted: Result<LearnedMatchModel, MatchError> = matcher.learn(&pieces(drives), ITERATIONS);
    spinner.finish_and_clear();
    let fitted = match fitted {
        Ok(fitted) => fitted,
        Err(error) => {
            roads::print(&format!("cannot learn from the drives: {error}; default model\n"))?;
            return Ok(matcher);
        }
    };
    let at_limits = match &fitted.at_limits()[..] {
        [] => String::new(),
        names => format!("; at the limit of their ranges: {}", names.join(", ")),
    };
    let LearnedMatchModel { model, iterations, converged, points, .. } = fitted;
    if fitted.median_interval > MOST_SECONDS {
        roads::print(&format!(
            "points are {:.0} s apart in the median: they hardly show how often vehicles are stationary or off the road\n",
            fitted.median_interval
        ))?;
    }
    if model == *matcher.model() {
        roads::print(&format!(
            "a model learned from half of the {points} points does not improve the other half (gain {:.1} nats): default model, noise {:.1} m\n",
            fitted.held_out, model.noise
        ))?;
        return Ok(matcher);
    }
    roads::print(&format!(
        "learned from {points} points in {:.1} s ({iterations} iterations, {}; gain on held-out halves {:.0} nats): noise {:.1} m ({:.0}% of its variance lasts for {:.0} s), outliers {:.3}, detour {:.2} m/s, stops {:.3}, leaves the road {:.1} times an hour and comes back after {:.0} s{at_limits}\n",
        start.elapsed().as_secs_f64(),
        if converged { "converged" } else { "not converged" },
        fitted.held_out,
        model.noise,
        100.0 * model.lasting,
        model.lasts,
        model.outliers,
        model.deviation,
        model.stop,
        3600.0 * model.leave_road,
        1.0 / model.return_to_road
    ))?;
    Ok(matcher.with_model(model)?)
}
