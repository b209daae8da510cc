//! The model: references, motion and camera; and its answers, from a belief: the middle of the most
//! probable window, and the mass around it. The prior is that of a vehicle that may be anywhere, at
//! the first observation; a fit replaces parameters, never the references.

use std::ops::RangeInclusive;
use std::sync::Arc;

use super::parameters::Parameters;
use super::references::{Exemplar, ExemplarScratch, References};
use super::sensor::{KNOWN_COUNT, Sensor};
use super::{Options, RecognitionError};
use crate::motion::{RouteControl, RouteTransition, Speeds};
use crate::observation::Distance;
use wayfix::inference::Distractor;
use wayfix::internal::buffers;
use wayfix::likelihood::{GroupedLikelihood, Groups};
use wayfix::transition::{DistractedTransition, DistractionRates};
use wayfix::{Belief, Hmm, HmmError, Likelihood, LikelihoodVector, Prior, Transition};
use wayfix_kernels as kernels;

/// The hidden Markov model: motion along a route of a vehicle whose camera is attentive or
/// distracted, and likelihoods of its places.
pub(super) type Model =
    Hmm<DistractedTransition<RouteTransition>, GroupedLikelihood<LikelihoodVector>>;
/// The place that a distracted camera follows.
pub(super) type Phantom = Distractor<Arc<RouteTransition>>;

/// Creates a model of a vehicle that may be anywhere at first. The sensor has a likelihood for each
/// place, one for off the map, and then, for a distracted camera, one or again as many.
pub(super) fn model(
    motion: RouteTransition,
    distractions: DistractionRates,
    sensor: LikelihoodVector,
) -> Result<Model, RecognitionError> {
    // Checks the rates and the number of states, before anything as long is made.
    let motion = DistractedTransition::new(motion, distractions)?;
    let (places, anywhere) = (motion.base().place_groups(), motion.base().anywhere());
    let (count, all) = (places.count(), Likelihood::states(&sensor));
    let attentive = places.as_slice().iter().copied();
    let distracted = attentive.clone().map(|place| count + if all > count + 1 { place } else { 0 });
    let groups = Groups::new(attentive.chain(distracted).collect())?;
    let shares = [1.0 - distractions.begin, distractions.begin];
    let modes = shares.iter().flat_map(|share| anywhere.as_slice().iter().map(move |p| p * share));
    let prior = Prior::AtFirstObservation(Belief::from_weights(modes.collect())?);
    Ok(Hmm::new(prior, motion, GroupedLikelihood::new(sensor, groups)?)?)
}

/// Checks the control of a step, numbered from 1.
pub(super) fn check_control(
    motion: &RouteTransition,
    step: usize,
    control: &RouteControl,
) -> Result<(), RecognitionError> {
    Ok(motion.check_control(control).map_err(|cause| HmmError::control(step, cause))?)
}

/// Recognises places along a route by images of an earlier pass.
///
/// Made from references and, optionally, [fitted](Self::fit) to labelled parts of drives;
/// then [`track`](Self::track) follows a vehicle live, and [`recording`](Self::recording)
/// takes a whole drive at once. Cheap to clone: references and model are shared.
///
/// ```
/// use wayfix_recognition::observation::Distance;
/// use wayfix_recognition::{Options, Recognizer};
///
/// // Descriptors of 40 references, and a drive past some of them.
/// let image = |place: usize| -> Vec<f32> {
///     (1..9).map(|k| ((place * 8 + k).pow(2) as f32 * 0.37).sin()).collect()
/// };
/// let references: Vec<Vec<f32>> = (0..40).map(image).collect();
/// let recognizer = Recognizer::from_descriptors(&references, Distance::Cosine, Options::default())?;
///
/// let mut track = recognizer.track();
/// for place in 12..30 {
///     let answer = track.step(&image(place))?;
///     if place > 20 {
///         assert_eq!(answer.place, Some(place));
///         assert!(answer.probability > 0.9);
///     }
/// }
/// # Ok::<(), wayfix_recognition::RecognitionError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Recognizer {
    pub(super) references: Arc<References>,
    parameters: Parameters,
    /// The sensor before the first query.
    pub(super) sensor: Sensor,
    pub(super) model: Arc<Model>,
    /// Before the first query.
    pub(super) phantom: Phantom,
}

impl Recognizer {
    /// Creates a recogniser for queries that are descriptors, from a descriptor for each
    /// reference. [`Distance::Cosine`] suits networks, [`Distance::Euclidean`] pixels.
    ///
    /// # Errors
    ///
    /// [`RecognitionError`] for references or options that are not valid.
    pub fn from_descriptors<R: AsRef<[f32]>>(
        references: &[R],
        distance: Distance,
        options: Options,
    ) -> Result<Self, RecognitionError> {
        Self::from_traverses(&[references], distance, options)
    }

    /// Creates a recogniser from several passes along the route, in other seasons or weather:
    /// reference i of each shows place i. The distance of a query from a place is the smallest over
    /// the passes.
    ///
    /// # Errors
    ///
    /// [`RecognitionError`] for references or options that are not valid, without traverses,
    /// or if their lengths differ.
    pub fn from_traverses<R: AsRef<[f32]>>(
        traverses: &[&[R]],
        distance: Distance,
        options: Options,
    ) -> Result<Self, RecognitionError> {
        let references = References::from_traverses(traverses, distance)?;
        Self::make(Arc::new(references), Parameters::new(options))
    }

    /// Creates a recogniser for queries that are rows of distances to this many references, smaller
    /// for more alike, by any comparison. For similarities, give their negatives.
    ///
    /// # Errors
    ///
    /// [`RecognitionError`] for no references or options that are not valid.
    pub fn from_distances(references: usize, options: Options) -> Result<Self, RecognitionError> {
        Self::make(Arc::new(References::Compared(references)), Parameters::new(options))
    }

    /// Returns a recogniser of the same references with another fit, such as a stored one. What was
    /// learned of single references is dropped if their number differs.
    ///
    /// # Errors
    ///
    /// [`RecognitionError`] if the fit is not valid.
    pub fn with_parameters(&self, fit: Parameters) -> Result<Self, RecognitionError> {
        Self::make(Arc::clone(&self.references), fit)
    }

    fn make(references: Arc<References>, fit: Parameters) -> Result<Self, RecognitionError> {
        let parameters = fit.checked(references.count())?;
        let (options, count) = (&parameters.options, references.count());
        // Motion always has states off the map: without `off_map` they stand for a lost vehicle.
        let motion = options.motion(count, options.speeds.clone())?;
        let sensor = LikelihoodVector::linear(count + 2);
        let model = Arc::new(model(
            motion.with_off_map(options.off_map.unwrap_or(options.lost))?,
            options.distractions,
            sensor,
        )?);
        // Every second speed: a phantom need not be followed as closely as the vehicle.
        let speeds: Vec<f64> = options.speeds.values().iter().step_by(2).copied().collect();
        let phantom = Arc::new(options.motion(count, Speeds::new(&speeds)?)?);
        let phantom =
            Distractor::new(Arc::clone(&phantom), phantom.anywhere(), options.distractions)?;
        let standardizer = match &parameters.standardizer {
            Some(known) => known.clone(),
            None => references.standardizer().map_err(|cause| RecognitionError::query(0, cause))?,
        };
        let sensor = Sensor::new(standardizer.discounted(KNOWN_COUNT), options);
        Ok(Self { references, parameters, sensor, model, phantom })
    }

    /// Learns usual scores from recent views, beside those learned from references alone.
    pub(super) fn after_views<'a>(
        mut self,
        views: impl Iterator<Item = Exemplar<'a>>,
    ) -> Result<Self, RecognitionError> {
        let mut standardizer = self.sensor.standardizer.clone();
        let mut scratch = ExemplarScratch::default();
        for view in views {
            let invalid = |cause| RecognitionError::query(0, cause);
            self.references.observe(view, &mut standardizer, &mut scratch).map_err(invalid)?;
        }
        self.sensor = Sensor::new(standardizer, self.options());
        Ok(self)
    }

    /// Number of references, n.
    #[must_use]
    pub fn references(&self) -> usize {
        self.references.count()
    }

    /// Options, as given or learned.
    #[must_use]
    pub fn options(&self) -> &Options {
        &self.parameters.options
    }

    /// Result of learning, or the given options if nothing was learned.
    #[must_use]
    pub fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    /// Model of motion.
    #[must_use]
    pub fn motion(&self) -> &RouteTransition {
        self.model.transition().base()
    }

    /// Length of a belief over places: one entry for each place, and one for off the map if that is
    /// modelled.
    pub(super) fn places(&self) -> usize {
        self.references() + usize::from(self.options().off_map.is_some())
    }

    /// Number of states of the phantom.
    pub(super) fn phantom_states(&self) -> usize {
        self.phantom.belief().as_slice().len()
    }

    /// Marginalises a belief over states to the places of an attentive camera and of a distracted
    /// one; returns the probability of off the map.
    pub(super) fn marginalize_modes(
        &self,
        belief: &[f64],
        [attentive, distracted]: [&mut [f64]; 2],
    ) -> f64 {
        let (first, second) = belief.split_at(belief.len() / 2);
        let motion = self.motion();
        motion.marginalize_places(first, attentive) + motion.marginalize_places(second, distracted)
    }

    /// Marginalises a belief over states to one over places.
    pub(super) fn marginalize_places(&self, belief: &[f64], places: &mut [f64]) {
        buffers::with_two(self.references(), |attentive, distracted| {
            let off = self.marginalize_modes(belief, [&mut *attentive, &mut *distracted]);
            self.combine_modes([attentive, distracted], off, places);
        });
    }

    /// Adds up the places of both modes.
    pub(super) fn combine_modes(
        &self,
        [attentive, distracted]: [&[f64]; 2],
        lost: f64,
        places: &mut [f64],
    ) {
        let (places, off) = places.split_at_mut(self.references());
        let modes = attentive.iter().zip(distracted);
        places.iter_mut().zip(modes).for_each(|(place, (a, d))| *place = a + d);
        if let [off] = off {
            *off = lost;
        } else {
            // Without a model of leaving the map, a lost vehicle may be anywhere.
            let each = lost / places.len() as f64;
            places.iter_mut().for_each(|place| *place += each);
        }
    }
}

/// Estimated position of the vehicle at one step.
#[derive(Debug, Clone, PartialEq)]
pub struct Answer {
    /// Place of the vehicle, or `None` if it is more probably off the map than on it.
    pub place: Option<usize>,
    /// Probability that the vehicle is within the [window](super::Options::window) of
    /// `place`, or that it is off the map if `place` is `None`. For another distance, or another
    /// place, see [`Recognizer::mass_near`].
    pub probability: f64,
    /// Places around `place` that hold 90% of the belief on the map; on a loop, the first may be
    /// above the last.
    pub around: RangeInclusive<usize>,
    /// Probability of being off the map.
    pub off_map: f64,
    /// ln p of the query and the measurements of this step, given all earlier ones.
    pub log_likelihood: f64,
}

/// Share of the belief that [`Answer::around`] holds.
const CREDIBLE: f64 = 0.9;
/// Tolerance for sums taken in a different order.
const ROUNDING: f64 = 1e-12;
/// Number of windows compared at a time.
const WINDOWS: usize = 8;

impl Recognizer {
    /// Returns the answer for a belief over places, which may end in an entry for off the map.
    pub(super) fn answer(&self, places: &[f64], log_likelihood: f64) -> Answer {
        let n = self.references();
        let off_map = at_most_one(places.get(n).copied().unwrap_or(0.0));
        let place = self.best_place(&places[..n]);
        let on_map = off_map <= 0.5;
        Answer {
            place: on_map.then_some(place),
            probability: if on_map {
                self.mass_near(places, place, self.options().window)
            } else {
                off_map
            },
            around: self.around(&places[..n], place),
            off_map,
            log_likelihood,
        }
    }

    /// Returns the centre of the most probable window; among equal windows, the most probable
    /// centre.
    fn best_place(&self, places: &[f64]) -> usize {
        let (n, window) = (places.len(), self.options().window);
        let mut best = (0, f64::NEG_INFINITY, f64::NEG_INFINITY);
        // Windows whose masses differ only by rounding are equal. `best.1` may fall by rounding at
        // each such exchange, but only as long as ever more probable centres follow.
        let offer = |best: &mut (usize, f64, f64), place: usize, mass: f64| {
            let more_probable = mass > best.1 - ROUNDING && places[place] > best.2;
            if mass > best.1 + ROUNDING || more_probable {
                *best = (place, mass, places[place]);
            }
        };
        // Windows cut by an end, or wrapped around a loop, are summed on their own.
        let edge = window.min(n);
        let ends = (0..edge).chain(n.saturating_sub(window).max(edge)..n);
        ends.for_each(|place| offer(&mut best, place, self.mass_near(places, place, window)));
        let width = window.saturating_mul(2).saturating_add(1);
        let count = (n + 1).saturating_sub(width);
        // Eight windows at a time; one by one only if one of them may be better than the best so
        // far.
        let mut first = 0;
        while first + WINDOWS <= count {
            let mut masses = [0.0; WINDOWS];
            // Entry k of eight successive places belongs to window first + k: `width` such slices
            // make the eight sums, in vectors.
            for eight in places[first..].windows(WINDOWS).take(width) {
                masses.iter_mut().zip(eight).for_each(|(mass, place)| *mass += place);
            }
            let above = masses.map(|mass| u8::from(mass > best.1 - ROUNDING));
            if above != [0; WINDOWS] {
                let masses = (first + window..).zip(masses);
                masses.for_each(|(place, mass)| offer(&mut best, place, mass));
            }
            first += WINDOWS;
        }
        for first in first..count {
            let mass = places[first..first + width].iter().sum();
            offer(&mut best, first + window, mass);
        }
        best.0
    }

    /// Returns the probability of all places at most `within` from `place`; NaN if any of their
    /// entries is.
    ///
    /// `places` is a belief over places as a slice, from [`Track::places`](super::Track::places) or
    /// from a step of [`PlaceBeliefs`](super::PlaceBeliefs::get). An entry for off the map is left
    /// out.
    ///
    /// ```
    /// use wayfix_recognition::{Options, Recognizer};
    ///
    /// let recognizer = Recognizer::from_distances(3, Options::default())?;
    /// let beliefs = recognizer.recording(&[[0.1, 0.9, 0.8]], &[])?.single();
    /// let places = beliefs.get(0).ok_or("no such step")?;
    /// let near = recognizer.mass_near(places.as_slice(), 0, 1);
    /// assert!((near - places.mass(0..2)?).abs() < 1e-12);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn mass_near(&self, places: &[f64], place: usize, within: usize) -> f64 {
        let n = self.references().min(places.len());
        let places = &places[..n];
        let sum: f64 = if self.options().closed && within < n {
            // A window as long as the loop would count places twice.
            if 2 * within + 1 >= n {
                places.iter().sum()
            } else {
                let first = place % n + n - within;
                (first..=first + 2 * within).map(|at| places[at % n]).sum()
            }
        } else {
            let end = place.saturating_add(within).saturating_add(1).min(n);
            places[place.saturating_sub(within).min(end)..end].iter().sum()
        };
        at_most_one(sum)
    }

    /// Grows a range from a place towards the more probable side until it holds enough.
    fn around(&self, places: &[f64], place: usize) -> RangeInclusive<usize> {
        let n = places.len();
        let wanted = CREDIBLE * kernels::sum(places);
        let (mut first, mut last, mut mass) = (place, place, places[place]);
        let mut count = 1;
        // Each iteration adds a place that is not yet in the range, so there are at most n.
        while mass < wanted && count < n {
            let (below, above) = if self.options().closed {
                (Some((first + n - 1) % n), Some((last + 1) % n))
            } else {
                (first.checked_sub(1), Some(last + 1).filter(|at| *at < n))
            };
            match (below, above) {
                (Some(a), b) if b.is_none_or(|b| places[a] >= places[b]) => {
                    (first, mass) = (a, mass + places[a]);
                }
                (_, Some(b)) => (last, mass) = (b, mass + places[b]),
                _ => break,
            }
            count += 1;
        }
        first..=last
    }
}

/// Clamps a sum of probabilities that rounding may have taken above 1; keeps NaN.
pub(super) fn at_most_one(sum: f64) -> f64 {
    // An empty sum is -0; adding 0 makes it +0.
    if sum > 1.0 { 1.0 } else { sum + 0.0 }
}
