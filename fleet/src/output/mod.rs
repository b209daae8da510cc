//! Tables of results: which routine has which, and their schemas.

mod measures;
mod rows;
mod tables;

use arrow_array::RecordBatch;
use arrow_schema::{DataType, Field, Fields, Schema};
use clap::ValueEnum;

use crate::error::{FleetError, Outcome};
use crate::input::Form;
pub(crate) use rows::kind as error_kind;
pub use tables::results;

/// A routine that runs on each drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, ValueEnum)]
pub enum Verb {
    /// Distribution of each step given the whole drive.
    Smooth,
    /// Distribution of each step given the observations up to it.
    Filter,
    /// The most probable path.
    Decode,
    /// Log-likelihood.
    Score,
}

/// Contents of a table of results.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Table {
    /// For each step the most probable state, its probability, the entropy of the belief, and a
    /// log-likelihood.
    Steps,
    /// For each step the given number of most probable states, with their probabilities.
    Best(usize),
    /// The given number of most probable paths.
    Paths(usize),
    /// For each drive its number of steps, its log-likelihood, and its error, if any.
    Drives,
}

/// A routine and its table of results.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Results {
    verb: Verb,
    table: Table,
    form: Form,
}

/// Results of a batch of drives.
#[derive(Debug)]
pub struct Batch {
    /// Rows of the table.
    pub rows: RecordBatch,
    /// Number of drives.
    pub drives: u64,
    /// Number of their steps.
    pub steps: u64,
    /// Number of drives that ended with an error.
    pub failed: u64,
}

impl Results {
    /// Combines a routine with a table, in the long or nested form.
    ///
    /// # Errors
    ///
    /// [`FleetError::Settings`] if the routine has no such table, or the count is 0.
    pub fn new(verb: Verb, table: Table, form: Form) -> Outcome<Self> {
        let fits = match table {
            Table::Steps | Table::Best(_) => matches!(verb, Verb::Smooth | Verb::Filter),
            Table::Paths(_) => verb == Verb::Decode,
            Table::Drives => true,
        };
        if !fits {
            let message = "smooth and filter have the tables steps, best and drives, decode has \
                           paths and drives, score has drives";
            return Err(FleetError::Settings(message.to_owned()));
        }
        if matches!(table, Table::Best(0) | Table::Paths(0)) {
            let message = "the number of states or paths is 0, expected at least 1";
            return Err(FleetError::Settings(message.to_owned()));
        }
        Ok(Self { verb, table, form })
    }

    /// The routine.
    #[must_use]
    pub fn verb(&self) -> Verb {
        self.verb
    }

    /// Contents of the table.
    #[must_use]
    pub fn table(&self) -> Table {
        self.table
    }

    /// Schema of the table, for trace ids of the given type.
    #[must_use]
    pub fn schema(&self, id_type: &DataType) -> Schema {
        let id = field("trace_id", id_type.clone(), false);
        let error = [
            field("error_kind", DataType::Utf8, true),
            field("error_step", DataType::Int64, true),
            field("error", DataType::Utf8, true),
        ];
        // The probability of a path is joint with the observations; the likelihood sums it over all
        // paths.
        let total = match self.verb {
            Verb::Decode => number("log_probability"),
            _ => number("log_likelihood"),
        };
        let mut fields = vec![id];
        match (self.table, self.form) {
            // One row per drive in either form.
            (Table::Drives, _) => {
                fields.extend([field("steps", DataType::Int64, false), total]);
                fields.extend(error);
            }
            (_, Form::Long) => {
                if let Table::Paths(_) = self.table {
                    fields.push(field("rank", DataType::UInt32, true));
                }
                fields.extend(self.step_fields());
                fields.extend(self.long_total());
                // A failed drive keeps one row, with room for the kind alone; messages are in the
                // table of drives.
                fields.push(error[0].clone());
            }
            (_, Form::Nested) => {
                if let Table::Paths(_) = self.table {
                    fields.push(field("rank", DataType::UInt32, true));
                }
                let items = DataType::Struct(self.struct_fields());
                fields.push(field(self.list_name(), DataType::new_list(items, false), true));
                fields.push(total);
                fields.extend(error);
            }
        }
        Schema::new(fields)
    }

    /// Fields of a step in the long form. The step itself is never null; the others are in rows of
    /// failed drives.
    fn step_fields(&self) -> Vec<Field> {
        let mut fields = vec![field("step", DataType::Int64, false)];
        if let Table::Best(_) = self.table {
            fields.push(field("rank", DataType::UInt32, true));
        }
        fields.push(field("state", DataType::UInt32, true));
        match self.table {
            Table::Steps => fields.extend([number("probability"), number("entropy")]),
            Table::Best(_) => fields.push(number("probability")),
            Table::Paths(_) | Table::Drives => {}
        }
        if self.has_step_logs() {
            fields.push(number("log_likelihood"));
        }
        fields
    }

    /// True if each step has a log-likelihood of its own.
    fn has_step_logs(&self) -> bool {
        self.verb == Verb::Filter && self.table == Table::Steps
    }

    /// Field of the whole drive that the long form repeats in each row.
    fn long_total(&self) -> Option<Field> {
        match self.table {
            Table::Steps if !self.has_step_logs() => Some(number("log_likelihood")),
            Table::Paths(_) => Some(number("log_probability")),
            _ => None,
        }
    }

    /// Fields of a step in a list; none is null, since a failed drive has a null list.
    fn struct_fields(&self) -> Fields {
        self.step_fields().into_iter().map(|field| field.with_nullable(false)).collect()
    }

    /// Name of the list column in the nested form.
    #[must_use]
    pub fn list_name(&self) -> &'static str {
        match self.table {
            Table::Best(_) => "best",
            Table::Paths(_) => "path",
            Table::Steps | Table::Drives => "results",
        }
    }
}

fn field(name: &str, of: DataType, nullable: bool) -> Field {
    Field::new(name, of, nullable)
}

fn number(name: &str) -> Field {
    field(name, DataType::Float64, true)
}
