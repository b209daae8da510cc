//! Arrays in NumPy's format `.npy`, version 1.0.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

/// Writes doubles, the last axis running fastest.
pub(crate) fn doubles(path: &Path, shape: &[usize], values: &[f64]) -> io::Result<()> {
    write(path, "<f8", shape, values.len(), values.iter().map(|value| value.to_le_bytes()))
}

/// Writes indices, the last axis running fastest.
pub(crate) fn indices(path: &Path, shape: &[usize], values: &[usize]) -> io::Result<()> {
    let bytes = values.iter().map(|&value| (value as u64).to_le_bytes());
    write(path, "<u8", shape, values.len(), bytes)
}

fn write(
    path: &Path,
    kind: &str,
    shape: &[usize],
    count: usize,
    bytes: impl Iterator<Item = [u8; 8]>,
) -> io::Result<()> {
    assert_eq!(shape.iter().product::<usize>(), count, "the shape of {}", path.display());
    let shape: Vec<String> = shape.iter().map(ToString::to_string).collect();
    let shape = shape.join(",") + ","; // a tuple, of one axis, too
    let mut header = format!("{{'descr':'{kind}','fortran_order':False,'shape':({shape})}}");
    // Magic, version and length take 10 bytes; what follows is aligned to 64.
    while (10 + header.len() + 1) % 64 != 0 {
        header.push(' ');
    }
    header.push('\n');
    let mut file = BufWriter::new(File::create(path)?);
    file.write_all(b"\x93NUMPY\x01\x00")?;
    file.write_all(&(header.len() as u16).to_le_bytes())?;
    file.write_all(header.as_bytes())?;
    bytes.into_iter().try_for_each(|value| file.write_all(&value))?;
    file.flush()
}
