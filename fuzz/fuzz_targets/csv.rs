//! Maps from CSV files.
#![no_main]

use wayfix_fuzz::Counts;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| wayfix_fuzz::csv(bytes, &mut Counts::default()));
