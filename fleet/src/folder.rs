//! Runs over a folder: one file of results for each file of the input.
//!
//! Each output has its own journal, so an interrupted run skips the finished ones and continues
//! within the one it was writing.

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::error::{FleetError, Outcome};
use crate::input::files::{InputFile, InputFiles};
use crate::job::{Job, Progress, Summary, Target};
use crate::overwrite::{self, beside};

/// True for an existing folder, or for a name that ends with a slash.
pub(crate) fn is_folder(output: &Path) -> bool {
    let name = output.as_os_str().as_encoded_bytes();
    output.is_dir() || name.last().is_some_and(|&last| std::path::is_separator(last.into()))
}

/// Refuses a result inside an input folder: the next run would read it as input.
pub(crate) fn outside(files: &InputFiles, result: &Path) -> Outcome<()> {
    // The result need not exist yet, so resolve links in its nearest existing ancestor.
    let parents = result.ancestors().filter(|path| !path.as_os_str().is_empty());
    let here = parents.chain([Path::new(".")]).find_map(|path| fs::canonicalize(path).ok());
    for folder in &files.folders {
        let folder = fs::canonicalize(folder).map_err(FleetError::file(folder))?;
        if here.as_ref().is_some_and(|here| here.starts_with(&folder)) {
            let (result, folder) = (result.display(), folder.display());
            let message = format!("{result} is in {folder}, which is part of the input");
            return Err(FleetError::Settings(message));
        }
    }
    Ok(())
}

/// Runs `run_into` over each file by itself.
pub(crate) fn run(
    job: &Job,
    files: &InputFiles,
    progress: &mut dyn FnMut(&Progress),
    run_into: impl Fn(&InputFiles, Target<'_>, &mut dyn FnMut(&Progress)) -> Outcome<Summary>,
) -> Outcome<Summary> {
    // All conflicts are found before the first file is written: inputs named in two folders may
    // have the same relative path.
    let mut made: HashMap<PathBuf, &InputFile> = HashMap::new();
    for file in &files.files {
        if let Some(other) = made.insert(within(&job.output, file, "parquet"), file) {
            return Err(FleetError::Settings(format!(
                "{} and {} would both be written to the same file of results",
                other.path.display(),
                file.path.display()
            )));
        }
    }
    let invalid = job.left_out.as_ref();
    let lines = files.files.iter().filter_map(|file| Some(within(invalid?, file, "jsonl")));
    let written = lines.chain(made.into_keys()).collect::<Vec<_>>();
    overwrite::refuse(written.iter().map(PathBuf::as_path), files.read_with(&job.model))?;
    let (mut sum, mut before) = (Summary::default(), Progress::default());
    for file in &files.files {
        let output = within(&job.output, file, "parquet");
        let left_out = job.left_out.as_ref().map(|folder| within(folder, file, "jsonl"));
        for path in left_out.iter().chain([&output]) {
            let folder = path.parent().unwrap_or(Path::new(""));
            fs::create_dir_all(folder).map_err(FleetError::file(folder))?;
        }
        let target = Target { output: &output, left_out: left_out.as_deref(), has_names: false };
        let one =
            // No folders: `outside` has already checked the original ones.
            InputFiles { files: vec![file.clone()], folders: Vec::new(), is_one: files.is_one };
        let mut last = Progress::default();
        let done = run_into(&one, target, &mut |state| {
            last = *state;
            progress(&Progress {
                rows: before.rows + state.rows,
                all_rows: None,
                drives: before.drives + state.drives,
            });
        })?;
        before.rows += last.rows;
        before.drives += done.drives;
        sum.drives += done.drives;
        sum.steps += done.steps;
        sum.failed += done.failed;
        sum.left_out += done.left_out;
        sum.parts += done.parts;
        sum.resumed += done.resumed;
        sum.outputs += done.outputs;
        sum.finished += done.finished;
    }
    Ok(sum)
}

/// Path of a result in the output folder: the relative path of the input, with `ending` added
/// unless it is there already.
fn within(folder: &Path, file: &InputFile, ending: &str) -> PathBuf {
    let path = folder.join(&file.relative);
    let has_it = path.extension().is_some_and(|found| found.eq_ignore_ascii_case(ending));
    if has_it { path } else { beside(&path, &format!(".{ending}")) }
}
