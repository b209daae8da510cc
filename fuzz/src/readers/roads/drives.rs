//! Drives of arbitrary points.

use wayfix::map::{Position, RoadClass};
use wayfix_roads::NetworkBuilder;
use wayfix_roads::matching::{
    MatchError, MatchModel, MatchedDrive, Matcher, RoadAnswer, TracePoint,
};

use super::super::check_message;
use super::{CORNERS, place};
use crate::counts::Counts;
use crate::draw::Draw;

/// A matcher of nine crossings.
pub(super) fn town(corner: [f64; 2]) -> Matcher {
    let mut builder = NetworkBuilder::new();
    for number in 0..9 {
        let [latitude, longitude] = place(corner, number);
        builder.node(number as u64, Position { latitude, longitude }).expect("a place on Earth");
    }
    for id in 0..9 {
        if id % 3 < 2 {
            builder.both_ways(id, id + 1, RoadClass::Street).expect("a street");
        }
        if id < 6 {
            builder.both_ways(id, id + 3, RoadClass::Main).expect("a street");
        }
    }
    Matcher::new(builder.build().expect("nodes"))
}

/// Drives past some positions, ten seconds each.
pub(super) fn along(matcher: &Matcher, positions: impl Iterator<Item = Position>) {
    let point = |(number, position)| TracePoint::new(10.0 * f64::from(number), position);
    let points: Vec<TracePoint> = (0_i32..).zip(positions).map(point).collect();
    check(&matcher.match_drive(&points).expect("points in order"));
}

pub(super) fn is_sane(answer: &RoadAnswer) {
    let RoadAnswer { probability, entropy, off_road, metres_along, edge } = *answer;
    assert!((0.0..=1.0 + 1e-9).contains(&probability), "{answer:?}");
    assert!((0.0..=1.0 + 1e-9).contains(&off_road), "{answer:?}");
    assert!(entropy.is_finite() && entropy >= -1e-9, "{answer:?}");
    assert!(metres_along.is_finite() && metres_along >= 0.0, "{answer:?}");
    assert!(edge.is_some() || probability == off_road, "{answer:?}");
}

/// Checks all answers of a drive.
pub(super) fn check(drive: &MatchedDrive) {
    for point in 0..drive.points().len() {
        is_sane(&drive.live(point));
        is_sane(&drive.late(point, 2));
        is_sane(&drive.smoothed(point));
        assert!(drive.log_normalizer(point).is_finite());
    }
    assert!(drive.log_likelihood().is_finite());
    assert!(drive.metres().is_finite() && drive.metres() >= 0.0);
    for stretch in drive.route() {
        assert!(stretch.enter.is_finite() && stretch.exit.is_finite(), "{stretch:?}");
    }
}

const NUMBERS: [f64; 16] = [
    0.0,
    -0.0,
    -1.0,
    1e-6,
    5e-324,
    1e9,
    1e18,
    1e20,
    -1e20,
    1e300,
    f64::MAX,
    f64::NAN,
    f64::INFINITY,
    f64::NEG_INFINITY,
    400.0,
    1.0 - f64::EPSILON / 2.0,
];

/// A point of a drive: in the town, far away, or nonsense.
fn point(draw: &mut Draw<'_>, corner: [f64; 2], before: f64) -> TracePoint {
    let [latitude, longitude] = place(corner, draw.below(9));
    let position = match draw.below(12) {
        0 => Position { latitude: draw.pick(&NUMBERS), longitude },
        1 => Position { latitude, longitude: draw.pick(&NUMBERS) },
        2 => Position { latitude: 90.0, longitude: -180.0 },
        3 => Position { latitude: latitude.min(80.0) + 9.0, longitude },
        _ => Position { latitude, longitude },
    };
    let time = match draw.below(12) {
        0 => draw.pick(&NUMBERS),
        1 => before,
        2 => before + 1e9,
        3 => before + 1e-9,
        4 => before - 1.0,
        _ => before + 10.0 * draw.unit(),
    };
    let mut optional = |usual: f64| match draw.below(8) {
        0 => Some(draw.pick(&NUMBERS)),
        1 | 2 => Some(usual),
        _ => None,
    };
    let [accuracy, heading, speed] = [12.0, 90.0, 8.0].map(&mut optional);
    TracePoint { time, position, accuracy, heading, speed }
}

fn model(draw: &mut Draw<'_>) -> MatchModel {
    let mut model = MatchModel::default();
    let MatchModel {
        noise,
        lasting,
        lasts,
        poor,
        outliers,
        deviation,
        stop,
        leave_road,
        return_to_road,
        u_turn,
    } = &mut model;
    let values = [
        noise,
        lasting,
        lasts,
        poor,
        outliers,
        deviation,
        stop,
        leave_road,
        return_to_road,
        u_turn,
    ];
    for value in values {
        if draw.one_in(5) {
            *value = draw.pick(&NUMBERS);
        }
    }
    model
}

/// Matches arbitrary points, live and as a whole drive, with any model.
pub(super) fn any_points(draw: &mut Draw<'_>, counts: &mut Counts) {
    let corner = draw.pick(&CORNERS);
    let model = model(draw);
    let matcher = match town(corner).with_model(model) {
        Ok(matcher) => matcher,
        Err(error) => {
            counts.add("models refused");
            check_message(&error);
            town(corner)
        }
    };
    let mut before = 0.0;
    let mut points =
        vec![TracePoint::new(0.0, Position { latitude: corner[0], longitude: corner[1] })];
    let lag = draw.pick(&[0, 2, usize::MAX]);
    let mut vehicle = matcher.start(&points[0], lag).expect("a good point");
    for _ in 0..=draw.below(10) {
        let point = point(draw, corner, before);
        counts.note(|| format!("{point:?} {:?}", matcher.model()));
        let (was, drive) = (vehicle.clone(), [points[points.len() - 1], point]);
        match vehicle.step(&matcher, &point) {
            Ok(log) => {
                assert!(log.is_finite(), "{log}");
                before = point.time;
                points.push(point);
                counts.add("points accepted");
            }
            Err(error) => {
                counts.add("points refused");
                check_message(&error);
                assert_eq!(vehicle, was);
                assert!(matches!(error, MatchError::Point { .. } | MatchError::Time { .. }));
                assert!(matcher.match_drive(&drive).is_err());
            }
        }
        super::vehicles::check(&vehicle, &matcher);
    }
    let drive = matcher.match_drive(&points).expect("points that were accepted");
    check(&drive);
    for route in matcher.routes(&drive, 2).expect("its drive").routes {
        assert!((0.0..=1.0).contains(&route.probability));
    }
    let fitted = matcher.learn(&[&points], 2).expect("points that were accepted");
    assert!(fitted.log_likelihood.is_finite());
    matcher.with_model(fitted.model).expect("a model that was learned");
    counts.add("drives of any points");
}
