//! State of a filter, as bytes.

use super::{Kind, Reader, Writer, contents};
use crate::belief::Belief;
use crate::error::SnapshotError;
use crate::inference::FilterSnapshot;

impl FilterSnapshot {
    /// Returns the state as bytes: 8 for each possible state, one bit for each state, and about
    /// 60 more. Needs no feature.
    ///
    /// ```
    /// # use wayfix::inference::FilterSnapshot;
    /// # use wayfix::{Belief, DenseTransition, Hmm, LikelihoodVector, Prior};
    /// # let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
    /// # let hmm = Hmm::new(prior, DenseTransition::from_rows(&[[0.9, 0.1], [0.1, 0.9]])?, LikelihoodVector::linear(2))?;
    /// let mut filter = hmm.filter();
    /// filter.step(&[0.9, 0.2])?;
    /// let mut bytes = filter.snapshot().to_bytes();
    ///
    /// let mut next = hmm.filter();
    /// next.restore(&FilterSnapshot::from_bytes(&bytes)?)?;
    /// assert_eq!(next.snapshot(), filter.snapshot()); // to the bit
    ///
    /// bytes[20] ^= 1;
    /// assert!(FilterSnapshot::from_bytes(&bytes).is_err());
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # The format
    ///
    /// Bytes begin with `wayfix`, the kind of state and the version, 1, and end with a checksum,
    /// which detects damage. They mean the same on all machines; another version of the format is
    /// refused.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut writer = Writer::new(Kind::Filter);
        self.write(&mut writer);
        writer.finish()
    }

    /// Reads a state from bytes. O(length).
    ///
    /// # Errors
    ///
    /// [`SnapshotError`] if the bytes are damaged, or not those of such a state.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, SnapshotError> {
        let mut reader = Reader::new(bytes, Kind::Filter)?;
        let state = Self::read(&mut reader)?;
        reader.finish()?;
        Ok(state)
    }

    pub(crate) fn write(&self, writer: &mut Writer) {
        writer.integer(self.steps);
        writer.integer(self.steps_in_logs);
        writer.log_sum(self.log_likelihood);
        writer.doubles(self.belief.as_slice(), 0.0);
        // Without logarithms, an empty vector.
        writer.doubles(self.logs.as_deref().unwrap_or_default(), f64::NEG_INFINITY);
    }

    pub(crate) fn read(reader: &mut Reader<'_>) -> Result<Self, SnapshotError> {
        let steps = [reader.integer()?, reader.integer()?];
        let log_likelihood = reader.log_sum()?;
        let belief =
            Belief::new(reader.doubles(0.0)?).map_err(|error| contents(error.to_string()))?;
        let logs = Some(reader.doubles(f64::NEG_INFINITY)?).filter(|logs| !logs.is_empty());
        Self::checked(steps, belief, logs, log_likelihood).map_err(contents)
    }
}
