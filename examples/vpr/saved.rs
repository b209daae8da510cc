//! Fits stored in files (feature `serde`).

use std::path::Path;

use wayfix::recognition::Fit;

#[cfg(feature = "serde")]
pub(super) fn read(file: &Path) -> Result<Fit, String> {
    let name = file.display();
    let text = std::fs::read(file).map_err(|error| format!("cannot read {name}: {error}"))?;
    serde_json::from_slice(&text).map_err(|error| format!("{name} is not a fit: {error}"))
}

#[cfg(feature = "serde")]
pub(super) fn write(file: &Path, fit: &Fit) -> Result<(), String> {
    let failed = |error| format!("cannot write {}: {error}", file.display());
    let text = serde_json::to_vec(fit).map_err(|error| failed(error.into()))?;
    std::fs::write(file, text).map_err(failed)
}

#[cfg(not(feature = "serde"))]
const WITHOUT: &str = "built without the feature serde, expected `cargo run --features serde`";

#[cfg(not(feature = "serde"))]
pub(super) fn read(_: &Path) -> Result<Fit, String> {
    Err(format!("--fit: {WITHOUT}"))
}

#[cfg(not(feature = "serde"))]
pub(super) fn write(_: &Path, _: &Fit) -> Result<(), String> {
    Err(format!("--save: {WITHOUT}"))
}
