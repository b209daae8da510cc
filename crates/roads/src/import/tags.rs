//! Meaning of the tags of roads, as defined by OpenStreetMap.

use super::options::ImportOptions;
use super::report::{ImportNote, ImportReport};
use super::words::{directions, speed_of};
use wayfix::map::RoadClass;

/// Properties of a drivable road.
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
    // One-way without saying so.
    let implied = roundabout || matches!(highway, "motorway" | "motorway_link");
    let oneway = ["oneway:motorcar", "oneway:motor_vehicle", "oneway"].into_iter().find_map(&tag);
    let [forward, backward] = match oneway.map(directions) {
        Some(Some(directions)) => directions,
        Some(None) => {
            // Of the other values, "alternating" is two-way with a signal.
            if oneway == Some("reversible") {
                report.note(ImportNote::Reversible);
            }
            [true, true]
        }
        None => [true, !implied],
    };
    let speed = tag("maxspeed").and_then(|text| {
        let speed = speed_of(text);
        // "none" is a road without a limit: valid, and no speed to learn from.
        if speed.is_none() && text != "none" {
            report.note(ImportNote::UnknownSpeed);
        }
        speed
    });
    Ok(RoadTags { class, forward, backward, speed, roundabout })
}
