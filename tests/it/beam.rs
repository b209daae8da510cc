//! Viterbi along a beam against the exact one, and against all paths.

use proptest::prelude::*;
use wayfix::transition::SwitchedTransition;
use wayfix::{
    Controlled, Hmm, HmmError, LikelihoodVector, OptionalLikelihood, SparseTransition, canberra,
};

use crate::kit::{Kind, Model, Sensor, cases_of, dyadic_models, models, rng};

type Steps = Hmm<SwitchedTransition<SparseTransition>, Sensor>;

/// Likelihoods as numbers, so that both decoders take the same logarithms.
fn hmm(model: &Model) -> (Steps, Vec<Option<Vec<f64>>>) {
    let sensor = OptionalLikelihood::new(LikelihoodVector::linear(model.states).owned());
    let exp = |logs: &Vec<f64>| logs.iter().map(|log| log.exp()).collect();
    let seen = model.logs.iter().map(|logs| logs.as_ref().map(exp)).collect();
    (Hmm::new(model.prior(), model.sparse(), sensor).unwrap(), seen)
}

fn check(model: &Model, width: f64) -> Result<(), TestCaseError> {
    if model.steps() == 0 {
        return Ok(());
    }
    let (hmm, seen) = hmm(model);
    let controls = model.controls();
    let sequence = Controlled::new(&controls, &seen).unwrap();
    match (hmm.viterbi(&sequence), hmm.beam_viterbi(&sequence, width)) {
        (Ok(best), Ok(found)) => {
            let (log, bound) = (found.path().log_probability(), found.upper_bound());
            let rounding = 1e-12 * (1.0 + best.log_probability().abs());
            // The path has the stated probability, and the best one is below the bound.
            let own = model.log_probability(found.path().states());
            prop_assert!((log - own).abs() <= rounding, "{log}, expected {own}");
            prop_assert!(log <= best.log_probability() + rounding);
            prop_assert!(best.log_probability() <= bound + rounding, "{bound}, {best:?}");
            if found.is_optimal() {
                prop_assert!((log - best.log_probability()).abs() <= rounding);
                prop_assert_eq!(bound, log);
            }
            if found.is_unrivalled() {
                prop_assert_eq!(found.path(), &best);
            }
            if width == f64::INFINITY {
                prop_assert!(found.is_unrivalled());
            }
            prop_assert!(found.most_active() <= model.states);
        }
        (Ok(_), Err(error)) => {
            prop_assert!(width < f64::INFINITY);
            let pruned = matches!(error, HmmError::Pruned { .. });
            prop_assert!(pruned, "{}", error);
        }
        (Err(exact), Err(error)) => {
            let text = exact.to_string();
            let pruned = matches!(error, HmmError::Pruned { .. });
            prop_assert!(error.to_string() == text || (pruned && width < f64::INFINITY));
        }
        (Err(exact), Ok(_)) => prop_assert!(false, "{}", exact),
    }
    Ok(())
}

fn widths() -> impl Strategy<Value = f64> {
    prop_oneof![Just(0.0), 0.1..5.0, Just(f64::INFINITY)]
}

proptest! {
    #![proptest_config(cases_of(4000))]

    #[test]
    fn what_is_proven_is_true(model in models(Kind::Plain), width in widths()) {
        check(&model, width)?;
    }

    #[test]
    fn ties_are_as_those_of_viterbi(model in dyadic_models(), width in widths()) {
        check(&model, width)?;
    }
}

#[test]
fn on_the_map_a_narrow_beam_proves_long_drives() {
    let hmm = canberra::hmm(5, 1.0).unwrap();
    for seed in 0..5 {
        let drive = hmm.simulate(2000, &mut rng(seed));
        let best = hmm.viterbi(drive.observations()).unwrap();
        let found = hmm.beam_viterbi(drive.observations(), 30.0).unwrap();
        assert!(found.is_unrivalled(), "drive {seed}: {}, {best:?}", found.upper_bound());
        assert_eq!(found.path(), &best);
        assert!(found.most_active() < 60, "{}", found.most_active());
    }
}

#[test]
fn a_beam_that_is_too_narrow_does_not_claim_to_prove() {
    let hmm = canberra::hmm(5, 2.0).unwrap();
    let drive = hmm.simulate(2000, &mut rng(1));
    let best = hmm.viterbi(drive.observations()).unwrap();
    let found = hmm.beam_viterbi(drive.observations(), 0.5).unwrap();
    assert!(found.path().log_probability() < best.log_probability());
    assert!(!found.is_optimal() && found.upper_bound() >= best.log_probability());
    // NaN and negative numbers count as 0.
    let narrowest = hmm.beam_viterbi(&[4, 4], 0.0).unwrap();
    assert_eq!(hmm.beam_viterbi(&[4, 4], f64::NAN).unwrap(), narrowest);
    assert_eq!(hmm.beam_viterbi(&[4, 4], -1.0).unwrap(), narrowest);
}

#[test]
fn an_empty_sequence_has_the_empty_path() {
    let hmm = canberra::hmm(5, 1.0).unwrap();
    let found = hmm.beam_viterbi(&[0_usize; 0], 1.0).unwrap();
    assert!(found.path().states().is_empty() && found.is_unrivalled());
    assert_eq!((found.upper_bound(), found.most_active()), (0.0, 0));
    assert!(found.into_path().into_states().is_empty());
}

#[test]
fn errors_name_the_step() {
    let hmm = canberra::hmm(5, 1.0).unwrap();
    let text = hmm.beam_viterbi(&[4, 999], 1.0).unwrap_err().to_string();
    assert_eq!(
        text,
        "step 2 has no valid likelihood: symbol 999 does not exist, the table has 105 symbols (0 to 104)"
    );
}
