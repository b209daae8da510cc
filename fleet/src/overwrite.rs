//! Outputs that would overwrite what is read.

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::error::{FleetError, Outcome};
use crate::storage;

/// Endings of an output and of the files that commands write beside it, the output itself first.
const ENDINGS: [&str; 11] = [
    "",
    ".partial",
    ".journal",
    ".unfinished",
    ".lock",
    ".new",
    ".partial.new",
    ".run",
    ".run.new",
    ".iteration",
    ".iteration.new",
];

/// Path of a file beside the output.
pub(crate) fn beside(output: &Path, ending: &str) -> PathBuf {
    let mut name = output.as_os_str().to_owned();
    name.push(ending);
    PathBuf::from(name)
}

/// Refuses outputs that are also read, whatever their paths: a different spelling, or a link.
///
/// # Errors
///
/// [`FleetError::Settings`] with both paths.
pub(crate) fn refuse<'a>(
    outputs: impl IntoIterator<Item = &'a Path>,
    read: impl IntoIterator<Item = &'a Path>,
) -> Outcome<()> {
    let read: HashMap<Place, &Path> =
        read.into_iter().filter_map(|path| Some((place(&on_disk(path)?)?, path))).collect();
    for output in outputs {
        for written in ENDINGS.map(|ending| beside(output, ending)) {
            if let Some(path) = place(&written).and_then(|place| read.get(&place)) {
                return Err(FleetError::Settings(format!(
                    "{} would be written to, but is also read (as {}); choose another --output",
                    written.display(),
                    path.display()
                )));
            }
        }
    }
    Ok(())
}

/// True if two paths lead to the same file, or to the same name in a folder before the file
/// exists.
pub(crate) fn is_same(path: &Path, other: &Path) -> bool {
    let named = |path: &Path| {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        let folder = fs::canonicalize(folder.unwrap_or(Path::new("."))).ok()?;
        Some((folder, path.file_name()?.to_owned()))
    };
    let is_one = |a: Option<Place>, b: Option<Place>| a.is_some() && a == b;
    path == other || is_one(place(path), place(other)) || {
        let (path, other) = (named(path), named(other));
        path.is_some() && path == other
    }
}

/// Local path of an input, if it has one.
fn on_disk(path: &Path) -> Option<PathBuf> {
    if storage::is_url(path) { storage::on_disk(path) } else { Some(path.to_owned()) }
}

/// Identity of a file, whatever path leads to it: device and inode.
#[cfg(unix)]
type Place = (u64, u64);

#[cfg(unix)]
fn place(path: &Path) -> Option<Place> {
    use std::os::unix::fs::MetadataExt;
    fs::metadata(path).ok().map(|found| (found.dev(), found.ino()))
}

/// Elsewhere hard links are not recognised.
#[cfg(not(unix))]
type Place = PathBuf;

#[cfg(not(unix))]
fn place(path: &Path) -> Option<Place> {
    fs::canonicalize(path).ok()
}
