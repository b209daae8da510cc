//! Distinct routes with their probabilities.

use proptest::prelude::*;
use wayfix::map::PlanePosition;
use wayfix::matching::{MatchMemory, Matcher, TracePoint, Vehicle};

use super::city::{Habits, at, city, drive};
use crate::kit::cases_of;

proptest! {
    #![proptest_config(cases_of(150))]

    /// All routes of a short drive, on a small network: certain together.
    #[test]
    fn probabilities_sum_to_one(
        seed in any::<u64>(), points in 1..4_usize, seconds in 2.0..15.0, sigma in 2.0..15.0,
    ) {
        let network = city(4, 3, 150.0, |_, _| false);
        let habits = Habits { points, seconds, sigma, ..Habits::default() };
        let points = drive(&network, &habits, seed).points;
        let matcher = Matcher::new(network);
        let mut memory = MatchMemory::default();
        let matched = matcher.match_drive(&points, &mut memory).unwrap();
        let all = matcher.routes(&matched, 2000, &mut memory).unwrap();
        let sum: f64 = all.iter().map(|route| route.probability).sum();
        // A way of the same length by other edges counts too: blocks are equal here.
        prop_assert!((sum - 1.0).abs() < 0.02, "{sum}: {all:?}");
        prop_assert!(all.windows(2).all(|pair| pair[0].probability >= pair[1].probability));
        let few = matcher.routes(&matched, 3, &mut memory).unwrap();
        prop_assert_eq!(few.len(), all.len().min(3));
        prop_assert!(matcher.routes(&matched, 0, &mut memory).unwrap().is_empty());
    }

    /// Stored at any point, a vehicle goes on to the bit; damaged bytes are an error, or a vehicle
    /// that takes the next point without a panic.
    #[test]
    fn vehicles_as_bytes(
        seed in any::<u64>(), lag in 0..4_usize, stored_at in 0..20_usize,
        damage in proptest::collection::vec((any::<proptest::sample::Index>(), any::<u8>()), 1..4),
    ) {
        let network = city(6, 6, 120.0, |_, _| false);
        let habits = Habits { points: 25, outliers: 0.1, ..Habits::default() };
        let points = drive(&network, &habits, seed).points;
        let matcher = Matcher::new(network);
        let mut memory = MatchMemory::default();
        let mut vehicle = matcher.start(&points[0], lag, &mut memory).unwrap();
        for point in &points[1..=stored_at] {
            matcher.step(&mut vehicle, point, &mut memory).unwrap();
        }
        let bytes = vehicle.to_bytes();
        let mut other: Vehicle<PlanePosition> = Vehicle::from_bytes(&bytes).unwrap();
        prop_assert_eq!(other.to_bytes(), bytes.clone());
        for point in &points[stored_at + 1..] {
            let logs = [&mut vehicle, &mut other]
                .map(|vehicle| matcher.step(vehicle, point, &mut memory).unwrap());
            prop_assert_eq!(logs[0], logs[1]);
            prop_assert_eq!(vehicle.live(), other.live());
            prop_assert_eq!(vehicle.late(), other.late());
        }
        let mut damaged = bytes;
        for (at, value) in damage {
            let at = at.index(damaged.len());
            damaged[at] = value;
        }
        if let Ok(mut vehicle) = Vehicle::from_bytes(&damaged) {
            let next = TracePoint::new(1e6, at(100.0, 100.0));
            if let Ok(log) = matcher.step(&mut vehicle, &next, &mut memory) {
                prop_assert!(log.is_finite());
            }
        }
    }
}
