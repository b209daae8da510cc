//! Cuts a Parquet file into many with a given number of rows, to compare one file with a folder.
//!
//! ```text
//! cargo run --release --example cut -- --input drives.parquet --rows 10000 --output days
//! ```
//!
//! In the long form drives must end where files end: 10,000 rows are 200 drives of 50 steps.

use std::error::Error;
use std::fs::{self, File};
use std::path::PathBuf;

use clap::Parser;
use parquet::arrow::ArrowWriter;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;

#[derive(Debug, Parser)]
struct Arguments {
    /// File of drives.
    #[arg(long)]
    input: PathBuf,
    /// Rows of each file.
    #[arg(long, default_value_t = 10_000)]
    rows: usize,
    /// Folder of the files.
    #[arg(long)]
    output: PathBuf,
}

fn main() -> Result<(), Box<dyn Error>> {
    let Arguments { input, rows, output } = Arguments::parse();
    fs::create_dir_all(&output)?;
    let builder = ParquetRecordBatchReaderBuilder::try_new(File::open(input)?)?;
    let schema = builder.schema().clone();
    for (number, batch) in builder.with_batch_size(rows).build()?.enumerate() {
        let file = File::create(output.join(format!("{number:06}.parquet")))?;
        let mut writer = ArrowWriter::try_new(file, schema.clone(), None)?;
        writer.write(&batch?)?;
        writer.close()?;
    }
    Ok(())
}
