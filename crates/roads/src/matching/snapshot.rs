//! Vehicles as bytes: the unit of their coordinates, then their fields in order of declaration.
//!
//! What is read may have been changed, so every number is checked before a vehicle exists: ranges
//! of the state, means and covariances, probabilities that sum to one, and a trellis that can be
//! smoothed. Only whether its edges exist is left to the matcher, which knows the network.

use super::candidates::Candidate;
use super::receiver::{ByReception, Place};
use super::vehicle::{Progress, Window};
use super::{TracePoint, Vehicle};
use wayfix::inference::{SnapshotError, Trellis};
use wayfix::internal::LogSum;
use wayfix::internal::bytes::{Kind, Reader, Writer, contents};
use wayfix::map::Coordinates;

/// Types of vehicles by the units of their coordinates.
const UNITS: [(&str, &str); 2] =
    [("degrees", "Vehicle<Position>"), ("metres", "Vehicle<PlanePosition>")];

/// A value that can be written as bytes.
trait Stored: Sized {
    fn write(&self, writer: &mut Writer);
    fn read(reader: &mut Reader<'_>) -> Result<Self, SnapshotError>;
}

/// Implements [`Stored`] for numbers of eight bytes each.
macro_rules! stored_numbers {
    ($($type:ty: |$value:ident, $out:ident| $write:expr, |$from:ident| $read:expr;)*) => {$(
        impl Stored for $type {
            fn write(&self, $out: &mut Writer) {
                let $value = self;
                $write
            }

            fn read($from: &mut Reader<'_>) -> Result<Self, SnapshotError> {
                $read
            }
        }
    )*};
}

/// Implements [`Stored`] for structs, field by field.
macro_rules! stored_fields {
    ($name:ident $(<$p:ident>)? { $($field:ident),* }) => {
        impl$(<$p: Coordinates>)? Stored for $name$(<$p>)? {
            fn write(&self, writer: &mut Writer) {
                let Self { $($field),* } = self;
                $($field.write(writer);)*
            }

            fn read(reader: &mut Reader<'_>) -> Result<Self, SnapshotError> {
                $(let $field = Stored::read(reader)?;)*
                Ok(Self { $($field),* })
            }
        }
    };
}

stored_numbers! {
    u64: |value, out| out.word(*value), |from| from.word();
    usize: |value, out| out.integer(*value), |from| from.integer();
    f64: |value, out| out.double(*value), |from| from.double();
    LogSum: |value, out| out.log_sum(*value), |from| from.log_sum();
    // A missing number is stored as NaN, which no valid point contains.
    Option<f64>: |value, out| out.double(value.unwrap_or(f64::NAN)),
        |from| from.double().map(|value| (!value.is_nan()).then_some(value));
    // Index of an edge.
    u32: |value, out| out.integer(*value as usize),
        |from| Self::try_from(from.integer()?)
            .map_err(|_| contents(String::from("the number of an edge is too large")));
}

impl<const N: usize> Stored for [ByReception; N] {
    fn write(&self, writer: &mut Writer) {
        self.iter().for_each(|values| values.write(writer));
    }

    fn read(reader: &mut Reader<'_>) -> Result<Self, SnapshotError> {
        let mut values = [ByReception::default(); N];
        for values in &mut values {
            *values = Stored::read(reader)?;
        }
        Ok(values)
    }
}

impl<const N: usize> Stored for [f64; N] {
    fn write(&self, writer: &mut Writer) {
        self.iter().for_each(|value| writer.double(*value));
    }

    fn read(reader: &mut Reader<'_>) -> Result<Self, SnapshotError> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = reader.double()?;
        }
        Ok(values)
    }
}

stored_fields!(Progress<P> { network, lag, points, point, speed, p_stationary, log_likelihood, last });
stored_fields!(Place { mean, covariance, shares });
stored_fields!(Candidate { edge, along, point, place, inlier });

impl<P: Coordinates> Stored for TracePoint<P> {
    fn write(&self, writer: &mut Writer) {
        let Self { time, position, accuracy, heading, speed } = self;
        time.write(writer);
        position.values().write(writer);
        [accuracy, heading, speed].into_iter().for_each(|value| value.write(writer));
    }

    fn read(reader: &mut Reader<'_>) -> Result<Self, SnapshotError> {
        let (time, position) = (reader.double()?, P::from_values(Stored::read(reader)?));
        let [accuracy, heading, speed] =
            [Stored::read(reader)?, Stored::read(reader)?, Stored::read(reader)?];
        let point = Self { time, position, accuracy, heading, speed };
        point.numbers().map_err(|error| contents(error.to_string()))?;
        Ok(point)
    }
}

impl Stored for Window {
    fn write(&self, writer: &mut Writer) {
        writer.integer(self.states.len());
        for (step, states) in (1..).zip(&self.states) {
            writer.integer(states.len());
            for (number, state) in states.iter().enumerate() {
                state.write(writer);
                writer.double(self.trellis.log_likelihood(step, number));
                writer.integer(self.trellis.moves(step, number).count());
                for (from, weight) in self.trellis.moves(step, number) {
                    writer.integer(from);
                    writer.double(weight);
                }
            }
        }
        self.log_filtered.iter().for_each(|log| writer.double(*log));
    }

    fn read(reader: &mut Reader<'_>) -> Result<Self, SnapshotError> {
        // Counts that were read never size an allocation: with a wrong one, the reader runs out of
        // bytes first.
        let (mut trellis, mut window) = (Trellis::new(), Vec::new());
        for _ in 0..reader.integer()? {
            trellis.begin_step();
            let mut states = Vec::new();
            let count = reader.integer()?;
            for number in 0..count {
                let state = Candidate::read(reader)?;
                if state.is_off_road() != (number + 1 == count) {
                    return Err(contents(String::from("the last state must be off the road")));
                }
                states.push(state);
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
        Ok(Self { trellis, states: window, log_filtered })
    }
}

impl<P: Coordinates> Vehicle<P> {
    /// Returns the state as bytes, in the format of
    /// [`FilterSnapshot`](wayfix::inference::FilterSnapshot::to_bytes): some 300 for each state of
    /// the window, and 16 for each move. A vehicle that is read back continues exactly, to the bit,
    /// on the network where it was started; the bytes contain its fingerprint.
    ///
    /// ```
    /// use wayfix_roads::NetworkBuilder;
    /// use wayfix::map::{PlanePosition, RoadClass};
    /// use wayfix_roads::matching::{Matcher, TracePoint, Vehicle};
    ///
    /// let mut builder = NetworkBuilder::new();
    /// builder.node(1, PlanePosition { x: 0.0, y: 0.0 })?;
    /// builder.node(2, PlanePosition { x: 500.0, y: 0.0 })?;
    /// builder.both_ways(1, 2, RoadClass::Street)?;
    /// let matcher = Matcher::new(builder.build()?);
    /// let point = |k: f64| TracePoint::new(5.0 * k, PlanePosition { x: 50.0 * k, y: 3.0 });
    ///
    /// let vehicle = matcher.start(&point(0.0), 2)?;
    /// let bytes = vehicle.to_bytes(); // into a file or a database
    /// let mut read = Vehicle::from_bytes(&bytes)?;
    /// assert_eq!(read, vehicle);
    /// matcher.step(&mut read, &point(1.0))?;
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut writer = Writer::new(Kind::Vehicle);
        writer.word(unit(P::UNIT));
        self.progress.write(&mut writer);
        self.window.write(&mut writer);
        writer.finish()
    }

    /// Reads a state from bytes. O(length). [`Matcher::step`](super::Matcher::step) returns an
    /// error for a vehicle of another network.
    ///
    /// # Errors
    ///
    /// [`SnapshotError`] if the bytes are damaged or not those of a vehicle; a vehicle with other
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
        let progress = Progress::read(&mut reader)?;
        let Progress { lag, points, speed, p_stationary, log_likelihood, last, .. } = progress;
        if !(0.0..=1.0).contains(&p_stationary) {
            return Err(contents(format!(
                "the probability of a stop is {p_stationary}, expected 0 to 1"
            )));
        }
        if !(0.0..=1e9).contains(&speed) {
            return Err(contents(format!("the speed is {speed}, expected 0 to 1e9")));
        }
        if let Some(value) = [log_likelihood.value(), last].iter().find(|v| !v.is_finite()) {
            let problem = format!("a log-likelihood is {value}, expected a finite number");
            return Err(contents(problem));
        }
        let window = Window::read(&mut reader)?;
        reader.finish()?;
        let steps = window.states.len();
        if steps == 0 || lag.checked_add(1).is_none_or(|most| steps > most) {
            return Err(contents(format!(
                "{steps} points in the window, expected up to {lag} + 1"
            )));
        }
        if points < steps {
            return Err(contents(format!("{points} points, but {steps} in the window")));
        }
        // The next step takes this for a distribution and does not normalise it.
        let sum: f64 = window.log_filtered.iter().map(|log| log.exp()).sum();
        if !(1.0 - 1e-9..=1.0 + 1e-9).contains(&sum) {
            return Err(contents(format!("probabilities sum to {sum}, expected 1")));
        }
        window.states.iter().flatten().try_for_each(check)?;
        // Late answers smooth the window, and must not fail later on what was accepted here.
        window.trellis.smooth().map_err(|error| contents(error.to_string()))?;
        Ok(Self { progress, window })
    }
}

/// Unit of coordinates as a word made of its first eight letters.
fn unit(name: &str) -> u64 {
    name.bytes().take(8).fold(0, |word, letter| word << 8 | u64::from(letter))
}

/// Checks the numbers of a state. Whether its edge exists is up to the network.
fn check(state: &Candidate) -> Result<(), SnapshotError> {
    /// Bound on all coordinates of the plane and lengths of edges.
    const LARGEST: f64 = 1e12;
    /// Tolerance for rounding in sums and products.
    const ROUNDING: f64 = 1e-9;
    let Candidate { edge: _, along, point, place: Place { mean, covariance, shares }, inlier } =
        *state;
    let range = |most: f64| -most..=most;
    let mut numbers = vec![
        ("metres along", along, 0.0..=LARGEST),
        ("probability of the road", inlier, 0.0..=1.0),
    ];
    numbers.extend(point.map(|value| ("coordinate", value, range(LARGEST))));
    let [xx, xy, xz, yy, yz, zz] = covariance;
    for value in mean.as_flattened() {
        numbers.push(("mean", *value, range(LARGEST)));
    }
    for value in [xx, yy, zz].as_flattened() {
        numbers.push(("variance", *value, 0.0..=LARGEST * LARGEST));
    }
    for (covariances, a, b) in [(xy, xx, yy), (xz, xx, zz), (yz, yy, zz)] {
        for ((covariance, a), b) in covariances.into_iter().zip(a).zip(b) {
            // |cov(a, b)| ≤ √(var a · var b), as `Place::rounded` left it.
            let most = (a * b).max(0.0).sqrt() * (1.0 + ROUNDING);
            numbers.push(("covariance", covariance, range(most)));
        }
    }
    numbers.extend(shares.map(|share| ("probability", share, 0.0..=1.0 + ROUNDING)));
    // The state off the road has no place.
    let total = if state.is_off_road() { 0.0 } else { 1.0 };
    let sum = shares.iter().sum();
    numbers.push(("sum of probabilities", sum, total - ROUNDING..=total + ROUNDING));
    for (what, value, range) in numbers {
        if !range.contains(&value) {
            let problem = format!("a state has the {what} {value}, expected {range:?}");
            return Err(contents(problem));
        }
    }
    Ok(())
}
