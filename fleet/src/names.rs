//! The column with the file that a row comes from.

use std::hash::Hasher;
use std::sync::Arc;

use arrow_array::types::Int32Type;
use arrow_array::{ArrayRef, DictionaryArray, Int32Array, RecordBatch, StringArray};
use arrow_schema::{DataType, Field, Schema};
use twox_hash::XxHash3_64;

use crate::error::Outcome;
use crate::input::files::{InputFile, InputFiles};

/// Column with the file of the input.
pub(crate) const FILE: &str = "file";

/// Hashes of the names of the files up to each.
pub(crate) fn hashes(files: &InputFiles) -> Vec<u64> {
    let mut hash = XxHash3_64::default();
    let hash_up_to = |file: &InputFile| {
        hash.write(file.path.as_os_str().as_encoded_bytes());
        hash.write(&[0]);
        hash.clone().finish()
    };
    files.files.iter().map(hash_up_to).collect()
}

/// Schema with a column for the file.
pub(crate) fn with_file(schema: &Schema) -> Arc<Schema> {
    let of = DataType::Dictionary(Box::new(DataType::Int32), Box::new(DataType::Utf8));
    let mut fields = vec![Arc::new(Field::new(FILE, of, false))];
    fields.extend(schema.fields().iter().cloned());
    Arc::new(Schema::new(fields))
}

/// Rows with the name of their file.
pub(crate) fn named(rows: &RecordBatch, schema: &Arc<Schema>, name: &str) -> Outcome<RecordBatch> {
    let keys = Int32Array::from(vec![0; rows.num_rows()]);
    let names = DictionaryArray::<Int32Type>::try_new(
        keys,
        Arc::new(StringArray::from(vec![name])) as ArrayRef,
    )?;
    let mut columns: Vec<ArrayRef> = vec![Arc::new(names)];
    columns.extend(rows.columns().iter().cloned());
    Ok(RecordBatch::try_new(schema.clone(), columns)?)
}
