//! Lines of text with a checksum, in files that a run believes when it goes on.

use twox_hash::XxHash3_64;

/// Bytes of the checksum, and of the space after it.
const WIDTH: usize = 17;

/// A line with a text, after its hash (XXH3).
pub(crate) fn line(text: &str) -> String {
    checksum(text.as_bytes()) + text + "\n"
}

/// Text of a line, if it is as it was written.
pub(crate) fn text(line: &[u8]) -> Option<&[u8]> {
    let (before, text) = line.strip_suffix(b"\n")?.split_at_checked(WIDTH)?;
    (before == checksum(text).as_bytes()).then_some(text)
}

fn checksum(text: &[u8]) -> String {
    format!("{:016x} ", XxHash3_64::oneshot(text))
}
