//! The model: references, motion and camera. The prior is that of a vehicle that may be anywhere,
//! at the first observation; a fit replaces parameters, never the references.

use std::sync::Arc;

use super::parameters::Parameters;
use super::references::{Exemplar, References, Scratch};
use super::sensor::{KNOWN_COUNT, Sensor};
use super::{Options, RecognitionError};
use crate::motion::{RouteControl, RouteTransition};
use crate::observation::Distance;
use wayfix::InferenceError;
use wayfix::LikelihoodVector;
use wayfix::Transition;
use wayfix::error::Count;
use wayfix::likelihood::GroupedLikelihood;
use wayfix::{Hmm, Prior};
use wayfix_kernels as kernels;

/// The hidden Markov model: motion along a route, and likelihoods of its places.
pub(super) type Model = Hmm<RouteTransition, GroupedLikelihood<LikelihoodVector>>;

/// Creates a model of a vehicle that may be anywhere at first, with a sensor of the places and of
/// off the map.
pub(super) fn model(
    motion: RouteTransition,
    sensor: LikelihoodVector,
) -> Result<Model, RecognitionError> {
    let groups = motion.place_groups();
    let (found, expected) = (groups.count(), wayfix::Likelihood::states(&sensor));
    let wrong = |_| RecognitionError::Count(Count { what: "groups of states", found, expected });
    let prior = Prior::AtFirstObservation(motion.anywhere());
    let camera = GroupedLikelihood::new(sensor, groups).map_err(wrong)?;
    Hmm::new(prior, motion, camera).map_err(wrong)
}

/// Checks the control of a step, numbered from 1.
pub(super) fn check_control(
    motion: &RouteTransition,
    step: usize,
    control: &RouteControl,
) -> Result<(), RecognitionError> {
    Ok(motion.check_control(control).map_err(|cause| InferenceError::control(step, cause))?)
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
    /// [`RecognitionError`] for references or options that are not valid, if there are no
    /// traverses, or if their lengths differ.
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
        // Motion always has states off the map: without `off_map` they stand for a lost vehicle.
        let motion = parameters.options.motion(references.count())?;
        let sensor = LikelihoodVector::linear(references.count() + 1);
        let model = Arc::new(model(motion, sensor)?);
        let standardizer = match &parameters.standardizer {
            Some(known) => known.clone(),
            None => references.standardizer().map_err(|cause| RecognitionError::query(0, cause))?,
        };
        let sensor = Sensor::new(standardizer.discounted(KNOWN_COUNT));
        Ok(Self { references, parameters, sensor, model })
    }

    /// Learns usual scores from recent views, beside those learned from references alone.
    pub(super) fn after_views<'a>(
        mut self,
        views: impl Iterator<Item = Exemplar<'a>>,
    ) -> Result<Self, RecognitionError> {
        let mut standardizer = self.sensor.standardizer;
        let mut scratch = Scratch::default();
        for view in views {
            let invalid = |cause| RecognitionError::query(0, cause);
            self.references.observe(view, &mut standardizer, &mut scratch).map_err(invalid)?;
        }
        self.sensor = Sensor::new(standardizer);
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
        self.model.transition()
    }

    /// Length of a belief over places: one entry for each place, and one for off the map if that is
    /// modelled.
    pub(super) fn places(&self) -> usize {
        self.references() + usize::from(self.options().off_map.is_some())
    }

    /// Marginalises a belief over states to one over places.
    pub(super) fn marginalize_places(&self, belief: &[f64], places: &mut [f64]) {
        let (places, off) = places.split_at_mut(self.references());
        let lost = self.motion().marginalize_places(belief, places);
        if let [off] = off {
            *off = lost;
        } else {
            // Without a model of leaving the map, answers are conditional on a vehicle that is not
            // lost.
            let found = kernels::sum(places);
            if found >= f64::MIN_POSITIVE {
                let scale = 1.0 / found;
                places.iter_mut().for_each(|place| *place *= scale);
            } else {
                // Surely lost, or beyond the range of doubles: nothing is known of the place.
                places.fill(1.0 / places.len() as f64);
            }
        }
    }
}
