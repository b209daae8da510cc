//! The routines as scalar functions: one drive per row, all drives of a batch in one call.

use std::sync::Arc;

use arrow::array::{Array, ArrayRef, AsArray, Int64Array, RecordBatch, StructArray};
use arrow::datatypes::{DataType, Field, FieldRef, Fields, Schema};
use arrow::util::display::array_value_to_string;
use datafusion::common::{Result, plan_err};
use datafusion::error::DataFusionError;
use datafusion::logical_expr::{
    ColumnarValue, ReturnFieldArgs, ScalarFunctionArgs, ScalarUDFImpl, Signature, TypeSignature,
    Volatility,
};
use datafusion::scalar::ScalarValue;

use super::models::{Loaded, Models};
use crate::error::{FleetError, Outcome};
use crate::input::{self, ColumnNames, Drives, Form};
use crate::output::{self, Results, Table, Verb};
use crate::sensor::{Kind, Sensor};

/// Number of elements of a drive shown in an error.
const SHOWN: usize = 8;

/// Error of a function.
#[derive(Debug, thiserror::Error)]
#[error("{function}: {source}{about}")]
pub struct FunctionError {
    function: &'static str,
    #[source]
    source: FleetError,
    /// Batch and drive, since input rows have no numbers in SQL.
    about: String,
}

/// A routine as a function of SQL.
#[derive(Debug, PartialEq, Eq, Hash)]
pub(super) struct Function {
    verb: Verb,
    models: Models,
    signature: Signature,
}

impl Function {
    pub(super) fn new(verb: Verb, models: Models) -> Self {
        let counts = [2, 3, 4].map(TypeSignature::Any).to_vec();
        // Stable rather than immutable: a file may change between two queries.
        Self { verb, models, signature: Signature::one_of(counts, Volatility::Stable) }
    }

    fn name(&self) -> &'static str {
        match self.verb {
            Verb::Score => "wayfix_score",
            Verb::Smooth => "wayfix_smooth",
            Verb::Filter => "wayfix_filter",
            Verb::Decode => "wayfix_decode",
        }
    }

    fn results(&self) -> Outcome<Results> {
        let table = match self.verb {
            Verb::Score => Table::Drives,
            Verb::Smooth | Verb::Filter => Table::Steps,
            Verb::Decode => Table::Paths(1),
        };
        Results::new(self.verb, table, Form::Nested)
    }

    /// Results of drives, one per row.
    fn compute(&self, model: &str, arguments: &[ArrayRef]) -> Result<ArrayRef> {
        let run = || -> Outcome<ArrayRef> {
            let loaded = self.models.model(model)?;
            let drives = drives(&loaded, arguments)?;
            let results = self.results()?;
            let schema = Arc::new(results.schema(drives.ids.data_type()));
            let rows = output::results(&loaded.model, &results, &schema, &drives)?.rows;
            let column = |name: &str| {
                let missing = || FleetError::column(name, "is missing");
                rows.column_by_name(name).cloned().ok_or_else(missing)
            };
            if self.verb != Verb::Score {
                return column(results.list_name());
            }
            let fields = score_fields(&schema);
            let columns = fields.iter().map(|field| column(field.name()));
            let columns = columns.collect::<Outcome<Vec<_>>>()?;
            let rows = rows.num_rows();
            Ok(Arc::new(StructArray::try_new_with_length(fields, columns, None, rows)?))
        };
        run().map_err(|error| failure(self.name(), error, arguments))
    }
}

/// Error of a function, with the drive it is about.
pub(super) fn failure(
    function: &'static str,
    source: FleetError,
    arguments: &[ArrayRef],
) -> DataFusionError {
    let about = about(&source, arguments);
    DataFusionError::External(Box::new(FunctionError { function, source, about }))
}

/// Reads drives from the arguments after the model.
pub(super) fn drives(loaded: &Loaded, arguments: &[ArrayRef]) -> Outcome<Drives> {
    let names = names();
    let batch = batch(arguments, loaded.model.sensor(), &names)?;
    let layout = loaded.layout(&batch.schema(), &names)?;
    input::drives(&batch, &layout, 0)
}

impl ScalarUDFImpl for Function {
    fn name(&self) -> &str {
        self.name()
    }

    fn signature(&self) -> &Signature {
        &self.signature
    }

    fn return_type(&self, _: &[DataType]) -> Result<DataType> {
        let results = self.results().map_err(|error| DataFusionError::External(Box::new(error)))?;
        let schema = results.schema(&DataType::Int64);
        if self.verb == Verb::Score {
            return Ok(DataType::Struct(score_fields(&schema)));
        }
        Ok(schema.field_with_name(results.list_name())?.data_type().clone())
    }

    fn return_field_from_args(&self, args: ReturnFieldArgs<'_>) -> Result<FieldRef> {
        if !matches!(args.scalar_arguments.first(), Some(Some(model)) if text(model).is_some()) {
            return plan_err!(
                "the first argument of {} is the model, expected a literal text: the path of its \
                 file, or `path#hash`",
                self.name()
            );
        }
        // Nullable: a failed drive has no list. A score always has its struct, which holds the
        // error.
        let is_null = self.verb != Verb::Score;
        Ok(Arc::new(Field::new(self.name(), self.return_type(&[])?, is_null)))
    }

    fn invoke_with_args(&self, args: ScalarFunctionArgs) -> Result<ColumnarValue> {
        let Some(ColumnarValue::Scalar(model)) = args.args.first() else {
            return plan_err!("the model of {} is not a literal", self.name());
        };
        let Some(model) = text(model) else {
            return plan_err!("the model of {} is not a text", self.name());
        };
        let drives = &args.args[1..];
        // All literals: one drive, computed once for all rows.
        let is_one = drives.iter().all(|drive| matches!(drive, ColumnarValue::Scalar(_)));
        let rows = if is_one { 1 } else { args.number_rows };
        let arrays = drives.iter().map(|drive| drive.to_array(rows)).collect::<Result<Vec<_>>>()?;
        let result = self.compute(model, &arrays)?;
        if is_one {
            return Ok(ColumnarValue::Scalar(ScalarValue::try_from_array(&result, 0)?));
        }
        Ok(ColumnarValue::Array(result))
    }
}

/// Text of a scalar, unless it is null or of another type.
fn text(value: &ScalarValue) -> Option<&str> {
    value.try_as_str().flatten()
}

/// Names of the arguments, for errors.
fn names() -> ColumnNames {
    ColumnNames {
        trace_id: "row".to_owned(),
        step: "step".to_owned(),
        observation: "observations".to_owned(),
        elsewhere: "elsewhere".to_owned(),
        latitude: "latitudes".to_owned(),
        longitude: "longitudes".to_owned(),
        deviation: "deviations".to_owned(),
    }
}

/// Fields of the struct that `wayfix_score` returns.
fn score_fields(schema: &Schema) -> Fields {
    let is_of_score = |field: &&FieldRef| {
        ["log_likelihood", "error_kind", "error_step", "error"].contains(&field.name().as_str())
    };
    schema.fields().iter().filter(is_of_score).cloned().collect()
}

/// Arguments as a table of drives, with row numbers as ids.
fn batch(arguments: &[ArrayRef], sensor: &Sensor, names: &ColumnNames) -> Outcome<RecordBatch> {
    let (expected, least): (&[&String], usize) = match sensor.kind() {
        Kind::Places(_) => (&[&names.latitude, &names.longitude, &names.deviation], 3),
        Kind::Sparse(_) => (&[&names.observation, &names.elsewhere], 1),
        _ => (&[&names.observation], 1),
    };
    let given = arguments.len();
    if !(least..=expected.len()).contains(&given) {
        let list = expected.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
        let optional = if least < expected.len() { " (the last of them optional)" } else { "" };
        let message =
            format!("{given} arguments after the model, but its sensor takes {list}{optional}");
        return Err(FleetError::Settings(message));
    }
    let rows = arguments.first().map_or(0, Array::len);
    let ids: ArrayRef = Arc::new(Int64Array::from_iter_values(0..rows as i64));
    let columns = expected.iter().zip(arguments);
    let columns = columns.map(|(name, column)| (name.as_str(), column.clone()));
    let columns = std::iter::once((names.trace_id.as_str(), ids)).chain(columns);
    let columns = columns.map(|(name, column)| (name, column, true));
    Ok(RecordBatch::try_from_iter_with_nullable(columns)?)
}

/// Describes the batch, and the first elements of the drive, that an error is about.
fn about(error: &FleetError, arguments: &[ArrayRef]) -> String {
    let FleetError::Value { row, .. } = error else { return String::new() };
    let (Ok(row), Some(first)) = (usize::try_from(*row), arguments.first()) else {
        return String::new();
    };
    let drive: Option<ArrayRef> = match first.data_type() {
        _ if row >= first.len() || first.is_null(row) => None,
        DataType::List(_) => Some(first.as_list::<i32>().value(row)),
        DataType::LargeList(_) => Some(first.as_list::<i64>().value(row)),
        DataType::FixedSizeList(..) => Some(first.as_fixed_size_list().value(row)),
        _ => None,
    };
    let rows = first.len();
    let begins = drive.map_or_else(String::new, |drive| {
        let text = |k| array_value_to_string(&drive, k).unwrap_or_default();
        let shown: Vec<String> = (0..drive.len().min(SHOWN)).map(text).collect();
        let shown: String = shown.join(", ").chars().take(200).collect();
        format!(", in which this drive begins with {shown}")
    });
    format!("; rows are those of a batch of {rows}{begins}")
}
