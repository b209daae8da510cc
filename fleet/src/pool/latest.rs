//! The latest time, robust against single clocks that are far ahead.
//!
//! The latest time is the m-th largest of the vehicles' largest times, for a given m. Only vehicles
//! beyond it matter for the next value, and there are fewer than m of them, so they are all that is
//! kept.

use serde::{Deserialize, Serialize};

use super::VehicleId;

/// The largest time that at least m vehicles have reached. It never decreases.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub(super) struct Latest {
    time: Option<i64>,
    /// The vehicles beyond it with their times: fewer than m.
    ahead: Vec<(VehicleId, i64)>,
}

impl Latest {
    /// Latest time of updates about which nothing else is known.
    pub(super) fn at(time: Option<i64>) -> Self {
        Self { time, ahead: Vec::new() }
    }

    pub(super) fn time(&self) -> Option<i64> {
        self.time
    }

    /// Takes the time of an update; m is `vehicles`.
    pub(super) fn see(&mut self, vehicle: &VehicleId, time: i64, vehicles: usize) {
        if self.time.is_some_and(|latest| time <= latest) {
            return;
        }
        // The usual case m = 1 needs no list.
        if vehicles <= 1 && self.ahead.is_empty() {
            self.time = Some(time);
            return;
        }
        match self.ahead.iter_mut().find(|(other, _)| other == vehicle) {
            Some((_, last)) => *last = time.max(*last),
            None => self.ahead.push((vehicle.clone(), time)),
        }
        // The loop runs more than once only if m is smaller than in an earlier run.
        while self.ahead.len() >= vehicles.max(1) {
            // All in the list, at least m vehicles, have reached the smallest of their times.
            self.time = self.ahead.iter().map(|(_, time)| *time).min();
            self.ahead.retain(|(_, time)| Some(*time) > self.time);
        }
    }

    /// Stops counting a vehicle.
    pub(super) fn remove(&mut self, vehicle: &VehicleId) {
        self.ahead.retain(|(other, _)| other != vehicle);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_the_largest_time_of_so_many_vehicles() {
        let mut random = 1_u64;
        let mut next = |below: u64| {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (random >> 33) % below
        };
        for vehicles in 1..5 {
            let (mut latest, mut largest) = (Latest::default(), [i64::MIN; 7]);
            for step in 0..2000 {
                let vehicle = next(7);
                let time = step + next(30) as i64;
                let last = &mut largest[vehicle as usize];
                *last = time.max(*last);
                latest.see(&(vehicle as i64).into(), time, vehicles);
                let mut sorted = largest;
                sorted.sort_unstable();
                let expected = Some(sorted[7 - vehicles]).filter(|&time| time > i64::MIN);
                assert_eq!(latest.time(), expected, "{vehicles} vehicles, step {step}");
                assert!(latest.ahead.len() < vehicles);
            }
        }
    }

    #[test]
    fn a_vehicle_that_is_removed_does_not_count() {
        let mut latest = Latest::default();
        latest.see(&1.into(), 1000, 2);
        latest.remove(&1.into());
        latest.see(&2.into(), 10, 2);
        assert_eq!(latest.time(), None);
        latest.see(&3.into(), 12, 2);
        assert_eq!(latest.time(), Some(10));
    }
}
