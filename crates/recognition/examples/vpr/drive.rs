//! Simulated drives through a recording, with stops, reversing, other speeds, and detours.

use std::ops::Range;

/// A number of steps at one speed, in frames per step.
pub(crate) type Leg = (usize, f64);
/// A range of frames shown before a step of the drive.
pub(crate) type Detour = (Range<usize>, usize);

/// Frame shown at each step, and the distance moved before it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Drive {
    pub(crate) frames: Vec<usize>,
    /// Distances in frames; the first is 0.
    pub(crate) distances: Vec<f64>,
}

impl Drive {
    /// Shows frame `start`, then at each step the frame nearest to the position, halves rounded up.
    pub(crate) fn new(legs: &[Leg], start: usize, frames: usize) -> Result<Self, String> {
        if start >= frames {
            return Err(format!("--start {start}: expected a frame below {frames}"));
        }
        let mut drive = Self { frames: vec![start], distances: vec![0.0] };
        let mut position = start as f64;
        for (leg, &(steps, speed)) in (1..).zip(legs) {
            for of_leg in 1..=steps {
                position += speed;
                let nearest = (position + 0.5).floor();
                if !(0.0..frames as f64).contains(&nearest) {
                    let found = format!("step {of_leg} of leg {leg} would show frame {position}");
                    return Err(format!("--drive: {found}, expected one below {frames}"));
                }
                #[expect(clippy::cast_sign_loss, reason = "it was just compared with 0")]
                drive.frames.push(nearest as usize);
                drive.distances.push(speed);
            }
        }
        Ok(drive)
    }

    /// Inserts detours at speed 1; the step after a detour has the same distance as without it.
    pub(crate) fn with_detours(self, detours: &[Detour], frames: usize) -> Result<Self, String> {
        let steps = self.frames.len();
        for (Range { start, end }, at) in detours {
            if *end > frames || *at == 0 || *at > steps {
                let expected = format!("an end up to {frames}, a step from 1 to {steps}");
                return Err(format!("--detour {start}..{end}@{at}: expected {expected}"));
            }
        }
        let mut drive = Self { frames: Vec::new(), distances: Vec::new() };
        for step in 0..=steps {
            for (detour, _) in detours.iter().filter(|detour| detour.1 == step) {
                drive.frames.extend(detour.clone());
                drive.distances.extend(detour.clone().map(|_| 1.0));
            }
            drive.frames.extend(self.frames.get(step));
            drive.distances.extend(self.distances.get(step));
        }
        Ok(drive)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_drive_shows_the_nearest_frames_and_detours_before_their_steps() {
        let legs = [(2, 1.0), (1, 0.0), (2, 2.0), (2, -1.0), (3, 0.5)];
        let drive = Drive::new(&legs, 3, 20).unwrap();
        // Positions: 3 4 5 5 7 9 8 7 7.5 8 8.5.
        assert_eq!(drive.frames, [3, 4, 5, 5, 7, 9, 8, 7, 8, 8, 9]);
        let detours = [(10..12, 2), (18..19, 2)];
        let with = drive.clone().with_detours(&detours, 20).unwrap();
        assert_eq!(with.frames[..6], [3, 4, 10, 11, 18, 5]);
        assert_eq!(with.distances[..8], [0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 2.0]);
        let errors =
            [drive.with_detours(&detours, 18), Drive::new(&legs, 3, 9)].map(Result::unwrap_err);
        assert_eq!(errors[0], "--detour 18..19@2: expected an end up to 18, a step from 1 to 11");
        assert_eq!(errors[1], "--drive: step 2 of leg 3 would show frame 9, expected one below 9");
    }
}
