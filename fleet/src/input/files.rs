//! Files of an input: one file, all files of a folder, or those that match a pattern.
//!
//! The order is part of the result, so it must not depend on the file system: names are sorted by
//! their bytes, folder by folder.

use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};

use crate::error::{FleetError, Outcome};
use crate::storage::{self, Listed};

/// An input file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct InputFile {
    pub(crate) path: PathBuf,
    /// Path within the given folder, or from where the pattern begins.
    pub(crate) relative: PathBuf,
}

/// Files of an input, in the order they are read.
#[derive(Debug, Clone)]
pub(crate) struct InputFiles {
    pub(crate) files: Vec<InputFile>,
    /// Folders that were searched.
    pub(crate) folders: Vec<PathBuf>,
    /// True if the input is a single file, given by name.
    pub(crate) is_one: bool,
}

impl InputFiles {
    /// The files and the model: everything that is read.
    pub(crate) fn read_with<'a>(&'a self, model: &'a Path) -> impl Iterator<Item = &'a Path> {
        self.files.iter().map(|file| file.path.as_path()).chain([model])
    }
}

/// Finds the files: inputs in the order given, those of a folder or pattern sorted by path.
///
/// # Errors
///
/// [`FleetError`] if a folder cannot be read, nothing is found, or a file occurs twice.
pub(crate) fn find(inputs: &[PathBuf]) -> Outcome<InputFiles> {
    let mut found = InputFiles { files: Vec::new(), folders: Vec::new(), is_one: false };
    for input in inputs {
        let before = found.files.len();
        if storage::is_url(input) {
            match storage::list(input)? {
                Listed::One(path) => {
                    let relative = path.file_name().map(PathBuf::from).unwrap_or_default();
                    found.files.push(InputFile { path, relative });
                    found.is_one = inputs.len() == 1;
                }
                Listed::Folder(objects, on_disk) => {
                    let file = |(path, relative)| InputFile { path, relative };
                    found.files.extend(objects.into_iter().map(file));
                    found.folders.extend(on_disk);
                }
            }
        } else if input.is_dir() {
            found.folders.push(input.clone());
            folder(input, Path::new(""), &mut found.files)?;
        } else if is_pattern(input) {
            pattern(input, &mut found)?;
        } else {
            // A missing file is reported when it is opened.
            let relative = input.file_name().map(PathBuf::from).unwrap_or_default();
            found.files.push(InputFile { path: input.clone(), relative });
            found.is_one = inputs.len() == 1;
        }
        // Each input must contribute: an empty folder is most likely a mistyped name.
        if found.files.len() == before {
            return Err(FleetError::format(input, "has no files"));
        }
    }
    if found.files.is_empty() {
        return Err(FleetError::Settings("no input is given".to_owned()));
    }
    // A file may occur twice through a link or overlapping patterns. Its drives would be counted
    // twice.
    let mut paths = HashSet::new();
    for file in &found.files {
        if !paths.insert(fs::canonicalize(&file.path).unwrap_or_else(|_| file.path.clone())) {
            let message = "occurs twice in the input";
            return Err(FleetError::format(&file.path, message));
        }
    }
    Ok(found)
}

/// True for a pattern; an existing path is not one, whatever characters it has.
fn is_pattern(input: &Path) -> bool {
    let text = input.to_string_lossy();
    text.contains(['*', '?', '[']) && !input.exists()
}

/// Adds the files of a folder and its subfolders, except hidden ones and those that other tools
/// write beside their data.
fn folder(root: &Path, within: &Path, files: &mut Vec<InputFile>) -> Outcome<()> {
    let here = root.join(within);
    let wrong = FleetError::file(&here);
    let mut entries = Vec::new();
    for entry in fs::read_dir(&here).map_err(&wrong)? {
        entries.push(entry.map_err(&wrong)?.file_name());
    }
    entries.retain(|name| !is_hidden(&name.to_string_lossy()));
    entries.sort_unstable();
    for name in entries {
        let relative = within.join(&name);
        let path = root.join(&relative);
        // `metadata` follows links, unlike the type of a directory entry.
        if fs::metadata(&path).map_err(FleetError::file(&path))?.is_dir() {
            folder(root, &relative, files)?;
        } else {
            files.push(InputFile { path, relative });
        }
    }
    Ok(())
}

/// True for `.part-0.crc`, `_SUCCESS`, `_metadata` and the like, but not for `_day=1`.
pub(crate) fn is_hidden(name: &str) -> bool {
    name.starts_with('.') || (name.starts_with('_') && !name.contains('='))
}

fn pattern(input: &Path, found: &mut InputFiles) -> Outcome<()> {
    let wrong = |error: &dyn std::fmt::Display| FleetError::format(input, error);
    let text = input.to_str().ok_or_else(|| wrong(&"is not Unicode, as a pattern must be"))?;
    // The part of the path before the first wildcard, to which relative paths refer.
    let plain = |part: &&std::ffi::OsStr| !part.to_string_lossy().contains(['*', '?', '[']);
    let base: PathBuf = input.iter().take_while(plain).collect();
    let options =
        glob::MatchOptions { require_literal_leading_dot: true, ..glob::MatchOptions::default() };
    let matches = glob::glob_with(text, options).map_err(|error| wrong(&error))?;
    let mut paths = Vec::new();
    for path in matches {
        paths.push(path.map_err(|error| wrong(&error))?);
    }
    paths.sort_unstable();
    for path in paths {
        let within = path.strip_prefix(&base).unwrap_or(&path).to_owned();
        // Hidden files are left out as in a folder, but only below the given path: the user may
        // well have named a hidden folder.
        let hidden = |part: &std::ffi::OsStr| is_hidden(&part.to_string_lossy());
        if within.iter().any(hidden) {
            continue;
        }
        if path.is_dir() {
            folder(&base, &within, &mut found.files)?;
            found.folders.push(path);
        } else {
            found.files.push(InputFile { path, relative: within });
        }
    }
    Ok(())
}
