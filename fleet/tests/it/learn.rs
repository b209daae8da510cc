//! Learning from files.

use std::thread;

use wayfix_fleet::learn;

use crate::kit::*;

#[test]
fn is_that_of_the_library_also_after_an_interruption() {
    let given = model(11);
    let folder = Folder::new(&given);
    let some = drives(12, 1500, 0, 30);
    folder.write("nested.parquet", &nested(&some), 200);
    folder.write("long.parquet", &long(&some), 3000);
    let expected = learned(&given, &some);
    assert!(!expected.left_out().is_empty());

    for (input, output) in [("nested.parquet", "a.json"), ("long.parquet", "b.json")] {
        let job = learn_job(&folder, input, output, 2);
        if input == "long.parquet" {
            let stopped = job.clone();
            let stopped =
                thread::spawn(move || learn(&stopped, |k, _| assert!(k < 5, "interrupted")));
            assert!(stopped.join().is_err());
            assert!(folder.has_leftovers() && !job.output.exists());
        }
        let mut iterations = Vec::new();
        let course = learn(&job, |iteration, _| iterations.push(iteration)).unwrap();
        assert!(!folder.has_leftovers());
        let first = if input == "long.parquet" { 5 } else { 0 };
        assert_eq!(iterations.first(), Some(&first));
        assert_learned(&job, &course, &expected);
    }
}
