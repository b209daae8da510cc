//! Road networks, drives and vehicles from files and bytes.
#![no_main]

use wayfix_fuzz::Counts;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| wayfix_fuzz::roads(bytes, &mut Counts::default()));
