//! Runs that are killed, and continue.

use std::fs;
use std::io::{Cursor, Write};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use rand::RngExt;
use serde_json::{Value, json};
use wayfix_fleet::model::Model;
use wayfix_fleet::pool::{Control, ServiceJob, Timing, Update, position, serve};

use crate::filters::updates;
use crate::kit::*;
use crate::service::*;

/// Kills at random moments.
const KILLS: usize = 50;

#[test]
fn kills_at_any_moment_lose_and_double_nothing() {
    let folder = Folder::new(&model(1));
    let text = lines(1, 60_000);
    let input = folder.path("seen");
    fs::write(&input, &text).unwrap();
    let timing = Timing { forget_after: Some(20_000), ..Timing::default() };
    let mut expected = Vec::new();
    let whole = ServiceJob { timing, ..job(&folder) };
    let text = Cursor::new(text.into_bytes());
    serve(&whole, &Control::new(), text, &mut expected, |_| ()).unwrap();
    let (output, snapshot) = (folder.path("positions"), folder.path("pool.bin"));
    let arguments = [
        "--restore",
        snapshot.to_str().unwrap(),
        "--snapshot",
        snapshot.to_str().unwrap(),
        "--output",
        output.to_str().unwrap(),
        "--forget-after",
        "20000",
        "--every",
        "0.002",
        "--replay",
    ];
    let mut rng = rng(20);
    let (mut killed, mut with_some) = (0, 0);
    while killed < KILLS {
        let mut child = command(&folder, &arguments);
        let mut child = child.stdin(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        let mut to_child = child.stdin.take().unwrap();
        let input = fs::read(&input).unwrap();
        // As much of the input as this run needs, in parts.
        let mut rest = input.len() * (killed + 2) / (KILLS + 2);
        let feeder = std::thread::spawn(move || {
            for part in input.chunks(20_000) {
                let part = &part[..part.len().min(rest)];
                if part.is_empty() || to_child.write_all(part).is_err() {
                    break;
                }
                rest -= part.len();
            }
            to_child
        });
        let before = fs::metadata(&output).map_or(0, |found| found.len());
        let more = expected.len() as u64 * 3 / 5 / KILLS as u64;
        let goal = (before + rng.random_range(0..more)).min(expected.len() as u64 * 3 / 4);
        let start = Instant::now();
        // This run may get no further than the one before.
        while fs::metadata(&output).map_or(0, |found| found.len()) <= goal
            && start.elapsed() < Duration::from_millis(60)
        {
            std::thread::sleep(Duration::from_micros(rng.random_range(50..2000)));
        }
        child.kill().unwrap();
        child.wait().unwrap();
        drop(feeder.join().unwrap());
        killed += 1;
        with_some += usize::from(
            snapshot.exists() && position(&snapshot).unwrap().unwrap_or_default().lines > 0,
        );
    }
    assert!(with_some > KILLS / 4, "{with_some} of the kills came after a snapshot");
    let mut last = command(&folder, &arguments);
    let status = last.stdin(fs::File::open(&input).unwrap()).stderr(Stdio::null()).status();
    assert!(status.unwrap().success());
    assert!(fs::read(&output).unwrap() == expected);
    let at = position(&snapshot).unwrap().unwrap();
    assert_eq!((at.lines, at.answers), (60_000, expected.len() as u64));
    assert_eq!(at.bytes, fs::metadata(&input).unwrap().len());

    // A run continues with a file that has grown; a shorter one is another file.
    let mut more = fs::OpenOptions::new().append(true).open(&input).unwrap();
    more.write_all(line(7, 70_000, 3).as_bytes()).unwrap();
    let mut again = arguments[..arguments.len() - 1].to_vec();
    again.extend(["--input", input.to_str().unwrap()]);
    let status = command(&folder, &again).output().unwrap();
    let said = String::from_utf8(status.stderr).unwrap();
    assert!(said.starts_with("1 lines, 0 with an error"), "{said}");
    fs::write(&input, line(7, 70_000, 3)).unwrap();
    let refused = command(&folder, &again).output().unwrap();
    let said = String::from_utf8(refused.stderr).unwrap();
    assert!(!refused.status.success() && said.contains("another input"), "{said}");
}

#[test]
fn an_output_of_which_nobody_knows_what_counts_is_left_alone() {
    let folder = Folder::new(&model(1));
    let (output, snapshot) = (folder.path("positions"), folder.path("pool.bin"));
    fs::write(&output, "of another run\n").unwrap();
    let mut job = job(&folder);
    job.live.restore = Some(snapshot.clone());
    job.live.snapshot = Some(snapshot.clone());
    job.output = Some(output.clone());
    let run = || serve(&job, &Control::new(), Cursor::new(line(1, 1, 1)), Vec::new(), |_| ());
    assert!(run().unwrap_err().to_string().contains("exists"));
    assert_eq!(fs::read(&output).unwrap(), b"of another run\n");
    assert!(!snapshot.exists());
    fs::remove_file(&output).unwrap();
    assert_eq!(run().unwrap().lines, 1);
    // A file shorter than the snapshot says.
    fs::write(&output, "").unwrap();
    assert!(run().unwrap_err().to_string().contains("bytes of answers"));
}

#[test]
fn the_first_run_has_no_snapshot_to_restore() {
    let folder = Folder::new(&model(1));
    let snapshot = Some(folder.path("pool.bin"));
    let mut job = job(&folder);
    (job.live.restore, job.live.snapshot) = (snapshot.clone(), snapshot);
    let (summary, _) = answers(&job, &line(7, 0, 3));
    assert_eq!((summary.errors, summary.vehicles), (0, 1));
    // The second continues where the first ended.
    let (summary, found) = answers(&job, &line(7, 0, 3));
    assert_eq!((summary.errors, &found[0]["error_kind"]), (1, &json!("time")));
    // A snapshot under another name must exist.
    job.live.restore = Some(folder.path("other.bin"));
    assert!(serve(&job, &Control::new(), Cursor::new(""), Vec::new(), |_| ()).is_err());
}

#[test]
fn the_command_goes_on_from_its_snapshot() {
    let hmm = model(5);
    let folder = Folder::new(&hmm);
    let mut rng = rng(9);
    let seen = updates(&mut rng, 3000, |rng| rng.random_range(0..6));
    let line = |update: &Update<usize>| {
        let Update { vehicle, time, observation, restart } = update;
        let vehicle = serde_json::to_value(vehicle).unwrap();
        let line = json!({
            "vehicle": vehicle, "time": time, "observation": observation, "restart": restart
        });
        format!("{line}\n")
    };
    let text: Vec<String> = seen.iter().map(line).collect();
    let (_, expected) = answers(&job(&folder), &text.concat());
    let snapshot = folder.path("pool.bin");
    let run = |arguments: &[&str], text: String| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_wayfix-fleet"));
        command.args(["live", "--threads", "2"]).args(arguments);
        command.arg("--model").arg(folder.path("model.json"));
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let mut input = child.stdin.take().unwrap();
        let writer = std::thread::spawn(move || input.write_all(text.as_bytes()));
        let output = child.wait_with_output().unwrap();
        _ = writer.join().unwrap();
        let text = String::from_utf8(output.stdout).unwrap();
        let lines: Vec<Value> =
            text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        (output.status.success(), lines, String::from_utf8(output.stderr).unwrap())
    };
    let name = snapshot.to_str().unwrap();
    let spill = folder.path("spill");
    let limit = ["--memory", "16K", "--spill", spill.to_str().unwrap()];
    let (mut found, mut before) = (Vec::new(), Vec::new());
    for (part, lines) in text.chunks(1000).enumerate() {
        let mut arguments = vec!["--snapshot", name];
        arguments.extend(if part > 0 { vec!["--restore", name] } else { vec![] });
        arguments.extend(if part == 1 { vec![] } else { limit.to_vec() });
        let (success, lines, summary) = run(&arguments, lines.concat());
        assert!(success, "{summary}");
        assert!(summary.starts_with("1000 lines, "), "{summary}");
        found.extend(lines);
        before = fs::read(&snapshot).unwrap();
    }
    assert_eq!(found.len(), expected.len());
    for (at, (found, expected)) in found.iter().zip(&expected).enumerate() {
        assert_eq!(found, expected, "line {at}");
    }
    // Another model: nothing is read, and the snapshot is kept.
    let hash = Model::load(&folder.path("model.json")).unwrap().hash().to_owned();
    fs::write(folder.path("model.json"), serde_json::to_vec(&model(6)).unwrap()).unwrap();
    let (success, lines, error) =
        run(&["--restore", name, "--snapshot", name], text[..10].concat());
    assert!(!success && lines.is_empty() && error.contains(&hash), "{error}");
    assert_eq!(fs::read(&snapshot).unwrap(), before);
    assert!(!run(&["--memory", "16K"], String::new()).0, "no folder");
}
