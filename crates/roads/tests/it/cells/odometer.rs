//! Distances: means, variances, and ticks of any size.

use proptest::prelude::*;
use wayfix::map::PlanePosition;
use wayfix::{Belief, Hmm, LikelihoodVector, Prior, Transition};
use wayfix_roads::cells::RoadCells;
use wayfix_roads::cells::{CellTransition, Odometer, TurnWeights};

use super::road;
use crate::kit::{cases, close, text};

fn motion(cells: &RoadCells<PlanePosition>) -> CellTransition {
    CellTransition::new(cells, &TurnWeights::default()).unwrap()
}

/// Mean and variance of the metres driven from the first cell.
fn spread(belief: &[f64]) -> (f64, f64) {
    let at = |cell: usize| 5.0 * cell as f64;
    let mean: f64 = belief.iter().enumerate().map(|(cell, p)| p * at(cell)).sum();
    let square = |(cell, p): (usize, &f64)| p * (at(cell) - mean).powi(2);
    (mean, belief.iter().enumerate().map(square).sum())
}

/// Drives a straight road by ticks.
fn drive(ticks: usize, metres: f64, variance: f64) -> (Vec<f64>, Odometer) {
    let cells = road(1000.0);
    let mut odometer = motion(&cells).odometer();
    let start = Belief::certain(cells.states(), 0).unwrap();
    let sensor = LikelihoodVector::linear(cells.states());
    let hmm = Hmm::new(Prior::BeforeFirstTransition(start), motion(&cells), sensor).unwrap();
    let mut filter = hmm.filter();
    for _ in 0..ticks {
        filter.predict_with(&odometer.add(metres, variance).unwrap()).unwrap();
    }
    (filter.belief().as_slice().to_vec(), odometer)
}

#[test]
fn ticks_of_any_size_spread_by_their_variance_alone() {
    // 100 m with a deviation of 1 m, in ticks of 2 cm, 3.3 cm, 1 m, 7 m, 100 m.
    for (ticks, metres) in [(5000, 0.02), (3030, 0.033), (100, 1.0), (14, 7.0), (1, 100.0)] {
        let (belief, odometer) = drive(ticks, metres, 0.01 * metres);
        let (mean, variance) = spread(&belief);
        let driven = ticks as f64 * metres;
        let ahead = odometer.ahead();
        assert!((mean + ahead - driven).abs() < 1e-3, "{ticks}: {mean}");
        assert!(ahead.abs() <= 2.5 + 1e-9, "{ticks}: {ahead}");
        // All of the distance, with the rest that is kept; a draw below 0 is a stay, which is rare.
        assert!((variance + odometer.variance() - 0.01 * driven).abs() < 1e-3, "{variance}");
    }
}

#[test]
fn a_kilometre_is_ten_times_a_hundred_metres() {
    let cells = road(1500.0);
    let (a, n) = (motion(&cells), cells.states());
    let mut x = vec![0.0; n];
    x[20] = 1.0;
    let mut once = vec![0.0; n];
    a.apply(&a.travel(1000.0, 90.0).unwrap(), &x, &mut once);
    let mut out = vec![0.0; n];
    for _ in 0..10 {
        a.apply(&a.travel(100.0, 9.0).unwrap(), &x, &mut out);
        std::mem::swap(&mut x, &mut out);
    }
    let differences = x.iter().zip(&once).map(|(a, b)| (a - b).abs());
    assert!(differences.fold(0.0, f64::max) < 1e-14);
    assert!(x[220] > 0.2 && x[0] == 0.0);
}

#[test]
fn what_goes_back_is_taken_off() {
    let mut odometer = motion(&road(100.0)).odometer();
    assert_eq!(odometer.add(-4.0, 0.0).unwrap().mean(), 0.0);
    assert_eq!(odometer.add(6.0, 0.0).unwrap().mean(), 0.0);
    assert_eq!(odometer.ahead(), 2.0);
    assert_eq!(odometer.add(1.0, 0.0).unwrap().mean(), 1.0);
    assert_eq!(odometer.ahead(), -2.0);
    odometer.reset();
    assert_eq!(odometer.ahead(), 0.0);
}

#[test]
fn a_bad_odometer_waits() {
    let mut odometer = motion(&road(1000.0)).odometer();
    // Deviations grow as √(25 m): 5 m at the first cell, a third of 45 m at the ninth.
    let released: Vec<f64> =
        (0..12).map(|_| odometer.add(5.0, 25.0).unwrap().mean().round()).collect();
    assert_eq!(released, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 9.0, 0.0, 0.0, 0.0]);
    assert_eq!((odometer.ahead(), odometer.variance()), (15.0, 75.0));
}

#[test]
fn readings_are_checked() {
    let mut odometer = motion(&road(100.0)).odometer();
    odometer.add(1.0, 0.5).unwrap();
    let before = odometer.clone();
    assert_eq!(
        text(odometer.add(f64::INFINITY, 0.0)),
        "inf metres driven, expected a finite value"
    );
    assert_eq!(
        text(odometer.add(0.0, f64::NAN)),
        "a variance of NaN of the metres driven, expected 0 or more"
    );
    assert!(odometer.add(1e300, 0.0).is_err());
    assert_eq!(odometer, before);
}

proptest! {
    #![proptest_config(cases())]

    /// Between whole numbers of cells, the variance is at least that of the two-point distribution.
    #[test]
    fn mean_and_variance_are_kept(
        metres in prop_oneof![0.0..2000.0_f64, (0..400_u32).prop_map(|cells| 5.0 * f64::from(cells))],
        deviation in prop_oneof![Just(0.0), -6.0..1.8_f64].prop_map(|power| if power == 0.0 { 0.0 } else { 10.0_f64.powf(power) }),
    ) {
        let cells = metres / 5.0;
        let variance = (deviation / 5.0).powi(2);
        // A negative distance is a stay.
        prop_assume!(cells == 0.0 && variance == 0.0 || cells > 12.0 * (deviation / 5.0) + 25.0);
        let travel = motion(&road(100.0)).travel(metres, deviation * deviation).unwrap();
        let part = cells.fract();
        close(travel.mean(), cells, 1e-9, 1e-9)?;
        close(travel.variance(), variance.max(part * (1.0 - part)), 1e-6, 1e-8)?;
        close(travel.weights().iter().sum::<f64>(), 1.0, 1e-12, 0.0)?;
    }
}
