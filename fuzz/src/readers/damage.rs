//! Damage to documents that were valid.

use crate::draw::Draw;

/// Replacements of a number.
const NUMBERS: [&str; 28] = [
    "0",
    "-0",
    "-0.0",
    "1",
    "2",
    "-1",
    "0.1",
    "0.5",
    "1.0000000001",
    "1e308",
    "-1e308",
    "1e309",
    "1e-310",
    "5e-324",
    "2.2250738585072014e-308",
    "1e-300",
    "NaN",
    "inf",
    "null",
    "",
    "\"1\"",
    "[]",
    "4294967295",
    "9007199254740992",
    "9007199254740993",
    "18446744073709551615",
    "18446744073709551616",
    "-9223372036854775808",
];
const CHARACTERS: &[u8] = b"0123456789.-+eE[]{},:\"n\n\r\t; '\\\0\xff\xc3\xa9";

/// The document, or what is left of it after one or more changes.
pub(super) fn damaged(draw: &mut Draw<'_>, document: &[u8]) -> Vec<u8> {
    let mut bytes = document.to_vec();
    let changes = draw.pick(&[1, 1, 1, 2, 2, 3, 8, 0]);
    for _ in 0..changes {
        if bytes.is_empty() {
            break;
        }
        let at = draw.below(bytes.len());
        match draw.below(12) {
            0..=5 => number(draw, &mut bytes, at),
            6 => bytes[at] ^= 1 << draw.below(8),
            7 => bytes.insert(at, draw.pick(CHARACTERS)),
            8 => bytes[at] = draw.pick(CHARACTERS),
            9 => {
                let end = bytes.len().min(at + 1 + draw.below(20));
                bytes.drain(at..end);
            }
            10 => {
                let end = bytes.len().min(at + 1 + draw.below(40));
                let times = draw.pick(&[1, 1, 1, 2, 1000]);
                let again = bytes[at..end].repeat(times);
                bytes.splice(at..at, again);
            }
            _ => bytes.truncate(at),
        }
    }
    bytes
}

/// Replaces the number at or after a position.
fn number(draw: &mut Draw<'_>, bytes: &mut Vec<u8>, at: usize) {
    let numeric = |byte: &u8| byte.is_ascii_digit() || b"+-.eE".contains(byte);
    let first = bytes[..at].iter().rposition(|byte| !numeric(byte)).map_or(0, |before| before + 1);
    let Some(start) = bytes[first..].iter().position(u8::is_ascii_digit) else { return };
    let mut start = first + start;
    if start > 0 && bytes[start - 1] == b'-' {
        start -= 1;
    }
    let end = bytes[start..].iter().position(|byte| !numeric(byte));
    let end = end.map_or(bytes.len(), |length| start + length);
    bytes.splice(start..end, draw.pick(&NUMBERS).bytes());
}
