//! Road maps, with the metres driven as control.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::{
    Belief, Controlled, DistanceTransition, DwellTransition, Hmm, KroneckerTransition,
    LikelihoodVector, Odometry, OffMapTransition, PowerTransition, Prior, RestartTransition,
    SparseTransition, Transition, TransitionEntries,
};

use crate::kit::{
    Expected, Matrix, NEVER, assert_operator, cases_of, close, dwell, kronecker, log_sum, off_map,
    power, rate, restart, sparse, still, stochastic, text, transposed,
};

/// By the formula, with the least of the exponents taken out of all.
fn by_distance(m: &Matrix, lengths: &Matrix, odometry: Option<Odometry>) -> Matrix {
    let Some(Odometry { distance, variance }) = odometry else { return m.clone() };
    let n = m.len();
    let column = |j: usize| -> Vec<f64> {
        let squares = (0..n).map(|i| {
            if m[i][j] > 0.0 { (distance - lengths[i][j]).powi(2) } else { f64::INFINITY }
        });
        let squares: Vec<f64> = squares.collect();
        let least = squares.iter().copied().fold(f64::INFINITY, f64::min);
        let log = |i: usize| match squares[i] - least {
            0.0 => m[i][j].ln(),
            more => m[i][j].ln() - more / (2.0 * variance),
        };
        let sum = log_sum((0..n).map(log));
        let top = (0..n).map(log).fold(NEVER, f64::max);
        let p = (0..n).map(|i| (log(i) - top).exp() / (sum - top).exp());
        p.map(|p| if p < f64::MIN_POSITIVE { 0.0 } else { p }).collect()
    };
    let columns: Vec<Vec<f64>> = (0..n).map(column).collect();
    transposed(&columns)
}

/// A base, the length of each move, and what three steps have driven. Lengths
/// are whole quarters and variances powers of two, 2^least or more, so that
/// squares are exact. If it is `exact`, all ways out of a place are alike, and variances are 0.
fn road_network(
    exact: bool,
    most: usize,
    least: i32,
) -> impl Strategy<Value = (Matrix, Matrix, Vec<Option<Odometry>>)> {
    let quarters = |n: i32| (0..n).prop_map(|quarters| 0.25 * f64::from(quarters));
    let variance = move || {
        let spread = (least..14_i32).prop_map(|power| 2.0_f64.powi(power));
        if exact { Just(0.0).boxed() } else { prop_oneof![1 => Just(0.0), 5 => spread].boxed() }
    };
    let odometry = move || {
        (quarters(1000), variance())
            .prop_map(|(distance, variance)| Odometry { distance: distance - 25.0, variance })
    };
    let alike = |mut m: Matrix| {
        for j in 0..m.len() {
            let ways = m.iter().filter(|row| row[j] > 0.0).count();
            m.iter_mut()
                .for_each(|row| row[j] = if row[j] > 0.0 { 1.0 / ways as f64 } else { 0.0 });
        }
        m
    };
    (1..=most).prop_flat_map(move |n| {
        let base = stochastic(false, n).prop_map(move |m| if exact { alike(m) } else { m });
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
    fn by_distance_is_its_matrix(
        (exact, (m, lengths, controls)) in
            any::<bool>().prop_flat_map(|e| (Just(e), road_network(e, 7, -6))),
    ) {
        let a = on_roads(&m, &lengths);
        for (i, j) in (0..49).map(|at| (at / 7, at % 7)) {
            let there = i < m.len() && j < m.len() && m[i][j] > 0.0;
            prop_assert_eq!(a.length(i, j), there.then(|| lengths[i][j]));
        }
        let expected: Vec<Matrix> = controls.iter().map(|u| by_distance(&m, &lengths, *u)).collect();
        assert_operator(a, Expected::each(&controls, &expected).with_exact_ties(exact))?;
    }

    /// Lengths so alike on either side of the distance that rounding decides.
    #[test]
    fn lengths_that_differ_by_a_bit_give_distributions(
        (distance, off) in (0.0..1000.0, prop_oneof![0.0..1e-9, 0.0..500.0]),
        sides in vec((any::<bool>(), -3..4_i64), 1..8),
        variance in prop_oneof![Just(0.0), Just(5e-324), Just(1e-30), Just(1e-12)],
    ) {
        let nudged = |x: f64, bits: i64| f64::from_bits(x.to_bits().saturating_add_signed(bits));
        let length = |(up, bits): &(bool, i64)| {
            nudged(if *up { distance + off } else { f64::abs(distance - off) }, *bits)
        };
        let lengths: Vec<f64> = sides.iter().map(length).collect();
        let found = ways(&fork(&lengths), distance, variance);
        close(found.iter().map(|way| way.1).sum(), 1.0, 1e-14, 1.0)?;
        // Whatever is there without variance is the nearest, but for a bit.
        let far = |length: &f64| (length - distance).abs();
        let least = lengths.iter().map(far).fold(f64::INFINITY, f64::min);
        for (to, _) in found.iter().filter(|_| variance == 0.0) {
            prop_assert!(far(&lengths[to - 1]) <= least + 1e-15 * (distance + off), "{:?}", found);
        }
    }

    /// Its listed entries are those that its products have, to the bit.
    #[test]
    fn listed_entries_are_those_of_products((m, lengths, controls) in road_network(false, 6, -6)) {
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
        (m, lengths, controls) in road_network(false, 3, 9),
        (one, other) in (rate(false), rate(false)),
    ) {
        let n = m.len();
        let a = || on_roads(&m, &lengths);
        let uniform = Belief::uniform(n).unwrap();
        let even = vec![1.0 / n as f64; n];
        let driven: Vec<Matrix> = controls.iter().map(|u| by_distance(&m, &lengths, *u)).collect();
        let over = |map: &dyn Fn(&Matrix) -> Matrix| driven.iter().map(map).collect::<Vec<_>>();

        let lost = || OffMapTransition::new(a(), one, other, uniform.clone()).unwrap();
        let off = |m: &Matrix| off_map(m, one, other, &even);
        assert_operator(lost(), Expected::each(&controls, &over(&off)))?;
        let towed = RestartTransition::new(a(), one, uniform.clone()).unwrap();
        assert_operator(towed, Expected::each(&controls, &over(&|m| restart(m, one, &even))))?;
        let pairs = KroneckerTransition::new(a(), lost()).unwrap();
        assert_operator(pairs, Expected::each(&controls, &over(&|m| kronecker(m, &off(m)))))?;
        let twice = PowerTransition::new(a(), 2);
        assert_operator(twice, Expected::each(&controls, &over(&|m| power(m, 2))))?;
        let slow = DwellTransition::from_leaving(a(), &vec![[other, 1.0]; n]).unwrap();
        assert_operator(slow, Expected::each(&controls, &over(&|m| dwell(m, &vec![vec![other, 1.0]; m.len()]))))?;
    }
}

/// Ways from state 0 of these lengths, to states 1, 2, …, all alike.
pub(crate) fn fork(lengths: &[f64]) -> DistanceTransition {
    let (n, p) = (lengths.len() + 1, 1.0 / lengths.len() as f64);
    let ways = (1..n).flat_map(|i| [(i, 0, p), (i, i, 1.0)]);
    let base = SparseTransition::from_triplets(n, ways).unwrap();
    DistanceTransition::new(base, |to, from| if from == 0 { lengths[to - 1] } else { 0.0 }).unwrap()
}

pub(crate) fn ways(a: &DistanceTransition, distance: f64, variance: f64) -> Vec<(usize, f64)> {
    let control = Some(Odometry { distance, variance });
    a.check_control(&control).unwrap();
    a.outgoing(&control, 0).collect()
}

#[test]
fn the_nearest_length_takes_all_without_variance() {
    let a = fork(&[0.0, 100.0, 100.0, 250.0]);
    assert_eq!(ways(&a, 0.0, 0.0), [(1, 1.0)]);
    assert_eq!(ways(&a, -1e300, 0.0), [(1, 1.0)]);
    assert_eq!(ways(&a, 49.9, 0.0), [(1, 1.0)]);
    assert_eq!(ways(&a, 50.0, 0.0), [(1, 1.0 / 3.0), (2, 1.0 / 3.0), (3, 1.0 / 3.0)]);
    assert_eq!(ways(&a, 50.1, 0.0), [(2, 0.5), (3, 0.5)]);
    assert_eq!(ways(&a, 175.0, 0.0), [(2, 1.0 / 3.0), (3, 1.0 / 3.0), (4, 1.0 / 3.0)]);
    assert_eq!(ways(&a, 1e300, 0.0), [(4, 1.0)]);
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
fn numbers_at_the_limits_give_distributions() {
    let extremes = [0.0, 5e-324, 1e-308, 1e-160, 1.0, 1e160, 1e300, f64::MAX];
    let a = fork(&extremes);
    let n = a.states();
    let (mut out, mut from) = (vec![0.0; n], vec![0; n]);
    for distance in extremes.iter().flat_map(|d| [*d, -d]) {
        for variance in extremes {
            let control = Some(Odometry { distance, variance });
            a.check_control(&control).unwrap();
            a.apply_transpose(&control, &vec![1.0; n], &mut out);
            assert!(out.iter().all(|sum| (sum - 1.0).abs() < 1e-14), "{control:?}: {out:?}");
            a.apply(&control, &vec![1.0; n], &mut out);
            assert!((out.iter().sum::<f64>() - n as f64).abs() < 1e-13, "{control:?}: {out:?}");
            a.max_product(&control, &vec![0.0; n], &mut out, &mut from);
            assert!(out.iter().all(|best| *best <= 0.0), "{control:?}: {out:?}");
        }
    }
}

/// A camera that sees nothing, and two ways to the same end.
#[test]
fn odometry_tells_ways_apart() {
    // From 0 by 1 (100 m, 300 m) or by 2 (300 m, 100 m) to 3, and on to itself.
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
    let metres = |distance| Some(Odometry { distance, variance: 900.0 });
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
        |distance, variance| text(a.check_control(&Some(Odometry { distance, variance })));
    let distance = |value: &str| {
        format!("unknown control: an odometry distance of {value}, expected a finite value")
    };
    assert_eq!(control(f64::NAN, 1.0), distance("NaN"));
    assert_eq!(control(f64::NEG_INFINITY, 1.0), distance("-inf"));
    let variance = |value: &str| {
        format!(
            "unknown control: an odometry variance of {value}, expected a finite value of at least 0"
        )
    };
    assert_eq!(control(1.0, f64::NAN), variance("NaN"));
    assert_eq!(control(1.0, -0.5), variance("-0.5"));
    assert_eq!(control(1.0, f64::INFINITY), variance("inf"));
    assert!(a.check_control(&None).is_ok());

    let map = wayfix::canberra::map();
    assert_eq!(
        text(DistanceTransition::on_map(&map, still(2))),
        "the map has 105 states, expected 2 as the operator within"
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
