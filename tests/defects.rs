//! Defects.
use wayfix::*;

#[test]
fn a_lane_that_does_not_hold_costs_no_other_sequence_its_counts() {
    // The second of the first eight is ruled out; the second of the next eight is
    // shorter than the others and finds its lane.
    let hmm = Hmm::new(
        Prior::AtFirstObservation(Belief::certain(2, 0).unwrap()),
        DenseTransition::from_rows(2, &[0.7, 0.4, 0.3, 0.6]).unwrap(),
        Fixed(LikelihoodVector::linear(2).owned()),
    )
    .unwrap();
    let good = [vec![0.5, 0.5], vec![0.9, 0.2], vec![0.3, 0.8], vec![0.6, 0.6]];
    let drive = |steps: usize| good[..steps].to_vec();
    let mut drives: Vec<Vec<Vec<f64>>> = vec![drive(2), vec![vec![0.0, 1.0], vec![1.0, 1.0]]];
    drives.extend((0..7).map(|_| drive(2)));
    drives.extend([drive(3), drive(4)]);
    let learning = Learning { iterations: 1, keep_prior: true, ..Learning::default() };
    let learned = hmm.learn(&drives, &learning).unwrap();
    let mut counts = MoveCounts::default();
    for drive in &drives {
        if let Ok(moves) = hmm.expected_moves(drive) {
            counts.merge(&moves);
        }
    }
    let expected = hmm.transition().reestimate(&[counts], 0.0).unwrap();
    for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
        let (a, b) = (learned.model().transition().get(i, j), expected.get(i, j));
        assert!((a - b).abs() < 1e-12, "{i} {j}: {a} {b}");
    }
}

#[test]
fn a_count_that_is_not_a_number_is_an_error() {
    let nan = |from, to| Move { from, to, weight: f64::NAN };
    let _ = nan;
}
