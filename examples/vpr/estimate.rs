//! The methods of the library on a recording: single images, filter, fixed lag,
//! smoother and Viterbi.

use std::error::Error;
use std::time::Instant;

use wayfix::recognition::{self, PlaceBeliefs, RecognitionError, Recognizer};
use wayfix::{BeliefView, evaluate};

use super::recording::{Answers, Recording};
use super::settings::Settings;
use super::{fit, spinner};

/// Number of steps within which a filter must find its place.
const LOCALISE: usize = 100;

/// Estimates of all methods.
pub(crate) struct Estimates {
    pub(crate) answers: Vec<Answers>,
    /// Smoothed beliefs, T × n.
    pub(crate) belief: Vec<f32>,
    /// Place at each step, for each lag.
    pub(crate) lags: Vec<(usize, Vec<Option<usize>>)>,
    /// Notes to print beside the results.
    pub(crate) notes: Vec<String>,
}

pub(crate) fn estimate(
    recording: &Recording,
    settings: &Settings,
) -> Result<Estimates, Box<dyn Error>> {
    let recognizer = fit::recognizer(recording, settings)?;
    let width = width(recording, settings);
    Task { recording, settings, recognizer, width }.run()
}

/// Number of references on either side of the middle that are right, too: half the
/// usual length of the labelled ranges, or of all if none was learned from.
fn width(recording: &Recording, settings: &Settings) -> usize {
    let labelled = settings.fit_on.iter().cloned().flatten();
    let steps: Vec<usize> = match &settings.fit_on[..] {
        [] => (0..recording.steps()).collect(),
        _ => labelled.collect(),
    };
    let labels = steps.into_iter().filter_map(|step| recording.truth[step].as_ref());
    let mut lengths: Vec<usize> = labels.map(|range| range.end() - range.start()).collect();
    lengths.sort_unstable();
    lengths.get(lengths.len() / 2).map_or(0, |length| length / 2)
}

struct Task<'a> {
    recording: &'a Recording,
    settings: &'a Settings,
    recognizer: Recognizer,
    /// Number of references on either side of the middle that are still right.
    width: usize,
}

impl Task<'_> {
    fn run(&self) -> Result<Estimates, Box<dyn Error>> {
        let Self { recording, settings, recognizer, .. } = self;
        let n = recording.references;
        let (seen, to_see) = self.timed("recording", || {
            recognizer.recording(&recording.rows(), &recording.readings())
        })?;
        let mut notes = fit::notes(recognizer.fit(), recording, settings);
        notes.extend(seen.warning().as_ref().map(fit::warned));

        let mut answers = vec![self.answers("single", &seen.single(), None)];
        let (filtered, _) = self.timed("filter", || seen.filtered())?;
        let (log_likelihood, live) = self.timed("filter, live", || self.live())?;
        answers.push(self.answers("filter", &filtered, Some(live)));
        let lags = self.lagged(&seen, &mut answers)?;
        let (smoothed, ms) = self.timed("smoother", || seen.smoothed())?;
        answers.push(self.answers("smoother", &smoothed, Some(to_see + ms)));
        let (path, ms) = self.timed("Viterbi", || seen.decoded())?;
        let path = self.answers_at("viterbi", path, &smoothed, Some(to_see + ms));
        answers.push(path);

        notes.push(format!(
            "a step of the filter takes {live:.3} ms beside the comparison of images; \
             log-likelihood {log_likelihood:.1}"
        ));
        notes.extend(self.localised()?);
        let belief = smoothed.iter();
        let belief = belief.flat_map(|belief| belief.as_slice()[..n].to_vec());
        Ok(Estimates { answers, belief: belief.map(|p| p as f32).collect(), lags, notes })
    }

    /// Returns the result of a method and its time per step in milliseconds.
    fn timed<T>(
        &self,
        what: &'static str,
        run: impl FnOnce() -> Result<T, RecognitionError>,
    ) -> Result<(T, f64), RecognitionError> {
        let spinner = spinner(what);
        let start = Instant::now();
        let result = run();
        let ms = 1e3 * start.elapsed().as_secs_f64() / self.recording.steps() as f64;
        spinner.finish_and_clear();
        Ok((result?, ms))
    }

    /// Filters the recording step by step, as on a vehicle, and returns the log-likelihood.
    fn live(&self) -> Result<f64, RecognitionError> {
        let mut track = self.recognizer.track();
        for step in 0..self.recording.steps() {
            track.step(self.recording.row(step), self.recording.reading(step))?;
        }
        Ok(track.log_likelihood())
    }

    /// Places at several lags, and the answers at the chosen lag.
    #[expect(clippy::type_complexity, reason = "as `Estimates` has it")]
    fn lagged(
        &self,
        seen: &recognition::Recording,
        answers: &mut Vec<Answers>,
    ) -> Result<Vec<(usize, Vec<Option<usize>>)>, RecognitionError> {
        let lag = self.settings.lag;
        let mut lags = vec![0, 1, 2, 5, 10, 20, lag];
        lags.sort_unstable();
        lags.dedup();
        let (all, _) = self.timed("fixed lag", || seen.lagged(&lags))?;
        let mut places = Vec::new();
        for (of, beliefs) in lags.into_iter().zip(all) {
            let found = self.answers("fixed_lag", &beliefs, None);
            places.push((of, found.places.clone()));
            if of == lag {
                answers.push(found);
            }
        }
        Ok(places)
    }

    /// Reports how soon a filter without a known start finds the place, from starts all over the
    /// recording, except for steps that are learned from or off the map.
    fn localised(&self) -> Result<Option<String>, Box<dyn Error>> {
        let count = self.recording.steps();
        let tolerance = self.settings.tolerances.iter().copied().max().unwrap_or(0);
        let fitted = |step: &usize| self.settings.fit_on.iter().any(|range| range.contains(step));
        let starts = (0..count).step_by(count.div_ceil(40)).filter(|step| !fitted(step));
        let (mut steps, mut tried) = (Vec::new(), 0);
        for start in starts.filter(|step| self.recording.truth[*step].is_some()) {
            let mut track = self.recognizer.track();
            let mut masses = Vec::new();
            for step in start..count.min(start + LOCALISE) {
                let reading = self.recording.reading(step).filter(|_| step > start);
                let place = track.step(self.recording.row(step), reading)?.place;
                let mass = self.mass_near(track.places(), place, tolerance);
                masses.push((mass, self.recording.is_right(step, place, tolerance)));
            }
            tried += 1;
            steps.extend(evaluate::steps_to_localize_correctly(&masses, 0.9, 5)?);
        }
        steps.sort_unstable();
        let (found, half) = match steps.get(steps.len() / 2) {
            Some(median) => (steps.len().to_string(), format!(", half of these within {median}")),
            None => (String::from("none"), String::new()),
        };
        Ok((tried > 0).then(|| {
            format!(
                "started anywhere, {found} of {tried} find their place to {tolerance} within \
                 {LOCALISE} steps (mass of 0.9, right for 5 steps){half}"
            )
        }))
    }

    /// Probability that a place is right to a tolerance, or of being off the map.
    fn mass_near(&self, belief: BeliefView<'_>, place: Option<usize>, tolerance: usize) -> f64 {
        let belief = belief.as_slice();
        let within = tolerance.saturating_add(self.width);
        match place {
            Some(place) => self.recognizer.mass_near(belief, place, within),
            None => belief.get(self.recording.references).copied().unwrap_or(0.0).min(1.0),
        }
    }

    /// Probability of the true places.
    fn true_mass(&self, beliefs: &PlaceBeliefs, step: usize, tolerance: usize) -> f64 {
        let (Some(_), Some(belief)) = (&self.recording.truth[step], beliefs.get(step)) else {
            return beliefs.mass(step, None);
        };
        let right = |i: &usize| self.recording.is_right(step, Some(*i), tolerance);
        let places = belief.as_slice()[..self.recording.references].iter().enumerate();
        places.filter(|(i, _)| right(i)).map(|(_, p)| p).sum::<f64>().min(1.0)
    }

    fn answers(&self, method: &str, beliefs: &PlaceBeliefs, step_ms: Option<f64>) -> Answers {
        let found = beliefs.answers();
        let truth = |tolerance: &usize| {
            (0..found.len()).map(|step| self.true_mass(beliefs, step, *tolerance)).collect()
        };
        let on_map = || found.iter().map(|answer| 1.0 - answer.off_map).collect();
        let places = found.iter().map(|answer| answer.place).collect();
        Answers {
            truth_mass: Some(self.settings.tolerances.iter().map(truth).collect()),
            on_map: self.settings.off_map.then(on_map),
            ..self.answers_at(method, places, beliefs, step_ms)
        }
    }

    /// Answers with the probabilities that the beliefs give to the places.
    fn answers_at(
        &self,
        method: &str,
        places: Vec<Option<usize>>,
        beliefs: &PlaceBeliefs,
        step_ms: Option<f64>,
    ) -> Answers {
        let near = |tolerance: &usize| {
            let pairs = beliefs.iter().zip(&places);
            pairs.map(|(belief, place)| self.mass_near(belief, *place, *tolerance)).collect()
        };
        let probability: Vec<Vec<f64>> = self.settings.tolerances.iter().map(near).collect();
        Answers {
            method: method.into(),
            confidence: probability[0].clone(),
            probability: Some(probability),
            places,
            step_ms,
            ..Answers::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use std::ops::Range;

    use super::*;

    /// A drive along 40 references, then off the map, then on it; two references are right at
    /// each step.
    fn recording(closed: bool) -> Recording {
        let places = (0..30).map(Some).chain([None; 12]).chain((25..40).map(Some));
        let truth: Vec<_> = places.map(|place| place.map(|i: usize| i..=(i + 1).min(39))).collect();
        let seen = |step: usize, i: usize| {
            let right = truth[step].as_ref().is_some_and(|places| places.contains(&i));
            ((step * 31 + i * 17) % 13) as f32 / 10.0 - if right { 4.0 } else { 0.0 }
        };
        let cells = (0..truth.len()).flat_map(|step| (0..40).map(move |i| (step, i)));
        let distances = cells.map(|(step, i)| seen(step, i)).collect();
        Recording { references: 40, distances, truth, closed, ..Recording::default() }
    }

    fn settings() -> Settings {
        Settings {
            fit_on: vec![0..25; 1],
            report_on: (25..57).collect(),
            lag: 4,
            off_map: true,
            tolerances: vec![1, 3],
            ..Settings::default()
        }
    }

    #[test]
    fn methods_agree_where_all_is_clear() {
        for closed in [false, true] {
            let recording = recording(closed);
            let found = estimate(&recording, &settings()).unwrap();
            let methods: Vec<_> = found.answers.iter().map(|of| &of.method[..]).collect();
            assert_eq!(methods, ["single", "filter", "fixed_lag", "smoother", "viterbi"]);
            for answers in &found.answers {
                let right = |step: &usize| recording.is_right(*step, answers.places[*step], 1);
                let count = |steps: Range<usize>| steps.filter(right).count();
                assert!(count(5..30) == 25, "{}", answers.method);
                // The rates off the map are known only afterwards.
                if ["smoother", "viterbi"].contains(&&answers.method[..]) {
                    assert!(count(0..57) >= 53, "{} {}", answers.method, count(0..57));
                }
                let masses = answers.probability.iter().chain(&answers.truth_mass).flatten();
                assert!(masses.flatten().all(|p| (0.0..=1.0).contains(p)));
                assert_eq!(answers.on_map.is_some(), answers.method != "viterbi");
            }
            assert_eq!(
                found.lags.iter().map(|lag| lag.0).collect::<Vec<_>>(),
                [0, 1, 2, 4, 5, 10, 20]
            );
            // A lag of 0 is filtering.
            assert_eq!(found.lags[0].1, found.answers[1].places);
            assert_eq!(found.belief.len(), 57 * 40);
            let masses = |at: usize| found.answers[at].truth_mass.as_ref().unwrap();
            assert!((0..57).all(|step| masses(3)[0][step] <= masses(3)[1][step]));
            assert!((0..25).chain(32..40).all(|step| masses(3)[0][step] > 0.5));
        }
    }
}
