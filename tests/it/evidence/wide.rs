//! Evidence on moves far beyond the range of doubles.

use wayfix::motion::{DistanceTransition, OdometryReading, OffMapTransition};
use wayfix::transition::EvidenceTransition;
use wayfix::{Belief, Hmm, LikelihoodVector, Prior, SparseTransition, Transition};

fn diagonal() -> SparseTransition {
    SparseTransition::from_triplets(2, [(0, 0, 1.0), (1, 1, 1.0)]).unwrap()
}

/// A distance that speaks against a move by 4,000 nats, and a sighting that speaks for it by
/// 5,000.
#[test]
fn a_distance_that_underflows_is_not_lost() {
    let length = |to, _| if to == 0 { 1000.0 } else { 100.0 };
    let transition = DistanceTransition::new(diagonal(), length).unwrap();
    let prior = Prior::BeforeFirstTransition(Belief::uniform(2).unwrap());
    let hmm = Hmm::new(prior, transition, LikelihoodVector::log(2)).unwrap();
    let read = [Some(OdometryReading { distance: 990.0, variance: 100.0 })];
    let seen = [[0.0, 5000.0]];
    let drive = wayfix::Controlled::new(&read, &seen).unwrap();
    let expected = 0.5_f64.ln() + 5000.0
        - 0.5 * (2.0 * std::f64::consts::PI * 100.0).ln()
        - 890.0_f64.powi(2) / 200.0;
    let close = |found: f64| assert!((found - expected).abs() < 1e-9, "{found} {expected}");
    close(hmm.log_likelihood(&drive).unwrap());
    let path = hmm.viterbi(&drive).unwrap();
    assert_eq!(path.states(), [1]);
    close(path.log_probability());
    let mut filter = hmm.filter();
    filter.predict_with(&read[0]).unwrap();
    filter.update(&seen[0]).unwrap();
    assert_eq!(filter.belief().as_slice(), [0.0, 1.0]);
    close(filter.log_likelihood());
}

/// Entries of any size that a double holds.
struct Large(f64);

impl Transition for Large {
    type Control = ();

    fn states(&self) -> usize {
        2
    }

    fn apply(&self, (): &(), x: &[f64], out: &mut [f64]) {
        (out[0], out[1]) = (self.0 * x[0], 0.5 * self.0 * x[1]);
    }

    fn apply_transpose(&self, (): &(), x: &[f64], out: &mut [f64]) {
        self.apply(&(), x, out);
    }

    fn evidence(&self, (): &()) -> Option<f64> {
        Some(0.0)
    }
}

#[test]
fn entries_far_above_one_are_taken() {
    for entry in [1.0, 1e7, 2e7, 1e20, 1e150, 1e300, 1e307] {
        let prior = Prior::AtFirstObservation(Belief::uniform(2).unwrap());
        let hmm = Hmm::new(prior, Large(entry), LikelihoodVector::linear(2)).unwrap();
        let found = hmm.log_likelihood(&[[1.0, 1.0], [1.0, 1.0]]).unwrap();
        let expected = entry.ln() + 0.75_f64.ln();
        assert!((found - expected).abs() < 1e-12 * expected.abs().max(1.0), "{entry}: {found}");
    }
}

#[test]
fn what_is_never_come_back_to_stays_impossible_off_the_map() {
    for log in [1.0, 17.0, 50.0, 600.0] {
        let half = SparseTransition::from_rows(&[[0.5; 2]; 2]).unwrap();
        let moves = EvidenceTransition::new(half, |(): &(), _, _| f64::NEG_INFINITY).unwrap();
        let back = Belief::certain(2, 1).unwrap();
        let off = OffMapTransition::new(moves, 0.25, 0.5, back).unwrap();
        let off = off.with_evidence(log).unwrap();
        let prior = Prior::AtFirstObservation(Belief::uniform(3).unwrap());
        let hmm = Hmm::new(prior, off, LikelihoodVector::linear(3)).unwrap();
        let found = hmm.log_likelihood(&[[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]).unwrap();
        let expected = log + (0.5_f64).ln() + (1.0 / 3.0_f64).ln();
        assert!((found - expected).abs() < 1e-11, "{log}: {found} {expected}");
        let error = hmm.log_likelihood(&[[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]).unwrap_err();
        assert!(matches!(error, wayfix::HmmError::Impossible { step: 2 }), "{error}");
    }
}
