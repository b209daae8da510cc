//! Families of independent components, and the distributions of a single component.
//!
//! Given the state, ln b_i(y) is the sum of the components' log densities, and the M step of
//! section 9 of the formulas is one for each state and component. Statistics are centred on the
//! present parameters (a deviation from the mean, a divergence, an angle to the mean direction), so
//! that a narrow distribution far from 0 loses no digits.
//!
//! This file has the family; `univariate` the trait of a distribution; `zeros` zeros beside any
//! distribution; and the others have one distribution each.

mod bernoulli;
mod beta;
mod binomial;
mod exponential;
mod gamma;
mod log_normal;
mod negative_binomial;
mod poisson;
mod univariate;
mod von_mises;
mod weibull;
mod wrapped_cauchy;
mod zeros;

use std::error::Error;

use rand::Rng;
use wayfix::inference::{Displacement, FreeParameters};
use wayfix::likelihood::{LearnLikelihood, SampleObservation};
use wayfix::{Diagonal, Likelihood, LikelihoodError, ReorderStates, Scratch};

use crate::error::{check, check_components, check_length, check_shape, shape, with_place};
use crate::{Clusters, EmissionError, Family, Marginals, StartFromClusters, Tails};

pub use bernoulli::Bernoulli;
pub use beta::Beta;
pub use binomial::Binomial;
pub use exponential::Exponential;
pub use gamma::Gamma;
pub use log_normal::LogNormal;
pub use negative_binomial::NegativeBinomial;
pub use poisson::Poisson;
pub(super) use poisson::{is_count, log_probability};
pub use univariate::{Cumulative, Sums, Univariate};
pub use von_mises::VonMises;
pub use weibull::Weibull;
pub use wrapped_cauchy::WrappedCauchy;
pub use zeros::{ExtraZeros, Hurdle, ZeroInflated};

// Families of independent components: b_i(y) is the product of their densities (section 1 of the
// formulas).

/// A family of observations whose d components are independent given the state: a distribution of
/// one number for each state and component.
///
/// Each distribution has a constructor of its family, such as
/// [`Poisson::family`](Poisson::family). [`Univariate`] shows how to add one of your own.
///
/// # Missing components
///
/// NaN is an error, unless the family takes it as missing
/// ([`with_missing`](Self::with_missing)): the component is then integrated out.
///
/// # Prior
///
/// Learning maximises the likelihood, unless there is a conjugate prior
/// ([`with_prior`](Self::with_prior)). It is given as c further observations in each state with a
/// known distribution. Its density is proportional to exp(c E ln p(y | θ)), where the expectation
/// is over observations y from that distribution; c need not be a whole number.
///
/// # Cost
///
/// A step costs O(n d), and allocates nothing. Memory: O(n d).
#[derive(Debug, Clone, PartialEq)]
pub struct Independent<F> {
    states: usize,
    components: usize,
    missing: bool,
    /// Distribution of component c in state i at c n + i.
    parts: Vec<F>,
    /// Distributions of the prior in the same order, and its number of observations.
    prior: Option<(Vec<F>, f64)>,
}

impl<F> Independent<F> {
    /// Creates a family from one row for each state, with the distribution of each component.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] for zero states or components, or rows of different lengths.
    pub fn from_rows<R: AsRef<[F]>>(rows: &[R]) -> Result<Self, EmissionError>
    where
        F: Clone,
    {
        let shape = shape("list of components", rows)?;
        Self::build(shape, |state, component| Ok(rows[state].as_ref()[component].clone()))
    }

    /// Creates a family of distributions with one parameter, from a named list of its values.
    fn of_one<R: AsRef<[f64]>>(
        what: &'static str,
        rows: &[R],
        new: impl Fn(f64) -> Result<F, EmissionError>,
    ) -> Result<Self, EmissionError> {
        Self::build(shape(what, rows)?, |state, c| new(rows[state].as_ref()[c]))
    }

    /// Creates a family of distributions with two parameters, from named lists of their values.
    fn of_two<R: AsRef<[f64]>, S: AsRef<[f64]>>(
        [what, other]: [&'static str; 2],
        rows: &[R],
        others: &[S],
        new: impl Fn(f64, f64) -> Result<F, EmissionError>,
    ) -> Result<Self, EmissionError> {
        let shape = shape(what, rows)?;
        check_shape(other, others, shape)?;
        Self::build(shape, |state, c| new(rows[state].as_ref()[c], others[state].as_ref()[c]))
    }

    /// Creates a family from the distribution of each state and component.
    fn build(
        (states, components): (usize, usize),
        part: impl Fn(usize, usize) -> Result<F, EmissionError>,
    ) -> Result<Self, EmissionError> {
        let mut parts = Vec::with_capacity(states * components);
        for component in 0..components {
            for state in 0..states {
                parts.push(
                    part(state, component).map_err(|e| with_place(e, state, Some(component)))?,
                );
            }
        }
        Ok(Self { states, components, missing: false, parts, prior: None })
    }

    /// Returns the family with NaN taken as a missing component, which is integrated out of
    /// likelihoods and left out of learning.
    #[must_use]
    pub fn with_missing(self) -> Self {
        Self { missing: true, ..self }
    }

    /// Adds a conjugate prior: learning proceeds as if each state had shown `count` more
    /// observations, distributed as `prior`, a family with a single state for all or as many states
    /// as this one.
    ///
    /// ```
    /// use wayfix_learn::Poisson;
    ///
    /// // As if each state had shown half an observation more, with a mean of 5.
    /// let events = Poisson::family(&[[3.0], [10.0]])?;
    /// let events = events.with_prior(Poisson::family(&[[5.0]])?, 0.5)?;
    /// # Ok::<(), wayfix_learn::EmissionError>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`EmissionError`] if the prior has another number of states or components, or `count` is
    /// not a finite value above 0.
    pub fn with_prior(self, prior: Self, count: f64) -> Result<Self, EmissionError>
    where
        F: Clone,
    {
        let n = self.states;
        let what = "list of components of the prior";
        check_length(what, None, prior.components, self.components)?;
        if prior.states != 1 {
            check_length("list of states of the prior", None, prior.states, n)?;
        }
        let (what, valid) =
            ("number of observations of the prior", count > 0.0 && count.is_finite());
        check(what, count, valid, "a finite value above 0")?;
        let parts = if prior.states == n {
            prior.parts
        } else {
            prior.parts.iter().flat_map(|part| vec![part.clone(); n]).collect()
        };
        Ok(Self { prior: Some((parts, count)), ..self })
    }

    /// True if NaN is a missing component.
    #[must_use]
    pub fn takes_missing(&self) -> bool {
        self.missing
    }

    /// Distribution of a component in a state, or `None` if either does not exist.
    #[must_use]
    pub fn component(&self, state: usize, component: usize) -> Option<&F> {
        self.parts.chunks_exact(self.states).nth(component)?.get(state)
    }

    /// The prior, with one distribution for each state, and its number of observations.
    #[must_use]
    pub fn prior(&self) -> Option<(Self, f64)>
    where
        F: Clone,
    {
        let &Self { states, components, ref prior, .. } = self;
        let (parts, count) = prior.clone()?;
        Some((Self { states, components, missing: false, parts, prior: None }, count))
    }

    /// Returns one row for each state with a parameter of each component, in the form that
    /// constructors take: `family.parameters(Poisson::rate)`.
    #[must_use]
    pub fn parameters(&self, parameter: impl Fn(&F) -> f64) -> Vec<Vec<f64>> {
        self.rows(parameter)
    }

    /// Returns one row for each state with a value for each component.
    pub(crate) fn rows<T>(&self, parameter: impl Fn(&F) -> T) -> Vec<Vec<T>> {
        let row = |state| self.parts[state..].iter().step_by(self.states).map(&parameter).collect();
        (0..self.states).map(row).collect()
    }
}

impl<F: Univariate> Independent<F> {
    /// Calls a function for each component that is not missing, with its index, its value and its
    /// distributions in all states.
    fn visit(
        &self,
        observation: &[f64],
        mut then: impl FnMut(usize, F::Point, &[F]),
    ) -> Result<(), EmissionError> {
        check_components(observation, self.components)?;
        let parts = self.parts.chunks_exact(self.states);
        for (component, (&value, parts)) in observation.iter().zip(parts).enumerate() {
            if value.is_nan() && self.missing {
                continue;
            }
            let point = if value.is_nan() { None } else { F::point(value) };
            let expected = F::VALUES;
            let error = || EmissionError::Observation { component, value, expected };
            then(component, point.ok_or_else(error)?, parts);
        }
        Ok(())
    }
}

impl<F: Univariate> Likelihood for Independent<F> {
    type Observation = [f64];

    fn states(&self) -> usize {
        self.states
    }

    fn diagonal<'a>(
        &'a self,
        observation: &'a [f64],
        scratch: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        let logs = scratch.values(self.states);
        // ln b_i(y) = Σ_c ln p(y_c | θ_ci). What is the same for all states, such as ln y_c, is
        // computed once for each component, in the point. A missing component adds ln 1.
        logs.fill(0.0);
        self.visit(observation, |_, point, parts| {
            logs.iter_mut().zip(parts).for_each(|(log, part)| *log += part.log_density(&point));
        })?;
        Ok(Diagonal::log(logs))
    }
}

impl<F: Univariate> Family for Independent<F> {
    fn components(&self) -> usize {
        self.components
    }
}

impl<F: Cumulative> Marginals for Independent<F> {
    fn numbers(&self) -> usize {
        self.components
    }

    fn number(&self, row: &[f64], component: usize) -> Result<Option<f64>, LikelihoodError> {
        check_components(row, self.components)?;
        let (value, expected) = (row[component], F::VALUES);
        if value.is_nan() && self.missing {
            return Ok(None);
        }
        if value.is_nan() || F::point(value).is_none() {
            return Err(EmissionError::Observation { component, value, expected }.into());
        }
        Ok(Some(F::principal(value)))
    }

    fn log_density(&self, state: usize, component: usize, y: f64) -> f64 {
        let part = &self.parts[component * self.states + state];
        let point = if y.is_nan() { None } else { F::point(y) };
        point.map_or(f64::NEG_INFINITY, |point| part.log_density(&point))
    }

    fn tails(&self, state: usize, component: usize, y: f64) -> Tails {
        self.parts[component * self.states + state].tails(y)
    }
}

/// M steps that come near the maximum where a single one does not find it.
const ROUNDS: usize = 20;

impl<F: Univariate + Send + Sync> StartFromClusters for Independent<F> {
    fn start<R: Rng + ?Sized>(
        &self,
        clusters: &Clusters<'_>,
        _: &mut R,
    ) -> Result<Self, Box<dyn Error + Send + Sync>> {
        // The first M step starts from the family's own parameters. If it maximises only a bound,
        // its result would still depend on them.
        let rounds = if F::EXACT { 0 } else { ROUNDS };
        (0..rounds).try_fold(clusters.fit(self)?, |family, _| clusters.round(&family))
    }
}

impl<F: Univariate> SampleObservation for Independent<F> {
    type Sample = Vec<f64>;

    fn sample<R: Rng + ?Sized>(&self, state: usize, rng: &mut R) -> Vec<f64> {
        self.parts[state..].iter().step_by(self.states).map(|part| part.draw(rng)).collect()
    }
}

impl<F: Clone> ReorderStates for Independent<F> {
    fn reordered(&self, order: &[usize]) -> Self {
        let reordered = |parts: &[F]| {
            let components = parts.chunks_exact(self.states);
            components.flat_map(|part| order.iter().map(|&state| part[state].clone())).collect()
        };
        let prior = self.prior.as_ref().map(|(parts, count)| (reordered(parts), *count));
        Self { parts: reordered(&self.parts), prior, ..*self }
    }
}

/// Returns a family with its settings.
#[cfg(feature = "serde")]
pub(crate) fn with_settings<F: Clone>(
    family: Independent<F>,
    missing: bool,
    prior: Option<(Independent<F>, f64)>,
) -> Result<Independent<F>, EmissionError> {
    let family = crate::family::when(missing, family, Independent::with_missing);
    prior.into_iter().try_fold(family, |family, (prior, count)| family.with_prior(prior, count))
}

// Learning of independent components: the M step of section 9 of the formulas, one by one for each
// state and component.

impl<F: Univariate> LearnLikelihood for Independent<F> {
    /// Sums of component c in state i, at c n + i.
    type Statistics = Vec<F::Statistics>;

    fn statistics(&self) -> Vec<F::Statistics> {
        vec![F::Statistics::default(); self.parts.len()]
    }

    /// Adds one observation. If it is invalid, and so has no
    /// [`diagonal`](wayfix::Likelihood::diagonal), only the components before the first invalid one
    /// are added.
    fn add(&self, statistics: &mut Vec<F::Statistics>, observation: &[f64], posterior: &[f64]) {
        let n = self.states;
        let _ = self.visit(observation, |component, point, parts| {
            let sums = &mut statistics[component * n..];
            for ((sums, part), &weight) in sums.iter_mut().zip(parts).zip(posterior) {
                // Statistics may be infinite in a state that rules the observation out: 0 · ∞ is
                // NaN.
                if weight > 0.0 {
                    sums.add(weight, &part.statistics(&point));
                }
            }
        });
    }

    fn merge(&self, statistics: &mut Vec<F::Statistics>, other: &Vec<F::Statistics>) {
        for (sums, other) in statistics.iter_mut().zip(other) {
            sums.add(1.0, other);
        }
    }

    fn maximize(
        &self,
        statistics: &Vec<F::Statistics>,
        pseudo_count: f64,
    ) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let maximize = |(index, part): (usize, &F)| {
            let mut sums = statistics[index].clone();
            // The prior is exp(c E ln p) for a count c: its term of Q is that of c observations
            // with the expected statistics.
            if let Some((prior, count)) = &self.prior {
                sums.add(*count, &part.expectations(&prior[index]));
            }
            part.add_pseudo_count(&mut sums, pseudo_count);
            // A state without observations or prior keeps its parameters.
            if sums.weight() < f64::MIN_POSITIVE {
                return Ok(part.clone());
            }
            let (component, state) = (index / self.states, index % self.states);
            part.maximize(&sums).map_err(|error| with_place(error, state, Some(component)))
        };
        let parts = self.parts.iter().enumerate().map(maximize).collect::<Result<_, _>>()?;
        Ok(Self { parts, prior: self.prior.clone(), ..*self })
    }

    fn log_prior(&self, pseudo_count: f64) -> f64 {
        let from_counts: f64 = self.parts.iter().map(|part| part.log_prior(pseudo_count)).sum();
        let prior = self.prior.iter().flat_map(|(prior, count)| {
            let parts = self.parts.iter().zip(prior);
            parts.map(move |(part, prior)| {
                count * part.expected_log_density(&part.expectations(prior))
            })
        });
        from_counts + prior.sum::<f64>()
    }

    fn free_parameters(&self) -> usize {
        self.parts.iter().map(Univariate::free_parameters).sum()
    }
}

// Free parameters of the distributions of one number, for standard errors (section 9 of the
// formulas): each on the scale of its constraint, logarithms for positive parameters and log-odds
// for probabilities.

type Outcome<T> = Result<T, Box<dyn Error + Send + Sync>>;

/// Parameters of each component in turn, and within it of each state.
impl<F: Univariate + FreeParameters> FreeParameters for Independent<F> {
    fn displaced(&self, by: &mut Displacement<'_>) -> Outcome<Self> {
        let parts = self.parts.iter().map(|part| part.displaced(by)).collect::<Result<_, _>>()?;
        Ok(Self { parts, prior: self.prior.clone(), ..*self })
    }
}

/// Implements the trait by calling a distribution's constructor with displaced parameters.
macro_rules! displaced {
    ($($type:ident, $part:ident, $by:ident => [$($parameter:expr),+];)+) => {$(
        impl FreeParameters for $type {
            fn displaced(&self, $by: &mut Displacement<'_>) -> Outcome<Self> {
                let $part = self;
                Ok(Self::new($($parameter),+)?)
            }
        }
    )+};
}

displaced! {
    Bernoulli, d, by => [by.probability(d.probability())];
    Binomial, d, by => [d.trials(), by.probability(d.probability())];
    Poisson, d, by => [by.positive(d.rate())];
    Exponential, d, by => [by.positive(d.rate())];
    NegativeBinomial, d, by => [by.positive(d.mean()), by.positive(d.dispersion())];
    Gamma, d, by => [by.positive(d.shape()), by.positive(d.scale())];
    LogNormal, d, by => [by.real(d.mean()), by.positive(d.deviation())];
    Weibull, d, by => [by.positive(d.shape()), by.positive(d.scale())];
    Beta, d, by => [by.positive(d.alpha()), by.positive(d.beta())];
    VonMises, d, by => [by.real(d.mean()), by.positive(d.concentration())];
    WrappedCauchy, d, by => [by.real(d.mean()), by.probability(d.concentration())];
}
