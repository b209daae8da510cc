//! Modules use only modules of lower layers, and the parts of a module only lower parts: no path
//! points upward or to a neighbour.

use std::fs;
use std::path::Path;

/// Layers from the lowest up; modules of one layer don't use each other.
const LAYERS: [&[&str]; 12] = [
    &["error", "random", "files", "stored"],
    &["sequence", "fixed", "reorder"],
    &["belief", "free_parameters"],
    &["groups"],
    &["transition", "likelihood"],
    &["hmm", "evaluate"],
    &["inference", "map"],
    &["motion", "observation"],
    &["canberra"],
    &["internal"],
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
    assert!(files > 100, "{files}");
}

#[test]
#[should_panic(expected = "crate::map is not below transition")]
fn a_path_upward_is_found() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("layers/transition");
    fs::create_dir_all(&folder).unwrap();
    fs::write(folder.join("a.rs"), "use crate::map::RoadMap;").unwrap();
    check(folder.parent().unwrap(), None, &mut 0);
}

/// Parts ("rooms") of inference, from the lowest up; those on one line may not use each other.
const ROOMS: [&[&str]; 6] = [
    &["step"],
    &["engines"],
    &["streams", "decoding"],
    &["sequences"],
    &["trellis", "pruned"],
    &["learning"],
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

/// Returns the uses of one part of a module by another: file, its part, the name, and whose it is.
fn arrows(folder: &Path, module: &str) -> Vec<[String; 4]> {
    let (mut files, mut found) = (Vec::new(), Vec::new());
    modules(folder, &[], &mut files);
    let root = files.iter().find(|(at, _)| at.is_empty()).map(|file| file.1.clone());
    let names = taken_from_rooms(&root.unwrap_or_default());
    let is_room = |room: &str| files.iter().any(|(at, _)| at.first().is_some_and(|at| at == room));
    for (at, code) in files.iter().filter(|(at, _)| !at.is_empty()) {
        let mut words = words_after(code, &format!("crate::{module}::"));
        words.extend(words_after(code, &"super::".repeat(at.len())));
        for word in words {
            let named = names.iter().find(|(name, _)| name == word);
            let room = named.map_or(word, |(_, room)| room);
            // Items of the root itself are in no part.
            if is_room(room) && room != at[0] {
                found.push([at.join("::"), at[0].clone(), word.to_owned(), room.to_owned()]);
            }
        }
    }
    found
}

/// Checks the parts of a module, and returns the number of uses among them.
fn check_rooms(folder: &Path, module: &str, rooms: &[&[&str]]) -> usize {
    let floor = |room: &str| {
        let found = rooms.iter().position(|rooms| rooms.contains(&room));
        found.unwrap_or_else(|| panic!("{module}::{room} is in no room"))
    };
    let arrows = arrows(folder, module);
    for [file, here, word, room] in &arrows {
        assert!(
            floor(room) < floor(here),
            "{module}::{file} takes {word} of {module}::{room}, which is not below it"
        );
    }
    arrows.len()
}

#[test]
fn no_path_points_to_a_room_above_or_beside() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/inference");
    let found = check_rooms(&folder, "inference", &ROOMS);
    assert!(found > 20, "{found} arrows");
}

#[test]
#[should_panic(expected = "inference::step::a takes Filter of inference::streams")]
fn a_path_to_a_room_above_is_found() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("rooms");
    fs::create_dir_all(folder.join("step")).unwrap();
    fs::create_dir_all(folder.join("streams")).unwrap();
    fs::write(folder.join("mod.rs"), "pub use streams::filter::Filter;").unwrap();
    fs::write(folder.join("step/a.rs"), "use super::super::{LogSum, Filter};").unwrap();
    fs::write(folder.join("streams/filter.rs"), "").unwrap();
    check_rooms(&folder, "inference", &ROOMS);
}

/// Files that are one concept: an operator may hand out its stored matrix
/// (`Transition::stored`), which is an operator itself.
const ONE_CONCEPT: (&str, [&str; 5]) =
    ("transition", ["operator", "entries", "stored", "sparse", "dense"]);

/// Fails if files of a folder, or of one below it, use each other in a circle.
fn check_circles(folder: &Path, module: &str) {
    let is_one = |room: &str| module == ONE_CONCEPT.0 && ONE_CONCEPT.1.contains(&room);
    let mut arrows = arrows(folder, module);
    arrows.retain(|[_, from, _, to]| !(is_one(from) && is_one(to)));
    for [_, start, ..] in &arrows {
        let (mut seen, mut waiting) = (Vec::new(), vec![start]);
        while let Some(here) = waiting.pop() {
            for [.., next] in arrows.iter().filter(|arrow| arrow[1] == *here) {
                assert!(next != start, "{module}: {start} is in a circle by {here}");
                if !seen.contains(&next) {
                    seen.push(next);
                    waiting.push(next);
                }
            }
        }
    }
    for entry in fs::read_dir(folder).unwrap().map(Result::unwrap) {
        if entry.path().is_dir() {
            let name = entry.file_name().into_string().unwrap();
            check_circles(&entry.path(), &format!("{module}::{name}"));
        }
    }
}

#[test]
fn no_files_of_a_folder_use_each_other_in_a_circle() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    for entry in fs::read_dir(source).unwrap().map(Result::unwrap) {
        if entry.path().is_dir() {
            check_circles(&entry.path(), &entry.file_name().into_string().unwrap());
        }
    }
}

#[test]
#[should_panic(expected = "step: a is in a circle by b")]
fn a_circle_is_found() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("circles");
    fs::create_dir_all(&folder).unwrap();
    fs::write(folder.join("mod.rs"), "mod a; mod b; pub use b::B;").unwrap();
    fs::write(folder.join("a.rs"), "use super::B;").unwrap();
    fs::write(folder.join("b.rs"), "fn b() { crate::step::a::A }").unwrap();
    check_circles(&folder, "step");
}
