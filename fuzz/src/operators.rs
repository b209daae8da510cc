//! Operators of several kinds as one type, so that inference is compiled once; each call is
//! forwarded to the operator.

use wayfix::motion::{DistanceTransition, OdometryReading};
use wayfix::transition::{
    EvidenceTransition, KroneckerTransition, LearnTransition, MoveCounts, RestartTransition,
    Stored, SwitchedTransition, WindowTransition,
};
use wayfix::{DenseTransition, SparseTransition, Transition, TransitionEntries, TransitionError};
use wayfix_learn::GeneratorTransition;
use wayfix_recognition::motion::{RouteControl, RouteTransition};

use crate::model::Matrix;

/// Log-likelihoods of moves, `logs[to][from]`, and the factor that is taken out of them.
pub(crate) type Measurement = (Matrix, f64);
pub(crate) type Measured = EvidenceTransition<
    SparseTransition,
    Measurement,
    fn(&Measurement, usize, usize) -> f64,
    fn(&Measurement) -> f64,
>;

/// One of two chains side by side, each with a measurement.
pub(crate) type OneOfTwo = EvidenceTransition<
    SparseTransition,
    [Measurement; 2],
    fn(&[Measurement; 2], usize, usize) -> f64,
    fn(&[Measurement; 2]) -> f64,
>;

/// Operators without a control.
#[derive(Debug, Clone)]
pub(crate) enum Plain {
    Sparse(SparseTransition),
    Dense(DenseTransition),
    Restart(RestartTransition<SparseTransition>),
    Window(WindowTransition),
}

/// Operators with a control, which is the number of one from a list.
#[derive(Debug, Clone)]
pub(crate) enum Driven {
    Switched(SwitchedTransition<SparseTransition>, Vec<usize>),
    Route(RouteTransition, Vec<RouteControl>),
    Distance(DistanceTransition, Vec<Option<OdometryReading>>),
    Generator(GeneratorTransition, Vec<f64>),
    Measured(Measured, Vec<Measurement>),
    Restart(RestartTransition<Measured>, Vec<Measurement>),
    Pairs(KroneckerTransition<OneOfTwo, OneOfTwo>, Vec<[Measurement; 2]>),
}

/// Evaluates the same expression for each operator `a` under its control `u`.
macro_rules! plain {
    ($self:ident, $a:ident, $u:ident => $value:expr) => {{
        let $u = &();
        match $self {
            Plain::Sparse($a) => $value,
            Plain::Dense($a) => $value,
            Plain::Restart($a) => $value,
            Plain::Window($a) => $value,
        }
    }};
}

macro_rules! driven {
    ($self:ident, $control:expr, $a:ident, $u:ident => $value:expr) => {
        match $self {
            Driven::Switched($a, controls) => {
                let $u = &controls[*$control];
                $value
            }
            Driven::Route($a, controls) => {
                let $u = &controls[*$control];
                $value
            }
            Driven::Distance($a, controls) => {
                let $u = &controls[*$control];
                $value
            }
            Driven::Generator($a, controls) => {
                let $u = &controls[*$control];
                $value
            }
            Driven::Measured($a, controls) => {
                let $u = &controls[*$control];
                $value
            }
            Driven::Restart($a, controls) => {
                let $u = &controls[*$control];
                $value
            }
            Driven::Pairs($a, controls) => {
                let $u = &controls[*$control];
                $value
            }
        }
    };
}

impl Transition for Plain {
    type Control = ();

    fn states(&self) -> usize {
        plain!(self, a, _u => a.states())
    }

    fn apply(&self, (): &(), x: &[f64], out: &mut [f64]) {
        plain!(self, a, u => a.apply(u, x, out));
    }

    fn apply_transpose(&self, (): &(), x: &[f64], out: &mut [f64]) {
        plain!(self, a, u => a.apply_transpose(u, x, out));
    }

    fn apply_log(&self, (): &(), x: &[f64], out: &mut [f64]) {
        plain!(self, a, u => a.apply_log(u, x, out));
    }

    fn apply_transpose_log(&self, (): &(), x: &[f64], out: &mut [f64]) {
        plain!(self, a, u => a.apply_transpose_log(u, x, out));
    }

    fn stored(&self, (): &()) -> Option<Stored<'_>> {
        plain!(self, a, u => a.stored(u))
    }
}

impl TransitionEntries for Plain {
    fn incoming(&self, (): &(), to: usize) -> impl Iterator<Item = (usize, f64)> {
        plain!(self, a, u => a.incoming(u, to).collect::<Vec<_>>()).into_iter()
    }

    fn outgoing(&self, (): &(), from: usize) -> impl Iterator<Item = (usize, f64)> {
        plain!(self, a, u => a.outgoing(u, from).collect::<Vec<_>>()).into_iter()
    }

    fn incoming_log2(&self, (): &(), to: usize) -> impl Iterator<Item = (usize, f64)> {
        plain!(self, a, u => a.incoming_log2(u, to).collect::<Vec<_>>()).into_iter()
    }

    fn max_product(&self, (): &(), x: &[f64], out: &mut [f64], from: &mut [u32]) {
        plain!(self, a, u => a.max_product(u, x, out, from));
    }
}

/// Matrices are learned, others stay as they are.
impl LearnTransition for Plain {
    type Statistics = MoveCounts;

    fn statistics(&self) -> MoveCounts {
        MoveCounts::default()
    }

    fn merge(&self, counts: &mut MoveCounts, other: &MoveCounts) {
        counts.merge(other);
    }

    fn counts<'s>(&self, counts: &'s mut MoveCounts, (): &()) -> Option<&'s mut MoveCounts> {
        matches!(self, Self::Sparse(_) | Self::Dense(_)).then_some(counts)
    }

    fn maximize(&self, counts: &MoveCounts, pseudo_count: f64) -> Result<Self, TransitionError> {
        Ok(match self {
            Self::Sparse(a) => Self::Sparse(a.maximize(counts, pseudo_count)?),
            Self::Dense(a) => Self::Dense(a.maximize(counts, pseudo_count)?),
            other => other.clone(),
        })
    }

    fn log_prior(&self, pseudo_count: f64) -> f64 {
        match self {
            Self::Sparse(a) => a.log_prior(pseudo_count),
            Self::Dense(a) => a.log_prior(pseudo_count),
            _ => 0.0,
        }
    }

    fn free_parameters(&self) -> usize {
        match self {
            Self::Sparse(a) => a.free_parameters(),
            Self::Dense(a) => a.free_parameters(),
            _ => 0,
        }
    }
}

impl Transition for Driven {
    type Control = usize;

    fn states(&self) -> usize {
        match self {
            Self::Switched(a, _) => a.states(),
            Self::Route(a, _) => a.states(),
            Self::Distance(a, _) => a.states(),
            Self::Generator(a, _) => a.states(),
            Self::Measured(a, _) => a.states(),
            Self::Restart(a, _) => a.states(),
            Self::Pairs(a, _) => a.states(),
        }
    }

    fn apply(&self, control: &usize, x: &[f64], out: &mut [f64]) {
        driven!(self, control, a, u => a.apply(u, x, out));
    }

    fn apply_transpose(&self, control: &usize, x: &[f64], out: &mut [f64]) {
        driven!(self, control, a, u => a.apply_transpose(u, x, out));
    }

    fn apply_log(&self, control: &usize, x: &[f64], out: &mut [f64]) {
        driven!(self, control, a, u => a.apply_log(u, x, out));
    }

    fn apply_transpose_log(&self, control: &usize, x: &[f64], out: &mut [f64]) {
        driven!(self, control, a, u => a.apply_transpose_log(u, x, out));
    }

    fn evidence(&self, control: &usize) -> Option<f64> {
        driven!(self, control, a, u => a.evidence(u))
    }

    fn needs_logs(&self, control: &usize) -> bool {
        driven!(self, control, a, u => a.needs_logs(u))
    }

    fn stored(&self, control: &usize) -> Option<Stored<'_>> {
        driven!(self, control, a, u => a.stored(u))
    }

    fn check_control(&self, control: &usize) -> Result<(), TransitionError> {
        let count = match self {
            Self::Switched(_, controls) => controls.len(),
            Self::Route(_, controls) => controls.len(),
            Self::Distance(_, controls) => controls.len(),
            Self::Generator(_, controls) => controls.len(),
            Self::Measured(_, controls) | Self::Restart(_, controls) => controls.len(),
            Self::Pairs(_, controls) => controls.len(),
        };
        if *control >= count {
            return Err(TransitionError::Control(format!("{control} of {count}")));
        }
        driven!(self, control, a, u => a.check_control(u))
    }
}

impl TransitionEntries for Driven {
    fn incoming(&self, control: &usize, to: usize) -> impl Iterator<Item = (usize, f64)> {
        driven!(self, control, a, u => a.incoming(u, to).collect::<Vec<_>>()).into_iter()
    }

    fn outgoing(&self, control: &usize, from: usize) -> impl Iterator<Item = (usize, f64)> {
        driven!(self, control, a, u => a.outgoing(u, from).collect::<Vec<_>>()).into_iter()
    }

    fn incoming_log2(&self, control: &usize, to: usize) -> impl Iterator<Item = (usize, f64)> {
        driven!(self, control, a, u => a.incoming_log2(u, to).collect::<Vec<_>>()).into_iter()
    }

    fn outgoing_log2(&self, control: &usize, from: usize) -> impl Iterator<Item = (usize, f64)> {
        driven!(self, control, a, u => a.outgoing_log2(u, from).collect::<Vec<_>>()).into_iter()
    }

    fn entries_need_logs(&self, control: &usize) -> bool {
        driven!(self, control, a, u => a.entries_need_logs(u))
    }

    fn max_product(&self, control: &usize, x: &[f64], out: &mut [f64], from: &mut [u32]) {
        driven!(self, control, a, u => a.max_product(u, x, out, from));
    }
}
