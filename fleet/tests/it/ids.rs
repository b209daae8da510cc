//! Ids: integers, or text.

use std::fs;
use std::sync::Arc;

use arrow::array::{ArrayRef, RecordBatch, UInt64Array};
use wayfix_fleet::output::{Table, Verb};

use crate::kit::*;

#[test]
fn ids_that_are_no_plain_integers_are_named() {
    let folder = Folder::new(&model(1));
    for (ids, said) in [
        (
            ["1", "a"],
            "column `trace_id`, row 1 (counted from 0): `a` is not a 64-bit integer, but the first \
             id of the file is an integer, so all must be; write all ids as text that is not a \
             number (`v7`), or use Parquet with a text column",
        ),
        (
            ["7", "007"],
            "row 1 (counted from 0): `007` is not an integer in its plain form (7), but",
        ),
        (["7", "+7"], "`+7` is not an integer in its plain form (7), but"),
        (["0", "-0"], "`-0` is not an integer in its plain form (0), but"),
        (["7", "9223372036854775808"], "`9223372036854775808` is not a 64-bit integer, but"),
    ] {
        let lines = ids.map(|id| format!("{id},1,0\n")).concat();
        fs::write(folder.path("bad.csv"), format!("trace_id,step,observation\n{lines}")).unwrap();
        let error = folder.error("bad.csv").to_string();
        assert!(error.contains(said), "{error}");
        assert!(!folder.has_leftovers());
    }
}

/// Ids as text differ if their text does.
#[test]
fn ids_with_zeros_before_them_are_text() {
    let folder = Folder::new(&model(1));
    for (number, (ids, expected)) in [
        (["007", "7"], ["007", "7"].map(str::to_owned)),
        (["+7", "7"], ["+7", "7"].map(str::to_owned)),
        (["-0", "0"], ["-0", "0"].map(str::to_owned)),
    ]
    .into_iter()
    .enumerate()
    {
        let text = ids.map(|id| format!("{id},1,0\n")).concat();
        fs::write(folder.path("ids.csv"), format!("trace_id,step,observation\n{text}")).unwrap();
        let output = format!("{number}.parquet");
        let job = folder.job("ids.csv", &output, Verb::Score, Table::Drives);
        let (summary, found) = folder.results(&job);
        assert_eq!(summary.drives, 2);
        assert_eq!(texts(&found, "trace_id"), expected.map(Some));
    }
    // The first id present decides the type.
    fs::write(folder.path("ids.csv"), "trace_id,step,observation\n,1,0\n9,1,1\n10,1,1\n").unwrap();
    let mut job = folder.job("ids.csv", "first.parquet", Verb::Score, Table::Drives);
    job.left_out = Some(folder.path("first.jsonl"));
    let (summary, found) = folder.results(&job);
    assert_eq!((summary.drives, summary.left_out), (2, 1));
    assert_eq!(integers(&found, "trace_id"), [Some(9), Some(10)]);
    // With the option, such an id counts as unreadable.
    fs::write(folder.path("ids.csv"), "trace_id,step,observation\n7,1,0\n007,1,1\n8,1,1\n")
        .unwrap();
    job = folder.job("ids.csv", "left.parquet", Verb::Score, Table::Drives);
    job.left_out = Some(folder.path("left.jsonl"));
    let (summary, found) = folder.results(&job);
    assert_eq!((summary.drives, summary.left_out), (2, 1));
    assert_eq!(integers(&found, "trace_id"), [Some(7), Some(8)]);
}

#[test]
fn unsigned_ids_have_63_bits() {
    let folder = Folder::new(&model(1));
    let some = long(&[vec![0], vec![1]]);
    for (largest, is_read) in [(i64::MAX as u64, true), (1 << 63, false)] {
        let ids: ArrayRef = Arc::new(UInt64Array::from(vec![7, largest]));
        let columns = [
            ("trace_id", ids),
            ("step", some.column(1).clone()),
            ("observation", some.column(2).clone()),
        ];
        folder.write("ids.parquet", &RecordBatch::try_from_iter(columns).unwrap(), 10);
        if is_read {
            let job = folder.job("ids.parquet", "out.parquet", Verb::Score, Table::Drives);
            let (_, found) = folder.results(&job);
            assert_eq!(integers(&found, "trace_id"), [Some(7), Some(i64::MAX)]);
        } else {
            let error = folder.error("ids.parquet").to_string();
            let said =
                "column `trace_id`, row 1 (counted from 0): cannot be read as a 64-bit integer";
            assert_eq!(error, said);
        }
    }
}
