//! Documented properties of simulated drives.

use super::city::{Drive, Network, ON_ROADS, Scenario, city, drive};

fn network() -> Network {
    city(30, 30, 100.0, |_, _| false)
}

fn drives(network: &Network, scenario: &Scenario) -> Vec<Drive> {
    (0..100).map(|seed| drive(network, scenario, seed)).collect()
}

/// Points are at the true positions up to noise, and routes are continuous.
#[test]
fn routes_pass_their_points() {
    let network = network();
    let scenario = Scenario { noise: 1e-3, outliers: 0.0, ..Scenario::default() };
    for drive in drives(&network, &scenario) {
        assert_eq!(drive.points.len(), drive.truth.len());
        for (point, truth) in drive.points.iter().zip(&drive.truth) {
            let off = if let Some((edge, along)) = *truth {
                network.position_along(edge, along).metres_to(point.position)
            } else {
                // At most 60 m from the road, and 30 m along it.
                let gate = drive.route.iter().find(|part| part.edge.is_none()).unwrap().ends[0];
                (gate.metres_to(point.position) - 60.0_f64.hypot(30.0)).max(0.0)
            };
            assert!(off < 0.05, "{point:?}: {truth:?}");
        }
        for pair in drive.route.windows(2) {
            assert!(pair[0].ends[1].metres_to(pair[1].ends[0]) < 1e-6, "{pair:?}");
            assert!(pair[0].exit >= pair[0].enter, "{pair:?}");
            if let (Some(edge), Some(next)) = (pair[0].edge, pair[1].edge) {
                let turns = network.reverse(edge) == Some(next);
                assert!(turns || network.next(edge).any(|other| other == next), "{pair:?}");
            }
        }
        // Each part that has a point is in the route, in order.
        let mut route = drive.route.iter();
        for truth in &drive.truth {
            let edge = truth.map(|(edge, _)| edge);
            let here = route.clone().find(|part| part.edge == edge);
            assert!(here.is_some(), "{truth:?}");
            while route.as_slice()[0].edge != edge {
                route.next();
            }
        }
    }
}

/// Gaps, stops and the like are as frequent as documented, and absent by default.
#[test]
fn shares_are_as_said() {
    let network = network();
    let is_lost = |drive: &Drive| {
        drive.points.windows(2).any(|pair| pair[1].time - pair[0].time > 5.0 + 1e-9)
    };
    let parks = |drive: &Drive| drive.route.iter().any(|part| part.edge.is_none());
    let turns = |drive: &Drive| {
        let is_turn = |pair: &[wayfix_roads::matching::Stretch<_>]| {
            let back = pair[0].edge.and_then(|edge| network.reverse(edge));
            back.is_some() && back == pair[1].edge
        };
        drive.route.windows(2).any(is_turn)
    };
    for (scenario, [lost, parked, turned]) in [
        (ON_ROADS, [0, 0, 0]),
        // Half of the gaps are due to poor reception, and a few are longer than the drive.
        (Scenario { gaps: 1.0, ..ON_ROADS }, [50, 0, 0]),
        (Scenario { car_parks: 1.0, ..ON_ROADS }, [0, 100, 0]),
        // One-way streets have no U-turns; the first and the last street are dead ends.
        (Scenario { u_turns: 1.0, ..ON_ROADS }, [0, 0, 100]),
    ] {
        let drives = drives(&network, &scenario);
        let count = |is: &dyn Fn(&Drive) -> bool| drives.iter().filter(|drive| is(drive)).count();
        for (found, said) in
            [count(&is_lost), count(&parks), count(&turns)].into_iter().zip([lost, parked, turned])
        {
            assert!(
                found.abs_diff(said) <= if said == 0 { 0 } else { 20 },
                "{found}: {scenario:?}"
            );
        }
    }
}
