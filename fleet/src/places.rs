//! A sensor of positions, where each state is a place on Earth: a Student density around each
//! place.

use std::f64::consts::PI;

use serde::{Deserialize, Serialize};
use wayfix::map::Position;
use wayfix::{Diagonal, Likelihood, LikelihoodError, Scratch};

/// Version of stored sensors, in the format of the library and in those of this crate.
pub(crate) const VERSION: u32 = 1;

/// A measured position with its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fix {
    /// Latitude in degrees, north positive.
    pub latitude: f64,
    /// Longitude in degrees, east positive.
    pub longitude: f64,
    /// Standard deviation of each coordinate, in metres, above 0.
    pub deviation: f64,
}

/// Density of a measured position around the place of each state.
///
/// A Student distribution with ν degrees of freedom, as in the library's `PositionLikelihood`, for
/// states that are points: with d the distance in metres between fix and place, and s the
/// deviation, b = (1 + d² / (ν s²))^(−(ν + 2) / 2) / (2π s²). O(n).
///
/// In a file it has the fields `version` (1), `places`, a list of [latitude, longitude], and
/// `degrees`, the ν above (3 is a good choice).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Stored", into = "Stored")]
pub struct Places {
    places: Vec<Position>,
    degrees: f64,
}

/// Places as stored in a file.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Stored {
    version: u32,
    places: Vec<[f64; 2]>,
    degrees: f64,
}

/// A value that is not a position, a deviation, or a number of degrees of freedom.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{what} is {value}, expected {expected}")]
pub struct PlaceError {
    what: String,
    value: f64,
    expected: &'static str,
}

fn check(what: &str, value: f64, limit: f64, expected: &'static str) -> Result<(), PlaceError> {
    // Also refuses NaN.
    if (-limit..=limit).contains(&value) {
        return Ok(());
    }
    Err(PlaceError { what: what.to_owned(), value, expected })
}

fn check_position(latitude: f64, longitude: f64) -> Result<(), PlaceError> {
    check("the latitude", latitude, 90.0, "degrees from -90 to 90")?;
    check("the longitude", longitude, 180.0, "degrees from -180 to 180")
}

impl Places {
    /// Creates a sensor from the place of each state and the degrees of freedom.
    ///
    /// # Errors
    ///
    /// [`PlaceError`] if a place is not on Earth, or the degrees of freedom are not between 1 and
    /// 1,000.
    pub fn new(places: Vec<Position>, degrees: f64) -> Result<Self, PlaceError> {
        places.iter().try_for_each(|place| check_position(place.latitude, place.longitude))?;
        if !(1.0..=1000.0).contains(&degrees) {
            let what = "the number of degrees of freedom".to_owned();
            return Err(PlaceError { what, value: degrees, expected: "a value from 1 to 1000" });
        }
        Ok(Self { places, degrees })
    }
}

impl TryFrom<Stored> for Places {
    type Error = String;

    fn try_from(stored: Stored) -> Result<Self, String> {
        if stored.version != VERSION {
            return Err(format!("version {} of places, expected 1", stored.version));
        }
        let place = |[latitude, longitude]: [f64; 2]| Position { latitude, longitude };
        let places = stored.places.into_iter().map(place).collect();
        Self::new(places, stored.degrees).map_err(|error| error.to_string())
    }
}

impl From<Places> for Stored {
    fn from(places: Places) -> Self {
        Self {
            version: VERSION,
            places: places.places.iter().map(|place| [place.latitude, place.longitude]).collect(),
            degrees: places.degrees,
        }
    }
}

impl Likelihood for Places {
    type Observation = Fix;

    fn states(&self) -> usize {
        self.places.len()
    }

    fn diagonal<'a>(
        &'a self,
        fix: &'a Fix,
        scratch: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        let sensor = |error: PlaceError| LikelihoodError::sensor(error);
        check_position(fix.latitude, fix.longitude).map_err(sensor)?;
        // Within these bounds the variance is a normal double, and its quotient with the largest
        // squared distance on Earth is finite.
        if !(1e-6..=1e9).contains(&fix.deviation) {
            let what = "the deviation".to_owned();
            let expected = "metres from 1e-6 to 1e9";
            return Err(sensor(PlaceError { what, value: fix.deviation, expected }));
        }
        let at = Position { latitude: fix.latitude, longitude: fix.longitude };
        let variance = fix.deviation * fix.deviation;
        let logs = scratch.values(self.places.len());
        for (log, place) in logs.iter_mut().zip(&self.places) {
            // ln b(i) up to a constant. Close to a place, where q is small, ln_1p keeps its digits.
            let metres = at.metres_to(*place);
            let q = metres * metres / variance;
            *log = -0.5 * (self.degrees + 2.0) * (q / self.degrees).ln_1p();
        }
        // The factor 1 / (2π s²), with the deviation s, is the same for all states, so it is kept
        // as a log factor. In logarithms, a fix far from every place does not underflow.
        Ok(Diagonal::log(logs).with_log_factor(-(2.0 * PI * variance).ln()))
    }
}
