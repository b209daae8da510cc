//! Readers of files: everything that they accept is usable, and errors are short.

mod damage;
mod json_models;
mod json_recognition;
mod json_snapshots;
mod map;
mod roads;

pub use json_models::json_models;
pub use json_snapshots::json_snapshots;
pub use map::csv;
pub use roads::roads;

use std::error::Error;

use serde::{Serialize, de::DeserializeOwned};

use crate::counts::Counts;
use crate::draw::Draw;

/// Longest error: more helps nobody, and fills logs.
const LONGEST_MESSAGE: usize = 1000;
/// Numbers of this size can be those of states, which may cost a lot of memory.
const LARGE: std::ops::RangeInclusive<u64> = 20_000..=1 << 36;

fn check_message(error: &dyn Error) {
    let text = error.to_string();
    let start: String = text.chars().take(80).collect();
    assert!(text.len() <= LONGEST_MESSAGE, "a message of {} bytes: {start}…", text.len());
}

/// True if a document may ask for more memory than there is: "a file can be as
/// costly as what it describes".
fn is_costly(text: &str) -> bool {
    let large = |token: &&str| token.parse().is_ok_and(|number: u64| LARGE.contains(&number));
    text.split(|c: char| !c.is_ascii_alphanumeric() && c != '.').filter(large).count() > 0
}

/// Damages a document, reads it, and checks that the result is written, read and written again to
/// the same bytes.
fn read<T: Serialize + DeserializeOwned>(
    draw: &mut Draw<'_>,
    written: &T,
    counts: &mut Counts,
) -> Option<T> {
    let text = serde_json::to_string(written).expect("a document");
    let damaged = damage::damaged(draw, text.as_bytes());
    let read_as = String::from_utf8_lossy(&damaged);
    if is_costly(&read_as) {
        counts.add("skipped as costly");
        return None;
    }
    counts.note(|| format!("{read_as}"));
    match serde_json::from_slice::<T>(&damaged) {
        Ok(value) => {
            counts.add("accepted");
            let again = serde_json::to_string(&value).expect("a document");
            let back: T = serde_json::from_str(&again)
                .unwrap_or_else(|error| panic!("accepted once, and then refused: {error}"));
            let third = serde_json::to_string(&back).expect("a document");
            assert_eq!(third, again, "written again");
            Some(value)
        }
        Err(error) => {
            counts.add("refused");
            // Such errors are serde's, which repeats the names of fields.
            assert!(damaged != text.as_bytes(), "a valid document is refused: {error}");
            None
        }
    }
}
