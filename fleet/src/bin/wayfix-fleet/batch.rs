//! The commands `smooth`, `filter`, `decode` and `score`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use wayfix_fleet::input::Form;
use wayfix_fleet::output::{Table, Verb};
use wayfix_fleet::{FleetError, Job, Pack, Summary, run};

use crate::bar::{bar, show};
use crate::files::Files;

/// Options of a routine with results for each drive.
#[derive(Debug, Args)]
pub(crate) struct Batch {
    #[command(flatten)]
    files: Files,
    /// Table of results: steps or best (smooth, filter), paths (decode), or drives.
    #[arg(long)]
    table: Option<Content>,
    /// Number of states per step (best) or of paths per drive (paths).
    #[arg(long, default_value_t = 1)]
    count: usize,
    /// One row per step (long) or per drive (nested); by default as in the input.
    #[arg(long)]
    form: Option<FormOf>,
    /// Minimum rows (steps) in a row group of the output. An interruption loses only the incomplete
    /// one.
    #[arg(long, default_value_t = 1 << 19)]
    part: usize,
    /// Compression of the output.
    #[arg(long, default_value = "none")]
    compression: Pack,
    /// Leaves out invalid drives, and writes them to a file: a line of JSON with file, row,
    /// trace_id, column and reason. A folder if the output is one.
    #[arg(long, value_name = "FILE")]
    skip_invalid: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Content {
    Steps,
    Best,
    Paths,
    Drives,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum FormOf {
    Long,
    Nested,
}

impl Batch {
    pub(crate) fn run(&self, verb: Verb) -> Result<String, FleetError> {
        let files = &self.files;
        let content = self.table.unwrap_or(match verb {
            Verb::Smooth | Verb::Filter => Content::Steps,
            Verb::Decode => Content::Paths,
            Verb::Score => Content::Drives,
        });
        let job = Job {
            model: files.model.clone(),
            inputs: files.input.clone(),
            output: files.output.clone(),
            left_out: self.skip_invalid.clone(),
            names: files.names(),
            verb,
            table: match content {
                Content::Steps => Table::Steps,
                Content::Best => Table::Best(self.count),
                Content::Paths => Table::Paths(self.count),
                Content::Drives => Table::Drives,
            },
            form: self.form.map(|form| match form {
                FormOf::Long => Form::Long,
                FormOf::Nested => Form::Nested,
            }),
            part: self.part,
            pack: self.compression,
            threads: files.threads(),
            start: files.start(),
        };
        let bar = bar(files.quiet);
        let done = run(&job, |progress| show(&bar, progress));
        bar.finish_and_clear();
        let Summary { drives, steps, failed, left_out, parts, resumed, outputs, finished } = done?;
        let mut text = format!("{drives} drives, {steps} steps, {failed} drives with an error");
        if left_out > 0 {
            text += &format!(", {left_out} drives left out");
        }
        if finished == outputs {
            text += "; finished already";
        } else if finished > 0 {
            text += &format!("; {finished} of {outputs} outputs were finished already");
        }
        if resumed > 0 {
            text += &format!("; {resumed} of {parts} parts were there already");
        }
        Ok(text)
    }
}
