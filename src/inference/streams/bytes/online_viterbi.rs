//! State of an online decoder, as bytes.

use super::{Kind, Reader, Writer, contents};
use crate::error::SnapshotError;
use crate::inference::OnlineViterbiSnapshot;
use crate::inference::step::scores::TakenOut;
use crate::inference::streams::online_viterbi_snapshot::Node;

impl OnlineViterbiSnapshot {
    /// Returns the state as bytes, in the format of
    /// [`FilterSnapshot`](crate::inference::FilterSnapshot::to_bytes): 8 for each possible state,
    /// and for each state of an undecided step on a surviving path.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut writer = Writer::new(Kind::OnlineViterbi);
        writer.integer(self.steps);
        writer.double(self.taken_out.whole);
        writer.log_sum(self.taken_out.factors);
        writer.doubles(&self.scores, f64::NEG_INFINITY);
        writer.integer(self.levels.len());
        for nodes in &self.levels {
            writer.integer(nodes.len());
            for node in nodes {
                writer.bytes.extend(node.state.to_le_bytes());
                writer.bytes.extend(node.from.to_le_bytes());
            }
        }
        writer.finish()
    }

    /// Reads a state from bytes. O(length).
    ///
    /// # Errors
    ///
    /// [`SnapshotError`] if the bytes are damaged, or not those of such a state.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, SnapshotError> {
        let mut reader = Reader::new(bytes, Kind::OnlineViterbi)?;
        let steps = reader.integer()?;
        let taken_out = TakenOut { whole: reader.double()?, factors: reader.log_sum()? };
        let scores = reader.doubles(f64::NEG_INFINITY)?;
        let mut levels = Vec::new();
        for _ in 0..reader.integer()? {
            let count = reader.integer()?;
            // The state is in the lower half of a word, its predecessor in the upper half.
            let node = |word: u64| Node { state: word as u32, from: (word >> 32) as u32 };
            levels.push(reader.words(count)?.map(node).collect());
        }
        reader.finish()?;
        Self::checked(steps, scores, taken_out, levels).map_err(contents)
    }
}
