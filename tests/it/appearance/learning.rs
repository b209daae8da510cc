//! The temperature without labels.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::inference::LearningOptions;
use wayfix::likelihood::GroupedLikelihood;
use wayfix::likelihood::Groups;
use wayfix::observation::{AppearanceLikelihood, Spread};
use wayfix::{Belief, DenseTransition, Hmm, OptionalLikelihood, Prior};

use super::definition::*;

use crate::kit::{cases, log_sum};

/// Σ ln p of rows under independent places with these probabilities.
fn evidence(plan: &Plan, p: &[f64], rows: &[Vec<f32>], temperature: f64) -> f64 {
    let plan = Plan { temperature, ..plan.clone() };
    let one = |row: &Vec<f32>| {
        let joint = plan.logs(row, f64::round).into_iter().zip(p).map(|(log, p)| log + p.ln());
        log_sum(joint)
    };
    rows.iter().map(one).sum()
}

fn learning(iterations: usize) -> LearningOptions {
    LearningOptions { keep_prior: true, tolerance: 0.0, iterations, ..LearningOptions::default() }
}

/// A plan, rows, and a probability for each state.
fn unlabelled() -> impl Strategy<Value = (Plan, Vec<Vec<f32>>, Vec<f64>)> {
    (2..=6_usize, 1..=6_usize).prop_flat_map(|(n, count)| {
        let any = (-6.0..6.0).prop_map(|e| 10_f64.powf(e));
        let temperature = prop_oneof![2 => Just(1.0), 1 => any];
        let rank = (0..n).prop_map(move |k| Some(k as f64 / (n - 1) as f64));
        let rank = prop_oneof![Just(None), rank];
        let sure = vec(prop_oneof![Just(0.01), Just(1.0)], n + 1);
        let p = prop_oneof![vec(0.1..1.0, n + 1), sure];
        let far = vec(prop::bool::weighted(0.05), count);
        (spread(), temperature, rank, (vec(row(n), count), far), p).prop_map(
            move |(spread, temperature, off_map, (mut rows, far), mut p)| {
                if off_map.is_some() {
                    let far = rows.iter_mut().zip(far).filter(|(_, far)| *far);
                    far.for_each(|(row, _)| row.fill(INF));
                }
                p.truncate(n + usize::from(off_map.is_some()));
                (Plan { spread, temperature, off_map, seen: None }, rows, normalized(&p))
            },
        )
    })
}

/// What a re-estimation maximises, with the posteriors at the old temperature.
fn expected_log(plan: &Plan, p: &[f64], rows: &[Vec<f32>], temperature: f64) -> f64 {
    let new = Plan { temperature, ..plan.clone() };
    let one = |row: &Vec<f32>| -> f64 {
        let joint = plan.logs(row, f64::round).into_iter().zip(p).map(|(log, p)| log + p.ln());
        let joint: Vec<f64> = joint.collect();
        let sum = log_sum(joint.iter().copied());
        let posterior = joint.iter().map(|joint| (joint - sum).exp());
        let pairs = new.logs(row, f64::round).into_iter().zip(posterior);
        pairs.filter(|(_, p)| *p > 0.0).map(|(log, p)| p * log).sum()
    };
    rows.iter().map(one).sum()
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn a_reestimation_is_the_best_of_those_about((plan, rows, p) in unlabelled()) {
        let (old, hmm) = (plan.temperature, independent(&p, plan.sensor(rows[0].len())));
        let learned = hmm.learn(&[&rows[..]], &learning(1)).unwrap();
        let new = learned.model().likelihood().temperature();
        prop_assert!((1e-6..=1e6).contains(&new));
        let found = expected_log(&plan, &p, &rows, new);
        for factor in [1.0, 0.99, 1.01, 0.9, 1.1, 0.5, 2.0, 0.25, 4.0] {
            let other = old / factor;
            if (1e-6..=1e6).contains(&other) {
                let least = expected_log(&plan, &p, &rows, other);
                let rounding = 1e-9 * least.abs().max(1.0);
                prop_assert!(found >= least - rounding, "{old} to {new}: {found}, but {least} at {other}");
            }
        }
    }

    #[test]
    fn learning_never_loses((plan, rows, p) in unlabelled()) {
        let hmm = independent(&p, plan.sensor(rows[0].len()));
        let learned = hmm.learn(&[&rows[..]], &learning(50)).unwrap();
        let objectives = learned.objectives();
        let rounding = 1e-9 * objectives[0].abs().max(1.0);
        let before = evidence(&plan, &p, &rows, plan.temperature);
        prop_assert!((objectives[0] - before).abs() <= rounding);
        prop_assert!(objectives.windows(2).all(|two| two[1] >= two[0] - rounding), "{objectives:?}");
        let temperature = learned.model().likelihood().temperature();
        prop_assert!((1e-6..=1e6).contains(&temperature));
        let after = evidence(&plan, &p, &rows, temperature);
        prop_assert!((learned.log_likelihood() - after).abs() <= rounding);
    }

    /// Where steps depend on each other, and prior and motion are learned too.
    #[test]
    fn learning_in_sequence_never_loses(
        (plan, rows, p) in unlabelled(),
        stay in 0.1..0.9,
        cut in 0..6_usize,
    ) {
        let entry = |to: usize, from: usize| {
            stay * f64::from(u8::from(to == from)) + (1.0 - stay) * p[to]
        };
        let motion = DenseTransition::from_fn(p.len(), entry).unwrap();
        let prior = Prior::AtFirstObservation(Belief::new(p.clone()).unwrap());
        let hmm = Hmm::new(prior, motion, plan.sensor(rows[0].len())).unwrap();
        let (first, second) = rows.split_at(cut.min(rows.len()));
        let learning = LearningOptions { tolerance: 0.0, iterations: 20, ..LearningOptions::default() };
        let learned = hmm.learn(&[first, second], &learning).unwrap();
        let objectives = learned.objectives();
        let rounding = 1e-9 * objectives[0].abs().max(1.0);
        prop_assert!(objectives.windows(2).all(|two| two[1] >= two[0] - rounding), "{objectives:?}");
        prop_assert!(learned.left_out().is_empty());
    }
}

/// Rows of two references, z = ±1, of which a are closer to the first and b to
/// the second: ln p = a ln (p q + r (1 − q)) + b ln (p (1 − q) + r q) but for a
/// constant, where q = 1 / (1 + exp(−2/τ)) and r = 1 − p.
#[test]
fn learning_reaches_the_best_temperature() {
    let rows = [vec![vec![0.0_f32, 1.0]; 55], vec![vec![1.0, 0.0]; 45]].concat();
    // For p = 0.6 its derivative is 0 at q = 3/4, where exp(2/τ) = 3.
    let best = 2.0 / 3_f64.ln();
    let close = |found: f64, to: f64, within: f64| {
        assert!((found / to - 1.0).abs() < within, "{found}, expected {to}");
    };
    let sensor = AppearanceLikelihood::new(2).unwrap();
    for start in [0.2, 1.0, best, 50.0] {
        let hmm = independent(&[0.6, 0.4], sensor.clone().with_temperature(start).unwrap());
        let learned = hmm.learn(&[&rows[..30], &rows[30..]], &learning(2000)).unwrap();
        close(learned.model().likelihood().temperature(), best, 1e-4);
    }

    // The same with gaps, and with states that look alike.
    let gaps: Vec<Option<Vec<f32>>> =
        rows.iter().flat_map(|row| [Some(row.clone()), None]).collect();
    let hmm = independent(&[0.6, 0.4], OptionalLikelihood::new(sensor.clone()));
    let learned = hmm.learn(&[gaps], &learning(2000)).unwrap();
    close(learned.model().likelihood().sensor().temperature(), best, 1e-4);
    let groups = Groups::new(vec![0, 1, 0, 1]).unwrap();
    let grouped = GroupedLikelihood::new(sensor, groups).unwrap();
    let hmm = independent(&[0.5, 0.1, 0.1, 0.3], grouped);
    let learned = hmm.learn(&[&rows[..]], &learning(2000)).unwrap();
    close(learned.model().likelihood().sensor().temperature(), best, 1e-4);

    // With a state off the map, found by going through all.
    for (rank, p) in [(0.0, [0.7, 0.2, 0.1]), (1.0, [0.7, 0.28, 0.02])] {
        let plan = Plan { off_map: Some(rank), ..Plan::new(Spread::Query) };
        let all = (-4000..4000).map(|k| 1.001_f64.powi(k));
        let all = all.map(|tau| (evidence(&plan, &p, &rows, tau), tau));
        let best = all.max_by(|x, y| x.0.total_cmp(&y.0)).unwrap().1;
        let learned = independent(&p, plan.sensor(2)).learn(&[&rows[..]], &learning(2000)).unwrap();
        close(learned.model().likelihood().temperature(), best, 2e-3);
    }
}

/// Some data are the better explained the hotter, or the colder, without end.
#[test]
fn learning_ends_at_the_last_temperature() {
    let learn = |row: [f32; 2], p: &[f64], start: f64| {
        let sensor = AppearanceLikelihood::new(2).unwrap().with_temperature(start).unwrap();
        let learned = independent(p, sensor).learn(&[[row.to_vec()]], &learning(200)).unwrap();
        learned.model().likelihood().temperature()
    };
    // Only reference 0 is possible, and it is the worse one, or the better.
    let hottest = learn([1.0, 0.0], &[1.0, 0.0], 1.0);
    assert!((0.98e6..=1e6).contains(&hottest), "{hottest}");
    assert_eq!(learn([1.0, 0.0], &[1.0, 0.0], 1e6), 1e6);
    let coldest = learn([0.0, 1.0], &[1.0, 0.0], 1.0);
    assert!(coldest < 0.1, "{coldest}"); // from where on doubles hold no gain
    assert_eq!(learn([0.0, 1.0], &[1.0, 0.0], 1e-6), 1e-6);
    // What says nothing changes nothing.
    assert_eq!(learn([1.0, 1.0], &[0.7, 0.3], 1.0), 1.0);
}
