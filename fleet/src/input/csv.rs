//! CSV files in the long form, with a header.

use std::io::{self, BufReader};
use std::path::Path;
use std::sync::Arc;

use arrow_array::builder::{Float64Builder, Int64Builder, ListBuilder, StructBuilder};
use arrow_array::cast::AsArray;
use arrow_array::{Array, ArrayRef, RecordBatch, StringArray};
use arrow_cast::{CastOptions, cast_with_options};
use arrow_csv::ReaderBuilder;
use arrow_csv::reader::{Decoder, Format};
use arrow_schema::{DataType, Field, Fields, Schema};

use super::columns::{ColumnNames, Layout};
use super::pieces::{self, BLOCK, Piece};
use super::{Batches, Reading, Rows, without};
use crate::error::{FleetError, Outcome};
use crate::sensor::{Kind, Sensor};
use crate::storage::{Reader, Stored};

/// Rows of a batch.
const ROWS: usize = 1 << 15;

/// Opens a file after rows to skip.
///
/// Trace ids are integers if the first one is, otherwise text. A list has its values between
/// spaces or semicolons: `0.5 0.25 0.25`; a sparse one pairs of a state and its likelihood:
/// `4:0.5 7:0.25`. An empty field is a null.
pub(super) fn open(
    path: &Path,
    names: &ColumnNames,
    sensor: &Sensor,
    skip: u64,
    reading: &Reading,
) -> Outcome<(Batches, Layout)> {
    let (header, ids) = head(path, &names.trace_id)?;
    let numbered = ids.as_deref().is_none_or(|id| id.parse::<i64>().is_ok());
    let field = |name: &String| {
        let to = if *name == names.trace_id {
            if numbered { DataType::Int64 } else { DataType::Utf8 }
        } else if *name == names.step {
            DataType::Int64
        } else if *name == names.observation {
            observation(sensor.kind())
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
    let path = path.to_owned();
    let batches = std::iter::from_fn(move || {
        let first_row = blocks.row;
        let batch = blocks.next(&path).transpose()?;
        Some(batch.and_then(|batch| rows(&batch, &schema, first_row, blocks.reading.leave_out)))
    });
    Ok((without(batches, cut as u64), layout))
}

/// Text of a file, in blocks that are noted as they are read.
struct Blocks {
    file: Reader,
    decoder: Decoder,
    buffer: Vec<u8>,
    /// Byte of the block that comes next.
    at: usize,
    /// Number of the next block.
    number: u64,
    /// First row of the batch that comes next.
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
            if read == 0 || self.decoder.capacity() == 0 {
                break;
            }
        }
        let batch = self.decoder.flush().map_err(wrong)?;
        self.row += batch.as_ref().map_or(0, RecordBatch::num_rows) as u64;
        Ok(batch)
    }

    fn fill(&mut self) -> io::Result<()> {
        pieces::block(&mut self.file, &mut self.buffer)?;
        self.at = 0;
        if let Some(pieces) = self.reading.pieces.as_ref().filter(|_| !self.buffer.is_empty()) {
            // Rows that are skipped are not counted here, and their blocks are known.
            let first_row = self.row + (ROWS - self.decoder.capacity()) as u64;
            let hash = pieces::hash_of(&self.buffer);
            pieces.add(Piece { file: self.reading.file, number: self.number, first_row, hash });
            self.number += 1;
        }
        Ok(())
    }
}

/// Reads columns of text as their types.
fn rows(
    batch: &RecordBatch,
    schema: &Arc<Schema>,
    first_row: u64,
    leave_out: bool,
) -> Outcome<Rows> {
    let mut wrong = Vec::new();
    let mut refuse = |row: usize, error: FleetError| {
        if !leave_out {
            return Err(error);
        }
        wrong.push((row, error));
        Ok(())
    };
    let columns = batch.columns().iter().zip(schema.fields());
    let columns = columns.map(|(text, field)| typed(text, field, first_row, &mut refuse));
    let columns = columns.collect::<Outcome<_>>()?;
    let batch = RecordBatch::try_new(schema.clone(), columns)?;
    wrong.sort_by_key(|(row, _)| *row);
    Ok(Rows { batch, wrong: wrong.into() })
}

/// Returns the header, and the first trace id.
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
    let Ok(column) = schema.index_of(trace_id) else { return Ok((header, None)) };
    let text = header.iter().map(|name| Field::new(name, DataType::Utf8, true));
    let mut reader = ReaderBuilder::new(Arc::new(Schema::new(text.collect::<Vec<_>>())))
        .with_header(true)
        .with_batch_size(1)
        .with_projection(vec![column])
        .build(read(path)?)
        .map_err(wrong)?;
    let Some(first) = reader.next().transpose().map_err(wrong)? else { return Ok((header, None)) };
    Ok((header, Some(first.column(0).as_string::<i32>().value(0).to_owned())))
}

fn read(path: &Path) -> Outcome<Reader> {
    Stored::open(path)?.read_from(0).map_err(FleetError::file(path))
}

/// Type of an observation.
fn observation(kind: &Kind) -> DataType {
    match kind {
        Kind::Table(_) | Kind::SparseTable(_) => DataType::Int64,
        Kind::Vector { .. } => DataType::new_list(DataType::Float64, true),
        Kind::Sparse(_) => DataType::new_list(DataType::Struct(pair()), true),
        Kind::Places(_) => DataType::Utf8, // not read
    }
}

/// Fields of a state with its likelihood.
fn pair() -> Fields {
    Fields::from(vec![
        Field::new("state", DataType::Int64, true),
        Field::new("likelihood", DataType::Float64, true),
    ])
}

/// Takes a row that cannot be read, and may end the work.
type Refuse<'a> = &'a mut dyn FnMut(usize, FleetError) -> Outcome<()>;

/// Reads a column of text as a type; what cannot be read is null.
fn typed(text: &ArrayRef, field: &Field, first_row: u64, refuse: Refuse<'_>) -> Outcome<ArrayRef> {
    let strings = text.as_string::<i32>();
    let mut refuse = |row: usize, what: &str| {
        let message = format!("`{}` is not {what}", strings.value(row));
        refuse(row, FleetError::value(field.name(), first_row + row as u64, message))
    };
    match field.data_type() {
        DataType::List(inner) if inner.data_type().is_floating() => {
            let row = |out: &mut ListBuilder<Float64Builder>, text: &str| {
                for value in parts(text) {
                    out.values().append_value(value.parse().ok()?);
                }
                Some(())
            };
            let what = "a list of numbers";
            list(strings, ListBuilder::new(Float64Builder::new()), row, |row| refuse(row, what))
        }
        DataType::List(_) => {
            let fields: Vec<Box<dyn arrow_array::builder::ArrayBuilder>> =
                vec![Box::new(Int64Builder::new()), Box::new(Float64Builder::new())];
            let row = |out: &mut ListBuilder<StructBuilder>, text: &str| {
                for pair in parts(text) {
                    let (state, likelihood) = pair.split_once(':')?;
                    let (state, likelihood) = (state.parse().ok()?, likelihood.parse().ok()?);
                    let pairs = out.values();
                    pairs.field_builder::<Int64Builder>(0)?.append_value(state);
                    pairs.field_builder::<Float64Builder>(1)?.append_value(likelihood);
                    pairs.append(true);
                }
                Some(())
            };
            let pairs = ListBuilder::new(StructBuilder::new(pair(), fields));
            list(strings, pairs, row, |row| refuse(row, "a list of pairs `state:likelihood`"))
        }
        to => {
            let options = CastOptions { safe: true, ..CastOptions::default() };
            let done = cast_with_options(text, to, &options)?;
            if done.null_count() > text.null_count() {
                let what = if to.is_integer() { "a 64-bit integer" } else { "a number" };
                let lost = |&row: &usize| done.is_null(row) && !text.is_null(row);
                (0..text.len()).filter(lost).try_for_each(|row| refuse(row, what))?;
            }
            Ok(done)
        }
    }
}

/// Values of a list as text.
fn parts(text: &str) -> impl Iterator<Item = &str> {
    text.split([' ', ';']).filter(|part| !part.is_empty())
}

/// Builds lists of a row each.
fn list<B: arrow_array::builder::ArrayBuilder>(
    texts: &StringArray,
    mut out: ListBuilder<B>,
    mut row: impl FnMut(&mut ListBuilder<B>, &str) -> Option<()>,
    mut refuse: impl FnMut(usize) -> Outcome<()>,
) -> Outcome<ArrayRef> {
    for (at, text) in texts.iter().enumerate() {
        let read = text.and_then(|text| row(&mut out, text));
        if text.is_some() && read.is_none() {
            refuse(at)?;
        }
        out.append(read.is_some());
    }
    Ok(Arc::new(out.finish()))
}
