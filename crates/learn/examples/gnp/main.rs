//! Finds the recessions of the United States in the growth of its gross national product, as
//! Hamilton (1989) did, with a user-defined sensor that learns and a chain that starts in its
//! stationary distribution.
//!
//! ```text
//! cargo run --release -p wayfix-learn --example gnp
//! ```

mod growth;
mod model;

use std::error::Error;

use wayfix::inference::LearningOptions;
use wayfix_learn::Rows;

use growth::GROWTH;
use model::{SwitchingMean, model};

fn main() -> Result<(), Box<dyn Error>> {
    // Four lags: each observation is a quarter with the four before it, oldest first.
    let quarters = Rows::new(&GROWTH, 1)?.lagged(4)?;
    let start = SwitchingMean { means: [-0.5, 1.0], lags: [0.0; 4], variance: 1.0 };
    let start = model([0.7, 0.1], start)?;
    let options = LearningOptions::default().with_iterations(1000).with_tolerance(1e-9);
    let learned = start.learn(&[quarters], &options)?;
    let (hmm, iterations) = (learned.model(), learned.iterations());
    println!("log-likelihood {:.5} after {iterations} iterations", learned.log_likelihood());
    let SwitchingMean { means, lags, variance } = hmm.likelihood();
    // Bit 0 of a state is the present regime. The moves 0 → 0 and 31 → 31 stay in the regimes 0 and
    // 1, and ties give all moves of a kind the same probability.
    let moves = hmm.transition().inner();
    let stay = [moves.get(0, 0), moves.get(31, 31)];
    for state in 0..2 {
        // The number of quarters in a regime is geometric, of mean 1 / (1 − stay).
        let (mean, quarters) = (means[state], 1.0 / (1.0 - stay[state]));
        println!("state {state}: {mean:+.3} % a quarter, for {quarters:.1} quarters");
    }
    println!("lags {lags:.3?}, deviation {:.3}", variance.sqrt());

    println!("recessions:");
    let smoothing = hmm.smooth(&quarters)?;
    let mut began = None;
    for (k, belief) in smoothing.posteriors().iter().enumerate() {
        // Regime 0 in the present quarter: the states whose bit 0 is 0.
        let in_recession = belief.mass((0..model::STATES).step_by(2))? > 0.5;
        // The data start with the second quarter of 1951, so the first one with four lags is the
        // second of 1952.
        let quarter = format!("{} Q{}", 1952 + (k + 1) / 4, (k + 1) % 4 + 1);
        match (&began, in_recession) {
            (None, true) => began = Some(quarter),
            (Some(first), false) => {
                println!("  from {first} until {quarter}");
                began = None;
            }
            _ => {}
        }
    }
    Ok(())
}
