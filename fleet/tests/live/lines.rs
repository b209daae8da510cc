//! Lines of JSON, good and bad.

use std::io::Cursor;

use rand::RngExt;
use serde_json::{Value, json};
use wayfix::likelihood::SparseObservation;
use wayfix::map::Position;
use wayfix::{Hmm, Likelihood, LikelihoodVector, OptionalLikelihood, SparseLikelihood};
use wayfix_fleet::places::{Fix, Places};
use wayfix_fleet::pool::{Control, LiveJob, LiveSummary, Notice, Update, live, position, serve};

use crate::filters::*;
use crate::kit::*;
use crate::service;

/// Runs `live` over lines, and returns the answers.
fn answers(job: &LiveJob, text: &str) -> (LiveSummary, Vec<Value>) {
    let mut output = Vec::new();
    let input = Cursor::new(text.to_owned().into_bytes());
    let summary = live(job, input, &mut output, |error| panic!("{error}")).unwrap();
    let output = String::from_utf8(output).unwrap();
    (summary, output.lines().map(|line| serde_json::from_str(line).unwrap()).collect())
}

fn job(folder: &Folder) -> LiveJob {
    let (model, options) = (folder.path("model.json"), threads(2));
    LiveJob { model, restore: None, snapshot: None, options }
}

/// Runs `live` over lines that are all updates, and compares the answers.
fn compare_lines<B: Likelihood<Observation: Sized>>(
    hmm: &Hmm<wayfix::SparseTransition, B>,
    seen: &[Update<B::Observation>],
    field: impl Fn(&B::Observation) -> Value,
) where
    Hmm<wayfix::SparseTransition, B>: serde::Serialize,
{
    let folder = Folder::new(hmm);
    let text: Vec<String> = seen
        .iter()
        .map(|update| {
            let vehicle = serde_json::to_value(&update.vehicle).unwrap();
            let mut line = json!({
                "vehicle": vehicle,
                "time": update.time,
                "observation": field(&update.observation),
                "more": {"is": ["not", "read"]},
            });
            if update.restart {
                line["restart"] = json!(true);
            }
            if let Some(elsewhere) = line["observation"].get("elsewhere").cloned() {
                line["observation"] = line["observation"]["listed"].take();
                line["elsewhere"] = elsewhere;
            }
            line.to_string()
        })
        .collect();
    let mut filters = Filters::new(hmm);
    let (summary, found) = answers(&job(&folder), &text.join("\n"));
    assert_eq!((summary.lines, found.len()), (seen.len() as u64, seen.len()));
    let mut errors = 0;
    for (at, (update, found)) in seen.iter().zip(&found).enumerate() {
        assert_eq!(found["vehicle"], serde_json::to_value(&update.vehicle).unwrap());
        assert_eq!(found["time"], json!(update.time));
        match filters.take(update) {
            Ok((state, probability, log_likelihood)) => {
                assert_eq!(found["state"], json!(state));
                let number = |name: &str| found[name].as_f64().unwrap().to_bits();
                assert_eq!(number("probability"), probability);
                assert_eq!(number("log_likelihood"), log_likelihood);
            }
            Err(kind) => {
                errors += 1;
                assert_eq!(found["error_kind"], json!(kind));
                assert_eq!(found["line"], json!(at + 1));
                assert!(!found["error"].as_str().unwrap().is_empty());
            }
        }
    }
    assert_eq!((summary.errors, summary.vehicles), (errors, filters.vehicles.len()));
}

#[test]
fn a_restart_that_comes_twice_is_refused() {
    let folder = Folder::new(&model(1));
    let line = |time: i64, seen: usize, restart: bool| {
        json!({"vehicle": 7, "time": time, "observation": seen, "restart": restart}).to_string()
    };
    let (again, last) = (line(1, 4, true), line(3, 2, false));
    let begin = [line(0, 3, false), again.clone(), line(2, 3, false)];
    let once = [&begin[..], std::slice::from_ref(&last)].concat();
    let twice = [&begin[..], &[again, last]].concat();
    let (_, once) = answers(&job(&folder), &once.join("\n"));
    let (summary, twice) = answers(&job(&folder), &twice.join("\n"));
    assert_eq!((summary.errors, &twice[3]["error_kind"]), (1, &json!("time")));
    assert_eq!((&twice[..3], &twice[4]), (&once[..3], &once[3]));
}

#[test]
fn lines_of_every_sensor() {
    let mut rng = rng(11);
    let symbols = updates(&mut rng, 1000, |rng| rng.random_range(0..6));
    compare_lines(&model(2), &symbols, |symbol| json!(symbol));

    let camera = model(2).into_parts().2;
    let optional =
        Hmm::new(prior(), transition(&mut rng), OptionalLikelihood::new(camera)).unwrap();
    let some = updates(&mut rng, 500, |rng| rng.random_bool(0.7).then(|| rng.random_range(0..5)));
    compare_lines(&optional, &some, |symbol| json!(symbol));

    let linear = LikelihoodVector::linear(STATES).owned();
    let linear = Hmm::new(prior(), transition(&mut rng), linear).unwrap();
    let rows = updates(&mut rng, 300, |rng| -> Vec<f64> {
        let count = if rng.random_bool(0.05) { STATES - 1 } else { STATES };
        (0..count).map(|_| rng.random_range(0.0..1.0)).collect()
    });
    compare_lines(&linear, &rows, |row| json!(row));

    let log = LikelihoodVector::log(STATES).owned();
    let log = Hmm::new(prior(), transition(&mut rng), log).unwrap();
    let rows = updates(&mut rng, 300, wide);
    compare_lines(&log, &rows, |row| {
        row.iter().map(|log| if log.is_finite() { json!(log) } else { Value::Null }).collect()
    });

    let sparse = SparseLikelihood::new(STATES);
    let sparse = Hmm::new(prior(), transition(&mut rng), sparse).unwrap();
    let lists = updates(&mut rng, 300, |rng| {
        let elsewhere = if rng.random_bool(0.5) { 0.0 } else { 0.01 };
        let listed = (0..3).map(|k| (4 * k + rng.random_range(0..4), rng.random_range(0.1..1.0)));
        SparseObservation::new(listed.collect(), elsewhere).unwrap()
    });
    compare_lines(&sparse, &lists, |seen| {
        let pairs = seen.listed().iter();
        let listed: Vec<Value> =
            pairs.map(|(state, p)| json!({"state": state, "likelihood": p})).collect();
        json!({"listed": listed, "elsewhere": seen.elsewhere()})
    });

    let place = |k: usize| Position { latitude: -35.3 + 1e-3 * k as f64, longitude: 149.1 };
    let places = Places::new((0..STATES).map(place).collect(), 3.0).unwrap();
    let places = Hmm::new(prior(), transition(&mut rng), places).unwrap();
    let fixes = updates(&mut rng, 300, |rng| Fix {
        latitude: rng.random_range(-35.301..-35.289),
        longitude: 149.1,
        deviation: rng.random_range(-1.0..100.0),
    });
    compare_lines(&places, &fixes, |fix| {
        json!({
            "latitude": fix.latitude, "longitude": fix.longitude, "deviation": fix.deviation
        })
    });
}

#[test]
fn a_bad_line_is_answered_and_the_run_goes_on() {
    let folder = Folder::new(&model(3));
    let too_long =
        format!(r#"{{"vehicle": "{}", "time": 0, "observation": 0}}"#, "x".repeat(2 << 20));
    let lines = [
        r#"{"vehicle": 1, "time": 5, "observation": 2}"#,
        "",
        r#"{"vehicle": 1, "time": 6"#,
        r#"{"vehicle": 1, "time": 6, "observation": "north"}"#,
        r#"{"vehicle": 1, "time": 6.5, "observation": 2}"#,
        r#"{"vehicle": 1, "observation": 2}"#,
        r#"{"vehicle": [1], "time": 6, "observation": 2}"#,
        r#"{"vehicle": 18446744073709551615, "time": 6, "observation": 2}"#,
        r#"{"vehicle": 1, "time": 6}"#,
        r#"{"vehicle": 1, "time": 6, "observation": null}"#,
        r#"{"vehicle": 1, "time": 6, "observation": -1}"#,
        &too_long,
        "\u{0}",
        "[1, 6, 2",
        r#"{"vehicle": "1", "time": 6, "observation": 2}"#,
        "{\"vehicle\": 1, \"time\": 6, \"observation\": 2}\r",
        r#"{"vehicle": 1, "time": 6, "observation": 3}"#,
        r#"{"vehicle": 1, "time": 7, "observation": 600}"#,
        r#"{"vehicle": 1, "time": 7, "observation": 3}"#,
    ];
    let (summary, found) = answers(&job(&folder), &lines.join("\n"));
    assert_eq!((summary.lines, found.len()), (lines.len() as u64, lines.len()));
    assert_eq!((summary.errors, summary.vehicles), (15, 2));
    for (at, found) in found.iter().enumerate() {
        let kind = match at {
            0 | 14 | 15 | 18 => {
                assert!(found["state"].is_u64() && found.get("error").is_none(), "{found}");
                continue;
            }
            16 => "time",
            17 => "likelihood",
            _ => "line",
        };
        assert_eq!((&found["error_kind"], &found["line"]), (&json!(kind), &json!(at + 1)));
        let message = found["error"].as_str().unwrap();
        assert!(!message.contains("line 1"), "{message}");
    }
    assert_eq!((&found[3]["vehicle"], &found[3]["time"]), (&json!(1), &json!(6)));
    assert!(found[3]["error"].as_str().unwrap().contains("\"north\""), "{}", found[3]);
    assert!(found[8]["error"].as_str().unwrap().contains("`observation`"), "{}", found[8]);
    assert!(found[11]["error"].as_str().unwrap().contains("too long"), "{}", found[11]);
    // Vehicle 1 has taken the three valid steps.
    let mut filter = model(3);
    filter = filter.with_rounded_tails();
    let mut filter = filter.filter();
    let logs = [2, 2, 3].map(|symbol| filter.step(&symbol).unwrap());
    for (at, log) in [0, 15, 18].into_iter().zip(logs) {
        close(found[at]["log_likelihood"].as_f64().unwrap(), log);
    }
}

#[test]
fn a_line_that_was_cut_off_at_the_end_is_left() {
    let folder = Folder::new(&model(1));
    let snapshot = folder.path("pool.bin");
    let mut run = service::job(&folder);
    (run.live.restore, run.live.snapshot) = (Some(snapshot.clone()), Some(snapshot.clone()));
    let text = [service::line(1, 1, 2), service::line(1, 2, 3)].concat();
    for cut in [text.len() - 30, text.len() - 2] {
        let mut said = Vec::new();
        let input = Cursor::new(text[..cut].to_owned());
        _ = std::fs::remove_file(&snapshot);
        serve(&run, &Control::new(), input, Vec::new(), |notice| {
            said.extend(matches!(notice, Notice::Unfinished { .. }).then(|| notice.to_json()));
        })
        .unwrap();
        assert_eq!(said.len(), 1, "{said:?}");
        let at = position(&snapshot).unwrap().unwrap();
        assert_eq!((at.lines, at.bytes as usize), (1, text.len() / 2));
        run.replay = true;
        assert_eq!(service::answers(&run, &text).0.lines, 1);
        run.replay = false;
    }
    // A whole line needs no line end.
    assert_eq!(service::answers(&service::job(&folder), text.trim_end()).0.lines, 2);
}

#[test]
fn an_offset_at_the_begin_is_that_of_any_line() {
    let folder = Folder::new(&model(1));
    let snapshot = folder.path("pool.bin");
    let mut run = service::job(&folder);
    run.live.snapshot = Some(snapshot.clone());
    let deep = format!(r#"{{"offset":3,"more":{}{}}}"#, "[".repeat(500), "]".repeat(500));
    let long = format!(r#"{{"offset":4,"vehicle":"{}"}}"#, "x".repeat(2 << 20));
    let lines = [
        r#"{"offset":1,"vehicle":7,"time":1,"observation":2}"#,
        r#"{"offset":2,"no json"#,
        &deep,
        &long,
        r#"{"offset":5,"offset":99,"vehicle":7,"time":2,"observation":2}"#,
        r#"{"offset":6,"vehicle":7,"remove":true,"offset":99}"#,
    ];
    for count in 1..=lines.len() {
        let found = service::answers(&run, &(lines[..count].join("\n") + "\n")).1;
        assert_eq!(found[count - 1]["offset"], json!(count));
        let at = position(&snapshot).unwrap().unwrap();
        assert_eq!(at.offset, Some((count as i64).into()));
    }
}
