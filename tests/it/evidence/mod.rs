//! Evidence on moves: every routine against the enumeration of all paths, and cases by hand.

mod bounds;
mod pairs;
mod restarts;
mod wide;

use proptest::prelude::*;
use wayfix::inference::Pruning;
use wayfix::transition::EvidenceTransition;
use wayfix::{
    Belief, Controlled, Hmm, HmmError, LikelihoodVector, OptionalLikelihood, Prior,
    SparseTransition, TransitionEntries,
};

use crate::kit::{
    Evidence, Kind, Model, NEVER, cases, check_enumeration, check_evidence, check_frequencies,
    measured_models, possible, rng, says,
};

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn evidence_equals_enumeration(model in measured_models(Kind::Shifted, false), of in (0..8_usize, 0..40_usize, any::<u64>())) {
        check_evidence(&model, model.measured(), of)?;
    }

    /// Likelihoods of one step 1e400 apart, and log factors that take all of them out of the range
    /// of doubles.
    #[test]
    fn evidence_of_wide_ranges_equals_enumeration(model in measured_models(Kind::Shifted, true), of in (0..8_usize, 0..40_usize, any::<u64>())) {
        check_evidence(&model, model.measured(), of)?;
    }

    #[test]
    fn evidence_on_extremes_equals_enumeration(model in measured_models(Kind::Extreme, true), of in (0..8_usize, 0..40_usize, any::<u64>())) {
        check_evidence(&model, model.measured(), of)?;
    }

    /// The smoother then goes back by the likelihoods, in two products a step.
    #[test]
    fn evidence_beside_likelihoods_at_hand_equals_enumeration(mut model in measured_models(Kind::Plain, true)) {
        let exp = |logs: &Vec<f64>| logs.iter().map(|log| log.exp()).collect::<Vec<_>>();
        let ys: Vec<_> = model.logs.iter().map(|logs| logs.as_ref().map(exp)).collect();
        let log = |ys: &Vec<f64>| ys.iter().map(|y| y.ln()).collect();
        model.logs = ys.iter().map(|ys| ys.as_ref().map(log)).collect();
        let sensor = OptionalLikelihood::new(LikelihoodVector::linear(model.states).owned());
        let hmm = Hmm::new(model.prior(), model.measured(), sensor).unwrap();
        check_enumeration(&model, &hmm, &ys, &model.enumerate())?;
    }

    /// An operator with only the required methods.
    #[test]
    fn evidence_of_an_own_operator_equals_enumeration(model in measured_models(Kind::Shifted, false), of in (0..8_usize, 0..40_usize, any::<u64>())) {
        check_evidence(&model, model.own_measured(), of)?;
    }

}

#[test]
fn paths_drawn_with_evidence_have_their_frequencies() {
    use proptest::strategy::ValueTree;
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    let mut tested = 0;
    while tested < 20 {
        let wide = tested % 2 == 0;
        let model = measured_models(Kind::Plain, wide).new_tree(&mut runner).unwrap().current();
        if possible(&model) && model.steps() >= 2 {
            let hmm = model.hmm(model.measured());
            tested += u64::from(check_frequencies(&model, &hmm, tested));
        }
    }
}

/// Two places; the evidence is a number that favours staying.
fn by_hand(
    log: impl Fn(&f64, usize, usize) -> f64,
) -> Hmm<impl TransitionEntries<Control = f64>, LikelihoodVector> {
    let base = SparseTransition::from_rows(&[[0.5, 0.25], [0.5, 0.75]]).unwrap();
    let prior = Prior::BeforeFirstTransition(Belief::new(vec![0.5, 0.5]).unwrap());
    let measured = EvidenceTransition::new(base, log).unwrap();
    Hmm::new(prior, measured, LikelihoodVector::linear(2)).unwrap()
}

#[test]
fn the_sum_of_a_prediction_is_the_probability_of_the_measurement() {
    // p(u | stays) = u, p(u | moves) = 1 − u.
    let hmm = by_hand(|u, to, from| if to == from { u.ln() } else { (1.0 - u).ln() });
    let mut filter = hmm.filter();
    filter.predict_with(&0.75).unwrap();
    // To 0: 0.5 · 0.5 · 0.75 + 0.5 · 0.25 · 0.25 = 0.21875; to 1: 0.0625 + 0.28125.
    assert!((filter.belief().as_slice()[0] - 0.218_75 / 0.562_5).abs() < 1e-15);
    assert!((filter.log_likelihood() - 0.562_5_f64.ln()).abs() < 1e-15);
    let log = filter.update(&[0.5, 0.25]).unwrap();
    let seen = (0.218_75 * 0.5 + 0.343_75 * 0.25) / 0.562_5;
    assert!((log - f64::ln(seen)).abs() < 1e-15);
    // Evidence that is the same for all moves changes no belief.
    let mut other = hmm.filter();
    assert!((other.step_with(&0.5, &[1.0, 1.0]).unwrap() - 0.5_f64.ln()).abs() < 1e-15);
    assert_eq!(other.belief().as_slice(), [0.375, 0.625]);
}

#[test]
fn what_cannot_have_been_measured_is_an_error_with_its_step() {
    let hmm = by_hand(|u, _, _| u.ln());
    let seen = [[1.0, 1.0]; 3];
    let controls = [1.0, 0.0, 1.0];
    let drive = Controlled::new(&controls, &seen).unwrap();
    let expected = "what was measured on the way to step 2 is impossible under the model";
    says(hmm.smooth(&drive), expected);
    says(hmm.viterbi(&drive), expected);
    says(hmm.k_best(&drive, 3), expected);
    says(hmm.path_entropy(&drive), expected);
    says(hmm.beam_viterbi(&drive, 1.0), expected);
    let (mut filter, mut decoder) = (hmm.filter(), hmm.online_viterbi());
    filter.step_with(&1.0, &seen[0]).unwrap();
    decoder.step_with(&1.0, &seen[0]).unwrap();
    let before = filter.snapshot();
    says(filter.step_with(&0.0, &seen[1]), expected);
    says(filter.predict_with(&0.0), expected);
    says(decoder.step_with(&0.0, &seen[1]), expected);
    says(decoder.predict_with(&0.0), expected);
    assert_eq!(filter.snapshot(), before);
    for pruning in [Pruning::default(), Pruning::default().with_most_active(1)] {
        let mut pruned = hmm.pruned_filter(pruning);
        pruned.step_with(&1.0, &seen[0]).unwrap();
        says(pruned.step_with(&0.0, &seen[1]), expected);
        says(pruned.predict_with(&0.0), expected);
        // A possible move, and an observation that rules out all states that it leads to.
        let ruled_out = "the observation of step 2 is impossible under the model";
        says(pruned.step_with(&1.0, &[0.0, 0.0]), ruled_out);
    }
    // A sighting that is impossible by itself is a different error.
    says(
        filter.step_with(&1.0, &[0.0, 0.0]),
        "the observation of step 2 is impossible under the model",
    );
}

#[test]
fn evidence_that_is_no_likelihood_is_an_error_with_its_step_and_states() {
    let hmm = by_hand(|u, to, from| if (to, from) == (1, 0) { *u } else { 0.0 });
    let mut filter = hmm.filter();
    filter.step_with(&0.0, &[1.0, 1.0]).unwrap();
    let before = filter.snapshot();
    for (u, name) in [(f64::NAN, "NaN"), (f64::INFINITY, "inf")] {
        let expected = format!(
            "step 2 has no valid control: a log-likelihood of {name} for the move from state 0 to state 1, expected a value up to 1e300 or negative infinity"
        );
        says(filter.step_with(&u, &[1.0, 1.0]), &expected);
        says(filter.predict_with(&u), &expected);
        let controls = [0.0, u];
        says(hmm.viterbi(&Controlled::new(&controls, &[[1.0, 1.0]; 2]).unwrap()), &expected);
        says(hmm.k_best(&Controlled::new(&controls, &[[1.0, 1.0]; 2]).unwrap(), 2), &expected);
    }
    assert_eq!(filter.snapshot(), before);
    filter.step_with(&NEVER, &[1.0, 1.0]).unwrap();
    says(
        hmm.filter().forecast_with(&[f64::NAN]),
        "step 1 has no valid control: a log-likelihood of NaN for the move from state 0 to state 1, expected a value up to 1e300 or negative infinity",
    );
}

#[test]
fn a_log_factor_must_be_a_number() {
    let base = SparseTransition::from_rows(&[[1.0]]).unwrap();
    let measured = EvidenceTransition::new(base, |_: &f64, _, _| 0.0).unwrap();
    let measured = measured.with_log_factor(|u| *u);
    let prior = Prior::BeforeFirstTransition(Belief::certain(1, 0).unwrap());
    let hmm = Hmm::new(prior, measured, LikelihoodVector::linear(1)).unwrap();
    assert_eq!(hmm.filter().step_with(&-1e9, &[1.0]).unwrap(), 0.0);
    let error = hmm.filter().step_with(&f64::NAN, &[1.0]).unwrap_err();
    assert!(matches!(error, HmmError::EvidenceFactor { step: 1, value } if value.is_nan()));
    assert!(hmm.log_likelihood(&Controlled::new(&[NEVER], &[[1.0]]).unwrap()).is_err());
}

#[test]
fn what_is_measured_cannot_be_given_to_a_simulation() {
    let model = Model {
        states: 1,
        at_first: true,
        prior: vec![1.0],
        matrices: vec![vec![vec![1.0]]; 2],
        evidence: vec![Evidence { logs: vec![vec![-1.0]], log_factor: 0.0 }; 2],
        logs: vec![None; 2],
    };
    let table = wayfix::TableLikelihood::from_rows(&[[1.0]]).unwrap();
    let hmm = Hmm::new(model.prior(), model.measured(), table).unwrap();
    let expected =
        "the control of step 2 is evidence on the move, which a simulation cannot be given";
    says(hmm.simulate_with(&[0, 1], &mut rng(1)), expected);
    assert_eq!(hmm.simulate_with(&[0], &mut rng(1)).unwrap().states(), [0]);
    let mut filter = hmm.filter();
    filter.step_with(&0, &0).unwrap();
    says(filter.simulate_with(&[1], &mut rng(1)), expected);
}
