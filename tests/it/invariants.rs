//! Properties of every model that hold whatever the answer.

use proptest::prelude::*;
use wayfix::TransitionEntries;

use crate::kit::{Kind, Model, bits, cases, models};

fn is_distribution(p: &[f64]) -> Result<(), TestCaseError> {
    prop_assert!(p.iter().all(|p| *p >= 0.0), "{p:?}");
    prop_assert!((p.iter().sum::<f64>() - 1.0).abs() <= 1e-12, "{p:?}");
    Ok(())
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn every_belief_is_a_distribution(model in models(Kind::Extreme), ahead in 0..4_usize) {
        let hmm = model.hmm(model.sparse());
        let mut filter = hmm.filter();
        is_distribution(filter.belief().as_slice())?;
        for (control, y) in model.controls().iter().zip(&model.logs) {
            if filter.step_with(control, y).is_err() {
                filter.predict_with(control).unwrap();
            }
            is_distribution(filter.belief().as_slice())?;
            is_distribution(filter.forecast_with(&vec![*control; ahead]).unwrap().as_slice())?;
            prop_assert!(filter.log_likelihood().is_finite());
        }
        if let Ok(smoothing) = hmm.smooth(&model) {
            let filtering = hmm.forward(&model).unwrap();
            for belief in filtering.posteriors().with_start().chain(smoothing.posteriors().with_start()) {
                is_distribution(belief.as_slice())?;
            }
        }
    }

    /// The sum over all paths is at least the best path.
    #[test]
    fn the_best_path_is_no_likelier_than_all(model in models(Kind::Extreme)) {
        let hmm = model.hmm(model.own());
        let path = hmm.viterbi(&model);
        let smoothing = hmm.smooth(&model);
        prop_assert_eq!(path.is_ok(), smoothing.is_ok());
        if let (Ok(path), Ok(smoothing)) = (path, smoothing) {
            let rounding = 1e-12 * smoothing.log_likelihood().abs().max(1.0);
            prop_assert!(smoothing.log_likelihood() >= path.log_probability() - rounding);
        }
    }

    #[test]
    fn filter_and_smoother_are_the_same_at_the_end(model in models(Kind::Extreme)) {
        let hmm = model.hmm(model.sparse());
        if let Ok(smoothing) = hmm.smooth(&model) {
            let end = model.steps();
            let filtering = hmm.forward(&model).unwrap();
            prop_assert_eq!(filtering.posteriors().get(end), smoothing.posteriors().get(end));
            prop_assert!(smoothing.posteriors().get(end + 1).is_none());
            let kept = smoothing.clone().into_posteriors().into_vec();
            prop_assert_eq!(&kept, smoothing.posteriors().as_slice());
            let moved = smoothing.into_posteriors().into_vec();
            prop_assert_eq!(moved, kept);
        }
    }

    #[test]
    fn streaming_is_the_batch(model in models(Kind::Shifted)) {
        let hmm = model.hmm(model.dense());
        if let Ok(filtering) = hmm.forward(&model) {
            let mut filter = hmm.filter();
            for (k, (control, y)) in model.controls().iter().zip(&model.logs).enumerate() {
                let log_likelihood = filter.step_with(control, y).unwrap();
                prop_assert_eq!(log_likelihood, filtering.log_likelihoods()[k]);
                prop_assert_eq!(Some(filter.belief()), filtering.posteriors().get(k + 1));
                prop_assert_eq!(filter.steps(), k + 1);
            }
            prop_assert_eq!(filter.log_likelihood(), filtering.log_likelihood());
            prop_assert_eq!(filter.log_likelihood(), hmm.log_likelihood(&model).unwrap());
        }
    }

    #[test]
    fn sparse_dense_and_own_operators_agree(model in models(Kind::Shifted)) {
        fn answer<A: TransitionEntries<Control = usize>>(model: &Model, a: A) -> Option<(Vec<f64>, f64, f64)> {
            let hmm = model.hmm(a);
            let smoothing = hmm.smooth(&model).ok()?;
            let path = hmm.viterbi(&model).unwrap();
            Some((smoothing.posteriors().as_slice().to_vec(), smoothing.log_likelihood(), path.log_probability()))
        }
        let answers = [answer(&model, model.sparse()), answer(&model, model.dense()), answer(&model, model.own())];
        for other in &answers[1..] {
            match (&answers[0], other) {
                (Some(a), Some(b)) => {
                    prop_assert!(a.0.iter().zip(&b.0).all(|(a, b)| (a - b).abs() <= 1e-12));
                    prop_assert!((a.1 - b.1).abs() <= 1e-12 * a.1.abs().max(1.0));
                    prop_assert!((a.2 - b.2).abs() <= 1e-12 * a.2.abs().max(1.0));
                }
                (a, b) => prop_assert!(a.is_none() && b.is_none()),
            }
        }
    }

    /// Predict and update are the two halves of a step, in both conventions.
    #[test]
    fn a_step_is_a_prediction_and_an_update(model in models(Kind::Plain)) {
        let hmm = model.hmm(model.sparse());
        let (mut whole, mut halves) = (hmm.filter(), hmm.filter());
        for (control, y) in model.controls().iter().zip(&model.logs) {
            if whole.step_with(control, y).is_err() {
                break;
            }
            halves.predict_with(control).unwrap();
            halves.update(y).unwrap();
            prop_assert_eq!(whole.steps(), halves.steps());
            for (a, b) in whole.belief().as_slice().iter().zip(halves.belief().as_slice()) {
                prop_assert!((a - b).abs() <= 1e-14);
            }
        }
        prop_assert!((whole.log_likelihood() - halves.log_likelihood()).abs() <= 1e-12);
    }

    #[test]
    fn a_snapshot_resumes_to_identical_bits(model in models(Kind::Extreme), cut in 0..6_usize) {
        let hmm = model.hmm(model.sparse());
        let controls = model.controls();
        let mut steps = controls.iter().zip(&model.logs);
        let mut first = hmm.filter();
        for (control, y) in steps.by_ref().take(cut) {
            let _ = first.step_with(control, y);
        }
        let mut second = hmm.filter();
        second.restore(&first.snapshot()).unwrap();
        for (control, y) in steps {
            prop_assert_eq!(first.step_with(control, y).is_ok(), second.step_with(control, y).is_ok());
        }
        prop_assert_eq!(bits(first.belief().as_slice()), bits(second.belief().as_slice()));
        prop_assert_eq!(first.log_likelihood().to_bits(), second.log_likelihood().to_bits());
        prop_assert_eq!(first.snapshot(), second.snapshot());
    }

    /// A forecast h steps ahead is h predictions.
    #[test]
    fn a_forecast_is_repeated_prediction(model in models(Kind::Plain)) {
        let hmm = model.hmm(model.sparse());
        let mut filter = hmm.filter();
        let forecast = filter.forecast_with(&model.controls()).unwrap();
        for control in model.controls() {
            filter.predict_with(&control).unwrap();
        }
        prop_assert_eq!(filter.belief().as_slice(), forecast.as_slice());
    }
}
