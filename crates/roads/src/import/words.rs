//! Words and numbers that describe roads in files.

use crate::FASTEST_ROAD;
#[cfg(any(feature = "csv", feature = "geojson"))]
use wayfix::map::RoadClass;

/// Class of a road by its name or its number, from 0 for a street to 3 for a main road.
#[cfg(any(feature = "csv", feature = "geojson"))]
pub(super) fn class_of(text: &str) -> Result<RoadClass, String> {
    Ok(match text {
        "" | "0" => RoadClass::Street,
        "1" => RoadClass::Collector,
        "2" => RoadClass::Arterial,
        "3" => RoadClass::Main,
        word => word.parse().map_err(|error| format!("{error}, or 0 to 3"))?,
    })
}

/// Directions of a road, forward and backward; `None` for an unknown word.
pub(super) fn directions(text: &str) -> Option<[bool; 2]> {
    Some(match text {
        "yes" | "true" | "1" => [true, false],
        "-1" | "reverse" => [false, true],
        "" | "no" | "false" | "0" => [true, true],
        _ => return None,
    })
}

/// Speed in metres per second from km/h or mph; `None` for words, and for results that are not
/// above 0 and at most 1e9.
pub(super) fn speed_of(text: &str) -> Option<f64> {
    let (number, unit) = match text.trim() {
        // Walking pace. A number without a unit is in km/h.
        "walk" => ("5", 3.6),
        text => match text.strip_suffix("mph") {
            Some(miles) => (miles, 3.6 / 1.609_344),
            None => (text.strip_suffix("km/h").unwrap_or(text), 3.6),
        },
    };
    let speed = number.trim().parse::<f64>().ok()? / unit;
    (speed > 0.0 && speed <= FASTEST_ROAD).then_some(speed)
}
