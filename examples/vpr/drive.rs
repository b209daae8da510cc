//! Simulated drives through a recording: with stops, reverse, other speeds, and detours.

use std::ops::Range;
use std::str::FromStr;

/// A number of steps at one speed, in frames per step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Leg {
    pub(crate) steps: usize,
    pub(crate) speed: f64,
}

/// A range of frames shown before a step of the drive.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Detour {
    pub(crate) frames: Range<usize>,
    pub(crate) at: usize,
}

/// Frame shown at each step, and the distance moved before it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Drive {
    pub(crate) frames: Vec<usize>,
    /// Distances in frames; the first is 0.
    pub(crate) distances: Vec<f64>,
}

/// Formats a number, shortened if it is huge.
fn short(value: f64) -> String {
    if value.abs() > 1e9 { format!("{value:e}") } else { value.to_string() }
}

impl FromStr for Leg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        const MOST: usize = 1_000_000;
        let parse = || {
            let (steps, speed) = text.trim().split_once('@')?;
            let leg = Self { steps: steps.parse().ok()?, speed: speed.parse().ok()? };
            ((1..=MOST).contains(&leg.steps) && leg.speed.is_finite()).then_some(leg)
        };
        parse().ok_or_else(|| {
            format!("expected STEPS@SPEED with 1 to {MOST} steps and a speed such as 1, 0 or -0.5")
        })
    }
}

impl FromStr for Detour {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parse = || {
            let (frames, at) = text.trim().split_once('@')?;
            let (first, end) = frames.split_once("..")?;
            let detour =
                Self { frames: first.parse().ok()?..end.parse().ok()?, at: at.parse().ok()? };
            (!detour.frames.is_empty()).then_some(detour)
        };
        parse().ok_or_else(|| String::from("expected FIRST..END@STEP with FIRST below END"))
    }
}

impl Drive {
    /// Shows frame `start`, then one frame for each step of the legs: the one nearest to the
    /// position, halves rounded up.
    pub(crate) fn new(legs: &[Leg], start: usize, frames: usize) -> Result<Self, String> {
        let last = frames - 1;
        if start > last {
            return Err(format!(
                "--start {start} is not in the recording, expected frames 0 to {last}"
            ));
        }
        let mut drive = Self { frames: vec![start], distances: vec![0.0] };
        let mut position = start as f64;
        for (leg, &Leg { steps, speed }) in (1..).zip(legs) {
            for of_leg in 1..=steps {
                position += speed;
                let nearest = (position + 0.5).floor();
                if !(0.0..frames as f64).contains(&nearest) {
                    return Err(format!(
                        "--drive: step {of_leg} of leg {leg} ({steps}@{}), step {} of the drive, \
                         would show frame {}, expected frames 0 to {last} (-0.5 to below {last}.5)",
                        short(speed),
                        drive.frames.len(),
                        short(position),
                    ));
                }
                #[expect(clippy::cast_sign_loss, reason = "it was just compared with 0")]
                drive.frames.push(nearest as usize);
                drive.distances.push(speed);
            }
        }
        Ok(drive)
    }

    /// Inserts the frames of each detour before its step. Detours are driven at speed 1, and the
    /// step after one has the same distance as without it.
    pub(crate) fn with_detours(self, detours: &[Detour], frames: usize) -> Result<Self, String> {
        let steps = self.frames.len();
        for Detour { frames: Range { start, end }, at } in detours {
            if *end > frames {
                return Err(format!(
                    "--detour {start}..{end}@{at}: frame {} is not in the recording, expected \
                     frames 0 to {}",
                    end - 1,
                    frames - 1
                ));
            }
            if *at == 0 || *at > steps {
                return Err(format!(
                    "--detour {start}..{end}@{at}: expected a step of 1 to {steps}, as the drive \
                     has {steps} steps"
                ));
            }
        }
        let mut drive = Self { frames: Vec::new(), distances: Vec::new() };
        for step in 0..=steps {
            for detour in detours.iter().filter(|detour| detour.at == step) {
                drive.frames.extend(detour.frames.clone());
                drive.distances.extend(detour.frames.clone().map(|_| 1.0));
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

    fn legs(text: &str) -> Vec<Leg> {
        text.split(',').map(|leg| leg.parse().unwrap()).collect()
    }

    #[test]
    fn a_drive_shows_the_nearest_frames() {
        let drive = Drive::new(&legs("2@1,1@0,2@2,2@-1,3@0.5,1@-0.25"), 3, 20).unwrap();
        // Positions: 3 4 5 5 7 9 8 7 7.5 8 8.5 8.25.
        assert_eq!(drive.frames, [3, 4, 5, 5, 7, 9, 8, 7, 8, 8, 9, 8]);
        assert_eq!(
            drive.distances,
            [0.0, 1.0, 1.0, 0.0, 2.0, 2.0, -1.0, -1.0, 0.5, 0.5, 0.5, -0.25]
        );
        assert_eq!(Drive::new(&[], 4, 5).unwrap().frames, [4]);
    }

    #[test]
    fn a_drive_may_end_within_half_a_frame_of_the_recording() {
        assert_eq!(Drive::new(&legs("1@-0.5"), 0, 2).unwrap().frames, [0, 0]);
        assert_eq!(Drive::new(&legs("1@0.25"), 1, 2).unwrap().frames, [1, 1]);
        assert!(Drive::new(&legs("1@0.5"), 1, 2).is_err());
    }

    #[test]
    fn a_drive_that_leaves_says_where() {
        let error = Drive::new(&legs("3@1,60@0,4@-2"), 2, 20).unwrap_err();
        assert_eq!(
            error,
            "--drive: step 3 of leg 3 (4@-2), step 66 of the drive, would show frame -1, expected \
             frames 0 to 19 (-0.5 to below 19.5)"
        );
        let error = Drive::new(&legs("3@1e300,3@1e300"), 2, 20).unwrap_err();
        assert_eq!(
            error,
            "--drive: step 1 of leg 1 (3@1e300), step 1 of the drive, would show frame 1e300, \
             expected frames 0 to 19 (-0.5 to below 19.5)"
        );
        let error = Drive::new(&[], 20, 20).unwrap_err();
        assert_eq!(error, "--start 20 is not in the recording, expected frames 0 to 19");
    }

    #[test]
    fn detours_are_shown_before_their_steps() {
        let detour = |text: &str| text.parse::<Detour>().unwrap();
        let drive = Drive::new(&legs("3@2"), 0, 20).unwrap();
        let detours = [detour("10..12@2"), detour("15..16@4"), detour("18..19@2")];
        let with = drive.clone().with_detours(&detours, 20).unwrap();
        assert_eq!(with.frames, [0, 2, 10, 11, 18, 4, 6, 15]);
        assert_eq!(with.distances, [0.0, 2.0, 1.0, 1.0, 1.0, 2.0, 2.0, 1.0]);

        let error = |text| drive.clone().with_detours(&[detour(text)], 20).unwrap_err();
        assert_eq!(
            error("18..21@2"),
            "--detour 18..21@2: frame 20 is not in the recording, expected frames 0 to 19"
        );
        let expected = "expected a step of 1 to 4, as the drive has 4 steps";
        assert_eq!(error("1..2@0"), format!("--detour 1..2@0: {expected}"));
        assert_eq!(error("1..2@5"), format!("--detour 1..2@5: {expected}"));
    }

    #[test]
    fn texts_that_are_no_legs_or_detours() {
        for text in
            ["", "5", "5@", "@1", "0@1", "-1@1", "1.5@1", "5@nan", "5@inf", "5@1@1", "1000001@0"]
        {
            assert!(text.parse::<Leg>().is_err(), "{text}");
        }
        for text in ["", "1..2", "1..2@", "2..2@3", "3..2@3", "1-2@3", "-1..2@3", "1..2@-3"] {
            assert!(text.parse::<Detour>().is_err(), "{text}");
        }
    }
}
