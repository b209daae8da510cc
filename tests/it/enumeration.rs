//! Every routine against the sum (or the maximum) over all paths.

use proptest::prelude::*;
use wayfix::{
    Controlled, Hmm, InferenceError, LikelihoodVector, OptionalLikelihood, TransitionEntries,
};

use crate::kit::{Answer, Kind, Model, Sensor, all_close, cases, close_logs, models};

pub(crate) fn check<A: TransitionEntries<Control = usize>>(
    model: &Model,
    hmm: &Hmm<A, Sensor>,
    ys: &[Option<Vec<f64>>],
    answer: &Answer,
) -> Result<(), TestCaseError> {
    let controls = model.controls();
    let drive = Controlled::new(&controls, ys).unwrap();
    let tolerance = 1e-11;
    let impossible = |error: InferenceError| match error {
        InferenceError::Impossible { step } | InferenceError::ImpossibleMove { step } => Ok(step),
        other => Err(TestCaseError::fail(format!("{other}"))),
    };

    let mut filter = hmm.filter();
    for (index, (control, y)) in controls.iter().zip(ys).enumerate() {
        if answer.impossible_at == Some(index + 1) {
            let before = filter.snapshot();
            prop_assert_eq!(impossible(filter.step_with(control, y).unwrap_err())?, index + 1);
            prop_assert_eq!(filter.snapshot(), before);
            break;
        }
        filter.step_with(control, y).unwrap();
        all_close(filter.belief().as_slice(), &answer.filtered[index + 1], tolerance, 1e-290)?;
    }
    if let Some(step) = answer.impossible_at {
        prop_assert_eq!(impossible(hmm.smooth(&drive).unwrap_err())?, step);
        prop_assert_eq!(impossible(hmm.viterbi(&drive).unwrap_err())?, step);
        return Ok(());
    }
    close_logs(filter.log_likelihood(), answer.log_likelihood, 1e-12)?;

    let filtering = hmm.forward(&drive).unwrap();
    close_logs(filtering.log_likelihood(), answer.log_likelihood, 1e-12)?;
    close_logs(hmm.log_likelihood(&drive).unwrap(), answer.log_likelihood, 1e-12)?;
    let smoothing = hmm.smooth(&drive).unwrap();
    close_logs(smoothing.log_likelihood(), answer.log_likelihood, 1e-12)?;
    for k in 0..=model.steps() {
        let filtered = filtering.posteriors().get(k).unwrap();
        let smoothed = smoothing.posteriors().get(k).unwrap();
        all_close(filtered.as_slice(), &answer.filtered[k], tolerance, 1e-290)?;
        all_close(smoothed.as_slice(), &answer.smoothed[k], tolerance, 1e-290)?;
    }

    let path = hmm.viterbi(&drive).unwrap();
    prop_assert_eq!(path.states().len(), model.steps());
    if model.steps() > 0 {
        close_logs(path.log_probability(), answer.viterbi, 1e-12)?;
        // The path is possible, and as probable as stated.
        close_logs(model.log_probability(path.states()), answer.viterbi, 1e-12)?;
    }
    Ok(())
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn sparse_equals_enumeration(model in models(Kind::Shifted)) {
        let hmm = model.hmm(model.sparse());
        check(&model, &hmm, &model.logs, &model.enumerate())?;
    }

    /// With entries of 1e-300 and likelihoods hundreds of orders apart.
    #[test]
    fn extremes_equal_enumeration(model in models(Kind::Extreme)) {
        let answer = model.enumerate();
        let hmm = model.hmm(model.sparse());
        check(&model, &hmm, &model.logs, &answer)?;
    }

    #[test]
    fn dense_equals_enumeration(model in models(Kind::Shifted)) {
        let hmm = model.hmm(model.dense());
        check(&model, &hmm, &model.logs, &model.enumerate())?;
    }

    /// As numbers on any scale, the same one at each step.
    #[test]
    fn linear_likelihoods_equal_enumeration(mut model in models(Kind::Plain), scale in -290..300) {
        let factor = 10_f64.powi(scale);
        let linear = |logs: &Vec<f64>| logs.iter().map(|l| l.exp() * factor).collect::<Vec<_>>();
        let ys: Vec<_> = model.logs.iter().map(|logs| logs.as_ref().map(linear)).collect();
        let log = |ys: &Vec<f64>| ys.iter().map(|y| y.ln()).collect();
        model.logs = ys.iter().map(|ys| ys.as_ref().map(log)).collect();
        let sensor = OptionalLikelihood::new(LikelihoodVector::linear(model.states).owned());
        let hmm = Hmm::new(model.prior(), model.sparse(), sensor).unwrap();
        check(&model, &hmm, &ys, &model.enumerate())?;
    }

    /// Adding c_k to the log-likelihoods of step k adds Σ c_k to log p, and changes nothing else.
    #[test]
    fn shifts_add_up(model in models(Kind::Plain), shift in prop_oneof![Just(-400.0), Just(-1e5), Just(700.0)]) {
        let mut shifted = model.clone();
        shifted.logs.iter_mut().flatten().flatten().for_each(|log| *log += shift);
        let count = model.logs.iter().flatten().count() as f64;
        let smooth = |model: &Model| {
            let hmm = model.hmm(model.sparse());
            hmm.smooth(&model).ok()
        };
        match (smooth(&model), smooth(&shifted)) {
            (Some(plain), Some(moved)) => {
                let expected = plain.log_likelihood() + count * shift;
                prop_assert!((moved.log_likelihood() - expected).abs() <= 1e-9);
                for (a, b) in plain.posteriors().as_slice().iter().zip(moved.posteriors().as_slice()) {
                    prop_assert!((a - b).abs() <= 1e-9);
                }
            }
            (plain, moved) => prop_assert!(plain.is_none() && moved.is_none()),
        }
    }
}
