//! CSV files in the long form, with a header.
//!
//! The decoder reads all columns as text; [`text`] parses them, so that an error names the row and
//! quotes the text. Blocks of bytes are hashed as they are read.

use std::io::{self, BufReader};
use std::path::Path;
use std::sync::Arc;

use arrow_array::RecordBatch;
use arrow_array::cast::AsArray;
use arrow_csv::ReaderBuilder;
use arrow_csv::reader::{Decoder, Format};
use arrow_schema::{DataType, Field, Schema};

use super::columns::{ColumnNames, Layout};
use super::pieces::{self, BLOCK, Piece};
use super::{Batches, Reading, Rows, text, without};
use crate::error::{FleetError, Outcome};
use crate::sensor::Sensor;
use crate::storage::{Reader, Stored};

/// Rows in a batch.
const ROWS: usize = 1 << 15;

/// Opens a file, and skips `skip` rows.
///
/// Trace ids are integers if the first one is (in canonical form: `007` is text), otherwise text. A
/// list has its values separated by spaces or semicolons: `0.5 0.25 0.25`; a sparse list has pairs
/// of a state and its likelihood: `4:0.5 7:0.25`. An empty field is null.
pub(super) fn open(
    path: &Path,
    names: &ColumnNames,
    sensor: &Sensor,
    skip: u64,
    reading: &Reading,
) -> Outcome<(Batches, Layout)> {
    let (header, ids) = head(path, &names.trace_id)?;
    let field = |name: &String| {
        let to = if *name == names.trace_id {
            text::type_of_ids(ids.as_deref())
        } else if *name == names.step {
            DataType::Int64
        } else if *name == names.observation {
            text::observation(sensor.kind())
        } else {
            DataType::Float64
        };
        Field::new(name, to, true)
    };
    let schema = Schema::new(header.iter().map(field).collect::<Vec<_>>());
    let layout = Layout::new(&schema, names, sensor)?;
    let needed = layout.needed();
    let projection: Vec<usize> =
        needed.iter().filter_map(|name| schema.index_of(name).ok()).collect();
    let schema = schema.project(&projection)?;
    let text = header.iter().map(|name| Field::new(name, DataType::Utf8, true));
    let text = Arc::new(Schema::new(text.collect::<Vec<_>>()));
    // The decoder skips whole batches, and `without` the rest, so batches begin at the same rows in
    // every run. The end is only half of the range, so that the decoder can add the header row to
    // it.
    let cut = skip as usize % ROWS;
    let decoder = ReaderBuilder::new(text)
        .with_header(true)
        .with_batch_size(ROWS)
        .with_projection(projection)
        .with_bounds(skip as usize - cut, usize::MAX >> 1)
        .build_decoder();
    let file = read(path)?;
    let row = skip - cut as u64;
    let (buffer, schema, reading) = (Vec::with_capacity(BLOCK), Arc::new(schema), reading.clone());
    let mut blocks = Blocks { file, decoder, buffer, at: 0, number: 0, row, reading };
    let (path, trace_id) = (path.to_owned(), names.trace_id.clone());
    let batches = std::iter::from_fn(move || {
        let first_row = blocks.row;
        let batch = blocks.next(&path).transpose()?;
        let leave_out = blocks.reading.leave_out;
        Some(batch.and_then(|batch| rows(&batch, &schema, &trace_id, first_row, leave_out)))
    });
    Ok((without(batches, cut as u64), layout))
}

/// Text of a file, in blocks that are recorded as they are read.
struct Blocks {
    file: Reader,
    decoder: Decoder,
    buffer: Vec<u8>,
    /// Position in the block of the next byte to decode.
    at: usize,
    /// Number of the next block.
    number: u64,
    /// First row of the next batch.
    row: u64,
    reading: Reading,
}

impl Blocks {
    fn next(&mut self, path: &Path) -> Outcome<Option<RecordBatch>> {
        let wrong = |error| FleetError::format(path, error);
        loop {
            if self.at == self.buffer.len() {
                self.fill().map_err(FleetError::file(path))?;
            }
            let read = self.decoder.decode(&self.buffer[self.at..]).map_err(wrong)?;
            self.at += read;
            // End of the file, or a full batch.
            if read == 0 || self.decoder.capacity() == 0 {
                break;
            }
        }
        // What is left of the block stays for the next batch.
        let batch = self.decoder.flush().map_err(wrong)?;
        self.row += batch.as_ref().map_or(0, RecordBatch::num_rows) as u64;
        Ok(batch)
    }

    fn fill(&mut self) -> io::Result<()> {
        pieces::block(&mut self.file, &mut self.buffer)?;
        self.at = 0;
        if let Some(pieces) = self.reading.pieces.as_ref().filter(|_| !self.buffer.is_empty()) {
            // `self.row` does not count rows that are still in the decoder. Skipped rows never get
            // there, so their blocks all count as the first wanted row; an earlier run recorded
            // them.
            let first_row = self.row + (ROWS - self.decoder.capacity()) as u64;
            let hash = pieces::hash_of(&self.buffer);
            pieces.add(Piece { file: self.reading.file, number: self.number, first_row, hash });
            self.number += 1;
        }
        Ok(())
    }
}

/// Parses columns of text into their types.
fn rows(
    batch: &RecordBatch,
    schema: &Arc<Schema>,
    trace_id: &str,
    first_row: u64,
    leave_out: bool,
) -> Outcome<Rows> {
    let mut wrong = Vec::new();
    let mut refuse = |row: usize, error: FleetError| {
        if !leave_out {
            return Err(error);
        }
        // The columns come one after the other, so errors are sorted by row below. The sort is
        // stable: of one row, the error of the first column comes first.
        wrong.push((row, error));
        Ok(())
    };
    let columns = batch.columns().iter().zip(schema.fields());
    let columns = columns.map(|(text, field)| {
        let read = if field.name() == trace_id { text::ids } else { text::typed };
        read(text, field, first_row, &mut refuse)
    });
    let columns = columns.collect::<Outcome<_>>()?;
    let batch = RecordBatch::try_new(schema.clone(), columns)?;
    wrong.sort_by_key(|(row, _)| *row);
    Ok(Rows { batch, wrong: wrong.into() })
}

/// Returns the header and the first trace id, if there is one.
fn head(path: &Path, trace_id: &str) -> Outcome<(Vec<String>, Option<String>)> {
    let wrong = |error| FleetError::format(path, error);
    let (schema, _) = Format::default()
        .with_header(true)
        .infer_schema(BufReader::new(read(path)?), Some(0))
        .map_err(wrong)?;
    let header: Vec<String> = schema.fields().iter().map(|field| field.name().clone()).collect();
    if header.is_empty() {
        return Err(FleetError::format(path, "is empty, expected a header"));
    }
    // `Layout::new` reports the missing column.
    let Ok(column) = schema.index_of(trace_id) else { return Ok((header, None)) };
    let text = header.iter().map(|name| Field::new(name, DataType::Utf8, true));
    let reader = ReaderBuilder::new(Arc::new(Schema::new(text.collect::<Vec<_>>())))
        .with_header(true)
        // Usually the first row has an id, and nothing else is read.
        .with_batch_size(1)
        .with_projection(vec![column])
        .build(read(path)?)
        .map_err(wrong)?;
    for row in reader {
        let row = row.map_err(wrong)?;
        if let Some(first) = row.column(0).as_string::<i32>().iter().flatten().next() {
            return Ok((header, Some(first.to_owned())));
        }
    }
    Ok((header, None))
}

fn read(path: &Path) -> Outcome<Reader> {
    Stored::open(path)?.read_from(0).map_err(FleetError::file(path))
}
