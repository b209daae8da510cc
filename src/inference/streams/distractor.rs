//! [`Distractor`]: the belief of what a distracted sensor follows.
//!
//! With the modes m, the place X of the vehicle and the place Z that a distracted sensor sees, the
//! chain is p_k(z) = p(Z_k = z | m_k = 1, y_1 … y_k). A step predicts it from the two ways into
//! m_k = 1, and multiplies by the likelihoods of the observation.

use crate::belief::{Belief, BeliefView, SUM_TOLERANCE};
use crate::error::{HmmError, OutOfRange, TransitionError};
use crate::likelihood::Diagonal;
use crate::transition::{DistractionRates, Transition, validate};
use wayfix_kernels::{self as kernels, limits};

/// Belief of what a distracted sensor follows, for the likelihoods of a
/// [`DistractedTransition`](crate::transition::DistractedTransition).
///
/// It is a chain of its own with M states: where the view of a distracted camera seems to be, say.
/// A distraction begins at a state drawn from `start`, and moves by an operator A, which may be that
/// of the vehicle. So the likelihood of an observation with the likelihoods q of the chain's states is
///
/// ```text
/// begins    = Σ_z start(z) q(z)
/// continues = Σ_z (A p)(z) q(z)
/// ```
/// with the belief p given that the sensor is distracted and all observations so far. Afterwards p is
/// in proportion to ((1 − b) d A p + a (1 − d) start) ∘ q, with the [rates](DistractionRates) a and b
/// and the probability d that the sensor was distracted. A step costs one product with A and O(M).
///
/// # Exact or approximate
///
/// Given the mode, the chain is taken to be independent of the vehicle. Both know when the
/// distraction began: the earlier it did, the less of the vehicle was seen, and the longer the chain
/// has moved. So likelihoods and filter are exact
///
/// - if it is certain at each step when the present distraction, if any, began,
/// - if attentive observations say nothing of the vehicle or its position is certain, or
/// - if each observation draws the state of the chain anew: all columns of A are `start`.
///
/// Otherwise the belief is a mixture over the times at which the distraction may have begun, and
/// how it depends on the vehicle is dropped at each step, as in assumed-density filters of factored
/// chains (Boyen and Koller 1998). Over random chains of two or three states and up to six
/// observations, filtered probabilities of mode and place differ from the exact ones by 0.003 in total
/// variation on average, or less, and in the worst of 30,000 drives by 0.17. Smoothing with the same
/// controls is exact in the first case and in the third; otherwise it differs by 0.012 on average, or
/// less, and by up to 0.41.
///
/// # In step with a filter
///
/// [`observe`](Self::observe) returns both likelihoods, and only proposes the next belief;
/// [`accept`](Self::accept) takes it over, once the step of the filter has succeeded.
///
/// ```
/// use wayfix::inference::Distractor;
/// use wayfix::transition::{DistractedTransition, Distraction, DistractionRates};
/// use wayfix::{Belief, Hmm, LikelihoodVector, Prior, SparseTransition};
///
/// // Three places of a loop; 0.9 of the views are as expected.
/// let drive = SparseTransition::from_triplets(3, (0..3).map(|j| ((j + 1) % 3, j, 1.0)))?;
/// let seen = |place| [0, 1, 2].map(|i| if i == place { 0.9 } else { 0.05 });
/// let rates = DistractionRates { begin: 0.1, end: 0.25 };
/// let mut distractor = Distractor::new(drive.clone(), Belief::uniform(3)?, rates)?;
/// let a = DistractedTransition::new(drive, rates)?;
/// let prior = Prior::BeforeFirstTransition(Belief::certain(6, 0)?);
/// let hmm = Hmm::new(prior, a, LikelihoodVector::linear(6))?;
/// let mut filter = hmm.filter();
/// for view in [1, 0, 1, 2] {
///     let [_, distracted] = hmm.transition().mode_masses(filter.belief().as_slice());
///     let q = seen(view);
///     let (begins, continues) = distractor.observe(&(), &q, distracted)?;
///     let control = Distraction { control: (), begins, continues };
///     filter.step_with(&control, &[q[0], q[1], q[2], 1.0, 1.0, 1.0])?;
///     distractor.accept();
/// }
/// // The vehicle is at place 1, and the camera follows something that goes ahead of it.
/// assert_eq!(filter.belief().mode(), 3 + 1);
/// assert_eq!(distractor.belief().mode(), 2);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct Distractor<A> {
    transition: A,
    start: Belief,
    rates: DistractionRates,
    /// Steps taken, for errors.
    steps: usize,
    belief: Vec<f64>,
    /// The next belief, if `pending`.
    next: Vec<f64>,
    pending: bool,
    /// Prediction of the belief by A, which sums to one; 0 if the control rules out all moves.
    predicted: Vec<f64>,
    /// Logarithms of the belief, where a prediction needs them.
    logs: Vec<f64>,
}

impl<A: Transition> Distractor<A> {
    /// Creates the belief before the first observation, at `start`, with the operator of what
    /// a distracted sensor follows. Allocates all memory that steps need, but for that of the
    /// operator.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Parameter`] unless both rates are from 0 to 1,
    /// [`TransitionError::PartStates`] if `start` has another number of states than the operator,
    /// or as [`Hmm::new`](crate::Hmm::new) for an operator that is not stochastic.
    pub fn new(
        transition: A,
        start: Belief,
        rates: DistractionRates,
    ) -> Result<Self, TransitionError> {
        rates.check()?;
        validate(&transition)?;
        check_states("start belief", &start, transition.states())?;
        let belief = start.as_slice().to_vec();
        let zeros = vec![0.0; belief.len()];
        let (next, predicted, logs) = (zeros.clone(), zeros.clone(), zeros);
        Ok(Self {
            transition,
            start,
            rates,
            steps: 0,
            belief,
            next,
            pending: false,
            predicted,
            logs,
        })
    }

    /// Replaces the present belief, such as by one that was stored. A proposal is dropped.
    ///
    /// # Errors
    ///
    /// [`TransitionError::PartStates`] if the belief has another number of states.
    pub fn with_belief(mut self, belief: Belief) -> Result<Self, TransitionError> {
        check_states("belief", &belief, self.belief.len())?;
        self.belief = belief.into_vec();
        self.pending = false;
        Ok(self)
    }

    /// Proposes the belief given the first observation, for a filter whose [prior is at the first
    /// observation](crate::Prior::AtFirstObservation): no move leads to it. `likelihoods` has one
    /// value for each of the M states.
    ///
    /// Returns both likelihoods of the observation, `begins` and `continues`, which are the same: a
    /// sensor that is distracted at the first observation is at a state drawn from `start`. As the
    /// step has no transition, and so no control, `begins` is the likelihood of the distracted
    /// states in the filter's first observation. O(M).
    ///
    /// # Errors
    ///
    /// [`HmmError::Likelihood`] unless there are M likelihoods, each finite and at least 0. The
    /// state is then unchanged, and so is a proposal.
    pub fn first(&mut self, likelihoods: &[f64]) -> Result<(f64, f64), HmmError> {
        let largest = self.check(likelihoods)?;
        let begins = kernels::dot(self.start.as_slice(), likelihoods);
        self.next.copy_from_slice(self.start.as_slice());
        condition(&mut self.next, likelihoods, largest);
        self.propose();
        Ok((begins, begins))
    }

    /// Proposes the belief after a step with an observation, and returns its likelihoods `begins`
    /// and `continues`, for the [control](crate::transition::Distraction) of the filter's step.
    ///
    /// `control` is that of the operator, `likelihoods` has one value for each of the M states,
    /// in the scale of those of an attentive sensor, and `distracted` is the probability, before the
    /// step, that the sensor is distracted. The control may be [evidence on
    /// moves](Transition::evidence): it weighs the states of the chain, but not the chain against
    /// the vehicle, so predictions are normalised.
    ///
    /// If a distraction can neither begin nor go on, or all the states that it leads to are
    /// impossible, the proposal is `start`. A second call replaces the proposal of the first.
    ///
    /// # Errors
    ///
    /// [`HmmError`] with the step: [`Control`](HmmError::Control) if the operator does not accept
    /// the control, or `distracted` is not from 0 to 1 (within 1e-9);
    /// [`Likelihood`](HmmError::Likelihood) unless there are M likelihoods, each finite and at
    /// least 0; [`Predicted`](HmmError::Predicted) if the operator violates its contract. The
    /// belief and its proposal are then unchanged.
    pub fn observe(
        &mut self,
        control: &A::Control,
        likelihoods: &[f64],
        distracted: f64,
    ) -> Result<(f64, f64), HmmError> {
        let largest = self.check(likelihoods)?;
        let distracted = self.move_on(control, distracted)?;
        let begins = kernels::dot(self.start.as_slice(), likelihoods);
        let continues = kernels::dot(&self.predicted, likelihoods);
        self.mix(distracted);
        condition(&mut self.next, likelihoods, largest);
        self.propose();
        Ok((begins, continues))
    }

    /// Takes over the proposal of the last [`observe`](Self::observe) or [`first`](Self::first), in
    /// O(1). Without one it does nothing.
    pub fn accept(&mut self) {
        if self.pending {
            std::mem::swap(&mut self.belief, &mut self.next);
            self.pending = false;
            self.steps += 1;
        }
    }

    /// Goes back to the belief at the start, in O(M).
    pub fn restart(&mut self) {
        self.belief.copy_from_slice(self.start.as_slice());
        (self.pending, self.steps) = (false, 0);
    }

    /// Predicts: a step without an observation, which takes effect at once. A proposal is dropped.
    ///
    /// # Errors
    ///
    /// As [`observe`](Self::observe).
    pub fn predict(&mut self, control: &A::Control, distracted: f64) -> Result<(), HmmError> {
        let distracted = self.move_on(control, distracted)?;
        self.mix(distracted);
        self.propose();
        self.accept();
        Ok(())
    }

    /// Present belief: the distribution of the state of the chain, given that the sensor is
    /// distracted.
    #[must_use]
    pub fn belief(&self) -> BeliefView<'_> {
        BeliefView::view(&self.belief)
    }

    /// Belief that [`accept`](Self::accept) would take over; the present one if there is none.
    #[must_use]
    pub fn proposed(&self) -> BeliefView<'_> {
        BeliefView::view(if self.pending { &self.next } else { &self.belief })
    }

    /// The operator of what a distracted sensor follows.
    #[must_use]
    pub fn transition(&self) -> &A {
        &self.transition
    }

    /// Checks likelihoods, and returns the largest.
    fn check(&self, likelihoods: &[f64]) -> Result<f64, HmmError> {
        let diagonal = Diagonal::linear(likelihoods);
        let checked = diagonal.check(self.belief.len());
        checked.map_err(|cause| HmmError::likelihood(self.steps + 1, cause))
    }

    /// Predicts the belief of a distraction that goes on, into `predicted`, and returns the
    /// probability of a distraction without rounding errors above 1.
    fn move_on(&mut self, control: &A::Control, distracted: f64) -> Result<f64, HmmError> {
        let step = self.steps + 1;
        let refused = |cause| HmmError::control(step, cause);
        if !(0.0..=1.0 + SUM_TOLERANCE).contains(&distracted) {
            let what = "the probability that the sensor is distracted";
            let cause = OutOfRange::new(what, distracted, "a value from 0 to 1");
            return Err(refused(cause.into()));
        }
        self.transition.check_control(control).map_err(refused)?;
        self.transition.apply(control, &self.belief, &mut self.predicted);
        let mut sum = kernels::sum(&self.predicted);
        // As a filter does: entries of evidence beyond doubles, or far from 1, take logarithms.
        if self.transition.needs_logs(control) || !limits::EVIDENCE_SUMS.contains(&sum) {
            self.logs.iter_mut().zip(&self.belief).for_each(|(log, p)| *log = p.ln());
            self.transition.apply_log(control, &self.logs, &mut self.predicted);
            let largest = self.predicted.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            // −∞ if no move is possible: nothing is then predicted.
            let shift = if largest.is_finite() { largest } else { 0.0 };
            self.predicted.iter_mut().for_each(|p| *p = (*p - shift).exp());
            sum = kernels::sum(&self.predicted);
        }
        // A fold without an early exit vectorises.
        let valid = |p: f64| (0.0..=f64::MAX).contains(&p);
        if !self.predicted.iter().fold(true, |all, p| all & valid(*p))
            && let Some(state) = self.predicted.iter().position(|p| !valid(*p))
        {
            return Err(HmmError::Predicted { step, state, value: self.predicted[state] });
        }
        if sum > 0.0 {
            self.predicted.iter_mut().for_each(|p| *p /= sum);
        }
        Ok(distracted.min(1.0))
    }

    /// Computes the belief before the observation, into `next`: a distraction went on, or began.
    fn mix(&mut self, distracted: f64) {
        let DistractionRates { begin, end } = self.rates;
        let (continues, begins) = ((1.0 - end) * distracted, begin * (1.0 - distracted));
        let parts = self.predicted.iter().zip(self.start.as_slice());
        for (next, (predicted, start)) in self.next.iter_mut().zip(parts) {
            *next = continues * predicted + begins * start;
        }
    }

    /// Normalises `next`, and makes it the proposal.
    fn propose(&mut self) {
        // Divided by the largest first: the weights may all be tiny.
        let largest = self.next.iter().copied().fold(0.0, f64::max);
        self.pending = true;
        if largest == 0.0 {
            self.next.copy_from_slice(self.start.as_slice());
            return;
        }
        self.next.iter_mut().for_each(|p| *p /= largest);
        let sum = kernels::sum(&self.next);
        self.next.iter_mut().for_each(|p| *p /= sum);
    }
}

/// Multiplies weights by likelihoods, relative to the largest of them.
fn condition(weights: &mut [f64], likelihoods: &[f64], largest: f64) {
    // The largest is 0 if all are: then so are the products.
    let largest = if largest > 0.0 { largest } else { 1.0 };
    weights.iter_mut().zip(likelihoods).for_each(|(p, q)| *p *= q / largest);
}

/// Checks that a belief has one value for each state of the operator.
fn check_states(
    part: &'static str,
    belief: &Belief,
    expected: usize,
) -> Result<(), TransitionError> {
    let found = belief.states();
    if found == expected {
        Ok(())
    } else {
        Err(TransitionError::PartStates { part, found, expected })
    }
}
