//! Families of rows with a known width, and likelihoods with marginals of single numbers.

use std::rc::Rc;
use std::sync::Arc;

use wayfix::{Fixed, Likelihood, LikelihoodError, OptionalLikelihood, TableLikelihood};

use crate::{EmissionError, Tails};

/// A likelihood of rows of numbers with a known width, so that a [`Product`](crate::Product) can
/// tell which part of a longer row belongs to it.
///
/// All families of this crate implement it. A sensor of your own takes part with its
/// [`Likelihood`] and one more method:
///
/// ```
/// use wayfix_learn::{Family, Poisson, Product};
/// use wayfix::{Diagonal, Likelihood, LikelihoodError, Scratch};
///
/// /// Height above the ground, by a barometer: floors of three metres.
/// struct Barometer(usize);
///
/// impl Likelihood for Barometer {
///     type Observation = [f64];
///     fn states(&self) -> usize {
///         self.0
///     }
///     fn diagonal<'a>(&'a self, height: &'a [f64], scratch: &'a mut Scratch) -> Result<Diagonal<'a>, LikelihoodError> {
///         let logs = scratch.values(self.0);
///         logs.iter_mut().enumerate().for_each(|(i, log)| *log = -(height[0] - 3.0 * i as f64).powi(2));
///         Ok(Diagonal::log(logs))
///     }
/// }
///
/// impl Family for Barometer {
///     fn components(&self) -> usize {
///         1
///     }
/// }
///
/// let networks = Poisson::family(&[[2.0], [9.0]])?; // that are received on either floor
/// let both = Product::new(Barometer(2), networks)?;
/// assert_eq!(both.components(), 2);
/// # Ok::<(), wayfix_learn::EmissionError>(())
/// ```
pub trait Family: Likelihood<Observation = [f64]> {
    /// Number of components of a row, d.
    fn components(&self) -> usize;
}

macro_rules! delegates {
    ($($wrapper:ty [$($bound:tt)*], |$this:ident| $inner:expr;)*) => {$(
        impl<B: Family $($bound)*> Family for $wrapper {
            fn components(&self) -> usize {
                let $this = self;
                $inner.components()
            }
        }
    )*};
}

delegates! {
    Fixed<B> [], |fixed| fixed.0;
    &B [+ ?Sized], |family| (**family);
    Box<B> [+ ?Sized], |family| (**family);
    Rc<B> [+ ?Sized], |family| (**family);
    Arc<B> [+ ?Sized], |family| (**family);
}

/// Changes a family, if it was changed before.
#[cfg(feature = "serde")]
pub(crate) fn when<F>(changed: bool, family: F, change: fn(F) -> F) -> F {
    if changed { change(family) } else { family }
}

/// Values of all states.
#[cfg(feature = "serde")]
pub(crate) fn by_state(values: impl Fn(usize) -> Option<Vec<f64>>) -> Vec<Vec<f64>> {
    (0..).map_while(values).collect()
}

// Likelihoods with a known marginal distribution for each number of an observation.

/// A likelihood that knows the marginal distribution of each number of an observation in a state,
/// for [pseudo-residuals](crate::PseudoResiduals) and [forecasts](crate::Predictive) of
/// observations.
///
/// Implemented for [`Independent`](crate::Independent) families of
/// [`Cumulative`](crate::Cumulative) distributions, [`Gaussian`](crate::Gaussian),
/// [`GaussianMixture`](crate::GaussianMixture), [`StudentT`](crate::StudentT),
/// [`Product`](crate::Product)s of these, and for tables of symbols, which are ordered by their
/// numbers. A sensor of your own takes part with a few lines:
///
/// ```
/// use wayfix_learn::{Marginals, PseudoResiduals, Tails};
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
    /// [`Cumulative::tails`](crate::Cumulative::tails).
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
