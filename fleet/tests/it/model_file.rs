//! The subcommands `model` and `simulate`.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use arrow::array::AsArray;
use arrow::datatypes::UInt32Type;
use serde_json::{Value, json};
use wayfix::{Hmm, LikelihoodVector};

use crate::kit::*;

fn fleet(folder: &Folder, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_wayfix-fleet"))
        .args(arguments)
        .current_dir(folder.dir.path())
        .output()
        .unwrap()
}

/// Standard output of a command that succeeds.
fn said(folder: &Folder, arguments: &[&str]) -> String {
    let done = fleet(folder, arguments);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    String::from_utf8(done.stdout).unwrap()
}

/// Standard error of a command that fails.
fn refused(folder: &Folder, arguments: &[&str]) -> String {
    let done = fleet(folder, arguments);
    assert_eq!(done.status.code(), Some(1));
    assert!(done.stdout.is_empty());
    String::from_utf8(done.stderr).unwrap()
}

#[test]
fn a_mistake_is_named_with_its_place() {
    let good = serde_json::to_value(model(1)).unwrap();
    let folder = Folder::new(&good);
    let check = ["model", "check", "model.json"];
    assert_eq!(said(&folder, &check), "model.json: valid\n");
    let set = |path: &str, value: Value| {
        let mut model = good.clone();
        *model.pointer_mut(path).unwrap() = value;
        fs::write(folder.path("model.json"), model.to_string()).unwrap();
        refused(&folder, &check)
    };
    for (path, value, expected) in [
        (
            "/transition/probability/0",
            json!(0.75),
            "column 0 (the transitions out of state 0) sums to",
        ),
        ("/transition/probability/2", json!(-0.5), "from state 1 to state 2 has probability -0.5"),
        ("/transition/to/2", json!(11), "state 11"),
        ("/likelihood/rows/3/2", json!(-0.25), "the probability of symbol 2 in state 3 is -0.25"),
        ("/likelihood/rows/3/2", json!(0.95), "the sum of the symbol probabilities of state 3 is"),
        ("/likelihood/rows", json!([[0.5, 0.5]]), "has 1 states, expected 11"),
        ("/prior/at_first_observation/4", json!(0.5), "the sum of the probabilities is 1."),
        ("/likelihood", json!({}), "the sensor is not one of"),
        ("/transition", json!({}), "`transition` is neither"),
        ("/transition/states", json!("x"), "expected usize"),
    ] {
        let message = set(path, value);
        assert!(message.starts_with("error: model.json: not a model: "), "{message}");
        assert!(message.contains(expected), "{path}: {message}");
    }
    for (name, text) in [("empty", ""), ("cut", "{\"prior\":"), ("bytes", "\u{0}\u{1}")] {
        fs::write(folder.path(name), text).unwrap();
        let message = refused(&folder, &["model", "check", name]);
        assert!(message.contains("not a model: ") && message.contains("line 1"), "{message}");
    }
    assert!(refused(&folder, &["model", "show", "none"]).contains("none: No such file"));
}

#[test]
fn what_may_be_a_mistake_is_said() {
    let ring = json!({
        "version": 1,
        "prior": {"at_first_observation": [1.0, 0.0, 0.0, 0.0]},
        "transition": {"version": 1, "states": 4, "to": [1, 2, 0, 2, 3], "from": [0, 1, 2, 2, 3],
            "probability": [1.0, 1.0, 0.5, 0.5, 1.0]},
        "likelihood": {"version": 1,
            "rows": [[0.5, 0.0, 0.5], [0.5, 0.0, 0.5], [0.5, 0.0, 0.5], [1.0, 0.0, 0.0]]},
        "rounds_tails": false,
    });
    let folder = Folder::new(&ring);
    let text = said(&folder, &["model", "check", "model.json"]);
    let expected = "model.json: valid\n\
        warning: state 3 cannot be reached from the prior, so no observation is ever made there\n\
        warning: state 3 cannot be left (absorbing)\n\
        warning: symbol 1 has probability 0 in every state, so a drive that contains it is impossible\n";
    assert_eq!(text, expected);
    let mut before = ring;
    before["prior"] = json!({"before_first_transition": [0.0, 0.0, 0.0, 1.0]});
    fs::write(folder.path("model.json"), before.to_string()).unwrap();
    let text = said(&folder, &["model", "check", "model.json"]);
    assert!(text.contains("states 0, 1, 2: each cannot be reached"), "{text}");
}

/// The table of sensors in the README.
#[test]
fn the_sensors_of_the_readme_are_valid() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/README.md");
    let text = fs::read_to_string(path).unwrap();
    let (_, table) = text.split_once("| sensor | JSON |\n|---|---|\n").unwrap();
    let rows = table.lines().take_while(|line| line.starts_with('|'));
    let expected = [
        "TableLikelihood, 2 symbols",
        "SparseTableLikelihood, 2 symbols",
        "LikelihoodVector of likelihoods",
        "SparseLikelihood",
        "places",
        "LikelihoodVector of logarithms, null if nothing was seen",
    ];
    let mut found = Vec::new();
    for row in rows {
        let (_, json) = row.trim_end_matches(" |").rsplit_once(" | ").unwrap();
        let sensor: Value = serde_json::from_str(json.trim_matches('`')).unwrap();
        let model = json!({
            "version": 1,
            "prior": {"at_first_observation": [0.5, 0.25, 0.25]},
            "transition": {"version": 1, "states": 3,
                "columns": [0.5, 0.5, 0.0, 0.0, 0.5, 0.5, 0.5, 0.0, 0.5]},
            "likelihood": sensor,
            "rounds_tails": false,
        });
        let folder = Folder::new(&model);
        assert_eq!(said(&folder, &["model", "check", "model.json"]), "model.json: valid\n");
        let shown = said(&folder, &["model", "show", "model.json"]);
        let line = shown.lines().find_map(|line| line.strip_prefix("sensor ")).unwrap();
        found.push(line.trim().to_owned());
        // As the library writes it.
        let read = wayfix_fleet::model::Model::load(&folder.path("model.json")).unwrap();
        assert_eq!(serde_json::to_value(read.sensor()).unwrap(), model["likelihood"], "{row}");
    }
    assert_eq!(found, expected);
}

#[test]
fn a_model_is_shown() {
    let folder = Folder::new(&model(1));
    let text = said(&folder, &["model", "show", "model.json"]);
    let hash = wayfix_fleet::model::Model::load(&folder.path("model.json")).unwrap();
    let expected = format!(
        "states      11\n\
         transition  SparseTransition, 21 entries above 0\n\
         prior       at the first observation, 11 states above 0\n\
         sensor      TableLikelihood, 6 symbols\n\
         name        model.json#{}\n",
        hash.hash()
    );
    assert_eq!(text, expected);
}

#[test]
fn drives_are_those_of_the_library() {
    let hmm = model(1);
    let folder = Folder::new(&hmm);
    let simulate = |form: &str, output: &str| {
        let mut arguments = vec!["simulate", "--model", "model.json", "--drives", "30"];
        arguments.extend(["--steps", "7", "--seed", "5", "--form", form, "--output", output]);
        said(&folder, &arguments)
    };
    assert_eq!(simulate("nested", "nested.parquet"), "30 drives of 7 steps\n");
    simulate("nested", "again.parquet");
    simulate("long", "long.parquet");
    let bytes = |name: &str| fs::read(folder.path(name)).unwrap();
    assert_eq!(bytes("nested.parquet"), bytes("again.parquet"));
    let mut rng = rng(5);
    let (nested, long) = (read(&folder.path("nested.parquet")), read(&folder.path("long.parquet")));
    let list = |name: &str, row: usize| -> Vec<u32> {
        let lists = nested.column_by_name(name).unwrap().as_list::<i32>().value(row);
        lists.as_primitive::<UInt32Type>().values().to_vec()
    };
    let (symbols, states_of) = (states(&long, "observation"), states(&long, "state"));
    for row in 0..30 {
        let drive = hmm.simulate(7, &mut rng);
        let of = |values: &[usize]| values.iter().map(|&value| value as u32).collect::<Vec<_>>();
        assert_eq!(list("observation", row), of(drive.observations()));
        assert_eq!(list("state", row), of(drive.states()));
        let steps = 7 * row..7 * row + 7;
        let flat = |column: &[Option<u32>]| column.iter().flatten().copied().collect::<Vec<_>>();
        assert_eq!(flat(&symbols[steps.clone()]), of(drive.observations()));
        assert_eq!(flat(&states_of[steps]), of(drive.states()));
    }
    for input in ["nested.parquet", "long.parquet"] {
        let output = format!("scored {input}");
        let arguments = ["--model", "model.json", "--input", input, "--output", &output, "--quiet"];
        let text = said(&folder, &[&["score"], &arguments[..]].concat());
        assert_eq!(text, "30 drives, 210 steps, 0 drives with an error\n");
    }
    let again = ["simulate", "--model", "model.json", "--output", "long.parquet"];
    assert!(refused(&folder, &again).contains("long.parquet exists; replace it with --force"));
    said(&folder, &[&again[..], &["--force", "--drives", "0"]].concat());
    assert_eq!(read(&folder.path("long.parquet")).num_rows(), 0);
    let vector = LikelihoodVector::linear(STATES).owned();
    let vector = Hmm::new(prior(), transition(&mut rng), vector).unwrap();
    fs::write(folder.path("model.json"), serde_json::to_vec(&vector).unwrap()).unwrap();
    let other = ["simulate", "--model", "model.json", "--output", "none.parquet"];
    let message = refused(&folder, &other);
    assert!(message.contains("cannot draw observations, expected a TableLikelihood"), "{message}");
    assert!(!Path::new(&folder.path("none.parquet")).exists());
    assert!(!folder.path("none.parquet.unfinished").exists());
}
