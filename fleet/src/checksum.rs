//! Lines of text with a checksum, for files that a resumed run relies on.

use twox_hash::XxHash3_64;

/// Bytes of the checksum and the space after it.
const WIDTH: usize = 17;

/// Returns the line for a text: its hash (XXH3), then the text.
pub(crate) fn line(text: &str) -> String {
    checksum(text.as_bytes()) + text + "\n"
}

/// Returns the text of a line, if the line is intact.
pub(crate) fn text(line: &[u8]) -> Option<&[u8]> {
    // A line without its newline was cut off, even if the text is whole.
    let (before, text) = line.strip_suffix(b"\n")?.split_at_checked(WIDTH)?;
    (before == checksum(text).as_bytes()).then_some(text)
}

fn checksum(text: &[u8]) -> String {
    format!("{:016x} ", XxHash3_64::oneshot(text))
}
