//! Learning from files.

use std::fs;
use std::process::{Command, Output};
use std::thread;

use rand::RngExt;
use wayfix_fleet::{LearnJob, learn};

use crate::kit::*;

#[test]
fn is_that_of_the_library_also_after_an_interruption() {
    let given = model(11);
    let folder = Folder::new(&given);
    let some = drives(12, 1500, 0, 30);
    folder.write("nested.parquet", &nested(&some), 200);
    folder.write("long.parquet", &long(&some), 3000);
    let expected = learned(&given, &some);
    assert!(!expected.left_out().is_empty());

    for (input, output) in [("nested.parquet", "a.json"), ("long.parquet", "b.json")] {
        let job = learn_job(&folder, input, output, 2);
        if input == "long.parquet" {
            let stopped = job.clone();
            let stopped =
                thread::spawn(move || learn(&stopped, |k, _| assert!(k < 5, "interrupted")));
            assert!(stopped.join().is_err());
            assert!(folder.has_leftovers() && !job.output.exists());
        }
        let mut iterations = Vec::new();
        let course = learn(&job, |iteration, _| iterations.push(iteration)).unwrap();
        assert!(!folder.has_leftovers());
        let first = if input == "long.parquet" { 5 } else { 0 };
        assert_eq!(iterations.first(), Some(&first));
        assert_learned(&job, &course, &expected);
    }
}

/// A folder with drives, and the command with some options.
fn prepared() -> (Folder, impl Fn(&Folder, &[&str]) -> Output) {
    let folder = Folder::new(&model(11));
    folder.write("nested.parquet", &nested(&drives(12, 300, 1, 20)), 200);
    let command = |folder: &Folder, options: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_wayfix-fleet"));
        command.current_dir(folder.dir.path()).args(["learn", "--quiet", "--model", "model.json"]);
        command.args(["--output", "out.json", "--tolerance", "0"]).args(options).output().unwrap()
    };
    (folder, command)
}

#[test]
fn a_finished_run_says_so() {
    let (folder, command) = prepared();
    let options = ["--input", "nested.parquet", "--iterations", "3"];
    let run = |more: &[&str]| {
        let done = command(&folder, &[&options, more].concat());
        let text = [done.stdout, done.stderr].concat();
        (done.status.success(), String::from_utf8(text).unwrap())
    };
    let (done, said) = run(&[]);
    assert!(done && said.contains("after 3 re-estimations"), "{said}");
    let model = fs::read(folder.path("out.json")).unwrap();
    assert_eq!(run(&[]), (true, format!("{}; finished already\n", said.trim_end())));
    assert!(fs::read(folder.path("out.json")).unwrap() == model);
    // A kill between the last two steps leaves the state of the run behind.
    fs::write(folder.path("out.json.partial"), "").unwrap();
    assert!(run(&[]).0 && !folder.has_leftovers());
    let exists = |more: &[&str]| {
        let (done, said) = run(more);
        assert!(!done && said.contains("out.json exists; replace it with --force"), "{said}");
    };
    exists(&["--keep-prior"]);
    fs::write(folder.path("out.json"), [&model[..], b" "].concat()).unwrap();
    exists(&[]);
    let (done, again) = run(&["--force"]);
    assert!(done && again == said, "{again}");
    folder.write("nested.parquet", &nested(&drives(13, 300, 1, 20)), 200);
    exists(&[]);
}

/// Stops after two re-estimations.
fn stop(folder: &Folder) -> LearnJob {
    let job = learn_job(folder, "nested.parquet", "out.json", 2);
    let stopped = job.clone();
    let stopped = thread::spawn(move || learn(&stopped, |k, _| assert!(k < 2, "interrupted")));
    assert!(stopped.join().is_err());
    job
}

#[test]
fn fewer_iterations_than_are_made_are_refused() {
    let (folder, _) = prepared();
    let mut job = stop(&folder);
    job.iterations = 1;
    let error = learn(&job, |_, _| {}).unwrap_err().to_string();
    assert!(error.contains("made 2 re-estimations already, but --iterations is 1"), "{error}");
    job.iterations = 2;
    assert_eq!(learn(&job, |_, _| {}).unwrap().log_likelihoods.len(), 3);
    let found = fs::read(&job.output).unwrap();
    job.output = folder.path("whole.json");
    learn(&job, |_, _| {}).unwrap();
    assert!(fs::read(&job.output).unwrap() == found);
}

#[test]
fn a_damaged_state_is_refused() {
    let (folder, _) = prepared();
    let job = stop(&folder);
    let path = folder.path("out.json.partial");
    let state = fs::read(&path).unwrap();
    let mut rng = rng(1);
    for _ in 0..200 {
        let mut damaged = state.clone();
        damaged[rng.random_range(0..state.len())] ^= 1 << rng.random_range(0..8);
        fs::write(&path, damaged).unwrap();
        let error = learn(&job, |_, _| {}).unwrap_err().to_string();
        assert!(error.contains("out.json.partial: is damaged"), "{error}");
    }
}
