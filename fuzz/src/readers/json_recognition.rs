//! The fit of a recogniser and the state of a track, from JSON.

use wayfix_recognition::motion::OffMap;
use wayfix_recognition::{Options, Recognizer, Track};

use super::read;
use crate::counts::Counts;
use crate::draw::Draw;

/// Reads a damaged fit, or the damaged state of a track.
pub(super) fn recognition(draw: &mut Draw<'_>, n: usize, counts: &mut Counts) {
    let options = Options::default()
        .with_off_map(draw.one_in(2).then(OffMap::default))
        .with_closed(draw.one_in(2));
    let recognizer = Recognizer::from_distances(n, options).expect("references");
    let mut track = recognizer.track();
    for _ in 0..draw.below(4) {
        let row = row(draw, n);
        let _ = track.step(&row);
    }
    if draw.one_in(2) {
        let Some(state) = read(draw, &track.snapshot(), counts) else { return };
        let mut other = recognizer.track();
        match other.restore(&state) {
            Ok(()) => drive(draw, other, n, counts),
            Err(error) => super::check_message(&error),
        }
    } else {
        let Some(fit) = read(draw, recognizer.parameters(), counts) else { return };
        match recognizer.with_parameters(fit) {
            Ok(other) => drive(draw, other.track(), n, counts),
            Err(error) => super::check_message(&error),
        }
    }
}

fn row(draw: &mut Draw<'_>, n: usize) -> Vec<f32> {
    let distance = |draw: &mut Draw<'_>| draw.pick(&[0.1, 0.5, 0.9, 2.0, f32::INFINITY, 0.3]);
    (0..n).map(|_| distance(draw)).collect()
}

fn drive(draw: &mut Draw<'_>, mut track: Track, n: usize, counts: &mut Counts) {
    for _ in 0..4 {
        let row = row(draw, n);
        match track.step_with(draw.pick(&[None, Some(1.0), Some(-30.0)]), &row) {
            Ok(answer) => {
                assert!((0.0..=1.0).contains(&answer.probability), "{answer:?}");
                assert!((0.0..=1.0).contains(&answer.off_map), "{answer:?}");
                assert!(!answer.log_likelihood.is_nan(), "{answer:?}");
            }
            Err(error) => super::check_message(&error),
        }
    }
    counts.add("tracks used");
}
