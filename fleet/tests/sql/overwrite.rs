//! The output of a query never overwrites files that it reads.

use std::fs;
use std::os::unix::fs::symlink;

use wayfix_fleet::sql::query;

use crate::kit::*;
use crate::tables::*;

#[test]
fn tables_and_models_are_kept() {
    let folder = Folder::new(&model(1));
    fs::create_dir_all(folder.path("days")).unwrap();
    folder.write("drives.parquet", &nested(&drives(3, 20, 1, 9)), 10);
    fs::copy(folder.path("drives.parquet"), folder.path("days/1.parquet")).unwrap();
    fs::hard_link(folder.path("drives.parquet"), folder.path("hard")).unwrap();
    symlink(folder.path("model.json"), folder.path("soft")).unwrap();
    let sql = format!("SELECT wayfix_score({}, observation) FROM drives", model_of(&folder));
    let is_read = "would be written to, but is also read (as ";
    for (table, output, expected) in [
        ("drives.parquet", "drives.parquet", is_read),
        ("drives.parquet", "days/../drives.parquet", is_read),
        ("drives.parquet", "hard", is_read),
        ("drives.parquet", "model.json", is_read),
        ("drives.parquet", "soft", is_read),
        ("days", "days/1.parquet", "which is part of the input"),
        ("days", "days/rows.parquet", "which is part of the input"),
    ] {
        for key in [&["trace_id"][..], &[]] {
            let mut of = over(&folder, table, key, &sql);
            of.output = folder.path(output);
            let files = ["drives.parquet", "model.json", "days/1.parquet"];
            let before = files.map(|name| fs::read(folder.path(name)).unwrap());
            let error = query(&of, |_| {}).unwrap_err().to_string();
            assert!(error.contains(expected), "{output}: {error}");
            assert!(files.map(|name| fs::read(folder.path(name)).unwrap()) == before, "{output}");
            let count = |name| fs::read_dir(folder.path(name)).unwrap().count();
            assert_eq!((count("."), count("days")), (5, 1), "{output}");
        }
    }
}
