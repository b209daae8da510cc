//! Times the service of live vehicles, without and with snapshots in turn: lines per second at full
//! speed, and latency of answers while lines come at a steady rate.
//!
//! ```text
//! cargo run --release --example service -- --model model.json --folder FOLDER
//! ```
//!
//! The example `simulate` writes the model, which needs a table of symbols.

use std::error::Error;
use std::io::{BufRead, BufReader, Read, Write, pipe};
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::SeqCst};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;
use std::time::{Duration, Instant};

use clap::Parser;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use wayfix::{Hmm, SparseTransition, TableLikelihood};
use wayfix_fleet::pool::{Control, LiveJob, Notice, PoolOptions, ServiceJob, serve};

#[derive(Debug, Clone, Parser)]
struct Arguments {
    /// Model with a sparse operator and a table.
    #[arg(long)]
    model: PathBuf,
    /// Folder for the snapshot and the answers.
    #[arg(long)]
    folder: PathBuf,
    /// Number of vehicles.
    #[arg(long, default_value_t = 1_000_000)]
    vehicles: usize,
    /// Lines per second of the steady part.
    #[arg(long, default_value_t = 50_000)]
    rate: usize,
    /// Seconds of each measurement, with a snapshot at its beginning and every ten seconds.
    #[arg(long, default_value_t = 20)]
    seconds: u64,
    /// Sends lines over a connection, and also writes answers to a file, which is synced before a
    /// snapshot.
    #[arg(long)]
    output: bool,
    /// Number of rounds.
    #[arg(long, default_value_t = 2)]
    rounds: usize,
}

/// Time between two snapshots.
const EVERY: Duration = Duration::from_secs(10);

/// Lines of random vehicles.
struct Lines {
    rng: ChaCha8Rng,
    steps: Vec<u32>,
    drives: Vec<Vec<usize>>,
    input: Box<dyn Write>,
    text: Vec<u8>,
    /// Number of lines.
    sent: u64,
}

impl Lines {
    fn send(&mut self, vehicles: impl Iterator<Item = usize>) -> std::io::Result<()> {
        self.text.clear();
        for vehicle in vehicles {
            self.sent += 1;
            let step = self.steps[vehicle] as usize;
            self.steps[vehicle] += 1;
            let drive = &self.drives[vehicle % self.drives.len()];
            let symbol = drive[step % drive.len()];
            writeln!(
                self.text,
                r#"{{"vehicle": {vehicle}, "time": {step}, "observation": {symbol}}}"#
            )?;
        }
        self.input.write_all(&self.text)
    }

    fn send_some(&mut self, count: usize) -> std::io::Result<()> {
        let all = self.steps.len();
        let vehicles: Vec<usize> = (0..count).map(|_| self.rng.random_range(0..all)).collect();
        self.send(vehicles.into_iter())
    }
}

/// Number of answers received.
#[derive(Debug, Default)]
struct Answers {
    count: AtomicU64,
}

impl Answers {
    fn read(&self, output: impl Read, times: &Sender<(u64, Instant)>) {
        let mut output = BufReader::with_capacity(1 << 16, output);
        loop {
            let Ok(bytes) = output.fill_buf() else { return };
            if bytes.is_empty() {
                return;
            }
            let (ends, length) = (bytes.split(|&byte| byte == b'\n').count(), bytes.len());
            let count = ends - 1;
            output.consume(length);
            let all = self.count.fetch_add(count as u64, SeqCst) + count as u64;
            _ = times.send((all, Instant::now()));
        }
    }

    fn wait_for(&self, count: u64) {
        while self.count.load(SeqCst) < count {
            thread::sleep(Duration::from_micros(200));
        }
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments = Arguments::parse();
    let model: Hmm<SparseTransition, TableLikelihood> =
        serde_json::from_slice(&std::fs::read(&arguments.model)?)?;
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let drives = (0..5000).map(|_| model.simulate(64, &mut rng).observations().to_vec()).collect();
    let ((from, input), (output, to)) = (pipe()?, pipe()?);
    let mut ends: (Box<dyn Write>, Box<dyn Read + Send>) = (Box::new(input), Box::new(output));
    let control = Control::new();
    let snapshot = arguments.folder.join("pool.bin");
    let positions = arguments.folder.join("positions");
    let socket = arguments.folder.join("socket");
    let mut job = ServiceJob::new(LiveJob {
        model: arguments.model.clone(),
        restore: None,
        snapshot: Some(snapshot.clone()),
        options: PoolOptions::default(),
    });
    if arguments.output {
        job.output = Some(positions.clone());
        job.listen = Some(format!("unix:{}", socket.display()));
    }
    let of_run = control.clone();
    let run = thread::spawn(move || {
        serve(&job, &of_run, from, to, |notice| {
            if let Notice::Snapshot { .. } = notice {
                println!("    {notice}");
            }
        })
    });
    if arguments.output {
        let stream = loop {
            match UnixStream::connect(&socket) {
                Err(_) if !run.is_finished() => thread::sleep(Duration::from_millis(10)),
                stream => break stream?,
            }
        };
        ends = (Box::new(stream.try_clone()?), Box::new(stream));
    }
    let (input, output) = ends;
    let answers = Arc::new(Answers::default());
    let (times, come) = channel();
    let reads = Arc::clone(&answers);
    thread::spawn(move || reads.read(output, &times));

    let steps = vec![0; arguments.vehicles];
    let mut lines = Lines { rng, steps, drives, input, text: Vec::new(), sent: 0 };
    for first in (0..arguments.vehicles).step_by(1000) {
        let next = first..arguments.vehicles.min(first + 1000);
        lines.send(next)?;
    }
    answers.wait_for(lines.sent);

    let parts = [false, true].repeat(arguments.rounds);
    for &with in &parts {
        let snapshots = Snapshots::begin(&control, with);
        time_rate(&arguments, &mut lines, &answers, with)?;
        snapshots.end();
    }
    for &with in &parts {
        while come.try_recv().is_ok() {}
        let snapshots = Snapshots::begin(&control, with);
        time_waits(&arguments, &mut lines, &answers, &come, with)?;
        snapshots.end();
    }
    drop(lines);
    control.stop();
    let summary = run.join().map_err(|_| "the run has panicked")??;
    println!("{summary:?}");
    std::fs::remove_file(snapshot)?;
    if arguments.output {
        std::fs::remove_file(positions)?;
    }
    Ok(())
}

/// Times lines sent as fast as they are taken.
fn time_rate(
    arguments: &Arguments,
    lines: &mut Lines,
    answers: &Answers,
    with: bool,
) -> Result<(), Box<dyn Error>> {
    let (start, first) = (Instant::now(), lines.sent);
    while start.elapsed() < Duration::from_secs(arguments.seconds) {
        lines.send_some(500)?;
    }
    answers.wait_for(lines.sent);
    let rate = (lines.sent - first) as f64 / start.elapsed().as_secs_f64();
    println!("{:17} {rate:9.0} lines a second", name(with));
    Ok(())
}

/// Times the latency of answers from the moment at which a line was due, so waiting behind other
/// lines counts, too.
fn time_waits(
    arguments: &Arguments,
    lines: &mut Lines,
    answers: &Answers,
    come: &Receiver<(u64, Instant)>,
    with: bool,
) -> Result<(), Box<dyn Error>> {
    let start = Instant::now();
    let mut asked = Vec::new();
    for tick in 0..1000 * arguments.seconds {
        let due = start + Duration::from_millis(tick);
        thread::sleep(due.saturating_duration_since(Instant::now()));
        lines.send_some(arguments.rate / 1000)?;
        asked.push((lines.sent, due));
    }
    answers.wait_for(lines.sent);
    thread::sleep(Duration::from_millis(100));
    let mut asked = asked.into_iter().peekable();
    let mut waits = Vec::new();
    for (count, moment) in come.try_iter() {
        while let Some((_, due)) = asked.next_if(|(last, _)| *last <= count) {
            waits.push(moment.saturating_duration_since(due).as_secs_f64() * 1e3);
        }
    }
    waits.sort_by(f64::total_cmp);
    let at = |part: f64| waits[((waits.len() - 1) as f64 * part) as usize];
    println!(
        "{:17} {} lines a second, answered after {:.1} ms (median), {:.1} (99%), {:.1} (99.9%), \
         {:.1} (all)",
        name(with),
        arguments.rate,
        at(0.5),
        at(0.99),
        at(0.999),
        at(1.0)
    );
    Ok(())
}

fn name(with: bool) -> &'static str {
    if with { "with snapshots" } else { "without snapshots" }
}

/// Requests snapshots, as `--every` does.
struct Snapshots {
    is_over: Arc<AtomicBool>,
    thread: thread::JoinHandle<()>,
}

impl Snapshots {
    fn begin(control: &Control, with: bool) -> Self {
        let is_over = Arc::new(AtomicBool::new(!with));
        let (over, control) = (Arc::clone(&is_over), control.clone());
        let thread = thread::spawn(move || {
            while !over.load(SeqCst) {
                control.snapshot();
                let next = Instant::now() + EVERY;
                while !over.load(SeqCst) && Instant::now() < next {
                    thread::sleep(Duration::from_millis(50));
                }
            }
        });
        Self { is_over, thread }
    }

    fn end(self) {
        self.is_over.store(true, SeqCst);
        _ = self.thread.join();
        // The last one is written.
        thread::sleep(Duration::from_secs(4));
    }
}
