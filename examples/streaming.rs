//! A live position from one observation at a time, as a template for a robot.
//!
//! ```text
//! cargo run --release --example streaming
//! ```

use std::sync::Arc;

use wayfix::observation::Confusion;
use wayfix::{Belief, Filter, Hmm, HmmError, OptionalLikelihood, Prior, canberra};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // Motion, a camera that may see nothing, and the start at place 5.
    let motion = canberra::turning().into_transition();
    let camera = Confusion::new(&canberra::map(), 0.7)?.into_table()?;
    let prior = Prior::BeforeFirstTransition(Belief::certain(canberra::PLACES, 4)?);
    let model = Arc::new(Hmm::new(prior, motion, OptionalLikelihood::new(camera))?);

    // A filter owns its state and shares the model, so it can move to another thread.
    let mut position = Filter::new(Arc::clone(&model));
    for place_seen in [Some(6), Some(7), None, Some(61), Some(8), Some(9)] {
        match position.step(&place_seen.map(|place| place - 1)) {
            Ok(_) => {}
            Err(error @ HmmError::Impossible { .. }) => {
                // The observation is impossible here, and the filter unchanged: predict without it.
                println!("{error}; without it:");
                position.predict()?;
            }
            Err(other) => return Err(other.into()),
        }
        let belief = position.belief();
        let (place, probability) = belief.peak();
        // States count from 0, the places of the paper from 1.
        let around: Vec<usize> = belief.credible_set(0.9)?.iter().map(|i| i + 1).collect();
        println!(
            "step {}: saw {place_seen:?}, at {} with {probability:.2}, 90% in {around:?}",
            position.steps(),
            place + 1,
        );
    }
    println!("one step on: {}", position.forecast(1)?.mode() + 1);
    Ok(())
}
