//! Hard evidence: the state is known.

use rand::Rng;

use super::{Diagonal, Likelihood, LocalLikelihood, SampleObservation, Scratch, Unlisted};
use crate::error::LikelihoodError;

/// A sensor that says which state it is, without error, or nothing: the
/// observation is an `Option<usize>`. For a fuel stop, a toll gate, a label.
///
/// Fused with a real sensor it constrains filter, smoother and decoder:
///
/// ```
/// use wayfix::{Belief, FusedLikelihood, Hmm, KnownState, Prior, SparseTransition, TableLikelihood};
///
/// // Around three places, staying or going one on.
/// let motion = SparseTransition::from_rows(&[[0.5, 0.0, 0.5], [0.5, 0.5, 0.0], [0.0, 0.5, 0.5]])?;
/// let camera = TableLikelihood::from_rows(&[[0.8, 0.1, 0.1], [0.1, 0.8, 0.1], [0.1, 0.1, 0.8]])?;
/// let sensor = FusedLikelihood::new(camera, KnownState::new(3))?;
/// let hmm = Hmm::new(Prior::AtFirstObservation(Belief::certain(3, 0)?), motion, sensor)?;
///
/// let seen = [(0, None), (0, None), (1, None)];
/// assert_eq!(hmm.viterbi(&seen)?.states(), [0, 0, 1]);
/// let toll_gate = [(0, None), (0, None), (1, Some(2))];
/// assert_eq!(hmm.viterbi(&toll_gate)?.states(), [0, 1, 2]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct KnownState {
    pub(crate) states: usize,
}

impl KnownState {
    /// For a model of `states` states.
    #[must_use]
    pub fn new(states: usize) -> Self {
        Self { states }
    }
}

impl Likelihood for KnownState {
    type Observation = Option<usize>;

    fn states(&self) -> usize {
        self.states
    }

    /// # Errors
    ///
    /// [`LikelihoodError::State`] if there is no such state.
    fn diagonal<'a>(
        &'a self,
        &known: &'a Option<usize>,
        scratch: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        let states = self.states;
        let values = scratch.values(states);
        values.fill(if known.is_none() { 1.0 } else { 0.0 });
        if let Some(state) = known {
            let value = values.get_mut(state);
            *value.ok_or(LikelihoodError::State { state, states })? = 1.0;
        }
        Ok(Diagonal::checked(values, 1.0, None))
    }
}

impl LocalLikelihood for KnownState {
    /// # Errors
    ///
    /// [`LikelihoodError::State`] if there is no such state.
    fn local(
        &self,
        &known: &Option<usize>,
        states: &[usize],
        out: &mut [f64],
        _: &mut Scratch,
    ) -> Result<Unlisted, LikelihoodError> {
        let Some(known) = known else {
            out.fill(1.0);
            return Ok(Unlisted::at_most(1.0));
        };
        if known >= self.states {
            return Err(LikelihoodError::State { state: known, states: self.states });
        }
        out.fill(0.0);
        let listed = states.binary_search(&known).map(|at| out[at] = 1.0).is_ok();
        Ok(Unlisted::at_most(if listed { 0.0 } else { 1.0 }))
    }

    fn standing_out(&self, &known: &Option<usize>, states: &mut Vec<usize>) {
        states.extend(known.filter(|&state| state < self.states));
    }
}

impl SampleObservation for KnownState {
    /// Draws `None`: how often a state becomes known is no part of the model.
    fn sample<R: Rng + ?Sized>(&self, _: usize, _: &mut R) -> Option<usize> {
        None
    }
}
