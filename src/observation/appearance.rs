//! From distances between images to likelihoods of places.

use std::ops::RangeInclusive;
use std::sync::Arc;

use super::ObservationError;
use super::spread::{Spread, rank};
use crate::error::LikelihoodError;
use crate::kernels;
use crate::likelihood::{Diagonal, Likelihood, Scratch};

/// Valid temperatures. Bounds for 1/τ are the same.
pub(super) const TEMPERATURES: RangeInclusive<f64> = 1e-6..=1e6;

/// Largest range of log-likelihoods taken in linear space: e^600 is 1e260.
const LINEAR_RANGE: f64 = 600.0;

/// The references whose average scores are subtracted, in
/// [`AppearanceLikelihood::with_offsets`].
///
/// ```
/// assert_eq!(wayfix::observation::Offsets::default(), wayfix::observation::Offsets::Hubs);
/// ```
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub enum Offsets {
    /// Only references that look more like the queries than the average one: hubs lose their
    /// advantage. The cautious choice if the queries show a part of the route, since references
    /// elsewhere merely look unlike that part.
    #[default]
    Hubs,
    /// All references: those that look less like the queries gain, too.
    All,
}

/// A camera as a sensor: the likelihood of places given the distances of a query image.
///
/// The observation is the row of **distances** from the query to each reference image, smaller
/// for more alike, by any comparison of images: descriptors of any kind
/// ([`ReferenceDescriptors`](super::ReferenceDescriptors) computes the row), local features, a
/// network. For similarities, take their negatives.
///
/// The likelihood of reference i is an exponential kernel, exp(−z_i / τ), divided by its mean
/// over the references: z_i is the distance relative to the query's others (see [`Spread`]), τ
/// the **temperature**. As odds against a reference drawn at random, log-likelihoods of a
/// sequence can be compared between temperatures.
///
/// A temperature that suits single images is too cold in sequence: one frame
/// after the other errs in the same way, yet filter and smoother multiply them as
/// if each were fresh evidence. 1 is a fair start. Fit it by
/// [`calibrate`](super::calibrate) on a labelled part and hold it fixed on the
/// rest; [`with_learned_temperature`](Self::with_learned_temperature) (from
/// labelled images in no order) and [`Hmm::learn`](crate::Hmm::learn) (without
/// labels) give one for single images.
///
/// ```
/// use wayfix::observation::AppearanceLikelihood;
/// use wayfix::transition::WindowTransition;
/// use wayfix::{Belief, Hmm, Prior};
///
/// // Five reference images along a loop; the vehicle moves on by one at each step, or stays.
/// let camera = AppearanceLikelihood::new(5)?.with_temperature(0.5)?;
/// let motion = WindowTransition::new(5, 0, &[0.2, 0.8], true)?;
/// let hmm = Hmm::new(Prior::AtFirstObservation(Belief::uniform(5)?), motion, camera)?;
///
/// let mut filter = hmm.filter();
/// filter.step(&vec![0.9, 0.2, 0.8, 0.3, 0.7])?; // place 1 or 3?
/// filter.step(&vec![0.8, 0.9, 0.2, 0.9, 0.9])?; // place 2, so it was 1
/// assert_eq!(filter.belief().mode(), 2);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Not on the map
///
/// [`with_off_map`](Self::with_off_map) adds a last state for "not seen before", whose
/// likelihood is that of a match of low rank, as in Xu, Fischer, Sünderhauf and Milford 2021.
/// Most references are wrong matches; if even the best are no better than wrong ones usually
/// are, the place is not among them.
/// [`OffMapTransition`](crate::motion::OffMapTransition) is the motion that goes with it.
///
/// # Cost and exactness
///
/// O(n) a step, and an exponential for each reference; no allocation after
/// warm-up. Over many steps its tails are beyond doubles, and not to be believed: a model is
/// faster [`with_rounded_tails`](crate::Hmm::with_rounded_tails).
///
/// An infinite distance is a likelihood of 0. Rows with NaN, −∞ or of a wrong
/// length, and rows in which all are infinite (unless there is a state off the
/// map, which then has a likelihood of 1), are errors. If all distances are
/// equal, the likelihood depends on the offsets alone.
#[derive(Debug, Clone, PartialEq)]
pub struct AppearanceLikelihood {
    references: usize,
    spread: Spread,
    /// Offsets subtracted from the scores, one for each reference; empty if all are 0.
    offsets: Vec<f64>,
    temperature: f64,
    off_map: Option<f64>,
}

impl AppearanceLikelihood {
    /// Creates a sensor for this many references, with the spread of each
    /// [query](Spread::Query) and a temperature of 1.
    ///
    /// # Errors
    ///
    /// [`ObservationError::Parameter`] if there are none, or more than 2^32 − 2: states have
    /// 32-bit indices, and one may be off the map.
    pub fn new(references: usize) -> Result<Self, ObservationError> {
        if references == 0 {
            let (what, expected) = ("the number of references", "at least 1");
            return Err(ObservationError::Parameter { what, value: 0.0, expected });
        }
        if references >= u32::MAX as usize {
            let (what, expected) = ("the number of references", "at most 4294967294");
            let value = references as f64;
            return Err(ObservationError::Parameter { what, value, expected });
        }
        let offsets = Vec::new();
        Ok(Self { references, spread: Spread::Query, offsets, temperature: 1.0, off_map: None })
    }

    /// Sets the scale of distances. Drops [offsets](Self::with_offsets), which are in the old
    /// scale.
    ///
    /// # Errors
    ///
    /// [`ObservationError::Parameter`] if it is not valid.
    pub fn with_spread(self, spread: Spread) -> Result<Self, ObservationError> {
        spread.check()?;
        Ok(Self { spread, offsets: Vec::new(), ..self })
    }

    /// Sets the temperature, in units of the spread: a match better by τ is e times as likely.
    ///
    /// # Errors
    ///
    /// [`ObservationError::Parameter`] unless it is finite and from 1e-6 to 1e6.
    pub fn with_temperature(self, temperature: f64) -> Result<Self, ObservationError> {
        if !TEMPERATURES.contains(&temperature) {
            let (what, expected) = ("the temperature", "from 1e-6 to 1e6");
            return Err(ObservationError::Parameter { what, value: temperature, expected });
        }
        Ok(Self { temperature, ..self })
    }

    /// Adds a last state for off the map, as likely as the match at this rank among those at a
    /// finite distance. The rank is a fraction (to the nearest reference): 0 is the best, 1 the
    /// worst; 0.15 suits most recordings.
    ///
    /// # Errors
    ///
    /// [`ObservationError::Parameter`] unless the rank is from 0 to 1.
    pub fn with_off_map(self, rank: f64) -> Result<Self, ObservationError> {
        if !(0.0..=1.0).contains(&rank) {
            let (what, expected) = ("the rank of the match off the map", "from 0 to 1");
            return Err(ObservationError::Parameter { what, value: rank, expected });
        }
        Ok(Self { off_map: Some(rank), ..self })
    }

    /// Subtracts from each reference's score its average over some queries, so that references
    /// that look like everything (hubs: a plain wall, a dark tunnel) lose that advantage.
    ///
    /// The places of the queries need not be known. Each average includes `prior_count` queries
    /// with a score of 0, so that few rows change little. Previous offsets are replaced.
    ///
    /// The queries should come from all over the route, or from elsewhere: a
    /// vehicle that stood at one place for half of them makes that place look
    /// like a hub. O(n) a row.
    ///
    /// # Errors
    ///
    /// [`ObservationError`] if a row is not valid, or `prior_count` not finite
    /// and at least 0.
    pub fn with_offsets<R: AsRef<[f32]>>(
        self,
        offsets: Offsets,
        rows: &[R],
        prior_count: f64,
    ) -> Result<Self, ObservationError> {
        if !(prior_count >= 0.0 && prior_count.is_finite()) {
            let (what, expected) = ("the prior count", "a finite value of at least 0");
            return Err(ObservationError::Parameter { what, value: prior_count, expected });
        }
        let plain = Self { offsets: Vec::new(), ..self };
        let mut sums = vec![(0.0, prior_count); plain.references];
        let (mut scores, mut scratch) = (vec![0.0; plain.references], Scratch::default());
        for row in rows {
            plain.scores(row.as_ref(), &mut scores, &mut scratch)?;
            let finite = sums.iter_mut().zip(&scores).filter(|(_, z)| z.is_finite());
            finite.for_each(|(sum, z)| *sum = (sum.0 + z, sum.1 + 1.0));
        }
        let offset = |(sum, count): (f64, f64)| match offsets {
            _ if count == 0.0 => 0.0,
            Offsets::Hubs => (sum / count).min(0.0),
            Offsets::All => sum / count,
        };
        Ok(Self { offsets: sums.into_iter().map(offset).collect(), ..plain })
    }

    /// The number of references.
    #[must_use]
    pub fn references(&self) -> usize {
        self.references
    }

    /// The scale of distances.
    #[must_use]
    pub fn spread(&self) -> Spread {
        self.spread
    }

    /// The temperature τ.
    #[must_use]
    pub fn temperature(&self) -> f64 {
        self.temperature
    }

    /// The offset subtracted from the score of each reference; empty if there are none.
    #[must_use]
    pub fn offsets(&self) -> &[f64] {
        &self.offsets
    }

    /// The rank of the match whose likelihood the state off the map has, if there is such a state.
    #[must_use]
    pub fn off_map_rank(&self) -> Option<f64> {
        self.off_map
    }

    /// The state off the map, if there is one.
    #[must_use]
    pub fn off_map_state(&self) -> Option<usize> {
        self.off_map.map(|_| self.references)
    }

    /// A sensor read from storage, checked.
    #[cfg(feature = "serde")]
    pub(crate) fn from_parts(
        references: usize,
        spread: Spread,
        offsets: Vec<f64>,
        temperature: f64,
        off_map: Option<f64>,
    ) -> Result<Self, ObservationError> {
        let camera = Self::new(references)?.with_spread(spread)?.with_temperature(temperature)?;
        let camera = match off_map {
            Some(rank) => camera.with_off_map(rank)?,
            None => camera,
        };
        if !(offsets.is_empty() || offsets.len() == references) {
            let (found, expected) = (offsets.len(), references);
            return Err(ObservationError::Distances { found, expected });
        }
        if let Some(&value) = offsets.iter().find(|offset| !offset.is_finite()) {
            let (what, expected) = ("an offset", "a finite value");
            return Err(ObservationError::Parameter { what, value, expected });
        }
        Ok(Self { offsets, ..camera })
    }

    /// Computes the scores z of a row: distances relative to the others, less the offsets.
    pub(super) fn scores(
        &self,
        distances: &[f32],
        out: &mut [f64],
        memory: &mut Scratch,
    ) -> Result<(), ObservationError> {
        let (found, expected) = (distances.len(), self.references);
        if found != expected {
            return Err(ObservationError::Distances { found, expected });
        }
        let valid = |d: f32| d > f32::NEG_INFINITY; // not NaN
        if let Some(reference) = distances.iter().position(|&d| !valid(d)) {
            return Err(ObservationError::Distance { reference, value: distances[reference] });
        }
        self.spread.apply(distances, out, memory);
        out.iter_mut().zip(&self.offsets).for_each(|(z, offset)| *z -= offset);
        Ok(())
    }

    /// Score of the state off the map: that of the match at its rank among the finite ones. `copy`
    /// holds the scores, and is reordered.
    pub(super) fn off_map_score(&self, copy: &mut [f64]) -> Option<f64> {
        let finite = copy.iter().filter(|z| z.is_finite()).count();
        if finite == 0 {
            return self.off_map.map(|_| 0.0);
        }
        let at = rank(self.off_map?, finite);
        Some(*copy.select_nth_unstable_by(at, f64::total_cmp).1)
    }
}

impl Likelihood for AppearanceLikelihood {
    type Observation = Vec<f32>;

    fn states(&self) -> usize {
        self.references + usize::from(self.off_map.is_some())
    }

    fn diagonal<'a>(
        &'a self,
        distances: &'a Vec<f32>,
        scratch: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        let n = self.references;
        let (values, parts) = scratch.with_parts(self.states(), 1);
        self.scores(distances, &mut values[..n], &mut parts[0]).map_err(sensor)?;
        let least = values[..n].iter().copied().fold(f64::INFINITY, f64::min);
        let off_map = self.off_map.and_then(|_| {
            let copy = parts[0].values(n);
            copy.copy_from_slice(&values[..n]);
            self.off_map_score(copy)
        });
        let seen = least.is_finite();
        if !seen && off_map.is_none() {
            return Err(sensor(ObservationError::NoMatch));
        }
        let (least, beta) = (if seen { least } else { 0.0 }, -1.0 / self.temperature);
        if let Some(score) = off_map {
            values[n] = score;
        }
        values.iter_mut().for_each(|z| *z = beta * (*z - least));
        // Divided by the mean over the references, unless that is 0.
        let lowest = values.iter().copied().filter(|log| log.is_finite()).fold(0.0, f64::min);
        let linear = lowest > -LINEAR_RANGE;
        let sum: f64 = if linear {
            values.iter_mut().for_each(|log| *log = log.exp());
            kernels::sum(&values[..n])
        } else {
            values[..n].iter().map(|log| log.exp()).sum()
        };
        let log_factor = if seen { -(sum / n as f64).ln() } else { 0.0 };
        let diagonal =
            if linear { Diagonal::checked(values, 1.0, None) } else { Diagonal::log(values) };
        Ok(Diagonal { log_factor, ..diagonal })
    }
}

fn sensor(error: ObservationError) -> LikelihoodError {
    LikelihoodError::Sensor(Arc::new(error))
}
