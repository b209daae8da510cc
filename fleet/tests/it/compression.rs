//! Compression of Parquet input, as documented in the README.

use std::fs::File;
use std::path::Path;

use parquet::arrow::ArrowWriter;
use parquet::basic::{Compression, ZstdLevel};
use parquet::file::properties::WriterProperties;
use wayfix_fleet::output::{Table, Verb};

use crate::kit::*;

fn write(path: &Path, codec: Compression) {
    let rows = long(&drives(3, 20, 1, 9));
    let properties = WriterProperties::builder().set_compression(codec).build();
    let file = File::create(path).unwrap();
    let mut writer = ArrowWriter::try_new(file, rows.schema(), Some(properties)).unwrap();
    writer.write(&rows).unwrap();
    writer.close().unwrap();
}

#[test]
fn columns_that_are_read() {
    let folder = Folder::new(&model(1));
    let mut results = Vec::new();
    for codec in [
        Compression::UNCOMPRESSED,
        Compression::SNAPPY,
        Compression::LZ4,
        Compression::LZ4_RAW,
        Compression::ZSTD(ZstdLevel::default()),
    ] {
        write(&folder.path("packed.parquet"), codec);
        let output = format!("{}.parquet", results.len());
        let job = folder.job("packed.parquet", &output, Verb::Smooth, Table::Steps);
        results.push(folder.results(&job).1);
    }
    assert!(results.iter().all(|rows| *rows == results[0]));
}

/// A build with `sql` can read these, too.
#[cfg(not(feature = "sql"))]
#[test]
fn columns_that_are_not_read() {
    use std::fs;

    use parquet::basic::{BrotliLevel, GzipLevel};
    use parquet::file::metadata::{
        ParquetMetaDataBuilder, ParquetMetaDataReader, ParquetMetaDataWriter,
    };

    let folder = Folder::new(&model(1));
    let path = folder.path("packed.parquet");
    for (codec, name) in [
        (Compression::BROTLI(BrotliLevel::default()), "brotli"),
        (Compression::GZIP(GzipLevel::default()), "flate2"),
    ] {
        // This build cannot write such columns, but it can label them so.
        write(&path, Compression::SNAPPY);
        let found = ParquetMetaDataReader::new().parse_and_finish(&File::open(&path).unwrap());
        let found = found.unwrap();
        let groups = found.row_groups().iter().map(|group| {
            let columns = group.columns().iter().map(|column| {
                column.clone().into_builder().set_compression(codec).build().unwrap()
            });
            let columns = columns.collect();
            group.clone().into_builder().set_column_metadata(columns).build().unwrap()
        });
        let about = ParquetMetaDataBuilder::new(found.file_metadata().clone());
        let about = about.set_row_groups(groups.collect()).build();
        let mut bytes = fs::read(&path).unwrap();
        ParquetMetaDataWriter::new(&mut bytes, &about).finish().unwrap();
        fs::write(&path, bytes).unwrap();
        let error = folder.error("packed.parquet").to_string();
        assert!(error.contains("packed.parquet: ") && error.contains(name), "{error}");
    }
}
