//! Learning from simulated drives.

use rand::{Rng, RngExt};
use rand_distr::{Distribution, StandardNormal, StudentT};
use wayfix_recognition::motion::{OdometryModel, Speeds};

use crate::kit::{cases, rng};

/// A drawn sequence of speeds, and the number of places that each step led on.
fn drive(speeds: &Speeds, steps: usize, rng: &mut impl Rng) -> (Vec<f64>, Vec<f64>) {
    let draw = |shares: &[f64], rng: &mut dyn FnMut() -> f64| {
        let mut left = rng() * shares.iter().sum::<f64>();
        shares.iter().position(|share| {
            left -= share;
            left < 0.0
        })
    };
    let (k, (nearby, anywhere)) = (speeds.values().len(), speeds.changes());
    let mut unit = || rng.random_range(0.0..1.0);
    let mut g = draw(speeds.shares(), &mut unit).unwrap_or(0);
    let (mut at, mut driven, mut moves) = (0.37, Vec::new(), Vec::new());
    for _ in 0..steps {
        let change = unit();
        if change < anywhere {
            g = draw(speeds.shares(), &mut unit).unwrap_or(g);
        } else if change < anywhere + nearby {
            let up = g + 1 < k && (g == 0 || unit() < 0.5);
            g = if up { g + 1 } else { g - 1 };
        }
        let after = at + speeds.values()[g];
        driven.push(speeds.values()[g]);
        moves.push(after.floor() - f64::floor(at));
        at = after;
    }
    (driven, moves)
}

fn mean_and_deviation(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    (mean, (values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n).sqrt())
}

#[test]
fn speeds_of_simulated_drives_are_found() {
    let usual = Speeds::default();
    let mut shares = vec![0.0; usual.values().len()];
    for (speed, share) in [(0.0, 0.3), (1.0, 0.4), (2.0, 0.2), (-1.0, 0.1)] {
        shares[usual.nearest(speed)] = share;
    }
    let truth = usual.clone().with_shares(&shares).unwrap().with_changes(0.0, 0.02).unwrap();
    let (mut apart, mut changes) = (Vec::new(), Vec::new());
    // All 20 take half a minute.
    for seed in 0..u64::from(cases().cases / 32).clamp(8, 20) {
        let rng = &mut rng(seed);
        let drives: Vec<Vec<f64>> = (0..4)
            .map(|_| drive(&truth, 1000, rng))
            .collect::<Vec<_>>()
            .into_iter()
            .map(|drive| drive.1)
            .collect();
        let learned = usual.fit(&drives).unwrap();
        let used: f64 = learned.shares().iter().sum();
        assert!((used - 1.0).abs() < 1e-12 && learned.shares().iter().all(|p| *p > 0.0));
        // Half of the sum of differences: the total variation.
        let pairs = learned.shares().iter().zip(truth.shares());
        apart.push(0.5 * pairs.map(|(a, b)| (a - b).abs()).sum::<f64>());
        changes.push(learned.changes().0 + learned.changes().1);
    }
    let ((apart, spread), (changes, of)) =
        (mean_and_deviation(&apart), mean_and_deviation(&changes));
    // 80 stays at speeds, so that each share is known to a few hundredths.
    assert!(apart < 0.2 && spread < 0.1, "{apart} ± {spread}");
    assert!((0.008..0.03).contains(&changes) && of < 0.006, "{changes} ± {of}");
}

#[test]
fn a_drive_at_one_speed_is_at_one_speed() {
    let usual = Speeds::default();
    for (speed, place) in [(0.5, 4), (1.0, 8), (1.25, 10), (2.0, 13), (-1.0, 1)] {
        let moves: Vec<f64> = (1..=200)
            .map(|k| (speed * f64::from(k)).floor() - (speed * f64::from(k - 1)).floor())
            .collect();
        let learned = usual.fit(&[moves]).unwrap();
        let most = learned.shares()[place];
        assert!(most > 0.5, "{speed}: {:?}", learned.shares());
        assert_eq!(learned.shares().iter().filter(|p| **p >= most).count(), 1, "{speed}");
    }
}

/// Odometry of drives at changing speeds, with errors that are Gaussian or have heavy tails.
#[test]
fn odometry_is_found_within_its_spread() {
    let truth = Speeds::default();
    for (scale, bias, deviation) in [(1.0, 0.0, 0.2), (1.06, 0.0, 0.3), (0.95, 0.02, 0.1)] {
        for heavy in [false, true] {
            let mut found = [Vec::new(), Vec::new(), Vec::new()];
            for seed in 0..20 {
                let rng = &mut rng(100 + seed);
                let drives: Vec<(Vec<f64>, Vec<f64>)> = (0..3)
                    .map(|_| {
                        let (driven, moves) = drive(&truth, 500, rng);
                        let read = driven.iter().map(|v| {
                            let error: f64 = if heavy {
                                StudentT::new(4.0).unwrap().sample(rng)
                            } else {
                                StandardNormal.sample(rng)
                            };
                            scale * v + bias + deviation * error
                        });
                        let read = read.collect();
                        (moves, read)
                    })
                    .collect();
                let learned = OdometryModel::fit(&drives).unwrap();
                found[0].push(learned.scale - scale);
                found[1].push(learned.bias - bias);
                found[2].push(learned.deviation / deviation);
            }
            let name = format!("{scale} {bias} {deviation} heavy {heavy}");
            let [off, biased, ratio] = found.map(|values| mean_and_deviation(&values));
            assert!(off.0.abs() < 0.01 && off.1 < 0.02, "{name}: scale {off:?}");
            assert!(biased.0.abs() < 0.012 && biased.1 < 0.02, "{name}: bias {biased:?}");
            // For errors between a Gaussian and t, one number for both.
            assert!((0.6..1.7).contains(&ratio.0) && ratio.1 < 0.25, "{name}: {ratio:?}");
        }
    }
}

/// One slip of a wheel in fifty changes little.
#[test]
fn slips_are_borne() {
    let truth = Speeds::default();
    let mut ratios = Vec::new();
    for seed in 0..20 {
        let rng = &mut rng(200 + seed);
        let (driven, moves) = drive(&truth, 1000, rng);
        let read: Vec<f64> = driven
            .iter()
            .enumerate()
            .map(|(k, v)| {
                let error: f64 = StandardNormal.sample(rng);
                v + 0.2 * error
                    + if k % 50 == 49 { 8.0 * (0.5 - f64::from(k as u32 / 50 % 2)) } else { 0.0 }
            })
            .collect();
        let learned = OdometryModel::fit(&[(moves, read)]).unwrap();
        assert!((learned.scale - 1.0).abs() < 0.1 && learned.bias.abs() < 0.06, "{learned:?}");
        ratios.push(learned.deviation / 0.2);
    }
    let (ratio, spread) = mean_and_deviation(&ratios);
    assert!((0.7..2.0).contains(&ratio) && spread < 0.3, "{ratio} ± {spread}");
}
