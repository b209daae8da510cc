//! What a complete output says of the run that made it, in the metadata of the file.

use std::fs::File;
use std::path::Path;

use parquet::file::metadata::{KeyValue, ParquetMetaDataReader};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::error::{FleetError, Outcome};

const KEY: &str = "wayfix.run";

/// A run that has come to its end.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Finished {
    /// Its settings.
    pub(crate) settings: Value,
    /// Hash of what was read.
    pub(crate) content: String,
    /// Hash of the names of the files, if rows have them.
    pub(crate) names: u64,
    /// Drives, steps, drives that failed, and those left out.
    pub(crate) counts: [u64; 4],
}

impl Finished {
    /// Returns what is written into the file.
    pub(crate) fn metadata(&self) -> KeyValue {
        KeyValue::new(KEY.to_owned(), serde_json::to_string(self).ok())
    }

    /// Reads what a file says, if it is an output of this version.
    pub(crate) fn read(path: &Path) -> Outcome<Option<Self>> {
        let file = File::open(path).map_err(FleetError::file(path))?;
        let Ok(metadata) = ParquetMetaDataReader::new().parse_and_finish(&file) else {
            return Ok(None);
        };
        let values = metadata.file_metadata().key_value_metadata();
        let value = values.and_then(|values| values.iter().find(|value| value.key == KEY));
        let text = value.and_then(|value| value.value.as_ref());
        Ok(text.and_then(|text| serde_json::from_str(text).ok()))
    }
}
