//! Runs that leave drives out, and are interrupted.

use std::fs;

use rand::RngExt;
use serde_json::json;
use wayfix_fleet::run;

use super::*;

/// Drives in the long form, many of them invalid at random.
fn faulty(seed: u64, drives: usize) -> Cells {
    let mut rng = rng(seed);
    let mut rows: Cells = Vec::new();
    for id in 0..drives as i64 {
        let length = rng.random_range(1..30);
        let first = rows.len();
        for k in 0..length {
            rows.push([Some(id), Some(step(k)), Some(rng.random_range(0..5))]);
        }
        let at = rng.random_range(first..rows.len());
        match rng.random_range(0..24) {
            0 => rows[at][0] = None,
            1 => rows[at][0] = Some(id / 2),
            2 => rows[at][1] = None,
            3 => rows[at][1] = Some(0),
            4 => rows[at][2] = None,
            5 => rows[at][2] = Some(7),
            _ => {}
        }
    }
    rows
}

/// Rows as text, some of it unreadable.
fn csv(rows: &[[Option<i64>; 3]]) -> String {
    let cell = |cell: Option<i64>| match cell {
        Some(0) => "0".to_owned(),
        Some(7) => "seven".to_owned(),
        other => other.map(|number| number.to_string()).unwrap_or_default(),
    };
    let line = |row: &[Option<i64>; 3]| row.map(cell).join(",") + "\n";
    "trace_id,step,observation\n".to_owned() + &rows.iter().map(line).collect::<String>()
}

#[test]
fn a_run_goes_on_without_lost_or_doubled_lines() {
    for seed in 0..3 {
        let folder = Folder::new(&model(5));
        let rows = faulty(seed, 500);
        // Row groups are batches, and end within drives.
        folder.write("drives.parquet", &table(&rows), 61);
        fs::write(folder.path("drives.csv"), csv(&rows)).unwrap();
        let input = if seed == 2 { "drives.csv" } else { "drives.parquet" };
        let whole = job(&folder, input, "whole.parquet");
        let mut steps = 0;
        let summary = run(&whole, |_| steps += 1).unwrap();
        assert!(summary.left_out > 50 && summary.parts > 10 && steps > 50, "{summary:?}, {steps}");
        assert_eq!(lines(&whole).len() as u64, summary.left_out);
        let bytes = |job: &Job| {
            let left_out = job.left_out.as_ref().unwrap();
            (fs::read(&job.output).unwrap(), fs::read(left_out).unwrap())
        };
        let expected = bytes(&whole);
        for stride in [1, 2, 5, 40] {
            let job = job(&folder, input, &format!("out{stride}.parquet"));
            let (mut runs, mut resumed, mut done) = (0, 0, None);
            while done.is_none() {
                let mut count = 0;
                let stopped = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
                    run(&job, |_| {
                        count += 1;
                        // Later each time, so that a run finishes eventually.
                        assert!(count <= stride + 4 * runs, "interrupted");
                    })
                }));
                runs += 1;
                // A command of another test may hold the locks for a moment.
                if let Ok(Ok(summary)) = stopped {
                    resumed = summary.resumed;
                    done = Some(summary);
                }
                assert!(runs < 500);
            }
            assert!(runs > 2 && resumed > 0, "{runs} runs, {resumed} parts");
            assert!(bytes(&job) == expected, "seed {seed}, {runs} runs");
            let done = done.unwrap();
            assert_eq!((done.drives, done.left_out), (summary.drives, summary.left_out));
        }
    }
}

#[test]
fn without_the_option_finished_parts_stay() {
    let folder = Folder::new(&model(5));
    let mut rows: Cells = Vec::new();
    for id in 0..400 {
        rows.extend((0..10).map(|k| [Some(id), Some(k), Some(k % 5)]));
    }
    let good = table(&rows);
    rows[3005][2] = Some(77);
    folder.write("drives.parquet", &table(&rows), 200);
    let whole = job(&folder, "drives.parquet", "whole.parquet");
    assert_eq!(go_on(&whole).unwrap().left_out, 1);
    assert_lines(&whole, &[(3005, json!(300), "observation", "symbol 77 does not exist")]);

    let mut job = job(&folder, "drives.parquet", "out.parquet");
    let left_out = job.left_out.take();
    let error = go_on(&job).unwrap_err().to_string();
    assert!(error.contains("row 3005"), "{error}");
    assert!(folder.has_leftovers() && !job.output.exists());
    job.left_out.clone_from(&left_out);
    let summary = go_on(&job).unwrap();
    assert!(summary.resumed >= 7 && summary.left_out == 1, "{summary:?}");
    assert!(fs::read(&job.output).unwrap() == fs::read(&whole.output).unwrap());
    assert_eq!(lines(&job), lines(&whole));
    assert_eq!(go_on(&job).unwrap().finished, 1);

    // Or with a repaired file.
    job.output = folder.path("repaired.parquet");
    job.left_out = None;
    assert!(go_on(&job).is_err());
    folder.write("drives.parquet", &good, 200);
    let summary = go_on(&job).unwrap();
    assert!(summary.resumed >= 7 && summary.drives == 400, "{summary:?}");
    assert!(!folder.has_leftovers());
}

#[test]
fn the_file_of_an_unfinished_run_is_asked_for() {
    let folder = Folder::new(&model(5));
    folder.write("drives.parquet", &table(&faulty(9, 300)), 100);
    let job = job(&folder, "drives.parquet", "out.parquet");
    let stopped =
        std::panic::catch_unwind(|| run(&job, |done| assert!(done.drives < 200, "interrupted")));
    assert!(stopped.is_err());
    let mut other = job.clone();
    other.left_out = None;
    let error = go_on(&other).unwrap_err().to_string();
    assert!(error.contains("give its --skip-invalid again"), "{error}");
    other.left_out = Some(folder.path("other.jsonl"));
    let error = go_on(&other).unwrap_err().to_string();
    assert!(error.contains("other.jsonl.partial is missing"), "{error}");
    // A file that is not ours is not replaced.
    fs::write(job.left_out.as_ref().unwrap(), "mine").unwrap();
    let error = go_on(&job).unwrap_err().to_string();
    assert!(error.contains("out.parquet.jsonl exists; replace it with --force"), "{error}");
    fs::remove_file(job.left_out.as_ref().unwrap()).unwrap();
    other.left_out = Some(other.output.clone());
    let error = go_on(&other).unwrap_err().to_string();
    assert!(error.contains("other than the output"), "{error}");
    assert!(go_on(&job).unwrap().resumed > 0);
}
