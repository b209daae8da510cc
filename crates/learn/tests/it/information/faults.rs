//! Undetermined parameters are errors that say why.

use wayfix::inference::{LearnError, LearningOptions};
use wayfix::{Belief, DenseTransition, Fixed, Hmm, Prior, TableLikelihood};
use wayfix_learn::StandardErrors;

use super::{Discrete, identity, kept, probabilities, uniform};

fn two(a: [[f64; 2]; 2], b: [[f64; 2]; 2]) -> Discrete {
    let (a, b) = (DenseTransition::from_rows(&a), TableLikelihood::from_rows(&b));
    Hmm::new(uniform(2), a.unwrap(), b.unwrap()).unwrap()
}

const SEEN: [usize; 12] = [0, 0, 1, 0, 1, 1, 0, 0, 0, 1, 0, 0];

/// Two equal states: no observation tells which of them was left.
#[test]
fn states_that_are_alike_are_not_determined() {
    let hmm = two([[0.6, 0.6], [0.4, 0.4]], [[2.0 / 3.0, 1.0 / 3.0], [2.0 / 3.0, 1.0 / 3.0]]);
    let error = StandardErrors::from_likelihood(&hmm, &[SEEN], &kept(), probabilities).unwrap_err();
    assert!(
        matches!(error, LearnError::NotDetermined { part: "transition operator", number: 0, .. }),
        "{error}"
    );
    // With known moves, the mean of both is known, but not each of them.
    let (a, b) = (hmm.transition().clone(), hmm.likelihood().clone());
    let prior = Prior::AtFirstObservation(Belief::new(vec![0.6, 0.4]).unwrap());
    let hmm = Hmm::new(prior, Fixed(a), b).unwrap();
    let none = |_: &Hmm<Fixed<DenseTransition>, TableLikelihood>| Vec::new();
    let error = StandardErrors::from_likelihood(&hmm, &[SEEN], &kept(), none).unwrap_err();
    assert!(matches!(error, LearnError::NotDetermined { part: "sensor", .. }), "{error}");
    let text = error.to_string();
    assert!(text.starts_with("the sequences do not determine free parameter "), "{text}");
    assert!(text.ends_with("alone or together with others"), "{text}");
}

/// A prior is known as far as sequences differ in their starts.
#[test]
fn the_part_of_a_parameter_is_named() {
    let hmm = two([[0.6, 0.6], [0.4, 0.4]], [[0.5, 0.5], [0.5, 0.5]]);
    let (a, b) = (hmm.transition().clone(), hmm.likelihood().clone());
    let hmm = Hmm::new(uniform(2), Fixed(a), Fixed(b)).unwrap();
    let none = |_: &Hmm<Fixed<_>, Fixed<_>>| vec![1.0];
    let error = StandardErrors::from_likelihood(&hmm, &[SEEN], &LearningOptions::default(), none)
        .unwrap_err();
    let expected =
        matches!(error, LearnError::NotDetermined { part: "prior", number: 0, value: 0.5 });
    assert!(expected, "{error}");
    // Without free parameters, everything is known.
    let found = StandardErrors::from_likelihood(&hmm, &[SEEN], &kept(), none).unwrap();
    assert_eq!((found.values(), found.errors(), found.at_bound()), (&[1.0][..], &[0.0][..], 0));
}

#[test]
fn a_model_that_was_learned_from_others_is_no_maximum() {
    let path = [0, 0, 0, 1, 1, 0, 1, 1, 1, 1, 0, 0, 1, 0, 0, 0, 1, 1, 1, 1];
    for a in [[[0.05, 0.05], [0.95, 0.95]], [[0.9, 0.4], [0.1, 0.6]]] {
        let hmm =
            Hmm::new(uniform(2), DenseTransition::from_rows(&a).unwrap(), identity(2)).unwrap();
        let error =
            StandardErrors::from_likelihood(&hmm, &[path], &kept(), probabilities).unwrap_err();
        let at = matches!(error, LearnError::NotAtMaximum { part: "transition operator", .. });
        assert!(at, "{error}");
        assert!(error.to_string().contains("not at a maximum of the objective"), "{error}");
        let learned = hmm.learn(&[path], &kept()).unwrap().into_model();
        assert!(StandardErrors::from_likelihood(&learned, &[path], &kept(), probabilities).is_ok());
    }
    // A saddle, at which a start with nearly equal states has not yet told them apart.
    let hmm = two([[0.5, 0.5], [0.5, 0.5]], [[0.51, 0.49], [0.49, 0.51]]);
    let runs: Vec<usize> = (0..60).map(|k| k / 10 % 2).collect();
    assert!(StandardErrors::from_likelihood(&hmm, &[runs], &kept(), probabilities).is_err());
}

#[test]
fn bad_input_is_an_error() {
    let path = [0, 0, 0, 1, 1, 0, 1, 1];
    let a = DenseTransition::from_rows(&[[0.5, 0.5], [0.5, 0.5]]).unwrap();
    let hmm = Hmm::new(uniform(2), a, identity(2)).unwrap();
    let hmm = hmm.learn(&[path], &kept()).unwrap().into_model();
    let none: [[usize; 0]; 2] = [[], []];
    let error = StandardErrors::from_likelihood(&hmm, &none, &kept(), probabilities).unwrap_err();
    assert!(matches!(error, LearnError::Nothing { sequences: 2 }), "{error}");
    let error =
        StandardErrors::from_likelihood(&hmm, &[vec![0, 1], vec![0, 7]], &kept(), probabilities)
            .unwrap_err();
    assert!(error.to_string().starts_with("sequence 1 failed"), "{error}");
    let options = kept().with_transition_pseudo_count(f64::NAN);
    let error =
        StandardErrors::from_likelihood(&hmm, &[path], &options, probabilities).unwrap_err();
    assert!(matches!(error, LearnError::Parameter(_)), "{error}");

    let error = StandardErrors::from_likelihood(&hmm, &[path], &kept(), |_| vec![0.0, f64::NAN])
        .unwrap_err();
    let expected = "number 1 that `read` returns is NaN, expected a finite value";
    assert_eq!(error.to_string(), expected);
    let at = hmm.transition().get(0, 0);
    let more = |hmm: &Discrete| vec![0.0; if hmm.transition().get(0, 0) == at { 1 } else { 2 }];
    let error = StandardErrors::from_likelihood(&hmm, &[path], &kept(), more).unwrap_err();
    let expected =
        "the number of values that `read` returns is 2, expected as many as for the model itself";
    assert_eq!(error.to_string(), expected);

    let found = StandardErrors::from_likelihood(&hmm, &[path], &kept(), probabilities).unwrap();
    for level in [0.0, 1.0, -1.0, f64::NAN, f64::INFINITY] {
        let error = found.intervals(level).unwrap_err();
        assert!(error.to_string().starts_with("the level of intervals is "), "{error}");
    }
    let (low, high) = found.intervals(0.95).unwrap()[0];
    let width = 1.959_963_984_540_054 * found.errors()[0];
    assert!((low - (found.values()[0] - width)).abs() < 1e-14);
    assert!((high - (found.values()[0] + width)).abs() < 1e-14);
}
