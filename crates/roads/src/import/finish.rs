//! The last steps of every import, and the checks that all formats share.

use super::options::ImportOptions;
use super::report::ImportReport;
use crate::{NetworkBuilder, NetworkError, RoadNetwork};
use wayfix::internal::Number;
use wayfix::map::Position;

/// Length in metres that replaces shorter straight lines.
pub(super) const LEAST_METRES: f64 = 0.1;

/// Builds and cleans a network, and completes the report.
pub(super) fn finish(
    builder: NetworkBuilder,
    mut report: ImportReport,
    options: &ImportOptions,
) -> Result<(RoadNetwork, ImportReport), NetworkError> {
    let network = builder.build()?;
    report.nodes = network.nodes().len();
    report.edges = network.edges().len();
    report.forbidden_turns = network.forbidden_turns().len();
    let (network, cleaning) = network.cleaned(&options.cleaning)?;
    report.cleaning = cleaning;
    Ok((network, report))
}

/// Describes what is wrong with a position; `None` for one on Earth.
pub(super) fn position_problem(position: Position) -> Option<String> {
    let Position { latitude, longitude } = position;
    if latitude.abs() <= 90.0 && longitude.abs() <= 180.0 {
        return None;
    }
    // Valid if exchanged. Swapped positions whose longitude is below 90° cannot be told from right
    // ones.
    if latitude.abs() > 90.0 && latitude.abs() <= 180.0 && longitude.abs() <= 90.0 {
        let [latitude, longitude] = [latitude, longitude].map(Number);
        return Some(format!(
            "latitude {latitude} and longitude {longitude} seem to be swapped, expected degrees from -90 to 90 for the latitude"
        ));
    }
    // NaN fails every comparison, and is reported as the latitude or longitude that it is.
    let (name, value, limit) = if latitude.abs() <= 90.0 {
        ("longitude", longitude, 180)
    } else {
        ("latitude", latitude, 90)
    };
    let value = Number(value);
    Some(format!("{name} is {value}, expected degrees from -{limit} to {limit}"))
}
