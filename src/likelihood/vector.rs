//! [`LikelihoodVector`], for likelihoods computed elsewhere: the observation is the diagonal.

use std::marker::PhantomData;

use super::{Diagonal, Likelihood, LocalLikelihood, Scratch};
use crate::error::LikelihoodError;

/// A sensor whose observation is the diagonal itself: a slice of n likelihoods, or of their
/// natural logarithms.
///
/// ```
/// use wayfix::{Belief, DenseTransition, Hmm, LikelihoodVector, Prior};
///
/// let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
/// let transition = DenseTransition::from_rows(&[[0.7, 0.3], [0.3, 0.7]])?;
/// let hmm = Hmm::new(prior, transition, LikelihoodVector::log(2))?;
/// let mut filter = hmm.filter();
/// filter.step(&[-100_000.0, -100_000.0 + 3f64.ln()])?;
/// assert!((filter.belief().as_slice()[1] - 0.75).abs() < 1e-10);
/// assert!((filter.log_likelihood() - (-100_000.0 + 2f64.ln())).abs() < 1e-9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// `Y` is the type of the observations: slices, or vectors after calling [`owned`](Self::owned).
#[derive(Debug)]
pub struct LikelihoodVector<Y: ?Sized = [f64]> {
    pub(crate) states: usize,
    pub(crate) log: bool,
    pub(crate) observation: PhantomData<fn(&Y)>,
}

impl LikelihoodVector {
    /// Creates a sensor for slices of `states` likelihoods, each finite and at least 0, of any
    /// scale.
    #[must_use]
    pub fn linear(states: usize) -> Self {
        Self { states, log: false, observation: PhantomData }
    }

    /// Creates a sensor for slices of `states` natural log-likelihoods, each at most 1e300 in
    /// magnitude, or −∞, which rules a state out.
    #[must_use]
    pub fn log(states: usize) -> Self {
        Self { states, log: true, observation: PhantomData }
    }

    /// Changes the type of the observations to `Vec<f64>`, which can be put into an `Option` or a
    /// pair, as [`OptionalLikelihood`](crate::OptionalLikelihood) and
    /// [`FusedLikelihood`](crate::FusedLikelihood) require.
    #[must_use]
    pub fn owned(self) -> LikelihoodVector<Vec<f64>> {
        LikelihoodVector { states: self.states, log: self.log, observation: PhantomData }
    }
}

impl<Y: AsRef<[f64]> + ?Sized> LikelihoodVector<Y> {
    #[inline]
    fn of<'a>(&self, observation: &'a Y) -> Diagonal<'a> {
        let values = observation.as_ref();
        if self.log { Diagonal::log(values) } else { Diagonal::linear(values) }
    }
}

impl<Y: AsRef<[f64]> + ?Sized> Likelihood for LikelihoodVector<Y> {
    type Observation = Y;

    fn states(&self) -> usize {
        self.states
    }

    #[inline]
    fn diagonal<'a>(
        &'a self,
        observation: &'a Y,
        _: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        Ok(self.of(observation))
    }

    // Logarithms would have to be exponentiated a second time.
    fn is_precomputed(&self) -> bool {
        !self.log
    }
}

/// Costs O(n), since all values are checked.
impl<Y: AsRef<[f64]> + ?Sized> LocalLikelihood for LikelihoodVector<Y> {
    fn local<'a>(
        &'a self,
        observation: &'a Y,
        states: &[usize],
        scratch: &'a mut Scratch,
    ) -> Result<(Diagonal<'a>, f64), LikelihoodError> {
        let all = self.of(observation);
        all.check(self.states)?;
        let out = scratch.values(states.len());
        // A merge: `states` ascend, so one pass divides the values into those asked for and the
        // others, whose maximum is the tightest bound.
        let mut asked = states.iter().zip(&mut *out).peekable();
        let mut others: f64 = if self.log { f64::NEG_INFINITY } else { 0.0 };
        for (i, &value) in all.as_slice().iter().enumerate() {
            match asked.next_if(|(state, _)| **state == i) {
                Some((_, out)) => *out = value,
                None => others = others.max(value),
            }
        }
        Ok((if self.log { Diagonal::log(out) } else { Diagonal::linear(out) }, others))
    }
}

impl<Y: ?Sized> Clone for LikelihoodVector<Y> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<Y: ?Sized> Copy for LikelihoodVector<Y> {}

#[cfg(feature = "serde")]
crate::stored! {
    [Y: AsRef<[f64]> + ?Sized] LikelihoodVector<Y>: [], |vector| {
        states: usize = vector.states,
        log: bool = vector.log,
    } => Ok::<_, std::convert::Infallible>(Self { states, log, observation: PhantomData });
}
