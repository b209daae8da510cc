//! Vehicles as bytes.

use super::candidates::{Candidate, OFF_ROAD};
use super::{TracePoint, Vehicle};
use crate::error::SnapshotError;
use crate::inference::Trellis;
use crate::inference::streams::bytes::{Kind, Reader, Writer, contents};
use crate::map::Coordinates;

/// Types of vehicles, by the units of their coordinates.
const UNITS: [(&str, &str); 2] =
    [("degrees", "Vehicle<Position>"), ("metres", "Vehicle<PlanePosition>")];

impl<P: Coordinates> Vehicle<P> {
    /// Returns the state as bytes, in the format of
    /// [`FilterSnapshot`](crate::inference::FilterSnapshot::to_bytes): some 80 for each state of
    /// the window, and 16 for each move. Read back, a vehicle goes on to the bit, on the network on
    /// which it was started: its fingerprint is among the bytes.
    ///
    /// ```
    /// use wayfix::map::{NetworkBuilder, PlanePosition, RoadClass};
    /// use wayfix::matching::{MatchMemory, Matcher, TracePoint, Vehicle};
    ///
    /// let mut builder = NetworkBuilder::new();
    /// builder.node(1, PlanePosition { x: 0.0, y: 0.0 })?;
    /// builder.node(2, PlanePosition { x: 500.0, y: 0.0 })?;
    /// builder.both_ways(1, 2, RoadClass::Street)?;
    /// let (matcher, mut memory) = (Matcher::new(builder.build()?), MatchMemory::default());
    /// let point = |k: f64| TracePoint::new(5.0 * k, PlanePosition { x: 50.0 * k, y: 3.0 });
    ///
    /// let vehicle = matcher.start(&point(0.0), 2, &mut memory)?;
    /// let bytes = vehicle.to_bytes(); // into a file or a database
    /// let mut read = Vehicle::from_bytes(&bytes)?;
    /// assert_eq!(read, vehicle);
    /// matcher.step(&mut read, &point(1.0), &mut memory)?;
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut writer = Writer::new(Kind::Vehicle);
        writer.word(unit(P::UNIT));
        writer.word(self.network);
        writer.integer(self.lag);
        writer.integer(self.points);
        let TracePoint { time, position, accuracy, heading, speed } = self.point;
        writer.double(time);
        position.values().into_iter().for_each(|value| writer.double(value));
        [accuracy, heading, speed].into_iter().for_each(|value| optional(&mut writer, value));
        writer.double(self.speed);
        writer.log_sum(self.log_likelihood);
        writer.double(self.last);
        writer.integer(self.window.len());
        for (step, states) in (1..).zip(&self.window) {
            writer.integer(states.len());
            for (number, state) in states.iter().enumerate() {
                let Candidate { edge, along, point, across, inlier, log_likelihood } = *state;
                writer.integer(edge as usize);
                writer.double(along);
                point.into_iter().for_each(|value| writer.double(value));
                optional(&mut writer, across);
                writer.double(inlier);
                writer.double(log_likelihood);
                writer.double(self.trellis.log_likelihood(step, number));
                writer.integer(self.trellis.moves(step, number).count());
                for (from, weight) in self.trellis.moves(step, number) {
                    writer.integer(from);
                    writer.double(weight);
                }
            }
        }
        self.log_filtered.iter().for_each(|log| writer.double(*log));
        writer.finish()
    }

    /// Reads a state from bytes. O(length). [`Matcher::step`](super::Matcher::step) gives an error
    /// for a vehicle of another network.
    ///
    /// # Errors
    ///
    /// [`SnapshotError`] if the bytes are damaged, or not those of a vehicle; one with other
    /// coordinates is of another [kind](SnapshotError::Kind).
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, SnapshotError> {
        let mut reader = Reader::new(bytes, Kind::Vehicle)?;
        let found = reader.word()?;
        if found != unit(P::UNIT) {
            let name = |word| UNITS.iter().find(|entry| unit(entry.0) == word).map(|entry| entry.1);
            let found = name(found).unwrap_or("unknown");
            let expected = name(unit(P::UNIT)).unwrap_or("unknown");
            return Err(SnapshotError::Kind { found, expected });
        }
        let network = reader.word()?;
        let (lag, points) = (reader.integer()?, reader.integer()?);
        let time = reader.double()?;
        let position = P::from_values([reader.double()?, reader.double()?]);
        let accuracy = read_optional(&mut reader)?;
        let heading = read_optional(&mut reader)?;
        let speed = read_optional(&mut reader)?;
        let point = TracePoint { time, position, accuracy, heading, speed };
        point.numbers().map_err(|error| contents(error.to_string()))?;
        let speed = reader.double()?;
        if !(0.0..=1e9).contains(&speed) {
            return Err(contents(format!("the speed is {speed}, expected 0 to 1e9")));
        }
        let (log_likelihood, last) = (reader.log_sum()?, reader.double()?);
        if let Some(value) = [log_likelihood.value(), last].iter().find(|v| !v.is_finite()) {
            let problem = format!("a log-likelihood is {value}, expected a finite number");
            return Err(contents(problem));
        }
        let (mut trellis, mut window) = (Trellis::new(), Vec::new());
        let steps = reader.integer()?;
        if steps == 0 || lag.checked_add(1).is_none_or(|most| steps > most) {
            return Err(contents(format!(
                "{steps} points in the window, expected up to {lag} + 1"
            )));
        }
        if points < steps {
            return Err(contents(format!("{points} points, but {steps} in the window")));
        }
        for _ in 0..steps {
            trellis.begin_step();
            let mut states = Vec::new();
            let count = reader.integer()?;
            for number in 0..count {
                let edge = u32::try_from(reader.integer()?)
                    .map_err(|_| contents(String::from("the number of an edge is too large")))?;
                if (edge == OFF_ROAD) != (number + 1 == count) {
                    return Err(contents(String::from("the last state must be off the road")));
                }
                states.push(Candidate {
                    edge,
                    along: reader.double()?,
                    point: [reader.double()?, reader.double()?],
                    across: read_optional(&mut reader)?,
                    inlier: reader.double()?,
                    log_likelihood: reader.double()?,
                });
                let log_likelihood = reader.double()?;
                let mut moves = Vec::new();
                for _ in 0..reader.integer()? {
                    moves.push((reader.integer()?, reader.double()?));
                }
                let added = trellis.state(log_likelihood, moves);
                added.map_err(|error| contents(error.to_string()))?;
            }
            if states.is_empty() {
                return Err(contents(String::from("a point without states")));
            }
            window.push(states);
        }
        let mut log_filtered = Vec::new();
        for _ in 0..window.last().map_or(0, Vec::len) {
            log_filtered.push(reader.double()?);
        }
        reader.finish()?;
        let sum: f64 = log_filtered.iter().map(|log| log.exp()).sum();
        if !(1.0 - 1e-9..=1.0 + 1e-9).contains(&sum) {
            return Err(contents(format!("probabilities sum to {sum}, expected 1")));
        }
        window.iter().flatten().try_for_each(check)?;
        trellis.smooth().map_err(|error| contents(error.to_string()))?;
        Ok(Self {
            lag,
            points,
            point,
            speed,
            log_likelihood,
            last,
            trellis,
            window,
            log_filtered,
            network,
        })
    }
}

/// Unit of coordinates as a word: its first eight letters, which are no number of points that a
/// window may have.
fn unit(name: &str) -> u64 {
    name.bytes().take(8).fold(0, |word, letter| word << 8 | u64::from(letter))
}

/// Checks the numbers of a state. Which edges there are, the network says.
fn check(state: &Candidate) -> Result<(), SnapshotError> {
    /// More than any coordinate of the plane, or any length of an edge.
    const LARGEST: f64 = 1e12;
    let Candidate { edge: _, along, point, across, inlier, log_likelihood } = *state;
    let range = -LARGEST..=LARGEST;
    for (value, range) in [
        (along, 0.0..=LARGEST),
        (point[0], range.clone()),
        (point[1], range.clone()),
        (across.unwrap_or(0.0), range),
        (inlier, 0.0..=1.0),
        (log_likelihood, -1e300..=1e300),
    ] {
        if !range.contains(&value) {
            let problem = format!("a state has {value}, expected {range:?}");
            return Err(contents(problem));
        }
    }
    Ok(())
}

/// Writes a number that may be missing, which is NaN.
fn optional(writer: &mut Writer, value: Option<f64>) {
    writer.double(value.unwrap_or(f64::NAN));
}

fn read_optional(reader: &mut Reader<'_>) -> Result<Option<f64>, SnapshotError> {
    let value = reader.double()?;
    Ok((!value.is_nan()).then_some(value))
}
