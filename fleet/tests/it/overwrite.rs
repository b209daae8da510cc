//! An output never overwrites what is read.

use std::fs;
use std::path::PathBuf;
use std::process::Command;

use wayfix_fleet::learn;
use wayfix_fleet::output::{Table, Verb};

use crate::kit::*;

/// Files of the folder with their content.
fn all(folder: &Folder) -> Vec<(PathBuf, Vec<u8>)> {
    let entries = fs::read_dir(folder.dir.path()).unwrap().map(|entry| entry.unwrap().path());
    let files = entries.filter(|path| path.is_file());
    let mut files: Vec<_> = files.map(|path| (path.clone(), fs::read(path).unwrap())).collect();
    files.sort();
    files
}

#[test]
fn an_output_that_is_read_is_refused_by_every_path() {
    let folder = Folder::new(&model(11));
    folder.write("nested.parquet", &nested(&drives(12, 300, 1, 20)), 200);
    for name in ["out.parquet.partial", "run.parquet.journal", "drawn.unfinished", "out.json.lock"]
    {
        fs::copy(folder.path("nested.parquet"), folder.path(name)).unwrap();
    }
    fs::create_dir(folder.path("days")).unwrap();
    let mut outputs = vec![
        "nested.parquet",
        "days/../nested.parquet",
        "model.json",
        "./model.json",
        "out.parquet",
        "run.parquet",
        "out.json",
    ];
    if cfg!(unix) {
        #[cfg(unix)]
        for (kept, link) in [("nested.parquet", "soft"), ("model.json", "soft model")] {
            std::os::unix::fs::symlink(folder.path(kept), folder.path(link)).unwrap();
        }
        fs::hard_link(folder.path("nested.parquet"), folder.path("hard")).unwrap();
        fs::hard_link(folder.path("model.json"), folder.path("hard model")).unwrap();
        outputs.extend(["soft", "hard", "soft model", "hard model"]);
    }
    let before = all(&folder);
    let refused = |arguments: &[&str], output: &str| {
        for more in [&[][..], &["--force"]] {
            let mut command = Command::new(env!("CARGO_BIN_EXE_wayfix-fleet"));
            command.current_dir(folder.dir.path()).args(arguments).args(["--model", "model.json"]);
            let done = command.args(["--output", output]).args(more).output().unwrap();
            let said = String::from_utf8(done.stderr).unwrap();
            assert_eq!(done.status.code(), Some(1), "{arguments:?} {output}: {said}");
            let expected = "would be written to, but is also read (as ";
            assert!(said.contains(expected), "{arguments:?} {output}: {said}");
            assert!(all(&folder) == before, "{arguments:?} {output}: {said}");
        }
    };
    for command in ["smooth", "filter", "decode", "score", "learn"] {
        for &output in &outputs {
            let input = match output {
                "out.parquet" => "out.parquet.partial",
                "run.parquet" => "run.parquet.journal",
                "out.json" => "out.json.lock",
                _ => "nested.parquet",
            };
            refused(&[command, "--input", input, "--quiet"], output);
        }
    }
    // One of several inputs, the file of left-out drives, and a folder of results.
    let two = ["smooth", "--input", "nested.parquet", "--input", "out.json.lock", "--quiet"];
    refused(&two, "nested.parquet");
    let lines = ["smooth", "--input", "nested.parquet", "--quiet", "--skip-invalid", "model.json"];
    refused(&lines, "fine.parquet");
    refused(&["smooth", "--input", "nested.parquet", "--quiet"], ".");
    for output in outputs.iter().filter(|output| output.contains("model")) {
        refused(&["simulate"], output);
    }
}

#[test]
fn lines_about_drives_have_a_file_of_their_own() {
    let folder = Folder::new(&model(11));
    folder.write("nested.parquet", &nested(&drives(12, 30, 1, 20)), 200);
    fs::create_dir(folder.path("days")).unwrap();
    let mut job = folder.job("nested.parquet", "out", Verb::Score, Table::Drives);
    for same in ["out", "./out", "days/../out"] {
        job.left_out = Some(folder.path(same));
        let error = go_on(&job).unwrap_err().to_string();
        assert!(error.contains("other than the output"), "{same}: {error}");
    }
}

#[test]
fn a_model_is_not_learned_into_its_input() {
    let folder = Folder::new(&model(11));
    fs::create_dir(folder.path("days")).unwrap();
    folder.write("days/1.parquet", &nested(&drives(12, 30, 1, 20)), 200);
    let job = learn_job(&folder, "days", "days/learned.json", 1);
    let error = learn(&job, |_, _| {}).unwrap_err().to_string();
    assert!(error.contains("which is part of the input"), "{error}");
    assert_eq!(fs::read_dir(folder.path("days")).unwrap().count(), 1);
}
