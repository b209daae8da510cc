//! Positions that a receiver reports.

use super::MatchError;
use crate::map::{Coordinates, Position};

/// A position of a vehicle at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TracePoint<P = Position> {
    /// Seconds since any moment, from −1e20 to 1e20.
    pub time: f64,
    /// Position that was measured.
    pub position: P,
    /// Standard deviation of this position in each direction in metres, from 1e-6 to 1e9, if the
    /// receiver tells it; else that of the [model](super::MatchModel).
    pub accuracy: Option<f64>,
    /// Direction of travel in degrees clockwise from north, if the receiver tells it.
    pub heading: Option<f64>,
    /// Speed in metres per second, from 0 to 1e9, if the receiver tells it.
    pub speed: Option<f64>,
}

impl<P: Coordinates> TracePoint<P> {
    /// Creates a point with a time and a position alone.
    #[must_use]
    pub fn new(time: f64, position: P) -> Self {
        Self { time, position, accuracy: None, heading: None, speed: None }
    }

    pub(super) fn check(&self) -> Result<(), MatchError> {
        for ((what, limit), value) in P::AXES.into_iter().zip(self.position.values()) {
            if !(-limit..=limit).contains(&value) {
                let expected = "a position on Earth, or in the plane";
                return Err(MatchError::Point { what, value, expected });
            }
        }
        let finite = |what, value: f64, valid: bool, expected| {
            if valid { Ok(()) } else { Err(MatchError::Point { what, value, expected }) }
        };
        // Far beyond what is measured, sums and densities would overflow.
        let valid = self.time.abs() <= 1e20;
        finite("time", self.time, valid, "seconds from -1e20 to 1e20")?;
        if let Some(value) = self.accuracy {
            let valid = (1e-6..=1e9).contains(&value);
            finite("accuracy", value, valid, "metres from 1e-6 to 1e9")?;
        }
        if let Some(value) = self.heading {
            finite("heading", value, value.is_finite(), "finite degrees")?;
        }
        if let Some(value) = self.speed {
            let valid = (0.0..=1e9).contains(&value);
            finite("speed", value, valid, "metres per second from 0 to 1e9")?;
        }
        Ok(())
    }
}
