//! Learning on a cluster.

use wayfix_fleet::sql;

use crate::Cluster;
use crate::kit::*;

/// Ten iterations on two executors equal those of the library, though one is killed on the way.
#[test]
fn iterations_are_those_of_one_process() {
    let given = model(21);
    let folder = Folder::new(&given);
    let some = drives(22, 2000, 0, 30);
    folder.write("nested.parquet", &nested(&some), 50);
    folder.write("long.parquet", &long(&some), 1000);
    let expected = learned(&given, &some);
    let cluster = Cluster::start(&folder);
    for kill in [false, true] {
        let output = if kill { "killed.json" } else { "learned.json" };
        let job = learn_job(&folder, "nested.parquet", output, 8);
        let course = sql::learn(&job, Some(&cluster.scheduler()), |iteration| {
            if kill && iteration == 4 {
                cluster.kill("executor1");
            }
            if kill && iteration == 6 {
                cluster.script(&["executor", "1"]);
            }
        });
        assert_learned(&job, &course.unwrap(), &expected);
    }
    // Sums of parts of a long table are added in order, whichever executor computed them.
    let models = ["one.json", "two.json"].map(|output| {
        let job = learn_job(&folder, "long.parquet", output, 8);
        assert_learned(
            &job,
            &sql::learn(&job, Some(&cluster.scheduler()), |_| {}).unwrap(),
            &expected,
        );
        std::fs::read(&job.output).unwrap()
    });
    assert!(models[0] == models[1]);
}
