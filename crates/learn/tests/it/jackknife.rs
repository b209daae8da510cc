//! The jackknife of models whose prior follows from their operator.

use wayfix::inference::LearningOptions;
use wayfix::{DenseTransition, Hmm, Prior, TableLikelihood};
use wayfix_learn::StandardErrors;

use crate::kit::rng;

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
