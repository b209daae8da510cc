//! Vehicles from bytes.

use wayfix::map::Position;
use wayfix_roads::matching::{Matcher, TracePoint, Vehicle};

use super::super::check_message;
use super::{CORNERS, drives, place};
use crate::counts::Counts;
use crate::draw::Draw;

/// Replacements of words.
const WORDS: [u64; 16] = [
    0,
    1,
    2,
    3,
    0xffff_ffff,
    0x1_0000_0000,
    u64::MAX,
    u64::MAX - 1,
    0x7fff_ffff_ffff_ffff,
    0x7ff0_0000_0000_0000,
    0xfff0_0000_0000_0000,
    0x7ff8_0000_0000_0000,
    0x7fef_ffff_ffff_ffff,
    0xffef_ffff_ffff_ffff,
    0x8000_0000_0000_0000,
    0x3ff0_0000_0000_0000,
];

/// Checks all answers of a vehicle.
pub(super) fn check(vehicle: &Vehicle, matcher: &Matcher) {
    drives::is_sane(&vehicle.live());
    drives::is_sane(&vehicle.late());
    for points in 0..=vehicle.points_late() {
        vehicle.ago(points).iter().for_each(drives::is_sane);
    }
    assert!(vehicle.log_likelihood().is_finite() && vehicle.log_normalizer().is_finite());
    let sum: f64 = vehicle.edges().iter().map(|edge| edge.1).sum();
    assert!((sum + vehicle.live().off_road - 1.0).abs() < 1e-6, "{sum}");
    match vehicle.credible(matcher, 0.9) {
        Ok(found) => {
            assert!((0.0..=1.0).contains(&found.probability));
            for stretch in &found.stretches {
                assert!(stretch.enter <= stretch.exit, "{stretch:?}");
            }
        }
        Err(error) => check_message(&error),
    }
}

/// Reads the damaged bytes of a vehicle, with a matching checksum.
pub(super) fn vehicle(draw: &mut Draw<'_>, counts: &mut Counts) {
    let corner = draw.pick(&CORNERS);
    let matcher = drives::town(corner);
    let mut time = 0.0;
    let mut next = |draw: &mut Draw<'_>| {
        time += 10.0;
        let [latitude, longitude] = place(corner, draw.below(9));
        TracePoint::new(time, Position { latitude, longitude })
    };
    let mut vehicle = matcher.start(&next(draw), draw.below(4)).expect("a point");
    for _ in 0..draw.below(5) {
        matcher.step(&mut vehicle, &next(draw)).expect("a point");
    }
    let mut bytes = vehicle.to_bytes();
    assert_eq!(Vehicle::from_bytes(&bytes).expect("its own bytes"), vehicle);
    for _ in 0..draw.pick(&[1, 1, 2, 3, 0]) {
        let word = 1 + draw.below(bytes.len() / 8 - 2);
        let at = 8 * word..8 * word + 8;
        match draw.below(8) {
            0 => bytes[at.start + draw.below(8)] ^= 1 << draw.below(8),
            1 => drop(bytes.drain(at)),
            2 => bytes.truncate(at.end + draw.below(8)),
            _ => bytes[at].copy_from_slice(&draw.pick(&WORDS).to_le_bytes()),
        }
        if bytes.len() < 32 {
            break;
        }
    }
    let end = bytes.len().saturating_sub(8);
    if !draw.one_in(8) {
        let sum = checksum(&bytes[..end]).to_le_bytes();
        let length = bytes.len() - end;
        bytes[end..].copy_from_slice(&sum[..length]);
    }
    counts.note(|| format!("vehicle: {bytes:?}"));
    match Vehicle::from_bytes(&bytes) {
        Ok(mut vehicle) => {
            counts.add("vehicles accepted");
            let again =
                Vehicle::<Position>::from_bytes(&vehicle.to_bytes()).expect("its own bytes");
            assert_eq!(again.to_bytes(), vehicle.to_bytes());
            check(&vehicle, &matcher);
            for _ in 0..5 {
                let point = TracePoint { time: vehicle.last_point().time + 10.0, ..next(draw) };
                match matcher.step(&mut vehicle, &point) {
                    Ok(log) => assert!(log.is_finite(), "{log}"),
                    Err(error) => check_message(&error),
                }
                check(&vehicle, &matcher);
            }
        }
        Err(error) => {
            counts.add("vehicles refused");
            check_message(&error);
        }
    }
}

/// The checksum of the format.
fn checksum(bytes: &[u8]) -> u64 {
    let (words, rest) = bytes.as_chunks::<8>();
    let mut last = [0; 8];
    last[..rest.len()].copy_from_slice(rest);
    let words = words.iter().chain([&last]).map(|word| u64::from_le_bytes(*word));
    let add =
        |sum: u64, word: u64| (sum ^ word).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29);
    words.fold(bytes.len() as u64, add)
}
