//! The subcommand `simulate`: drives drawn from a model, to try things out.

use std::fs::{self, File};
use std::path::PathBuf;
use std::sync::Arc;

use arrow_array::{ArrayRef, Int64Array, ListArray, RecordBatch, UInt32Array};
use arrow_buffer::OffsetBuffer;
use arrow_schema::{DataType, Field, Schema};
use clap::{Args, ValueEnum};
use parquet::arrow::ArrowWriter;
use parquet::basic::{Compression, Encoding};
use parquet::file::properties::WriterProperties;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use wayfix::{Hmm, TableLikelihood, TransitionEntries};

use crate::error::{FleetError, Outcome};
use crate::journal::open_locked;
use crate::model::{Model, with_hmm};
use crate::overwrite::{self, beside};
use crate::sensor::{Kind, Sensor};

/// Steps of a row group, unless a single drive is longer.
const GROUP: usize = 1 << 20;
/// Maximum steps of a drive: a row group is built in memory.
const LONGEST: usize = 1 << 24;

/// Draws drives from a model, with their hidden states.
#[derive(Debug, Clone, Args)]
pub struct SimulateCommand {
    /// Model with a table of symbols, the JSON of a wayfix `Hmm`.
    #[arg(long)]
    model: PathBuf,
    /// Number of drives.
    #[arg(long, default_value_t = 1000)]
    drives: usize,
    /// Steps of each drive.
    #[arg(long, default_value_t = 50)]
    steps: usize,
    /// Seed of the random numbers: the same seed gives the same drives.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// One row per step, or one per drive.
    #[arg(long, default_value = "nested")]
    form: SimulatedForm,
    /// Output, Parquet.
    #[arg(long)]
    output: PathBuf,
    /// Replaces an existing output.
    #[arg(long)]
    force: bool,
}

/// Rows of simulated drives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SimulatedForm {
    /// One row per step.
    Long,
    /// One row per drive.
    Nested,
}

impl SimulateCommand {
    /// Writes the drives, and returns a summary line.
    ///
    /// # Errors
    ///
    /// [`FleetError`] if a file cannot be read or written, or the sensor cannot draw observations.
    pub fn run(&self) -> Outcome<String> {
        let model = Model::load(&self.model)?;
        if self.steps > LONGEST {
            let message = format!("--steps {}: expected at most {LONGEST}", self.steps);
            return Err(FleetError::Settings(message));
        }
        overwrite::refuse([self.output.as_path()], [self.model.as_path()])?;
        let unfinished = beside(&self.output, ".unfinished");
        // Checked before the temporary file is created, and again under its lock, since another run
        // may have written the output in between.
        self.check_output()?;
        let file = open_locked(&unfinished)?;
        let done = self.check_output().and_then(|()| {
            with_hmm!(model, hmm => self.write(&drawable(hmm)?, file.try_clone()))?;
            fs::rename(&unfinished, &self.output).map_err(FleetError::file(&self.output))
        });
        if done.is_err() {
            // The first error says more than one from here. The lock is still held, so this is our
            // own file.
            _ = fs::remove_file(&unfinished);
        }
        done?;
        Ok(format!("{} drives of {} steps", self.drives, self.steps))
    }

    fn check_output(&self) -> Outcome<()> {
        if self.output.exists() && !self.force {
            let message = format!("{} exists; replace it with --force", self.output.display());
            return Err(FleetError::Settings(message));
        }
        Ok(())
    }

    fn write<A: TransitionEntries<Control = ()>>(
        &self,
        hmm: &Hmm<A, TableLikelihood>,
        file: std::io::Result<File>,
    ) -> Outcome<()> {
        let (wrong, failed) = (FleetError::file(&self.output), FleetError::parquet(&self.output));
        let file = file.map_err(&wrong)?;
        // A run that was killed may have left some contents.
        file.set_len(0).map_err(&wrong)?;
        let schema = Arc::new(self.schema());
        let properties = WriterProperties::builder()
            .set_compression(Compression::SNAPPY)
            .set_column_dictionary_enabled("trace_id".into(), false)
            .set_column_dictionary_enabled("step".into(), false)
            .set_column_encoding("trace_id".into(), Encoding::DELTA_BINARY_PACKED)
            .set_column_encoding("step".into(), Encoding::DELTA_BINARY_PACKED)
            .build();
        let mut writer =
            ArrowWriter::try_new(file, schema.clone(), Some(properties)).map_err(&failed)?;
        // One generator for all drives: row groups do not change the draws.
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        let group = (GROUP / self.steps.max(1)).max(1);
        let mut first = 0;
        while first < self.drives {
            let count = group.min(self.drives - first);
            let mut symbols: Vec<u32> = Vec::with_capacity(count * self.steps);
            let mut states: Vec<u32> = Vec::with_capacity(count * self.steps);
            for _ in 0..count {
                let drive = hmm.simulate(self.steps, &mut rng);
                symbols.extend(drive.observations().iter().map(|&symbol| symbol as u32));
                states.extend(drive.states().iter().map(|&state| state as u32));
            }
            let columns = self.columns(first, count, [symbols, states])?;
            let rows = RecordBatch::try_new(schema.clone(), columns)?;
            writer.write(&rows).and_then(|()| writer.flush()).map_err(&failed)?;
            first += count;
        }
        writer.finish().map_err(&failed)?;
        writer.inner().sync_all().map_err(&wrong)
    }

    fn schema(&self) -> Schema {
        let number = |name| Field::new(name, DataType::Int64, false);
        if self.form == SimulatedForm::Long {
            let counted = |name| Field::new(name, DataType::UInt32, false);
            let columns = [number("trace_id"), number("step")];
            return Schema::new([columns, [counted("observation"), counted("state")]].concat());
        }
        let list = |name| Field::new(name, DataType::List(item()), false);
        Schema::new(vec![number("trace_id"), list("observation"), list("state")])
    }

    /// Columns of `count` drives, numbered from `first`.
    fn columns(&self, first: usize, count: usize, steps: [Vec<u32>; 2]) -> Outcome<Vec<ArrayRef>> {
        let ids = first as i64..(first + count) as i64;
        let number = |values: Vec<i64>| Arc::new(Int64Array::from(values)) as ArrayRef;
        let steps = steps.map(|values| Arc::new(UInt32Array::from(values)) as ArrayRef);
        if self.form == SimulatedForm::Long {
            let ids = ids.flat_map(|id| std::iter::repeat_n(id, self.steps)).collect();
            let numbers = (0..count).flat_map(|_| 1..=self.steps as i64).collect();
            return Ok([vec![number(ids), number(numbers)], steps.to_vec()].concat());
        }
        let offsets = OffsetBuffer::from_lengths(std::iter::repeat_n(self.steps, count));
        let mut columns = vec![number(ids.collect())];
        for values in steps {
            columns.push(Arc::new(ListArray::try_new(item(), offsets.clone(), values, None)?));
        }
        Ok(columns)
    }
}

fn item() -> Arc<Field> {
    Arc::new(Field::new_list_field(DataType::UInt32, false))
}

/// The model with its table, which can draw symbols. The other sensors cannot: a likelihood tells
/// how well an observation fits, not how often it occurs.
fn drawable<A: Clone + TransitionEntries>(
    hmm: &Hmm<A, Sensor>,
) -> Outcome<Hmm<A, TableLikelihood>> {
    let Kind::Table(table) = hmm.likelihood().kind() else {
        let message =
            "the sensor of the model cannot draw observations, expected a TableLikelihood";
        return Err(FleetError::Settings(message.to_owned()));
    };
    Hmm::new(hmm.prior().clone(), hmm.transition().clone(), table.clone())
        .map_err(|error| FleetError::Settings(error.to_string()))
}
