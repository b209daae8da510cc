//! The path of a drive: the legal path with the largest expected number of right steps, by Viterbi
//! on the smoothed beliefs.

use super::recognizer::{Model, model};
use super::{RecognitionError, Recording};
use wayfix::Controlled;
use wayfix::LikelihoodVector;

/// Gain of a right step, in nats of moves: large, so that moves only break near ties.
const STEP_GAIN: f64 = 1000.0;

impl Recording {
    /// Path with the most steps expected to be right, among those that the model allows: the place
    /// of each step, or `None` off the map.
    ///
    /// A step is right if the vehicle is within the [window](super::Options::window) of its place,
    /// or if both are off the map, by the smoothed beliefs. The path maximises the sum of these
    /// probabilities over all sequences of states with a probability above 0, and the logarithm of
    /// its moves breaks near ties: a nat counts as much as a thousandth of a step.
    ///
    /// The single most probable path, that of Viterbi, does worse where the vehicle takes one of
    /// many ways: when it comes back on the map it may do so anywhere, and off it speeds are
    /// lumped.
    ///
    /// Takes the time of a smoother and of Viterbi; 8 n (k + 1) bytes a step for back-pointers, and
    /// 16 n.
    ///
    /// # Errors
    ///
    /// [`RecognitionError::Inference`] with the step that is impossible.
    pub fn decoded(&self) -> Result<Vec<Option<usize>>, RecognitionError> {
        let gains = self.gains()?;
        let path = self.decoder()?.viterbi(&Controlled::new(&self.controls, &gains)?)?;
        let off_map = self.recognizer.options().off_map.is_some();
        // Without a model of leaving the map, a lost vehicle keeps the place where it was last
        // seen.
        let motion = self.recognizer.motion();
        let states = wayfix::Transition::states(motion);
        let place = |state: &usize| {
            let state = &(state % states);
            let is_place = !off_map || motion.speed_of(*state).is_some();
            motion.place_of(*state).filter(|_| is_place)
        };
        Ok(path.states().iter().map(place).collect())
    }

    /// Model of motion, with logarithms in place of likelihoods.
    fn decoder(&self) -> Result<Model, RecognitionError> {
        let sensor = LikelihoodVector::log(2 * (self.recognizer.references() + 1));
        let distractions = self.recognizer.options().distractions;
        model(self.recognizer.motion().clone(), distractions, sensor)
    }

    /// Probability that an answer is right, times [`STEP_GAIN`], for each place and for off the
    /// map, of an attentive camera and then of a distracted one; −∞ where the query rules it out.
    fn gains(&self) -> Result<Vec<Vec<f64>>, RecognitionError> {
        let (beliefs, recognizer) = (self.smoothed()?, &self.recognizer);
        let (n, window) = (recognizer.references(), recognizer.options().window);
        let rows = beliefs.iter().zip(&self.likelihoods).map(|(belief, likelihoods)| {
            let belief = belief.as_slice();
            let right = |place: usize| match belief.get(n) {
                _ if place < n => recognizer.mass_near(belief, place, window),
                // Without a model of leaving the map the belief has no entry for it: being lost is
                // never right.
                off => off.copied().unwrap_or(0.0),
            };
            let gains = (0..=n).map(|place| STEP_GAIN * right(place));
            // Only states with a likelihood of exactly 0 are forbidden; small likelihoods already
            // count in the smoothed belief.
            let attentive = gains.clone().zip(likelihoods).map(|(gain, likelihood)| {
                if *likelihood == 0.0 { f64::NEG_INFINITY } else { gain }
            });
            attentive.chain(gains).collect()
        });
        Ok(rows.collect())
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::LN_2;

    use super::*;
    use crate::motion::{OffMap, Speeds};
    use crate::{Options, Recognizer};
    use wayfix::TransitionEntries;

    /// Best value of all paths that go on from a state, by enumeration.
    fn best_from(
        recording: &Recording,
        gain: &dyn Fn(usize, usize) -> f64,
        at: usize,
        state: usize,
    ) -> f64 {
        let own = gain(at, state);
        if at + 1 == recording.steps() {
            return own;
        }
        let motion = recording.recognizer.model.transition();
        let next = motion.outgoing_log2(&recording.controls[at + 1], state);
        let values = next.map(|(to, log2)| log2 * LN_2 + best_from(recording, gain, at + 1, to));
        own + values.fold(f64::NEG_INFINITY, f64::max)
    }

    #[test]
    fn decoded_paths_are_the_best_of_all() {
        let off_maps = [None, Some(OffMap { leave: 0.1, back: 0.3, near: 0.5, within: 1 })];
        for (seed, off_map) in (0..12_u32).map(|seed| (seed, off_maps[seed as usize % 2])) {
            let speeds = Speeds::new(&[0.0, 1.0]).unwrap();
            let window = seed as usize % 3 % 2;
            let options = Options { speeds, off_map, window, ..Options::default() };
            let recognizer = Recognizer::from_distances(4, options).unwrap();
            let query = |step: u32| -> Vec<f32> {
                let far = |i: u32| ((step * 7 + i * 5 + seed * 3 + step * i * seed) % 11) as f32;
                (0..4).map(|i| if i == seed % 5 { f32::INFINITY } else { far(i) }).collect()
            };
            let queries: Vec<Vec<f32>> = (0..4).map(query).collect();
            let recording = recognizer.recording(&queries, &[]).unwrap();
            let beliefs = recording.smoothed().unwrap();
            let places = recognizer.motion().place_groups();
            let groups = places.as_slice().repeat(2);
            let right = |at: usize, place: usize| {
                let window = recognizer.options().window;
                let around = place.saturating_sub(window)..=(place + window).min(3);
                match place {
                    4 => beliefs.mass(at, None),
                    _ => beliefs.mass(at, Some(&around)),
                }
            };
            let attentive = groups.len() / 2;
            let gain = |at: usize, state: usize| match recording.likelihoods[at][groups[state]] {
                0.0 if state < attentive => f64::NEG_INFINITY,
                _ => STEP_GAIN * right(at, groups[state]),
            };
            let prior = recognizer.model.prior().belief();
            let starts = prior.as_slice().iter().enumerate();
            let best = starts.map(|(state, p)| p.ln() + best_from(&recording, &gain, 0, state));
            let best = best.fold(f64::NEG_INFINITY, f64::max);

            let gains = recording.gains().unwrap();
            let steps = Controlled::new(&recording.controls, &gains).unwrap();
            let path = recording.decoder().unwrap().viterbi(&steps).unwrap();
            let states = path.states();
            let mut value = prior.as_slice()[states[0]].ln() + gain(0, states[0]);
            for at in 1..states.len() {
                let control = &recording.controls[at];
                let motion = recognizer.model.transition();
                let mut moves = motion.outgoing_log2(control, states[at - 1]);
                let (_, log2) = moves.find(|(to, _)| *to == states[at]).expect("a legal move");
                value += log2 * LN_2 + gain(at, states[at]);
            }
            assert!((value - best).abs() < 1e-6, "{seed}: {value} and {best}");
            let place = |state: &usize| Some(groups[*state]).filter(|place| *place < 4);
            let decoded = recording.decoded().unwrap();
            if off_map.is_some() {
                assert_eq!(decoded, states.iter().map(place).collect::<Vec<_>>());
            } else {
                assert!(decoded.iter().all(Option::is_some));
            }
        }
    }
}
