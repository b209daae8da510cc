//! Vehicles from JSON.

use wayfix::map::Position;
use wayfix_roads::matching::{Matcher, TracePoint, Vehicle};

use super::super::{check_message, read};
use super::{CORNERS, drives, place};
use crate::counts::Counts;
use crate::draw::Draw;

/// Checks all answers of a vehicle.
pub(super) fn check(vehicle: &Vehicle, matcher: &Matcher) {
    drives::is_sane(&vehicle.live());
    drives::is_sane(&vehicle.late());
    for points in 0..=vehicle.points_late() {
        vehicle.ago(points).iter().for_each(drives::is_sane);
    }
    assert!(vehicle.log_likelihood().is_finite() && vehicle.log_normalizer().is_finite());
    let sum: f64 = vehicle.edges().iter().map(|edge| edge.1).sum();
    assert!((sum + vehicle.live().off_road - 1.0).abs() < 1e-6, "{sum}");
    match vehicle.credible(matcher, 0.9) {
        Ok(found) => {
            assert!((0.0..=1.0).contains(&found.probability));
            for stretch in &found.stretches {
                assert!(stretch.enter <= stretch.exit, "{stretch:?}");
            }
        }
        Err(error) => check_message(&error),
    }
}

/// Reads a damaged vehicle.
pub(super) fn vehicle(draw: &mut Draw<'_>, counts: &mut Counts) {
    let corner = draw.pick(&CORNERS);
    let matcher = drives::town(corner);
    let mut time = 0.0;
    let mut next = |draw: &mut Draw<'_>| {
        time += 10.0;
        let [latitude, longitude] = place(corner, draw.below(9));
        TracePoint::new(time, Position { latitude, longitude })
    };
    let mut vehicle = matcher.start(&next(draw), draw.below(4)).expect("a point");
    for _ in 0..draw.below(5) {
        vehicle.step(&matcher, &next(draw)).expect("a point");
    }
    let Some(mut vehicle) = read(draw, &vehicle, counts) else { return };
    counts.add("vehicles accepted");
    check(&vehicle, &matcher);
    for _ in 0..5 {
        let point = TracePoint { time: vehicle.last_point().time + 10.0, ..next(draw) };
        match vehicle.step(&matcher, &point) {
            Ok(log) => assert!(log.is_finite(), "{log}"),
            Err(error) => check_message(&error),
        }
        check(&vehicle, &matcher);
    }
}
