//! Raw grey frames from files.

use std::fs;
use std::path::Path;

use crate::vpr::patches::Frames;

/// Reads frames of unsigned 8-bit grey values, row by row, frame after frame.
pub(crate) fn read(file: &Path, rows: usize, cols: usize) -> Result<Frames, String> {
    let name = file.display();
    let pixels = fs::read(file).map_err(|error| format!("cannot read {name}: {error}"))?;
    frames(pixels, rows, cols).map_err(|what| format!("{name} {what}"))
}

fn frames(pixels: Vec<u8>, rows: usize, cols: usize) -> Result<Frames, String> {
    let (bytes, size) = (pixels.len(), rows.saturating_mul(cols));
    if size == 0 {
        return Err(format!(
            "has no frames of {rows} rows × {cols} columns, expected at least 1 × 1"
        ));
    }
    if pixels.is_empty() {
        return Err(format!("is empty, expected frames of {size} bytes"));
    }
    if !bytes.is_multiple_of(size) {
        return Err(format!(
            "has {bytes} bytes, expected a multiple of {size} = {rows} rows × {cols} columns"
        ));
    }
    Ok(Frames { rows, cols, pixels })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_follow_each_other() {
        let frames = frames(vec![7; 18], 2, 3).unwrap();
        assert_eq!((frames.count(), frames.rows, frames.cols), (3, 2, 3));
        assert_eq!(frames.pixels, [7; 18]);
    }

    #[test]
    fn sizes_that_do_not_fit() {
        let error = |bytes, rows, cols| frames(vec![7; bytes], rows, cols).unwrap_err();
        assert_eq!(error(19, 2, 3), "has 19 bytes, expected a multiple of 6 = 2 rows × 3 columns");
        assert_eq!(error(0, 2, 3), "is empty, expected frames of 6 bytes");
        let expected = "has no frames of 0 rows × 3 columns, expected at least 1 × 1";
        assert_eq!(error(6, 0, 3), expected);
        assert!(error(6, 2, 0).contains("2 rows × 0 columns"));
        assert!(error(6, usize::MAX, 2).contains("expected a multiple"));
        let missing = read(Path::new("no such file.u8"), 2, 3).unwrap_err();
        assert!(missing.starts_with("cannot read no such file.u8: "), "{missing}");
    }
}
