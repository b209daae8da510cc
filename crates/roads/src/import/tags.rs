//! Words, numbers and tags that describe roads in files; tags are those of OpenStreetMap.

#[cfg(any(feature = "geojson", feature = "osm"))]
use super::report::{ImportNote, ImportOptions, ImportReport};
use crate::network::FASTEST_ROAD;
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

/// Properties of a drivable road.
#[cfg(any(feature = "geojson", feature = "osm"))]
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RoadTags {
    pub(super) class: RoadClass,
    pub(super) forward: bool,
    pub(super) backward: bool,
    /// Metres per second.
    pub(super) speed: Option<f64>,
    pub(super) roundabout: bool,
}

/// Road with these tags, or the reason why it is skipped.
#[cfg(any(feature = "geojson", feature = "osm"))]
pub(super) fn road_of<'a>(
    tag: impl Fn(&str) -> Option<&'a str>,
    options: &ImportOptions,
    report: &mut ImportReport,
) -> Result<RoadTags, ImportNote> {
    let highway = tag("highway").unwrap_or_default();
    // A link (a ramp) has the class of the road in its name.
    let class = match highway.strip_suffix("_link").unwrap_or(highway) {
        "motorway" | "trunk" | "primary" => RoadClass::Main,
        "secondary" => RoadClass::Arterial,
        "tertiary" => RoadClass::Collector,
        "unclassified" | "residential" | "living_street" | "road" => RoadClass::Street,
        "service" if options.service_roads => RoadClass::Street,
        "track" if options.tracks => RoadClass::Street,
        _ => return Err(ImportNote::NotDrivable),
    };
    let aisle = matches!(
        tag("service"),
        Some("parking_aisle" | "driveway" | "drive-through" | "emergency_access")
    );
    if highway == "service" && aisle && !options.parking_aisles {
        return Err(ImportNote::NotDrivable);
    }
    if tag("area") == Some("yes") {
        return Err(ImportNote::Area);
    }
    // The most specific tag decides.
    let access = ["motorcar", "motor_vehicle", "vehicle", "access"].into_iter().find_map(&tag);
    let closed = matches!(
        access,
        Some("no" | "private" | "agricultural" | "forestry" | "military" | "emergency")
    );
    if closed && !options.private_roads {
        return Err(ImportNote::Closed);
    }
    let roundabout = matches!(tag("junction"), Some("roundabout" | "circular"));
    // These are one-way without a tag that says so.
    let implied = roundabout || matches!(highway, "motorway" | "motorway_link");
    let oneway = ["oneway:motorcar", "oneway:motor_vehicle", "oneway"].into_iter().find_map(&tag);
    let [forward, backward] = match oneway.map(directions) {
        Some(Some(directions)) => directions,
        Some(None) => {
            // All other values count as two-way: "alternating", for example, is two-way with a
            // signal.
            if oneway == Some("reversible") {
                report.note(ImportNote::Reversible);
            }
            [true, true]
        }
        None => [true, !implied],
    };
    let speed = tag("maxspeed").and_then(|text| {
        let speed = speed_of(text);
        // "none" means that there is no limit: valid, but not a speed.
        if speed.is_none() && text != "none" {
            report.note(ImportNote::UnknownSpeed);
        }
        speed
    });
    Ok(RoadTags { class, forward, backward, speed, roundabout })
}
