//! Runs of the command `live`, and lines for them.

use std::fmt::Write as _;
use std::fs;
use std::io::Cursor;
use std::path::Path;
#[cfg(unix)]
use std::process::Child;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use rand::RngExt;
use serde_json::{Value, json};
use wayfix_fleet::pool::{Control, LiveJob, LiveSummary, PoolOptions, ServiceJob, serve};

use crate::kit::*;

pub(crate) fn job(folder: &Folder) -> ServiceJob {
    ServiceJob::new(LiveJob {
        model: folder.path("model.json"),
        restore: None,
        snapshot: None,
        options: PoolOptions { threads: 2, memory: None, spill: None },
    })
}

/// Runs over a text, and returns the answers.
pub(crate) fn answers(job: &ServiceJob, text: &str) -> (LiveSummary, Vec<Value>) {
    let mut output = Vec::new();
    let input = Cursor::new(text.to_owned().into_bytes());
    let summary = serve(job, &Control::new(), input, &mut output, |_| ()).unwrap();
    let output = String::from_utf8(output).unwrap();
    (summary, output.lines().map(|line| serde_json::from_str(line).unwrap()).collect())
}

pub(crate) fn line(vehicle: i64, time: i64, seen: usize) -> String {
    format!("{}\n", json!({"vehicle": vehicle, "time": time, "observation": seen}))
}

/// Random lines of many vehicles, some of them bad, late, or removals.
pub(crate) fn lines(seed: u64, count: usize) -> String {
    let mut rng = rng(seed);
    let mut text = String::new();
    for at in 0..count as i64 {
        let vehicle = rng.random_range(0..500);
        match rng.random_range(0..100) {
            0 => text += "no line\n",
            1 => _ = writeln!(text, r#"{{"vehicle": {vehicle}, "remove": true}}"#),
            2 => text += &line(vehicle, at - 3000, 2),
            _ => {
                let seen = rng.random_range(0..5);
                _ = writeln!(
                    text,
                    r#"{{"vehicle": {vehicle}, "time": {at}, "observation": {seen}, "offset": {at}}}"#
                );
            }
        }
    }
    text
}

pub(crate) fn command(folder: &Folder, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_wayfix-fleet"));
    command.args(["live", "--threads", "2"]).args(arguments);
    command.arg("--model").arg(folder.path("model.json"));
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// Waits until a file has a given number of bytes.
pub(crate) fn wait_for(path: &Path, bytes: u64) {
    let start = Instant::now();
    while fs::metadata(path).map_or(0, |found| found.len()) < bytes {
        assert!(start.elapsed() < Duration::from_mins(1), "{} does not grow", path.display());
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[cfg(unix)]
pub(crate) fn signal(child: &Child, name: &str) {
    let id = child.id().to_string();
    assert!(Command::new("kill").args([&format!("-{name}"), &id]).status().unwrap().success());
}
