//! Runs that are interrupted.

use std::fs::{self, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::process::{Command, Stdio};
use std::thread;
use std::time::Instant;

use rand::RngExt;
use wayfix_fleet::output::{Table, Verb};
use wayfix_fleet::{Start, run};

use crate::kit::*;

/// A command on 6,000 drives, and the results without an interruption.
pub(crate) fn prepare(form: &str) -> (Folder, Vec<u8>) {
    let folder = Folder::new(&model(3));
    let drives = drives(33, 6000, 1, 60);
    let rows = if form == "long" { long(&drives) } else { nested(&drives) };
    folder.write("drives.parquet", &rows, 7000);
    let expected = folder.path("expected.parquet");
    let job = folder.job("drives.parquet", "expected.parquet", Verb::Smooth, Table::Steps);
    let parts = run(&job, |_| {}).unwrap().parts;
    assert!(parts > 1, "{parts}");
    let bytes = fs::read(expected).unwrap();
    (folder, bytes)
}

fn command(folder: &Folder) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_wayfix-fleet"));
    command.args(["smooth", "--quiet", "--part", "300"]);
    for (option, name) in
        [("--model", "model.json"), ("--input", "drives.parquet"), ("--output", "out.parquet")]
    {
        command.arg(option).arg(folder.path(name));
    }
    command.stdout(Stdio::null());
    command
}

/// Kills the command at random moments until a run finishes.
#[test]
fn a_killed_run_goes_on() {
    for form in ["long", "nested"] {
        let (folder, expected) = prepare(form);
        let output = folder.path("out.parquet");
        let start = Instant::now();
        assert!(command(&folder).status().unwrap().success());
        let whole = start.elapsed();
        assert!(fs::read(&output).unwrap() == expected);
        for seed in 0..10 {
            fs::remove_file(&output).unwrap();
            let mut rng = rng(seed);
            let mut kills = 0;
            loop {
                let mut child = command(&folder).spawn().unwrap();
                if kills < 4 {
                    thread::sleep(whole.mul_f64(rng.random_range(0.0..1.2)));
                    // Fails if the process has already ended.
                    _ = child.kill();
                    kills += 1;
                }
                let done = child.wait().unwrap().success();
                let complete = output.exists() && !folder.has_leftovers();
                // A kill may also come after everything is done.
                assert!(complete || !done, "{form}, seed {seed}");
                if complete {
                    break;
                }
                assert!(kills <= 4);
                if output.exists() {
                    // Killed between the last two steps: the file is complete.
                    assert!(fs::read(&output).unwrap() == expected, "seed {seed}");
                }
            }
            assert!(fs::read(&output).unwrap() == expected, "{form}, seed {seed}, {kills} kills");
        }
    }
}

/// Leaves a run with some parts behind, by a panic halfway.
pub(crate) fn interrupt(folder: &Folder) -> wayfix_fleet::Job {
    let job = folder.job("drives.parquet", "out.parquet", Verb::Smooth, Table::Steps);
    let limited = job.clone();
    let stopped = thread::spawn(move || {
        run(&limited, |progress| assert!(progress.drives < 3000, "interrupted"))
    });
    assert!(stopped.join().is_err());
    assert!(folder.has_leftovers() && !job.output.exists());
    job
}

#[test]
fn finished_parts_are_not_made_again() {
    let (folder, expected) = prepare("long");
    let job = interrupt(&folder);
    let summary = run(&job, |_| {}).unwrap();
    assert!(summary.resumed > 0 && summary.resumed < summary.parts, "{summary:?}");
    assert_eq!(summary.drives, 6000);
    assert!(fs::read(&job.output).unwrap() == expected);
}

#[test]
fn damaged_parts_are_made_again() {
    let (folder, expected) = prepare("long");
    let partial = folder.path("out.parquet.partial");
    let journal = folder.path("out.parquet.journal");
    let damages: [&dyn Fn(); 5] = [
        // Bytes that never reached the disk.
        &|| OpenOptions::new().write(true).open(&partial).unwrap().set_len(5000).unwrap(),
        &|| {
            let mut file = OpenOptions::new().read(true).write(true).open(&partial).unwrap();
            let mut byte = [0];
            file.seek(SeekFrom::Start(4000)).unwrap();
            file.read_exact(&mut byte).unwrap();
            file.seek(SeekFrom::Start(4000)).unwrap();
            file.write_all(&[!byte[0]]).unwrap();
        },
        &|| fs::remove_file(&partial).unwrap(),
        // A line that was cut off.
        &|| {
            let text = fs::read(&journal).unwrap();
            fs::write(&journal, &text[..text.len() - 30]).unwrap();
        },
        &|| fs::write(&journal, "").unwrap(),
    ];
    for (number, damage) in damages.iter().enumerate() {
        let job = interrupt(&folder);
        damage();
        run(&job, |_| {}).unwrap();
        assert!(fs::read(&job.output).unwrap() == expected, "damage {number}");
        fs::remove_file(&job.output).unwrap();
    }
}

#[test]
fn another_run_does_not_go_on() {
    let (folder, expected) = prepare("nested");
    let mut job = interrupt(&folder);
    job.part = 400;
    let error = run(&job, |_| {}).unwrap_err().to_string();
    assert!(error.contains("part is 400, was 300"), "{error}");
    job.part = 300;
    fs::write(folder.path("model.json"), serde_json::to_vec(&model(4)).unwrap()).unwrap();
    let error = run(&job, |_| {}).unwrap_err().to_string();
    assert!(error.contains("model is"), "{error}");
    fs::write(folder.path("model.json"), serde_json::to_vec(&model(3)).unwrap()).unwrap();

    job.start.restart = true;
    assert_eq!(run(&job, |_| {}).unwrap().resumed, 0);
    assert!(fs::read(&job.output).unwrap() == expected);

    // A complete output is not replaced without --force.
    job.start = Start::default();
    job.part = 400;
    let error = run(&job, |_| {}).unwrap_err().to_string();
    assert!(error.contains("exists; replace it with --force"), "{error}");
    job.part = 300;
    job.start.force = true;
    run(&job, |_| {}).unwrap();
    assert!(!folder.has_leftovers());
}

#[test]
fn two_runs_do_not_share_an_output() {
    let (folder, _) = prepare("nested");
    let job = folder.job("drives.parquet", "out.parquet", Verb::Smooth, Table::Steps);
    let mut errors = Vec::new();
    run(&job, |_| {
        if errors.is_empty() {
            errors.push(run(&job, |_| {}).unwrap_err().to_string());
        }
    })
    .unwrap();
    assert!(errors[0].contains("another run holds the lock on"), "{errors:?}");
    assert!(job.output.exists());
}
