//! Models and their parts from JSON.
#![no_main]

use wayfix_fuzz::Counts;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| wayfix_fuzz::json_models(bytes, &mut Counts::default()));
