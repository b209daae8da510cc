//! Modules use only modules of lower layers, and the parts of a module only lower parts: no path
//! points upward or to a neighbour.

use std::fs;
use std::path::Path;

/// Layers from the lowest up; modules of one layer don't use each other.
const LAYERS: [&[&str]; 13] = [
    &["error", "random", "limits", "files", "standard_normal"],
    &["kernels", "sequence", "fixed", "reorder"],
    &["belief", "free_parameters"],
    &["groups"],
    &["transition", "likelihood"],
    &["hmm", "evaluate"],
    &["inference", "map"],
    &["emission", "motion"],
    &["observation"],
    &["recognition", "matching", "canberra"],
    &["persistence"],
    &["guide"],
    &["lib"],
];

fn layer(module: &str) -> usize {
    let found = LAYERS.iter().position(|layer| layer.contains(&module));
    found.unwrap_or_else(|| panic!("the module {module} is in no layer"))
}

/// Returns the modules after `crate::` in code, including those in braces.
fn imports(code: &str) -> Vec<String> {
    let first_word = |text: &str| {
        text.trim().split(|c: char| !c.is_alphanumeric() && c != '_').next().map(String::from)
    };
    let mut found = Vec::new();
    for path in code.split("crate::").skip(1) {
        match path.strip_prefix('{') {
            Some(group) => {
                let group = &group[..group.find("};").unwrap_or(group.len())];
                found.extend(group.split(',').filter_map(first_word));
            }
            None => found.extend(first_word(path)),
        }
    }
    found
}

fn check(folder: &Path, top: Option<&str>, files: &mut usize) {
    for entry in fs::read_dir(folder).unwrap().map(Result::unwrap) {
        let path = entry.path();
        let stem = path.file_stem().unwrap().to_str().unwrap().to_owned();
        let module = top.unwrap_or(&stem);
        if path.is_dir() {
            check(&path, Some(module), files);
        } else if path.extension().is_some_and(|end| end == "rs") {
            *files += 1;
            let text = fs::read_to_string(&path).unwrap();
            let code: String =
                text.lines().filter(|line| !line.trim_start().starts_with("//")).collect();
            for import in imports(&code.replace("$crate::", "")) {
                let (below, here) = (layer(&import), layer(module));
                let allowed = import == module || below < here;
                assert!(allowed, "{}: crate::{import} is not below {module}", path.display());
            }
        }
    }
}

#[test]
fn no_path_points_upward() {
    let mut files = 0;
    check(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"), None, &mut files);
    assert!(files > 200, "{files}");
}

#[test]
#[should_panic(expected = "crate::map is not below transition")]
fn a_path_upward_is_found() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("layers/transition");
    fs::create_dir_all(&folder).unwrap();
    fs::write(folder.join("a.rs"), "use crate::map::RoadMap;").unwrap();
    check(folder.parent().unwrap(), None, &mut 0);
}

/// Parts ("rooms") of modules, from the lowest up; those on one line may not use each other.
const ROOMS: [(&str, &[&[&str]]); 2] = [
    (
        "inference",
        &[
            &["step"],
            &["engines"],
            &["streams", "decoding"],
            &["sequences"],
            &["trellis", "pruned"],
            &["beam"],
            &["learning"],
        ],
    ),
    (
        "emission",
        &[
            &["error"],
            &["check", "special", "rows"],
            &["columns", "series", "tails"],
            &["family", "marginals", "clusters"],
            &["normal", "concentration"],
            &["independent", "gaussian"],
            &[
                "multinomial",
                "von_mises_fisher",
                "gaussian_mixture",
                "student_t",
                "linear_regression",
            ],
            &["product"],
            &["start"],
            &["symbols", "residuals", "predictive"],
        ],
    ),
];

/// Returns the Rust files below a folder, each with its path as a module of the folder.
fn modules(folder: &Path, at: &[String], found: &mut Vec<(Vec<String>, String)>) {
    for entry in fs::read_dir(folder).unwrap().map(Result::unwrap) {
        let path = entry.path();
        let stem = path.file_stem().unwrap().to_str().unwrap().to_owned();
        let inside = [at, std::slice::from_ref(&stem)].concat();
        if path.is_dir() {
            modules(&path, &inside, found);
        } else if path.extension().is_some_and(|end| end == "rs") {
            let text = fs::read_to_string(&path).unwrap();
            let code = text.split("#[cfg(test)]\nmod tests {").next().unwrap();
            let lines = code.lines().filter(|line| !line.trim_start().starts_with("//"));
            let code: Vec<&str> = lines.collect();
            found.push((if stem == "mod" { at.to_vec() } else { inside }, code.join("\n")));
        }
    }
}

/// Returns the first words after a path that ends in `::`, including those in braces.
fn words_after<'a>(code: &'a str, path: &str) -> Vec<&'a str> {
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    let word = |text: &'a str| text.trim().split(|c| !is_word(c)).next().unwrap_or("");
    let mut found = Vec::new();
    for (at, _) in code.match_indices(path) {
        // `super::` after another one has been found with that.
        if path.starts_with("super") && code[..at].ends_with("super::") {
            continue;
        }
        match code[at + path.len()..].strip_prefix('{') {
            Some(group) => {
                let (mut depth, mut start) = (0, 0);
                for (end, c) in group.char_indices() {
                    match c {
                        '{' => depth += 1,
                        ',' | '}' if depth == 0 => {
                            found.push(word(&group[start..end]));
                            start = end + 1;
                            if c == '}' {
                                break;
                            }
                        }
                        '}' => depth -= 1,
                        _ => {}
                    }
                }
            }
            None => found.push(word(&code[at + path.len()..])),
        }
    }
    found
}

/// Returns the names that the root of a module re-exports, with the room of each.
fn taken_from_rooms(root: &str) -> Vec<(String, String)> {
    let mut found = Vec::new();
    for item in root.split(';').filter_map(|item| item.split_once("use ")) {
        let Some((room, names)) = item.1.split_once("::") else { continue };
        let names = names.rsplit("::").next().unwrap_or(names);
        let names = names.trim_matches(|c| c == '{' || c == '}').split(',');
        found.extend(names.map(|name| (name.trim().to_owned(), room.trim().to_owned())));
    }
    found
}

/// Checks the files of a module, and returns the number of arrows between its rooms.
fn check_rooms(folder: &Path, module: &str, rooms: &[&[&str]]) -> usize {
    let (mut files, mut arrows) = (Vec::new(), 0);
    modules(folder, &[], &mut files);
    let root = files.iter().find(|(at, _)| at.is_empty()).map(|file| file.1.clone());
    let names = taken_from_rooms(&root.unwrap_or_default());
    let floor = |room: &str| rooms.iter().position(|rooms| rooms.contains(&room));
    for (at, code) in files.iter().filter(|(at, _)| !at.is_empty()) {
        let here = floor(&at[0]);
        assert!(here.is_some(), "{module}::{} is in no room", at[0]);
        let mut words = words_after(code, &format!("crate::{module}::"));
        words.extend(words_after(code, &"super::".repeat(at.len())));
        for word in words {
            let named = names.iter().find(|(name, _)| name == word);
            let room = named.map_or(word, |(_, room)| room);
            // Items of the root itself belong to no room.
            let Some(below) = floor(room) else { continue };
            arrows += usize::from(room != at[0]);
            assert!(
                room == at[0] || Some(below) < here,
                "{module}::{} takes {word} of {module}::{room}, which is not below it",
                at.join("::")
            );
        }
    }
    arrows
}

#[test]
fn no_path_points_to_a_room_above_or_beside() {
    let arrows = ROOMS.iter().map(|(module, rooms)| {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("src").join(module);
        check_rooms(&folder, module, rooms)
    });
    let arrows: usize = arrows.sum();
    assert!(arrows > 100, "{arrows}");
}

#[test]
#[should_panic(expected = "inference::step::a takes Filter of inference::streams")]
fn a_path_to_a_room_above_is_found() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("rooms");
    fs::create_dir_all(folder.join("step")).unwrap();
    fs::write(folder.join("mod.rs"), "pub use streams::filter::Filter;").unwrap();
    fs::write(folder.join("step/a.rs"), "use super::super::{LogSum, Filter};").unwrap();
    check_rooms(&folder, "inference", ROOMS[0].1);
}
