//! Runs queries, and writes their rows to files.

use std::fs::File;
use std::io::Seek;
use std::path::Path;
use std::sync::Arc;

use arrow::datatypes::{DataType, Schema, SchemaRef};
use datafusion::execution::SendableRecordBatchStream;
use datafusion::physical_plan::sorts::sort_preserving_merge::SortPreservingMergeExec;
use datafusion::physical_plan::{ExecutionPlan, ExecutionPlanProperties, execute_stream};
use datafusion::prelude::DataFrame;
use futures::StreamExt;
use parquet::arrow::ArrowWriter;
use parquet::basic::Encoding;
use parquet::file::properties::{EnabledStatistics, WriterProperties};

use crate::error::{FleetError, Outcome};
use crate::properties::Pack;

/// Maximum bytes of a row group of the output.
const GROUP: usize = 16 << 20;

/// Runs a plan. If its partitions are ordered, they are merged in that order.
pub(super) async fn rows(frame: DataFrame) -> Outcome<SendableRecordBatchStream> {
    let task = Arc::new(frame.task_ctx());
    let mut plan = frame.create_physical_plan().await?;
    // `execute_stream` alone would interleave partitions as they come.
    if plan.output_partitioning().partition_count() > 1
        && let Some(order) = plan.output_ordering().cloned()
    {
        plan = Arc::new(SortPreservingMergeExec::new(order, plan)) as Arc<dyn ExecutionPlan>;
    }
    Ok(execute_stream(plan, task)?)
}

/// Writes rows to a file from its beginning, and reports how many there are so far.
pub(super) async fn write(
    mut rows: SendableRecordBatchStream,
    schema: &SchemaRef,
    file: &File,
    path: &Path,
    pack: Pack,
    mut progress: impl FnMut(u64),
) -> Outcome<u64> {
    let (wrong, failed) = (FleetError::file(path), FleetError::parquet(path));
    let mut file = file.try_clone().map_err(&wrong)?;
    file.set_len(0).and_then(|()| file.rewind()).map_err(&wrong)?;
    let mut writer = ArrowWriter::try_new(file, schema.clone(), Some(properties(schema, pack)))
        .map_err(&failed)?;
    let mut count = 0;
    while let Some(batch) = rows.next().await {
        let batch = batch?;
        count += batch.num_rows() as u64;
        writer.write(&batch).map_err(&failed)?;
        progress(count);
    }
    writer.finish().map_err(&failed)?;
    Ok(count)
}

/// Encodings: integers as differences, doubles plain, text in dictionaries.
pub(super) fn properties(schema: &Schema, pack: Pack) -> WriterProperties {
    let mut properties = WriterProperties::builder()
        .set_compression(pack.into())
        .set_dictionary_enabled(false)
        .set_statistics_enabled(EnabledStatistics::None)
        .set_max_row_group_row_count(None)
        .set_max_row_group_bytes(Some(GROUP));
    let Ok(leaves) = parquet::arrow::ArrowSchemaConverter::new().convert(schema) else {
        return properties.build(); // the writer will say why
    };
    for leaf in leaves.columns() {
        use parquet::basic::Type;
        let path = leaf.path().clone();
        properties = match leaf.physical_type() {
            Type::INT32 | Type::INT64 => {
                properties.set_column_encoding(path, Encoding::DELTA_BINARY_PACKED)
            }
            Type::BYTE_ARRAY => properties.set_column_dictionary_enabled(path, true),
            _ => properties,
        };
    }
    for field in schema.fields() {
        if !matches!(field.data_type(), DataType::List(_) | DataType::Struct(_)) {
            let column = parquet::schema::types::ColumnPath::from(field.name().as_str());
            properties = properties.set_column_statistics_enabled(column, EnabledStatistics::Chunk);
        }
    }
    properties.build()
}
