//! Grey frames, and their comparison by patch-normalised pixels (Milford and Wyeth, 2012).

use std::ops::Range;

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use rand_distr::{Distribution, Normal};

use super::{Drive, Recording};

/// Frames of one size, one after the other, row by row; at least one frame.
#[derive(Debug, Clone)]
pub(crate) struct Frames {
    pub(crate) rows: usize,
    pub(crate) cols: usize,
    pub(crate) pixels: Vec<u8>,
}

/// Frames of a map and of a later pass: frame i of both shows the same place.
pub(crate) struct Pass {
    pub(crate) name: String,
    pub(crate) references: Frames,
    pub(crate) map: Range<usize>,
    pub(crate) queries: Frames,
    /// Side of the patches that are normalised, in pixels.
    pub(crate) patch: usize,
    pub(crate) closed: bool,
    /// Noise of the odometry.
    pub(crate) noise: Option<Normal<f64>>,
    pub(crate) seed: u64,
}

impl Pass {
    /// Compares the frame shown at each step of a drive with the places of the map.
    pub(crate) fn recording(&self, shown: &Frames, drive: &Drive) -> Result<Recording, String> {
        let Self { map, closed, .. } = self;
        let (end, frames) = (map.end, self.references.count());
        if end > frames {
            return Err(format!("--reference-range ends at {end}, expected {frames} or less"));
        }
        let size = shown.rows * shown.cols;
        let places = self.references.descriptors(self.patch)?;
        let queries = shown.descriptors(self.patch)?;
        let mut distances = Vec::new();
        let bar = super::bar("comparing frames", shown.count());
        for query in queries.chunks_exact(size) {
            let places = places[size * map.start..size * end].chunks_exact(size);
            distances.extend(places.map(|place| mean_difference(query, place)));
            bar.inc(1);
        }
        bar.finish_and_clear();
        // Frames outside of the map's range show places off the map.
        let place = |frame: &usize| map.contains(frame).then(|| frame.abs_diff(map.start));
        let truth = drive.frames.iter().map(|frame| place(frame).map(|place| place..=place));
        let (mut rng, mut odometry) = (generator(self.seed, 1), Vec::new());
        if let Some(noise) = self.noise {
            let readings = drive.distances[1..].iter().map(|d| Some(d + noise.sample(&mut rng)));
            // Nothing was driven before the first step.
            odometry = std::iter::once(None).chain(readings).collect();
        }
        let (name, references, truth) = (self.name.clone(), map.len(), Some(truth.collect()));
        Ok(Recording { name, references, distances, truth, odometry, closed: *closed })
    }
}

/// Independent generator for each stream: 0 for synthetic frames, 1 for odometry, 2 for `hard`.
pub(crate) fn generator(seed: u64, stream: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(stream);
    rng
}

impl Frames {
    pub(crate) fn count(&self) -> usize {
        self.pixels.len() / (self.rows * self.cols)
    }

    pub(crate) fn frame(&self, frame: usize) -> &[u8] {
        let size = self.rows * self.cols;
        &self.pixels[frame * size..][..size]
    }

    pub(crate) fn select(&self, frames: &[usize]) -> Self {
        let pixels = frames.iter().flat_map(|frame| self.frame(*frame)).copied().collect();
        Self { pixels, ..*self }
    }

    /// Normalises each square patch to mean 0 and deviation 1, or to 0 if it is flat. The pixels of
    /// a patch are stored one after another, as only differences between the same pixels are taken.
    fn descriptors(&self, patch: usize) -> Result<Vec<f32>, String> {
        let Self { rows, cols, .. } = *self;
        if patch < 2 || !rows.is_multiple_of(patch) || !cols.is_multiple_of(patch) {
            let sides = format!("{rows} rows and {cols} columns");
            return Err(format!("--patch {patch}: expected a common divisor above 1 of {sides}"));
        }
        let (count, mut values) = ((patch * patch) as f64, Vec::new());
        for frame in self.pixels.chunks_exact(rows * cols) {
            for top in (0..rows).step_by(patch) {
                for left in (0..cols).step_by(patch) {
                    let lines = (top..top + patch).map(|row| &frame[row * cols + left..][..patch]);
                    normalize(lines.flatten().map(|&x| f64::from(x)), count, &mut values);
                }
            }
        }
        Ok(values)
    }
}

fn normalize(pixels: impl Iterator<Item = f64> + Clone, count: f64, into: &mut Vec<f32>) {
    let mean = pixels.clone().sum::<f64>() / count;
    let deviation = (pixels.clone().map(|x| (x - mean).powi(2)).sum::<f64>() / count).sqrt();
    // The mean of equal whole numbers is exact, so a flat patch has a deviation of exactly 0.
    into.extend(
        pixels.map(|x| if deviation > 0.0 { ((x - mean) / deviation) as f32 } else { 0.0 }),
    );
}

/// Mean absolute difference in sixteen independent sums, which the compiler can keep in registers.
fn mean_difference(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0.0_f32; 16];
    let ((a_blocks, a_rest), (b_blocks, b_rest)) = (a.as_chunks::<16>(), b.as_chunks::<16>());
    for (a, b) in a_blocks.iter().zip(b_blocks) {
        (0..16).for_each(|lane| sums[lane] += (a[lane] - b[lane]).abs());
    }
    let rest = a_rest.iter().zip(b_rest).map(|(a, b)| (a - b).abs());
    (sums.iter().sum::<f32>() + rest.sum::<f32>()) / a.len() as f32
}
