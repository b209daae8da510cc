//! A small synthetic recording, for a first run without data.
//!
//! The route has 360 places, each with a smooth random texture that resembles those of its
//! neighbours. The reference pass shows them unchanged; the query pass has another contrast and
//! brightness, the texture of another season that changes slowly, and noise. It does not imitate
//! a real camera.

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use rand_distr::{Distribution, StandardNormal};

use super::drive::{Detour, Leg};
use super::patches::Frames;

/// Name of the recording in the outputs.
pub(crate) const NAME: &str = "synthetic recording (made up by the example)";
/// Number of frames of each pass.
pub(crate) const PLACES: usize = 360;
/// Number of frames that form the map, from the first on.
pub(crate) const MAPPED: usize = 300;
/// First frame of the drive.
pub(crate) const START: usize = 10;

const ROWS: usize = 16;
const COLS: usize = 32;

/// Legs: ahead, a stop, ahead, reverse, twice as fast, slower.
pub(crate) fn legs() -> Vec<Leg> {
    let legs = [(120, 1.0), (30, 0.0), (60, 1.0), (50, -1.0), (50, 2.0), (40, 0.5), (30, 1.0)];
    legs.map(|(steps, speed)| Leg { steps, speed }).to_vec()
}

/// Detour to places that are not on the map.
pub(crate) fn detours() -> Vec<Detour> {
    vec![
        Detour { frames: MAPPED + 5..MAPPED + 30, at: 60 },
        Detour { frames: MAPPED + 30..MAPPED + 60, at: 240 },
    ]
}

/// Reference pass and query pass; frames with the same index show the same place. On a closed
/// route, the last place of the map resembles the first.
pub(crate) fn frames(seed: u64, closed: bool) -> (Frames, Frames) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let places = textures(4, closed, &mut rng);
    let season = textures(8, false, &mut rng);
    let light = textures(12, false, &mut rng);
    let mut frames = [(); 2].map(|()| Frames { rows: ROWS, cols: COLS, pixels: Vec::new() });
    for place in 0..PLACES {
        for pixel in 0..ROWS * COLS {
            let [noise, query_noise]: [f64; 2] = [(); 2].map(|()| StandardNormal.sample(&mut rng));
            let texture = places[place][pixel];
            let brightness = 10.0 * light[place][0];
            let reference = 128.0 + 36.0 * texture + 6.0 * noise;
            let query = 96.0
                + brightness
                + 12.0 * texture
                + 40.0 * season[place][pixel]
                + 10.0 * query_noise;
            let [references, queries] = &mut frames;
            references.pixels.push(grey(reference));
            queries.pixels.push(grey(query));
        }
    }
    let [references, queries] = frames;
    (references, queries)
}

/// Nearest value that a pixel can have.
#[expect(clippy::cast_sign_loss, reason = "it is clamped, as a camera's is")]
pub(crate) fn grey(value: f64) -> u8 {
    value.round().clamp(0.0, 255.0) as u8
}

/// One texture per place: white noise of variance one, smoothed along the route and within the
/// image.
fn textures(along: usize, closed: bool, rng: &mut ChaCha8Rng) -> Vec<Vec<f64>> {
    const BLUR: usize = 3;
    let mut white = || -> Vec<f64> {
        let values = StandardNormal.sample_iter(&mut *rng);
        let noise: Vec<f64> = values.take((ROWS + BLUR) * (COLS + BLUR)).collect();
        let blurred = |row: usize, col: usize| {
            let rows = (row..row + BLUR).map(|row| &noise[row * (COLS + BLUR) + col..][..BLUR]);
            rows.flatten().sum::<f64>() / BLUR as f64
        };
        let pixels = (0..ROWS).flat_map(|row| (0..COLS).map(move |col| (row, col)));
        pixels.map(|(row, col)| blurred(row, col)).collect()
    };
    let noise: Vec<Vec<f64>> = (0..PLACES + along).map(|_| white()).collect();
    let scale = (along as f64).sqrt().recip();
    let sum = |place: usize| {
        let around = |i: usize| if closed && place < MAPPED { i % MAPPED } else { i };
        let near: Vec<&Vec<f64>> = (place..place + along).map(|i| &noise[around(i)]).collect();
        (0..ROWS * COLS).map(|pixel| scale * near.iter().map(|n| n[pixel]).sum::<f64>()).collect()
    };
    (0..PLACES).map(sum).collect()
}
