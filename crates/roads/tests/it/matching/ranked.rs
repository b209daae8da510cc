//! Distinct routes with their probabilities.

use proptest::prelude::*;
#[cfg(feature = "serde")]
use wayfix::map::PlanePosition;
use wayfix_roads::matching::Matcher;
#[cfg(feature = "serde")]
use wayfix_roads::matching::{TracePoint, Vehicle};

use super::city::{Scenario, at, city, points};
use crate::kit::cases_of;

proptest! {
    #![proptest_config(cases_of(150))]

    /// All routes of a short drive on a small network have a total probability of one.
    #[test]
    fn probabilities_sum_to_one(
        seed in any::<u64>(), count in 1..4_usize, seconds in 2.0..15.0, sigma in 2.0..15.0,
    ) {
        let network = city(4, 3, 150.0, |_, _| false);
        let scenario = Scenario { noise: sigma, every: seconds, gaps: 0.0, ..Scenario::default() };
        let points = points(&network, &scenario, count, seed);
        let matcher = Matcher::new(network);
        let matched = matcher.match_drive(&points).unwrap();
        let all = matcher.routes(&matched, 2000).unwrap();
        prop_assert!(all.is_exact);
        let sum: f64 = all.routes.iter().map(|route| route.probability).sum();
        prop_assert!((sum + all.remaining - 1.0).abs() < 1e-9, "{sum}: {all:?}");
        prop_assert!(all.remaining < 1e-6, "{}", all.remaining);
        let few = matcher.routes(&matched, 3).unwrap();
        prop_assert!(few.is_exact);
        prop_assert_eq!(few.routes.len(), all.routes.len().min(3));
        let none = matcher.routes(&matched, 0).unwrap();
        prop_assert_eq!((none.routes.len(), none.remaining), (0, 1.0));
    }

    /// The requested number of distinct routes, without stretches of length 0.
    #[test]
    fn routes_of_drives(seed in any::<u64>(), seconds in 1.0..20.0, sigma in 2.0..15.0) {
        let network = city(8, 8, 120.0, |_, _| false);
        let scenario = Scenario { noise: sigma, every: seconds, ..Scenario::default() };
        let points = points(&network, &scenario, 60, seed);
        let matcher = Matcher::new(network);
        let matched = matcher.match_drive(&points).unwrap();
        let found = matcher.routes(&matched, 5).unwrap();
        prop_assert!(found.is_exact);
        prop_assert_eq!(found.routes.len(), 5);
        prop_assert!(found.routes.is_sorted_by(|a, b| a.probability >= b.probability));
        let mut distinct = std::collections::BTreeSet::new();
        for stretches in found.routes.iter().map(|route| &route.stretches[..]).chain([matched.route()]) {
            distinct.insert(stretches.iter().map(|stretch| stretch.edge).collect::<Vec<_>>());
            for stretch in stretches {
                let is_short = stretch.edge.is_some() && stretch.exit <= stretch.enter;
                prop_assert!(!is_short || stretches.len() == 1, "{stretches:?}");
            }
        }
        prop_assert!(distinct.len() == 5 || distinct.len() == 6);
    }

    /// A vehicle that is stored at any point continues with the same bits; damaged bytes are an
    /// error, or a vehicle that takes the next point without a panic.
    #[cfg(feature = "serde")]
    #[test]
    fn stored_vehicles(
        seed in any::<u64>(), lag in 0..4_usize, stored_at in any::<proptest::sample::Index>(),
        damage in proptest::collection::vec((any::<proptest::sample::Index>(), any::<u8>()), 1..4),
    ) {
        let network = city(6, 6, 120.0, |_, _| false);
        let scenario = Scenario { outliers: 0.1, ..Scenario::default() };
        let points = points(&network, &scenario, 25, seed);
        let stored_at = stored_at.index(points.len());
        let matcher = Matcher::new(network);
        let mut vehicle = matcher.start(&points[0], lag).unwrap();
        for point in &points[1..=stored_at] {
            vehicle.step(&matcher, point).unwrap();
        }
        let bytes = postcard::to_stdvec(&vehicle).unwrap();
        let mut other: Vehicle<PlanePosition> = postcard::from_bytes(&bytes).unwrap();
        prop_assert_eq!(postcard::to_stdvec(&other).unwrap(), bytes.clone());
        let text = serde_json::to_string(&vehicle).unwrap();
        let from_text: Vehicle<PlanePosition> = serde_json::from_str(&text).unwrap();
        prop_assert_eq!(&from_text, &vehicle);
        for point in &points[stored_at + 1..] {
            let logs = [&mut vehicle, &mut other]
                .map(|vehicle| vehicle.step(&matcher, point).unwrap());
            prop_assert_eq!(logs[0], logs[1]);
            prop_assert_eq!(vehicle.live(), other.live());
            prop_assert_eq!(vehicle.late(), other.late());
        }
        let mut damaged = bytes;
        for (at, value) in damage {
            let at = at.index(damaged.len());
            damaged[at] = value;
        }
        if let Ok(mut vehicle) = postcard::from_bytes::<Vehicle<PlanePosition>>(&damaged) {
            let next = TracePoint::new(1e6, at(100.0, 100.0));
            if let Ok(log) = vehicle.step(&matcher, &next) {
                prop_assert!(log.is_finite());
            }
        }
    }
}
