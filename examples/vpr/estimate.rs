//! The methods of the library on a recording: single images, filter, fixed lag,
//! smoother and Viterbi.

use std::error::Error;
use std::ops::Range;

use wayfix::observation::{AppearanceLikelihood, Calibration, ObservationError, calibrate};
use wayfix::{
    Belief, Controlled, Fixed, Groups, Hmm, Learning, Likelihood, Order, Prior, RouteControl,
    TransitionEntries, evaluate,
};

use super::answers::places;
use super::model::{self, Camera, Model, Sighting, Steps};
use super::recording::{Answers, Recording};
use super::settings::Settings;

/// The temperatures that are tried, hottest first.
const TEMPERATURES: [f64; 9] = [4.0, 2.8, 2.0, 1.4, 1.0, 0.7, 0.5, 0.35, 0.25];

/// Differences of log scores that are not worth a colder temperature.
const WORTH: f64 = 0.01;
/// How far from the truth a probability still counts in the fit, in references.
/// It does not depend on what is reported.
const TOLERANCE: usize = 1;
/// How many steps a filter has to find its place.
const LOCALISE: usize = 100;

/// What the methods say.
pub(crate) struct Estimates {
    pub(crate) answers: Vec<Answers>,
    /// Smoothed, T × n.
    pub(crate) belief: Vec<f32>,
    /// For each lag, the place at each step.
    pub(crate) lags: Vec<(usize, Vec<Option<usize>>)>,
    /// What to print beside the results.
    pub(crate) notes: Vec<String>,
}

pub(crate) fn estimate(
    recording: &Recording,
    settings: &Settings,
) -> Result<Estimates, Box<dyn Error>> {
    let fit_on = &settings.fit_on;
    if !model::shows_motion(recording, fit_on) {
        let labelled = fit_on.iter().cloned().flatten();
        let on_map = labelled.clone().filter(|step| recording.truth[*step].is_some()).count();
        return Err(format!(
            "{on_map} of {} steps of --fit-on are on the map, expected at least 2 in a row",
            labelled.count(),
        )
        .into());
    }
    let steps = Steps::new(recording, fit_on)?;
    let cameras = model::cameras(recording, &steps, fit_on, settings.off_map)?;
    let (motion, occupied, note) = model::motion(recording, &steps, fit_on)?;
    let unchanged = steps.sightings.iter().filter(|sighting| sighting.is_none()).count();
    let notes = vec![format!("{unchanged} of {} views are unchanged", recording.steps()), note];
    let width = model::width(recording, fit_on);
    let task = Task { recording, settings, steps, cameras, width };
    if settings.off_map {
        let rates = model::off_map_rates(recording, fit_on);
        task.run(&model::with_off_map(motion, &occupied, rates)?, notes)
    } else {
        task.run(&model::on_map(motion, &occupied)?, notes)
    }
}

#[derive(Clone)]
pub(super) struct Task<'a> {
    pub(super) recording: &'a Recording,
    pub(super) settings: &'a Settings,
    steps: Steps,
    cameras: [(&'static str, AppearanceLikelihood); 3],
    /// How far from the middle of the true places is still right.
    pub(super) width: usize,
}

impl Task<'_> {
    fn run<A: TransitionEntries<Control = RouteControl> + Sync>(
        &self,
        model: &Model<A>,
        mut notes: Vec<String>,
    ) -> Result<Estimates, Box<dyn Error>> {
        let candidates: Vec<(usize, f64)> =
            (0..self.cameras.len()).flat_map(|at| TEMPERATURES.map(|t| (at, t))).collect();
        let calibration = if self.settings.off_map {
            let gap = model::with_a_gap(self.recording, &self.settings.fit_on);
            let steps = self.steps.with_rows(&gap);
            Task { recording: &gap, steps, ..self.clone() }.calibrate(model, &candidates)?
        } else {
            self.calibrate(model, &candidates)?
        };
        let (at, temperature) = candidates[calibration.chosen()];
        let (offsets, camera) = &self.cameras[at];
        let (alone, learned) = self.for_single_images(camera);
        notes.push(format!(
            "temperature {temperature} in sequence with offsets of {offsets}, {:.3} for single images",
            alone.temperature(),
        ));
        if let Err(error) = learned {
            notes.push(format!(
                "single images have the temperature of the sensor, as none was learned: {}",
                super::chain(&error)
            ));
        }
        let tables = self.cameras.iter().zip(calibration.scores().chunks(TEMPERATURES.len()));
        for ((offsets, _), scores) in tables {
            let tried = TEMPERATURES.iter().zip(scores);
            let tried: Vec<String> =
                tried.map(|(t, score)| format!("{t}: {}", super::decimals(*score, 3))).collect();
            notes.push(format!(
                "log scores, offsets of {offsets}, by temperature: {}",
                tried.join(", ")
            ));
        }

        let hmm = model.hmm(camera.clone().with_temperature(temperature)?)?;
        notes.push(format!("temperature without labels, {}", self.unlabelled(&hmm)?));
        notes.extend(self.localised(&hmm, &model.groups)?);
        let all = 0..self.recording.steps();
        let [filtered, smoothed] = self.beliefs(&hmm, &model.groups, &all)?;
        let [_, untempered] = self.beliefs(&model.hmm(alone.clone())?, &model.groups, &all)?;

        let path = hmm.viterbi(&self.sequence(&all)?)?;
        let path = model.groups.map_path(path.states())?;
        let (lags, lagged) = self.lagged(&hmm, &model.groups)?;

        let n = self.recording.references;
        let mut answers = vec![self.single(&alone)?];
        answers.push(self.answers("filter", &filtered));
        answers.push(self.answers("fixed_lag", &lagged));
        answers.push(self.answers("smoother", &smoothed));
        answers.push(self.answers("smoother_untempered", &untempered));
        answers.push(self.path_answers(&path, &smoothed));
        let belief = smoothed.iter().flat_map(|belief| belief[..n].iter().map(|p| *p as f32));
        Ok(Estimates { answers, belief: belief.collect(), lags, notes })
    }

    fn sequence(
        &self,
        range: &Range<usize>,
    ) -> Result<Controlled<'_, RouteControl, Sighting>, Box<dyn Error>> {
        let Steps { controls, sightings } = &self.steps;
        Ok(Controlled::new(&controls[range.clone()], &sightings[range.clone()])?)
    }

    /// The camera at the temperature that is best for single labelled images;
    /// as it is, if none is, and why.
    fn for_single_images(
        &self,
        camera: &AppearanceLikelihood,
    ) -> (AppearanceLikelihood, Result<(), ObservationError>) {
        let ranges = &self.settings.fit_on;
        let rows: Vec<&[f32]> =
            ranges.iter().cloned().flatten().map(|step| self.recording.row(step)).collect();
        let labels: Vec<Option<usize>> =
            ranges.iter().flat_map(|range| model::labels(self.recording, range)).collect();
        match camera.clone().with_learned_temperature(&rows, &labels) {
            Ok(learned) => (learned, Ok(())),
            Err(error) => (camera.clone(), Err(error)),
        }
    }

    /// The camera and temperature with which filter and smoother do well on the
    /// labelled part.
    fn calibrate<A: TransitionEntries<Control = RouteControl>>(
        &self,
        model: &Model<A>,
        candidates: &[(usize, f64)],
    ) -> Result<Calibration, Box<dyn Error>> {
        let bar = super::bar("fitting", candidates.len());
        let fitted = calibrate(candidates, WORTH, |(at, temperature)| {
            let hmm = model.hmm(self.cameras[*at].1.clone().with_temperature(*temperature)?)?;
            let mut scores = Vec::new();
            for range in &self.settings.fit_on {
                for beliefs in self.beliefs(&hmm, &model.groups, range)? {
                    let masses = beliefs.iter().zip(range.clone());
                    let masses = masses.map(|(p, step)| self.true_mass(p, step, TOLERANCE));
                    scores.extend(masses.map(f64::ln));
                }
            }
            bar.inc(1);
            Ok::<_, Box<dyn Error>>(scores)
        });
        bar.finish_and_clear();
        fitted
    }

    /// The temperature by expectation and maximisation on the labelled part,
    /// without its labels.
    fn unlabelled<A: TransitionEntries<Control = RouteControl> + Sync>(
        &self,
        hmm: &Hmm<&A, Camera>,
    ) -> Result<String, Box<dyn Error>> {
        let (prior, motion, camera) = hmm.clone().into_parts();
        let hmm = Hmm::new(prior, Fixed(motion), camera)?;
        let parts: Vec<_> = (self.settings.fit_on.iter())
            .map(|range| self.sequence(range))
            .collect::<Result<_, _>>()?;
        let learning = Learning { iterations: 20, keep_prior: true, ..Learning::default() };
        let learned = hmm.learn(&parts, &learning)?;
        let camera = learned.model().likelihood().sensor().sensor();
        Ok(format!(
            "{}: {:.3}",
            super::counted(learned.iterations(), "iteration"),
            camera.temperature()
        ))
    }

    /// How soon a filter that starts anywhere has found the place, from starts
    /// all over the recording that are neither learned from nor off the map.
    fn localised<A: TransitionEntries<Control = RouteControl>>(
        &self,
        hmm: &Hmm<&A, Camera>,
        groups: &Groups,
    ) -> Result<Option<String>, Box<dyn Error>> {
        let count = self.recording.steps();
        let tolerance = self.settings.tolerances.iter().copied().max().unwrap_or(0);
        let fitted = |step: &usize| self.settings.fit_on.iter().any(|range| range.contains(step));
        let starts = (0..count).step_by(count.div_ceil(40)).filter(|step| !fitted(step));
        let (mut steps, mut tried) = (Vec::new(), 0);
        for start in starts.filter(|step| self.recording.truth[*step].is_some()) {
            let mut filter = hmm.filter();
            let mut masses = Vec::new();
            for step in start..count.min(start + LOCALISE) {
                let seen = self.recording.row(step).to_vec();
                let sighting = self.steps.sightings[step].clone();
                // To a filter that has just begun, every view is new.
                let sighting = if step == start { Some(seen) } else { sighting };
                filter.step_with(&self.steps.controls[step], &sighting)?;
                let belief = places(groups, filter.belief())?;
                let place = self.place(&belief);
                let mass = self.mass_near(&belief, place, tolerance);
                masses.push((mass, self.recording.is_right(step, place, tolerance)));
            }
            tried += 1;
            steps.extend(evaluate::steps_to_localise_correctly(&masses, 0.9, 5)?);
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

    /// Filtered and smoothed probabilities of the places (and of off the map).
    fn beliefs<A: TransitionEntries<Control = RouteControl>>(
        &self,
        hmm: &Hmm<&A, Camera>,
        groups: &Groups,
        range: &Range<usize>,
    ) -> Result<[Vec<Vec<f64>>; 2], Box<dyn Error>> {
        let mut beliefs = [Vec::new(), Vec::new()];
        hmm.smooth_each(&self.sequence(range)?, Order::Backward, |step| {
            for (beliefs, belief) in beliefs.iter_mut().zip([step.filtered(), step.smoothed()]) {
                beliefs.push(places(groups, belief));
            }
        })?;
        // From last to first; the first is step 0.
        let [filtered, smoothed] = beliefs.map(|beliefs| {
            let steps = beliefs.into_iter().rev().skip(1);
            steps.collect::<Result<Vec<Vec<f64>>, _>>()
        });
        Ok([filtered?, smoothed?])
    }

    /// One pass of a fixed-lag smoother, read at several lags; and the beliefs
    /// at the lag asked for.
    #[expect(clippy::type_complexity, reason = "as `Estimates` has it")]
    fn lagged<A: TransitionEntries<Control = RouteControl>>(
        &self,
        hmm: &Hmm<&A, Camera>,
        groups: &Groups,
    ) -> Result<(Vec<(usize, Vec<Option<usize>>)>, Vec<Vec<f64>>), Box<dyn Error>> {
        let (count, lag) = (self.recording.steps(), self.settings.lag);
        let mut lags = vec![0, 1, 2, 5, 10, 20, lag];
        lags.sort_unstable();
        lags.dedup();
        let longest = lags[lags.len() - 1].min(count - 1);
        let mut answers: Vec<(usize, Vec<Option<usize>>)> =
            lags.into_iter().map(|lag| (lag, vec![None; count])).collect();
        let mut beliefs = vec![Vec::new(); count];
        let mut stream = hmm.fixed_lag(longest);
        let bar = super::bar("fixed lag", count);
        for now in 0..count {
            let Steps { controls, sightings } = &self.steps;
            stream.step_with(&controls[now], &sightings[now])?;
            for (of, answers) in &mut answers {
                // At the end, what is still due is answered with what there is.
                let oldest = now.saturating_sub(*of);
                let due = if now + 1 == count { oldest..count } else { oldest..oldest + 1 };
                for step in due.filter(|step| now + 1 == count || step + *of == now) {
                    let belief = stream.get(step + 1).ok_or("beyond the lag")?;
                    let belief = places(groups, belief)?;
                    answers[step] = self.place(&belief);
                    if *of == lag {
                        beliefs[step] = belief;
                    }
                }
            }
            bar.inc(1);
        }
        bar.finish_and_clear();
        Ok((answers, beliefs))
    }

    /// Each image on its own, all places alike before.
    fn single(&self, camera: &AppearanceLikelihood) -> Result<Answers, Box<dyn Error>> {
        let prior = Prior::AtFirstObservation(Belief::uniform(camera.states())?);
        let motion = wayfix::WindowTransition::new(camera.states(), 0, &[1.0], wayfix::Ends::Stop)?;
        let hmm = Hmm::new(prior, motion, camera)?;
        let mut filter = hmm.filter();
        let mut beliefs = Vec::new();
        for step in 0..self.recording.steps() {
            filter.restart();
            filter.step(&self.recording.row(step).to_vec())?;
            beliefs.push(filter.belief().as_slice().to_vec());
        }
        Ok(self.answers("single", &beliefs))
    }
}
