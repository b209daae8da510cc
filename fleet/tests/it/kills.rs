//! Commands that are killed and repeated give the same results as without a kill.
//!
//! `WAYFIX_KILLS` is the number of kills per command; few by default.

use std::fs;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::thread;
use std::time::Instant;

use rand::RngExt;

use crate::kit::*;

/// A command without its output, and the other files it makes.
struct Case {
    arguments: &'static [&'static str],
    input: &'static str,
    ending: &'static str,
    skips: bool,
}

const CASES: [Case; 6] = [
    Case { arguments: &["smooth"], input: "drives.parquet", ending: "parquet", skips: true },
    Case {
        arguments: &["filter", "--table", "best", "--count", "2", "--compression", "zstd"],
        input: "drives.parquet",
        ending: "parquet",
        skips: true,
    },
    Case { arguments: &["decode"], input: "nested.parquet", ending: "parquet", skips: false },
    Case { arguments: &["score"], input: "drives.csv", ending: "parquet", skips: true },
    Case { arguments: &["smooth"], input: "drives.csv", ending: "parquet", skips: false },
    Case {
        arguments: &["learn", "--iterations", "12", "--tolerance", "0"],
        input: "nested.parquet",
        ending: "json",
        skips: false,
    },
];

impl Case {
    fn command(&self, folder: &Folder, name: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_wayfix-fleet"));
        command.args(self.arguments).arg("--quiet");
        command.arg("--model").arg(folder.path("model.json"));
        command.arg("--input").arg(folder.path(self.input));
        let [output, left_out] = self.outputs(folder, name);
        command.arg("--output").arg(output);
        if self.skips {
            command.arg("--skip-invalid").arg(left_out);
        }
        if self.ending == "parquet" {
            command.args(["--part", "500"]);
        }
        command.stdout(Stdio::null());
        command
    }

    fn outputs(&self, folder: &Folder, name: &str) -> [PathBuf; 2] {
        [self.ending, "jsonl"].map(|ending| folder.path(&format!("{name}.{ending}")))
    }

    fn made(&self, folder: &Folder, name: &str) -> Vec<Vec<u8>> {
        let outputs = self.outputs(folder, name);
        let outputs = outputs.iter().take(if self.skips { 2 } else { 1 });
        outputs.map(|path| fs::read(path).unwrap()).collect()
    }
}

fn kills() -> usize {
    let kills = std::env::var("WAYFIX_KILLS").ok();
    kills.map_or(4, |kills| kills.parse().expect("WAYFIX_KILLS is a number"))
}

#[test]
fn the_same_bytes_after_any_number_of_kills() {
    let folder = Folder::new(&model(3));
    let some = drives(33, 3000, 1, 60);
    folder.write("nested.parquet", &nested(&some), 500);
    let mut faulty = some.clone();
    for drive in (0..3000).step_by(97) {
        faulty[drive][0] = 9;
    }
    folder.write("drives.parquet", &long(&faulty), 7000);
    let mut text = String::from("trace_id,step,observation\n");
    for (id, drive) in some.iter().enumerate() {
        for (k, symbol) in drive.iter().enumerate() {
            text += &format!("{id:04},{},{symbol}\n", step(k));
        }
    }
    fs::write(folder.path("drives.csv"), text).unwrap();

    for (seed, case) in CASES.iter().enumerate() {
        let mut rng = rng(seed as u64);
        let start = Instant::now();
        assert!(case.command(&folder, "whole").status().unwrap().success());
        let whole = start.elapsed();
        let expected = case.made(&folder, "whole");
        let (mut killed, mut runs, mut went_on) = (0, 0, 0);
        while killed < kills() {
            let mut kills_of_run = 0;
            loop {
                let mut child = case.command(&folder, "out").spawn().unwrap();
                // Times that only get shorter would never let a run finish.
                let most = if kills_of_run < 6 { 0.9 } else { 3.0 };
                thread::sleep(whole.mul_f64(rng.random_range(0.0..most)));
                // Fails if the process has already ended.
                _ = child.kill();
                if child.wait().unwrap().success() {
                    break;
                }
                (killed, kills_of_run) = (killed + 1, kills_of_run + 1);
            }
            (runs, went_on) = (runs + 1, went_on + usize::from(kills_of_run > 0));
            let found = case.made(&folder, "out");
            assert!(found == expected, "{:?} after {killed} kills", case.arguments);
            let mut names = fs::read_dir(folder.dir.path()).unwrap();
            let name = |entry: std::io::Result<fs::DirEntry>| entry.unwrap().file_name();
            let leftover = names.find_map(|entry| {
                let name = name(entry).into_string().unwrap();
                name.contains(".partial").then_some(name)
            });
            assert_eq!(leftover, None, "{:?}", case.arguments);
            for path in case.outputs(&folder, "out") {
                _ = fs::remove_file(path);
            }
        }
        for path in case.outputs(&folder, "whole") {
            _ = fs::remove_file(path);
        }
        eprintln!("{:?}: {killed} kills in {runs} runs, {went_on} of them killed", case.arguments);
    }
}

/// Two processes at once: one gets the output, the other says so.
#[test]
fn two_processes_do_not_share_an_output() {
    let folder = Folder::new(&model(3));
    let some = drives(33, 3000, 1, 60);
    folder.write("nested.parquet", &nested(&some), 500);
    for case in [&CASES[2], &CASES[5]] {
        let mut both = [0, 1].map(|_| {
            let mut command = case.command(&folder, "out");
            command.stderr(Stdio::piped()).spawn().unwrap()
        });
        let done = both.each_mut().map(|child| child.wait().unwrap().success());
        let said = both.map(|child| {
            let said = child.wait_with_output().unwrap().stderr;
            String::from_utf8(said).unwrap()
        });
        for (done, said) in done.iter().zip(&said) {
            // The second process may also start when everything is done.
            let is_refused =
                said.contains("another run holds the lock on") || said.contains("exists");
            assert!(*done || is_refused, "{said}");
        }
        assert!(done.contains(&true), "{said:?}");
        let found = case.made(&folder, "out");
        case.outputs(&folder, "out").iter().for_each(|path| _ = fs::remove_file(path));
        assert!(case.command(&folder, "out").status().unwrap().success());
        assert!(case.made(&folder, "out") == found, "{:?}", case.arguments);
    }
}
