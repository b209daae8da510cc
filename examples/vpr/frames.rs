//! Reads raw grey frames.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

use crate::vpr::patches::Frames;

/// Why a file holds no frames.
#[derive(Debug, Error)]
pub(crate) enum FramesError {
    #[error("cannot read {}: {source}", file.display())]
    File { file: PathBuf, source: io::Error },
    #[error("frames of {rows} rows × {cols} columns have no pixels, expected at least 1 × 1")]
    NoPixels { rows: usize, cols: usize },
    #[error("{} is empty, expected frames of {pixels} bytes", file.display())]
    Empty { file: PathBuf, pixels: usize },
    #[error(
        "{} has {bytes} bytes, expected a multiple of {pixels} = {rows} rows × {cols} columns",
        file.display()
    )]
    Size { file: PathBuf, bytes: usize, pixels: usize, rows: usize, cols: usize },
}

/// Reads frames of unsigned 8-bit grey values, row by row, frame after frame.
pub(crate) fn read(file: &Path, rows: usize, cols: usize) -> Result<Frames, FramesError> {
    if rows == 0 || cols == 0 {
        return Err(FramesError::NoPixels { rows, cols });
    }
    let pixels =
        fs::read(file).map_err(|source| FramesError::File { file: file.to_owned(), source })?;
    let size = rows.saturating_mul(cols);
    if pixels.is_empty() {
        return Err(FramesError::Empty { file: file.to_owned(), pixels: size });
    }
    if !pixels.len().is_multiple_of(size) {
        let (file, bytes) = (file.to_owned(), pixels.len());
        return Err(FramesError::Size { file, bytes, pixels: size, rows, cols });
    }
    Ok(Frames { rows, cols, pixels })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_bytes(name: &str, bytes: &[u8], rows: usize, cols: usize) -> Result<Frames, String> {
        let name = format!("wayfix_frames_{}_{name}.u8", std::process::id());
        let file = std::env::temp_dir().join(name);
        fs::write(&file, bytes).unwrap();
        let frames = read(&file, rows, cols);
        fs::remove_file(&file).unwrap();
        frames.map_err(|error| error.to_string().replace(&file.display().to_string(), "FILE"))
    }

    #[test]
    fn frames_follow_each_other() {
        let frames = read_bytes("three", &[7; 18], 2, 3).unwrap();
        assert_eq!((frames.count(), frames.rows, frames.cols), (3, 2, 3));
        assert_eq!(frames.pixels, [7; 18]);
    }

    #[test]
    fn sizes_that_do_not_fit() {
        let error =
            |name, bytes: &[u8], rows, cols| read_bytes(name, bytes, rows, cols).unwrap_err();
        assert_eq!(
            error("odd", &[7; 19], 2, 3),
            "FILE has 19 bytes, expected a multiple of 6 = 2 rows × 3 columns"
        );
        assert_eq!(error("empty", &[], 2, 3), "FILE is empty, expected frames of 6 bytes");
        let expected = "frames of 0 rows × 3 columns have no pixels, expected at least 1 × 1";
        assert_eq!(error("rows", &[7; 6], 0, 3), expected);
        assert!(error("cols", &[7; 6], 2, 0).contains("2 rows × 0 columns have no pixels"));
        assert!(read_bytes("huge", &[7; 6], usize::MAX, 2).is_err());
        let missing = read(Path::new("no such file.u8"), 2, 3).unwrap_err().to_string();
        assert!(missing.starts_with("cannot read no such file.u8: "), "{missing}");
    }
}
