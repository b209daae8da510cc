//! Encodings and compression of an output.

use arrow_schema::DataType;
use parquet::basic::{Compression, Encoding, ZstdLevel};
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::schema::types::ColumnPath;

use crate::input::Form;
use crate::job::Job;
use crate::model::Model;
use crate::names::FILE;
use crate::output::{Table, Verb};

/// Compression of the pages of an output.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Pack {
    /// Uncompressed: doubles at full precision hardly shrink.
    None,
    /// Fast.
    Lz4,
    /// Fast, and readable everywhere.
    Snappy,
    /// Small.
    Zstd,
}

impl From<Pack> for Compression {
    fn from(pack: Pack) -> Self {
        match pack {
            Pack::None => Self::UNCOMPRESSED,
            Pack::Lz4 => Self::LZ4_RAW,
            Pack::Snappy => Self::SNAPPY,
            Pack::Zstd => Self::ZSTD(ZstdLevel::default()),
        }
    }
}

/// Encodings: integers as differences, doubles plain.
pub(crate) fn properties(
    job: &Job,
    model: &Model,
    id_type: &DataType,
    form: Form,
) -> WriterProperties {
    let about = |key: &str, value: String| KeyValue::new(format!("wayfix.{key}"), value);
    let mut properties = WriterProperties::builder()
        .set_compression(job.pack.into())
        .set_dictionary_enabled(false)
        // The offset index follows all row groups, so it would have to be kept in memory until
        // then.
        .set_offset_index_disabled(true)
        .set_statistics_enabled(EnabledStatistics::None)
        .set_max_row_group_row_count(None)
        .set_key_value_metadata(Some(vec![
            about("model", model.hash().to_owned()),
            about("routine", format!("{:?}", job.verb).to_lowercase()),
        ]));
    let path = |list: &[&str], name: &str| {
        let parts = list.iter().copied().chain([name]);
        ColumnPath::new(parts.map(str::to_owned).collect())
    };
    // Columns by their paths in both forms; those that a schema lacks are ignored.
    for list in [
        &[][..],
        &["results", "list", "item"],
        &["best", "list", "item"],
        &["path", "list", "item"],
    ] {
        for name in ["step", "steps", "rank", "state", "error_step"] {
            let column = path(list, name);
            properties = properties.set_column_encoding(column, Encoding::DELTA_BINARY_PACKED);
        }
    }
    // Sorted integers have tiny differences. Texts repeat within a drive.
    let id = path(&[], "trace_id");
    properties = if *id_type == DataType::Int64 {
        properties.set_column_encoding(id.clone(), Encoding::DELTA_BINARY_PACKED)
    } else {
        properties.set_column_dictionary_enabled(id.clone(), true)
    };
    for name in [FILE, "error_kind"] {
        properties = properties.set_column_dictionary_enabled(path(&[], name), true);
    }
    if form == Form::Long && job.table != Table::Drives {
        // Constant within a drive, except for the filter, which has one value per step.
        for name in ["log_likelihood", "log_probability"] {
            let is_of_step = job.verb == Verb::Filter;
            properties = properties.set_column_dictionary_enabled(path(&[], name), !is_of_step);
        }
    }
    // Readers that look for a drive skip row groups by the bounds of the id; other columns would
    // only make the footer, and each line of the journal, longer.
    properties.set_column_statistics_enabled(id, EnabledStatistics::Chunk).build()
}
