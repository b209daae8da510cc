//! Rows of distances to likelihoods, one step at a time.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::Likelihood;
use wayfix::observation::{AppearanceLikelihood, Offsets, Spread};

use super::definition::*;

use crate::kit::{cases, text};

/// A plan for n references, a row, and a prior for all states.
fn instances() -> impl Strategy<Value = (Plan, Vec<f32>, Vec<f64>)> {
    (1..=12_usize).prop_flat_map(|n| {
        let temperature = prop_oneof![
            Just(1.0),
            (-1.5..3.0).prop_map(|e| 10_f64.powf(e)),
            (-6.0..6.0).prop_map(|e| 10_f64.powf(e))
        ];
        // Ranks that are those of a match, and any.
        let rank =
            prop_oneof![(0..n).prop_map(move |k| k as f64 / (n - 1).max(1) as f64), 0.0..=1.0,];
        let count = prop_oneof![Just(0.0), 0.1..9.0];
        let seen =
            prop_oneof![2 => Just(None), 1 => (vec(row(n), 0..5), count, offsets()).prop_map(Some)];
        let plan = (spread(), temperature, prop_oneof![Just(None), rank.prop_map(Some)], seen);
        let plan = plan.prop_map(|(spread, temperature, off_map, seen)| Plan {
            spread,
            temperature,
            off_map,
            seen,
        });
        let weight = prop_oneof![1 => Just(0.0), 4 => 0.1..1.0, 1 => Just(1e-200)];
        let prior = prop_oneof![Just(vec![1.0; n + 1]), vec(weight, n + 1)];
        let off = |plan: &Plan| plan.off_map.is_some();
        let far = prop::bool::weighted(0.05);
        (plan, row(n), prior, far).prop_map(move |(plan, row, mut prior, far)| {
            let row = if far && off(&plan) { vec![INF; n] } else { row };
            prior.truncate(n + usize::from(off(&plan)));
            if prior.iter().all(|p| *p == 0.0) {
                prior[0] = 1.0;
            }
            (plan, row, prior)
        })
    })
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn one_step_is_that_of_the_kernel((plan, row, prior) in instances()) {
        let sensor = plan.sensor(row.len());
        prop_assert_eq!(sensor.states(), prior.len());
        let found = step(&prior, &sensor, &row);
        // Between two ranks, either.
        let either = [f64::floor, f64::ceil].map(|round| agrees(&found, &prior, &plan.logs(&row, round)));
        prop_assert!(either.iter().any(Result::is_ok), "{:?}", either);
        // Ranks that are those of a match are met.
        if let Some(rank) = plan.off_map {
            let at = rank * (row.len() - 1) as f64;
            if (at - at.round()).abs() < 1e-9 {
                prop_assert_eq!(agrees(&found, &prior, &plan.logs(&row, f64::round)), Ok(()));
            }
        }
    }

    #[test]
    fn memory_of_other_rows_does_not_matter((plan, row, prior) in instances(), reversed in any::<bool>()) {
        let hmm = stays(&prior, plan.sensor(row.len()));
        let mut filter = hmm.filter();
        let fresh = filter.step(&row).map(f64::to_bits).map_err(|e| e.to_string());
        let belief = filter.belief().to_owned();
        let mut other: Vec<f32> = row.iter().map(|d| 1.5 - d / 2.0).map(|d| if d.is_finite() { d } else { 3.0 }).collect();
        if reversed {
            other.reverse();
        }
        filter.restart();
        let _ = filter.step(&other);
        filter.restart();
        prop_assert_eq!(filter.step(&row).map(f64::to_bits).map_err(|e| e.to_string()), fresh);
        prop_assert_eq!(filter.belief().to_owned(), belief);
    }
}

#[test]
fn rows_that_are_not_valid_are_errors_and_leave_the_filter() {
    for off_map in [None, Some(0.2)] {
        for spread in [
            Spread::Query,
            Spread::Local { radius: 1, closed: false },
            Spread::Local { radius: 9, closed: true },
            Spread::Fixed(2.0),
        ] {
            let plan = Plan { off_map, ..Plan::new(spread) };
            let sensor = plan.sensor(3);
            let hmm = stays(&vec![1.0; sensor.states()], sensor);
            let mut filter = hmm.filter();
            let mut says = |row: &[f32]| {
                let before = filter.snapshot();
                let says = text(filter.step(&row.to_vec()));
                assert_eq!(filter.snapshot(), before);
                says
            };
            let failed = "step 1 has no valid likelihood: the sensor failed: ";
            assert_eq!(
                says(&[0.1, 0.2]),
                format!("{failed}2 distances, expected one for each of 3 references")
            );
            assert_eq!(
                says(&[0.0; 4]),
                format!("{failed}4 distances, expected one for each of 3 references")
            );
            assert_eq!(
                says(&[]),
                format!("{failed}0 distances, expected one for each of 3 references")
            );
            assert_eq!(
                says(&[0.1, f32::NAN, f32::NAN]),
                format!(
                    "{failed}the distance to reference 1 is NaN, expected a number or infinity"
                )
            );
            assert_eq!(
                says(&[INF, 0.1, -INF]),
                format!(
                    "{failed}the distance to reference 2 is -inf, expected a number or infinity"
                )
            );
            let all = filter.step(&vec![INF; 3]);
            if off_map.is_some() {
                assert!(all.unwrap().is_finite());
                assert_eq!(filter.belief().as_slice(), [0.0, 0.0, 0.0, 1.0]);
            } else {
                assert_eq!(
                    text(all),
                    format!(
                        "{failed}the query is infinitely far from all references, and there is no state off the map"
                    )
                );
            }
        }
    }
}

#[test]
fn the_parts_of_a_sensor_say_what_is_wrong() {
    let sensor = || AppearanceLikelihood::new(3).unwrap();
    let spread = |spread| text(sensor().with_spread(spread));
    assert_eq!(
        text(AppearanceLikelihood::new(0)),
        "the number of references is 0, expected at least 1"
    );
    assert_eq!(
        text(AppearanceLikelihood::new(usize::MAX)),
        "the number of references is 18446744073709552000, expected at most 4294967294"
    );
    assert_eq!(
        spread(Spread::Local { radius: 0, closed: true }),
        "the radius of the local contrast is 0, expected at least 1"
    );
    for unit in [0.0, -1.0, f64::NAN, f64::INFINITY, 0.9e-100, 1.1e100] {
        let expected = format!("the unit of distance is {unit}, expected from 1e-100 to 1e100");
        assert_eq!(spread(Spread::Fixed(unit)), expected);
    }
    for temperature in [0.9e-6, 1.1e6, f64::NAN, 0.0, -1.0] {
        let expected = format!("the temperature is {temperature}, expected from 1e-6 to 1e6");
        assert_eq!(text(sensor().with_temperature(temperature)), expected);
    }
    for rank in [-0.1, 1.1, f64::NAN] {
        let expected = format!("the rank of the match off the map is {rank}, expected from 0 to 1");
        assert_eq!(text(sensor().with_off_map(rank)), expected);
    }
    for count in [-1.0, f64::NAN, f64::INFINITY] {
        let expected = format!("the prior count is {count}, expected a finite value of at least 0");
        assert_eq!(text(sensor().with_offsets(Offsets::All, &[[0.1_f32; 3]], count)), expected);
    }
    assert_eq!(
        text(sensor().with_offsets(Offsets::All, &[vec![0.1_f32; 3], vec![0.1; 2]], 1.0)),
        "2 distances, expected one for each of 3 references"
    );
    assert_eq!(
        text(sensor().with_offsets(Offsets::All, &[[0.1_f32, 0.2, f32::NAN]], 1.0)),
        "the distance to reference 2 is NaN, expected a number or infinity"
    );
}

#[test]
fn a_sensor_says_what_it_is_made_of() {
    let rows = [[0.1_f32, 0.5, 0.7], [0.2, 0.1, 0.9]];
    let plain = AppearanceLikelihood::new(3).unwrap();
    assert_eq!(
        (
            plain.references(),
            plain.states(),
            plain.off_map_state(),
            plain.spread(),
            plain.temperature()
        ),
        (3, 3, None, Spread::Query, 1.0)
    );
    let sensor =
        plain.clone().with_offsets(Offsets::All, &rows, 1.0).unwrap().with_off_map(0.5).unwrap();
    let sensor = sensor.with_temperature(1e-6).unwrap().with_temperature(1e6).unwrap();
    assert_eq!((sensor.references(), sensor.states(), sensor.off_map_state()), (3, 4, Some(3)));
    assert_eq!(sensor.temperature(), 1e6);
    // Offsets are taken anew, and forgotten with the scale that they are in.
    let again = sensor.clone().with_offsets(Offsets::All, &rows[..1], 1.0).unwrap();
    let once = plain.clone().with_offsets(Offsets::All, &rows[..1], 1.0).unwrap();
    let once = once.with_off_map(0.5).unwrap().with_temperature(1e6).unwrap();
    assert_eq!(again, once);
    let fixed = sensor.with_spread(Spread::Fixed(2.0)).unwrap();
    let plain = plain.with_spread(Spread::Fixed(2.0)).unwrap();
    assert_eq!(fixed, plain.with_off_map(0.5).unwrap().with_temperature(1e6).unwrap());
}

#[test]
fn where_all_distances_are_equal_the_query_says_nothing() {
    for spread in [
        Spread::Query,
        Spread::Local { radius: 1, closed: true },
        Spread::Local { radius: 2, closed: false },
        Spread::Local { radius: usize::MAX, closed: true },
        Spread::Local { radius: usize::MAX, closed: false },
        Spread::Fixed(1e-100),
    ] {
        for d in [0.0, 0.1, -7.7, 1e-45, f32::MAX, f32::MIN] {
            let plan = Plan { off_map: Some(0.3), ..Plan::new(spread) };
            let prior = [0.1, 0.2, 0.3, 0.1, 0.3];
            let (log, p) = step(&prior, plan.sensor(4), &vec![d; 4]).unwrap();
            assert!(log.abs() < 1e-15, "{spread:?} {d} {log}");
            let unchanged = p.iter().zip(&prior).all(|(p, prior)| (p - prior).abs() < 1e-15);
            assert!(unchanged, "{p:?}");
        }
    }
    // One reference is as likely as the mean of all.
    for d in [0.3, -1e38] {
        let sensor = AppearanceLikelihood::new(1).unwrap();
        assert_eq!(step(&[1.0], sensor, &vec![d]).unwrap(), (0.0, vec![1.0]));
    }
}

/// Neighbours that differ little, beside some that differ much.
#[test]
fn a_window_does_not_feel_what_is_outside_it() {
    for (far, close) in [(-5.0, 1e-6), (1e4, 1e-4), (1e30, 1.0), (f32::MAX, 1e-30)] {
        for closed in [false, true] {
            let mut row = vec![far, 0.0, close, 3.0 * close, 0.0, 2.0 * close, 0.0, far];
            for _ in 0..row.len() {
                let plan = Plan::new(Spread::Local { radius: 1, closed });
                let found = step(&[1.0; 8], plan.sensor(8), &row);
                assert_eq!(agrees(&found, &[1.0; 8], &plan.logs(&row, f64::round)), Ok(()));
                row.rotate_left(1);
            }
        }
    }
    // Equal ones have no spread, whatever is beside them.
    let row = vec![1e4, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 7.3];
    let sensor = Plan::new(Spread::Local { radius: 1, closed: false }).sensor(8);
    let (_, p) = step(&[1.0; 8], sensor, &row).unwrap();
    assert!(p[2..=5].iter().all(|other| *other == p[2]), "{p:?}");
}

#[test]
fn scores_beyond_the_range_of_doubles_are_kept_apart() {
    // A unit of distance is 1e4 nats.
    let plan = Plan { temperature: 1e-4, ..Plan::new(Spread::Fixed(1.0)) };
    let (log, p) = step(&[1.0; 3], plan.sensor(3), &vec![0.0, 1.0, 2.0]).unwrap();
    assert!(log.abs() < 1e-9);
    assert_eq!(p, [1.0, 0.0, 0.0]);
    // What the prior rules out leaves the next best, at its cost.
    let (log, p) = step(&[0.0, 1.0, 1.0], plan.sensor(3), &vec![0.0, 1.0, 2.0]).unwrap();
    assert!((log - (1.5_f64.ln() - 1e4)).abs() < 1e-9);
    assert_eq!(p, [0.0, 1.0, 0.0]);
    // The widest that there is: f32::MAX * 1e100 / 1e-6 nats between matches.
    let plan = Plan { temperature: 1e-6, off_map: Some(1.0), ..Plan::new(Spread::Fixed(1e-100)) };
    let row = vec![f32::MIN, 0.0, f32::MAX];
    let (log, p) = step(&[0.0, 1.0, 1.0, 1.0], plan.sensor(3), &row).unwrap();
    assert!((log / (-1e106 * f64::from(f32::MAX)) - 1.0).abs() < 1e-9, "{log}");
    assert_eq!(p, [0.0, 1.0, 0.0, 0.0]);
}

#[test]
fn a_rank_is_a_place_in_the_order_of_the_finite_references() {
    let row: Vec<f32> = (0..201_u16).map(|i| f32::from(i * 37 % 201)).collect();
    for k in 0..=200_u16 {
        let rank = f64::from(k) / 200.0;
        let plan =
            Plan { off_map: Some(rank), temperature: 100.0, ..Plan::new(Spread::Fixed(1.0)) };
        let (_, p) = step(&[1.0; 202], plan.sensor(201), &row).unwrap();
        let at = row.iter().position(|d| *d == f32::from(k)).unwrap();
        assert_eq!(p[201].to_bits(), p[at].to_bits(), "rank {rank}");
    }
    // Those that are infinitely far are none of them.
    let row = vec![0.3, INF, 0.1, INF, 0.2];
    for (rank, at) in [(0.0, 2), (0.24, 2), (0.26, 4), (0.5, 4), (0.74, 4), (0.76, 0), (1.0, 0)] {
        let plan = Plan { off_map: Some(rank), ..Plan::new(Spread::Query) };
        let (_, p) = step(&[1.0; 6], plan.sensor(5), &row).unwrap();
        assert_eq!(p[5].to_bits(), p[at].to_bits(), "rank {rank}");
    }
}
