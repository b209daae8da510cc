//! The route with gears against the dense matrices that its formula defines.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::{
    Belief, Gear, Hmm, LikelihoodVector, Odometry, Prior, RouteControl, RouteTransition,
    Transition, TransitionEntries, TransitionError, View, ViewRates,
};

use crate::kit::{Expected, Matrix, assert_operator, cases_of, transposed, weighted};

/// What a route is made from.
#[derive(Debug, Clone)]
struct Parts {
    places: usize,
    closed: bool,
    /// First move and weights.
    gears: Vec<(isize, Vec<f64>)>,
    /// `switching[to][from]`.
    switching: Matrix,
    views: Option<(Vec<usize>, [f64; 3])>,
}

impl Parts {
    fn route(&self) -> RouteTransition {
        let gears = self.gears.iter().map(|(first, w)| Gear::new(*first, w).unwrap()).collect();
        let route = RouteTransition::new(self.places, self.closed, gears, 0.5).unwrap();
        let rows = self.switching.concat();
        match &self.views {
            None => route.with_switching(&rows).unwrap(),
            Some((stretches, [standing, alike, moved])) => {
                let rates = ViewRates { standing: *standing, alike: *alike, moved: *moved };
                let before = route.clone().with_views(stretches, rates).unwrap();
                let after = route.with_switching(&rows).unwrap();
                let after = after.with_views(stretches, rates).unwrap();
                let before = before.with_switching(&rows).unwrap();
                assert_eq!(format!("{before:?}"), format!("{after:?}"));
                after
            }
        }
    }

    /// The matrix of a step, by the formula, column after column.
    fn matrix(&self, control: &RouteControl) -> Matrix {
        let (n, k) = (self.places, self.gears.len());
        let mut a = vec![vec![0.0; n * k]; n * k];
        for g in 0..k {
            // All moves from this gear: new gear, move, G w.
            let mut moves = Vec::new();
            for (new, (first, weights)) in self.gears.iter().enumerate() {
                for (m, w) in (*first..).zip(weights) {
                    if *w > 0.0 && self.switching[new][g] > 0.0 {
                        moves.push((new, m, self.switching[new][g] * w));
                    }
                }
            }
            if let Some(odometry) = control.odometry {
                let o = |m: isize| passed(m as f64 - odometry.distance, odometry.variance.sqrt());
                if moves.iter().all(|(_, m, p)| p * o(*m) < 1e-250) {
                    let far = |m: isize| (m as f64 - odometry.distance).abs();
                    let least = moves.iter().map(|m| far(m.1)).fold(f64::INFINITY, f64::min);
                    moves.retain(|m| far(m.1) == least);
                } else {
                    moves.iter_mut().for_each(|(_, m, p)| *p *= o(*m));
                }
            }
            for i in 0..n {
                let mut column = vec![0.0; n * k];
                for (new, m, p) in &moves {
                    let (to, count) = (i.cast_signed() + m, n.cast_signed());
                    let stops = to.clamp(0, count - 1);
                    let j = if self.closed { to.rem_euclid(count) } else { stops }.cast_unsigned();
                    column[new * n + j] += p * self.seen(control, i, j);
                }
                let sum: f64 = column.iter().sum();
                column.iter().enumerate().for_each(|(to, p)| a[to][g * n + i] = p / sum);
            }
        }
        a
    }

    /// Whether a move has a probability by odometry that doubles hold badly.
    fn tiny(&self, control: &RouteControl) -> bool {
        control.odometry.is_some_and(|odometry| {
            self.gears.iter().any(|(first, weights)| {
                (*first..*first + weights.len().cast_signed()).any(|m| {
                    let o = passed(m as f64 - odometry.distance, odometry.variance.sqrt());
                    o > 0.0 && o < 1e-290
                })
            })
        })
    }

    fn seen(&self, control: &RouteControl, i: usize, j: usize) -> f64 {
        let (Some(view), Some((stretches, rates))) = (control.view, &self.views) else {
            return 1.0;
        };
        let unchanged = match (i == j, stretches[i] == stretches[j]) {
            (true, _) => rates[0],
            (_, true) => rates[1],
            _ => rates[2],
        };
        if view == View::Unchanged { unchanged } else { 1.0 - unchanged }
    }
}

/// The triangle around `a`, blurred, by Gauss–Legendre quadrature on pieces no
/// wider than the blur.
fn passed(a: f64, s: f64) -> f64 {
    const NODES: [(f64, f64); 4] = [
        (0.183_434_642_495_649_8, 0.362_683_783_378_362),
        (0.525_532_409_916_329, 0.313_706_645_877_887_3),
        (0.796_666_477_413_626_7, 0.222_381_034_453_374_5),
        (0.960_289_856_497_536_3, 0.101_228_536_290_376_3),
    ];
    if s == 0.0 {
        return (1.0 - a.abs()).max(0.0);
    }
    let density = |x: f64| (-0.5 * x * x).exp() / (2.0 * std::f64::consts::PI).sqrt();
    let pieces = (16..=100_000_u32).find(|count| f64::from(*count) * s >= 8.0).unwrap();
    let width = 1.0 / f64::from(pieces);
    let mut sum = 0.0;
    for piece in 0..pieces {
        for (node, weight) in NODES {
            for node in [-node, node] {
                let t = (f64::from(piece) + 0.5 * (1.0 + node)) * width;
                let both = density((a - t) / s) + density((a + t) / s);
                sum += 0.5 * width * weight * (1.0 - t) * both / s;
            }
        }
    }
    sum
}

/// Distributions with equal weights and zeros among them.
fn shares(count: usize) -> impl Strategy<Value = Vec<f64>> {
    weighted(prop_oneof![2 => Just(0.0), 3 => 0.01..1.0, 2 => Just(0.25)], count)
}

fn parts() -> impl Strategy<Value = Parts> {
    (1..=12_usize, 1..=4_usize, any::<bool>()).prop_flat_map(|(places, k, closed)| {
        let most = if closed { places.min(5) } else { 5 };
        let gear = (-5..=4_isize, (1..=most).prop_flat_map(shares));
        let switching = vec(shares(k), k).prop_map(|columns| transposed(&columns));
        let rate = || prop_oneof![4 => 0.01..0.99, 1 => Just(0.5), 1 => Just(1e-30)];
        let stretches = prop_oneof![
            vec(0..3_usize, places),
            vec(any::<bool>(), places).prop_map(|ends| {
                let mut id = 7;
                ends.iter()
                    .map(|end| {
                        id += usize::from(*end);
                        id
                    })
                    .collect()
            }),
        ];
        let views = proptest::option::weighted(0.7, (stretches, [rate(), rate(), rate()]));
        (vec(gear, k), switching, views).prop_map(move |(gears, switching, views)| Parts {
            places,
            closed,
            gears,
            switching,
            views,
        })
    })
}

fn control() -> impl Strategy<Value = RouteControl> {
    let distance = prop_oneof![4 => -6.0..6.0, 2 => (-3..4_i32).prop_map(|d| f64::from(d) / 2.0), 1 => -60.0..60.0, 1 => Just(1e9)];
    let variance = prop_oneof![2 => Just(0.0), 3 => 0.01..4.0, 1 => 10.0..1000.0, 1 => Just(1e12)];
    let odometry =
        (distance, variance).prop_map(|(distance, variance)| Odometry { distance, variance });
    let view = prop_oneof![Just(View::Changed), Just(View::Unchanged)];
    (proptest::option::weighted(0.7, odometry), proptest::option::weighted(0.7, view))
        .prop_map(|(odometry, view)| RouteControl { odometry, view })
}

fn gear(first: isize, weights: &[f64]) -> Gear {
    Gear::new(first, weights).unwrap()
}

/// Standing, and going on by one, on three places.
fn stop_and_go(closed: bool) -> RouteTransition {
    RouteTransition::new(3, closed, vec![gear(0, &[1.0]), gear(1, &[1.0])], 0.75).unwrap()
}

fn driven(distance: f64, variance: f64) -> RouteControl {
    RouteControl { odometry: Some(Odometry { distance, variance }), view: None }
}

fn column(route: &RouteTransition, u: &RouteControl, from: usize) -> Vec<(usize, f64)> {
    route.outgoing(u, from).collect()
}

#[test]
fn gears_are_what_they_say() {
    let is = |gear: Gear, first: isize, weights: &[f64]| {
        assert_eq!((gear.first(), gear.weights()), (first, weights));
    };
    is(gear(-3, &[0.0, 0.0, 0.25, 0.0, 0.75, 0.0]), -1, &[0.25, 0.0, 0.75]);
    is(Gear::speed(0.0, 0.0).unwrap(), 0, &[1.0]);
    is(Gear::speed(2.0, 0.125).unwrap(), 1, &[0.125, 0.75, 0.125]);
    is(Gear::speed(-1.25, 0.0).unwrap(), -2, &[0.25, 0.75]);
    is(Gear::speed(-1.25, 0.125).unwrap(), -3, &[0.125, 0.1875, 0.5625, 0.125]);
    is(Gear::uniform(-1..=2).unwrap(), -1, &[0.25; 4]);
    is(Gear::uniform(7..=7).unwrap(), 7, &[1.0]);
    is(gear(1 << 30, &[1.0]), 1 << 30, &[1.0]);
}

#[test]
fn what_is_no_gear_is_an_error() {
    let refused = |gear: Result<Gear, TransitionError>, expected: &str| {
        assert_eq!(gear.err().map(|error| error.to_string()).as_deref(), Some(expected));
    };
    refused(Gear::new(0, &[]), "the sum of the weights of a gear is 0, expected 1");
    refused(Gear::new(0, &[0.5, 0.4]), "the sum of the weights of a gear is 0.9, expected 1");
    refused(
        Gear::new(-1, &[0.5, f64::NAN]),
        "the weight of move 0 is NaN, expected a finite value of at least 0",
    );
    // It might be the only one that odometry leaves.
    for (weights, at) in [([1e-310, 1.0], 0), ([1.0, 5e-324], 1)] {
        let expected = format!(
            "the weight of move {at} is {}, expected 0, or at least 2.2250738585072014e-308",
            weights[at]
        );
        refused(Gear::new(0, &weights), &expected);
    }
    assert!(Gear::new(0, &[f64::MIN_POSITIVE, 1.0]).is_ok());
    for (first, weights) in
        [(isize::MIN, &[1.0][..]), (isize::MAX, &[0.0, 1.0]), (-1 << 31, &[1.0])]
    {
        let error = Gear::new(first, weights).unwrap_err().to_string();
        assert!(error.starts_with("a move of a gear is "), "{error}");
        assert!(error.ends_with(", expected a move within 1073741824 places"), "{error}");
    }
    for speed in [f64::NAN, f64::INFINITY, -1e300, 1_073_741_823.0] {
        let expected = format!(
            "the speed of a gear is {speed}, expected a value within 1073741823 places a step"
        );
        refused(Gear::speed(speed, 0.1), &expected);
    }
    for slack in [0.5, -0.1, f64::NAN] {
        let expected =
            format!("the slack of a gear is {slack}, expected a value of at least 0 and below 0.5");
        refused(Gear::speed(1.0, slack), &expected);
    }
    #[expect(clippy::reversed_empty_ranges, reason = "that is the error")]
    refused(Gear::uniform(1..=0), "the number of moves of a gear is 0, expected at least 1");
    refused(
        Gear::uniform(isize::MIN..=isize::MAX),
        "18446744073709551615 moves, expected at most 4294967295 (32-bit indices)",
    );
}

#[test]
fn what_is_no_route_is_an_error() {
    let refused = |route: Result<RouteTransition, TransitionError>, expected: &str| {
        assert_eq!(route.err().map(|error| error.to_string()).as_deref(), Some(expected));
    };
    let stand = || vec![gear(0, &[1.0])];
    let none = "a transition operator needs at least one state, found none";
    refused(RouteTransition::new(0, false, stand(), 1.0), none);
    refused(RouteTransition::new(3, false, Vec::new(), 1.0), none);
    refused(
        RouteTransition::new(1 << 31, false, [stand(), stand()].concat(), 1.0),
        "4294967296 states, expected at most 4294967295 (32-bit indices)",
    );
    refused(
        RouteTransition::new(3, false, stand(), 1.5),
        "the probability of keeping the gear is 1.5, expected a value from 0 to 1",
    );
    refused(
        RouteTransition::new(2, true, vec![stand()[0].clone(), gear(0, &[0.5, 0.25, 0.25])], 0.5),
        "the number of weights of gear 1 is 3, expected at most the number of places of a closed route",
    );
    let route = stop_and_go(true);
    refused(
        route.clone().with_switching(&[1.0]),
        "the number of switching probabilities is 1, expected the number of gears squared",
    );
    refused(
        route.clone().with_switching(&[1.0, 0.5, 0.0, 0.25]),
        "the sum of the ways out of gear 1 is 0.75, expected 1",
    );
    refused(
        route.clone().with_switching(&[2.0, 0.5, -1.0, 0.5]),
        "the probability of a change from gear 0 to gear 1 is -1, expected a finite value of at least 0",
    );
    let rates = ViewRates { standing: 0.9, alike: 0.5, moved: 0.1 };
    refused(
        route.clone().with_views(&[0, 0], rates),
        "the number of stretches is 2, expected one for each place",
    );
    for (rates, expected) in [
        (ViewRates { standing: 1.0, ..rates }, "standing is 1"),
        (ViewRates { alike: f64::NAN, ..rates }, "in a stretch is NaN"),
        (ViewRates { moved: 0.0, ..rates }, "elsewhere is 0"),
    ] {
        let expected = format!(
            "the probability of an unchanged view {expected}, expected a value of at least 1e-30 and below 1"
        );
        refused(route.clone().with_views(&[0, 0, 1], rates), &expected);
    }
}

#[test]
fn what_is_no_odometry_is_an_error_and_the_filter_stays() {
    let route = stop_and_go(false);
    for (u, expected) in [
        (driven(f64::NAN, 1.0), "an odometry distance of NaN, expected a finite value"),
        (driven(f64::INFINITY, 1.0), "an odometry distance of inf, expected a finite value"),
        (driven(1.0, -1.0), "an odometry variance of -1, expected a finite value of at least 0"),
        (
            driven(1.0, f64::NAN),
            "an odometry variance of NaN, expected a finite value of at least 0",
        ),
        (
            driven(1.0, f64::INFINITY),
            "an odometry variance of inf, expected a finite value of at least 0",
        ),
    ] {
        let error = route.check_control(&u).unwrap_err().to_string();
        assert_eq!(error, format!("unknown control: {expected}"));
        let prior = Prior::BeforeFirstTransition(Belief::uniform(6).unwrap());
        let hmm = Hmm::new(prior, &route, LikelihoodVector::linear(6)).unwrap();
        let mut filter = hmm.filter();
        let before = filter.snapshot();
        assert!(filter.predict_with(&u).is_err());
        assert_eq!(filter.snapshot(), before);
    }
}

#[test]
fn states_are_gears_and_places() {
    let route = stop_and_go(false);
    assert_eq!((route.places(), route.gears(), route.states()), (3, 2, 6));
    for state in 0..6 {
        let (gear, place) = route.parts(state).unwrap();
        assert_eq!((gear, place), (state / 3, state % 3));
        assert_eq!(route.index(gear, place), Some(state));
    }
    assert_eq!((route.index(2, 0), route.index(0, 3), route.parts(6)), (None, None, None));
    assert_eq!(route.place_groups().as_slice(), [0, 1, 2, 0, 1, 2]);
    assert_eq!(route.gear_groups().as_slice(), [0, 0, 0, 1, 1, 1]);
}

#[test]
fn gears_are_kept_or_shared_and_the_new_one_moves() {
    let nothing = RouteControl::default();
    assert_eq!(column(&stop_and_go(false), &nothing, 0), [(0, 0.75), (4, 0.25)]);
    assert_eq!(column(&stop_and_go(false), &nothing, 5), [(2, 0.25), (5, 0.75)]);
    assert_eq!(column(&stop_and_go(true), &nothing, 5), [(2, 0.25), (3, 0.75)]);
    let three = vec![gear(0, &[1.0]), gear(1, &[1.0]), gear(-1, &[1.0])];
    let route = RouteTransition::new(4, true, three, 0.5).unwrap();
    assert_eq!(column(&route, &nothing, 4), [(0, 0.25), (5, 0.5), (11, 0.25)]);
    let one = RouteTransition::new(2, true, vec![gear(1, &[1.0])], 0.0).unwrap();
    assert_eq!(column(&one, &nothing, 0), [(1, 1.0)]);
    // A view means nothing to a route without views.
    let seen = RouteControl { view: Some(View::Changed), ..nothing };
    assert_eq!(column(&one, &seen, 0), [(1, 1.0)]);
}

#[test]
fn odometry_that_no_gear_agrees_with_leaves_the_moves_nearest_to_it() {
    let gears = vec![gear(-1, &[0.25, 0.5, 0.25]), gear(2, &[1.0])];
    let route = RouteTransition::new(9, false, gears, 0.5).unwrap();
    assert_eq!(column(&route, &driven(1.5, 0.0), 4), [(5, 1.0 / 5.0), (15, 4.0 / 5.0)]);
    for (distance, to) in [(3.5, 15), (1e300, 15), (-2.5, 3), (-1e300, 3)] {
        assert_eq!(column(&route, &driven(distance, 0.0), 4), [(to, 1.0)], "{distance}");
        assert_eq!(column(&route, &driven(distance, 1e-3), 13), [(to, 1.0)], "{distance}");
    }
    // Of gears that never change, each by itself; two moves may be as near.
    let gears = vec![gear(-1, &[0.25, 0.5, 0.25]), gear(3, &[0.75, 0.0, 0.25])];
    let route = RouteTransition::new(9, false, gears, 1.0).unwrap();
    let u = driven(4.0, 0.0);
    assert_eq!(column(&route, &u, 1), [(2, 1.0)]);
    assert_eq!(column(&route, &u, 10), [(13, 0.75), (15, 0.25)]);
}

#[test]
fn views_tell_standing_from_moving() {
    let rates = ViewRates { standing: 0.75, alike: 0.5, moved: 0.25 };
    let route = stop_and_go(false).with_views(&[4, 4, 7], rates).unwrap();
    let unchanged = RouteControl { view: Some(View::Unchanged), ..RouteControl::default() };
    let changed = RouteControl { view: Some(View::Changed), ..RouteControl::default() };
    let close = |u: &RouteControl, from: usize, expected: [(usize, f64); 2]| {
        for (found, expected) in column(&route, u, from).into_iter().zip(expected) {
            assert!(found.0 == expected.0 && (found.1 - expected.1).abs() < 1e-15, "{found:?}");
        }
    };
    close(&unchanged, 0, [(0, 9.0 / 11.0), (4, 2.0 / 11.0)]);
    close(&unchanged, 1, [(1, 9.0 / 10.0), (5, 1.0 / 10.0)]);
    close(&changed, 1, [(1, 3.0 / 6.0), (5, 3.0 / 6.0)]);
    close(&unchanged, 2, [(2, 3.0 / 4.0), (5, 1.0 / 4.0)]); // it can't go on
}

#[test]
fn moves_far_longer_than_a_route_are_none_the_worse() {
    for (closed, first) in [(false, 1 << 30), (false, -1 << 30), (true, 1 << 30), (true, -1 << 30)]
    {
        let route = RouteTransition::new(3, closed, vec![gear(first, &[1.0])], 1.0).unwrap();
        let end = if first > 0 { 2 } else { 0 };
        for from in 0..3_usize {
            let to = (from.cast_signed() + first).rem_euclid(3).cast_unsigned();
            let to = if closed { to } else { end };
            for u in [RouteControl::default(), driven(0.0, 1.0)] {
                assert_eq!(column(&route, &u, from), [(to, 1.0)]);
                let mut out = [0.0; 3];
                route.apply(&u, &[1.0, 2.0, 4.0], &mut out);
                assert_eq!(out.iter().sum::<f64>(), 7.0);
            }
        }
    }
}

proptest! {
    #![proptest_config(cases_of(1000))]

    #[test]
    fn a_route_is_the_matrix_of_its_formula(parts in parts(), controls in vec(control(), 1..5)) {
        prop_assume!(!controls.iter().any(|u| parts.tiny(u)));
        let matrices: Vec<Matrix> = controls.iter().map(|u| parts.matrix(u)).collect();
        // Odometry and views make entries as small as 1e-290.
        assert_operator(parts.route(), Expected::each(&controls, &matrices).within(1e-11, 1e-30))?;
    }
}
