//! A filter's state as plain data: its accessors, copies at rest, its bytes and its format.
//!
//! [`FilterSnapshot::checked`] establishes for a state from outside what steps guarantee for a
//! running filter: the belief is a distribution, and its logarithms, if any, agree with it.
//!
//! The bytes begin with `wayfix`, the kind and the version, one byte each, and end with a checksum
//! of everything before it. In between are little-endian numbers of eight bytes: integers, and
//! doubles by their bits. A vector of doubles is stored as its length n, a mask of n bits (in whole
//! words) that marks the values other than 0 (other than −∞ in a vector of logarithms), and those
//! values.

use crate::belief::{Belief, SUM_TOLERANCE};
use crate::error::HmmError;
use crate::inference::step::state::{FilterSnapshot, LogSum, MOST_STEPS};
#[cfg(feature = "serde")]
use crate::stored::{finite_logs, logs as logs_of};
use wayfix_kernels::Aligned;

impl Clone for FilterSnapshot {
    /// Copies the state into as little memory as possible.
    fn clone(&self) -> Self {
        // A state at rest needs no aligned memory: there may be millions of a few hundred bytes.
        let belief = Aligned::from(self.belief.to_vec());
        Self { belief, logs: self.logs.clone(), ..*self }
    }

    /// Copies the state into existing memory. Allocates nothing if both have the same number of
    /// states, unless only the source has logarithms.
    fn clone_from(&mut self, other: &Self) {
        self.copy(other);
        // A vehicle that needed logarithms once should not keep the memory for them.
        if other.logs.is_empty() {
            self.logs = Vec::new();
        }
    }
}

impl FilterSnapshot {
    /// Replaces the belief, its logarithms if there are any (with −∞ for nothing), and the number
    /// of steps, for models that get more states. A filter checks the result when it is restored.
    #[doc(hidden)]
    #[must_use]
    pub fn remade(&self, steps: usize, mut values: impl FnMut(&[f64], f64) -> Vec<f64>) -> Self {
        let belief = Aligned::from(values(&self.belief, 0.0));
        let logs = values(&self.logs, f64::NEG_INFINITY);
        Self { steps, belief, logs, ..self.clone() }
    }

    /// Memory on the heap in bytes, in addition to the snapshot itself: 8 for each state, or 16 if
    /// the belief is held in logarithms too. (The state within a filter keeps room for steps.)
    #[must_use]
    pub fn heap_bytes(&self) -> usize {
        (self.belief.capacity() + self.logs.capacity()) * size_of::<f64>()
    }

    /// Returns the state as bytes: 8 bytes for each possible state, one bit for each state, and
    /// about 60 bytes more. Needs no feature.
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
    /// The bytes begin with `wayfix`, the kind of state and the version, 1, and end with a
    /// checksum, which detects damage. They mean the same on all machines; other versions of the
    /// format are refused.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut out = Writer::new();
        out.integer(self.steps);
        out.integer(self.steps_in_logs);
        out.log_sum(self.log_likelihood);
        out.doubles(&self.belief, 0.0);
        out.doubles(&self.logs, f64::NEG_INFINITY);
        out.finish()
    }

    /// Reads a state from bytes. O(length).
    ///
    /// # Errors
    ///
    /// [`HmmError::Snapshot`] if the bytes are damaged, or not of such a state.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, HmmError> {
        let mut from = Reader::new(bytes)?;
        let (steps, steps_in_logs) = (from.integer()?, from.integer()?);
        let log_likelihood = from.log_sum()?;
        let belief = Belief::new(from.doubles(0.0)?).map_err(|error| invalid(error.to_string()))?;
        let logs = from.doubles(f64::NEG_INFINITY)?;
        // Checked before the state, since leftover bytes are the better explanation of a wrong
        // number.
        from.finish()?;
        let belief = belief.into_vec().into();
        let state = Self { steps, steps_in_logs, belief, logs, log_likelihood };
        state.checked().map_err(invalid)
    }

    /// Checks that the numbers, which may be damaged, can be those of a filter.
    fn checked(self) -> Result<Self, String> {
        let Self { steps, belief, logs, log_likelihood, .. } = &self;
        if *steps > MOST_STEPS {
            return Err(format!("{steps} steps, expected at most {MOST_STEPS}"));
        }
        if !logs.is_empty() {
            let (found, expected) = (logs.len(), belief.len());
            if found != expected {
                return Err(format!("{found} logarithms for a belief over {expected} states"));
            }
            for (state, (log, p)) in logs.iter().zip(&**belief).enumerate() {
                // Steps read the logarithms, accessors the belief: the two must agree. (The
                // comparison is false for NaN.)
                let agree = (log.exp() - p).abs() <= SUM_TOLERANCE;
                if !agree {
                    return Err(format!(
                        "state {state} has probability {p}, expected exp({log}) as its logarithm says"
                    ));
                }
            }
        }
        let LogSum { sum, compensation } = *log_likelihood;
        if !log_likelihood.is_finite() {
            return Err(format!(
                "the log-likelihood is the sum of {sum} and {compensation}, expected finite values"
            ));
        }
        Ok(self)
    }
}

const MAGIC: &[u8] = b"wayfix";
const VERSION: u8 = 1;
/// Length of magic, kind and version.
const HEADER: usize = 8;
/// Length of the checksum at the end.
const SUM: usize = 8;

/// Kind of state in the header: a `FilterSnapshot`.
const KIND: u8 = 1;

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

/// Bytes as they are written.
struct Writer {
    bytes: Vec<u8>,
}

impl Writer {
    fn new() -> Self {
        Self { bytes: [MAGIC, &[KIND, VERSION]].concat() }
    }

    fn word(&mut self, value: u64) {
        self.bytes.extend(value.to_le_bytes());
    }

    fn integer(&mut self, value: usize) {
        self.word(value as u64);
    }

    fn double(&mut self, value: f64) {
        self.bytes.extend(value.to_bits().to_le_bytes());
    }

    fn log_sum(&mut self, LogSum { sum, compensation }: LogSum) {
        [sum, compensation].into_iter().for_each(|value| self.double(value));
    }

    /// Writes a vector of numbers; those equal to `usual` take one bit each.
    fn doubles(&mut self, values: &[f64], usual: f64) {
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

    fn finish(mut self) -> Vec<u8> {
        let sum = checksum(&self.bytes);
        self.bytes.extend(sum.to_le_bytes());
        self.bytes
    }
}

/// Bytes as they are read.
struct Reader<'a> {
    /// All bytes before the checksum.
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    fn new(bytes: &'a [u8]) -> Result<Self, HmmError> {
        // Checked in this order so that the error names the most basic problem: not our bytes,
        // another version, another kind of state, and only then damage.
        let Some((header, _)) = bytes.split_first_chunk::<HEADER>() else {
            // An empty or cut input may have begun as a snapshot.
            let begins = MAGIC.starts_with(&bytes[..bytes.len().min(MAGIC.len())]);
            return Err(if begins { too_short(bytes.len(), HEADER + SUM) } else { no_snapshot() });
        };
        let [magic @ .., found, version] = header;
        if magic != MAGIC {
            return Err(no_snapshot());
        }
        if *version != VERSION {
            return Err(invalid(format!("its bytes are of version {version}, expected {VERSION}")));
        }
        if *found != KIND {
            return Err(invalid(format!(
                "its bytes are of kind {found}, expected {KIND}, a filter"
            )));
        }
        // Header and checksum must not overlap: a short input could otherwise pass.
        let (before, sum) = match bytes.split_last_chunk::<SUM>() {
            Some((before, sum)) if before.len() >= HEADER => (before, sum),
            _ => return Err(too_short(bytes.len(), HEADER + SUM)),
        };
        let (found, expected) = (checksum(before), u64::from_le_bytes(*sum));
        if found != expected {
            let problem =
                format!("its checksum is {found:#x}, expected {expected:#x}: it is damaged");
            return Err(invalid(problem));
        }
        Ok(Self { bytes: before, at: HEADER })
    }

    fn take(&mut self, count: usize) -> Result<&'a [u8], HmmError> {
        // Saturating: a count from damaged bytes may be anything up to 2^64 − 1.
        let end = self.at.saturating_add(count);
        let length = self.bytes.len() + SUM;
        let found = self
            .bytes
            .get(self.at..end)
            .ok_or_else(|| too_short(length, end.saturating_add(SUM)))?;
        self.at = end;
        Ok(found)
    }

    fn words(&mut self, count: usize) -> Result<impl Iterator<Item = u64> + use<'a>, HmmError> {
        let bytes = self.take(count.saturating_mul(8))?;
        Ok(bytes.as_chunks::<8>().0.iter().map(|word| u64::from_le_bytes(*word)))
    }

    fn word(&mut self) -> Result<u64, HmmError> {
        Ok(self.words(1)?.fold(0, |_, word| word))
    }

    fn integer(&mut self) -> Result<usize, HmmError> {
        let found = self.word()?;
        usize::try_from(found).map_err(|_| invalid(format!("{found} does not fit in a usize")))
    }

    fn double(&mut self) -> Result<f64, HmmError> {
        Ok(f64::from_bits(self.word()?))
    }

    fn log_sum(&mut self) -> Result<LogSum, HmmError> {
        Ok(LogSum { sum: self.double()?, compensation: self.double()? })
    }

    /// Reads a vector written by [`Writer::doubles`]. Allocates at most 64 times the length of the
    /// input.
    fn doubles(&mut self, usual: f64) -> Result<Vec<f64>, HmmError> {
        let count = self.integer()?;
        // This fails unless the input contains the masks, one bit for each value. So a damaged
        // count cannot make the vector below larger than 64 times the input.
        let masks = self.words(count.div_ceil(64))?;
        let mut values = vec![usual; count];
        for (values, mask) in values.chunks_mut(64).zip(masks) {
            // The last word of masks may have bits beyond the vector, which must not be set.
            if values.len() < 64 && mask >> values.len() != 0 {
                return Err(invalid(format!("a vector of {count} numbers stores more of them")));
            }
            for (bit, value) in values.iter_mut().enumerate() {
                if mask >> bit & 1 == 1 {
                    *value = self.double()?;
                }
            }
        }
        Ok(values)
    }

    fn finish(&self) -> Result<(), HmmError> {
        match self.bytes.len() - self.at {
            0 => Ok(()),
            found => Err(invalid(format!("{found} bytes follow it, expected 0"))),
        }
    }
}

fn invalid(problem: String) -> HmmError {
    HmmError::Snapshot { problem: problem.into() }
}

fn no_snapshot() -> HmmError {
    HmmError::Snapshot { problem: "its bytes do not begin with the header of one".into() }
}

fn too_short(found: usize, expected: usize) -> HmmError {
    invalid(format!("it ends after {found} bytes, expected at least {expected}"))
}

#[cfg(feature = "serde")]
crate::stored! {
    [] FilterSnapshot: [], |state| {
        steps: usize = state.steps,
        steps_in_logs: usize = state.steps_in_logs,
        belief: Belief = Belief::view(&state.belief).to_owned(),
        logs: Option<Vec<Option<f64>>> = (!state.logs.is_empty()).then(|| finite_logs(&state.logs)),
        log_likelihood: [f64; 2] = [state.log_likelihood.sum, state.log_likelihood.compensation],
    } => {
        let [sum, compensation] = log_likelihood;
        let state = self::FilterSnapshot {
            steps,
            steps_in_logs,
            belief: belief.into_vec().into(),
            logs: logs.map_or_else(Vec::new, logs_of),
            log_likelihood: LogSum { sum, compensation },
        };
        state.checked()
    };
}
