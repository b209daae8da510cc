//! Every routine against the sum (or the maximum) over all paths.

use proptest::prelude::*;
use wayfix::{Hmm, LikelihoodVector, OptionalLikelihood};

use crate::kit::{Kind, Model, cases, check_enumeration, models};

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn sparse_equals_enumeration(model in models(Kind::Shifted)) {
        let hmm = model.hmm(model.sparse());
        check_enumeration(&model, &hmm, &model.logs, &model.enumerate())?;
    }

    /// With entries of 1e-300 and likelihoods hundreds of orders apart.
    #[test]
    fn extremes_equal_enumeration(model in models(Kind::Extreme)) {
        let answer = model.enumerate();
        let hmm = model.hmm(model.sparse());
        check_enumeration(&model, &hmm, &model.logs, &answer)?;
    }

    #[test]
    fn dense_equals_enumeration(model in models(Kind::Shifted)) {
        let hmm = model.hmm(model.dense());
        check_enumeration(&model, &hmm, &model.logs, &model.enumerate())?;
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
        check_enumeration(&model, &hmm, &ys, &model.enumerate())?;
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
