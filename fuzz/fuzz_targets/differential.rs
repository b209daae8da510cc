//! Every routine against a dense reference.
#![no_main]

use wayfix_fuzz::Counts;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| wayfix_fuzz::differential(
    bytes,
    &mut Counts::default()
));
