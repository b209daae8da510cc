//! Runs of equal odometry readings, which are one witness (`guide::formulas`, Equal readings).

use super::warning::Warning;
#[cfg(feature = "serde")]
use crate::motion::OdometryModel;
use crate::motion::ViewChange;

/// Number of equal readings that count nearly in full.
const ALIKE: f64 = 5.0;
/// Largest reading of a vehicle that stands, in places.
const STANDS: f64 = 0.05;
/// Excess of changed views over unchanged ones, during equal readings of a vehicle that stands,
/// that shows motion: a vehicle that stands in traffic sees both.
const CHANGED: u32 = 20;

/// The last reading, and the run of readings equal to it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub(crate) struct Readings {
    last: Option<f64>,
    /// Number of times in a row that it was read.
    equal: u32,
    /// Recent excess of changed views over unchanged ones in the run.
    changed: u32,
}

impl Readings {
    /// Returns the reading if it counts as evidence, else `None`. Of k equal readings in a row,
    /// 5 ln(1 + k / 5) count, rounded up, since wheels that are stuck err once and not k times.
    /// One of a vehicle that stands counts in any case if the view is unchanged.
    pub(super) fn counted(&self, change: Option<ViewChange>, odometry: Option<f64>) -> Option<f64> {
        let reading = odometry?;
        let stands = reading.abs() <= STANDS && change == Some(ViewChange::Unchanged);
        let before = if odometry == self.last && !stands { self.equal } else { 0 };
        let counted = |k: f64| (ALIKE * (k / ALIKE).ln_1p()).floor();
        let before = f64::from(before);
        (before == 0.0 || counted(before + 1.0) > counted(before)).then_some(reading)
    }

    /// Takes the reading of a step, and the change of its view if there is a view before it.
    pub(super) fn record(&mut self, change: Option<ViewChange>, odometry: Option<f64>) {
        // A run ends with any other reading, and with a missing one.
        if odometry.is_none() || odometry != self.last {
            *self = Self { last: odometry, ..Self::default() };
        }
        if odometry.is_some() {
            self.equal = self.equal.saturating_add(1);
        }
        // Saturating at 0 gives the excess since its last minimum, as in a CUSUM test: long
        // standing before does not hide that the vehicle moves now.
        match change {
            Some(ViewChange::Changed) => self.changed = self.changed.saturating_add(1),
            Some(ViewChange::Unchanged) => self.changed = self.changed.saturating_sub(1),
            None => {}
        }
    }

    /// Warns if odometry reads again and again that the vehicle stands, while the views change.
    pub(super) fn warning(&self) -> Option<Warning> {
        let reading = self.last.filter(|reading| reading.abs() <= STANDS)?;
        (self.changed >= CHANGED).then_some(Warning::Stuck { reading, steps: self.equal })
    }

    /// Returns the longer of two runs that are stuck.
    pub(super) fn longer(self, other: Self) -> Self {
        if other.warning().is_some() && other.equal > self.equal { other } else { self }
    }

    /// Checks a run read from storage.
    #[cfg(feature = "serde")]
    pub(crate) fn checked(self) -> Result<Self, String> {
        match self.last {
            Some(reading) if OdometryModel::check_reading(reading).is_err() => {
                Err(format!("a last reading of {reading} places"))
            }
            _ => Ok(self),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_readings_count_less_and_less() {
        let count = |reading: f64, change, steps: u32| {
            let mut readings = Readings::default();
            let counted = (0..steps).filter(|_| {
                let counted = readings.counted(change, Some(reading)).is_some();
                readings.record(change, Some(reading));
                counted
            });
            counted.count()
        };
        let changed = Some(ViewChange::Changed);
        assert_eq!(count(1.5, changed, 3), 3);
        assert!((14..=16).contains(&count(1.5, changed, 100)));
        assert!((26..=28).contains(&count(1.5, None, 1000)));
        // A vehicle that stands is believed where the views do not change.
        assert_eq!(count(0.0, Some(ViewChange::Unchanged), 1000), 1000);
        assert!((14..=16).contains(&count(0.0, changed, 100)));
        assert!((26..=28).contains(&count(0.0, None, 1000)));
        // Other readings between them start anew.
        let mut readings = Readings::default();
        for k in 0..100_u32 {
            let reading = Some(f64::from(k % 2));
            assert_eq!(readings.counted(changed, reading), reading);
            readings.record(changed, reading);
        }
    }
}
