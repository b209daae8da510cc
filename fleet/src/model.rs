//! Models read from files.

use std::fs;
use std::path::Path;

use serde_json::Value;
use twox_hash::XxHash3_128;
use wayfix::{DenseTransition, Hmm, SparseTransition};

use crate::error::{FleetError, Outcome};
use crate::sensor::Sensor;
use crate::storage;

/// Maximum size of a file in bytes: enough for some twenty million places with five roads each.
const LARGEST: u64 = 4 << 30;

/// A model with one of the two stored operators.
#[derive(Debug, Clone)]
#[expect(clippy::large_enum_variant, reason = "there is one of them")]
pub enum Operator {
    /// With the sparse matrix of a map.
    Sparse(Hmm<SparseTransition, Sensor>),
    /// With a full matrix.
    Dense(Hmm<DenseTransition, Sensor>),
}

/// A model from a file, with the hash that identifies it.
///
/// The file is the JSON of an `Hmm` of the library, with a `SparseTransition` or `DenseTransition`
/// and one of the sensors of [`Sensor`].
#[derive(Debug, Clone)]
pub struct Model {
    operator: Operator,
    hash: String,
}

/// Evaluates an expression with the model behind an [`Operator`], whatever its type.
macro_rules! with_hmm {
    ($model:expr, $hmm:ident => $body:expr) => {
        match $model.operator() {
            $crate::model::Operator::Sparse($hmm) => $body,
            $crate::model::Operator::Dense($hmm) => $body,
        }
    };
}
pub(crate) use with_hmm;

impl Model {
    /// Reads a model.
    ///
    /// # Errors
    ///
    /// [`FleetError`] if the file cannot be read, is a folder, a pipe or a device, is larger than 4
    /// GiB, or is not such a model.
    pub fn load(path: &Path) -> Outcome<Self> {
        let wrong = FleetError::file(path);
        // Checked before opening: opening a pipe waits for a writer.
        let found = fs::metadata(path).map_err(&wrong)?;
        if !found.is_file() {
            return Err(FleetError::format(path, "is not a file"));
        }
        if found.len() > LARGEST {
            let message = format!("has {} bytes, expected at most {LARGEST}", found.len());
            return Err(FleetError::format(path, message));
        }
        let text = fs::read(path).map_err(wrong)?;
        Self::from_json(&text).map_err(|message| FleetError::format(path, message))
    }

    /// Reads a model from a file, or from an object of a store.
    pub(crate) fn fetch(path: &Path) -> Outcome<Self> {
        if !storage::is_url(path) {
            return Self::load(path);
        }
        let text = storage::whole(path, LARGEST)?;
        Self::from_json(&text).map_err(|message| FleetError::format(path, message))
    }

    /// Parses a model; the hash is that of the bytes of the text.
    ///
    /// # Errors
    ///
    /// A description of what makes it not a model.
    pub fn from_json(text: &[u8]) -> Result<Self, String> {
        let value: Value =
            serde_json::from_slice(text).map_err(|error| format!("not a model: {error}"))?;
        let refused = |error: serde_json::Error| format!("not a model: {error}");
        let transition = value.get("transition");
        let has = |field| transition.is_some_and(|transition| transition.get(field).is_some());
        // The two operators share no field names, so the first that is present decides. An untagged
        // enum would give no reason for an error.
        let operator = if has("columns") {
            Operator::Dense(serde_json::from_value(value).map_err(refused)?)
        } else if has("to") {
            Operator::Sparse(serde_json::from_value(value).map_err(refused)?)
        } else {
            return Err("not a model: its field `transition` is neither a SparseTransition \
                        (`to`, `from`, `probability`) nor a DenseTransition (`columns`)"
                .to_owned());
        };
        Ok(Self { operator, hash: format!("{:032x}", XxHash3_128::oneshot(text)) })
    }

    /// The model with its operator.
    #[must_use]
    pub fn operator(&self) -> &Operator {
        &self.operator
    }

    /// Hash of the file (XXH3, 128 bits, in hexadecimal). It tells whether two files are the same,
    /// not whether one was forged.
    #[must_use]
    pub fn hash(&self) -> &str {
        &self.hash
    }

    /// Number of states, n.
    #[must_use]
    pub fn states(&self) -> usize {
        with_hmm!(self, hmm => hmm.states())
    }

    /// The sensor, which determines the type of observations.
    #[must_use]
    pub fn sensor(&self) -> &Sensor {
        with_hmm!(self, hmm => hmm.likelihood())
    }
}
