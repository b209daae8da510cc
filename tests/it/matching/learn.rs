//! Learning finds back what drives were simulated with.

use wayfix::map::PlanePosition;
use wayfix::matching::{LearnedMatchModel, MatchModel, Matcher};

use super::city::{Drive, Habits, city, drive};

fn fit(noise: f64, drives: &[Drive]) -> LearnedMatchModel {
    let network = city(30, 30, 100.0, |_, _| false);
    let model = MatchModel { noise, ..MatchModel::default() };
    let matcher: Matcher<PlanePosition> = Matcher::new(network).with_model(model).unwrap();
    let points: Vec<_> = drives.iter().map(|drive| &drive.points[..]).collect();
    matcher.learn(&points, 30).unwrap()
}

fn drives(habits: &Habits) -> Vec<Drive> {
    let network = city(30, 30, 100.0, |_, _| false);
    (0..12).map(|seed| drive(&network, habits, seed)).collect()
}

#[test]
fn finds_the_noise() {
    for (sigma, start) in [(5.0, 8.0), (5.0, 20.0), (15.0, 20.0), (15.0, 8.0)] {
        let drives = drives(&Habits { sigma, ..Habits::default() });
        let fitted = fit(start, &drives);
        let points: usize = drives.iter().map(|drive| drive.points.len()).sum();
        let stood: usize = drives.iter().map(|drive| drive.stood).sum();
        let stop = stood as f64 / points as f64;
        assert!((fitted.model.noise / sigma - 1.0).abs() < 0.1, "{fitted:?}");
        assert_eq!(fitted.points, points);
        // Slow moves look like stops where positions are coarse.
        let margin = if sigma < 10.0 { 0.05 } else { 0.25 };
        assert!((fitted.model.stop - stop).abs() < margin, "{stop}: {fitted:?}");
        assert!(fitted.model.outliers < 0.05, "{fitted:?}");
    }
}

#[test]
fn finds_outliers() {
    let drives = drives(&Habits { outliers: 0.1, sigma: 6.0, ..Habits::default() });
    // A tenth of them; two or three deviations count for a part.
    let fitted = fit(12.0, &drives);
    assert!((fitted.model.noise / 6.0 - 1.0).abs() < 0.2, "{fitted:?}");
    assert!(fitted.model.outliers > 0.05 && fitted.model.outliers < 0.25, "{fitted:?}");
}

/// More probable with each iteration.
#[test]
fn iterations_improve() {
    let network = city(30, 30, 100.0, |_, _| false);
    let drives = drives(&Habits { points: 60, sigma: 12.0, ..Habits::default() });
    let matcher: Matcher<PlanePosition> = Matcher::new(network);
    let points: Vec<_> = drives.iter().map(|drive| &drive.points[..]).collect();
    let logs: Vec<f64> = (1..6)
        .map(|iterations| matcher.learn(&points, iterations).unwrap().log_likelihood)
        .collect();
    assert!(logs[4] > logs[0], "{logs:?}");
    let none = matcher.learn(&points, 0).unwrap();
    assert_eq!((none.model, none.iterations), (*matcher.model(), 0));
}
