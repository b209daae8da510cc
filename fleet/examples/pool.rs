//! Times a pool of live vehicles, and prints its memory.
//!
//! ```text
//! cargo run --release --example pool -- --model model.json --vehicles 1000000 --folder FOLDER
//! ```
//!
//! The example `canberra` writes the model. Every vehicle drives on it; updates come in batches, in
//! random order of the vehicles. The folder receives the snapshot and, in the last part, the
//! vehicles beyond the memory limit.

use std::error::Error;
use std::fs;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use clap::Parser;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use wayfix::{Hmm, SparseTransition};
use wayfix_fleet::model::{Model, Operator};
use wayfix_fleet::pool::{Pool, PoolOptions, Update};
use wayfix_fleet::sensor::{Observation, Sensor};

#[derive(Debug, Parser)]
struct Arguments {
    /// Model with a sparse operator and a table.
    #[arg(long)]
    model: PathBuf,
    /// Folder for files.
    #[arg(long)]
    folder: PathBuf,
    /// Number of vehicles.
    #[arg(long, default_value_t = 1_000_000)]
    vehicles: usize,
    /// Timed updates per vehicle, on average.
    #[arg(long, default_value_t = 5)]
    rounds: usize,
    /// Updates in a batch.
    #[arg(long, default_value_t = 100_000)]
    batch: usize,
    /// Threads; by default one per core.
    #[arg(long)]
    threads: Option<usize>,
    /// Also writes the updates as lines of JSON, for the command `live`.
    #[arg(long)]
    lines: Option<PathBuf>,
}

type Road = Hmm<SparseTransition, Sensor>;

/// Simulated vehicles on the roads.
struct Fleet {
    rng: ChaCha8Rng,
    /// Steps that each vehicle has taken, and its current drive.
    steps: Vec<u32>,
    drives: Vec<Vec<usize>>,
}

impl Fleet {
    /// The next updates, of random vehicles (`next` is `None`) or of all in order.
    fn batch(&mut self, first: Option<usize>, count: usize) -> Vec<Update<Observation>> {
        let vehicles = self.steps.len();
        let update = |k: usize| {
            let vehicle = first.map_or_else(|| self.rng.random_range(0..vehicles), |at| at + k);
            let step = self.steps[vehicle] as usize;
            self.steps[vehicle] += 1;
            let drive = &self.drives[vehicle % self.drives.len()];
            let symbol = drive[step % drive.len()];
            Update::new(vehicle as i64, step as i64, Observation::Symbol(symbol))
        };
        (0..count).map(update).collect()
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments = Arguments::parse();
    let model = Model::load(&arguments.model)?;
    let Operator::Sparse(hmm) = model.operator() else { return Err("not a sparse model".into()) };
    let hmm: Arc<Road> = Arc::new(hmm.clone());
    let simulated: Hmm<SparseTransition, wayfix::TableLikelihood> =
        serde_json::from_slice(&fs::read(&arguments.model)?)?;
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let drives = (0..5000).map(|_| simulated.simulate(64, &mut rng).observations().to_vec());
    let drives = drives.collect();
    let mut fleet = Fleet { rng, steps: vec![0; arguments.vehicles], drives };

    let mut options = PoolOptions::default();
    options.threads = arguments.threads.unwrap_or(options.threads);
    println!("{} threads, {} states", options.threads, hmm.states());
    let before = resident();
    let mut pool = Pool::new(Arc::clone(&hmm), model.hash(), &options)?;
    let mut lines = Lines::new(arguments.lines.as_ref())?;

    let batches = |pool: &mut Pool<SparseTransition, Sensor>,
                   fleet: &mut Fleet,
                   lines: &mut Lines,
                   rounds: usize,
                   in_order: bool|
     -> Result<[f64; 3], Box<dyn Error>> {
        let (mut seconds, mut used, mut refused) = (0.0, 0.0, 0);
        for _ in 0..rounds {
            for first in (0..arguments.vehicles).step_by(arguments.batch) {
                let count = arguments.batch.min(arguments.vehicles - first);
                let batch = fleet.batch(in_order.then_some(first), count);
                lines.write(&batch)?;
                let (start, before) = (Instant::now(), processor());
                let answers = pool.update_all(&batch);
                seconds += start.elapsed().as_secs_f64();
                used += processor() - before;
                refused += answers.iter().filter(|answer| answer.is_err()).count();
            }
        }
        let count = (rounds * arguments.vehicles) as f64;
        Ok([count / seconds, used * 1e9 / count, refused as f64])
    };
    let report = |what: &str, [rate, each, refused]: [f64; 3]| {
        println!(
            "{what:45} {rate:10.0} a second, {each:6.0} ns of processor time each, {refused} refused"
        );
    };
    report("first updates", batches(&mut pool, &mut fleet, &mut lines, 1, true)?);
    let usage = pool.usage();
    println!(
        "{} vehicles, {} bytes each as counted, {} according to the system",
        usage.vehicles,
        usage.bytes / usage.vehicles.max(1),
        (resident() - before) / usage.vehicles.max(1)
    );
    let rounds = arguments.rounds;
    report(
        &format!("updates, {} a batch", arguments.batch),
        batches(&mut pool, &mut fleet, &mut lines, rounds, false)?,
    );
    lines.end()?;

    let file = arguments.folder.join("pool.bin");
    let start = Instant::now();
    let bytes = pool.snapshot(&file)?;
    let seconds = start.elapsed().as_secs_f64();
    println!("snapshot of {} MB in {seconds:.2} s", bytes >> 20);
    let start = Instant::now();
    let restored = Pool::restore(&file, Arc::clone(&hmm), model.hash(), &options)?;
    println!("restored in {:.2} s", start.elapsed().as_secs_f64());
    drop(restored);

    // Memory for fewer than a fifth of the vehicles.
    options.memory = Some(usage.bytes / 5);
    options.spill = Some(arguments.folder.join("spill"));
    drop(pool);
    let start = Instant::now();
    let mut pool = Pool::restore(&file, hmm, model.hash(), &options)?;
    let usage = pool.usage();
    println!(
        "restored with {} MB in {:.2} s: {} vehicles in memory, {} MB in all, files of {} MB",
        usage.bytes >> 20,
        start.elapsed().as_secs_f64(),
        usage.in_memory,
        usage.bytes >> 20,
        usage.file_bytes >> 20
    );
    let mut none = Lines::new(None)?;
    report("updates, most vehicles on disk", batches(&mut pool, &mut fleet, &mut none, 1, false)?);
    fs::remove_file(&file)?;
    Ok(())
}

/// Updates as lines of JSON.
struct Lines(Option<std::io::BufWriter<fs::File>>);

impl Lines {
    fn new(path: Option<&PathBuf>) -> std::io::Result<Self> {
        Ok(Self(path.map(fs::File::create).transpose()?.map(std::io::BufWriter::new)))
    }

    fn write(&mut self, batch: &[Update<Observation>]) -> std::io::Result<()> {
        use std::io::Write;
        let Some(file) = &mut self.0 else { return Ok(()) };
        for Update { vehicle, time, observation, .. } in batch {
            if let Observation::Symbol(symbol) = observation {
                writeln!(
                    file,
                    r#"{{"vehicle": {vehicle}, "time": {time}, "observation": {symbol}}}"#
                )?;
            }
        }
        Ok(())
    }

    fn end(self) -> std::io::Result<()> {
        use std::io::Write;
        self.0.map_or(Ok(()), |mut file| file.flush())
    }
}

/// Resident memory of this process in bytes, where the system reports it (Linux).
fn resident() -> usize {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    let kilobytes = line.and_then(|line| line.trim().strip_suffix(" kB")?.parse::<usize>().ok());
    kilobytes.unwrap_or(0) * 1024
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
