//! Snapshots as bytes: compact, and restored to the bit.
//!
//! The bytes begin with `wayfix`, the kind and the version, one byte each, and end with a checksum
//! of everything before it. In between are little-endian numbers of eight bytes: integers, and
//! doubles by their bits. A vector of doubles is stored as its length n, a mask of n bits (in whole
//! words) that marks the values other than 0 (other than −∞ in a vector of logarithms), and those
//! values.

use crate::error::{Count, SnapshotError};
use crate::inference::step::state::LogSum;

const MAGIC: &[u8] = b"wayfix";
const VERSION: u8 = 1;
/// Length of magic, kind and version.
const HEADER: usize = 8;
/// Length of the checksum at the end.
const SUM: usize = 8;

/// Stored types and their names.
const KINDS: [(Kind, &str); 2] = [(Kind::Filter, "FilterSnapshot"), (Kind::Vehicle, "Vehicle")];

/// Type of a stored state, by its byte in the header.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kind {
    Filter = 1,
    /// State of a vehicle, in the module `matching`.
    Vehicle = 5,
}

fn name(kind: u8) -> &'static str {
    KINDS.iter().find(|entry| entry.0 as u8 == kind).map_or("unknown", |entry| entry.1)
}

/// Returns a checksum that is certain to change if the change is confined to one word.
fn checksum(bytes: &[u8]) -> u64 {
    let (words, rest) = bytes.as_chunks::<8>();
    // The last word is padded with zeros. The sum starts from the length, so that trailing zeros
    // still make a difference.
    let mut last = [0; 8];
    last[..rest.len()].copy_from_slice(rest);
    let words = words.iter().chain([&last]).map(|word| u64::from_le_bytes(*word));
    // Multiplying by an odd factor and rotating are bijections: two sums that differ still differ
    // after any common words that follow.
    let add =
        |sum: u64, word: u64| (sum ^ word).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29);
    words.fold(bytes.len() as u64, add)
}

#[derive(Debug)]
pub struct Writer {
    bytes: Vec<u8>,
}

impl Writer {
    #[must_use]
    pub fn new(kind: Kind) -> Self {
        Self { bytes: [MAGIC, &[kind as u8, VERSION]].concat() }
    }

    pub fn word(&mut self, value: u64) {
        self.bytes.extend(value.to_le_bytes());
    }

    pub fn integer(&mut self, value: usize) {
        self.word(value as u64);
    }

    pub fn double(&mut self, value: f64) {
        self.bytes.extend(value.to_bits().to_le_bytes());
    }

    pub fn log_sum(&mut self, LogSum { sum, compensation }: LogSum) {
        [sum, compensation].into_iter().for_each(|value| self.double(value));
    }

    /// Writes a vector of numbers; those equal to `usual` take one bit each.
    pub fn doubles(&mut self, values: &[f64], usual: f64) {
        // Compared by bits, so that −0 and NaN are restored as they were.
        let is_usual = |value: &f64| value.to_bits() == usual.to_bits();
        let others = values.iter().filter(|value| !is_usual(value));
        self.bytes.reserve(8 * (1 + values.len().div_ceil(64) + others.clone().count()));
        self.integer(values.len());
        // One mask word for 64 values, its lowest bit for the first; then the unusual values.
        for values in values.chunks(64) {
            let bits = (0..).zip(values).filter(|(_, value)| !is_usual(value));
            let word = bits.fold(0_u64, |word, (bit, _)| word | 1 << bit);
            self.bytes.extend(word.to_le_bytes());
        }
        others.for_each(|value| self.double(*value));
    }

    #[must_use]
    pub fn finish(mut self) -> Vec<u8> {
        let sum = checksum(&self.bytes);
        self.bytes.extend(sum.to_le_bytes());
        self.bytes
    }
}

#[derive(Debug)]
pub struct Reader<'a> {
    /// All bytes before the checksum.
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    pub fn new(bytes: &'a [u8], kind: Kind) -> Result<Self, SnapshotError> {
        // Checked in this order so that the error names the most basic problem: not our bytes,
        // another version, another kind of state, and only then damage.
        let Some((header, _)) = bytes.split_first_chunk::<HEADER>() else {
            let (found, expected) = (bytes.len(), HEADER + SUM);
            let begins = MAGIC.starts_with(&bytes[..found.min(MAGIC.len())]);
            let length = SnapshotError::Length { found, expected };
            return Err(if begins { length } else { SnapshotError::Format });
        };
        let [magic @ .., found, version] = header;
        if magic != MAGIC {
            return Err(SnapshotError::Format);
        }
        if *version != VERSION {
            return Err(SnapshotError::Version { found: *version, expected: VERSION });
        }
        if *found != kind as u8 {
            let (found, expected) = (name(*found), name(kind as u8));
            return Err(SnapshotError::Kind { found, expected });
        }
        // Header and checksum must not overlap: a short input could otherwise pass.
        let length = SnapshotError::Length { found: bytes.len(), expected: HEADER + SUM };
        let (before, sum) = bytes.split_last_chunk::<SUM>().ok_or(length.clone())?;
        if before.len() < HEADER {
            return Err(length);
        }
        let (found, expected) = (checksum(before), u64::from_le_bytes(*sum));
        if found != expected {
            return Err(SnapshotError::Checksum { found, expected });
        }
        Ok(Self { bytes: before, at: HEADER })
    }

    fn take(&mut self, count: usize) -> Result<&'a [u8], SnapshotError> {
        // Saturating: a count from damaged bytes may be anything up to 2^64 − 1.
        let end = self.at.saturating_add(count);
        let found = self.bytes.get(self.at..end).ok_or(SnapshotError::Length {
            found: self.bytes.len() + SUM,
            expected: end.saturating_add(SUM),
        })?;
        self.at = end;
        Ok(found)
    }

    fn words(
        &mut self,
        count: usize,
    ) -> Result<impl Iterator<Item = u64> + use<'a>, SnapshotError> {
        let bytes = self.take(count.saturating_mul(8))?;
        Ok(bytes.as_chunks::<8>().0.iter().map(|word| u64::from_le_bytes(*word)))
    }

    pub fn word(&mut self) -> Result<u64, SnapshotError> {
        Ok(self.words(1)?.fold(0, |_, word| word))
    }

    pub fn integer(&mut self) -> Result<usize, SnapshotError> {
        let found = self.word()?;
        usize::try_from(found).map_err(|_| contents(format!("{found} does not fit in a usize")))
    }

    pub fn double(&mut self) -> Result<f64, SnapshotError> {
        Ok(f64::from_bits(self.word()?))
    }

    pub fn log_sum(&mut self) -> Result<LogSum, SnapshotError> {
        Ok(LogSum { sum: self.double()?, compensation: self.double()? })
    }

    /// Reads a vector written by [`Writer::doubles`]. Allocates at most 64 times the length of the
    /// input.
    pub fn doubles(&mut self, usual: f64) -> Result<Vec<f64>, SnapshotError> {
        let count = self.integer()?;
        // This fails unless the input contains the masks, one bit for each value. So a damaged
        // count cannot make the vector below larger than 64 times the input.
        let masks = self.words(count.div_ceil(64))?;
        let mut values = vec![usual; count];
        for (values, mask) in values.chunks_mut(64).zip(masks) {
            // The last word of masks may have bits beyond the vector, which must not be set.
            if values.len() < 64 && mask >> values.len() != 0 {
                return Err(contents(format!("a vector of {count} numbers stores more of them")));
            }
            for (bit, value) in values.iter_mut().enumerate() {
                if mask >> bit & 1 == 1 {
                    *value = self.double()?;
                }
            }
        }
        Ok(values)
    }

    pub fn finish(&self) -> Result<(), SnapshotError> {
        match self.bytes.len() - self.at {
            0 => Ok(()),
            found => {
                let what = "bytes after the snapshot";
                Err(SnapshotError::Trailing(Count { what, found, expected: 0 }))
            }
        }
    }
}

#[must_use]
pub fn contents(reason: String) -> SnapshotError {
    SnapshotError::Contents { reason }
}
