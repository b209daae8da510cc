//! State of a fixed-lag smoother, as bytes.

use super::{Kind, Reader, Writer, contents};
use crate::error::SnapshotError;
use crate::inference::{FilterSnapshot, FixedLagSnapshot};

impl FixedLagSnapshot<()> {
    /// Returns the state as bytes, for a model without controls: as many as those of L + 1
    /// [filter states](FilterSnapshot::to_bytes).
    ///
    /// ```
    /// # use wayfix::inference::FixedLagSnapshot;
    /// # use wayfix::{Belief, DenseTransition, Hmm, LikelihoodVector, Prior};
    /// # let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
    /// # let hmm = Hmm::new(prior, DenseTransition::from_rows(&[[0.9, 0.1], [0.1, 0.9]])?, LikelihoodVector::linear(2))?;
    /// let mut smoother = hmm.fixed_lag(2);
    /// smoother.step(&[0.9, 0.2])?;
    /// let bytes = smoother.snapshot().to_bytes();
    /// assert_eq!(FixedLagSnapshot::from_bytes(&bytes)?, smoother.snapshot());
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        self.to_bytes_with(|(), _| ())
    }

    /// Reads a state from bytes.
    ///
    /// # Errors
    ///
    /// [`SnapshotError`] if the bytes are damaged, or not those of such a state.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, SnapshotError> {
        Self::from_bytes_with(bytes, |control| control.is_empty().then_some(()))
    }
}

impl<U> FixedLagSnapshot<U> {
    /// Returns the state as bytes. `write` appends those of a control, of any number.
    ///
    /// ```
    /// # use wayfix::inference::FixedLagSnapshot;
    /// # use wayfix::transition::SwitchedTransition;
    /// # use wayfix::{Belief, DenseTransition, Hmm, LikelihoodVector, Prior};
    /// # let prior = Prior::BeforeFirstTransition(Belief::uniform(2)?);
    /// # let a = DenseTransition::from_rows(&[[0.9, 0.1], [0.1, 0.9]])?;
    /// # let hmm = Hmm::new(prior, SwitchedTransition::new(vec![a])?, LikelihoodVector::linear(2))?;
    /// let mut smoother = hmm.fixed_lag(2);
    /// smoother.step_with(&0, &[0.9, 0.2])?;
    /// let state = smoother.snapshot();
    /// let bytes = state.to_bytes_with(|gear: &usize, out| out.push(*gear as u8));
    /// let read = |bytes: &[u8]| bytes.first().map(|gear| usize::from(*gear));
    /// assert_eq!(FixedLagSnapshot::from_bytes_with(&bytes, read)?, state);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn to_bytes_with(&self, mut write: impl FnMut(&U, &mut Vec<u8>)) -> Vec<u8> {
        let mut writer = Writer::new(Kind::FixedLag);
        writer.integer(self.lag);
        self.present.write(&mut writer);
        writer.integer(self.past.len());
        let mut bytes = Vec::new();
        for (state, control) in &self.past {
            state.write(&mut writer);
            bytes.clear();
            write(control, &mut bytes);
            writer.integer(bytes.len());
            writer.bytes.extend_from_slice(&bytes);
        }
        writer.finish()
    }

    /// Reads a state from bytes. `read` makes a control of the bytes that were written for it, or
    /// returns `None` for others.
    ///
    /// # Errors
    ///
    /// [`SnapshotError`] if the bytes are damaged, or not those of such a state.
    pub fn from_bytes_with(
        bytes: &[u8],
        mut read: impl FnMut(&[u8]) -> Option<U>,
    ) -> Result<Self, SnapshotError> {
        let mut reader = Reader::new(bytes, Kind::FixedLag)?;
        let (lag, present) = (reader.integer()?, FilterSnapshot::read(&mut reader)?);
        let mut past = Vec::new();
        for index in 0..reader.integer()? {
            let state = FilterSnapshot::read(&mut reader)?;
            let length = reader.integer()?;
            let control = read(reader.take(length)?).ok_or(SnapshotError::Control { index })?;
            past.push((state, control));
        }
        reader.finish()?;
        Self::checked(lag, present, past).map_err(contents)
    }
}
