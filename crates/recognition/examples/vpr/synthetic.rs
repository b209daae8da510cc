//! A small synthetic recording, for a first run without data. Its places resemble their neighbours;
//! the query has less contrast, the texture of another season, and noise. It does not imitate any
//! camera.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::{Common, Drive, Frames, Pass, generator};

/// Number of frames of each pass, and of those that form the map, counted from the first.
const PLACES: usize = 360;
const MAPPED: usize = 300;
const ROWS: usize = 16;
const COLS: usize = 32;

pub(crate) fn pass(common: &Common) -> Pass {
    let mut rng = generator(common.seed, 0);
    let textures = [(4, common.closed), (8, false), (12, false)];
    let [places, season, light] = textures.map(|(along, closed)| texture(along, closed, &mut rng));
    let mut noise = |deviation: f64| deviation * rng.sample::<f64, _>(StandardNormal);
    let (mut references, mut queries) = (Vec::new(), Vec::new());
    for place in 0..PLACES {
        for pixel in 0..ROWS * COLS {
            let (texture, brightness) = (places[place][pixel], 10.0 * light[place][0]);
            references.push(grey(128.0 + 36.0 * texture + noise(6.0)));
            let query = 96.0 + brightness + 7.0 * texture + 40.0 * season[place][pixel];
            queries.push(grey(query + noise(10.0)));
        }
    }
    let frames = |pixels| Frames { rows: ROWS, cols: COLS, pixels };
    let (references, queries) = (frames(references), frames(queries));
    let name = String::from("synthetic recording (made up by the example)");
    let (map, closed, seed) = (0..MAPPED, common.closed, common.seed);
    Pass { name, references, map, queries, patch: 8, closed, noise: None, seed }
}

/// Returns a drive with a stop and a reversal and, if asked for, detours to places off the map.
pub(crate) fn drive(off_map: bool) -> Result<Drive, String> {
    let legs = [(120, 1.0), (30, 0.0), (60, 1.0), (50, -1.0), (50, 2.0), (40, 0.5), (30, 1.0)];
    let detours = [(MAPPED + 5..MAPPED + 30, 60), (MAPPED + 30..MAPPED + 60, 240)];
    Drive::new(&legs, 10, PLACES)?.with_detours(if off_map { &detours } else { &[] }, PLACES)
}

/// The nearest value that a pixel can have.
#[expect(clippy::cast_sign_loss, reason = "it is clamped, as a camera's is")]
pub(crate) fn grey(value: f64) -> u8 {
    value.round().clamp(0.0, 255.0) as u8
}

/// Values of variance one for each pixel of each place, smooth along the route.
fn texture(along: usize, closed: bool, rng: &mut ChaCha8Rng) -> Vec<Vec<f64>> {
    let mut white = || StandardNormal.sample_iter(&mut *rng).take(ROWS * COLS).collect();
    let noise: Vec<Vec<f64>> = (0..PLACES + along).map(|_| white()).collect();
    // The map's window wraps around a loop, so its first and last places are neighbours, too.
    let around = |i: usize| if closed && i < MAPPED + along { i % MAPPED } else { i };
    let value = |place: usize, pixel: usize| {
        let near = (place..place + along).map(|i| noise[around(i)][pixel]);
        near.sum::<f64>() / (along as f64).sqrt()
    };
    (0..PLACES).map(|place| (0..ROWS * COLS).map(|pixel| value(place, pixel)).collect()).collect()
}
