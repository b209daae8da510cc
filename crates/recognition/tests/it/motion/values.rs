//! Values computed by hand, and errors.

use wayfix::{Hmm, LikelihoodVector, Prior, Transition, TransitionEntries};
use wayfix_recognition::motion::{
    Driven, OdometryModel, OffMap, RouteControl, RouteTransition, Speeds, ViewChange,
    ViewChangeRates, ViewEvidence,
};

use crate::kit::text;

fn driven(places: f64) -> RouteControl {
    RouteControl { odometry: Some(places), ..RouteControl::default() }
}

fn seen(view: ViewChange, weight: f64) -> RouteControl {
    RouteControl { view: Some(ViewEvidence { view, weight }), ..RouteControl::default() }
}

fn after(mean: f64, readings: u32) -> RouteControl {
    let before = Driven { standing: 0.0, odometry: Some((mean, readings)) };
    RouteControl { before: Some(before), ..RouteControl::default() }
}

/// Standing, or one place on, on three places.
fn stop_and_go(closed: bool) -> RouteTransition {
    let speeds = Speeds::new(&[0.0, 1.0]).unwrap().with_changes(0.25, 0.0).unwrap();
    let route = if closed { RouteTransition::closed } else { RouteTransition::open };
    route(3, speeds.with_slack(0.0).unwrap()).unwrap()
}

fn column(route: &RouteTransition, u: &RouteControl, from: usize) -> Vec<(usize, f64)> {
    route.outgoing(u, from).collect()
}

#[test]
fn states_are_speeds_and_places() {
    let plain = stop_and_go(false);
    assert_eq!((plain.places(), plain.is_closed(), plain.states()), (3, false, 6));
    let route = plain.with_off_map(OffMap::default()).unwrap();
    assert_eq!(route.states(), 9);
    for state in 0..6 {
        let (speed, place) = (state / 3, state % 3);
        assert_eq!((route.speed_of(state), route.place_of(state)), (Some(speed), Some(place)));
        assert_eq!(route.index(speed, place), Some(state));
    }
    // The state off the map after leaving this place.
    assert_eq!((route.speed_of(8), route.place_of(8)), (None, Some(2)));
    assert_eq!((route.speed_of(9), route.place_of(9)), (None, None));
    assert_eq!((route.index(2, 0), route.index(0, 3)), (None, None));
    assert_eq!(route.place_groups().as_slice(), [0, 1, 2, 0, 1, 2, 3, 3, 3]);
    assert_eq!(route.speed_groups().as_slice(), [0, 0, 0, 1, 1, 1, 2, 2, 2]);
    let off: f64 = route.anywhere().as_slice()[6..].iter().sum();
    assert!((off - OffMap::default().share()).abs() < 1e-15);
}

#[test]
fn the_new_speed_moves_and_ends_stop() {
    let nothing = RouteControl::default();
    // Half of the time 1, else speeds from 0.5 to 1.5, which lead to 0, 1 or 2 places on.
    let on = [0.0625, 0.875, 0.0625];
    let close = |route: &RouteTransition, from, expected: &[(usize, f64)]| {
        let found = column(route, &nothing, from);
        assert_eq!(found.len(), expected.len(), "{found:?}");
        for (found, expected) in found.iter().zip(expected) {
            assert!(found.0 == expected.0 && (found.1 - expected.1).abs() < 1e-12, "{found:?}");
        }
    };
    let half = 0.25;
    let go = on.map(|p| half * p);
    close(&stop_and_go(false), 0, &[(0, 0.75), (3, go[0]), (4, go[1]), (5, go[2])]);
    close(&stop_and_go(false), 1, &[(1, 0.75), (4, go[0]), (5, go[1] + go[2])]);
    close(&stop_and_go(true), 1, &[(1, 0.75), (3, go[2]), (4, go[0]), (5, go[1])]);
    // A route without views ignores a view.
    let view = seen(ViewChange::Changed, 1.0);
    assert_eq!(stop_and_go(false).evidence(&view), None);
    assert_eq!(column(&stop_and_go(false), &view, 0), column(&stop_and_go(false), &nothing, 0));
}

/// Views are evidence against places, too.
#[test]
fn what_is_measured_is_not_normalised_away() {
    let rates = ViewChangeRates { standing: 0.8, moved: 0.1 };
    let route = stop_and_go(false).with_views(rates).unwrap();
    let sum = |u: &RouteControl, from| column(&route, u, from).iter().map(|e| e.1).sum::<f64>();
    let unchanged = seen(ViewChange::Unchanged, 1.0);
    assert!((route.evidence(&unchanged).unwrap() - 0.8_f64.ln()).abs() < 1e-15);
    // At the end, a vehicle that drives on is stopped, which explains no view well.
    let stays = 0.75 + 0.25 * 0.0625;
    assert!((sum(&unchanged, 2) - (stays + (1.0 - stays) * 0.1 / 0.8)).abs() < 1e-12);
    assert!(sum(&unchanged, 3) < sum(&unchanged, 0));
    // With a weight of 0, views have no influence.
    assert!((sum(&seen(ViewChange::Changed, 0.0), 4) - 1.0).abs() < 1e-12);
    // To a filter that is sure of its place, a contradiction is improbable.
    let prior = Prior::AtFirstObservation(route.anywhere());
    let hmm = Hmm::new(prior, &route, LikelihoodVector::linear(6)).unwrap();
    let mut filter = hmm.filter();
    filter.step_with(&RouteControl::default(), &[0.0, 0.0, 1.0, 0.0, 0.0, 0.0]).unwrap();
    let log = filter.step_with(&seen(ViewChange::Changed, 1.0), &[1.0; 6]).unwrap();
    assert!((log - 0.2_f64.ln()).abs() < 1e-12, "{log}");
}

#[test]
fn controls_that_are_none_are_errors_and_the_filter_stays() {
    let route = stop_and_go(false).with_views(ViewChangeRates::default()).unwrap();
    let prior = Prior::AtFirstObservation(route.anywhere());
    let hmm = Hmm::new(prior, &route, LikelihoodVector::linear(6)).unwrap();
    let mut filter = hmm.filter();
    filter.step_with(&RouteControl::default(), &[1.0; 6]).unwrap();
    let before = filter.snapshot();
    let reading =
        |value: &str| format!("an odometry of {value} places, expected a value from -1e6 to 1e6");
    let weight =
        |value: &str| format!("a view with a weight of {value}, expected a value from 0 to 1");
    for (u, expected) in [
        (driven(f64::NAN), reading("NaN")),
        (driven(f64::INFINITY), reading("inf")),
        (driven(-1.5e6), reading("-1500000")),
        (seen(ViewChange::Changed, 1.5), weight("1.5")),
        (seen(ViewChange::Changed, -0.5), weight("-0.5")),
        (seen(ViewChange::Unchanged, f64::NAN), weight("NaN")),
        (after(f64::INFINITY, 3), reading("inf")),
        (after(1.0, 0), "a mean over 0 odometry readings, expected at least 1".into()),
    ] {
        let error = route.check_control(&u).unwrap_err().to_string();
        assert_eq!(error, format!("{expected}"));
        assert!(filter.step_with(&u, &[1.0; 6]).is_err());
        assert!(filter.predict_with(&u).is_err());
        assert_eq!(filter.snapshot(), before);
    }
    // Readings that no speed explains are improbable, but not errors.
    for reading in [1e6, -1e6, 300.0] {
        filter.step_with(&driven(reading), &[1.0; 6]).unwrap();
        let sum: f64 = filter.belief().as_slice().iter().sum();
        assert!((sum - 1.0).abs() < 1e-12 && filter.log_likelihood().is_finite());
    }
}

#[test]
fn what_is_no_route_is_an_error() {
    let new = |places| text(RouteTransition::open(places, Speeds::default()));
    assert_eq!(new(0), "a transition operator needs at least one state, found none");
    assert_eq!(new(1 << 32), "68719476736 states, expected at most 4294967295 (32-bit indices)");
    assert!(RouteTransition::closed(usize::MAX, Speeds::default()).is_err());
    let route = || stop_and_go(true);
    let odometry = |scale, bias, deviation| {
        text(route().with_odometry(OdometryModel { scale, bias, deviation }))
    };
    assert_eq!(
        odometry(0.0, 0.0, 1.0),
        "the scale of the odometry is 0, expected from 0.01 to 100"
    );
    assert_eq!(
        odometry(1.0, f64::NAN, 1.0),
        "the bias of the odometry is NaN, expected from -1e6 to 1e6"
    );
    assert_eq!(
        odometry(1.0, 0.0, 0.0),
        "the deviation of the odometry is 0, expected from 0.001 to 1e6"
    );
    let rates = ViewChangeRates { standing: 0.9, moved: 0.1 };
    for (rates, expected) in [
        (ViewChangeRates { standing: 1.0, ..rates }, "standing is 1"),
        (ViewChangeRates { standing: f64::NAN, ..rates }, "standing is NaN"),
        (ViewChangeRates { moved: 0.0, ..rates }, "elsewhere is 0"),
    ] {
        let expected = format!(
            "the probability of an unchanged view {expected}, expected a value of at least 1e-30 and below 1"
        );
        assert_eq!(text(route().with_views(rates)), expected);
    }
    let off = OffMap::default();
    for (off_map, expected) in [
        (OffMap { leave: 0.0, ..off }, "the probability of leaving the map is 0"),
        (OffMap { back: 1.5, ..off }, "the probability of coming back is 1.5"),
        (OffMap { near: -0.5, ..off }, "the probability of coming back near is -0.5"),
        (OffMap { near: f64::NAN, ..off }, "the probability of coming back near is NaN"),
    ] {
        let found = text(route().with_off_map(off_map));
        assert!(found.starts_with(expected), "{found}");
    }
    assert!(route().with_off_map(OffMap { within: usize::MAX, ..off }).is_ok());
}

/// Speeds persist off the map, too.
#[test]
fn what_was_measured_before_tells_what_to_expect_off_the_map() {
    let route = RouteTransition::open(9, Speeds::default()).unwrap();
    let route = route.with_views(ViewChangeRates::default()).unwrap();
    let odometry = OdometryModel { scale: 1.0, bias: 0.0, deviation: 0.3 };
    let route = route.with_off_map(OffMap::default()).unwrap().with_odometry(odometry).unwrap();
    let stay = |u: &RouteControl| column(&route, u, 9 * 15 + 4).last().unwrap().1;
    let mut control = RouteControl::default();
    for reading in [0.9, 1.1, 1.05, 0.95] {
        control.odometry = Some(reading);
        control.before = Some(route.driven(&control));
    }
    let Some(Driven { standing, odometry: Some((mean, 4)) }) = control.before else {
        panic!("{control:?}")
    };
    assert!((mean - 1.0).abs() < 1e-12 && standing < 0.05, "{standing}");
    let with = |odometry| RouteControl { odometry: Some(odometry), ..control };
    assert!(stay(&with(1.0)) > 2.0 * stay(&RouteControl { before: None, ..with(1.0) }));
    assert!(stay(&with(1.0)) > 10.0 * stay(&with(2.5)));
    // A change of speed, and a stop.
    let mut faster = control;
    for _ in 0..6 {
        faster.odometry = Some(2.5);
        faster.before = Some(route.driven(&faster));
    }
    let Some(Driven { odometry: Some((mean_after, _)), .. }) = faster.before else {
        panic!("{faster:?}")
    };
    assert!((mean_after - 2.5).abs() < 0.5, "{mean_after}");
    let view = seen(ViewChange::Unchanged, 1.0).view;
    let mut stopped = RouteControl { odometry: None, view, before: control.before };
    // One view may be chance.
    assert!(route.driven(&stopped).standing < 0.5);
    for _ in 0..3 {
        stopped.before = Some(route.driven(&stopped));
    }
    let Some(Driven { standing, odometry: None }) = stopped.before else { panic!("{stopped:?}") };
    assert!(standing > 0.9, "{standing}");
    // And it sets off again.
    let view = seen(ViewChange::Changed, 1.0).view;
    let mut moves = RouteControl { view, ..stopped };
    for _ in 0..4 {
        moves.before = Some(route.driven(&moves));
    }
    assert!(moves.before.unwrap().standing < 0.1);
}
