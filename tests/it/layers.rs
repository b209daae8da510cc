//! Modules stand on modules of lower layers: no `crate::` path points upward.

use std::fs;
use std::path::Path;

/// From the lowest up; modules of one layer don't know each other.
const LAYERS: [&[&str]; 13] = [
    &["error", "random", "limits", "files"],
    &["kernels", "sequence", "fixed", "reorder"],
    &["belief"],
    &["groups"],
    &["transition", "likelihood"],
    &["hmm", "evaluate"],
    &["inference", "map", "emission"],
    &["motion"],
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

/// The modules after `crate::` in code, those in braces too.
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
