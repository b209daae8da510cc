//! Models with a matrix for each step.

use wayfix::{
    Belief, DenseTransition, Hmm, LikelihoodVector, OptionalLikelihood, Prior, Sequence,
    SparseTransition, SwitchedTransition, Transition,
};

use super::{Matrix, Own, dense, matrix, sparse};

/// Log-likelihoods as they are given, or nothing.
pub(crate) type Sensor = OptionalLikelihood<LikelihoodVector<Vec<f64>>>;

pub(crate) fn sensor(states: usize) -> Sensor {
    OptionalLikelihood::new(LikelihoodVector::log(states).owned())
}

/// These probabilities, in either convention.
pub(crate) fn prior(probabilities: &[f64], at_first: bool) -> Prior {
    let belief = Belief::new(probabilities.to_vec()).unwrap();
    if at_first { Prior::AtFirstObservation(belief) } else { Prior::BeforeFirstTransition(belief) }
}

/// A model with a matrix for each step.
#[derive(Debug, Clone)]
pub(crate) struct Model {
    pub(crate) states: usize,
    pub(crate) at_first: bool,
    pub(crate) prior: Vec<f64>,
    /// `matrices[k - 1][to][from]` drives k − 1 → k.
    pub(crate) matrices: Vec<Matrix>,
    /// ln `b_i` of each step, `None` where nothing is observed.
    pub(crate) logs: Vec<Option<Vec<f64>>>,
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
    pub(crate) fn steps(&self) -> usize {
        self.logs.len()
    }

    pub(crate) fn prior(&self) -> Prior {
        prior(&self.prior, self.at_first)
    }

    /// The model with this operator, that of [`sparse`](Self::sparse) say.
    pub(crate) fn hmm<A: Transition<Control = usize>>(&self, transition: A) -> Hmm<A, Sensor> {
        Hmm::new(self.prior(), transition, sensor(self.states)).unwrap()
    }

    /// The number of the operator of each step.
    pub(crate) fn controls(&self) -> Vec<usize> {
        (0..self.steps()).collect()
    }

    pub(crate) fn dense(&self) -> SwitchedTransition<DenseTransition> {
        self.switched(dense)
    }

    pub(crate) fn sparse(&self) -> SwitchedTransition<SparseTransition> {
        self.switched(sparse)
    }

    pub(crate) fn own(&self) -> SwitchedTransition<Own> {
        self.switched(|m| Own(m.clone()))
    }

    fn switched<A: Transition<Control = ()>>(
        &self,
        operator: impl Fn(&Matrix) -> A,
    ) -> SwitchedTransition<A> {
        // At T = 0 there is none, but a model needs one.
        let spare = [matrix(self.states, |i, j| f64::from(i == j))];
        let matrices = if self.matrices.is_empty() { &spare[..] } else { &self.matrices };
        SwitchedTransition::new(matrices.iter().map(operator).collect()).unwrap()
    }
}
