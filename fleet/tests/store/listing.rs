//! URLs that name many objects, or none.

use std::fs;
use std::path::PathBuf;

use arrow::array::{AsArray, RecordBatch};
use arrow::compute::cast;
use arrow::datatypes::DataType;
use wayfix_fleet::output::{Table, Verb};
use wayfix_fleet::{Job, learn};

use crate::kit::*;
use crate::shelf::Shelf;

const NAMES: [&str; 5] = [
    "days/day=2024-01-01/part-0.parquet",
    "days/day=2024-01-02 00%3A00/part 1.parquet",
    "days/day=2024-01-10/part-0.parquet",
    "days/day=2024-01-10/part-1.parquet",
    "days/more.parquet",
];

/// The same folder on disk and in a store, with files that other tools write beside the data.
fn days() -> (Folder, Shelf) {
    let (folder, shelf) = (Folder::new(&model(1)), Shelf::new());
    for (seed, name) in (0..).zip(NAMES) {
        fs::create_dir_all(folder.path(name).parent().unwrap()).unwrap();
        folder.write(name, &nested(&drives(seed, 40, 1, 40)), 16);
        shelf.copy(&folder, name);
    }
    for name in ["_SUCCESS", "_metadata", ".part-0.crc", "_temporary/0/part-0.parquet"] {
        shelf.put(&format!("days/{name}"), b"no drives".to_vec());
    }
    shelf.put("days2/other.parquet", b"no drives".to_vec());
    (folder, shelf)
}

fn job(folder: &Folder, inputs: &[PathBuf], output: &str) -> Job {
    let mut job = folder.job("", output, Verb::Smooth, Table::Steps);
    job.inputs = inputs.to_vec();
    job
}

fn files(rows: &RecordBatch) -> Vec<String> {
    let column = cast(rows.column_by_name("file").unwrap(), &DataType::Utf8).unwrap();
    column.as_string::<i32>().iter().map(|name| name.unwrap().to_owned()).collect()
}

#[test]
fn a_prefix_is_a_folder() {
    let (folder, shelf) = days();
    let (_, expected) = folder.results(&job(&folder, &[folder.path("days")], "files.parquet"));
    let names = files(&expected);
    let without = |rows: &RecordBatch| rows.project(&[1, 2, 3, 4, 5, 6]).unwrap();
    let file = format!("file://{}/", folder.path("").display());
    for base in [shelf.to_string(), file] {
        for end in ["days", "days/"] {
            let inputs = [PathBuf::from(format!("{base}{end}"))];
            let (summary, rows) = folder.results(&job(&folder, &inputs, "objects.parquet"));
            assert_eq!(summary.drives, 200);
            assert_eq!(without(&rows), without(&expected));
            for (object, file) in files(&rows).iter().zip(&names) {
                let object = object.replace("%20", " ").replace("%25", "%");
                let name = object.split_once("days/").unwrap().1;
                assert!(file.ends_with(name), "{object}, {file}");
            }
            // Each name that it writes is that of the object.
            let inputs: Vec<PathBuf> = {
                let mut names = files(&rows);
                names.dedup();
                names.into_iter().map(PathBuf::from).collect()
            };
            assert_eq!(inputs.len(), 5);
            let (_, one_by_one) = folder.results(&job(&folder, &inputs, "list.parquet"));
            assert_eq!(one_by_one, rows);
            fs::remove_file(folder.path("objects.parquet")).unwrap();
            fs::remove_file(folder.path("list.parquet")).unwrap();
        }
    }
    // One file of results per object, under its name.
    let inputs = [PathBuf::from(format!("{shelf}days"))];
    let summary = go_on(&job(&folder, &inputs, "objects/")).unwrap();
    assert_eq!(summary.outputs, 5);
    go_on(&job(&folder, &[folder.path("days")], "results/")).unwrap();
    for name in NAMES {
        let name = name.strip_prefix("days/").unwrap();
        let [object, file] =
            ["objects", "results"].map(|kind| fs::read(folder.path(kind).join(name)).unwrap());
        assert!(object == file, "{name}");
    }
    // For learning, too.
    let file = learn_job(&folder, "days", "file.json", 2);
    let mut object = learn_job(&folder, "days", "object.json", 2);
    object.input.clone_from(&inputs[0]);
    assert_eq!(learn(&file, |_, _| {}).unwrap(), learn(&object, |_, _| {}).unwrap());
}

#[test]
fn what_cannot_be_meant_is_refused() {
    let (folder, shelf) = days();
    let at = |name: &str| PathBuf::from(format!("{shelf}{name}"));
    for (input, said) in [
        (at("nothing"), "has no files"),
        (at("days3/"), "has no files"),
        (at("days/*.parquet"), "has no files"),
        (PathBuf::from("ftp://host/file.parquet"), "no store for this URL"),
        (at("days2/other.parquet"), "other.parquet: "),
    ] {
        let error = folder_error(&folder, &[input], "out.parquet");
        assert!(error.contains(said), "{error}");
    }
    let twice = [at("days"), at("days/more.parquet")];
    let error = folder_error(&folder, &twice, "out.parquet");
    assert!(error.contains("occurs twice in the input"), "{error}");
    let mut job = job(&folder, &[at("days")], "out.parquet");
    job.output = at("out.parquet");
    let error = go_on(&job).unwrap_err().to_string();
    assert!(error.contains("results are written to local files"), "{error}");
    job.output = folder.path("out.parquet");
    job.left_out = Some(at("out.jsonl"));
    let error = go_on(&job).unwrap_err().to_string();
    assert!(error.contains("results are written to local files"), "{error}");
    job.left_out = None;
    job.model = at("nothing.json");
    let error = go_on(&job).unwrap_err().to_string();
    assert!(error.contains("nothing.json: "), "{error}");
    // Results beside the objects would be input the next time.
    job.model = folder.path("model.json");
    job.inputs = vec![PathBuf::from(format!("file://{}", folder.path("days").display()))];
    job.output = folder.path("days/out.parquet");
    let error = go_on(&job).unwrap_err().to_string();
    assert!(error.contains("which is part of the input"), "{error}");
}

fn folder_error(folder: &Folder, inputs: &[PathBuf], output: &str) -> String {
    let error = go_on(&job(folder, inputs, output)).unwrap_err().to_string();
    assert!(!folder.has_leftovers());
    error
}
