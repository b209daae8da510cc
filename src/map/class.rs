//! Classes of roads, in the order of their traffic, with their names in files.

use std::fmt;
use std::str::FromStr;

/// Class of a road by the traffic it is built for, from least to most.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum RoadClass {
    /// A local street.
    Street,
    /// A road that collects the traffic of streets.
    Collector,
    /// A road that connects districts.
    Arterial,
    /// A main road.
    Main,
}

impl FromStr for RoadClass {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "street" => Ok(Self::Street),
            "collector" => Ok(Self::Collector),
            "arterial" => Ok(Self::Arterial),
            "main" => Ok(Self::Main),
            _ => Err(format!("class {text:?}, expected main, arterial, collector or street")),
        }
    }
}

impl fmt::Display for RoadClass {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Street => "street",
            Self::Collector => "collector",
            Self::Arterial => "arterial",
            Self::Main => "main",
        })
    }
}
