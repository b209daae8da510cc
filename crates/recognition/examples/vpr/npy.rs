//! Arrays of NumPy, from `.npy` files.

use std::{fs::File, io::BufReader, path::Path};

use npyz::{NpyFile, Order};

/// An array in C order; the type of its elements is still to be chosen.
pub(crate) struct Array<const AXES: usize> {
    pub(crate) shape: [usize; AXES],
    pub(crate) npy: NpyFile<BufReader<File>>,
}

impl<const AXES: usize> Array<AXES> {
    /// Opens a file if its name ends in `.npy`.
    pub(crate) fn open(file: &Path, axes: &str) -> Result<Option<Self>, String> {
        if file.extension().is_none_or(|extension| !extension.eq_ignore_ascii_case("npy")) {
            return Ok(None);
        }
        let npy = File::open(file).and_then(|file| NpyFile::new(BufReader::new(file)));
        let npy = npy.map_err(|error| format!("cannot read {}: {error}", file.display()))?;
        let side = |side: &u64| usize::try_from(*side).unwrap_or(usize::MAX);
        let (shape, order): (Vec<_>, _) = (npy.shape().iter().map(side).collect(), npy.order());
        let sides = <[usize; AXES]>::try_from(&shape[..]).ok();
        let sides = sides.filter(|sides| order == Order::C && !sides.contains(&0));
        let found = format!("{} has the shape {shape:?} in {order:?} order", file.display());
        let wrong = || format!("{found}, expected {axes}, none of them 0, in C order");
        sides.map(|shape| Some(Self { shape, npy })).ok_or_else(wrong)
    }
}
