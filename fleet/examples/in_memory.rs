//! Times the library's routines on drives in memory, for comparison with the command.
//!
//! ```text
//! cargo run --release --features rayon --example in_memory -- --input drives.parquet --model model.json
//! ```
//!
//! Drives are read beforehand. The results of a step are used to find the most probable state and
//! the entropy (or not at all, first line), and dropped.

use std::error::Error;
use std::fs::{self, File};
use std::path::PathBuf;
use std::time::Instant;

use arrow::array::AsArray;
use arrow::datatypes::UInt32Type;
use clap::Parser;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use wayfix::inference::SmoothedSequence;
use wayfix::{Hmm, SparseTransition, TableLikelihood};

#[derive(Debug, Parser)]
struct Arguments {
    /// Drives in the nested form, as the command `simulate` writes them.
    #[arg(long)]
    input: PathBuf,
    /// Model, as the example `canberra` writes it.
    #[arg(long)]
    model: PathBuf,
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments = Arguments::parse();
    let hmm: Hmm<SparseTransition, TableLikelihood> =
        serde_json::from_slice(&fs::read(&arguments.model)?)?;
    let reader =
        ParquetRecordBatchReaderBuilder::try_new(File::open(&arguments.input)?)?.build()?;
    let mut drives: Vec<Vec<usize>> = Vec::new();
    for batch in reader {
        let batch = batch?;
        for drive in batch.column(1).as_list::<i32>().iter().flatten() {
            let symbols = drive.as_primitive::<UInt32Type>();
            drives.push(symbols.values().iter().map(|&symbol| symbol as usize).collect());
        }
    }
    let steps: usize = drives.iter().map(Vec::len).sum();
    let time = |what: &str, run: &dyn Fn() -> f64| {
        let (start, before) = (Instant::now(), processor());
        let sum = run();
        let (seconds, used) = (start.elapsed().as_secs_f64(), processor() - before);
        let each = seconds * 1e9 / steps as f64;
        println!(
            "{what:50} {seconds:7.2} s, {used:7.2} s of processor time, {each:6.1} ns a step \
             (sum {sum:.6})"
        );
    };
    // A slice at a time, so that results are dropped before the next.
    let smoothed = || drives.chunks(1_000).flat_map(|some| hmm.smooth_all(some)).flatten();
    time("smooth_all, results dropped", &|| {
        smoothed().map(|smoothed| smoothed.log_likelihood()).sum()
    });
    time("smooth_all, most probable states", &|| {
        smoothed().map(|smoothed| smoothed.posteriors().modes()[0] as f64).sum()
    });
    time("smooth_all, most probable states and entropies", &|| {
        let sum_of = |smoothed: SmoothedSequence| -> f64 {
            let beliefs = smoothed.posteriors().iter();
            beliefs.map(|belief| belief.peak().1 + belief.entropy()).sum()
        };
        smoothed().map(sum_of).sum()
    });
    time("smooth_all, in blocks of 10,000 drives", &|| {
        let blocks = drives.chunks(10_000).flat_map(|block| hmm.smooth_all(block));
        blocks.flatten().map(|smoothed| smoothed.log_likelihood()).sum()
    });
    time("log_likelihood_all", &|| hmm.log_likelihood_all(&drives).into_iter().flatten().sum());
    time("viterbi_all", &|| {
        let paths = hmm.viterbi_all(&drives);
        paths.into_iter().flatten().map(|path| path.log_probability()).sum()
    });
    Ok(())
}

/// Processor time of all threads in seconds, where the system reports it (Linux): comparable even
/// on a busy machine.
fn processor() -> f64 {
    let stat = fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // After the name in brackets; user and system time, in hundredths of a second.
    let fields = stat.rsplit(')').next().unwrap_or_default().split_whitespace();
    let ticks = fields.skip(11).take(2).filter_map(|ticks| ticks.parse::<f64>().ok());
    ticks.sum::<f64>() / 100.0
}
