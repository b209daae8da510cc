//! Grey frames, and the patch-normalised descriptor of `SeqSLAM` (Milford and Wyeth, 2012).

use indicatif::ProgressBar;

/// Frames of one size, one after the other, row by row; at least one.
#[derive(Debug)]
pub(crate) struct Frames {
    pub(crate) rows: usize,
    pub(crate) cols: usize,
    pub(crate) pixels: Vec<u8>,
}

/// Descriptors with one number per pixel.
pub(crate) struct Descriptors {
    size: usize,
    values: Vec<f32>,
}

impl Frames {
    pub(crate) fn count(&self) -> usize {
        self.pixels.len() / (self.rows * self.cols)
    }

    pub(crate) fn frame(&self, frame: usize) -> &[u8] {
        let size = self.rows * self.cols;
        &self.pixels[frame * size..][..size]
    }

    /// Splits frames into square patches and normalises each patch to mean 0 and standard
    /// deviation 1; a flat patch becomes 0. The pixels of a patch are stored one after another,
    /// since only differences of the same pixels are taken.
    pub(crate) fn descriptors(
        &self,
        frames: impl ExactSizeIterator<Item = usize>,
        patch: usize,
    ) -> Result<Descriptors, String> {
        let Self { rows, cols, .. } = *self;
        let fits = |side: usize| rows.is_multiple_of(side) && cols.is_multiple_of(side);
        if patch < 2 || !fits(patch) {
            let sides = (2..=rows.min(cols)).filter(|side| fits(*side));
            let sides: Vec<String> = sides.map(|side| side.to_string()).collect();
            let expected = if sides.is_empty() {
                String::from("frames whose sides have a common divisor above 1")
            } else {
                sides.join(" or ")
            };
            return Err(if patch == 1 {
                format!("--patch 1: a patch of one pixel has no contrast, expected {expected}")
            } else {
                format!(
                    "--patch {patch} does not divide frames of {rows} rows × {cols} columns, \
                     expected {expected}"
                )
            });
        }
        let size = rows * cols;
        let mut values = Vec::with_capacity(frames.len() * size);
        for frame in frames {
            let frame = self.frame(frame);
            for top in (0..rows).step_by(patch) {
                for left in (0..cols).step_by(patch) {
                    let lines = (top..top + patch).map(|row| &frame[row * cols + left..][..patch]);
                    let pixels = lines.flatten().map(|&pixel| f64::from(pixel));
                    normalize(pixels, &mut values);
                }
            }
        }
        Ok(Descriptors { size, values })
    }
}

fn normalize(pixels: impl Iterator<Item = f64> + Clone, into: &mut Vec<f32>) {
    let (count, sum) = pixels.clone().fold((0.0, 0.0), |(n, sum), x| (n + 1.0, sum + x));
    let mean = sum / count;
    let variance = pixels.clone().map(|x| (x - mean).powi(2)).sum::<f64>() / count;
    // The mean of equal whole numbers is exact.
    let scale = if variance == 0.0 { 0.0 } else { variance.sqrt().recip() };
    into.extend(pixels.map(|x| ((x - mean) * scale) as f32));
}

/// Mean absolute difference of each query (row) to each reference.
pub(crate) fn differences(
    queries: &Descriptors,
    references: &Descriptors,
    bar: &ProgressBar,
) -> Result<Vec<f32>, String> {
    /// Number of queries that stay in the cache while all references are read.
    const BLOCK: usize = 8;
    let size = queries.size;
    let (rows, columns) = (queries.values.len() / size, references.values.len() / size);
    let mut all = Vec::new();
    let cells = rows.checked_mul(columns);
    if cells.is_none_or(|cells| all.try_reserve_exact(cells).is_err()) {
        return Err(format!("{rows} × {columns} differences do not fit into memory"));
    }
    all.resize(rows * columns, 0.0);
    bar.set_length(rows as u64);
    let blocks = queries.values.chunks(BLOCK * size).zip(all.chunks_mut(BLOCK * columns));
    for (queries, differences) in blocks {
        for (j, reference) in references.values.chunks_exact(size).enumerate() {
            let rows = queries.chunks_exact(size).zip(differences.chunks_exact_mut(columns));
            rows.for_each(|(query, row)| row[j] = mean_difference(query, reference));
        }
        bar.inc((queries.len() / size) as u64);
    }
    Ok(all)
}

/// Mean absolute difference in sixteen parallel sums, which the compiler can keep in registers.
fn mean_difference(a: &[f32], b: &[f32]) -> f32 {
    const LANES: usize = 16;
    let mut sums = [0.0_f32; LANES];
    let (a_chunks, a_rest) = a.as_chunks::<LANES>();
    let (b_chunks, b_rest) = b.as_chunks::<LANES>();
    for (a, b) in a_chunks.iter().zip(b_chunks) {
        for lane in 0..LANES {
            sums[lane] += (a[lane] - b[lane]).abs();
        }
    }
    let rest: f32 = a_rest.iter().zip(b_rest).map(|(a, b)| (a - b).abs()).sum();
    (sums.iter().sum::<f32>() + rest) / a.len() as f32
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn frames() -> impl Strategy<Value = (usize, Frames)> {
        (2_usize..4, 1_usize..4, 1_usize..4, 1_usize..12).prop_flat_map(
            |(patch, down, across, n)| {
                let (rows, cols) = (patch * down, patch * across);
                proptest::collection::vec(prop_oneof![Just(7), any::<u8>()], n * rows * cols)
                    .prop_map(move |pixels| (patch, Frames { rows, cols, pixels }))
            },
        )
    }

    proptest! {
        #[test]
        fn patches_have_mean_0_and_deviation_1((patch, frames) in frames()) {
            let descriptors = frames.descriptors(0..frames.count(), patch).unwrap();
            prop_assert_eq!(descriptors.values.len(), frames.pixels.len());
            for values in descriptors.values.chunks(patch * patch) {
                let count = values.len() as f32;
                let mean = values.iter().sum::<f32>() / count;
                let square = values.iter().map(|v| v * v).sum::<f32>() / count;
                prop_assert!(mean.abs() < 1e-5);
                let flat = values.iter().all(|v| *v == 0.0);
                prop_assert!(flat || (square - 1.0).abs() < 1e-5);
            }
        }

        /// Compares with the formula, evaluated pixel by pixel.
        #[test]
        fn differences_are_those_of_the_formula((patch, frames) in frames(), skip in 0_usize..3) {
            let count = frames.count();
            let skip = skip.min(count - 1);
            let Frames { rows, cols, .. } = frames;
            let normalized = |frame: usize, row: usize, col: usize| {
                let pixel = |r: usize, c: usize| {
                    f64::from(frames.pixels[(frame * rows + r) * cols + c])
                };
                let (top, left) = (row / patch * patch, col / patch * patch);
                let mut all = Vec::new();
                for r in 0..patch {
                    for c in 0..patch {
                        all.push(pixel(top + r, left + c));
                    }
                }
                let mean = all.iter().sum::<f64>() / all.len() as f64;
                let square = all.iter().map(|v| v * v).sum::<f64>() / all.len() as f64;
                let deviation = (square - mean * mean).max(0.0).sqrt();
                let flat = all.iter().all(|v| *v == all[0]);
                if flat { 0.0 } else { (pixel(row, col) - mean) / deviation }
            };
            let queries = frames.descriptors(0..count, patch).unwrap();
            let references = frames.descriptors(skip..count, patch).unwrap();
            let all = differences(&queries, &references, &ProgressBar::hidden()).unwrap();
            prop_assert_eq!(all.len(), count * (count - skip));
            for (at, found) in all.iter().enumerate() {
                let (i, j) = (at / (count - skip), at % (count - skip) + skip);
                let pixels = (0..rows).flat_map(|r| (0..cols).map(move |c| (r, c)));
                let sum: f64 =
                    pixels.map(|(r, c)| (normalized(i, r, c) - normalized(j, r, c)).abs()).sum();
                prop_assert!((sum / (rows * cols) as f64 - f64::from(*found)).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn contrast_and_brightness_do_not_matter() {
        let dark: Vec<u8> = (0..16).map(|i| i * i % 23).collect();
        let bright = dark.iter().map(|pixel| 40 + 3 * pixel);
        let pixels = dark.iter().copied().chain(bright).collect();
        let frames = Frames { rows: 4, cols: 4, pixels };
        let descriptors = frames.descriptors(0..2, 2).unwrap();
        let all = differences(&descriptors, &descriptors, &ProgressBar::hidden()).unwrap();
        assert!(all.iter().all(|difference| difference.abs() < 1e-6), "{all:?}");
    }

    #[test]
    fn a_patch_must_divide() {
        let frames = |rows, cols| Frames { rows, cols, pixels: vec![0; rows * cols] };
        let error = |rows, cols, patch| frames(rows, cols).descriptors(0..1, patch).err();
        assert_eq!(
            error(16, 32, 5).unwrap(),
            "--patch 5 does not divide frames of 16 rows × 32 columns, expected 2 or 4 or 8 or 16"
        );
        assert_eq!(
            error(3, 4, 1).unwrap(),
            "--patch 1: a patch of one pixel has no contrast, expected frames whose sides have a \
             common divisor above 1"
        );
        assert!(error(16, 32, 0).is_some());
        assert_eq!(error(16, 32, 16), None);
    }
}
