//! Times: order, forgetting, and steps by the clock.

use std::io::{Cursor, Read};
use std::num::{NonZeroU64, NonZeroUsize};
use std::time::Duration;

use rand::RngExt;
use rand::seq::SliceRandom;
use serde_json::{Value, json};
use wayfix_fleet::pool::{Control, ServiceJob, Timing, position, serve};

use crate::kit::*;
use crate::service::*;

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
        line(1, 5, 3), // forgotten: starts anew, even at an earlier time
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
    // All others are 990 units behind the latest.
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
    for (at, (found, whole)) in found.iter().zip(&whole).enumerate() {
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
    // No line is more than 20 units behind any line before it.
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

    // Stopped runs keep waiting lines.
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

/// An input that never ends, but stops the run.
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
fn one_clock_that_is_far_ahead_makes_no_other_late_or_forgotten() {
    let folder = Folder::new(&model(1));
    let mut rng = rng(12);
    let mut text: Vec<String> =
        (0..2000).map(|time| line(rng.random_range(0..30), time, rng.random_range(0..5))).collect();
    let without = text.concat();
    text.insert(500, line(99, 1_000_000, 3));
    text.insert(1200, line(99, 1_000_001, 3));
    let with = text.concat();
    let of_others = |job: &ServiceJob, text: &str| {
        let mut found = answers(job, text).1;
        found.retain(|answer| answer["vehicle"] != json!(99));
        found
    };
    let agree = NonZeroUsize::new(2);
    for lateness in [None, Some(5)] {
        let timing = Timing { forget_after: Some(1000), agree, ..Timing::default() };
        let mut job = ServiceJob { timing, lateness, ..job(&folder) };
        let expected = of_others(&job, &without);
        assert!(expected.iter().all(|answer| answer.get("error").is_none()));
        assert!(of_others(&job, &with) == expected);
        // A run that continues knows the time of each vehicle.
        let snapshot = folder.path(&format!("{lateness:?}.bin"));
        job.replay = true;
        job.live.restore = Some(snapshot.clone());
        job.live.snapshot = Some(snapshot);
        let mut output = Vec::new();
        for end in [501, 1201, text.len()] {
            let control = Control::new();
            let input = Cursor::new(text[..end].concat().into_bytes());
            if end < text.len() {
                let input = Stopping(input, control.clone());
                serve(&job, &control, input, &mut output, |_| ()).unwrap();
            } else {
                serve(&job, &control, input, &mut output, |_| ()).unwrap();
            }
        }
        let found = String::from_utf8(output).unwrap();
        let found = found.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
        let found: Vec<Value> = found.filter(|answer| answer["vehicle"] != json!(99)).collect();
        assert!(found == expected);
        // By default, one such clock does affect the others.
        (job.live.restore, job.live.snapshot, job.replay) = (None, None, false);
        job.timing.agree = None;
        assert!(of_others(&job, &with) != expected);
    }
}
