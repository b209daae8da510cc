//! The command `live` left alone: kills, signals, time, and models that change.

use std::fmt::Write as _;
use std::fs;
use std::io::{Cursor, Read, Write};
use std::net::TcpStream;
use std::num::NonZeroU64;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use rand::RngExt;
use rand::seq::SliceRandom;
use serde_json::{Value, json};
use wayfix_fleet::pool::{
    Control, LiveJob, LiveSummary, Notice, Pool, PoolOptions, ServiceJob, Timing, Update, position,
    serve,
};

use crate::kit::*;

fn job(folder: &Folder) -> ServiceJob {
    ServiceJob::new(LiveJob {
        model: folder.path("model.json"),
        restore: None,
        snapshot: None,
        options: PoolOptions { threads: 2, memory: None, spill: None },
    })
}

/// Runs over a text, and returns the answers.
fn answers(job: &ServiceJob, text: &str) -> (LiveSummary, Vec<Value>) {
    let mut output = Vec::new();
    let input = Cursor::new(text.to_owned().into_bytes());
    let summary = serve(job, &Control::new(), input, &mut output, |_| ()).unwrap();
    let output = String::from_utf8(output).unwrap();
    (summary, output.lines().map(|line| serde_json::from_str(line).unwrap()).collect())
}

fn line(vehicle: i64, time: i64, seen: usize) -> String {
    format!("{}\n", json!({"vehicle": vehicle, "time": time, "observation": seen}))
}

/// Lines of many vehicles at random, some of them bad, late, or of removals.
fn lines(seed: u64, count: usize) -> String {
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

fn command(folder: &Folder, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_wayfix-fleet"));
    command.args(["live", "--threads", "2"]).args(arguments);
    command.arg("--model").arg(folder.path("model.json"));
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// Waits until a file has so many bytes.
fn wait_for(path: &Path, bytes: u64) {
    let start = Instant::now();
    while fs::metadata(path).map_or(0, |found| found.len()) < bytes {
        assert!(start.elapsed() < Duration::from_mins(1), "{} does not grow", path.display());
        std::thread::sleep(Duration::from_millis(1));
    }
}

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
    while killed < 24 {
        let mut child = command(&folder, &arguments);
        let mut child = child.stdin(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        let mut to_child = child.stdin.take().unwrap();
        let input = fs::read(&input).unwrap();
        // As much of the input as will do for this run, in parts.
        let mut rest = input.len() * (killed + 2) / 26;
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
        let more = expected.len() as u64 / 40;
        let goal = (before + rng.random_range(0..more)).min(expected.len() as u64 * 3 / 4);
        let start = Instant::now();
        // It may be that this run gets no further than the one before.
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
    assert!(with_some > 5, "{with_some} of the kills came after a snapshot");
    let mut last = command(&folder, &arguments);
    let status = last.stdin(fs::File::open(&input).unwrap()).stderr(Stdio::null()).status();
    assert!(status.unwrap().success());
    assert!(fs::read(&output).unwrap() == expected);
    let at = position(&snapshot).unwrap().unwrap();
    assert_eq!((at.lines, at.answers), (60_000, expected.len() as u64));
    assert_eq!(at.bytes, fs::metadata(&input).unwrap().len());

    // A file that grows is gone on with; one that is shorter is another.
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
    // One that is shorter than the snapshot says.
    fs::write(&output, "").unwrap();
    assert!(run().unwrap_err().to_string().contains("bytes of answers"));
}

#[cfg(unix)]
fn signal(child: &Child, name: &str) {
    let id = child.id().to_string();
    assert!(Command::new("kill").args([&format!("-{name}"), &id]).status().unwrap().success());
}

#[cfg(unix)]
#[test]
fn signals_snapshot_and_end_in_order() {
    let folder = Folder::new(&model(1));
    for name in ["TERM", "INT"] {
        let (output, snapshot) =
            (folder.path(&format!("{name}.answers")), folder.path(&format!("{name}.bin")));
        let mut child = command(
            &folder,
            &[
                "--snapshot",
                snapshot.to_str().unwrap(),
                "--output",
                output.to_str().unwrap(),
                "--restore",
                snapshot.to_str().unwrap(),
                "--log",
                "json",
            ],
        );
        let mut child = child.stdin(Stdio::piped()).spawn().unwrap();
        let mut input = child.stdin.take().unwrap();
        // The last line has not ended, and is not taken.
        let text = format!("{}{}{{\"vehicle\": 3", line(1, 1, 2), line(2, 1, 2));
        input.write_all(text.as_bytes()).unwrap();
        wait_for(&output, 150);
        signal(&child, "USR1");
        let start = Instant::now();
        while position(&snapshot).unwrap().unwrap().lines < 2 {
            assert!(start.elapsed() < Duration::from_mins(1));
            std::thread::sleep(Duration::from_millis(2));
        }
        let before = fs::metadata(&output).unwrap().len();
        input.write_all(b", \"time\": 1, \"observation\": 2}\n").unwrap();
        wait_for(&output, before + 50);
        signal(&child, name);
        // The input is still open.
        let done = child.wait_with_output().unwrap();
        assert!(done.status.success());
        let at = position(&snapshot).unwrap().unwrap();
        let answered = fs::read_to_string(&output).unwrap();
        assert_eq!((at.lines, at.answers), (3, answered.len() as u64));
        assert_eq!(at.bytes, text.len() as u64 + 31);
        let log = String::from_utf8(done.stderr).unwrap();
        let events: Vec<Value> =
            log.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        let names: Vec<_> = events.iter().map(|event| event["event"].as_str().unwrap()).collect();
        assert_eq!(names, ["begin", "snapshot", "snapshot", "end"], "{log}");
        drop(input);
    }
}

#[test]
fn a_snapshot_is_of_one_moment_while_updates_go_on() {
    let folder = Folder::new(&model(1));
    let spill = folder.path("spill");
    for options in [
        PoolOptions { threads: 2, memory: None, spill: None },
        PoolOptions { threads: 2, memory: Some(100_000), spill: Some(spill) },
    ] {
        let hmm = std::sync::Arc::new(model(1));
        let mut pool = Pool::new(hmm.clone(), "model", &options).unwrap();
        let mut rng = rng(3);
        let mut batch = |time: i64, count: usize| -> Vec<Update<usize>> {
            (0..count)
                .map(|at| {
                    let vehicle = rng.random_range(0..3000);
                    Update::new(vehicle, time + at as i64, rng.random_range(0..5))
                })
                .collect()
        };
        let mut changed = 0;
        for round in 0..20 {
            let time = round * 100_000;
            pool.update_all(&batch(time, 5000));
            let (still, moving) = (folder.path("still.bin"), folder.path("moving.bin"));
            pool.snapshot(&still).unwrap();
            let writing = pool.begin_snapshot(&moving).unwrap();
            // One at a time; this one may just have ended.
            let second = pool.begin_snapshot(&folder.path("second.bin"));
            if let Ok(second) = second {
                second.wait().unwrap();
            }
            let mut next = time + 10_000;
            while !writing.is_finished() {
                changed += 1;
                pool.update_all(&batch(next, 200));
                pool.remove(&(next % 3000).into());
                pool.update(&Update::new(format!("new {next}"), next, 2)).unwrap();
                next += 200;
            }
            writing.wait().unwrap();
            let unlimited = PoolOptions { threads: 2, memory: None, spill: None };
            let open = |path: &Path| Pool::restore(path, hmm.clone(), "model", &unlimited).unwrap();
            let (still, moving) = (open(&still), open(&moving));
            assert_eq!(still.usage().vehicles, moving.usage().vehicles);
            let mut found = 0;
            for vehicle in (0..3000_i64).map(Into::into) {
                assert_eq!(still.time(&vehicle), moving.time(&vehicle));
                assert_eq!(still.state(&vehicle).unwrap(), moving.state(&vehicle).unwrap());
                found += usize::from(still.time(&vehicle).is_some());
            }
            assert!(found > 1000);
        }
        assert!(changed > 20, "{changed} batches came meanwhile");
    }
}

#[test]
fn vehicles_are_forgotten_and_removed() {
    let folder = Folder::new(&model(1));
    let job = ServiceJob {
        timing: Timing { forget_after: Some(10), ..Timing::default() },
        ..job(&folder)
    };
    let text = [
        line(1, 0, 3),
        line(2, 10, 3),
        line(1, 10, 2), // just kept
        line(3, 21, 3),
        line(1, 5, 3), // forgotten: begins anew, also at an earlier time
        line(4, 1000, 3),
        "{\"vehicle\": 4, \"remove\": true, \"offset\": 9}\n".to_owned(),
        "{\"vehicle\": 4, \"remove\": true}\n".to_owned(),
        line(4, 2, 3),
        "{\"remove\": true}\n".to_owned(),
    ];
    let (summary, found) = answers(&job, &text.concat());
    assert_eq!((summary.lines, summary.errors), (10, 1));
    assert_eq!(found[6], json!({"line": 7, "offset": 9, "vehicle": 4, "removed": true}));
    assert_eq!(found[7], json!({"line": 8, "vehicle": 4, "removed": false}));
    assert_eq!(found[9]["error_kind"], json!("line"));
    let hmm = model(1);
    let mut filter = hmm.filter();
    let first = filter.step(&3).unwrap();
    for at in [0, 1, 3, 4, 5, 8] {
        close(found[at]["log_likelihood"].as_f64().unwrap(), first);
    }
    close(found[2]["log_likelihood"].as_f64().unwrap(), filter.step(&2).unwrap());
    // All of the others are 990 units behind the latest.
    assert_eq!(summary.vehicles, 0);
}

#[test]
fn forgetting_does_not_depend_on_how_lines_come() {
    let folder = Folder::new(&model(1));
    let timing = Timing { forget_after: Some(300), ..Timing::default() };
    let text = lines(4, 4000);
    let whole = answers(&ServiceJob { timing, ..job(&folder) }, &text).1;
    let mut pieces = job(&folder);
    pieces.timing = timing;
    let snapshot = folder.path("pool.bin");
    pieces.live.restore = Some(snapshot.clone());
    pieces.live.snapshot = Some(snapshot);
    let mut found = Vec::new();
    let all: Vec<&str> = text.split_inclusive('\n').collect();
    for part in all.chunks(70) {
        found.extend(answers(&pieces, &part.concat()).1);
    }
    assert_eq!(found.len(), whole.len());
    for (at, (found, whole)) in found.iter_mut().zip(&whole).enumerate() {
        if found.get("line").is_some() {
            found["line"] = json!(at + 1);
        }
        assert_eq!(found, whole, "line {at}");
    }
}

#[test]
fn late_lines_are_put_in_order() {
    let folder = Folder::new(&model(1));
    let mut rng = rng(8);
    let mut seen: Vec<(i64, i64, usize)> =
        (0..3000).map(|time| (rng.random_range(0..40), time / 2, rng.random_range(0..5))).collect();
    // Each vehicle has one line at a time.
    seen.sort_unstable();
    seen.dedup_by_key(|line| (line.0, line.1));
    seen.sort_by_key(|line| line.1);
    let sorted: String = seen.iter().map(|&(id, time, see)| line(id, time, see)).collect();
    let (_, expected) = answers(&job(&folder), &sorted);
    assert!(expected.iter().all(|answer| answer.get("error").is_none()));
    // No line is more than 20 units behind a later one.
    seen.chunk_by_mut(|a, b| a.1 / 20 == b.1 / 20).for_each(|part| part.shuffle(&mut rng));
    let late = [line(3, 100, 2)];
    let text: Vec<String> = seen.iter().map(|&(id, time, see)| line(id, time, see)).collect();
    let lateness = ServiceJob { lateness: Some(20), ..job(&folder) };
    let (summary, found) =
        answers(&lateness, &[&text[..2000], &late, &text[2000..]].concat().concat());
    assert_eq!(summary.errors, 1);
    let (refused, mut found): (Vec<Value>, Vec<Value>) =
        found.into_iter().partition(|answer| answer.get("error").is_some());
    assert_eq!((&refused[0]["error_kind"], &refused[0]["line"]), (&json!("time"), &json!(2001)));
    let by = |answer: &Value| (answer["time"].as_i64(), answer["vehicle"].as_i64());
    let is_sorted = found.is_sorted_by_key(|answer| answer["time"].as_i64());
    assert!(is_sorted);
    found.sort_by_key(by);
    let mut expected = expected;
    expected.sort_by_key(by);
    assert_eq!(found, expected);

    // Stopped runs keep what waits.
    let snapshot = folder.path("pool.bin");
    let mut pieces = ServiceJob { lateness: Some(20), replay: true, ..job(&folder) };
    pieces.live.restore = Some(snapshot.clone());
    pieces.live.snapshot = Some(snapshot.clone());
    let mut output = Vec::new();
    for end in [700, 1500, text.len()] {
        let control = Control::new();
        let input = Cursor::new(text[..end].concat().into_bytes());
        if end < text.len() {
            let input = Stopping(input, control.clone());
            serve(&pieces, &control, input, &mut output, |_| ()).unwrap();
            let at = position(&snapshot).unwrap().unwrap();
            assert_eq!((at.lines, at.answers), (end as u64, output.len() as u64));
            assert!(!at.waiting.is_empty());
        } else {
            serve(&pieces, &Control::new(), input, &mut output, |_| ()).unwrap();
        }
    }
    let (_, whole) = answers(&ServiceJob { lateness: Some(20), ..job(&folder) }, &text.concat());
    let found = String::from_utf8(output).unwrap();
    let found: Vec<Value> = found.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(found, whole);
}

/// An input that does not end, but stops the run.
struct Stopping(Cursor<Vec<u8>>, Control);

impl Read for Stopping {
    fn read(&mut self, bytes: &mut [u8]) -> std::io::Result<usize> {
        let count = self.0.read(bytes)?;
        if count == 0 {
            self.1.stop();
            // Long after the run has ended.
            std::thread::sleep(Duration::from_mins(10));
        }
        Ok(count)
    }
}

#[test]
fn steps_follow_the_time() {
    let hmm = model(2);
    let folder = Folder::new(&hmm);
    let step = NonZeroU64::new(10);
    let timing = Timing { step, most_steps: NonZeroU64::new(50), ..Timing::default() };
    let job = ServiceJob { timing, ..job(&folder) };
    let times = [-7, -3, 3, 33, 34, 45, 1_000_000];
    let text: String = times.iter().map(|&time| line(1, time, 3)).collect();
    let (_, found) = answers(&job, &text);
    let mut filter = hmm.filter();
    // Multiples of 10 between the updates; at most 50.
    for (answer, steps) in found.iter().zip([1, 0, 1, 3, 0, 1, 50]) {
        for _ in 1..steps {
            filter.predict().unwrap();
        }
        let log = match steps {
            0 => filter.update(&3).unwrap(),
            _ => filter.step(&3).unwrap(),
        };
        close(answer["log_likelihood"].as_f64().unwrap(), log);
        close(answer["probability"].as_f64().unwrap(), filter.belief().peak().1);
    }
}

#[test]
fn the_model_is_exchanged_while_it_runs() {
    let (old, new) = (model(2), model(3));
    let folder = Folder::new(&old);
    let models = folder.path("models");
    fs::create_dir(&models).unwrap();
    fs::write(models.join("new.json"), serde_json::to_vec(&new).unwrap()).unwrap();
    let other = wayfix::canberra::hmm(5, 1.0).unwrap();
    fs::write(models.join("other.json"), serde_json::to_vec(&other).unwrap()).unwrap();
    let name = |name: &str| format!("{}\n", json!({ "model": name }));
    let text = [
        line(1, 0, 3),
        line(1, 1, 2),
        name("new.json"),
        line(1, 2, 4),
        name("../model.json"),
        name("none.json"),
        name("other.json"),
        line(1, 3, 80), // of the other sensor
    ];
    let snapshot = folder.path("pool.bin");
    let mut job = ServiceJob { models: Some(models), replay: true, ..job(&folder) };
    job.live.restore = Some(snapshot.clone());
    job.live.snapshot = Some(snapshot);
    let (_, found) = answers(&job, &text.concat());
    assert_eq!(
        (&found[2]["vehicles_kept"], &found[2]["vehicles_begun_anew"]),
        (&json!(1), &json!(0))
    );
    assert_eq!(
        (&found[6]["vehicles_kept"], &found[6]["vehicles_begun_anew"]),
        (&json!(0), &json!(1))
    );
    assert!(found[4]["error"].as_str().unwrap().contains("not the name"), "{}", found[4]);
    assert!(found[5]["error"].as_str().unwrap().contains("none.json"), "{}", found[5]);
    let mut before = old.filter();
    before.step(&3).unwrap();
    before.step(&2).unwrap();
    let mut after = new.filter();
    after.restore(&before.snapshot()).unwrap();
    close(found[3]["log_likelihood"].as_f64().unwrap(), after.step(&4).unwrap());
    let mut anew = other.filter();
    close(found[7]["log_likelihood"].as_f64().unwrap(), anew.step(&80).unwrap());
    // The next run goes on with it.
    let (summary, found) = answers(&job, &[&text.concat(), &line(1, 4, 81)[..]].concat());
    assert_eq!(summary.lines, 1);
    close(found[0]["log_likelihood"].as_f64().unwrap(), anew.step(&81).unwrap());
}

#[test]
fn figures_are_answered() {
    let folder = Folder::new(&model(1));
    let job = ServiceJob { metrics: Some("127.0.0.1:0".to_owned()), ..job(&folder) };
    let mut seen = None;
    let text = format!("{}{}none\n", line(1, 5, 2), line(1, 5, 2));
    serve(&job, &Control::new(), Cursor::new(text), Vec::new(), |notice| {
        if let Notice::Metrics(address) = notice {
            seen = Some(*address);
        }
    })
    .unwrap();
    // The figures of a run outlive it.
    let get = |path: &str| {
        let mut stream = TcpStream::connect(seen.unwrap()).unwrap();
        write!(stream, "GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
        let mut text = String::new();
        stream.read_to_string(&mut text).unwrap();
        text
    };
    let text = get("/metrics");
    for line in [
        "HTTP/1.1 200 OK",
        "wayfix_fleet_lines_total 3",
        "wayfix_fleet_accepted_total 1",
        "wayfix_fleet_refused_total{kind=\"time\"} 1",
        "wayfix_fleet_refused_total{kind=\"line\"} 1",
        "wayfix_fleet_vehicles 1",
        "wayfix_fleet_latest_time 5",
    ] {
        assert!(text.lines().any(|found| found == line), "{line}: {text}");
    }
    assert!(get("/health").ends_with("\r\n\r\nok\n"));
    assert!(get("/other").starts_with("HTTP/1.1 404"));
}

#[test]
fn ids_beyond_the_limit_are_said() {
    let folder = Folder::new(&model(1));
    let mut job = job(&folder);
    let text: String = (0..5000).map(|id| line(id, 0, 3)).collect();
    let said = |job: &ServiceJob| {
        let mut said = Vec::new();
        serve(job, &Control::new(), Cursor::new(text.clone()), Vec::new(), |notice| {
            if let Notice::Ids { bytes, limit } = notice {
                said.push((*bytes, *limit));
            }
        })
        .unwrap();
        said
    };
    job.live.options.spill = Some(folder.path("spill"));
    job.live.options.memory = Some(100_000);
    let found = said(&job);
    assert!(found.len() == 1 && found[0].0 > 300_000 && found[0].1 == 100_000, "{found:?}");
    job.live.options.memory = Some(1 << 20);
    assert_eq!(said(&job), []);
}
