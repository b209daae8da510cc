//! Bounds of pruned routines, with evidence on moves.

use proptest::prelude::*;
use wayfix::inference::Pruning;
use wayfix::transition::EvidenceTransition;
use wayfix::{
    Belief, Controlled, Hmm, HmmError, LikelihoodVector, OptionalLikelihood, Prior,
    SparseTransition, TransitionEntries,
};

use crate::kit::{Kind, Model, cases, measured_models};

/// Along a beam, no path is above the bound, and a path that is proven best is best.
fn check_beam(model: &Model, width: f64) -> Result<(), TestCaseError> {
    if model.steps() == 0 {
        return Ok(());
    }
    let seen: Vec<Option<Vec<f64>>> = (model.logs.iter())
        .map(|logs| logs.as_ref().map(|logs| logs.iter().map(|log| log.exp()).collect()))
        .collect();
    let sensor = LikelihoodVector::linear(model.states).owned();
    let sensor = OptionalLikelihood::new(sensor);
    let hmm = Hmm::new(model.prior(), model.measured(), sensor).unwrap();
    let controls = model.controls();
    let drive = Controlled::new(&controls, &seen).unwrap();
    match (hmm.viterbi(&drive), hmm.beam_viterbi(&drive, width)) {
        (Ok(best), Ok(found)) => {
            let (log, bound) = (found.path().log_probability(), found.upper_bound());
            let rounding = 1e-12 * (1.0 + best.log_probability().abs()) + 1e-11;
            let own = model.log_probability(found.path().states());
            prop_assert!((log - own).abs() <= rounding, "{log}, expected {own}");
            prop_assert!(best.log_probability() <= bound + rounding, "{bound}, {best:?}");
            if found.is_optimal() || width == f64::INFINITY {
                prop_assert!((log - best.log_probability()).abs() <= rounding);
            }
        }
        (exact, Err(error)) => {
            let pruned = matches!(error, HmmError::Pruned { .. });
            // (If both are impossible, either the move or the observation may be named.)
            let step = |error: &HmmError| match error {
                HmmError::Impossible { step } | HmmError::ImpossibleMove { step } => Some(*step),
                _ => None,
            };
            let same =
                step(&error).is_some() && exact.err().as_ref().and_then(step) == step(&error);
            prop_assert!(same || (pruned && width < f64::INFINITY), "{}", error);
        }
        (Err(exact), Ok(_)) => prop_assert!(false, "{}", exact),
    }
    Ok(())
}

/// The exact belief is within the bounds of the pruned one.
fn check_pruned(model: &Model, pruning: Pruning) -> Result<(), TestCaseError> {
    let hmm = model.hmm(model.measured());
    let answer = model.enumerate();
    let (mut pruned, mut exact) = (hmm.pruned_filter(pruning), hmm.filter());
    for k in 1..=model.steps() {
        let same = match &model.logs[k - 1] {
            None => exact.predict_with(&(k - 1)),
            seen => exact.step_with(&(k - 1), seen).map(|_| ()),
        };
        let before = (pruned.active().to_vec(), pruned.probabilities().to_vec());
        let result = match &model.logs[k - 1] {
            None => pruned.predict_with(&(k - 1)),
            seen => pruned.step_with(&(k - 1), seen),
        };
        match result {
            Ok(certificate) => {
                prop_assert_ne!(answer.impossible_at, Some(k));
                let distances = answer.filtered[k].iter().enumerate();
                let distances = distances.map(|(i, p)| (p - pruned.probability(i).unwrap()).abs());
                let (distance, bound) = (0.5 * distances.sum::<f64>(), certificate.bound());
                prop_assert!(distance <= bound + 1e-11, "step {}: {distance:e} > {bound:e}", k);
                let part = Model { logs: model.logs[..k].to_vec(), ..model.clone() };
                let log = part.enumerate().log_likelihood;
                let (range, rounding) = (pruned.log_likelihood(), 1e-10 + 1e-12 * log.abs());
                prop_assert!(
                    range.start() - rounding <= log && log <= range.end() + rounding,
                    "step {}: {log} in {range:?}",
                    k
                );
            }
            Err(HmmError::Pruned { step }) => {
                prop_assert_eq!(step, k);
                prop_assert_eq!(pruned.active(), before.0);
                prop_assert_eq!(pruned.probabilities(), before.1);
                break;
            }
            Err(error) => {
                // The error names the same of move and observation.
                prop_assert_eq!(Some(error.to_string()), same.err().map(|e| e.to_string()));
                prop_assert_eq!(answer.impossible_at, Some(k));
                break;
            }
        }
    }
    Ok(())
}

fn prunings() -> impl Strategy<Value = Pruning> {
    let tolerance = prop_oneof![Just(0.0), Just(1e-12), Just(1e-3), Just(1.0), Just(1e8)];
    let most_active = prop_oneof![1 => Just(usize::MAX), 2 => 1..=5_usize];
    let pruning = |(tolerance, most_active)| {
        Pruning::default().with_tolerance(tolerance).with_most_active(most_active)
    };
    (tolerance, most_active).prop_map(pruning)
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn what_is_proven_of_a_pruned_belief_with_evidence_holds(model in measured_models(Kind::Plain, false), pruning in prunings()) {
        check_pruned(&model, pruning)?;
    }

    #[test]
    fn what_is_proven_with_evidence_of_wide_ranges_holds(model in measured_models(Kind::Extreme, true), pruning in prunings()) {
        check_pruned(&model, pruning)?;
    }

    #[test]
    fn a_beam_with_evidence_proves_what_is_true(model in measured_models(Kind::Plain, true), width in prop_oneof![Just(0.0), 0.1..50.0, Just(f64::INFINITY)]) {
        check_beam(&model, width)?;
    }
}

/// Two states that stay, and evidence on both stays with these logarithms.
fn staying(logs: [f64; 2]) -> Hmm<impl TransitionEntries<Control = ()>, LikelihoodVector> {
    let still = SparseTransition::from_triplets(2, [(0, 0, 1.0), (1, 1, 1.0)]).unwrap();
    let moves = EvidenceTransition::new(still, move |(): &(), to, _| logs[to]).unwrap();
    let prior = Prior::AtFirstObservation(Belief::uniform(2).unwrap());
    Hmm::new(prior, moves, LikelihoodVector::linear(2)).unwrap()
}

#[test]
fn mass_that_was_dropped_counts_however_unlikely_the_evidence_is() {
    // The second state is dropped at 1e-285, and the evidence takes it below the smallest double;
    // then the sensor names it.
    for log in [-60.0, -100.0, -150.0, -700.0, -1500.0] {
        let hmm = staying([log; 2]);
        let mut pruned = hmm.pruned_filter(Pruning::default());
        pruned.step(&[1.0, 1e-285]).unwrap();
        assert_eq!(pruned.active(), [0]);
        let certificate = pruned.step_with(&(), &[1e-150, 1e150]).unwrap();
        let distance = 1.0 - pruned.probability(1).unwrap(); // the exact belief is [1e-15, 1]
        assert!(certificate.bound() >= distance - 1e-14, "{log}: {certificate:?} for {distance}");
        let (range, exact) = (pruned.log_likelihood(), log + 1e-135_f64.ln() + 0.5_f64.ln());
        assert!(*range.start() <= exact && exact <= *range.end(), "{log}: {exact} in {range:?}");
    }
}

#[test]
fn logarithms_of_large_evidence_count_with_their_rounding() {
    for at in [1e3, 1e5, 1e7, 1e9, 1e12] {
        let (mut largest, mut bounds) = (0.0_f64, Vec::new());
        for number in 0..50_u32 {
            let logs = [-at - f64::from(number) / 7.0, -at - f64::from(50 - number) / 9.0];
            let hmm = staying(logs);
            let mut pruned = hmm.pruned_filter(Pruning::default());
            pruned.step(&[1.0, 1.0]).unwrap();
            let bound = pruned.step_with(&(), &[1.0, 1.0]).unwrap().bound();
            // The difference of two numbers this near each other is exact.
            let exact = 1.0 / (1.0 + (logs[1] - logs[0]).exp());
            let distance = (pruned.probability(0).unwrap() - exact).abs();
            assert!(distance <= bound, "{logs:?}: {distance:e} > {bound:e}");
            largest = largest.max(distance);
            bounds.push(bound);
        }
        // The bound is useful: it is of the size of the rounding.
        let bound = bounds.iter().copied().fold(0.0, f64::max);
        assert!(bound <= 1e-12 + 1e-14 * at, "{at:e}: {bound:e}, seen {largest:e}");
    }
}
