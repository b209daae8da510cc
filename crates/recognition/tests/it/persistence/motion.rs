//! Motion along a route comes back to the bit, and errors say what is wrong.

use crate::kit::{
    assert_stored_operator as operator, check_columns, damage, json, refuses, stored,
};
use proptest::prelude::*;
use wayfix::Transition;
use wayfix_recognition::motion::{
    OdometryModel, OffMap, RouteControl, RouteTransition, Speeds, ViewChange, ViewChangeRates,
    ViewEvidence,
};

use crate::kit::cases;
use crate::motion::definition::{control, parts};

const SPEEDS: &str = r#"{"version":1,"values":[0.0,1.0],"shares":[0.5,0.5],"nearby":0.25,"anywhere":0.125,"slack":0.0625}"#;

#[test]
fn the_format_is_as_documented() {
    let speeds = Speeds::new(&[0.0, 1.0]).unwrap().with_shares(&[0.5, 0.5]).unwrap();
    let speeds = speeds.with_changes(0.25, 0.125).unwrap().with_slack(0.0625).unwrap();
    assert_eq!(json(&speeds), SPEEDS);
    assert_eq!(stored(&speeds), speeds);
    assert_eq!(stored(&Speeds::default()), Speeds::default());
    let route = RouteTransition::closed(3, speeds).unwrap();
    let odometry = OdometryModel { scale: 1.5, bias: 0.25, deviation: 0.5 };
    let route = route.with_odometry(odometry).unwrap();
    let start = format!(
        r#"{{"version":1,"places":3,"closed":true,"speeds":{SPEEDS},"odometry":{{"scale":1.5,"bias":0.25,"deviation":0.5}}"#
    );
    assert_eq!(json(&route), format!(r#"{start},"views":null,"off_map":null}}"#));
    let rates = ViewChangeRates { standing: 0.75, moved: 0.25 };
    let route = route.with_views(rates).unwrap();
    let off_map = OffMap { leave: 0.25, back: 0.5, near: 0.125, within: 2 };
    assert_eq!(
        json(&route.with_off_map(off_map).unwrap()),
        format!(
            r#"{start},"views":{{"standing":0.75,"moved":0.25}},"off_map":{{"leave":0.25,"back":0.5,"near":0.125,"within":2}}}}"#
        )
    );
    let view = Some(ViewEvidence { view: ViewChange::Unchanged, weight: 0.5 });
    assert_eq!(
        json(&RouteControl { odometry: Some(1.5), view, before: None }),
        r#"{"odometry":1.5,"view":{"view":"unchanged","weight":0.5}}"#
    );
    assert_eq!(json(&RouteControl::default()), r#"{"odometry":null,"view":null}"#);
}

#[test]
fn what_is_no_grid_of_speeds_or_route_is_refused() {
    let speeds = |from: &str, to: &str, expected: &str| {
        refuses::<Speeds>(&SPEEDS.replace(from, to), expected);
    };
    speeds("[0.0,1.0]", "[]", "a transition operator needs at least one state, found none");
    speeds(
        "[0.0,1.0]",
        "[1.0,0.0]",
        "speed 1 is 0, expected a value from -64 to 64, above the one before",
    );
    speeds(
        "[0.5,0.5]",
        "[0.5]",
        "the shares of speeds has 1 states, expected 2 to match the inner operator",
    );
    speeds("[0.5,0.5]", "[0.5,0.25]", "the sum of the shares of speeds is 0.75, expected 1");
    speeds(
        "0.25",
        "1.0",
        "the probability of another speed is 1.125, expected a value from 0 to 1",
    );
    speeds("0.0625", "-0.5", "the slack of speeds is -0.5, expected a value from 0 to 0.5");
    speeds("1,", "2,", "version 2, expected 1");
    let route = RouteTransition::open(2, Speeds::new(&[0.0]).unwrap()).unwrap();
    let route = route.with_views(ViewChangeRates::default()).unwrap();
    let text = json(&route.with_off_map(OffMap::default()).unwrap());
    let route = |from: &str, to: &str, expected: &str| {
        assert!(text.contains(from));
        refuses::<RouteTransition>(&text.replace(from, to), expected);
    };
    let places = r#""places":2"#;
    route(places, r#""places":0"#, "a transition operator needs at least one state, found none");
    route(
        places,
        r#""places":4294967295"#,
        "8589934590 states, expected at most 4294967295 (32-bit indices)",
    );
    route(
        r#""scale":1.0"#,
        r#""scale":0"#,
        "the scale of the odometry is 0, expected from 0.01 to 100",
    );
    route(
        r#""leave":0.001"#,
        r#""leave":0"#,
        "the probability of leaving the map is 0, expected from 1e-30 to 1",
    );
    route(
        r#""moved":0.05"#,
        r#""moved":1"#,
        "the probability of an unchanged view elsewhere is 1, expected a value of at least 1e-30 and below 1",
    );
    route(
        r#""within":10"#,
        r#""within":10,"far":1"#,
        "unknown field `far`, expected one of `leave`, `back`, `near`, `within`",
    );
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn routes_are_the_same_to_the_bit(parts in parts(6, 5), control in control()) {
        prop_assert_eq!(stored(&parts.speeds), parts.speeds.clone());
        operator(&parts.route(), &stored(&control));
    }

    #[test]
    fn damaged_routes_are_refused_or_valid(parts in parts(6, 5), control in control(), damage in damage()) {
        let damaged = damage.of(&json(&parts.route()));
        // A replaced number may make a valid route of millions of places.
        if let Ok(route) = serde_json::from_str::<RouteTransition>(&damaged)
            && route.states() < 100_000
        {
            check_columns(&route, &RouteControl::default())?;
            if let Ok(control) = serde_json::from_str::<RouteControl>(&damage.of(&json(&control)))
                && route.check_control(&control).is_ok()
            {
                let mut out = vec![0.0; route.states()];
                route.apply(&control, &vec![1.0; route.states()], &mut out);
                prop_assert!(out.iter().all(|p| p.is_finite() && *p >= 0.0), "{damaged}");
            }
        }
    }
}
