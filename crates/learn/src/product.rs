//! Several families in one row: b_i(y) is the product of theirs (section 1 of the formulas). Its
//! logarithm is a sum, so each family is learned from its own components with the same γ.

use std::borrow::Borrow;

use rand::Rng;

use super::clusters::Outcome;
use super::{Clusters, EmissionError, Family, Marginals, StartFromClusters, Tails};
use crate::error::check_length;
use wayfix::LikelihoodError;
use wayfix::ReorderStates;
use wayfix::inference::{Displacement, FreeParameters};
use wayfix::internal::product_of;
use wayfix::likelihood::{LearnLikelihood, SampleObservation};
use wayfix::{Diagonal, Likelihood, Scratch};

/// Several sensors in one row: the first components are observations of one family, the others of
/// another, independent given the state.
///
/// The density of a row is the product of the two densities. Nest products for more than two
/// families; each keeps its own settings, such as missing components and priors, and is learned by
/// itself. [`Fixed`](wayfix::Fixed) excludes one of them from learning, and a sensor of your own
/// takes part as a [`Family`].
///
/// A step costs those of both families and O(n) more, and allocates nothing.
///
/// ```
/// use wayfix_learn::{Gamma, Poisson, Product, VonMises};
/// use wayfix::inference::LearningOptions;
/// use wayfix::{Belief, DenseTransition, Hmm, Prior};
///
/// // A vehicle on one of two roads, with a heading in radians, a speed in metres per second and
/// // the number of satellites in view.
/// let heading = VonMises::family(&[[0.0], [1.6]], &[[2.0], [2.0]])?;
/// let speed = Gamma::family(&[[2.0], [2.0]], &[[3.0], [8.0]])?; // shapes, then scales
/// let satellites = Poisson::family(&[[6.0], [10.0]])?;
/// let sensors = Product::new(heading, Product::new(speed, satellites)?)?;
///
/// let hmm = Hmm::new(
///     Prior::AtFirstObservation(Belief::uniform(2)?),
///     DenseTransition::from_rows(&[[0.9, 0.1], [0.1, 0.9]])?,
///     sensors,
/// )?;
/// let street = [[0.1, 6.2, 5.0], [-0.1, 7.9, 4.0], [0.0, 5.1, 7.0], [0.2, 6.8, 4.0]];
/// let motorway = [[1.5, 25.0, 11.0], [1.7, 27.5, 12.0], [1.6, 26.1, 11.0], [1.5, 24.8, 12.0]];
/// let rows = [street, motorway].concat();
/// assert_eq!(hmm.viterbi(&rows)?.states(), [0, 0, 0, 0, 1, 1, 1, 1]);
///
/// let learned = hmm.learn(&[rows], &LearningOptions::default())?;
/// let (heading, others) = learned.model().likelihood().clone().into_parts();
/// assert!((heading.component(1, 0).unwrap().mean() - 1.575).abs() < 1e-3);
/// let (speed, satellites) = (others.first().component(0, 0), others.second().component(1, 0));
/// assert!((speed.map_or(0.0, |gamma| gamma.shape() * gamma.scale()) - 6.5).abs() < 1e-3);
/// assert!((satellites.map_or(0.0, Poisson::rate) - 11.5).abs() < 1e-3);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Product<A, B> {
    first: A,
    second: B,
}

impl<A: Family, B: Family> Product<A, B> {
    /// Creates the family of rows with the components of `first` followed by those of `second`.
    ///
    /// # Errors
    ///
    /// [`EmissionError::Length`] if the two differ in their number of states.
    pub fn new(first: A, second: B) -> Result<Self, EmissionError> {
        let what = "list of states of the second factor";
        check_length(what, None, second.states(), first.states())?;
        Ok(Self { first, second })
    }

    /// Splits a row into the components of either family, or returns `None` if it has the wrong
    /// width.
    fn split<'a>(&self, row: &'a [f64]) -> Option<(&'a [f64], &'a [f64])> {
        let parts = row.split_at_checked(self.first.components())?;
        (parts.1.len() == self.second.components()).then_some(parts)
    }

    /// Range of the second family's components in a row.
    fn others(&self) -> (usize, usize) {
        (self.first.components(), self.components())
    }
}

impl<A, B> Product<A, B> {
    /// Family of the first components.
    #[must_use]
    pub fn first(&self) -> &A {
        &self.first
    }

    /// Family of the components after those of the first.
    #[must_use]
    pub fn second(&self) -> &B {
        &self.second
    }

    /// Both families.
    #[must_use]
    pub fn into_parts(self) -> (A, B) {
        (self.first, self.second)
    }
}

impl<A: Family, B: Family> Family for Product<A, B> {
    /// Sum of the widths of both families.
    fn components(&self) -> usize {
        self.first.components() + self.second.components()
    }
}

impl<A: Family, B: Family> Likelihood for Product<A, B> {
    type Observation = [f64];

    fn states(&self) -> usize {
        self.first.states()
    }

    fn diagonal<'a>(
        &'a self,
        row: &'a [f64],
        scratch: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        let Some((first, second)) = self.split(row) else {
            let (found, expected) = (row.len(), self.components());
            return Err(EmissionError::Components { found, expected }.into());
        };
        // A scratch for each family: both diagonals are in use until the product is written.
        let (out, parts) = scratch.with_parts(self.states(), 2);
        let (left, right) = parts.split_at_mut(1);
        let whole = |(from, to)| move |error| in_factor(error, from, to);
        let first = self.first.diagonal(first, &mut left[0]);
        let first = first.map_err(whole((0, self.first.components())))?;
        let second = self.second.diagonal(second, &mut right[0]).map_err(whole(self.others()))?;
        product_of(&first, &second, out)
    }
}

impl<A: Family + Marginals, B: Family + Marginals> Marginals for Product<A, B> {
    fn numbers(&self) -> usize {
        self.components()
    }

    fn number(&self, row: &[f64], component: usize) -> Result<Option<f64>, LikelihoodError> {
        let Some((first, second)) = self.split(row) else {
            let (found, expected) = (row.len(), self.components());
            return Err(EmissionError::Components { found, expected }.into());
        };
        let (from, to) = self.others();
        if component < from {
            let found = self.first.number(first, component);
            return found.map_err(|error| in_factor(error, 0, from));
        }
        self.second.number(second, component - from).map_err(|error| in_factor(error, from, to))
    }

    fn log_density(&self, state: usize, component: usize, y: f64) -> f64 {
        match component.checked_sub(self.first.components()) {
            None => self.first.log_density(state, component, y),
            Some(component) => self.second.log_density(state, component, y),
        }
    }

    fn tails(&self, state: usize, component: usize, y: f64) -> Tails {
        match component.checked_sub(self.first.components()) {
            None => self.first.tails(state, component, y),
            Some(component) => self.second.tails(state, component, y),
        }
    }
}

/// Converts an error of the family of components `from` to `to` into one of the whole row.
fn in_factor(error: LikelihoodError, from: usize, to: usize) -> LikelihoodError {
    // Errors of a user's own family are passed on unchanged, since their components are unknown.
    if let LikelihoodError::Sensor(failed) = &error
        && let Some(source) = failed.cause.downcast_ref::<EmissionError>()
    {
        return source.clone().in_factor(from, to).into();
    }
    error
}

impl<A, B> LearnLikelihood for Product<A, B>
where
    A: Family + LearnLikelihood,
    B: Family + LearnLikelihood,
{
    /// Statistics of either family.
    type Statistics = (A::Statistics, B::Statistics);

    fn statistics(&self) -> Self::Statistics {
        (self.first.statistics(), self.second.statistics())
    }

    /// Adds one observation, or nothing if it has the wrong width.
    fn add(&self, statistics: &mut Self::Statistics, row: &[f64], posterior: &[f64]) {
        if let Some((first, second)) = self.split(row) {
            self.first.add(&mut statistics.0, first, posterior);
            self.second.add(&mut statistics.1, second, posterior);
        }
    }

    fn merge(&self, statistics: &mut Self::Statistics, other: &Self::Statistics) {
        self.first.merge(&mut statistics.0, &other.0);
        self.second.merge(&mut statistics.1, &other.1);
    }

    /// Maximises each family by itself. Their errors, if they are [`EmissionError`]s, name the
    /// components of the row.
    fn maximize(&self, statistics: &Self::Statistics, pseudo_count: f64) -> Outcome<Self> {
        let (from, to) = self.others();
        let first = self.first.maximize(&statistics.0, pseudo_count);
        let second = self.second.maximize(&statistics.1, pseudo_count);
        Ok(Self { first: learned(first, 0, from)?, second: learned(second, from, to)? })
    }

    fn log_prior(&self, pseudo_count: f64) -> f64 {
        self.first.log_prior(pseudo_count) + self.second.log_prior(pseudo_count)
    }

    fn free_parameters(&self) -> usize {
        self.first.free_parameters() + self.second.free_parameters()
    }
}

/// Returns the learned family of components `from` to `to`, or its error as one of the whole row.
fn learned<F>(outcome: Outcome<F>, from: usize, to: usize) -> Outcome<F> {
    outcome.map_err(|error| match error.downcast::<EmissionError>() {
        Ok(error) => error.in_factor(from, to).into(),
        Err(other) => other,
    })
}

impl<A, B> StartFromClusters for Product<A, B>
where
    A: Family + StartFromClusters,
    B: Family + StartFromClusters,
{
    /// Starts each family from its own components of the same clusters. Errors name components of
    /// the row.
    fn start<R: Rng + ?Sized>(&self, clusters: &Clusters<'_>, rng: &mut R) -> Outcome<Self> {
        clusters.check(self)?;
        let (from, to) = self.others();
        let first = self.first.start(&clusters.columns(0..from), rng);
        let second = self.second.start(&clusters.columns(from..to), rng);
        Ok(Self { first: learned(first, 0, from)?, second: learned(second, from, to)? })
    }
}

impl<A, B> SampleObservation for Product<A, B>
where
    A: Family + SampleObservation,
    B: Family + SampleObservation,
{
    type Sample = Vec<f64>;

    fn sample<R: Rng + ?Sized>(&self, state: usize, rng: &mut R) -> Vec<f64> {
        let first = self.first.sample(state, rng);
        let second = self.second.sample(state, rng);
        [first.borrow(), second.borrow()].concat()
    }
}

impl<A: ReorderStates, B: ReorderStates> ReorderStates for Product<A, B> {
    fn reordered(&self, order: &[usize]) -> Self {
        Self { first: self.first.reordered(order), second: self.second.reordered(order) }
    }
}

/// Parameters of the first family, then of the second.
impl<A: FreeParameters, B: FreeParameters> FreeParameters for Product<A, B> {
    fn displaced(&self, by: &mut Displacement<'_>) -> Outcome<Self> {
        Ok(Self { first: self.first.displaced(by)?, second: self.second.displaced(by)? })
    }
}

#[cfg(feature = "serde")]
wayfix::stored! {
    [A: Family, B: Family] Product<A, B>: [A, B], |product| {
        first: A = product.first(),
        second: B = product.second(),
    } => Self::new(first, second);
}
