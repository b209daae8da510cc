//! Equally probable paths and states.

use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
use wayfix_fleet::output::{Table, Verb};

use crate::kit::*;

#[test]
fn the_lowest_state_from_the_end_comes_first() {
    let half = [[0.5, 0.5], [0.5, 0.5]];
    let hmm = Hmm::new(
        Prior::AtFirstObservation(Belief::uniform(2).unwrap()),
        DenseTransition::from_rows(&half).unwrap(),
        TableLikelihood::from_rows(&half).unwrap(),
    );
    let folder = Folder::new(&hmm.unwrap());
    folder.write("drives.parquet", &nested(&[vec![0, 1, 0]]), 10);
    let found = |output: &str, verb, table| {
        let mut job = folder.job("drives.parquet", output, verb, table);
        job.form = Some(wayfix_fleet::input::Form::Long);
        let (_, rows) = folder.results(&job);
        states(&rows, "state").into_iter().flatten().collect::<Vec<_>>()
    };
    assert_eq!(found("path", Verb::Decode, Table::Paths(1)), [0, 0, 0]);
    let paths = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 0, 1]].concat();
    assert_eq!(found("paths", Verb::Decode, Table::Paths(5)), paths);
    assert_eq!(found("smoothed", Verb::Smooth, Table::Steps), [0, 0, 0]);
    assert_eq!(found("best", Verb::Filter, Table::Best(2)), [0, 1, 0, 1, 0, 1]);
}
