//! Signals: snapshots, an orderly end, and rereading the model.

use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::process::Stdio;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use wayfix_fleet::pool::position;

use crate::kit::*;
use crate::service::*;

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
        // The last line is incomplete, so it is not taken.
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
fn the_model_is_read_again_on_hangup() {
    let folder = Folder::new(&model(1));
    let write = |model: &Model| {
        let (file, next) = (folder.path("model.json"), folder.path("next.json"));
        fs::write(&next, serde_json::to_vec(model).unwrap()).unwrap();
        fs::rename(&next, &file).unwrap();
    };
    let (output, snapshot) = (folder.path("positions"), folder.path("pool.bin"));
    let (to, file) = (output.to_str().unwrap(), snapshot.to_str().unwrap());
    let arguments = ["--snapshot", file, "--restore", file, "--output", to, "--log", "json"];
    let mut child = command(&folder, &arguments).stdin(Stdio::piped()).spawn().unwrap();
    let mut input = child.stdin.take().unwrap();
    let mut log = BufReader::new(child.stderr.take().unwrap());
    let mut next_event = || {
        let mut line = String::new();
        log.read_line(&mut line).unwrap();
        serde_json::from_str::<Value>(&line).unwrap()
    };
    assert_eq!(next_event()["event"], json!("begin"));
    input.write_all(line(1, 1, 3).as_bytes()).unwrap();
    wait_for(&output, 50);
    // A file that is not a model is reported, and the old model stays.
    fs::write(folder.path("model.json"), "{}").unwrap();
    signal(&child, "HUP");
    assert_eq!(next_event()["event"], json!("model_failed"));
    let before = fs::metadata(&output).unwrap().len();
    input.write_all(line(1, 2, 2).as_bytes()).unwrap();
    wait_for(&output, before + 50);
    write(&model(2));
    signal(&child, "HUP");
    let event = next_event();
    assert_eq!((&event["event"], &event["kept"]), (&json!("model"), &json!(1)), "{event}");
    // A snapshot with the new model follows, so a killed run continues with it.
    assert_eq!(next_event()["event"], json!("snapshot"));
    child.kill().unwrap();
    child.wait().unwrap();
    drop(input);
    let mut child = command(&folder, &arguments).stdin(Stdio::piped()).spawn().unwrap();
    child.stdin.take().unwrap().write_all(line(1, 3, 4).as_bytes()).unwrap();
    let done = child.wait_with_output().unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));

    let (old, new) = (model(1), model(2));
    let mut filter = old.filter();
    let mut expected = vec![filter.step(&3).unwrap(), filter.step(&2).unwrap()];
    let mut after = new.filter();
    after.restore(&filter.snapshot()).unwrap();
    expected.push(after.step(&4).unwrap());
    let found = fs::read_to_string(&output).unwrap();
    assert_eq!(found.lines().count(), 3);
    for (found, expected) in found.lines().zip(expected) {
        let found: Value = serde_json::from_str(found).unwrap();
        close(found["log_likelihood"].as_f64().unwrap(), expected);
    }
}
