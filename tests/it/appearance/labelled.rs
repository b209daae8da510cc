//! The temperature from labels, each on its own and in sequence.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::observation::{AppearanceLikelihood, ObservationError, Spread, calibrate};

use super::definition::*;

use crate::kit::{NEVER, cases, log_sum, text};

fn labelled(plan: &Plan, rows: &[Vec<f32>], places: &[Option<usize>], beta: f64) -> f64 {
    let one = |(row, place): (&Vec<f32>, &Option<usize>)| {
        let z = plan.scores(row);
        let best = z.iter().copied().fold(f64::INFINITY, f64::min);
        let logs: Vec<f64> = z.iter().map(|z| (best - z) * beta).collect();
        place.map_or(0.0, |place| logs[place] - log_sum(logs.iter().copied()))
    };
    rows.iter().zip(places).map(one).sum()
}

/// All of 1/τ that is allowed.
fn grid() -> impl Iterator<Item = f64> {
    (-150..=150).map(|k| 10_f64.powf(f64::from(k) / 25.0))
}

type Labels = (Plan, Vec<Vec<f32>>, Vec<Option<usize>>);

fn labels() -> impl Strategy<Value = Labels> {
    (1..=8_usize, 1..=6_usize).prop_flat_map(|(n, count)| {
        let seen = prop_oneof![Just(None), (vec(row(n), 1..3), 0.1..9.0, offsets()).prop_map(Some)];
        let rows = vec(row(n), count);
        let place = prop_oneof![1 => Just(None), 3 => (0..n).prop_map(Some)];
        (spread(), seen, rows, vec(place, count)).prop_map(
            move |(spread, seen, rows, mut places)| {
                // Labels that may be.
                for (row, place) in rows.iter().zip(&mut places) {
                    *place = place.map(|p| {
                        (0..n).map(|i| (p + i) % n).find(|i| row[*i].is_finite()).unwrap()
                    });
                }
                (Plan { seen, ..Plan::new(spread) }, rows, places)
            },
        )
    })
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn the_learned_temperature_is_the_best_of_a_grid((plan, rows, places) in labels(), off_map in any::<bool>()) {
        let mut sensor = plan.sensor(rows[0].len());
        if off_map {
            sensor = sensor.with_off_map(0.3).unwrap();
        }
        let at = |beta| labelled(&plan, &rows, &places, beta);
        let values: Vec<(f64, f64)> = grid().map(|beta| (at(beta), beta)).collect();
        let best = values.iter().copied().fold((NEVER, 0.0), |best, v| if v.0 > best.0 { v } else { best });
        let coldest = values.last().unwrap().0;
        match sensor.with_learned_temperature(&rows, &places) {
            Ok(learned) => {
                let tau = learned.temperature();
                prop_assert!((1e-6..=1e6).contains(&tau));
                let found = at(1.0 / tau);
                prop_assert!(found >= best.0 - 1e-9 * best.0.abs(), "{tau}: {found}, but {best:?}");
                // The best there is, not only one as good: a maximum inside.
                for beta in [1.0 / tau * 0.99, 1.0 / tau * 1.01] {
                    prop_assert!(at(beta) <= found + 1e-9 * found.abs(), "{tau}");
                }
                prop_assert_eq!(learned.with_temperature(1.0).unwrap(), {
                    let again = plan.sensor(rows[0].len());
                    if off_map { again.with_off_map(0.3).unwrap() } else { again }
                });
            }
            Err(ObservationError::Unlabelled { rows: count }) => {
                prop_assert_eq!(count, rows.len());
                prop_assert!(places.iter().all(Option::is_none));
            }
            Err(ObservationError::Unbounded { trend: "colder" }) => {
                prop_assert!(coldest >= best.0 - 1e-9 * best.0.abs(), "{coldest}, but {best:?}");
            }
            Err(ObservationError::Unbounded { trend: "hotter" }) => {
                prop_assert!(values[0].0 >= best.0 - 1e-9 * best.0.abs(), "{}, but {best:?}", values[0].0);
            }
            Err(error) => prop_assert!(false, "{error}"),
        }
    }
}

#[test]
fn labels_that_give_no_temperature_are_errors() {
    let sensor = || AppearanceLikelihood::new(3).unwrap();
    let says = |rows: &[[f32; 3]], places: &[Option<usize>]| {
        text(sensor().with_learned_temperature(rows, places))
    };
    let row = [0.1, 0.5, 0.9];
    let colder = "the labelled rows are the more probable the colder the temperature, without end";
    let hotter = "the labelled rows are the more probable the hotter the temperature, without end";
    assert_eq!(says(&[row], &[Some(0)]), colder);
    assert_eq!(says(&[row, row], &[Some(0), None]), colder);
    assert_eq!(says(&[[0.1, 0.1, 0.9]], &[Some(1)]), colder); // tied for the best
    assert_eq!(says(&[row], &[Some(1)]), hotter); // the mean itself
    assert_eq!(says(&[row], &[Some(2)]), hotter);
    assert_eq!(says(&[row, row], &[Some(2), Some(0)]), hotter); // on average the mean
    assert_eq!(says(&[row], &[None]), "none of 1 rows is labelled");
    assert_eq!(says(&[], &[]), "none of 0 rows is labelled");
    assert_eq!(says(&[row], &[]), "0 labels for 1 rows, expected one each");
    assert_eq!(says(&[], &[None]), "1 labels for 0 rows, expected one each");
    let label = |row, place| {
        format!("row {row} is labelled {place}, expected a reference at a finite distance, 0 to 2")
    };
    assert_eq!(says(&[row, row], &[Some(0), Some(3)]), label(1, 3));
    assert_eq!(says(&[row, [0.1, INF, 0.3]], &[Some(0), Some(1)]), label(1, 1));
    assert_eq!(
        says(&[row, [0.1, f32::NAN, 0.3]], &[Some(0), Some(0)]),
        "the distance to reference 1 is NaN, expected a number or infinity"
    );
    // Tied for the best, any number of them, by any margin.
    for (n, tied) in (3..20).flat_map(|n| (2..n).map(move |tied| (n, tied))) {
        let row: Vec<f32> = (0..n).map(|i| if i < tied { 0.0 } else { 1.0 }).collect();
        for unit in [None, Some(0.1), Some(0.3), Some(1e-9), Some(1e9)] {
            let sensor = AppearanceLikelihood::new(n).unwrap();
            let spread = unit.map_or(Spread::Query, Spread::Fixed);
            let found = sensor.with_spread(spread).unwrap();
            let found = found.with_learned_temperature(&[&row], &[Some(tied - 1)]);
            assert_eq!(text(found), colder, "{tied} of {n}, {spread:?}");
        }
    }
    // The state off the map is no label.
    let off = sensor().with_off_map(0.0).unwrap();
    assert_eq!(text(off.with_learned_temperature(&[row], &[Some(3)])), label(0, 3));
    // Two rows that contradict each other as often as the kernel says: z is
    // ±1 about the mean, so three of four labels are the nearer one at τ = 2 / ln 3.
    let rows = [[0.0_f32, 1.0]; 4];
    let learned = AppearanceLikelihood::new(2).unwrap();
    let learned =
        learned.with_learned_temperature(&rows, &[Some(0), Some(0), Some(1), Some(0)]).unwrap();
    assert!((learned.temperature() - 2.0 / 3_f64.ln()).abs() < 1e-9);
}

// ---- Calibration.

/// The candidates that the rule may choose: of each best one (several may be),
/// the first within a standard error of the mean difference, or within what is
/// worth something. Those at just that may count or not.
fn one_standard_error(all: &[Vec<f64>], worth: f64) -> Vec<usize> {
    let possible = |step: &usize| all.iter().any(|scores| scores[*step].is_finite());
    let told: Vec<usize> = (0..all[0].len()).filter(possible).collect();
    let all: Vec<Vec<f64>> =
        all.iter().map(|scores| told.iter().map(|step| scores[*step]).collect()).collect();
    let steps = told.len() as f64;
    let means: Vec<f64> =
        all.iter().map(|scores| if told.is_empty() { NEVER } else { mean(scores) }).collect();
    let most = means.iter().copied().fold(NEVER, f64::max);
    let mut chosen = Vec::new();
    for best in (0..all.len()).filter(|at| means[*at] == most) {
        let within = |at: &usize, about: f64| {
            let pairs = all[best].iter().zip(&all[*at]);
            let differences: Vec<f64> = pairs.map(|(best, other)| best - other).collect();
            let error = deviation(&differences) / (steps - 1.0).sqrt();
            means[*at] == most || mean(&differences) <= error.max(worth) + about
        };
        let surely = (0..all.len()).find(|at| within(at, -1e-12)).unwrap_or(best);
        chosen.extend((0..=surely).filter(|at| within(at, 1e-12)));
    }
    chosen
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn calibration_is_the_one_standard_error_rule(
        all in (1..7_usize).prop_flat_map(|steps| {
            let score = prop_oneof![
                4 => -3.0..=0.0,
                4 => (-3..=0_i32).prop_map(f64::from),
                1 => prop_oneof![9 => Just(-1.0), 1 => Just(NEVER)],
            ];
            vec(vec(score, steps), 1..7)
        }),
        worth in prop_oneof![Just(0.0), 0.0..1.0],
    ) {
        let mut calls = (0..all.len()).collect::<Vec<_>>().into_iter();
        let candidates: Vec<usize> = (0..all.len()).collect();
        let found = calibrate::<_, ObservationError>(&candidates, worth, |candidate| {
            assert_eq!(calls.next(), Some(*candidate));
            Ok(all[*candidate].clone())
        });
        let found = found.unwrap();
        prop_assert!(calls.next().is_none());
        prop_assert_eq!(found.scores().len(), all.len());
        let possible = |step: &usize| all.iter().any(|scores| scores[*step].is_finite());
        let told: Vec<usize> = (0..all[0].len()).filter(possible).collect();
        for (mean_found, scores) in found.scores().iter().zip(&all) {
            let scores: Vec<f64> = told.iter().map(|step| scores[*step]).collect();
            let expected = if scores.is_empty() { NEVER } else { mean(&scores) };
            prop_assert!(*mean_found == expected || (mean_found - expected).abs() < 1e-12);
        }
        let chosen = one_standard_error(&all, worth);
        prop_assert!(chosen.contains(&found.chosen()), "{}, expected {chosen:?}", found.chosen());
    }
}

#[test]
fn calibration_by_hand() {
    let run = |worth: f64, table: &[&[f64]]| {
        calibrate::<_, ObservationError>(table, worth, |scores| Ok(scores.to_vec())).unwrap()
    };
    let chosen = |table: &[&[f64]]| run(0.0, table).chosen();
    // Differences −1 and 1 − d: mean −d/2, standard error about 1.
    let noisy: [&[f64]; 3] = [&[-3.0, -2.0], &[-2.0, -0.5], &[-1.0, -1.0]];
    assert_eq!(run(0.0, &noisy).chosen(), 1);
    assert_eq!(run(0.0, &noisy).scores(), [-2.5, -1.25, -1.0]);
    assert_eq!(run(1.5, &noisy).chosen(), 0);
    // The same difference at each step is none of chance, but may be worth little.
    assert_eq!(chosen(&[&[-1.25, -2.25], &[-1.0, -2.0]]), 1);
    assert_eq!(run(0.25, &[&[-1.25, -2.25], &[-1.0, -2.0]]).chosen(), 0);
    // One step has no error; ties go to the first.
    assert_eq!(chosen(&[&[-1.1], &[-1.0]]), 1);
    assert_eq!(chosen(&[&[-1.0], &[-1.0]]), 0);
    assert_eq!(chosen(&[&[0.0, 0.0], &[0.0, 0.0], &[0.0, 0.0]]), 0);
    // One that loses the vehicle once is not as good.
    assert_eq!(chosen(&[&[-0.1, NEVER], &[-1.0, -3.0]]), 1);
    assert_eq!(chosen(&[&[-1.0, -3.0], &[-0.1, NEVER]]), 0);
    // If all do, they cannot be told apart, unless it is at the same step.
    let lost = run(0.0, &[&[-0.1, NEVER], &[NEVER, -0.2], &[-0.1, NEVER]]);
    assert_eq!((lost.chosen(), lost.scores()[0]), (0, NEVER));
    let same = run(0.0, &[&[-0.5, NEVER], &[-0.1, NEVER]]);
    assert_eq!((same.chosen(), same.scores()), (1, &[-0.5, -0.1][..]));
    assert_eq!(run(0.0, &[&[NEVER], &[NEVER]]).scores(), [NEVER, NEVER]);
}

#[test]
fn calibration_says_what_is_wrong() {
    let run = |worth: f64, table: &[&[f64]]| {
        text(calibrate::<_, ObservationError>(table, worth, |scores| Ok(scores.to_vec())))
    };
    assert_eq!(run(0.0, &[]), "the number of candidates is 0, expected at least 1");
    for worth in [-0.1, f64::NAN] {
        let expected = format!("the worth of a difference is {worth}, expected at least 0");
        assert_eq!(run(worth, &[&[-1.0]]), expected);
    }
    let number = |found: usize| {
        let expected = "expected at least 1, and as many for each candidate";
        format!("the number of log scores is {found}, {expected}")
    };
    assert_eq!(run(0.0, &[&[-1.0, -1.0], &[-1.0]]), number(1));
    assert_eq!(run(0.0, &[&[-1.0], &[-1.0; 3]]), number(3));
    assert_eq!(run(0.0, &[&[]]), number(0));
    assert_eq!(run(0.0, &[&[-1.0, 0.5]]), "a log score is 0.5, expected at most 0");
    assert_eq!(run(0.0, &[&[-1.0, f64::NAN]]), "a log score is NaN, expected at most 0");
    // An error of the estimate is passed on as it is.
    let failed = calibrate(&[1.0], 0.0, |_| Err::<Vec<f64>, _>(ObservationError::NoSpread));
    assert_eq!(failed, Err(ObservationError::NoSpread));
}
