//! Positions that a receiver reports, and the ranges of their numbers.

use std::fmt;

use super::MatchError;
use wayfix::internal::Number;
use wayfix::map::{Coordinates, Position};

/// A position of a vehicle at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TracePoint<P = Position> {
    /// Time in seconds since any fixed moment, from −1e20 to 1e20.
    pub time: f64,
    /// Measured position.
    pub position: P,
    /// Standard deviation of this position in each direction in metres, from 1e-6 to 1e9, if the
    /// receiver reports it; otherwise that of the [model](super::MatchModel).
    pub accuracy: Option<f64>,
    /// Direction of travel in degrees clockwise from north, from −180 to 360, if the receiver
    /// reports it: both −90 and 270 are west.
    pub heading: Option<f64>,
    /// Speed in metres per second, from 0 to 1e9, if the receiver reports it.
    pub speed: Option<f64>,
}

impl<P: Coordinates> TracePoint<P> {
    /// Creates a point with a time and a position alone.
    #[must_use]
    pub fn new(time: f64, position: P) -> Self {
        Self { time, position, accuracy: None, heading: None, speed: None }
    }

    /// Checks a point, given its index in the drive and the point before.
    pub(super) fn check(&self, point: usize, before: Option<&Self>) -> Result<(), MatchError> {
        self.numbers().map_err(|InvalidNumber { what, value, expected }| MatchError::Point {
            point,
            what,
            value,
            expected,
        })?;
        match before {
            Some(before) if self.time <= before.time => {
                Err(MatchError::Time { point, time: self.time, before: before.time })
            }
            _ => Ok(()),
        }
    }

    /// Checks the ranges of all numbers; NaN is in none.
    pub(super) fn numbers(&self) -> Result<(), InvalidNumber> {
        let [a, b] = self.position.values();
        let [(_, limit_a), (_, limit_b)] = P::AXES;
        // Out of range as given, but in range with latitude and longitude exchanged: the usual
        // mistake.
        let swapped = a.abs() > limit_a && a.abs() <= limit_b && b.abs() <= limit_a;
        for ((what, limit), value) in P::AXES.into_iter().zip([a, b]) {
            if !(-limit..=limit).contains(&value) {
                let expected = match what {
                    "latitude" if swapped => {
                        "a latitude from -90 to 90 degrees (are longitude and latitude swapped?)"
                    }
                    "latitude" => "a latitude from -90 to 90 degrees",
                    "longitude" => "a longitude from -180 to 180 degrees",
                    _ => "metres from -1e9 to 1e9",
                };
                return Err(InvalidNumber { what, value, expected });
            }
        }
        let check = |what, value: Option<f64>, [least, most]: [f64; 2], expected| match value {
            Some(value) if !(least..=most).contains(&value) => {
                Err(InvalidNumber { what, value, expected })
            }
            _ => Ok(()),
        };
        // Limits far beyond anything measured, within which no sum or density overflows.
        check("time", Some(self.time), [-1e20, 1e20], "seconds from -1e20 to 1e20")?;
        check("accuracy", self.accuracy, [1e-6, 1e9], "metres from 1e-6 to 1e9")?;
        check("heading", self.heading, [-180.0, 360.0], "degrees from -180 to 360")?;
        check("speed", self.speed, [0.0, 1e9], "metres per second from 0 to 1e9")
    }
}

/// A number of a point that is out of range.
#[derive(Debug)]
pub(super) struct InvalidNumber {
    what: &'static str,
    value: f64,
    expected: &'static str,
}

impl fmt::Display for InvalidNumber {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { what, value, expected } = self;
        write!(f, "the point has {what} {}, expected {expected}", Number(*value))
    }
}
