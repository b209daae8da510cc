//! Mapping while driving.

use super::{Options, RecognitionError, Recognizer, Track};
use crate::error::InferenceError;
use crate::motion::{OffMap, RouteControl, RouteTransition, ViewChange};
use crate::observation::{
    Descriptor, DescriptorError, Distance, ReferenceDescriptors, ViewComparison,
};
use crate::transition::Transition;

/// Builds the references while the vehicle drives: is this a new place, or one that it has
/// seen before?
///
/// Each new view becomes a reference unless its place was seen before; views of the last
/// [`gap`](Self::with_gap) steps do not count as seen before. References join the model in
/// groups. A step costs as much as a [`Track`] step, and every sixteenth reference 64 comparisons
/// of O(n d) more, for n references of d numbers each.
///
/// On a railway by pixels (16 × 32, normalised in patches), first in summer and then in winter,
/// 98% to 100% of the first pass were taken for new; of the second, 78% to 88% were recognised,
/// none to 9% taken for another place, and the rest for new. By unnormalised pixels, almost all
/// of the second pass were taken for new.
///
/// ```
/// use wayfix::observation::Distance;
/// use wayfix::recognition::{Mapper, Options, Seen};
///
/// // A loop of 120 places, driven one time and a half.
/// let image = |place: usize| -> Vec<f32> {
///     (1..17).map(|k| ((place * 16 + k).pow(2) as f32 * 0.37).sin()).collect()
/// };
/// let mut mapper = Mapper::new(Distance::Cosine, Options::default())?;
/// let mut again = 0;
/// for step in 0..180 {
///     match mapper.step(&image(step % 120), None)? {
///         Seen::Again { reference, .. } if reference.abs_diff(step % 120) <= 2 => again += 1,
///         _ => {}
///     }
/// }
/// assert!(again > 30);
/// assert!(mapper.references().len() < 150);
/// # Ok::<(), wayfix::recognition::RecognitionError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Mapper {
    distance: Distance,
    options: Options,
    /// Checks odometry readings.
    motion: RouteTransition,
    gap: usize,
    references: Vec<Vec<f32>>,
    /// The step at which each reference was added.
    added: Vec<usize>,
    steps: usize,
    views: Option<ViewComparison>,
    track: Option<Track>,
}

/// Answer of a [`Mapper`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Seen {
    /// A place that was not seen before, or an unchanged view of the last such place.
    New {
        /// The last reference, which shows the place.
        reference: usize,
    },
    /// A place that was seen before.
    Again {
        /// The reference that shows the place.
        reference: usize,
        /// Probability that the vehicle is within the window of that reference.
        probability: f64,
    },
}

/// Number of references added to the model at once.
const BATCH: usize = 16;
/// Number of references of the first model: the best of a few says little, as even wrong ones
/// differ.
const FIRST: usize = 48;
/// Largest Euclidean length of a descriptor.
const LONGEST: f64 = 1.7e38;
/// Default rates: a vehicle that maps leaves the known part as often as it comes back to it.
const MAPPING: OffMap = OffMap { leave: 0.01, back: 0.01, near: 0.3, within: 10 };

impl Mapper {
    /// Creates a mapper without references. Unless the options model leaving the map, the vehicle
    /// leaves it and comes back every hundred steps, and the odds of being off it are 1.
    ///
    /// # Errors
    ///
    /// [`RecognitionError`] for options that are not valid.
    pub fn new(distance: Distance, mut options: Options) -> Result<Self, RecognitionError> {
        if options.off_map.is_none() {
            options.off_map = Some(MAPPING);
            // Dark stretches are new places, too, and need references like any other.
            options.off_map_odds = 1.0;
        }
        // A route is not known to be a loop until it has closed.
        options.closed = false;
        options.check()?;
        let motion = options.motion(1)?;
        Ok(Self {
            motion,
            distance,
            options,
            gap: 30,
            references: Vec::new(),
            added: Vec::new(),
            steps: 0,
            views: None,
            track: None,
        })
    }

    /// Sets the least number of steps between two views of the same place, 30 by default. Views a
    /// few steps apart always look alike.
    #[must_use]
    pub fn with_gap(self, gap: usize) -> Self {
        Self { gap, ..self }
    }

    /// The references so far.
    #[must_use]
    pub fn references(&self) -> &[Vec<f32>] {
        &self.references
    }

    /// Takes the next descriptor, and the distance driven since the last one, in references, if
    /// that is known.
    ///
    /// # Errors
    ///
    /// [`RecognitionError`] for a descriptor or a reading that is not valid; the mapper is
    /// then as before.
    pub fn step(&mut self, query: &[f32], odometry: Option<f64>) -> Result<Seen, RecognitionError> {
        self.check(query, odometry)?;
        self.grow()?;
        let answer = match &mut self.track {
            Some(track) => Some(track.step(query, odometry)?),
            None => None,
        };
        self.steps += 1;
        if let Some(answer) = answer
            && let Some(reference) = answer.place
        {
            return Ok(Seen::Again { reference, probability: answer.probability });
        }
        if self.is_new_view(query) {
            self.references.push(query.to_vec());
            self.added.push(self.steps);
        }
        Ok(Seen::New { reference: self.references.len() - 1 })
    }

    /// Returns a recogniser of the references so far, for later drives.
    ///
    /// # Errors
    ///
    /// [`RecognitionError`] if there are no references, or all are equal.
    pub fn recognizer(&self, options: Options) -> Result<Recognizer, RecognitionError> {
        Recognizer::from_descriptors(&self.references, self.distance, options)
    }

    /// True if a descriptor differs from that of the last new view.
    fn is_new_view(&mut self, query: &[f32]) -> bool {
        if self.views.is_none() {
            self.views = ViewComparison::new(self.options.view_threshold).ok();
        }
        let view = self.views.as_mut().map(|views| views.next(query));
        self.references.is_empty() || !matches!(view, Some(Ok(ViewChange::Unchanged)))
    }

    /// Checks a query, which may become a reference, and an odometry reading.
    fn check(&self, query: &[f32], odometry: Option<f64>) -> Result<(), RecognitionError> {
        let step = self.steps + 1;
        let failed = |source| RecognitionError::Descriptor { step, source };
        let of_query = |source| {
            failed(match source {
                DescriptorError::Element { element, value, .. } => {
                    DescriptorError::Element { which: Descriptor::Query(0), element, value }
                }
                DescriptorError::Zero { .. } => {
                    DescriptorError::Zero { which: Descriptor::Query(0) }
                }
                other => other,
            })
        };
        if let Some(first) = self.references.first()
            && first.len() != query.len()
        {
            let (which, length) = (Descriptor::Query(0), query.len());
            let expected = first.len();
            return Err(failed(DescriptorError::Length { which, length, expected }));
        }
        ReferenceDescriptors::from_rows(&[query], self.distance).map_err(of_query)?;
        let squares: f64 = query.iter().map(|x| f64::from(*x).powi(2)).sum();
        // The distance of any two such descriptors then fits 32 bits.
        if self.distance == Distance::Euclidean && squares.sqrt() > LONGEST {
            let (what, value) = ("the length of a descriptor", squares.sqrt());
            return Err(RecognitionError::Parameter { what, value, expected: "at most 1.7e38" });
        }
        let control = RouteControl { odometry, ..RouteControl::default() };
        let refused = |source| InferenceError::Control { step, source };
        Ok(self.motion.check_control(&control).map_err(refused)?)
    }

    /// Adds references to the model once enough of them are old enough.
    fn grow(&mut self) -> Result<(), RecognitionError> {
        let known = self.track.as_ref().map_or(0, |track| track.recognizer().references());
        let old = |added: &usize| added.saturating_add(self.gap) <= self.steps;
        let count = self.added.iter().take_while(|added| old(added)).count();
        if count < (known + BATCH).max(FIRST) {
            return Ok(());
        }
        let references = &self.references[..count];
        let made = Recognizer::from_descriptors(references, self.distance, self.options.clone());
        let recognizer = match made {
            Ok(recognizer) => recognizer,
            // A vehicle that stands may give equal descriptors for a while.
            Err(RecognitionError::References {
                source: DescriptorError::AllEqual { .. }, ..
            }) => return Ok(()),
            Err(error) => return Err(error),
        };
        self.track = Some(match &self.track {
            Some(track) => track.extended(recognizer)?,
            None => recognizer.track().after(self.steps)?,
        });
        Ok(())
    }
}
