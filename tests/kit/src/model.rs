//! Models with a matrix for each step.

use std::sync::Arc;

use wayfix::transition::{EvidenceTransition, SwitchedTransition};
use wayfix::{
    Belief, DenseTransition, Hmm, LikelihoodVector, OptionalLikelihood, Prior, Sequence,
    SparseTransition, Transition,
};

use super::{Matrix, Own, OwnMeasured, dense, matrix, sparse};

/// An operator with a likelihood of moves.
pub type Measured<F, G> = EvidenceTransition<SparseTransition, (), F, G>;

/// ln p(u | to, from) of a step with a measured u.
pub trait Moves: Fn(&(), usize, usize) -> f64 + Clone + Send + Sync {}
impl<F: Fn(&(), usize, usize) -> f64 + Clone + Send + Sync> Moves for F {}

/// The log factor of such a step.
pub trait Factor: Fn(&()) -> f64 + Clone + Send + Sync {}
impl<G: Fn(&()) -> f64 + Clone + Send + Sync> Factor for G {}

/// Log-likelihoods as given, or a missing observation.
pub type Sensor = OptionalLikelihood<LikelihoodVector<Vec<f64>>>;

pub fn sensor(states: usize) -> Sensor {
    OptionalLikelihood::new(LikelihoodVector::log(states).owned())
}

/// A prior with these probabilities, in either convention.
pub fn prior(probabilities: &[f64], at_first: bool) -> Prior {
    let belief = Belief::new(probabilities.to_vec()).unwrap();
    if at_first { Prior::AtFirstObservation(belief) } else { Prior::BeforeFirstTransition(belief) }
}

/// Evidence on the move to a step.
#[derive(Debug, Clone)]
pub struct Evidence {
    /// `logs[to][from]` is ln p(u | to, from).
    pub logs: Matrix,
    /// The log factor that an operator takes out of them.
    pub log_factor: f64,
}

/// A model with a matrix for each step.
#[derive(Debug, Clone)]
pub struct Model {
    pub states: usize,
    pub at_first: bool,
    pub prior: Vec<f64>,
    /// `matrices[k - 1][to][from]` drives k − 1 → k.
    pub matrices: Vec<Matrix>,
    /// The evidence on the move to each step; empty without evidence.
    pub evidence: Vec<Evidence>,
    /// ln `b_i` of each step; `None` for a missing observation.
    pub logs: Vec<Option<Vec<f64>>>,
}

impl Sequence<usize, Option<Vec<f64>>> for Model {
    fn steps(&self) -> usize {
        self.logs.len()
    }
    fn control(&self, step: usize) -> &usize {
        &[0, 1, 2, 3, 4, 5][step - 1]
    }
    fn observation(&self, step: usize) -> &Option<Vec<f64>> {
        &self.logs[step - 1]
    }
}

impl Model {
    pub fn steps(&self) -> usize {
        self.logs.len()
    }

    pub fn prior(&self) -> Prior {
        prior(&self.prior, self.at_first)
    }

    /// The model with this operator, such as that of [`sparse`](Self::sparse).
    pub fn hmm<A: Transition<Control = usize>>(&self, transition: A) -> Hmm<A, Sensor> {
        Hmm::new(self.prior(), transition, sensor(self.states)).unwrap()
    }

    /// The number of the operator of each step.
    pub fn controls(&self) -> Vec<usize> {
        (0..self.steps()).collect()
    }

    pub fn dense(&self) -> SwitchedTransition<DenseTransition> {
        self.switched(dense)
    }

    pub fn sparse(&self) -> SwitchedTransition<SparseTransition> {
        self.switched(sparse)
    }

    pub fn own(&self) -> SwitchedTransition<Own> {
        self.switched(|m| Own(m.clone()))
    }

    /// With evidence on moves, each step's operator by its definition.
    pub fn measured(&self) -> SwitchedTransition<Measured<impl Moves, impl Factor>> {
        let spare = (matrix(self.states, |i, j| f64::from(i == j)), self.nothing_measured());
        let steps = self.matrices.iter().zip(&self.evidence);
        let steps = steps.chain(self.matrices.is_empty().then_some((&spare.0, &spare.1)));
        let operator = |(m, evidence): (&Matrix, &Evidence)| {
            let (logs, log_factor) = (Arc::new(evidence.logs.clone()), evidence.log_factor);
            let log = move |(): &(), to: usize, from: usize| logs[to][from];
            EvidenceTransition::new(sparse(m), log)
                .unwrap()
                .with_log_factor(move |(): &()| log_factor)
        };
        SwitchedTransition::new(steps.map(operator).collect()).unwrap()
    }

    /// The model with entries as numbers, and an operator with only the required methods.
    pub fn own_measured(&self) -> SwitchedTransition<OwnMeasured> {
        let spare = (matrix(self.states, |i, j| f64::from(i == j)), self.nothing_measured());
        let steps = self.matrices.iter().zip(&self.evidence);
        let steps = steps.chain(self.matrices.is_empty().then_some((&spare.0, &spare.1)));
        let operator = |(m, Evidence { logs, log_factor }): (&Matrix, &Evidence)| {
            let entry = |i: usize, j: usize| m[i][j] * (logs[i][j] - log_factor).exp();
            OwnMeasured { entries: Own(matrix(self.states, entry)), log_factor: *log_factor }
        };
        SwitchedTransition::new(steps.map(operator).collect()).unwrap()
    }

    fn nothing_measured(&self) -> Evidence {
        Evidence { logs: matrix(self.states, |_, _| 0.0), log_factor: 0.0 }
    }

    fn switched<A: Transition<Control = ()>>(
        &self,
        operator: impl Fn(&Matrix) -> A,
    ) -> SwitchedTransition<A> {
        // At T = 0 the list of matrices is empty, but a model needs one.
        let spare = [matrix(self.states, |i, j| f64::from(i == j))];
        let matrices = if self.matrices.is_empty() { &spare[..] } else { &self.matrices };
        SwitchedTransition::new(matrices.iter().map(operator).collect()).unwrap()
    }
}
