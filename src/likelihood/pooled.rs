//! [`PooledLikelihood`], for places with several reference images: the likelihood of a place is the
//! mean of those of its images. Means are taken of numbers, or by log-sum-exp where numbers
//! underflow or the sensor gives logarithms.

use rand::Rng;

use super::Values;
use super::{Diagonal, Likelihood, SampleObservation, Scratch};
use crate::error::{HmmError, LikelihoodError};
use crate::groups::Groups;
use crate::random::index;

/// A sensor of reference images as a sensor of places: the likelihood of a place is the mean of
/// those of its images. The reverse of
/// [`GroupedLikelihood`](crate::likelihood::GroupedLikelihood).
///
/// The observation is modelled as one of the images of its place, all equally probable, so a place
/// with many images is not favoured. The mean is taken over likelihoods, not logarithms: one image
/// that matches well makes up for many that do not.
///
/// Costs O(images) a step on top of the inner sensor, with one exponential per image if the sensor
/// returns logarithms.
///
/// ```
/// use wayfix::likelihood::PooledLikelihood;
/// use wayfix::likelihood::Groups;
/// use wayfix::{Belief, DenseTransition, Hmm, LikelihoodVector, Prior};
///
/// // Two images of place 0, by day and by night, and one of place 1.
/// let images = Groups::new(vec![0, 0, 1])?;
/// let camera = PooledLikelihood::new(LikelihoodVector::linear(3), images)?;
/// let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
/// let hmm = Hmm::new(prior, DenseTransition::from_fn(2, |_, _| 0.5)?, camera)?;
/// let mut filter = hmm.filter();
/// filter.step(&[0.0, 0.75, 0.125])?;
/// assert_eq!(filter.belief().as_slice(), [0.75, 0.25]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct PooledLikelihood<B> {
    pub(crate) sensor: B,
    groups: Groups,
}

impl<B: Likelihood> PooledLikelihood<B> {
    /// Creates a sensor from one whose states are the images, and the place of each image.
    ///
    /// # Errors
    ///
    /// [`HmmError::StateCount`] unless the groups have one entry per state of the sensor.
    pub fn new(sensor: B, groups: Groups) -> Result<Self, HmmError> {
        let (found, expected) = (groups.as_slice().len(), sensor.states());
        if found != expected {
            let (part, first) = ("grouping", "sensor");
            return Err(HmmError::StateCount { part, found, first, expected });
        }
        // Sorts the images now, so that no step allocates.
        let _ = groups.states(0);
        Ok(Self { sensor, groups })
    }

    /// Returns the sensor of the images.
    #[must_use]
    pub fn sensor(&self) -> &B {
        &self.sensor
    }

    /// Returns the groups, the place of each image.
    pub fn groups(&self) -> &Groups {
        &self.groups
    }

    /// Pairs each image with its place.
    fn images<T>(&self, images: impl Iterator<Item = T>) -> impl Iterator<Item = (usize, T)> {
        self.groups.as_slice().iter().copied().zip(images)
    }

    /// Number of images of a place.
    fn count(&self, place: usize) -> f64 {
        self.groups.states(place).len() as f64
    }

    /// Computes the means. Returns false if one leaves the range of normal numbers, unless it is 0
    /// because all its images are.
    fn means(&self, images: &[f64], out: &mut [f64]) -> bool {
        out.fill(0.0);
        self.images(images.iter()).for_each(|(place, b)| out[place] += b);
        let exact = f64::MIN_POSITIVE..=f64::MAX;
        out.iter_mut().enumerate().all(|(place, out)| {
            *out /= self.count(place);
            exact.contains(out)
                || *out == 0.0 && self.groups.states(place).all(|i| images[i] == 0.0)
        })
    }

    /// Computes the logarithms of the means, less `shift`.
    fn log_means(
        &self,
        logs: impl Iterator<Item = f64> + Clone,
        shift: f64,
        sums: &mut [f64],
        out: &mut [f64],
    ) {
        // Log-sum-exp for each place around its own largest image, kept in `out`: each sum has a
        // term of 1, so no place is lost, however far below the others.
        out.fill(f64::NEG_INFINITY);
        self.images(logs.clone()).for_each(|(place, log)| out[place] = out[place].max(log));
        sums.fill(0.0);
        for (place, log) in self.images(logs) {
            // −∞ less −∞ would be NaN, for a place without a possible image.
            if log > f64::NEG_INFINITY {
                sums[place] += (log - out[place]).exp();
            }
        }
        for (place, (out, sum)) in out.iter_mut().zip(sums).enumerate() {
            *out = (*out - shift) + (*sum / self.count(place)).ln();
        }
    }
}

impl<B: Likelihood> Likelihood for PooledLikelihood<B> {
    type Observation = B::Observation;

    fn states(&self) -> usize {
        self.groups.count()
    }

    fn diagonal<'a>(
        &'a self,
        observation: &'a B::Observation,
        scratch: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        let places = self.states();
        let (pooled, parts) = scratch.with_parts(places, 2);
        let (inner, sums) = parts.split_at_mut(1);
        let diagonal = self.sensor.diagonal(observation, &mut inner[0])?;
        let largest = diagonal.check(self.groups.as_slice().len())?;
        let top = match diagonal.values {
            Values::Linear(images) | Values::Checked { linear: images, .. } => {
                if self.means(images, pooled) {
                    return Ok(Diagonal { values: Values::Linear(pooled), ..diagonal });
                }
                largest.ln()
            }
            Values::Log(_) => largest,
        };
        // The maximum is subtracted before anything is added, so that small differences of large
        // logarithms keep their digits.
        let shift = if top.is_finite() { top } else { 0.0 };
        self.log_means(diagonal.logs(), shift, sums[0].values(places), pooled);
        let log_factor = diagonal.log_factor + shift;
        Ok(Diagonal { values: Values::Log(pooled), log_factor })
    }
}

impl<B: SampleObservation> SampleObservation for PooledLikelihood<B> {
    type Sample = B::Sample;

    /// Draws one of the images of the place, and an observation of it.
    fn sample<R: Rng + ?Sized>(&self, state: usize, rng: &mut R) -> B::Sample {
        let images = self.groups.states(state).map(|image| (image, 1.0));
        let image = index(images, self.count(state), rng);
        self.sensor.sample(image, rng)
    }
}

#[cfg(feature = "serde")]
crate::stored! {
    [B: Likelihood] PooledLikelihood<B>: [B], |pooled| {
        sensor: B = pooled.sensor,
        groups: Groups = pooled.groups(),
    } => Self::new(sensor, groups);
}
