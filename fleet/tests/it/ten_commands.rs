//! The first section of the README works as written.

use std::fs;
use std::process::Command;

use serde_json::Value;
use wayfix::{Belief, Hmm, Prior, SparseTransition, TableLikelihood};
use wayfix_fleet::model::Model;

use crate::kit::read;

/// First block of the README in a language.
fn block(language: &str) -> String {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/README.md");
    let text = fs::read_to_string(path).unwrap();
    let (_, from) = text.split_once(&format!("```{language}\n")).unwrap();
    from.split_once("```").unwrap().0.to_owned()
}

fn one_line(code: &str) -> String {
    code.split_whitespace().collect::<Vec<_>>().join(" ")
}

type Ring = Hmm<SparseTransition, TableLikelihood>;

/// The model of the README in Rust.
fn ring() -> Result<Ring, Box<dyn std::error::Error>> {
    let n = 4; // places on a ring: 0.3 to stay, 0.7 to the next one
    let moves = (0..n).flat_map(|from| [(from, from, 0.3), ((from + 1) % n, from, 0.7)]);
    let shows = |place, symbol| if place == symbol { 0.85 } else { 0.05 };
    let row = |place| (0..n).map(|symbol| shows(place, symbol)).collect();
    let rows: Vec<Vec<f64>> = (0..n).map(row).collect();
    let hmm = Hmm::new(
        Prior::AtFirstObservation(Belief::uniform(n)?),
        SparseTransition::from_triplets(n, moves)?,
        TableLikelihood::from_rows(&rows)?,
    )?;
    Ok(hmm)
}

#[test]
fn a_new_user_gets_on() {
    // The code in the README is the code compiled here.
    let shown = block("rust");
    let (code, _) = shown.split_once("std::fs::write").unwrap();
    let (_, code) = code.split_once(";\n").unwrap();
    assert!(one_line(include_str!("ten_commands.rs")).contains(&one_line(code)), "{code}");
    let rust = serde_json::to_value(ring().unwrap()).unwrap();

    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let has_python = Command::new("python3").arg("--version").output().is_ok();
    let mut script = block("sh");
    assert!(script.lines().count() <= 10, "{script}");
    // It is built already.
    script = script.replace("cargo build --release", "true");
    if has_python {
        fs::write(path("model.py"), block("python")).unwrap();
    } else {
        script = script.replace("python3 model.py", "true");
        fs::write(path("model.json"), rust.to_string()).unwrap();
    }
    fs::create_dir_all(path("target/release")).unwrap();
    fs::copy(env!("CARGO_BIN_EXE_wayfix-fleet"), path("target/release/wayfix-fleet")).unwrap();
    let done = Command::new("sh").args(["-e", "-c", &script]).current_dir(folder.path()).output();
    let done = done.unwrap();
    let said = String::from_utf8_lossy(&done.stdout);
    assert!(done.status.success(), "{said}{}", String::from_utf8_lossy(&done.stderr));
    assert!(said.contains("model.json: valid\n") && said.contains("\"state\":2"), "{said}");
    assert_eq!(read(&path("smoothed.parquet")).num_rows(), 1000);
    let python = fs::read(path("model.json")).unwrap();
    Model::from_json(&python).unwrap();
    let python: Ring = serde_json::from_slice(&python).unwrap();
    assert_eq!(serde_json::to_value(python).unwrap(), rust);
    assert!(rust.get("rounds_tails") == Some(&Value::Bool(false)));
}
