//! Learning recovers the parameters of simulated drives.

use wayfix::map::PlanePosition;
use wayfix_roads::matching::{LearnedMatchModel, MatchModel, Matcher};

use super::city::{Drive, ON_ROADS, Scenario, city, drive};

fn fit(noise: f64, drives: &[Drive]) -> LearnedMatchModel {
    let network = city(30, 30, 100.0, |_, _| false);
    let model = MatchModel { noise, ..MatchModel::default() };
    let matcher: Matcher<PlanePosition> = Matcher::new(network).with_model(model).unwrap();
    let points: Vec<_> = drives.iter().map(|drive| &drive.points[..]).collect();
    matcher.learn(&points, 30).unwrap()
}

fn drives(scenario: &Scenario) -> Vec<Drive> {
    let network = city(30, 30, 100.0, |_, _| false);
    (0..24).map(|seed| drive(&network, scenario, seed)).collect()
}

#[test]
fn finds_the_noise() {
    for (sigma, start) in [(5.0, 8.0), (5.0, 20.0), (15.0, 20.0), (15.0, 8.0)] {
        let drives = drives(&Scenario { noise: sigma, ..ON_ROADS });
        let fitted = fit(start, &drives);
        let points: usize = drives.iter().map(|drive| drive.points.len()).sum();
        // The position at the point before.
        let truths = drives.iter().flat_map(|drive| drive.truth.windows(2));
        let stood = truths.filter(|pair| pair[0] == pair[1]).count();
        let stop = stood as f64 / points as f64;
        assert!((fitted.model.noise / sigma - 1.0).abs() < 0.1, "{fitted:?}");
        assert_eq!(fitted.points, points);
        // Slow moves look like stops if positions are coarse.
        let margin = if sigma < 10.0 { 0.05 } else { 0.25 };
        assert!((fitted.model.stop - stop).abs() < margin, "{stop}: {fitted:?}");
        assert!(fitted.model.outliers < 0.05, "{fitted:?}");
    }
}

#[test]
fn finds_outliers() {
    let drives = drives(&Scenario { outliers: 0.1, noise: 6.0, ..ON_ROADS });
    // A tenth of the points are outliers; those of two or three deviations count partly.
    let fitted = fit(12.0, &drives);
    assert!((fitted.model.noise / 6.0 - 1.0).abs() < 0.2, "{fitted:?}");
    assert!(fitted.model.outliers > 0.05 && fitted.model.outliers < 0.25, "{fitted:?}");
}

/// The likelihood rises with each iteration.
#[test]
fn iterations_improve() {
    let network = city(30, 30, 100.0, |_, _| false);
    let drives = drives(&Scenario { noise: 12.0, ..Scenario::default() });
    let matcher: Matcher<PlanePosition> = Matcher::new(network);
    let points: Vec<_> = drives[..8].iter().map(|drive| &drive.points[..]).collect();
    let logs: Vec<f64> = (1..6)
        .map(|iterations| matcher.learn(&points, iterations).unwrap().log_likelihood)
        .collect();
    assert!(logs[4] > logs[0], "{logs:?}");
    let none = matcher.learn(&points, 0).unwrap();
    assert_eq!((none.model, none.iterations), (*matcher.model(), 0));
}

/// Parameters learned from one half of the drives must help on the other.
#[test]
fn what_does_not_hold_is_not_kept() {
    let of_noise = |noise| drives(&Scenario { noise, ..ON_ROADS });
    let sure = fit(8.0, &of_noise(15.0));
    assert!(sure.held_out > 100.0 && sure.model.noise > 12.0, "{sure:?}");
    // Few points are hardly informative.
    let mut short = of_noise(8.0);
    short.iter_mut().for_each(|drive| drive.points.truncate(4));
    let short = fit(8.0, &short[..3]);
    assert!(short.held_out < 7.0, "{short:?}");
    assert_eq!(short.model, MatchModel { noise: 8.0, ..MatchModel::default() });
    // Halves that contradict each other.
    let [fine, rough] = [1.0, 40.0].map(|noise| of_noise(noise).into_iter().take(6));
    let mixed: Vec<Drive> = fine.zip(rough).flat_map(|(fine, rough)| [fine, rough]).collect();
    let mixed = fit(8.0, &mixed);
    assert!(mixed.held_out < 0.0 && mixed.model.noise == 8.0, "{mixed:?}");
    assert_eq!(mixed.median_interval, sure.median_interval);
    assert!(mixed.points > 0 && mixed.iterations > 0);
}

/// Two halves of a drive, a single point, and none.
#[test]
fn drives_are_halved() {
    let drive = &drives(&Scenario { noise: 15.0, ..ON_ROADS })[0];
    let network = city(30, 30, 100.0, |_, _| false);
    let matcher: Matcher<PlanePosition> = Matcher::new(network);
    let whole = matcher.learn(&[&drive.points], 5).unwrap();
    let (a, b) = drive.points.split_at(drive.points.len() / 2);
    assert_eq!(
        whole.held_out.is_sign_positive(),
        matcher.learn(&[a, b], 5).unwrap().held_out > 0.0
    );
    let point = matcher.learn(&[&drive.points[..1]], 5).unwrap();
    assert_eq!((point.model, point.points, point.median_interval), (*matcher.model(), 1, 0.0));
    let none: [&[_]; 0] = [];
    let none = matcher.learn(&none, 5).unwrap();
    assert_eq!((none.model, none.points, none.held_out), (*matcher.model(), 0, 0.0));
    assert!(matcher.learn(&[&drive.points[..0]], 5).is_err());
}
