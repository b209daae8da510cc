//! Operators of road maps, with the metres driven as control.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::motion::{DistanceTransition, OdometryReading, OffMapTransition};
use wayfix::transition::KroneckerTransition;
use wayfix::{
    Belief, Controlled, Hmm, HmmError, LikelihoodVector, Prior, SparseTransition, Transition,
    TransitionEntries,
};

use super::evidence;
use crate::kit::{
    Expected, Matrix, assert_operator, cases_of, kronecker, matrix, off_map, rate, sparse, still,
    stochastic, text,
};

/// ln A by the formula.
fn joint(m: &Matrix, lengths: &Matrix, odometry: Option<OdometryReading>) -> Matrix {
    let log = |i: usize, j: usize| {
        odometry.map_or(0.0, |OdometryReading { distance, variance }| {
            let square = (distance - lengths[i][j]).powi(2);
            -0.5 * (2.0 * std::f64::consts::PI * variance).ln() - square / (2.0 * variance)
        })
    };
    matrix(m.len(), |i, j| m[i][j].ln() + log(i, j))
}

/// The log factor: the density at the nearest length.
fn log_factor(m: &Matrix, lengths: &Matrix, odometry: Option<OdometryReading>) -> Option<f64> {
    let OdometryReading { distance, variance } = odometry?;
    let there = m.iter().flatten().zip(lengths.iter().flatten()).filter(|entry| *entry.0 > 0.0);
    let squares = there.map(|(_, length)| (distance - length).powi(2));
    let least = squares.fold(f64::INFINITY, f64::min);
    Some(-0.5 * (2.0 * std::f64::consts::PI * variance).ln() - least / (2.0 * variance))
}

/// Entries, with the log factor taken out.
fn by_distance(m: &Matrix, lengths: &Matrix, odometry: Option<OdometryReading>) -> Matrix {
    let (logs, log_factor) = (joint(m, lengths, odometry), log_factor(m, lengths, odometry));
    matrix(m.len(), |i, j| (logs[i][j] - log_factor.unwrap_or(0.0)).exp())
}

/// A base operator, the length of each move, and the metres of three steps. Lengths are multiples
/// of a quarter and variances powers of two, 2^least or more, so that squares are exact.
fn road_network(
    most: usize,
    least: i32,
) -> impl Strategy<Value = (Matrix, Matrix, Vec<Option<OdometryReading>>)> {
    let quarters = |n: i32| (0..n).prop_map(|quarters| 0.25 * f64::from(quarters));
    let variance = move || (least..14_i32).prop_map(|power| 2.0_f64.powi(power));
    let odometry = move || {
        (quarters(1000), variance()).prop_map(|(distance, variance)| OdometryReading {
            distance: distance - 25.0,
            variance,
        })
    };
    (1..=most).prop_flat_map(move |n| {
        let base = stochastic(false, n);
        let length = prop_oneof![1 => Just(0.0), 1 => Just(100.0), 2 => quarters(800)];
        let controls = (odometry(), odometry(), any::<bool>());
        let controls =
            controls.prop_map(|(a, b, none)| vec![Some(a), (!none).then_some(b), Some(b)]);
        (base, vec(vec(length, n), n), controls)
    })
}

fn on_roads(m: &Matrix, lengths: &Matrix) -> DistanceTransition {
    DistanceTransition::new(sparse(m), |to, from| lengths[to][from]).unwrap()
}

proptest! {
    #![proptest_config(cases_of(1000))]

    #[test]
    fn by_distance_is_its_matrix((m, lengths, controls) in road_network(7, 9)) {
        let a = on_roads(&m, &lengths);
        for (i, j) in (0..49).map(|at| (at / 7, at % 7)) {
            let there = i < m.len() && j < m.len() && m[i][j] > 0.0;
            prop_assert_eq!(a.length(i, j), there.then(|| lengths[i][j]));
        }
        let expected: Vec<Matrix> = controls.iter().map(|u| by_distance(&m, &lengths, *u)).collect();
        let factors: Vec<_> = controls.iter().map(|u| log_factor(&m, &lengths, *u)).collect();
        assert_operator(a, Expected::each(&controls, &expected).with_evidence(&factors))?;
    }

    /// With densities further apart than the range of doubles.
    #[test]
    fn densities_of_any_size_are_known((m, lengths, controls) in road_network(6, -6)) {
        let a = on_roads(&m, &lengths);
        for control in controls.into_iter().flatten().map(Some) {
            evidence::check(&a, control, &joint(&m, &lengths, control), false)?;
        }
    }

    /// Lengths on either side of the distance, so similar that rounding decides.
    #[test]
    fn lengths_that_differ_by_a_bit_have_densities_up_to_the_largest(
        (distance, off) in (0.0..1000.0, prop_oneof![0.0..1e-9, 0.0..500.0]),
        sides in vec((any::<bool>(), -3..4_i64), 1..8),
        variance in prop_oneof![Just(5e-324), Just(1e-30), Just(1e-12)],
    ) {
        let nudged = |x: f64, bits: i64| f64::from_bits(x.to_bits().saturating_add_signed(bits));
        let length = |(up, bits): &(bool, i64)| {
            nudged(if *up { distance + off } else { f64::abs(distance - off) }, *bits)
        };
        let lengths: Vec<f64> = sides.iter().map(length).collect();
        let found = ways(&fork(&lengths), distance, variance);
        let most = 1.0 / lengths.len() as f64;
        prop_assert!(found.iter().all(|way| way.1 > 0.0 && way.1 <= most), "{:?}", found);
    }

    /// The listed entries are those of the products, to the bit.
    #[test]
    fn listed_entries_are_those_of_products((m, lengths, controls) in road_network(6, -6)) {
        let a = on_roads(&m, &lengths);
        let n = m.len();
        for control in &controls {
            for j in 0..n {
                let (mut unit, mut column) = (vec![0.0; n], vec![0.0; n]);
                unit[j] = 1.0;
                a.apply(control, &unit, &mut column);
                let listed: Vec<_> = a.outgoing(control, j).collect();
                let entries = column.into_iter().enumerate().filter(|entry| entry.1 > 0.0);
                prop_assert_eq!(&entries.collect::<Vec<_>>(), &listed);
                for (i, p) in listed {
                    prop_assert_eq!(a.incoming(control, i).find(|e| e.0 == j), Some((j, p)));
                }
            }
        }
    }

    #[test]
    fn by_distance_nests(
        (m, lengths, controls) in road_network(3, 9),
        (one, other) in (rate(false), rate(false)),
    ) {
        let n = m.len();
        let a = || on_roads(&m, &lengths);
        let uniform = Belief::uniform(n).unwrap();
        let even = vec![1.0 / n as f64; n];
        let driven: Vec<Matrix> = controls.iter().map(|u| by_distance(&m, &lengths, *u)).collect();
        let over = |map: &dyn Fn(&Matrix) -> Matrix| driven.iter().map(map).collect::<Vec<_>>();

        let factors: Vec<_> = controls.iter().map(|u| log_factor(&m, &lengths, *u)).collect();
        let lost = || OffMapTransition::new(a(), one, other, uniform.clone()).unwrap();
        let off = |m: &Matrix| off_map(m, one, other, &even);
        assert_operator(lost(), Expected::each(&controls, &over(&off)).with_evidence(&factors))?;
        let pairs = KroneckerTransition::new(a(), lost()).unwrap();
        let twice: Vec<_> = factors.iter().map(|factor| factor.map(|log| 2.0 * log)).collect();
        let expected = over(&|m| kronecker(m, &off(m)));
        assert_operator(pairs, Expected::each(&controls, &expected).with_evidence(&twice))?;
    }
}

/// Moves of these lengths from state 0 to states 1, 2, …, equally probable.
pub(crate) fn fork(lengths: &[f64]) -> DistanceTransition {
    let (n, p) = (lengths.len() + 1, 1.0 / lengths.len() as f64);
    let ways = (1..n).flat_map(|i| [(i, 0, p), (i, i, 1.0)]);
    let base = SparseTransition::from_triplets(n, ways).unwrap();
    DistanceTransition::new(base, |to, from| if from == 0 { lengths[to - 1] } else { 0.0 }).unwrap()
}

pub(crate) fn ways(a: &DistanceTransition, distance: f64, variance: f64) -> Vec<(usize, f64)> {
    let control = Some(OdometryReading { distance, variance });
    a.check_control(&control).unwrap();
    a.outgoing(&control, 0).collect()
}

#[test]
fn entries_are_densities_over_that_of_the_nearest_length() {
    let a = fork(&[100.0, 130.0]);
    let control = Some(OdometryReading { distance: 130.0, variance: 100.0 });
    assert_eq!(
        a.outgoing(&control, 0).collect::<Vec<_>>(),
        [(1, 0.5 * (-4.5_f64).exp()), (2, 0.5)]
    );
    // A stay in state 1 has the length 0, which is improbable given 130 m.
    assert_eq!(a.outgoing(&control, 1).collect::<Vec<_>>(), [(1, (-84.5_f64).exp())]);
    let density = -0.5 * (200.0 * std::f64::consts::PI).ln();
    assert!((a.evidence(&control).unwrap() - density).abs() < 1e-15);
    let off = Some(OdometryReading { distance: 150.0, variance: 100.0 });
    assert!((a.evidence(&off).unwrap() - (density - 2.0)).abs() < 1e-15);
    assert_eq!(a.evidence(&None), None);
}

#[test]
fn a_distance_speaks_against_places_without_such_a_way() {
    // Two loops of two places, of 100 m and of 500 m, without observations.
    let moves = [(1, 0, 1.0), (0, 1, 1.0), (3, 2, 1.0), (2, 3, 1.0)];
    let base = SparseTransition::from_triplets(4, moves).unwrap();
    let a = DistanceTransition::new(base, |_, from| if from < 2 { 100.0 } else { 500.0 }).unwrap();
    let prior = Prior::BeforeFirstTransition(Belief::uniform(4).unwrap());
    let hmm = Hmm::new(prior, a, LikelihoodVector::linear(4)).unwrap();
    let mut filter = hmm.filter();
    filter.predict_with(&Some(OdometryReading { distance: 500.0, variance: 1600.0 })).unwrap();
    assert!(filter.belief().mass([2, 3]).unwrap() > 1.0 - 1e-15);
    let expected = -0.5 * (2.0 * std::f64::consts::PI * 1600.0).ln() - 2.0_f64.ln();
    assert!((filter.log_likelihood() - expected).abs() < 1e-14);
}

#[test]
fn far_off_distances_keep_their_digits() {
    // Squares near 1e12 differ by 2^-10 (2e6 − 200), which the formula loses.
    let gap = 2.0_f64.powi(-10);
    let a = fork(&[100.0, 100.0 + gap]);
    let found = ways(&a, 1e6, 1024.0);
    let exponent = gap * (2e6 - 200.0 - gap) / 2048.0;
    assert!((found[1].1 / found[0].1 / exponent.exp() - 1.0).abs() < 1e-14, "{found:?}");
}

#[test]
fn numbers_at_the_limits_give_distributions_or_errors() {
    let extremes = [0.0, 5e-324, 1e-308, 1e-160, 1.0, 1e160, 1e300, f64::MAX];
    let a = fork(&extremes);
    let n = a.states();
    let (mut out, mut from) = (vec![0.0; n], vec![0; n]);
    let prior = || Prior::BeforeFirstTransition(Belief::uniform(n).unwrap());
    let hmm = Hmm::new(prior(), &a, LikelihoodVector::linear(n)).unwrap();
    for distance in extremes.iter().flat_map(|d| [*d, -d]) {
        for &variance in &extremes[1..] {
            let control = Some(OdometryReading { distance, variance });
            a.check_control(&control).unwrap();
            a.apply_transpose(&control, &vec![1.0; n], &mut out);
            assert!(
                out.iter().all(|sum| (0.0..=1.0 + 1e-14).contains(sum)),
                "{control:?}: {out:?}"
            );
            a.apply(&control, &vec![1.0; n], &mut out);
            assert!(out.iter().all(|p| (0.0..=n as f64).contains(p)), "{control:?}: {out:?}");
            a.max_product(&control, &vec![0.0; n], &mut out, &mut from);
            assert!(out.iter().all(|best| *best <= 0.0), "{control:?}: {out:?}");
            let mut filter = hmm.filter();
            match filter.predict_with(&control) {
                Ok(()) => {
                    let sum: f64 = filter.belief().as_slice().iter().sum();
                    assert!((sum - 1.0).abs() < 1e-12 && filter.log_likelihood().is_finite());
                }
                // The density of a distance that far off would be NaN.
                Err(error) => {
                    assert!(matches!(error, HmmError::EvidenceFactor { step: 1, .. }), "{error}");
                }
            }
        }
    }
}

/// An uninformative camera, and two ways to the same end.
#[test]
fn odometry_tells_ways_apart() {
    // From 0 via 1 (100 m, 300 m) or via 2 (300 m, 100 m) to 3, which leads to itself.
    let base = [(1, 0, 0.5), (2, 0, 0.5), (3, 1, 1.0), (3, 2, 1.0), (3, 3, 1.0)];
    let base = SparseTransition::from_triplets(4, base).unwrap();
    let metres = |to: usize, from: usize| match (from, to) {
        (0, 1) | (2, 3) => 100.0,
        (0, 2) | (1, 3) => 300.0,
        _ => 0.0,
    };
    let a = DistanceTransition::new(base, metres).unwrap();
    let prior = Prior::AtFirstObservation(Belief::certain(4, 0).unwrap());
    let hmm = Hmm::new(prior, a, LikelihoodVector::linear(4).owned()).unwrap();
    let seen = vec![vec![1.0; 4]; 3];
    let metres = |distance| Some(OdometryReading { distance, variance: 900.0 });
    for (driven, path) in [(120.0, [0, 1, 3]), (270.0, [0, 2, 3]), (200.0, [0, 1, 3])] {
        let controls = [None, metres(driven), None];
        let drive = Controlled::new(&controls, &seen).unwrap();
        assert_eq!(hmm.viterbi(&drive).unwrap().states(), path);
        let smoothed = hmm.smooth(&drive).unwrap();
        let odds = ((driven - 300.0).powi(2) - (driven - 100.0).powi(2)) / 1800.0;
        let p = 1.0 / (1.0 + (-odds).exp());
        assert!((smoothed.posteriors().get(2).unwrap().as_slice()[1] - p).abs() < 1e-14);
    }
}

#[test]
fn bad_lengths_and_odometry_are_named() {
    let new = |length: f64| {
        text(DistanceTransition::new(still(2), |to, _| if to == 1 { length } else { 0.0 }))
    };
    let length = |value: &str| {
        format!(
            "the length of the transition from state 1 to state 1 is {value}, expected a finite value of at least 0"
        )
    };
    assert_eq!(new(f64::NAN), length("NaN"));
    assert_eq!(new(-1.0), length("-1"));
    assert_eq!(new(f64::INFINITY), length("inf"));

    let a = fork(&[100.0]);
    let control =
        |distance, variance| text(a.check_control(&Some(OdometryReading { distance, variance })));
    let distance =
        |value: &str| format!("an odometry distance of {value}, expected a finite value");
    assert_eq!(control(f64::NAN, 1.0), distance("NaN"));
    assert_eq!(control(f64::NEG_INFINITY, 1.0), distance("-inf"));
    let variance =
        |value: &str| format!("an odometry variance of {value}, expected a finite value above 0");
    assert_eq!(control(1.0, f64::NAN), variance("NaN"));
    assert_eq!(control(1.0, -0.5), variance("-0.5"));
    assert_eq!(control(1.0, 0.0), variance("0"));
    assert_eq!(control(1.0, f64::INFINITY), variance("inf"));
    assert!(a.check_control(&None).is_ok());

    let map = wayfix::canberra::map();
    assert_eq!(
        text(DistanceTransition::on_map(&map, still(2))),
        "the map has 105 states, expected 2 to match the inner operator"
    );
    let jump = (0..105).map(|i| (if i == 7 { 90 } else { i }, i, 1.0));
    let jump = SparseTransition::from_triplets(105, jump).unwrap();
    assert_eq!(
        text(DistanceTransition::on_map(&map, jump)),
        "the number of roads from state 7 to state 90 is 0, expected 1, since there is such a transition"
    );
}

#[test]
fn on_a_map_lengths_are_those_of_roads() {
    let map = wayfix::canberra::map();
    let turning = wayfix::canberra::turning().into_transition();
    let a = DistanceTransition::on_map(&map, turning).unwrap();
    for from in 0..map.places().len() {
        assert_eq!(a.length(from, from), Some(0.0));
        for (to, road) in map.roads_from(from) {
            assert_eq!(a.length(to, from), Some(road.metres));
        }
    }
    assert_eq!((a.length(0, 105), a.length(105, 0)), (None, None));
}
