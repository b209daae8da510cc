//! Record of the run that made an output, in the metadata of the file.
//!
//! With it, repeating a command whose output is complete costs one pass over the input, to hash it,
//! and no computation.

use std::fs::File;
use std::path::Path;

use parquet::file::metadata::{KeyValue, ParquetMetaDataReader};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::error::{FleetError, Outcome};

const KEY: &str = "wayfix.run";

/// A finished run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Finished {
    /// Its settings.
    pub(crate) settings: Value,
    /// Hash of the input that was read.
    pub(crate) content: String,
    /// Hash of the names of the input files, if rows carry them.
    pub(crate) names: u64,
    /// Drives, steps, failed drives, and left-out drives.
    pub(crate) counts: [u64; 4],
}

impl Finished {
    /// Returns the entry for the metadata of the file.
    pub(crate) fn metadata(&self) -> KeyValue {
        KeyValue::new(KEY.to_owned(), serde_json::to_string(self).ok())
    }

    /// Reads the record of a file, if it is an output of this version.
    pub(crate) fn read(path: &Path) -> Outcome<Option<Self>> {
        let file = File::open(path).map_err(FleetError::file(path))?;
        // Any other file under that name has no record; it is not an error, as --force may replace
        // it.
        let Ok(metadata) = ParquetMetaDataReader::new().parse_and_finish(&file) else {
            return Ok(None);
        };
        let values = metadata.file_metadata().key_value_metadata();
        let value = values.and_then(|values| values.iter().find(|value| value.key == KEY));
        let text = value.and_then(|value| value.value.as_ref());
        Ok(text.and_then(|text| serde_json::from_str(text).ok()))
    }
}
