//! A whole drive, and its beliefs. A track runs over it once; smoother and decoder then share its
//! likelihoods.

use std::borrow::Borrow;
use std::ops::RangeInclusive;

use super::readings::Readings;
use super::recognizer::at_most_one;
use super::{Answer, RecognitionError, Recognizer};
use crate::motion::RouteControl;
use crate::observation::Standardizer;
use wayfix::Sequence;
use wayfix::error::OutOfRange;
use wayfix::inference::Order;
use wayfix::transition::Distraction;
use wayfix::{Belief, BeliefView};

/// A drive compared with the references, to be filtered, smoothed or decoded.
///
/// Step k, counted from 1, is that of query k − 1. Likelihoods are those of their time: the sensor
/// learns about the references as the vehicle drives, and the smoother uses the likelihoods that
/// the filter had.
#[derive(Debug, Clone)]
pub struct Recording {
    pub(super) recognizer: Recognizer,
    pub(super) controls: Vec<Distraction<RouteControl>>,
    pub(super) likelihoods: Vec<Vec<f64>>,
    /// Odometry readings, also those that did not count.
    pub(super) readings: Vec<Option<f64>>,
    pub(super) filtered: PlaceBeliefs,
    /// Beliefs over places, each by the last new frame alone.
    pub(super) single: PlaceBeliefs,
    /// Usual scores at the end of the recording.
    pub(super) standardizer: Standardizer,
    /// Longest run of equal readings that are stuck.
    pub(super) stuck: Readings,
}

/// Beliefs over places, one for each step of a recording.
#[derive(Debug, Clone)]
pub struct PlaceBeliefs {
    recognizer: Recognizer,
    rows: Vec<f64>,
    log_likelihoods: Vec<f64>,
}

impl Recognizer {
    /// Compares a whole drive with the references: a query for each step, and the odometry reading
    /// of the way before it, in references, or none at all. Memory: 8 bytes for each of O(steps ×
    /// n) numbers.
    ///
    /// # Errors
    ///
    /// [`RecognitionError`] for a query that is not valid, with its step, or if the numbers of
    /// odometry readings and queries differ.
    pub fn recording<Q: AsRef<[f32]>>(
        &self,
        queries: &[Q],
        odometry: &[Option<f64>],
    ) -> Result<Recording, RecognitionError> {
        if !(odometry.is_empty() || odometry.len() == queries.len()) {
            let (found, expected) = (odometry.len(), queries.len());
            return Err(
                OutOfRange::count("the number of odometry readings", found, expected).into()
            );
        }
        let mut track = self.track();
        let mut recording = Recording {
            recognizer: self.clone(),
            controls: Vec::new(),
            likelihoods: Vec::new(),
            readings: Vec::new(),
            filtered: PlaceBeliefs::new(self, queries.len()),
            single: PlaceBeliefs::new(self, queries.len()),
            standardizer: self.sensor.standardizer.clone(),
            stuck: Readings::default(),
        };
        for (at, query) in queries.iter().enumerate() {
            let reading = odometry.get(at).copied().flatten();
            let sighting = track.observe(reading, query.as_ref())?;
            let log_likelihood = track.advance(&sighting.control)?;
            recording.likelihoods.push(track.scratch().likelihoods.clone());
            recording.single.set_single(at, &track.scratch().standardized);
            recording.filtered.set(at, track.places().as_slice(), log_likelihood);
            recording.controls.push(sighting.control);
            recording.readings.push(reading);
            track.learn(&sighting);
            recording.stuck = recording.stuck.longer(track.sensor().readings);
        }
        recording.standardizer.clone_from(&track.sensor().standardizer);
        Ok(recording)
    }
}

impl Recording {
    /// Number of steps.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.controls.len()
    }

    /// Filtered beliefs: that of each step, given the queries up to it.
    #[must_use]
    pub fn filtered(&self) -> PlaceBeliefs {
        self.filtered.clone()
    }

    /// Smoothed beliefs: that of each step, given all queries. O(n k √steps) memory beside the
    /// result.
    ///
    /// # Errors
    ///
    /// [`RecognitionError::Inference`] with the step that is impossible.
    pub fn smoothed(&self) -> Result<PlaceBeliefs, RecognitionError> {
        let mut beliefs = PlaceBeliefs::new(&self.recognizer, self.steps());
        self.recognizer.model.smooth_each(self, Order::Backward, |step| {
            if let Some(at) = step.step().checked_sub(1) {
                beliefs.set_states(at, step.smoothed(), 0.0);
            }
        })?;
        Ok(beliefs)
    }

    /// Fixed-lag beliefs: that of each step, given the queries up to `lag` steps later; one result
    /// for each lag. O(n k longest lag) a step, and as much memory.
    ///
    /// # Errors
    ///
    /// [`RecognitionError::Inference`] with the step that is impossible.
    pub fn lagged(&self, lags: &[usize]) -> Result<Vec<PlaceBeliefs>, RecognitionError> {
        let count = self.steps();
        let mut all = vec![PlaceBeliefs::new(&self.recognizer, count); lags.len()];
        let longest = lags.iter().copied().max().unwrap_or(0).min(count.saturating_sub(1));
        let mut stream = self.recognizer.model.fixed_lag(longest);
        let mut logs = Vec::with_capacity(count);
        for (now, (control, likelihoods)) in self.controls.iter().zip(&self.likelihoods).enumerate()
        {
            logs.push(stream.step_with(control, likelihoods)?);
            for (lag, beliefs) in lags.iter().zip(&mut all) {
                // A step is due `lag` steps later; at the end all remaining ones are, given all
                // queries.
                let oldest = now.saturating_sub(*lag);
                let due = if now + 1 == count { oldest..count } else { oldest..oldest + 1 };
                for at in due.filter(|at| now + 1 == count || at + *lag == now) {
                    if let Some(belief) = stream.get(at + 1) {
                        beliefs.set_states(at, belief, logs[at]);
                    }
                }
            }
        }
        Ok(all)
    }

    /// Single-image beliefs: that of each step, given the last new query alone and a uniform prior.
    /// O(n) a step.
    ///
    /// A baseline: motion adds the difference by which [`filtered`](Self::filtered) is right more
    /// often. The odds are those of [`Options::odds`](super::Options::odds), of standardised scores that are
    /// bounded by those of neighbours.
    #[must_use]
    pub fn single(&self) -> PlaceBeliefs {
        self.single.clone()
    }
}

/// The drive for other models: the motion before each step, and the likelihoods of places.
impl<Y: ?Sized> Sequence<Distraction<RouteControl>, Y> for Recording
where
    Vec<f64>: Borrow<Y>,
{
    fn steps(&self) -> usize {
        self.controls.len()
    }

    fn control(&self, step: usize) -> &Distraction<RouteControl> {
        &self.controls[step - 1]
    }

    fn observation(&self, step: usize) -> &Y {
        self.likelihoods[step - 1].borrow()
    }
}

impl PlaceBeliefs {
    fn new(recognizer: &Recognizer, steps: usize) -> Self {
        let rows = vec![0.0; recognizer.places() * steps];
        let log_likelihoods = vec![0.0; steps];
        Self { recognizer: recognizer.clone(), rows, log_likelihoods }
    }

    fn row_mut(&mut self, at: usize) -> &mut [f64] {
        let width = self.recognizer.places();
        &mut self.rows[at * width..][..width]
    }

    fn set(&mut self, at: usize, places: &[f64], log_likelihood: f64) {
        self.row_mut(at).copy_from_slice(places);
        self.log_likelihoods[at] = log_likelihood;
    }

    /// Sets a step to the places of a belief over states.
    fn set_states(&mut self, at: usize, belief: BeliefView<'_>, log_likelihood: f64) {
        let Self { recognizer, rows, log_likelihoods } = self;
        let width = recognizer.places();
        recognizer.marginalize_places(belief.as_slice(), &mut rows[at * width..][..width]);
        log_likelihoods[at] = log_likelihood;
    }

    /// Sets a step to the belief by standardised scores alone.
    fn set_single(&mut self, at: usize, scores: &[f64]) {
        let odds = self.recognizer.options().odds();
        let off = self.recognizer.options().off_map.map_or(0.0, |off_map| off_map.share());
        let n = self.recognizer.references();
        let own = self.row_mut(at);
        let (places, off_map) = own.split_at_mut(n);
        odds.odds_of(scores, places);
        places.iter_mut().for_each(|place| *place *= (1.0 - off) / n as f64);
        off_map.fill(off);
        let sum: f64 = own.iter().sum();
        // A frame that rules out all places leaves the prior.
        if sum > 0.0 {
            own.iter_mut().for_each(|own| *own /= sum);
        } else {
            own[..n].fill((1.0 - off) / n as f64);
        }
        self.log_likelihoods[at] = sum.ln();
    }

    /// Number of steps.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.log_likelihoods.len()
    }

    /// Returns the belief over places at a step, from 0, with a last entry for off the map if that
    /// is modelled; `None` beyond the last step.
    #[must_use]
    pub fn get(&self, at: usize) -> Option<BeliefView<'_>> {
        let width = self.recognizer.places();
        let start = at.checked_mul(width)?;
        Some(Belief::view(self.rows.get(start..start.checked_add(width)?)?))
    }

    /// Iterates over the beliefs, step by step.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = BeliefView<'_>> {
        self.rows.chunks_exact(self.recognizer.places()).map(Belief::view)
    }

    /// Returns the answer of each step. Its log-likelihood is that of the filter's step, and 0 for
    /// smoothed beliefs.
    #[must_use]
    pub fn answers(&self) -> Vec<Answer> {
        let beliefs = self.rows.chunks_exact(self.recognizer.places());
        let pairs = beliefs.zip(&self.log_likelihoods);
        pairs.map(|(places, log)| self.recognizer.answer(places, *log)).collect()
    }

    /// Returns the probability of some places, or of off the map for `None`, at a step, from 0; 0
    /// beyond the last step. Places beyond the last count as 0.
    #[must_use]
    pub fn mass(&self, at: usize, places: Option<&RangeInclusive<usize>>) -> f64 {
        let Some(belief) = self.get(at) else { return 0.0 };
        let (belief, n) = (belief.as_slice(), self.recognizer.references());
        let sum: f64 = match places {
            None => belief.get(n).copied().unwrap_or(0.0),
            Some(places) => {
                let end = places.end().saturating_add(1).min(n);
                belief[(*places.start()).min(end)..end].iter().sum()
            }
        };
        at_most_one(sum)
    }
}
