//! Disturbances of real cameras and drives, inserted into a recording: pixels of the query are
//! altered before the descriptors are computed, and frames are lost or repeated.

use std::ops::Range;

use rand::RngExt;
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use rand_distr::{Distribution, StandardNormal};

use crate::vpr::drive::Drive;
use crate::vpr::patches::Frames;
use crate::vpr::settings::Settings;
use crate::vpr::synthetic::grey;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Black, except for the noise of the sensor.
    Tunnel,
    /// A bright grey with little remaining contrast.
    Fog,
    /// A tenth of the light, with noise.
    Night,
    /// A part of the image that does not change.
    Lens,
    /// Noisy copies of another part of the map, passed at the speed of the vehicle.
    LookAlike,
    /// Jumps of gain and offset, so large that pixels saturate.
    Exposure,
    /// Half of the frames are lost.
    Dropped,
    /// Each frame comes once, twice or three times.
    Repeated,
}

/// All kinds with their names in the outputs.
pub(crate) const KINDS: [(Kind, &str); 8] = [
    (Kind::Tunnel, "tunnel"),
    (Kind::Fog, "fog"),
    (Kind::Night, "night"),
    (Kind::Lens, "lens"),
    (Kind::LookAlike, "look_alike"),
    (Kind::Exposure, "exposure"),
    (Kind::Dropped, "dropped"),
    (Kind::Repeated, "repeated"),
];

/// A query pass along a map.
pub(crate) struct Pass<'a> {
    pub(crate) references: &'a Frames,
    /// References of the map.
    pub(crate) map: Range<usize>,
    pub(crate) queries: &'a Frames,
    pub(crate) drive: Drive,
}

/// A pass with disturbances.
#[derive(Debug)]
pub(crate) struct Disturbed {
    /// Frames shown, one per step.
    pub(crate) shown: Frames,
    /// True positions of the vehicle.
    pub(crate) drive: Drive,
    /// Step of the undisturbed drive for each step; never decreasing.
    sources: Vec<usize>,
    /// Disturbed steps, as steps of the undisturbed drive.
    stretches: Vec<Range<usize>>,
}

/// Creates an independent generator for each stream; streams 0 and 1 are in use elsewhere.
pub(crate) fn generator(seed: u64, stream: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(stream);
    rng
}

/// Maps grey values, and adds noise of the given standard deviation.
fn alter(frame: &mut [u8], deviation: f64, rng: &mut ChaCha8Rng, map: impl Fn(f64) -> f64) {
    for pixel in frame {
        let noise: f64 = StandardNormal.sample(rng);
        *pixel = grey(map(f64::from(*pixel)) + deviation * noise);
    }
}

impl Pass<'_> {
    /// Disturbs stretches in order, cycling through the kinds.
    pub(crate) fn disturbed(
        &self,
        stretches: &[Range<usize>],
        kinds: &[Kind],
        seed: u64,
    ) -> Disturbed {
        let (mut shown, mut next) = (Vec::new(), 0);
        for ((stretch, kind), stream) in stretches.iter().zip(kinds.iter().cycle()).zip(3..) {
            shown.extend((next..stretch.start).map(|step| (step, self.seen(step))));
            self.disturb(stretch.clone(), *kind, &mut generator(seed, stream), &mut shown);
            next = stretch.end;
        }
        shown.extend((next..self.drive.frames.len()).map(|step| (step, self.seen(step))));
        let (sources, pixels): (Vec<usize>, Vec<Vec<u8>>) = shown.into_iter().unzip();
        // The vehicle also passes the places of lost frames.
        let mut passed = 0;
        let distances = sources.iter().map(|&source| {
            let driven = self.drive.distances[passed..=source].iter().skip(1).sum();
            passed = source;
            driven
        });
        Disturbed {
            drive: Drive {
                distances: distances.collect(),
                frames: sources.iter().map(|source| self.drive.frames[*source]).collect(),
            },
            shown: Frames { pixels: pixels.concat(), ..*self.queries },
            sources,
            stretches: stretches.to_vec(),
        }
    }

    fn seen(&self, step: usize) -> Vec<u8> {
        self.queries.frame(self.drive.frames[step]).to_vec()
    }

    /// Appends the steps of a stretch with the frames shown at each.
    fn disturb(
        &self,
        stretch: Range<usize>,
        kind: Kind,
        rng: &mut ChaCha8Rng,
        shown: &mut Vec<(usize, Vec<u8>)>,
    ) {
        let Frames { rows, cols, .. } = *self.queries;
        let contrast = rng.random_range(0.05..0.3);
        // The cover takes between a quarter and all of the image.
        let tall = rng.random_range(rows.div_ceil(2)..=rows);
        let wide = rng.random_range(cols.div_ceil(2)..=cols);
        let top = rng.random_range(0..=rows - tall);
        let left = rng.random_range(0..=cols - wide);
        // At least a quarter of the map away, in both directions.
        let n = self.map.len();
        let away = rng.random_range(n / 4..=n - n / 4);
        let (mut gain, mut offset) = (0.0, 0.0);
        for step in stretch.clone() {
            let mut frame = self.seen(step);
            match kind {
                Kind::Tunnel => alter(&mut frame, 3.0, rng, |_| 4.0),
                Kind::Fog => alter(&mut frame, 2.0, rng, |grey| 190.0 + contrast * (grey - 190.0)),
                Kind::Night => alter(&mut frame, 4.0, rng, |grey| 0.1 * grey),
                Kind::Lens => {
                    let lines = frame.chunks_mut(cols).skip(top).take(tall);
                    lines.for_each(|line| line[left..left + wide].fill(60));
                }
                Kind::LookAlike => {
                    let place = (self.drive.frames[step] + away + n - self.map.start % n) % n;
                    frame = self.references.frame(self.map.start + place).to_vec();
                    alter(&mut frame, 12.0, rng, |grey| grey);
                }
                Kind::Exposure => {
                    if step == stretch.start || rng.random_bool(0.2) {
                        gain = 2_f64.powf(rng.random_range(-2.0..2.0));
                        offset = rng.random_range(-80.0..80.0);
                    }
                    alter(&mut frame, 0.0, rng, |grey| gain * grey + offset);
                }
                Kind::Dropped if rng.random_bool(0.5) => continue,
                Kind::Dropped => {}
                Kind::Repeated => {
                    shown
                        .extend(std::iter::repeat_n((step, frame.clone()), rng.random_range(0..3)));
                }
            }
            shown.push((step, frame));
        }
    }
}

impl Disturbed {
    /// Maps the settings to the disturbed steps: the same steps are learned from and reported on.
    pub(crate) fn settings(&self, settings: &Settings) -> Settings {
        let now = |step: usize| self.sources.partition_point(|source| *source < step);
        let reported =
            |step: &usize| settings.report_on.binary_search(&self.sources[*step]).is_ok();
        Settings {
            fit_on: settings.fit_on.iter().map(|part| now(part.start)..now(part.end)).collect(),
            report_on: (0..self.sources.len()).filter(reported).collect(),
            // The fit is that of the undisturbed recording.
            save: None,
            ..settings.clone()
        }
    }

    /// Disturbed steps.
    pub(crate) fn steps(&self) -> Vec<usize> {
        let within = |step: &usize| self.stretches.iter().any(|s| s.contains(&self.sources[*step]));
        (0..self.sources.len()).filter(within).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROWS: usize = 4;
    const COLS: usize = 6;

    /// Frames in which frame i has the grey values i, i + 1, i + 2, …
    fn frames(count: u8) -> Frames {
        let frame = |i: u8| (0..24).map(move |pixel| i + pixel);
        Frames { rows: ROWS, cols: COLS, pixels: (0..count).flat_map(frame).collect() }
    }

    fn disturbed(kind: Kind, stretch: Range<usize>, seed: u64) -> (Drive, Frames, Disturbed) {
        let (references, queries) = (frames(200), frames(100));
        let legs = [crate::vpr::drive::Leg { steps: 80, speed: 0.5 }];
        let drive = Drive::new(&legs, 20, 100).unwrap();
        let pass =
            Pass { references: &references, map: 10..150, queries: &queries, drive: drive.clone() };
        let disturbed = pass.disturbed(&[stretch], &[kind], seed);
        (drive, queries, disturbed)
    }

    #[test]
    fn only_the_stretch_is_altered_and_seeds_decide_how() {
        for (kind, name) in KINDS.into_iter().filter(|kind| kind.0 as u8 <= Kind::Exposure as u8) {
            let (drive, queries, now) = disturbed(kind, 30..50, 1);
            assert_eq!(now.drive, drive, "{name}");
            assert_eq!(now.steps(), (30..50).collect::<Vec<_>>());
            for step in 0..81 {
                let same = now.shown.frame(step) == queries.frame(drive.frames[step]);
                assert_eq!(same, !(30..50).contains(&step), "{name}, step {step}");
            }
            assert_eq!(now.shown.pixels, disturbed(kind, 30..50, 1).2.shown.pixels);
            assert_ne!(now.shown.pixels, disturbed(kind, 30..50, 2).2.shown.pixels, "{name}");
        }
    }

    #[test]
    fn pixels_are_as_the_kind_says() {
        let of = |kind| disturbed(kind, 30..50, 3).2.shown;
        let all = |frames: &Frames, test: fn(u8) -> bool| {
            (30..50).all(|step| frames.frame(step).iter().all(|pixel| test(*pixel)))
        };
        assert!(all(&of(Kind::Tunnel), |pixel| pixel < 24));
        assert!(all(&of(Kind::Fog), |pixel| pixel > 120));
        assert!(all(&of(Kind::Night), |pixel| pixel < 30));
        let lens = of(Kind::Lens);
        let covered = (0..24).filter(|at| (30..50).all(|step| lens.frame(step)[*at] == 60));
        assert!(covered.count() >= 6);
        // At least 256 pixels away from the truth, except for noise, or around the loop.
        let like = of(Kind::LookAlike);
        let mean = |step: usize| like.frame(step).iter().map(|p| f64::from(*p)).sum::<f64>() / 24.0;
        assert!((mean(30) - 46.5).abs() > 25.0 && (mean(40) - mean(30)).abs() < 16.0);
    }

    #[test]
    fn frames_are_lost_and_come_again() {
        let (drive, queries, now) = disturbed(Kind::Dropped, 30..60, 1);
        let lost = 81 - now.drive.frames.len();
        assert!((5..25).contains(&lost) && now.steps().len() == 30 - lost);
        assert_eq!(now.drive.distances.iter().sum::<f64>(), drive.distances.iter().sum::<f64>());
        let shown = |now: &Disturbed| {
            (0..now.drive.frames.len())
                .all(|step| now.shown.frame(step) == queries.frame(now.drive.frames[step]))
        };
        assert!(shown(&now));
        let (_, _, now) = disturbed(Kind::Repeated, 30..60, 1);
        let more = now.drive.frames.len() - 81;
        assert!((15..45).contains(&more) && now.steps().len() == 30 + more && shown(&now));
        assert_eq!(now.drive.distances.iter().sum::<f64>(), drive.distances.iter().sum::<f64>());

        // Later steps are shifted.
        let settings = Settings {
            fit_on: vec![0..20, 70..75],
            report_on: (20..70).chain(75..81).collect(),
            lag: 1,
            off_map: false,
            tolerances: vec![1],
            ..Settings::default()
        };
        let moved = now.settings(&settings);
        assert_eq!(moved.fit_on, [0..20, 70 + more..75 + more]);
        assert_eq!(
            moved.report_on,
            (20..70 + more).chain(75 + more..81 + more).collect::<Vec<_>>()
        );
    }
}
