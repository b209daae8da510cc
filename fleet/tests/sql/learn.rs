//! Learning by queries.

use std::thread;

use wayfix_fleet::sql;

use crate::kit::*;

/// Ten iterations equal those of the library, however the rows are divided.
#[test]
fn iterations_by_queries_are_those_of_the_library() {
    let given = model(11);
    let folder = Folder::new(&given);
    let some = drives(12, 1500, 0, 30);
    folder.write("nested.parquet", &nested(&some), 100);
    folder.write("long.parquet", &long(&some), 1000);
    let expected = learned(&given, &some);
    assert!(!expected.left_out().is_empty());
    for (input, threads) in [("nested.parquet", 1), ("nested.parquet", 3), ("long.parquet", 2)] {
        let job = learn_job(&folder, input, &format!("{input}.{threads}.json"), threads);
        let mut iterations = Vec::new();
        let course = sql::learn(&job, None, |iteration| iterations.push(iteration)).unwrap();
        assert!(iterations.into_iter().eq(0..=10));
        assert!(!folder.has_leftovers());
        assert_learned(&job, &course, &expected);
    }
}

/// An interrupted run continues after its last re-estimation.
#[test]
fn learning_goes_on_after_an_interruption() {
    let given = model(13);
    let folder = Folder::new(&given);
    let some = drives(14, 300, 0, 30);
    folder.write("nested.parquet", &nested(&some), 100);
    let job = learn_job(&folder, "nested.parquet", "learned.json", 2);
    let stopped = job.clone();
    let stopped = thread::spawn(move || {
        sql::learn(&stopped, None, |iteration| assert!(iteration < 4, "interrupted"))
    });
    assert!(stopped.join().is_err());
    assert!(!job.output.exists());
    let mut iterations = Vec::new();
    let course = sql::learn(&job, None, |iteration| iterations.push(iteration)).unwrap();
    assert_eq!(iterations.first(), Some(&4));
    assert_learned(&job, &course, &learned(&given, &some));
}

#[test]
fn drives_that_cannot_be_used_are_errors() {
    let given = model(15);
    let folder = Folder::new(&given);
    let mut some = drives(16, 50, 1, 30);
    some[40][0] = 1000;
    folder.write("nested.parquet", &nested(&some), 100);
    let wrong = learn_job(&folder, "nested.parquet", "a.json", 2);
    let message = sql::learn(&wrong, None, |_| ()).unwrap_err().to_string();
    assert!(message.contains("wayfix_expect") && message.contains("symbol 1000"), "{message}");
    assert!(!wrong.output.exists());
    folder.write("none.parquet", &nested(&Vec::new()), 100);
    let none = learn_job(&folder, "none.parquet", "b.json", 2);
    let message = sql::learn(&none, None, |_| ()).unwrap_err().to_string();
    assert_eq!(message, "learning failed: none of the 0 drives is possible under the model");
}
