//! Simulates drives on a road network with a sensor that names a few places, writes them, and
//! follows them with pruned filters.
//!
//! ```text
//! cargo run --release --example city -- --roads FOLDER --output drives.parquet --model model.json
//! ```
//!
//! The folder has `nodes.csv` (one line per node) and `edges.csv` (`from,to,…`). A vehicle stays or
//! takes any road out, and starts anywhere. A sighting lists the true place with probability 0.6,
//! or else one of its neighbours, and the places around the one it lists; elsewhere the likelihood
//! is 1e-6.

use std::error::Error;
use std::fs::{self, File};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;
use std::{iter, thread};

use arrow::array::{
    ArrayRef, Float64Array, Int64Array, ListArray, RecordBatch, StructArray, UInt32Array,
};
use arrow::buffer::OffsetBuffer;
use arrow::datatypes::{DataType, Field, Fields};
use clap::Parser;
use parquet::arrow::ArrowWriter;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use wayfix::inference::Pruning;
use wayfix::{Belief, Hmm, Prior, SparseLikelihood, SparseTransition, TransitionEntries};
use wayfix_fleet::input::{self, ColumnNames};
use wayfix_fleet::model::Model;
use wayfix_fleet::sensor::Observation;

#[derive(Debug, Parser)]
struct Arguments {
    /// Folder with `nodes.csv` and `edges.csv`.
    #[arg(long)]
    roads: PathBuf,
    /// Number of drives.
    #[arg(long, default_value_t = 20_000)]
    drives: usize,
    /// Steps of each drive.
    #[arg(long, default_value_t = 50)]
    steps: usize,
    /// Drives, a Parquet file.
    #[arg(long)]
    output: PathBuf,
    /// Model, JSON.
    #[arg(long)]
    model: PathBuf,
}

type City = Hmm<SparseTransition, SparseLikelihood>;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments = Arguments::parse();
    let hmm = city(&arguments)?;
    fs::write(&arguments.model, serde_json::to_vec(&hmm)?)?;
    let truth = write(&hmm, &arguments)?;
    println!("{} places, {} drives of {} steps", hmm.states(), arguments.drives, arguments.steps);

    let start = Instant::now();
    let model = Model::load(&arguments.model)?;
    let found = input::open(&arguments.output, &ColumnNames::default(), model.sensor(), 0)?;
    let batches = found.batches.collect::<Result<Vec<_>, _>>()?;
    let mut drives = Vec::new();
    for batch in &batches {
        let seen = batch.observations()?;
        drives.extend(batch.offsets.windows(2).map(|drive| seen[drive[0]..drive[1]].to_vec()));
    }
    println!("read in {:.2} s", start.elapsed().as_secs_f64());

    let start = Instant::now();
    let (next, right, active) = (AtomicUsize::new(0), AtomicUsize::new(0), AtomicUsize::new(0));
    let cores = thread::available_parallelism().map_or(1, Into::into);
    thread::scope(|scope| {
        let work = || -> Result<(), wayfix::HmmError> {
            let mut filter = hmm.pruned_filter(Pruning::default());
            loop {
                let number = next.fetch_add(1, Ordering::Relaxed);
                let Some(drive) = drives.get(number) else { return Ok(()) };
                filter.restart();
                for observation in drive {
                    if let Observation::Sparse(seen) = observation {
                        filter.step(seen)?;
                        active.fetch_add(filter.active().len(), Ordering::Relaxed);
                    }
                }
                let is_right = truth[number] == filter.mode();
                right.fetch_add(usize::from(is_right), Ordering::Relaxed);
            }
        };
        let threads: Vec<_> = (0..cores).map(|_| scope.spawn(work)).collect();
        threads.into_iter().try_for_each(|thread| thread.join().expect("no thread panics"))
    })?;
    let (seconds, all) =
        (start.elapsed().as_secs_f64(), (arguments.drives * arguments.steps) as f64);
    println!(
        "pruned filters, {cores} threads: {seconds:.2} s, {:.0} steps a second, {:.0} active states; \
         {} of {} drives end where the filter believes them to be",
        all / seconds,
        active.into_inner() as f64 / all,
        right.into_inner(),
        arguments.drives
    );
    Ok(())
}

/// Model of a road network: staying and each road out are equally probable.
fn city(arguments: &Arguments) -> Result<City, Box<dyn Error>> {
    let read = |name: &str| fs::read_to_string(arguments.roads.join(name));
    let places = read("nodes.csv")?.lines().skip(1).filter(|line| !line.is_empty()).count();
    let mut roads: Vec<Vec<usize>> = (0..places).map(|place| vec![place]).collect();
    for (number, line) in read("edges.csv")?.lines().enumerate().skip(1) {
        let mut fields = line.split(',').map(str::parse::<usize>);
        let (Some(Ok(from)), Some(Ok(to))) = (fields.next(), fields.next()) else {
            return Err(format!("edges.csv, line {}: expected from,to,…", number + 1).into());
        };
        let ways = roads.get_mut(from).filter(|_| to < places);
        ways.ok_or_else(|| format!("edges.csv, line {}: no such node", number + 1))?.push(to);
    }
    let entries = roads.iter_mut().enumerate().flat_map(|(from, ways)| {
        ways.sort_unstable();
        ways.dedup();
        let share = 1.0 / ways.len() as f64;
        ways.iter().map(move |&to| (to, from, share)).collect::<Vec<_>>()
    });
    let transition = SparseTransition::from_triplets(places, entries)?;
    let prior = Prior::BeforeFirstTransition(Belief::uniform(places)?);
    Ok(Hmm::new(prior, transition, SparseLikelihood::new(places))?)
}

/// Writes drives, and returns where each one ends.
fn write(hmm: &City, arguments: &Arguments) -> Result<Vec<usize>, Box<dyn Error>> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let (count, steps) = (arguments.drives, arguments.steps);
    let ways = |place: usize| hmm.transition().outgoing(&(), place).map(|way| way.0);
    let step = |from: usize, rng: &mut ChaCha8Rng| {
        let at = rng.random_range(0..ways(from).count());
        ways(from).nth(at).unwrap_or(from)
    };
    let (mut listed, mut likelihoods, mut lengths) = (Vec::new(), Vec::new(), Vec::new());
    let mut ends = Vec::with_capacity(count);
    for _ in 0..count {
        let mut place = rng.random_range(0..hmm.states());
        for _ in 0..steps {
            place = step(place, &mut rng);
            let seen = if rng.random_bool(0.6) { place } else { step(place, &mut rng) };
            let around: Vec<usize> = ways(seen).collect();
            lengths.push(around.len());
            listed.extend(around.iter().map(|&state| state as u32));
            likelihoods.extend(around.iter().map(|&state| if state == seen { 0.6 } else { 0.1 }));
        }
        ends.push(place);
    }
    let sightings = lengths.len();
    let fields = Fields::from(vec![
        Field::new("state", DataType::UInt32, false),
        Field::new("likelihood", DataType::Float64, false),
    ]);
    let columns: Vec<ArrayRef> =
        vec![Arc::new(UInt32Array::from(listed)), Arc::new(Float64Array::from(likelihoods))];
    let items = StructArray::try_new(fields, columns, None)?;
    let list = |values: ArrayRef, lengths: OffsetBuffer<i32>| {
        let field = Arc::new(Field::new_list_field(values.data_type().clone(), false));
        ListArray::try_new(field, lengths, values, None)
    };
    let by_drive = || OffsetBuffer::from_lengths(iter::repeat_n(steps, count));
    let seen = list(Arc::new(items), OffsetBuffer::from_lengths(lengths))?;
    let elsewhere = Arc::new(Float64Array::from(vec![1e-6; sightings]));
    let batch = RecordBatch::try_from_iter([
        ("trace_id", Arc::new(Int64Array::from_iter_values(0..count as i64)) as ArrayRef),
        ("observation", Arc::new(list(Arc::new(seen), by_drive())?) as ArrayRef),
        ("elsewhere", Arc::new(list(elsewhere, by_drive())?) as ArrayRef),
    ])?;
    let mut writer = ArrowWriter::try_new(File::create(&arguments.output)?, batch.schema(), None)?;
    for first in (0..count).step_by(1000) {
        writer.write(&batch.slice(first, 1000.min(count - first)))?;
        writer.flush()?;
    }
    writer.close()?;
    Ok(ends)
}
