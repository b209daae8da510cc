//! All checks of an operator, in one call.

mod erased;
mod inputs;
mod methods;
mod routines;

use std::fmt::Debug;

use proptest::prelude::*;
use proptest::test_runner::TestCaseResult;
use wayfix::{DenseTransition, Hmm, LikelihoodVector, SparseTransition, TransitionEntries};

use self::erased::{AtStep, EachStep, Steps, WithControls};
use self::inputs::Inputs;
use super::{Matrix, Own, OwnMeasured, close_logs, dense, prior};

/// Matrices that an operator must equal, with tolerances.
#[derive(Debug, Clone)]
pub struct Expected<C> {
    controls: Vec<C>,
    /// One for each control, with columns that sum to one, except with evidence.
    matrices: Vec<Matrix>,
    /// The log factor of the evidence on moves of each, if any.
    evidence: Vec<Option<f64>>,
    /// True without a control: all matrices are the same.
    constant: bool,
    rounding: Rounding,
}

/// Tolerances relative to the dense matrix.
#[derive(Debug, Clone, Copy)]
struct Rounding {
    /// True if ties must be resolved: the lowest of equal predecessors, and of equal paths the same
    /// one as with dense matrices.
    exact: bool,
    /// Relative tolerance of products and entries.
    entries: f64,
    /// Positive sums of at most this size are not compared.
    least: f64,
}

impl Expected<()> {
    /// The same matrix at each step.
    pub fn constant(matrix: &Matrix) -> Self {
        let expected = Self::each(&[(); 3], &vec![matrix.clone(); 3]);
        Self { constant: true, ..expected }
    }
}

impl<C: Clone> Expected<C> {
    /// A matrix for each control; they drive a model one after another.
    pub fn each(controls: &[C], matrices: &[Matrix]) -> Self {
        assert_eq!(controls.len(), matrices.len());
        let rounding = Rounding { exact: false, entries: 1e-12, least: 0.0 };
        let (controls, matrices) = (controls.to_vec(), matrices.to_vec());
        let evidence = vec![None; matrices.len()];
        Self { controls, matrices, evidence, constant: false, rounding }
    }
}

impl<C> Expected<C> {
    /// The controls are evidence on moves, with these log factors taken out; `None` for controls
    /// without evidence.
    pub fn with_evidence(self, log_factors: &[Option<f64>]) -> Self {
        assert_eq!(log_factors.len(), self.matrices.len());
        Self { evidence: log_factors.to_vec(), ..self }
    }

    /// Logarithms of the entries are exact, so that ties are exact: the lowest of equal
    /// predecessors must be named.
    pub fn with_exact_ties(mut self, exact: bool) -> Self {
        self.rounding.exact = exact;
        self
    }

    /// Entries may have this relative error, and sums up to `least` a larger one.
    pub fn within(mut self, entries: f64, least: f64) -> Self {
        (self.rounding.entries, self.rounding.least) = (entries, least);
        self
    }
}

impl From<&Matrix> for Expected<()> {
    fn from(matrix: &Matrix) -> Self {
        Self::constant(matrix)
    }
}

/// Checks all methods of an operator, and all routines of models with it, against its dense matrix.
///
/// The methods are both products at scales from 2^-800 to 2^1000 and in logarithms,
/// column sums, the entries of each row and column, and the step of Viterbi, against
/// the matrix and against the listed entries to the bit. The routines are the
/// smoother, the score, both streams, both decoders, the entropy and the expected
/// moves, on likelihoods of usual and of huge ranges, some of them 0. Inputs are
/// drawn anew for each matrix.
///
/// A new operator needs its matrix, written from its definition, and one call:
///
/// ```ignore
/// proptest! {
///     #![proptest_config(cases())]
///
///     #[test]
///     fn mine((exact, m) in any::<bool>().prop_flat_map(|e| (Just(e), any_stochastic(e, 5)))) {
///         let a = MyTransition::new(sparse(&m), 0.5).unwrap();
///         let expected = matrix(m.len(), |to, from| 0.5 * m[to][from] + ...);
///         assert_operator(a, Expected::constant(&expected).with_exact_ties(exact))?;
///     }
/// }
/// ```
///
/// Without exact ties the matrix suffices, `assert_operator(a, &expected)`; with controls it is
/// `Expected::each(&controls, &matrices)`.
pub fn assert_operator<A>(operator: A, expected: impl Into<Expected<A::Control>>) -> TestCaseResult
where
    A: TransitionEntries<Control: Debug>,
{
    let Expected { controls, matrices, evidence, constant, rounding } = expected.into();
    let n = matrices[0].len();
    // A model checks the columns of an operator without a control.
    let start = prior(&vec![1.0 / n as f64; n], false);
    prop_assert!(Hmm::new(start, &operator, LikelihoodVector::log(n)).is_ok());
    assert_steps(&WithControls { operator, controls }, (&matrices, &evidence), constant, rounding)
}

/// The rest of [`assert_operator`], compiled once for all operators.
fn assert_steps(
    operator: &dyn Steps,
    (matrices, evidence): (&[Matrix], &[Option<f64>]),
    constant: bool,
    rounding: Rounding,
) -> TestCaseResult {
    prop_assert_eq!(operator.states(), matrices[0].len());
    for (step, m) in matrices.iter().enumerate().take(if constant { 1 } else { usize::MAX }) {
        let inputs = Inputs::of(m);
        let at_step = AtStep { operator, step };
        methods::check(operator, step, m, &inputs, rounding)?;
        let log_factor = operator.evidence(step);
        prop_assert_eq!(log_factor.is_some(), evidence[step].is_some());
        if let (Some(found), Some(expected)) = (log_factor, evidence[step]) {
            close_logs(found, expected, rounding.entries)?;
            continue;
        }
        let stored = SparseTransition::from_operator(&at_step).unwrap();
        let stored = WithControls { operator: stored, controls: vec![()] };
        methods::check(&stored, 0, m, &inputs, rounding)?;
    }
    let seen: Vec<Inputs> = (1..).zip(matrices).map(|(k, m)| Inputs::nth(k, m)).collect();
    if !constant && evidence.iter().any(Option::is_some) {
        let numbers: Vec<usize> = (0..matrices.len()).collect();
        let own = matrices.iter().zip(evidence).map(|(m, log_factor)| OwnMeasured {
            entries: Own(m.clone()),
            log_factor: log_factor.unwrap_or(0.0),
        });
        let family = wayfix::transition::SwitchedTransition::new(own.collect()).unwrap();
        let each = EachStep(operator);
        return routines::check((&each, &numbers), (&family, &numbers), matrices, &seen, rounding);
    }
    let dense: Vec<DenseTransition> = matrices.iter().map(dense).collect();
    if constant {
        let at_step = AtStep { operator, step: 0 };
        let controls = vec![(); matrices.len()];
        routines::check((&at_step, &controls), (&dense[0], &controls), matrices, &seen, rounding)
    } else {
        let numbers: Vec<usize> = (0..matrices.len()).collect();
        let family = wayfix::transition::SwitchedTransition::new(dense).unwrap();
        let each = EachStep(operator);
        routines::check((&each, &numbers), (&family, &numbers), matrices, &seen, rounding)
    }
}
