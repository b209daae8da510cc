//! Snapshots of filters and smoothers from JSON.
#![no_main]

use wayfix_fuzz::Counts;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| wayfix_fuzz::json_snapshots(
    bytes,
    &mut Counts::default()
));
