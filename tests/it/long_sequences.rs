//! A million steps neither underflow nor drift.

use wayfix::{Belief, DenseTransition, Hmm, LikelihoodVector, Prior, SparseTransition, canberra};

use crate::kit::rng;

const STEPS: usize = 1_000_000;

#[test]
fn a_million_steps_on_the_map_keep_every_belief_a_distribution() {
    let hmm = canberra::hmm(5, 1.0).unwrap();
    let drive = hmm.simulate(STEPS, &mut rng(7));
    let mut filter = hmm.filter();
    let mut worst = 0.0_f64;
    for y in drive.observations() {
        filter.step(y).unwrap();
        worst = worst.max((filter.belief().as_slice().iter().sum::<f64>() - 1.0).abs());
    }
    assert!(worst <= 1e-12, "a sum is off by {worst}");
    assert_eq!(filter.steps(), STEPS);
    assert!(filter.log_likelihood().is_finite());
}

/// Two symmetric states: the log-likelihood of T equal observations has a closed form, since the
/// filter is at its fixed point from the start.
#[test]
fn the_log_likelihood_of_a_million_steps_has_all_its_digits() {
    let hmm = Hmm::new(
        Prior::BeforeFirstTransition(Belief::uniform(2).unwrap()),
        DenseTransition::from_rows(&[[0.9, 0.1], [0.1, 0.9]]).unwrap(),
        LikelihoodVector::linear(2),
    )
    .unwrap();
    let y = [0.3, 0.3];
    let expected = STEPS as f64 * 0.3_f64.ln();
    let mut filter = hmm.filter();
    for _ in 0..STEPS {
        filter.step(&y).unwrap();
    }
    let error = (filter.log_likelihood() - expected).abs() / expected.abs();
    assert!(error <= 1e-15, "relative error {error}");
    let smoothing = hmm.smooth(&vec![y; STEPS]).unwrap();
    let error = (smoothing.log_likelihood() - expected).abs() / expected.abs();
    assert!(error <= 1e-15, "relative error {error}");
    for k in [0, 1, STEPS / 2, STEPS] {
        assert!((smoothing.posteriors().get(k).unwrap().as_slice()[0] - 0.5).abs() <= 1e-12);
    }
    let path = hmm.viterbi(&vec![y; STEPS]).unwrap();
    // Stays where it starts; ties go to the lowest state.
    assert!(path.states().iter().all(|&state| state == 0));
    let best = 0.5_f64.ln() + expected + (STEPS - 1) as f64 * 0.9_f64.ln();
    let error = (path.log_probability() - best).abs() / best.abs();
    assert!(error <= 1e-14, "relative error {error}");
}

/// A million steps without observations: predictions must not drift, even if sums of columns are
/// off by a rounding.
#[test]
fn a_million_predictions_do_not_drift() {
    let third = 1.0 / 3.0;
    let columns = [0.1, 0.2, 0.7, third, third, third, 0.7, 0.2, 0.1];
    let entries = columns.iter().enumerate().map(|(at, &p)| (at % 3, at / 3, p));
    let hmm = Hmm::new(
        Prior::BeforeFirstTransition(Belief::certain(3, 0).unwrap()),
        SparseTransition::from_triplets(3, entries).unwrap(),
        LikelihoodVector::linear(3),
    )
    .unwrap();
    let mut filter = hmm.filter();
    for _ in 0..STEPS {
        filter.predict().unwrap();
    }
    let p = filter.belief().as_slice().to_vec();
    assert!((p.iter().sum::<f64>() - 1.0).abs() <= 1e-12);
    // Stationary: A p = p.
    filter.predict().unwrap();
    for (a, b) in filter.belief().as_slice().iter().zip(&p) {
        assert!((a - b).abs() <= 1e-15);
    }
    assert_eq!(filter.log_likelihood(), 0.0);
}

/// Streams over long sequences agree with the batch routines at the end.
#[test]
fn streams_of_a_hundred_thousand_steps_are_the_batch() {
    let hmm = canberra::hmm(90, 2.0).unwrap();
    let steps = 100_000;
    let drive = hmm.simulate(steps, &mut rng(8));
    let ys = drive.observations();
    let mut decoder = hmm.online_viterbi();
    let mut path = Vec::new();
    let mut most = 0;
    let mut smoother = hmm.fixed_lag(3);
    for y in ys {
        path.extend_from_slice(decoder.step(y).unwrap());
        most = most.max(decoder.steps() - path.len());
        smoother.step(y).unwrap();
    }
    assert!(most < 1000, "{most} steps were undecided");
    path.extend(decoder.undecided());
    let batch = hmm.viterbi(ys).unwrap();
    assert_eq!(path, batch.states());
    assert_eq!(decoder.log_probability(), batch.log_probability());
    let smoothing = hmm.smooth(ys).unwrap();
    for k in steps - 3..=steps {
        let (stream, batch) = (smoother.get(k).unwrap(), smoothing.posteriors().get(k).unwrap());
        for (a, b) in stream.as_slice().iter().zip(batch.as_slice()) {
            assert!((a - b).abs() <= 1e-12 * b.max(1e-290), "{a} {b} at {k}");
        }
    }
    assert_eq!(hmm.log_likelihood(ys).unwrap(), smoothing.log_likelihood());
    let entropy = hmm.path_entropy(ys).unwrap();
    let marginals: f64 = smoothing.posteriors().iter().map(|b| b.entropy()).sum();
    assert!(0.0 < entropy && entropy < marginals, "{entropy} of {marginals}");
}
