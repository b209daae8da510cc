//! Numbers of random cases, and random numbers.

use proptest::prelude::*;
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};

/// The number of random cases of a property: `WAYFIX_CASES`, or 128.
pub fn cases() -> ProptestConfig {
    cases_of(2000)
}

/// This many cases where other properties have 2,000, for properties that take long.
pub fn cases_of(share: u32) -> ProptestConfig {
    let cases = match std::env::var("WAYFIX_CASES") {
        Ok(text) => text.parse().expect("WAYFIX_CASES is a number of cases"),
        Err(_) => 128_u32,
    };
    let config = ProptestConfig::with_cases((cases * share).div_ceil(2000));
    // Slow cases are not shrunk for half an hour.
    ProptestConfig { failure_persistence: None, max_shrink_iters: share, ..config }
}

/// Random numbers that are the same in each run.
pub fn rng(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}
