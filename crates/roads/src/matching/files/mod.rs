//! Drives from files: GPX, GeoJSON or CSV, by the extension of the name.

mod collect;
#[cfg(feature = "csv")]
mod csv;
#[cfg(feature = "geojson")]
mod geojson;
#[cfg(feature = "gpx")]
mod gpx;
mod time;

use std::io::Read;
use std::path::Path;

use crate::NetworkError;
pub use collect::{Trace, TraceReport};
use wayfix::internal::open;

/// Reads drives from a file: GPX (`.gpx`), GeoJSON (`.geojson`, `.json`), or CSV (any other).
///
/// - **CSV** has the header `trace,time,longitude,latitude[,accuracy,heading,speed]`, with its
///   columns in any order: the name of the drive, the time, degrees, and, if known, metres, degrees
///   clockwise from north (from −180 to 360) and metres per second. The lines of a drive follow
///   each other.
/// - **GPX**: each segment of a track is a drive, named after the track or by its number, with a
///   number appended where drives share a name. Each point has a time, and may have `speed` and
///   `course`, as elements of its own or among its extensions. Waypoints and routes are not read.
/// - **GeoJSON**: a line is a drive. Its name is in `trace` or `name`, or else is the number of its
///   feature; a list of its times is in `coordTimes` or `times`, among its properties or in
///   `coordinateProperties`. A `MultiLineString` is a drive for each line, with a list of times for
///   each. Points belong to the drive that their `trace` names, or all to one; they have a `time`
///   or `timestamp`, and, if known, `accuracy`, `heading` or `course`, and `speed`.
///
/// Times are seconds, or dates and times in ISO 8601 (`2024-05-01T12:00:00Z`, `2024-05-01
/// 14:00:00.5+02:00`; UTC without an offset), read as seconds since 1970. Points that are not later
/// than the last one kept are skipped, and counted per drive and in total; the report names the
/// lines of the first ten, and unknown columns. A GPX or GeoJSON file is read into memory as a
/// whole: O(bytes).
///
/// # Errors
///
/// [`NetworkError::Read`] if the file cannot be opened or read, or the feature for its format
/// (`csv`, `gpx`, `geojson`) is not enabled; otherwise [`NetworkError::Line`] with file and line,
/// or [`NetworkError::Feature`] with the feature of GeoJSON, for a missing column, attribute or
/// property, a value that cannot be parsed or is out of range, a drive whose points are not
/// contiguous or mostly go back in time, text not in the format, and a file without points.
pub fn read_traces(path: impl AsRef<Path>) -> Result<(Vec<Trace>, TraceReport), NetworkError> {
    let (name, file) = open(path.as_ref())?;
    read_traces_from(&name, file)
}

/// Reads drives from a reader, as [`read_traces`] does from a file. The extension of the name
/// determines the format, and errors quote the name.
///
/// ```
/// use wayfix_roads::matching::read_traces_from;
///
/// let text = "trace,time,longitude,latitude,acuracy\nA,0,149.13,-35.28,5\nA,0,149.13,-35.28,5\n";
/// let (traces, report) = read_traces_from("drive", text.as_bytes())?;
/// assert_eq!((traces.len(), traces[0].points.len()), (1, 1));
/// assert_eq!(
///     report.to_string(),
///     "skipped 1 points of the same time and 0 that go back in time (line 3)\n\
///      unknown column: acuracy"
/// );
///
/// let text = "trace,time,longitude,latitude\nA,0,149.13,-35.28\nA,1,149.13,-95\n";
/// let error = read_traces_from("drive", text.as_bytes()).unwrap_err();
/// assert_eq!(
///     error.to_string(),
///     "drive, line 3: the point has latitude -95, expected a latitude from -90 to 90 degrees"
/// );
/// # Ok::<(), wayfix_roads::NetworkError>(())
/// ```
///
/// # Errors
///
/// As [`read_traces`].
pub fn read_traces_from(
    name: &str,
    reader: impl Read,
) -> Result<(Vec<Trace>, TraceReport), NetworkError> {
    let end = Path::new(name).extension().unwrap_or_default();
    let is = |extension: &str| end.eq_ignore_ascii_case(extension);
    if is("gpx") {
        #[cfg(feature = "gpx")]
        return gpx::read(name, reader);
        #[cfg(not(feature = "gpx"))]
        return needs("gpx", name);
    }
    if is("geojson") || is("json") {
        #[cfg(feature = "geojson")]
        return geojson::read(name, reader);
        #[cfg(not(feature = "geojson"))]
        return needs("geojson", name);
    }
    #[cfg(feature = "csv")]
    return csv::read(name, reader);
    #[cfg(not(feature = "csv"))]
    return needs("csv", name);
}

/// Error for a format whose feature is not enabled.
#[cfg(not(all(feature = "csv", feature = "geojson", feature = "gpx")))]
fn needs(feature: &str, name: &str) -> Result<(Vec<Trace>, TraceReport), NetworkError> {
    let reason = format!("this format needs the feature `{feature}`");
    Err(NetworkError::Read { file: name.to_owned(), reason })
}
