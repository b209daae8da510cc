//! Choices of an import.

use crate::Cleaning;

/// Choice of the roads that an import takes, and of the cleaning after it.
///
/// Services, tracks and private roads are known in OpenStreetMap extracts and in GeoJSON features
/// with a `highway` property; CSV files hold the roads that are wanted.
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
    /// Aisles of car parks and driveways, if service roads are taken; true by default.
    pub parking_aisles: bool,
    /// Farm and forest tracks (`highway=track`); false by default.
    pub tracks: bool,
    /// Roads that are closed to the public (`access=private` or `no` and the like); false by
    /// default.
    pub private_roads: bool,
    /// Operations that [clean](crate::RoadNetwork::cleaned) the network after it was read;
    /// none by default.
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
