//! Directions in any number of dimensions: their densities b_i(y) (section 1 of the guide's
//! formulas).
//!
//! All is computed from 1 − μ·y = ½ ‖y − μ‖², and from 1 less a mean length, rather than from
//! cosines: for large concentrations these are 1 up to rounding.

use std::error::Error;
use std::f64::consts::TAU;

use rand::Rng;
use rand_distr::{Distribution, StandardNormal};
use wayfix::inference::{Displacement, FreeParameters};
use wayfix::likelihood::{LearnLikelihood, SampleObservation};
use wayfix::{Diagonal, Likelihood, LikelihoodError, ReorderStates, Scratch};

use crate::concentration::{concentration, draw};
use crate::error::{
    LOG_DENSITY_FLOOR, check, check_components, check_length, check_spread, check_values, shape,
    with_place,
};
use crate::special::Bessel;
use crate::{EmissionError, Family, StartFromClusters};

/// Largest deviation from length one of a vector that counts as a direction.
const TOLERANCE: f64 = 1e-6;

/// Directions in d ≥ 2 dimensions, as vectors of length one: a von Mises–Fisher distribution in
/// each state.
///
/// p(y) = κ^ν exp(κ μ·y) / ((2π)^{d/2} I_ν(κ)), where ν = d/2 − 1, with a mean direction μ of
/// length one and a concentration κ ≥ 0: at 0 all directions are equally likely, and for large κ
/// the variance around μ is 1 / κ in each of d − 1 dimensions. The density is with respect to the
/// area of the sphere. Vectors within 1e-6 of length one are accepted, and scaled to it.
///
/// Learning sets μ to the direction of the mean vector, and κ to the solution of
/// I_{ν+1}(κ) / I_ν(κ) = its length, by Newton's method to the last digits, from the starting value
/// of Banerjee et al. (2005); closed-form approximations (Sra, 2012) are not used. Observations
/// that are all alike determine no concentration, an [error](EmissionError::TooFew), unless there
/// is a [prior](Self::with_prior).
///
/// A vector may be missing as a whole ([`with_missing`](Self::with_missing)), but not in part.
///
/// A step costs O(n d), learning O(n d) an observation, and O(n (d + √κ)) a re-estimation. Memory:
/// O(n d).
///
/// ```
/// use wayfix_learn::VonMisesFisher;
/// use wayfix::{Belief, DenseTransition, Hmm, Prior};
///
/// let hmm = Hmm::new(
///     Prior::AtFirstObservation(Belief::uniform(2)?),
///     DenseTransition::from_rows(&[[0.9, 0.1], [0.1, 0.9]])?,
///     VonMisesFisher::new(&[[1.0, 0.0, 0.0], [0.0, 0.6, 0.8]], &[20.0, 5.0])?,
/// )?;
/// let seen = [[0.8, 0.6, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
/// assert_eq!(hmm.viterbi(&seen)?.states(), [0, 0, 1]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct VonMisesFisher {
    components: usize,
    missing: bool,
    /// Mean direction of state i from index i d onwards.
    means: Vec<f64>,
    concentrations: Vec<f64>,
    /// Log density at each mean direction.
    peaks: Vec<f64>,
    /// Distribution of the prior's observations in each state, and their number.
    prior: Option<(Box<Self>, f64)>,
}

/// Returns the length of a vector.
fn length(vector: &[f64]) -> f64 {
    vector.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// 1 − cosine of the angle between two directions, as half their squared distance, so that nothing
/// cancels.
fn cosine_distance(mean: &[f64], direction: impl Iterator<Item = f64>) -> f64 {
    0.5 * mean.iter().zip(direction).map(|(m, y)| (y - m).powi(2)).sum::<f64>()
}

impl VonMisesFisher {
    /// Creates a family from one row for each state with its mean direction, and the
    /// concentrations of the states. O(n (d + √κ)).
    ///
    /// # Errors
    ///
    /// [`EmissionError`] for zero states, rows of different lengths or of fewer than two
    /// components, a direction whose length is not one within 1e-6, or a concentration outside 0 to
    /// 1e300.
    pub fn new<R: AsRef<[f64]>>(
        means: &[R],
        concentrations: &[f64],
    ) -> Result<Self, EmissionError> {
        let (states, components) = shape("mean direction", means)?;
        let value = components as f64;
        check("number of components", value, components > 1, "at least 2")?;
        check_length("list of concentrations", None, concentrations.len(), states)?;
        let mut directions = Vec::with_capacity(states * components);
        let mut peaks = Vec::with_capacity(states);
        for (state, (mean, &k)) in means.iter().zip(concentrations).enumerate() {
            let mean = mean.as_ref();
            let long = length(mean);
            let valid = (long - 1.0).abs() <= TOLERANCE;
            check("length of the mean direction", long, valid, "1 within 1e-6")
                .and_then(|_| {
                    let valid = (0.0..=1e300).contains(&k);
                    check("concentration", k, valid, "a value from 0 to 1e300")
                })
                .map_err(|error| with_place(error, state, None))?;
            // A length that differs from 1 by rounding alone is left: parameters survive a round
            // trip to the bit.
            let scale = if (long - 1.0).abs() < 1e-12 { 1.0 } else { long.recip() };
            directions.extend(mean.iter().map(|m| m * scale));
            // At y = μ, ln p = κ − (d/2) ln 2π − ln(I_ν(κ) κ^−ν): `Bessel::log` takes out e^κ, so
            // the log density at a distance t = 1 − μ·y is peak − κ t.
            let half = 0.5 * components as f64;
            peaks.push(-half * TAU.ln() - Bessel::new(half - 1.0, k).log);
        }
        let (means, concentrations) = (directions, concentrations.to_vec());
        Ok(Self { components, missing: false, means, concentrations, peaks, prior: None })
    }

    /// Returns the family with rows of all NaN taken as missing observations.
    #[must_use]
    pub fn with_missing(self) -> Self {
        Self { missing: true, ..self }
    }

    /// Adds a conjugate prior: learning proceeds as if each state had shown `count` more
    /// observations, distributed as `prior`, a family with a single state for all or as many states
    /// as this one.
    ///
    /// With the prior's direction m and concentration k, the density of μ and κ is proportional to
    /// exp(c κ μ·m I_{ν+1}(k) / I_ν(k)) (κ^ν / I_ν(κ))^c, where c is the count, which need not be a
    /// whole number.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] if the prior has another number of states or components, or `count` is
    /// not a finite value above 0.
    pub fn with_prior(self, prior: Self, count: f64) -> Result<Self, EmissionError> {
        let n = self.states();
        check_length("mean direction of the prior", None, prior.components, self.components)?;
        if prior.states() != 1 {
            check_length("list of states of the prior", None, prior.states(), n)?;
        }
        let (what, valid) =
            ("number of observations of the prior", count > 0.0 && count.is_finite());
        check(what, count, valid, "a finite value above 0")?;
        let order: Vec<usize> = if prior.states() == n { (0..n).collect() } else { vec![0; n] };
        let prior = Self { missing: false, prior: None, ..prior }.reordered(&order);
        Ok(Self { prior: Some((Box::new(prior), count)), ..self })
    }

    /// True if a row of all NaN is a missing observation.
    #[must_use]
    pub fn takes_missing(&self) -> bool {
        self.missing
    }

    /// Mean directions, one row for each state.
    #[must_use]
    pub fn means(&self) -> Vec<Vec<f64>> {
        self.means.chunks_exact(self.components).map(<[f64]>::to_vec).collect()
    }

    /// Concentrations, one for each state.
    #[must_use]
    pub fn concentrations(&self) -> &[f64] {
        &self.concentrations
    }

    /// The prior, with one distribution for each state, and its number of observations.
    #[must_use]
    pub fn prior(&self) -> Option<(&Self, f64)> {
        self.prior.as_ref().map(|(prior, count)| (&**prior, *count))
    }

    /// Mean direction of a state.
    fn mean(&self, state: usize) -> &[f64] {
        &self.means[state * self.components..][..self.components]
    }

    /// Returns the factor that brings a valid vector to length one, or `None` if it is missing.
    fn scale(&self, observation: &[f64]) -> Result<Option<f64>, EmissionError> {
        check_components(observation, self.components)?;
        if self.missing && observation.iter().all(|y| y.is_nan()) {
            return Ok(None);
        }
        check_values(observation, f64::is_finite, "a finite value")?;
        let value = length(observation);
        let valid = (value - 1.0).abs() <= TOLERANCE;
        if valid { Ok(Some(value.recip())) } else { Err(EmissionError::Norm { value }) }
    }
}

impl Likelihood for VonMisesFisher {
    type Observation = [f64];

    fn states(&self) -> usize {
        self.concentrations.len()
    }

    fn diagonal<'a>(
        &'a self,
        observation: &'a [f64],
        scratch: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        let logs = scratch.values(self.states());
        logs.fill(0.0);
        if let Some(scale) = self.scale(observation)? {
            let states = self.peaks.iter().zip(&self.concentrations);
            let states = states.zip(self.means.chunks_exact(self.components));
            for (log, ((peak, k), mean)) in logs.iter_mut().zip(states) {
                let distance = cosine_distance(mean, observation.iter().map(|y| y * scale));
                *log = (peak - k * distance).max(LOG_DENSITY_FLOOR);
            }
        }
        Ok(Diagonal::log(logs))
    }
}

impl Family for VonMisesFisher {
    fn components(&self) -> usize {
        self.components
    }
}

impl SampleObservation for VonMisesFisher {
    type Sample = Vec<f64>;

    fn sample<R: Rng + ?Sized>(&self, state: usize, rng: &mut R) -> Vec<f64> {
        let mean = self.mean(state);
        let distance = draw(self.components, self.concentrations[state], rng);
        // An isotropic normal vector, made orthogonal to the mean, has a uniform direction there.
        // The cosine is 1 − t, so the sine is √(t (2 − t)).
        let mut across: Vec<f64> = mean.iter().map(|_| StandardNormal.sample(rng)).collect();
        let along: f64 = across.iter().zip(mean).map(|(a, m)| a * m).sum();
        across.iter_mut().zip(mean).for_each(|(a, m)| *a -= along * m);
        let part = (distance * (2.0 - distance)).max(0.0).sqrt() / length(&across);
        let parts = across.iter().zip(mean);
        let direction: Vec<f64> = parts.map(|(a, m)| (1.0 - distance) * m + part * a).collect();
        let long = length(&direction);
        direction.iter().map(|y| y / long).collect()
    }
}

impl ReorderStates for VonMisesFisher {
    fn reordered(&self, order: &[usize]) -> Self {
        let prior = self.prior.as_ref();
        Self {
            components: self.components,
            missing: self.missing,
            means: order.iter().flat_map(|&i| self.mean(i)).copied().collect(),
            concentrations: order.iter().map(|&i| self.concentrations[i]).collect(),
            peaks: order.iter().map(|&i| self.peaks[i]).collect(),
            prior: prior.map(|(prior, count)| (Box::new(prior.reordered(order)), *count)),
        }
    }
}

// Learning of directions: the M step of section 9 of the formulas, with a conjugate prior.
//
// ln p is linear in y and in 1, so the mean vector R and the weight are sufficient: μ = R / ‖R‖,
// and κ solves I_{ν+1}(κ) / I_ν(κ) = ‖R‖. The sums are of y − μ_old, so that 1 − ‖R‖ has all its
// digits.

impl VonMisesFisher {
    /// Expected distance 1 − μ·y from the mean of a state, and length of the mean vector, for
    /// observations distributed as the prior.
    fn expected_distance(&self, prior: &Self, state: usize) -> (f64, f64) {
        let order = 0.5 * self.components as f64 - 1.0;
        let Bessel { ratio, complement, .. } = Bessel::new(order, prior.concentrations[state]);
        // The prior's mean vector is r m, and 1 − r μ·m = (1 − r) + r (1 − μ·m).
        let distance = cosine_distance(self.mean(state), prior.mean(state).iter().copied());
        (complement + ratio * distance, ratio)
    }

    /// Returns the mean direction and the concentration that maximise the likelihood of the
    /// observations behind the sums.
    fn maximize(&self, state: usize, sums: &[f64]) -> Result<(Vec<f64>, f64), EmissionError> {
        let old = self.mean(state);
        let (weight, distance) = (sums[0], sums[1] / sums[0]);
        let shift = || sums[2..].iter().map(|sum| sum / weight);
        let mut mean: Vec<f64> = old.iter().zip(shift()).map(|(old, shift)| old + shift).collect();
        let length = length(&mean);
        // With R = μ_old + s, 1 − ‖R‖² = −2 μ_old·s − ‖s‖², and −μ_old·s is the mean distance.
        let variance = 2.0 * distance - shift().map(|shift| shift * shift).sum::<f64>();
        let variance = check_spread("concentration", weight, variance, distance)?;
        if length == 0.0 {
            return Ok((old.to_vec(), 0.0));
        }
        // 1 − ‖R‖ = (1 − ‖R‖²) / (1 + ‖R‖).
        mean.iter_mut().for_each(|m| *m /= length);
        Ok((mean, concentration(self.components, length, variance / (1.0 + length))))
    }
}

impl LearnLikelihood for VonMisesFisher {
    /// For each state the weighted sums of 1, of the distance 1 − μ·y from the mean direction, and
    /// of y − μ in each component.
    type Statistics = Vec<f64>;

    fn statistics(&self) -> Vec<f64> {
        vec![0.0; self.states() * (self.components + 2)]
    }

    /// Adds one observation; nothing if it is invalid.
    fn add(&self, statistics: &mut Vec<f64>, observation: &[f64], posterior: &[f64]) {
        let Ok(Some(scale)) = self.scale(observation) else { return };
        let states = statistics.chunks_exact_mut(self.components + 2).zip(posterior);
        for ((sums, &weight), mean) in states.zip(self.means.chunks_exact(self.components)) {
            sums[0] += weight;
            sums[1] += weight * cosine_distance(mean, observation.iter().map(|y| y * scale));
            let parts = sums[2..].iter_mut().zip(observation).zip(mean);
            parts.for_each(|((sum, y), m)| *sum += weight * (y * scale - m));
        }
    }

    fn merge(&self, statistics: &mut Vec<f64>, other: &Vec<f64>) {
        statistics.iter_mut().zip(other).for_each(|(sum, other)| *sum += other);
    }

    fn maximize(
        &self,
        statistics: &Vec<f64>,
        _: f64,
    ) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let (mut means, mut concentrations) = (self.means(), self.concentrations.clone());
        for (state, sums) in statistics.chunks_exact(self.components + 2).enumerate() {
            let mut sums = sums.to_vec();
            // The prior adds the expected sums of its `count` observations.
            if let Some((prior, count)) = &self.prior {
                let (distance, ratio) = self.expected_distance(prior, state);
                sums[0] += count;
                sums[1] += count * distance;
                let parts = sums[2..].iter_mut().zip(prior.mean(state)).zip(self.mean(state));
                parts.for_each(|((sum, p), m)| *sum += count * (ratio * p - m));
            }
            if sums[0] >= f64::MIN_POSITIVE {
                let learned =
                    self.maximize(state, &sums).map_err(|e| with_place(e, state, None))?;
                (means[state], concentrations[state]) = learned;
            }
        }
        let (missing, prior) = (self.missing, self.prior.clone());
        Ok(Self { missing, prior, ..Self::new(&means, &concentrations)? })
    }

    fn log_prior(&self, _: f64) -> f64 {
        let Some((prior, count)) = &self.prior else { return 0.0 };
        let state = |state: usize| {
            let distance = self.expected_distance(prior, state).0;
            self.peaks[state] - self.concentrations[state] * distance
        };
        count * (0..self.states()).map(state).sum::<f64>()
    }

    fn free_parameters(&self) -> usize {
        self.means.len()
    }
}

impl StartFromClusters for VonMisesFisher {}

/// The direction of each state with its concentration.
impl FreeParameters for VonMisesFisher {
    fn displaced(&self, by: &mut Displacement<'_>) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let (mut means, mut concentrations) = (self.means(), self.concentrations.clone());
        for (mean, concentration) in means.iter_mut().zip(&mut concentrations) {
            by.direction(mean);
            *concentration = by.positive(*concentration);
        }
        let (missing, prior) = (self.missing, self.prior.clone());
        Ok(Self { missing, prior, ..Self::new(&means, &concentrations)? })
    }
}

#[cfg(feature = "serde")]
wayfix::stored! {
    [] VonMisesFisher: [], |family| {
        means: Vec<Vec<f64>> = family.means(),
        concentrations: Vec<f64> = family.concentrations(),
        missing: bool = family.takes_missing(),
        prior: Option<(self::VonMisesFisher, f64)> = family.prior(),
    } => Self::new(&means, &concentrations)
        .map(|new| crate::family::when(missing, new, Self::with_missing))
        .and_then(|new| prior.into_iter().try_fold(new, |new, (prior, count)| new.with_prior(prior, count)));
}
