//! Writes the model of the bundled road map of 105 places: drives start anywhere on it, and are
//! observed by a camera with σ = 1.
//!
//! ```text
//! cargo run --release --example canberra -- model.json
//! wayfix-fleet simulate --model model.json --drives 1000000 --output drives.parquet
//! ```

use std::error::Error;
use std::{env, fs};

use wayfix::{Belief, Hmm, Prior, canberra};

fn main() -> Result<(), Box<dyn Error>> {
    let path = env::args_os().nth(1).ok_or("expected the path of the model file")?;
    let (_, transition, sensor) = canberra::hmm(5, 1.0)?.into_parts();
    let prior = Prior::BeforeFirstTransition(Belief::uniform(canberra::PLACES)?);
    let hmm = Hmm::new(prior, transition, sensor)?.with_rounded_tails();
    fs::write(path, serde_json::to_vec(&hmm)?)?;
    Ok(())
}
