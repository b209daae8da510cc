//! Map matching, and the parts of road networks that it uses.

mod answers;
mod antimeridian;
mod calibration;
mod city;
mod drives;
#[cfg(feature = "csv")]
mod files;
#[cfg(all(feature = "geojson", feature = "gpx"))]
mod formats;
mod garbage;
mod hostile;
mod index;
mod learn;
mod ranked;
mod routes;
mod shapes;
#[path = "../../../examples/roads/simulate/mod.rs"]
mod simulate;
mod simulated;
mod vehicles;
