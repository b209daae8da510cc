//! Drives of several files, one file after the other.

use std::path::Path;

use arrow_schema::DataType;

use super::files::InputFiles;
use super::pieces::{Content, Digest, Piece, Pieces};
use super::{ColumnNames, Drives, Form, Input, Reading, open_with};
use crate::error::{FleetError, Outcome};
use crate::sensor::Sensor;

/// Files of drives, with the columns that a sensor needs.
pub(crate) struct Source<'a> {
    pub(crate) files: &'a InputFiles,
    names: &'a ColumnNames,
    sensor: &'a Sensor,
    /// True if invalid drives are left out, false if they are an error.
    leave_out: bool,
    /// Pieces read so far.
    pub(crate) pieces: Pieces,
    /// Type of the trace ids, the same in all files.
    pub(crate) id_type: DataType,
    /// Form of the first file.
    pub(crate) form: Form,
    /// Rows of all files, if known.
    pub(crate) rows: Option<u64>,
    /// For each file, the rows of the files before it.
    rows_before: Vec<u64>,
}

impl<'a> Source<'a> {
    /// Opens each file once, so that a missing column is reported before any work is done.
    pub(crate) fn new(
        files: &'a InputFiles,
        names: &'a ColumnNames,
        sensor: &'a Sensor,
        leave_out: bool,
    ) -> Outcome<Self> {
        let mut source = Self {
            files,
            names,
            sensor,
            leave_out,
            pieces: Pieces::default(),
            id_type: DataType::Null,
            form: Form::Long,
            rows: Some(0),
            rows_before: Vec::with_capacity(files.files.len()),
        };
        for file in 0..files.files.len() {
            // Only headers and footers are read here; batches are lazy.
            let found = source.open(file, 0)?;
            if file == 0 {
                (source.id_type, source.form) = (found.id_type, found.form);
            }
            source.rows_before.push(source.rows.unwrap_or(0));
            // The number of rows is unknown from the first CSV file onwards.
            source.rows = source.rows.zip(found.rows).map(|(sum, rows)| sum + rows);
        }
        Ok(source)
    }

    pub(crate) fn path(&self, file: usize) -> &'a Path {
        self.files.files.get(file).map_or(Path::new(""), |file| &file.path)
    }

    /// Rows before row `row` of a file, counting all files before it as far as their rows are
    /// known.
    pub(crate) fn rows_until(&self, file: usize, row: u64) -> u64 {
        self.rows_before.get(file).copied().unwrap_or(0) + row
    }

    fn open(&self, file: usize, skip: u64) -> Outcome<Input> {
        let path = self.path(file);
        let named = |error: FleetError| if self.files.is_one { error } else { error.in_file(path) };
        let pieces = Some(self.pieces.clone());
        let reading = Reading { file, pieces, leave_out: self.leave_out };
        let found = open_with(path, self.names, self.sensor, skip, &reading).map_err(named)?;
        // `id_type` is `Null` only while the first file is opened.
        if self.id_type != DataType::Null && found.id_type != self.id_type {
            let message = format!(
                "is read as {}, but as {} in {}; ids must be integers in all files, or text in all",
                found.id_type,
                self.id_type,
                self.path(0).display()
            );
            return Err(FleetError::column(&self.names.trace_id, message).in_file(path));
        }
        Ok(found)
    }

    /// Drives from row `row` of file `file` onwards, each batch with the number of its file.
    pub(crate) fn drives(
        &self,
        file: usize,
        row: u64,
    ) -> impl Iterator<Item = Outcome<(usize, Drives)>> {
        // Files are opened one at a time, when the previous one is exhausted.
        (file..self.files.files.len()).flat_map(move |number| {
            let opened = self.open(number, if number == file { row } else { 0 });
            let (batches, error) = match opened {
                Ok(found) => (Some(found.batches), None),
                Err(error) => (None, Some(Err(error))),
            };
            let named = move |drives: Outcome<Drives>| match drives {
                Ok(drives) => Ok((number, drives)),
                Err(error) => Err(self.name(number, error)),
            };
            batches.into_iter().flatten().map(named).chain(error)
        })
    }

    /// Adds the file to an error, if there are several.
    pub(crate) fn name(&self, file: usize, error: FleetError) -> FleetError {
        if self.files.is_one { error } else { error.in_file(self.path(file)) }
    }

    /// Checks that pieces are unchanged.
    pub(crate) fn check<'p>(&self, pieces: impl Iterator<Item = &'p Piece>) -> Outcome<()> {
        let mut open: Option<(usize, Content)> = None;
        for piece in pieces {
            let path = self.path(piece.file);
            // Pieces are in the order of reading, so one open file at a time suffices.
            if open.as_ref().is_none_or(|(file, _)| *file != piece.file) {
                let content = Content::open(path, self.names, self.sensor);
                open = Some((piece.file, content.map_err(|error| self.name(piece.file, error))?));
            }
            let Some((_, content)) = &mut open else { continue };
            let found = content.hash(piece.number)?;
            if found != Some(piece.hash) {
                let number = piece.number;
                let what = match found {
                    Some(_) => format!("{} has changed", content.name(number)),
                    None => format!("row group or block {number} has disappeared"),
                };
                let message = format!(
                    "{what} since parts of the unfinished run were made from it; put the file \
                     back, or start over with --restart"
                );
                return Err(FleetError::changed(path, message));
            }
        }
        Ok(())
    }

    /// Digest of the contents of all files, as far as they are read. It equals the one that a run
    /// collects from its pieces.
    pub(crate) fn digest(&self) -> Outcome<Digest> {
        let mut digest = Digest::default();
        for file in 0..self.files.files.len() {
            let mut content = Content::open(self.path(file), self.names, self.sensor)
                .map_err(|error| self.name(file, error))?;
            for number in 0.. {
                let Some(hash) = content.hash(number)? else { break };
                // The first row is not part of the digest.
                digest.add(&Piece { file, number, first_row: 0, hash });
            }
        }
        Ok(digest)
    }
}
