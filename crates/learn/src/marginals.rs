//! Likelihoods with a known marginal distribution for each number of an observation.

use std::rc::Rc;
use std::sync::Arc;

use super::{EmissionError, Tails};
use wayfix::Fixed;
use wayfix::LikelihoodError;
use wayfix::{Likelihood, OptionalLikelihood, TableLikelihood};

/// A likelihood that knows the marginal distribution of each number of an observation in a state,
/// for [pseudo-residuals](wayfix::Hmm::pseudo_residuals) and [forecasts](super::Predictive) of
/// observations.
///
/// Implemented for [`Independent`](super::Independent) families of
/// [`Cumulative`](super::Cumulative) distributions, [`Gaussian`](super::Gaussian),
/// [`GaussianMixture`](super::GaussianMixture), [`StudentT`](super::StudentT),
/// [`Product`](super::Product)s of these, and for tables of symbols, which are ordered by their
/// numbers. A sensor of your own takes part with a few lines:
///
/// ```
/// use wayfix_learn::{Marginals, Tails};
/// use wayfix::{Diagonal, Likelihood, LikelihoodError, Scratch};
///
/// /// A number that is uniform from 0 to a width of each state.
/// struct Widths(Vec<f64>);
///
/// impl Likelihood for Widths {
///     type Observation = f64;
///     fn states(&self) -> usize {
///         self.0.len()
///     }
///     fn diagonal<'a>(&'a self, y: &f64, scratch: &'a mut Scratch) -> Result<Diagonal<'a>, LikelihoodError> {
///         let logs = scratch.values(self.0.len());
///         (0..).zip(&mut *logs).for_each(|(state, log)| *log = self.log_density(state, 0, *y));
///         Ok(Diagonal::log(logs))
///     }
/// }
///
/// impl Marginals for Widths {
///     fn numbers(&self) -> usize {
///         1
///     }
///     fn number(&self, y: &f64, _: usize) -> Result<Option<f64>, LikelihoodError> {
///         Ok(Some(*y))
///     }
///     fn log_density(&self, state: usize, _: usize, y: f64) -> f64 {
///         if (0.0..=self.0[state]).contains(&y) { -self.0[state].ln() } else { f64::NEG_INFINITY }
///     }
///     fn tails(&self, state: usize, _: usize, y: f64) -> Tails {
///         let y = y.clamp(0.0, self.0[state]) / self.0[state];
///         Tails { below: y, at: 0.0, above: 1.0 - y }
///     }
/// }
///
/// # use wayfix::{Belief, DenseTransition, Hmm, Prior};
/// let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
/// let hmm = Hmm::new(prior, DenseTransition::from_rows(&[[0.5; 2]; 2])?, Widths(vec![1.0, 4.0]))?;
/// let residuals = PseudoResiduals::new(&hmm, &[1.0, 0.5], 0)?;
/// assert_eq!(residuals.forecast()[0].map(|tails| tails.below), Some(0.5 * 1.0 + 0.5 * 0.25));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub trait Marginals: Likelihood {
    /// Number of components of an observation.
    fn numbers(&self) -> usize;

    /// The number at a component of an observation, below [`numbers`](Self::numbers), or `None` if
    /// it is missing. It is never NaN.
    ///
    /// # Errors
    ///
    /// [`LikelihoodError`] if the number is not valid, or the observation has another number of
    /// components.
    fn number(
        &self,
        observation: &Self::Observation,
        component: usize,
    ) -> Result<Option<f64>, LikelihoodError>;

    /// Logarithm of the density of a number in a state (of the probability, for symbols and
    /// counts): −∞ where it is 0, and for a number that cannot be observed. State and component
    /// exist.
    fn log_density(&self, state: usize, component: usize, y: f64) -> f64;

    /// Probabilities below, at and above any number but NaN, in a state. See
    /// [`Cumulative::tails`](super::Cumulative::tails).
    fn tails(&self, state: usize, component: usize, y: f64) -> Tails;
}

/// Checks that observations have this component.
pub(super) fn check_component<B: Marginals>(
    likelihood: &B,
    component: usize,
) -> Result<(), EmissionError> {
    let components = likelihood.numbers();
    if component < components {
        return Ok(());
    }
    Err(EmissionError::NoComponent { component, components })
}

/// Symbols count as their numbers, from 0.
impl Marginals for TableLikelihood {
    fn numbers(&self) -> usize {
        1
    }

    fn number(&self, &symbol: &usize, _: usize) -> Result<Option<f64>, LikelihoodError> {
        let symbols = self.symbols();
        if symbol < symbols {
            return Ok(Some(symbol as f64));
        }
        Err(LikelihoodError::Symbol { symbol, symbols })
    }

    fn log_density(&self, state: usize, _: usize, y: f64) -> f64 {
        // Numbers between symbols, or beyond the last, have no probability.
        let symbol = (0..self.symbols()).find(|symbol| *symbol as f64 == y);
        symbol.and_then(|symbol| self.probability(state, symbol)).map_or(f64::NEG_INFINITY, f64::ln)
    }

    /// O(symbols).
    fn tails(&self, state: usize, _: usize, y: f64) -> Tails {
        let mut tails = Tails::default();
        for symbol in 0..self.symbols() {
            let (p, place) = (self.probability(state, symbol).unwrap_or(0.0), symbol as f64);
            if place < y {
                tails.below += p;
            } else if place > y {
                tails.above += p;
            } else {
                tails.at += p;
            }
        }
        tails
    }
}

impl<B: Marginals<Observation: Sized>> Marginals for OptionalLikelihood<B> {
    fn numbers(&self) -> usize {
        self.sensor().numbers()
    }

    fn number(
        &self,
        observation: &Option<B::Observation>,
        component: usize,
    ) -> Result<Option<f64>, LikelihoodError> {
        let Some(observation) = observation else { return Ok(None) };
        self.sensor().number(observation, component)
    }

    fn log_density(&self, state: usize, component: usize, y: f64) -> f64 {
        self.sensor().log_density(state, component, y)
    }

    fn tails(&self, state: usize, component: usize, y: f64) -> Tails {
        self.sensor().tails(state, component, y)
    }
}

macro_rules! delegates {
    ($($wrapper:ty [$($bound:tt)*];)*) => {$(
        impl<B: Marginals $($bound)*> Marginals for $wrapper {
            fn numbers(&self) -> usize {
                (**self).numbers()
            }

            fn number(
                &self,
                observation: &B::Observation,
                component: usize,
            ) -> Result<Option<f64>, LikelihoodError> {
                (**self).number(observation, component)
            }

            fn log_density(&self, state: usize, component: usize, y: f64) -> f64 {
                (**self).log_density(state, component, y)
            }

            fn tails(&self, state: usize, component: usize, y: f64) -> Tails {
                (**self).tails(state, component, y)
            }
        }
    )*};
}

delegates! {
    Fixed<B> [];
    &B [+ ?Sized];
    Box<B> [+ ?Sized];
    Rc<B> [+ ?Sized];
    Arc<B> [+ ?Sized];
}
