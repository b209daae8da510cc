//! Standard errors by the jackknife: known ones, recovered parameters, and a prior that follows from its
//! operator.

use wayfix::inference::{LearnError, LearningOptions};
use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
use wayfix_learn::StandardErrors;

use crate::kit::rng;

type Model = Hmm<DenseTransition, TableLikelihood>;

#[test]
fn a_stationary_prior_stays_one() {
    let start = |stay: f64| {
        let a = DenseTransition::from_rows(&[[stay, 0.3], [1.0 - stay, 0.7]]).unwrap();
        let sensor = TableLikelihood::from_rows(&[[0.8, 0.2], [0.3, 0.7]]).unwrap();
        Hmm::new(Prior::stationary(&a).unwrap(), a, sensor).unwrap()
    };
    let mut noise = rng(4);
    let truth = start(0.9);
    let seen: Vec<Vec<usize>> =
        (0..12).map(|_| truth.simulate(30, &mut noise).observations().to_vec()).collect();
    let options = LearningOptions::default().with_tolerance(1e-7).with_iterations(500);
    let best = Hmm::learn_best(&[start(0.6), start(0.9)], &seen, &options, |_, _| ()).unwrap();
    let read = |hmm: &Hmm<DenseTransition, TableLikelihood>| {
        assert!(matches!(hmm.prior(), Prior::Stationary(_)));
        hmm.prior().belief().as_slice().to_vec()
    };
    let errors = StandardErrors::from_jackknife(best.model(), &seen, 6, &options, read).unwrap();
    assert!(errors.errors().iter().all(|error| *error > 0.0 && *error < 0.5), "{errors:?}");
}

/// The jackknife of a mean is the standard error of a mean.
#[test]
fn standard_errors_of_a_share_are_those_of_counting() {
    let one = Hmm::new(
        Prior::AtFirstObservation(Belief::uniform(1).unwrap()),
        DenseTransition::from_rows(&[[1.0]]).unwrap(),
        TableLikelihood::from_rows(&[[0.5, 0.5]]).unwrap(),
    )
    .unwrap();
    let sequences: Vec<[usize; 1]> = (0..40).map(|s| [usize::from(s % 5 == 0)]).collect();
    let learning = LearningOptions::default();
    let learned = one.learn(&sequences, &learning).unwrap().into_model();
    let share = |hmm: &Model| vec![hmm.likelihood().probability(0, 1).unwrap()];
    let errors =
        StandardErrors::from_jackknife(&learned, &sequences, 40, &learning, share).unwrap();
    assert!((errors.values()[0] - 0.2).abs() < 1e-12);
    assert!((errors.errors()[0] - (0.2_f64 * 0.8 / 39.0).sqrt()).abs() < 1e-12);
    for groups in [0, 1, 41] {
        let error = StandardErrors::from_jackknife(&learned, &sequences, groups, &learning, share)
            .unwrap_err();
        assert!(matches!(error, LearnError::Groups { sequences: 40, .. }));
    }
}

/// Errors of recovered parameters are at most three standard errors, except for about one in a
/// hundred.
#[test]
fn parameters_are_found_back_within_three_standard_errors() {
    let learning = LearningOptions::default().with_tolerance(1e-6).with_keep_prior(true);
    let read = |hmm: &Model| {
        let (a, b) = (hmm.transition().to_rows(), hmm.likelihood().to_rows());
        vec![a[0][0], a[1][1], b[0][0], b[0][1], b[1][0], b[1][1]]
    };
    let (mut all, mut beyond, mut squares) = (0, 0, 0.0);
    for seed in 0..12 {
        let truth = Hmm::new(
            Prior::AtFirstObservation(Belief::uniform(2).unwrap()),
            DenseTransition::from_rows(&[[0.9, 0.2], [0.1, 0.8]]).unwrap(),
            TableLikelihood::from_rows(&[[0.8, 0.1, 0.1], [0.1, 0.3, 0.6]]).unwrap(),
        )
        .unwrap();
        let mut rng = rng(seed);
        let sequences: Vec<_> =
            (0..40).map(|_| truth.simulate(50, &mut rng).observations().to_vec()).collect();
        let learned = truth.learn(&sequences, &learning).unwrap().into_model();
        let errors =
            StandardErrors::from_jackknife(&learned, &sequences, 20, &learning, read).unwrap();
        let pairs = errors.values().iter().zip(errors.errors()).zip(read(&truth));
        for ((value, error), truth) in pairs {
            let z = (value - truth) / error;
            all += 1;
            beyond += usize::from(z.abs() > 3.0);
            squares += z * z;
        }
    }
    assert!(beyond <= 3, "{beyond} of {all}");
    // Standard errors of the right size: the mean square is 1, or 1.1 with 19 degrees of freedom.
    let mean = squares / f64::from(all);
    assert!((0.7..1.7).contains(&mean), "{mean}");
}
