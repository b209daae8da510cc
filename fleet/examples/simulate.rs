//! Writes drives on the bundled road map of 105 places, and the model that they are from.
//!
//! ```text
//! cargo run --release --example simulate -- --drives 1000000 --output drives.parquet --model model.json
//! ```
//!
//! Drives start anywhere on the map, and are seen by a camera of σ = 1. Random numbers are of a
//! known generator, so that the same command writes the same file.

use std::error::Error;
use std::fs::{self, File};
use std::path::PathBuf;
use std::sync::Arc;

use arrow::array::{ArrayRef, Int64Array, ListArray, RecordBatch, UInt32Array};
use arrow::buffer::OffsetBuffer;
use arrow::datatypes::{DataType, Field, Schema};
use clap::{Parser, ValueEnum};
use indicatif::ProgressBar;
use parquet::arrow::ArrowWriter;
use parquet::basic::{Compression, Encoding};
use parquet::file::properties::WriterProperties;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use wayfix::{Belief, Hmm, Prior, canberra};

#[derive(Debug, Parser)]
struct Arguments {
    /// Number of drives.
    #[arg(long, default_value_t = 1000)]
    drives: usize,
    /// Steps of each.
    #[arg(long, default_value_t = 50)]
    steps: usize,
    /// A row for each step, or for each drive.
    #[arg(long, default_value = "nested")]
    form: FormOf,
    /// Drives, a Parquet file.
    #[arg(long)]
    output: PathBuf,
    /// Model that smooths them, JSON.
    #[arg(long)]
    model: PathBuf,
    /// Seed of the random numbers.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, ValueEnum)]
enum FormOf {
    Long,
    Nested,
}

/// Drives of a row group.
const GROUP: usize = 20_000;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments = Arguments::parse();
    let (_, transition, sensor) = canberra::hmm(5, 1.0)?.into_parts();
    let prior = Prior::BeforeFirstTransition(Belief::uniform(canberra::PLACES)?);
    let hmm = Hmm::new(prior, transition, sensor)?.with_rounded_tails();
    fs::write(&arguments.model, serde_json::to_vec(&hmm)?)?;

    let (steps, nested) = (arguments.steps, arguments.form == FormOf::Nested);
    let item = Arc::new(Field::new_list_field(DataType::UInt32, false));
    let mut fields = vec![Field::new("trace_id", DataType::Int64, false)];
    if nested {
        fields.push(Field::new("observation", DataType::List(item.clone()), false));
    } else {
        fields.push(Field::new("step", DataType::Int64, false));
        fields.push(Field::new("observation", DataType::UInt32, false));
    }
    let schema = Arc::new(Schema::new(fields));
    let properties = WriterProperties::builder()
        .set_compression(Compression::SNAPPY)
        .set_column_dictionary_enabled("trace_id".into(), false)
        .set_column_dictionary_enabled("step".into(), false)
        .set_column_encoding("trace_id".into(), Encoding::DELTA_BINARY_PACKED)
        .set_column_encoding("step".into(), Encoding::DELTA_BINARY_PACKED)
        .build();
    let file = File::create(&arguments.output)?;
    let mut writer = ArrowWriter::try_new(file, schema.clone(), Some(properties))?;
    let mut rng = ChaCha8Rng::seed_from_u64(arguments.seed);
    let bar = ProgressBar::new(arguments.drives as u64);
    let mut first = 0;
    while first < arguments.drives {
        let count = GROUP.min(arguments.drives - first);
        let mut symbols: Vec<u32> = Vec::with_capacity(count * steps);
        for _ in 0..count {
            let drive = hmm.simulate(steps, &mut rng);
            symbols.extend(drive.observations().iter().map(|&symbol| symbol as u32));
        }
        let ids = first as i64..(first + count) as i64;
        let symbols = UInt32Array::from(symbols);
        let columns: Vec<ArrayRef> = if nested {
            let offsets = OffsetBuffer::from_lengths(std::iter::repeat_n(steps, count));
            let lists = ListArray::try_new(item.clone(), offsets, Arc::new(symbols), None)?;
            vec![Arc::new(Int64Array::from_iter_values(ids)), Arc::new(lists)]
        } else {
            let ids = ids.flat_map(|id| std::iter::repeat_n(id, steps));
            let numbers = (0..count).flat_map(|_| 1..=steps as i64);
            vec![
                Arc::new(Int64Array::from_iter_values(ids)),
                Arc::new(Int64Array::from_iter_values(numbers)),
                Arc::new(symbols),
            ]
        };
        writer.write(&RecordBatch::try_new(schema.clone(), columns)?)?;
        writer.flush()?;
        first += count;
        bar.set_position(first as u64);
    }
    writer.close()?;
    bar.finish_and_clear();
    println!("{} drives of {steps} steps in {}", arguments.drives, arguments.output.display());
    Ok(())
}
