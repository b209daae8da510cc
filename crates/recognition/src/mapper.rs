//! Mapping while driving: new views become references, in groups, and a track on the references so
//! far tells whether a place was seen before.

use std::collections::VecDeque;

#[cfg(feature = "serde")]
use super::TrackSnapshot;
use super::recognizer::check_control;
use super::references::Exemplar;
use super::{Answer, Options, RecognitionError, Recognizer, Track};
use crate::motion::{OffMap, RouteControl, RouteTransition};
use crate::observation::{Distance, ViewError, check_descriptor, view_change};
use wayfix::error::{At, OutOfRange};
#[cfg(feature = "serde")]
use wayfix::internal::MOST_STEPS;

/// Builds the references while the vehicle drives, and decides whether it is at a new place or at
/// one that it has seen before.
///
/// Each view becomes a reference unless its place was seen before or it equals the last one; views
/// of the last [`gap`](Self::with_gap) steps do not count as seen before. Where odometry says that
/// the vehicle stands, views that hardly change do not become references either. A place counts as
/// seen again once the track has passed references that amount to five wholly new views, without a
/// jump, and is sure to within a few of them; so a route along which views change by less in all is
/// not recognised. References join the model in groups. A step costs as
/// much as a [`Track`] step, and every sixteenth reference costs 96 more comparisons of O(n d), for n
/// references of d numbers each.
///
/// With the feature `serde` a mapper can be stored and resumed after a restart.
///
/// The first views of a second pass become references again, until the track has found itself: in
/// another season, usual scores have to be learned anew. A [`Recognizer`] of the first pass knows
/// that each place is on the map, and does not have to find out that the vehicle is back on it.
///
/// ```
/// use wayfix_recognition::observation::Distance;
/// use wayfix_recognition::{Mapper, Options};
///
/// // A loop of 120 places, driven one and a half times.
/// let image = |place: usize| -> Vec<f32> {
///     (1..17).map(|k| ((place * 16 + k).pow(2) as f32 * 0.37).sin()).collect()
/// };
/// let mut mapper = Mapper::new(Distance::Cosine, Options::default())?;
/// let mut again = 0;
/// for step in 0..180 {
///     let place = mapper.step(&image(step % 120))?.and_then(|seen| seen.place);
///     again += u32::from(place.is_some_and(|place| place.abs_diff(step % 120) <= 2));
/// }
/// assert!(again > 30);
/// assert!(mapper.references().len() < 150);
/// # Ok::<(), wayfix_recognition::RecognitionError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Mapper {
    distance: Distance,
    options: Options,
    /// Checks odometry readings.
    motion: RouteTransition,
    gap: usize,
    references: Vec<Vec<f32>>,
    /// Step at which each reference was added.
    added: Vec<usize>,
    steps: usize,
    /// Mean change from one view to the next, and the number of changes.
    usual_change: (f64, u32),
    /// Distance driven since the last reference, by odometry; `None` if a reading is missing.
    driven: Option<f64>,
    track: Option<Track>,
    /// Last views, and the reference that each became, if it did.
    recent: VecDeque<(Vec<f32>, Option<usize>)>,
    /// References along which the track has found itself, without a jump.
    run: Option<Run>,
}

/// A run of answers without a jump.
#[derive(Debug, Clone, Copy)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
struct Run {
    first: usize,
    last: usize,
    now: usize,
}

/// Number of references added to the model at once.
const BATCH: usize = 16;
/// Number of references of the first model: the best match among a few says little, as even wrong
/// ones differ.
const FIRST: usize = 48;
/// Largest Euclidean length of a descriptor.
const LONGEST: f64 = 1.7e38;
/// Default rates: rare, so that the views decide whether the vehicle is back on the map or has left
/// it.
const MAPPING: OffMap = OffMap { leave: 1e-4, back: 1e-3, near: 0.3, within: 10 };
/// Number of recent views that teach the usual scores of the season, and the weight of each, in
/// queries.
const RECENT: usize = 32;
const RECENT_WEIGHT: f64 = 0.5;
/// Least change along a run of answers before it is believed, in wholly new views: a dark stretch
/// looks like another but leads nowhere, and five views a metre apart may amount to one new view.
const PASSED: f64 = 5.0;
/// Largest distance between successive answers of a run, in references, unless it amounts to less
/// than one wholly new view.
const JUMP: usize = 5;
/// Least probability that the vehicle is within `AROUND` references of an answer, for the answer to
/// be believed.
const SURE: f64 = 0.9;
const AROUND: usize = 5;
/// Change up to which a view repeats another without odometry, in units of the usual change: in a
/// tunnel views change less than in front of a red light.
const EQUAL: f64 = 1e-4;
/// Distance driven below which a vehicle may have stood, in references.
const STOOD: f64 = 0.5;

impl Mapper {
    /// Creates a mapper without references. If the options do not model leaving the map, the
    /// vehicle leaves it once in ten thousand steps, and comes back once in a thousand.
    ///
    /// # Errors
    ///
    /// [`RecognitionError`] for options that are not valid.
    pub fn new(distance: Distance, mut options: Options) -> Result<Self, RecognitionError> {
        if options.off_map.is_none() {
            options.off_map = Some(MAPPING);
        }
        // A route is not known to be a loop until it has closed.
        options.closed = false;
        options.check()?;
        let motion = options.motion(1, options.speeds.clone())?;
        let motion = motion.with_off_map(options.off_map.unwrap_or(MAPPING))?;
        Ok(Self {
            motion,
            distance,
            options,
            gap: 30,
            references: Vec::new(),
            added: Vec::new(),
            steps: 0,
            usual_change: (0.0, 0),
            driven: None,
            track: None,
            recent: VecDeque::new(),
            run: None,
        })
    }

    /// Sets the least number of steps between two views of the same place, 30 by default: views a
    /// few steps apart always look alike.
    #[must_use]
    pub fn with_gap(self, gap: usize) -> Self {
        Self { gap, ..self }
    }

    /// Distance of descriptors.
    #[must_use]
    pub fn distance(&self) -> Distance {
        self.distance
    }

    /// References so far.
    #[must_use]
    pub fn references(&self) -> &[Vec<f32>] {
        &self.references
    }

    /// Takes the next descriptor. Returns the answer at a place that was seen before, or `None` at a
    /// new one: its view is then the last reference, or hardly differs from it.
    ///
    /// # Errors
    ///
    /// [`RecognitionError`] for a descriptor that is not valid; the mapper is then as before.
    pub fn step(&mut self, query: &[f32]) -> Result<Option<Answer>, RecognitionError> {
        self.step_with(None::<f64>, query)
    }

    /// Takes the distance driven since the last step by odometry, in references, and the next
    /// descriptor, as [`step`](Self::step) does. The distance is a number, or `None` without a
    /// reading.
    ///
    /// # Errors
    ///
    /// [`RecognitionError`] for a descriptor or a reading that is not valid; the mapper is
    /// then as before.
    pub fn step_with(
        &mut self,
        odometry: impl Into<Option<f64>>,
        query: &[f32],
    ) -> Result<Option<Answer>, RecognitionError> {
        let odometry = odometry.into();
        self.check(query, odometry)?;
        // The track grows before it takes the view, so the view is compared with all references
        // that are old enough.
        self.grow()?;
        // The track skips a repeated frame, of a slow camera or a vehicle that stands: it shows
        // neither a place nor a motion.
        let last = self.recent.back();
        let repeated = odometry.is_none() && last.is_some_and(|(view, _)| view == query);
        let answer = match &mut self.track {
            Some(track) if repeated => Some(track.present()),
            Some(track) => Some(track.step_with(odometry, query)?),
            None => None,
        };
        self.steps += 1;
        self.driven = self.driven.zip(odometry).map(|(driven, reading)| driven + reading.abs());
        let seen = answer.filter(|answer| self.is_believed(answer));
        let is_new = seen.is_none() && self.is_new_view(query);
        if is_new {
            self.references.push(query.to_vec());
            self.added.push(self.steps);
            self.driven = Some(0.0);
        }
        // Views that merely repeat the last reference would outweigh all others while the vehicle
        // stands.
        if !repeated && (is_new || seen.is_some()) {
            if self.recent.len() == RECENT {
                self.recent.pop_front();
            }
            self.recent.push_back((query.to_vec(), is_new.then(|| self.references.len() - 1)));
        }
        Ok(seen)
    }

    /// Returns a recogniser of the references so far, for later drives.
    ///
    /// # Errors
    ///
    /// [`RecognitionError`] without references, or if all are equal.
    pub fn recognizer(&self, options: Options) -> Result<Recognizer, RecognitionError> {
        Recognizer::from_descriptors(&self.references, self.distance, options)
    }

    /// True if an answer is that of a place seen before: several answers before it lead there, and
    /// the track is sure.
    fn is_believed(&mut self, answer: &Answer) -> bool {
        let (Some(track), Some(place)) = (&self.track, answer.place) else {
            self.run = None;
            return false;
        };
        // Number of wholly new views that some references amount to, at the usual change of a view.
        let usual = if self.usual_change.1 > 0 { self.usual_change.0.min(1.0) } else { 1.0 };
        let new_views = |count: usize| count as f64 * usual;
        let goes_on = |apart: usize| apart <= JUMP || new_views(apart) <= 1.0;
        let run = match self.run {
            Some(run) if goes_on(run.now.abs_diff(place)) => {
                Run { first: run.first.min(place), last: run.last.max(place), now: place }
            }
            _ => Run { first: place, last: place, now: place },
        };
        self.run = Some(run);
        let around = self.options.window.max(AROUND);
        let near = track.recognizer().mass_near(track.places().as_slice(), place, around);
        new_views(run.last - run.first) >= PASSED && near >= SURE
    }

    /// True if a descriptor differs from that of the last reference.
    fn is_new_view(&mut self, query: &[f32]) -> bool {
        let Some(last) = self.references.last() else { return true };
        let change = view_change(last, query).unwrap_or(1.0);
        let (usual, count) = &mut self.usual_change;
        let stood = self.driven.is_some_and(|driven| driven < STOOD);
        let part = if stood { self.options.view_threshold.max(EQUAL) } else { EQUAL };
        let is_new = *count == 0 && change > 0.0 || change > part * *usual;
        // The usual change is from view to view, so a change since a place that was seen again does
        // not count; views between that repeat the last reference are not recent ones.
        let last_new = self.recent.back().and_then(|(_, reference)| *reference);
        if is_new && last_new == Some(self.references.len() - 1) {
            *count = count.saturating_add(1);
            *usual += (change - *usual) / f64::from(*count);
        }
        is_new
    }

    /// Checks a query, which may become a reference, and an odometry reading.
    fn check(&self, query: &[f32], odometry: Option<f64>) -> Result<(), RecognitionError> {
        let step = self.steps + 1;
        let failed = |cause| RecognitionError::descriptor(step, cause);
        if let Some(first) = self.references.first()
            && first.len() != query.len()
        {
            let (which, index) = ("query", 0);
            let (length, expected) = (query.len(), first.len());
            return Err(failed(ViewError::Length { which, index, length, expected }));
        }
        check_descriptor(query, self.distance).map_err(failed)?;
        let squares: f64 = query.iter().map(|x| f64::from(*x).powi(2)).sum();
        // Up to this length, the distance between any two descriptors fits 32 bits.
        if self.distance == Distance::Euclidean && squares.sqrt() > LONGEST {
            let (what, value) = ("the length of a descriptor", squares.sqrt());
            return Err(OutOfRange::new(what, value, "at most 1.7e38").into());
        }
        let control = RouteControl { odometry, ..RouteControl::default() };
        check_control(&self.motion, step, &control)
    }

    /// Adds references to the model once enough of them are old enough.
    fn grow(&mut self) -> Result<(), RecognitionError> {
        let known = self.track.as_ref().map_or(0, |track| track.recognizer().references());
        let old = |added: &usize| added.saturating_add(self.gap) <= self.steps;
        // References were added in the order of steps, so the old enough ones are a prefix: the
        // model's references stay the first of all.
        let count = self.added.iter().take_while(|added| old(added)).count();
        if count < (known + BATCH).max(FIRST) {
            return Ok(());
        }
        let references = &self.references[..count];
        let made = Recognizer::from_descriptors(references, self.distance, self.options.clone());
        let recognizer = match made {
            Ok(recognizer) => recognizer,
            // A vehicle that stands may give equal descriptors for a while: the model waits.
            Err(RecognitionError::References(At { cause: ViewError::AllEqual { .. }, .. })) => {
                return Ok(());
            }
            Err(error) => return Err(error),
        };
        let views = self.recent.iter().map(|(descriptor, reference)| Exemplar {
            descriptor,
            reference: *reference,
            weight: RECENT_WEIGHT,
        });
        let recognizer = recognizer.after_views(views)?;
        // A new track has the steps of the mapper, so that errors name them.
        self.track = Some(match &self.track {
            Some(track) => track.extended(&recognizer)?,
            None => recognizer.track().after(self.steps)?,
        });
        Ok(())
    }
}

#[cfg(feature = "serde")]
wayfix::stored! {
    [] Mapper: [], |mapper| {
        distance: Distance = mapper.distance,
        options: Options = mapper.options,
        gap: usize = mapper.gap,
        references: Vec<Vec<f32>> = mapper.references,
        added: Vec<usize> = mapper.added,
        steps: usize = mapper.steps,
        usual_change: (f64, u32) = mapper.usual_change,
        driven: Option<f64> = mapper.driven,
        track: Option<TrackSnapshot> = mapper.track.as_ref().map(Track::snapshot),
        recent: VecDeque<(Vec<f32>, Option<usize>)> = mapper.recent,
        run: Option<Run> = mapper.run,
    } => Self::new(distance, options).map_err(|error| error.to_string()).and_then(|new| {
        let new = Self { gap, references, added, steps, usual_change, driven, recent, run, ..new };
        new.restored(track)
    });
}

#[cfg(feature = "serde")]
impl Mapper {
    /// Checks parts read from storage, and restores the track on the first references.
    fn restored(mut self, track: Option<TrackSnapshot>) -> Result<Self, String> {
        let text = |error: RecognitionError| error.to_string();
        let Self { references, added, recent, run, distance, .. } = &self;
        let (count, dimension) = (references.len(), references.first().map_or(0, Vec::len));
        for view in references.iter().chain(recent.iter().map(|(view, _)| view)) {
            check_descriptor(view, *distance).map_err(|error| error.to_string())?;
            if view.len() != dimension {
                return Err(format!("a view of {} numbers, expected {dimension}", view.len()));
            }
        }
        let rising = added.is_sorted_by(|a, b| a < b);
        if self.steps >= MOST_STEPS || recent.len() > RECENT {
            let (steps, recent) = (self.steps, recent.len());
            return Err(format!(
                "{steps} steps and {recent} recent views, expected at most {RECENT}"
            ));
        }
        if added.len() != count || !rising || added.last().is_some_and(|at| *at > self.steps) {
            let steps = self.steps;
            return Err(format!("references added at {added:?} of {steps} steps, of {count}"));
        }
        let known = track.as_ref().map_or(0, TrackSnapshot::references);
        let shown = recent.iter().filter_map(|(_, reference)| *reference).max();
        let passed = run.map(|run| run.first.max(run.last).max(run.now));
        let beyond = |place: Option<usize>, count: usize| place.is_some_and(|place| place >= count);
        if known > count || beyond(shown, count) || beyond(passed, known) {
            return Err(format!("a place beyond {count} references, {known} of them tracked"));
        }
        if let Some(run) = run.filter(|run| !(run.first..=run.last).contains(&run.now)) {
            return Err(format!("{run:?}, expected `now` from `first` to `last`"));
        }
        let (usual, driven) = (self.usual_change.0, self.driven.unwrap_or(0.0));
        if !((0.0..=2.0).contains(&usual) && (0.0..=f64::MAX).contains(&driven)) {
            return Err(format!("a usual change of {usual} and a distance driven of {driven}"));
        }
        if let Some(state) = track {
            if state.steps() > self.steps {
                return Err(format!("{} steps of the track, of {}", state.steps(), self.steps));
            }
            let known = &self.references[..known];
            let made = Recognizer::from_descriptors(known, self.distance, self.options.clone());
            let mut track = made.map_err(text)?.track();
            track.restore(&state).map_err(text)?;
            self.track = Some(track);
        }
        Ok(self)
    }
}
