//! State of a pruned filter, as bytes.

use super::{Kind, Reader, Writer, contents};
use crate::error::SnapshotError;
use crate::inference::pruned::{Envelope, PrunedFilterSnapshot, Pruning};

impl PrunedFilterSnapshot {
    /// Returns the state as bytes, in the format of
    /// [`FilterSnapshot`](crate::inference::FilterSnapshot::to_bytes): some 32 for each active
    /// state, and 180.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut writer = Writer::new(Kind::Pruned);
        writer.integer(self.states);
        writer.integer(self.steps);
        writer.double(self.pruning.tolerance);
        writer.integer(self.pruning.most_active);
        writer.double(self.bound);
        writer.log_sum(self.log);
        writer.log_sum(self.log_excess);
        writer.integer(usize::from(self.log_lost));
        writer.double(self.share);
        let Envelope { states, estimate, lower, excess, elsewhere, outside } = &self.belief;
        writer.double(*elsewhere);
        writer.double(*outside);
        writer.integer(states.len());
        states.iter().for_each(|state| writer.integer(*state));
        [estimate, lower, excess].into_iter().for_each(|values| writer.doubles(values, 0.0));
        writer.finish()
    }

    /// Reads a state from bytes. O(length).
    ///
    /// # Errors
    ///
    /// [`SnapshotError`] if the bytes are damaged, or not those of such a state.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, SnapshotError> {
        let mut reader = Reader::new(bytes, Kind::Pruned)?;
        let (states, steps) = (reader.integer()?, reader.integer()?);
        let tolerance = reader.double()?;
        // May come from a machine with a larger `usize`.
        let most_active = usize::try_from(reader.word()?).unwrap_or(usize::MAX);
        let bound = reader.double()?;
        let (log, log_excess) = (reader.log_sum()?, reader.log_sum()?);
        let log_lost = match reader.word()? {
            0 => false,
            1 => true,
            other => return Err(contents(format!("{other} is neither yes, 1, nor no, 0"))),
        };
        let (share, elsewhere, outside) = (reader.double()?, reader.double()?, reader.double()?);
        let active = reader.integer()?;
        let active =
            reader.words(active)?.map(|state| usize::try_from(state).unwrap_or(usize::MAX));
        let active = active.collect();
        let [estimate, lower, excess] =
            [reader.doubles(0.0)?, reader.doubles(0.0)?, reader.doubles(0.0)?];
        let belief = Envelope { states: active, estimate, lower, excess, elsewhere, outside };
        let pruning = Pruning { tolerance, most_active };
        reader.finish()?;
        Self { states, steps, pruning, belief, bound, log, log_excess, log_lost, share }
            .checked()
            .map_err(contents)
    }
}
