//! The column that names the input file of each row.

use std::hash::Hasher;
use std::sync::Arc;

use arrow_array::types::Int32Type;
use arrow_array::{ArrayRef, DictionaryArray, Int32Array, RecordBatch, StringArray};
use arrow_schema::{DataType, Field, Schema};
use twox_hash::XxHash3_64;

use crate::error::Outcome;
use crate::input::files::{InputFile, InputFiles};

/// Name of the column.
pub(crate) const FILE: &str = "file";

/// For each file, the hash of the names of all files up to and including it.
pub(crate) fn hashes(files: &InputFiles) -> Vec<u64> {
    let mut hash = XxHash3_64::default();
    let hash_up_to = |file: &InputFile| {
        hash.write(file.path.as_os_str().as_encoded_bytes());
        // A separator, so that `ab`, `c` and `a`, `bc` differ: no path contains a zero byte.
        hash.write(&[0]);
        hash.clone().finish()
    };
    files.files.iter().map(hash_up_to).collect()
}

/// Schema with a column for the file in front.
pub(crate) fn with_file(schema: &Schema) -> Arc<Schema> {
    let of = DataType::Dictionary(Box::new(DataType::Int32), Box::new(DataType::Utf8));
    let mut fields = vec![Arc::new(Field::new(FILE, of, false))];
    fields.extend(schema.fields().iter().cloned());
    Arc::new(Schema::new(fields))
}

/// Rows with a column that names their file.
pub(crate) fn named(rows: &RecordBatch, schema: &Arc<Schema>, name: &str) -> Outcome<RecordBatch> {
    // A dictionary of one value: 4 bytes a row, whatever the length of the name.
    let keys = Int32Array::from(vec![0; rows.num_rows()]);
    let names = DictionaryArray::<Int32Type>::try_new(
        keys,
        Arc::new(StringArray::from(vec![name])) as ArrayRef,
    )?;
    let mut columns: Vec<ArrayRef> = vec![Arc::new(names)];
    columns.extend(rows.columns().iter().cloned());
    Ok(RecordBatch::try_new(schema.clone(), columns)?)
}
