//! Options of an import.

use crate::Cleaning;

/// Options of an import: which roads are read, and how the network is cleaned.
///
/// Service roads, tracks and private roads are recognised in OpenStreetMap extracts and in GeoJSON
/// features with a `highway` property; all roads of CSV files are read.
///
/// ```
/// use wayfix_roads::{Cleaning, ImportOptions};
///
/// let options = ImportOptions {
///     parking_aisles: false,
///     cleaning: vec![Cleaning::LargestComponent, Cleaning::Contraction],
///     ..ImportOptions::default()
/// };
/// assert!(options.service_roads);
/// ```
#[derive(Debug, Clone, PartialEq)]
#[expect(clippy::struct_excessive_bools, reason = "each is a kind of road, chosen by itself")]
pub struct ImportOptions {
    /// Roads to and on private ground, car parks and depots (`highway=service`); true by default.
    pub service_roads: bool,
    /// Aisles of car parks and driveways, if service roads are read; true by default.
    pub parking_aisles: bool,
    /// Farm and forest tracks (`highway=track`); false by default.
    pub tracks: bool,
    /// Roads closed to the public (`access=private`, `no` and the like); false by default.
    pub private_roads: bool,
    /// Operations that [clean](crate::RoadNetwork::cleaned) the network after reading; none by
    /// default.
    pub cleaning: Vec<Cleaning>,
}

impl Default for ImportOptions {
    fn default() -> Self {
        Self {
            service_roads: true,
            parking_aisles: true,
            tracks: false,
            private_roads: false,
            cleaning: Vec::new(),
        }
    }
}
