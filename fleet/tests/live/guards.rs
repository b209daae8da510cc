//! Input that a run refuses, and clients that must not hold it up.

use std::fs;
use std::io::{self, Cursor, Read, Write};
use std::net::TcpStream;
use std::sync::mpsc::channel;
use std::thread;
use std::time::Duration;

use serde_json::json;
use wayfix_fleet::FleetError;
use wayfix_fleet::pool::{Control, LiveSummary, Notice, ServiceJob, position, serve};

use crate::kit::*;
use crate::service::*;

fn run(job: &ServiceJob, text: &str) -> Result<LiveSummary, FleetError> {
    let input = Cursor::new(text.to_owned().into_bytes());
    serve(job, &Control::new(), input, io::sink(), |_| ())
}

fn refusal(job: &ServiceJob, text: &str) -> String {
    run(job, text).unwrap_err().to_string()
}

/// A run with a snapshot that it continues from.
fn with_snapshot(folder: &Folder) -> ServiceJob {
    let mut job = job(folder);
    job.live.snapshot = Some(folder.path("snapshot"));
    job.live.restore = Some(folder.path("snapshot"));
    job
}

#[test]
fn a_snapshot_has_one_run_at_a_time() {
    let folder = Folder::new(&model(1));
    let job = with_snapshot(&folder);
    let (control, (say, said)) = (Control::new(), channel());
    let first = ServiceJob { metrics: Some("127.0.0.1:0".to_owned()), ..job.clone() };
    let (of_run, (reader, writer)) = (control.clone(), io::pipe().unwrap());
    let thread = thread::spawn(move || {
        serve(&first, &of_run, reader, io::sink(), |notice| {
            if let Notice::Begin { .. } = notice {
                say.send(()).unwrap();
            }
        })
    });
    said.recv().unwrap();
    assert!(refusal(&job, "").contains("another run holds the lock on"));
    drop(writer);
    thread.join().unwrap().unwrap();
    assert!(!folder.path("snapshot.lock").exists());
    run(&job, &line(1, 1, 2)).unwrap();
}

#[test]
fn a_snapshot_replaces_no_file_of_another_kind() {
    let folder = Folder::new(&model(1));
    for name in ["model.json", "input", "folder"] {
        let path = folder.path(name);
        match name {
            "input" => fs::write(&path, line(1, 1, 2)).unwrap(),
            "folder" => fs::create_dir(&path).unwrap(),
            _ => {}
        }
        let mut job = job(&folder);
        job.live.snapshot = Some(path.clone());
        let before = fs::read(&path).ok();
        let error = refusal(&job, &line(1, 1, 2));
        assert!(error.contains("no snapshot is written there"), "{error}");
        assert_eq!(fs::read(&path).ok(), before);
    }
    let mut job = job(&folder);
    job.live.snapshot = Some(folder.path("both"));
    job.output = Some(folder.path("both"));
    let error = refusal(&job, &line(1, 1, 2));
    assert!(error.contains("no snapshot is written there"), "{error}");
}

#[test]
fn another_input_of_the_same_length_is_refused() {
    let folder = Folder::new(&model(1));
    let input = folder.path("input");
    let text = lines(3, 400);
    let (first, rest) = text.split_at(text[..text.len() / 2].rfind('\n').unwrap() + 1);
    let as_file = ServiceJob { input: Some(input.clone()), ..with_snapshot(&folder) };
    fs::write(&input, first).unwrap();
    run(&as_file, "").unwrap();
    let snapshot = fs::read(folder.path("snapshot")).unwrap();
    assert_eq!(position(&folder.path("snapshot")).unwrap().unwrap().bytes, first.len() as u64);

    let replayed = ServiceJob { input: None, replay: true, ..as_file.clone() };
    let other = text.replacen("\"time\": 1", "\"time\": 2", 300);
    assert_eq!(other.len(), text.len());
    // A log that was started anew has grown beyond the position.
    for wrong in [&other, &rest.repeat(2)] {
        fs::write(&input, wrong).unwrap();
        assert!(refusal(&as_file, "").contains("another input"));
        assert!(refusal(&replayed, wrong).contains("another input"));
        assert_eq!(fs::read(folder.path("snapshot")).unwrap(), snapshot);
    }
    let replay = run(&replayed, &text).unwrap();
    fs::write(folder.path("snapshot"), snapshot).unwrap();
    fs::write(&input, &text).unwrap();
    assert_eq!(run(&as_file, "").unwrap().lines, replay.lines);
    // Nothing new to save.
    assert_eq!(run(&as_file, "").unwrap().lines, 0);
    assert_eq!(run(&replayed, &text).unwrap().lines, 0);
}

#[test]
fn the_end_of_a_last_line_may_come_later() {
    let folder = Folder::new(&model(1));
    let (input, output) = (folder.path("input"), folder.path("output"));
    let text = lines(5, 50);
    let as_file = ServiceJob {
        input: Some(input.clone()),
        output: Some(output.clone()),
        ..with_snapshot(&folder)
    };
    let replayed = ServiceJob { input: None, replay: true, ..as_file.clone() };
    let whole = {
        fs::write(&input, &text).unwrap();
        run(&as_file, "").unwrap();
        fs::read(&output).unwrap()
    };
    let half = text[..text.len() / 2].rfind('\n').unwrap();
    for job in [&as_file, &replayed] {
        fs::remove_file(folder.path("snapshot")).unwrap();
        fs::remove_file(&output).unwrap();
        // Nothing, the line end alone, and the line end with lines after it.
        for end in [half, half, half + 1, text.len() - 1, text.len()] {
            fs::write(&input, &text[..end]).unwrap();
            run(job, &text[..end]).unwrap();
        }
        assert_eq!(
            String::from_utf8_lossy(&fs::read(&output).unwrap()),
            String::from_utf8_lossy(&whole)
        );
    }
}

#[test]
fn an_offset_is_short() {
    let folder = Folder::new(&model(1));
    let text = |length: usize| {
        let line =
            json!({"vehicle": 1, "time": length, "observation": 2, "offset": "x".repeat(length)});
        format!("{line}\n")
    };
    let (_, answers) = answers(&job(&folder), &(text(256) + &text(257) + &text(1)));
    assert!(answers[0]["state"].is_u64(), "{}", answers[0]);
    assert_eq!(answers[1]["error_kind"], "line");
    assert!(answers[1]["error"].as_str().unwrap().contains("256 bytes"), "{}", answers[1]);
    assert!(answers[1].get("offset").is_none());
}

#[test]
fn figures_are_there_while_others_say_nothing() {
    let folder = Folder::new(&model(1));
    let job = ServiceJob { metrics: Some("127.0.0.1:0".to_owned()), ..job(&folder) };
    let (control, (say, said)) = (Control::new(), channel());
    let (of_run, (reader, writer)) = (control.clone(), io::pipe().unwrap());
    let thread = thread::spawn(move || {
        serve(&job, &of_run, reader, io::sink(), |notice| {
            if let Notice::Metrics(address) = notice {
                say.send(*address).unwrap();
            }
        })
    });
    let address = said.recv().unwrap();
    let silent: Vec<TcpStream> = (0..20).map(|_| TcpStream::connect(address).unwrap()).collect();
    let mut stream = TcpStream::connect(address).unwrap();
    // One after another they would take 40 seconds.
    stream.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
    stream.write_all(b"GET /health HTTP/1.1\r\n\r\n").unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
    drop((silent, writer));
    thread.join().unwrap().unwrap();
}
