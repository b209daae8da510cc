//! Transition operators: the trait of their two products, its implementations by the stored matrices, and
//! [`Stored`], by which inference recognises these and fuses the product with its other loops.

use std::any::Any;

use super::{DenseTransition, SparseTransition, TransitionEntries, buffers, check_slices, log};
use crate::error::TransitionError;
use wayfix_kernels::{Lines, Panels};

/// A transition operator A, whose columns sum to one:
/// A\[i, j\] = p(`X_k` = i | `X_{k-1}` = j), as in the paper's eq. 6.
///
/// Filter and smoother need only two products, so an operator does not have to store a matrix.
/// Algorithms that need single entries (Viterbi, simulation, learning) require
/// [`TransitionEntries`](super::TransitionEntries).
///
/// An operator may depend on a **control**, the input of the step from k − 1 to k, such as
/// odometry, elapsed time or a gear. An operator without one has `Control = ()`: it is the same at
/// every step. Its columns and transpose are then checked when a model is built from it, and
/// inference has faster routines for it.
///
/// A control may also be **evidence on the move**, a measurement between two steps, such as
/// odometry or a compass. It does not choose an operator; its likelihood p(u | `X_{k-1}`, `X_k`)
/// multiplies the entries of A, whose columns then do not sum to one.
/// [`evidence`](Self::evidence) declares it, and
/// [`EvidenceTransition`](crate::transition::EvidenceTransition) adds a likelihood of moves to
/// any operator.
///
/// Entries below 2.2e-308 (subnormal doubles) have lost precision, and states reached only through
/// them may be lost.
///
/// A reference, `Box`, `Rc` or `Arc` of an operator is also an operator, so models can share a
/// large one. So is a trait object such as `Box<dyn Transition<Control = ()>>`, for operators
/// chosen at run time.
///
/// # Implement it yourself
///
/// A drive around a loop: one place forward with probability 0.9, else stay.
///
/// ```
/// use wayfix::{Belief, Hmm, LikelihoodVector, Prior, Transition};
///
/// struct Around(usize);
///
/// impl Transition for Around {
///     type Control = ();
///     fn states(&self) -> usize {
///         self.0
///     }
///     fn apply(&self, _: &(), x: &[f64], out: &mut [f64]) {
///         (0..self.0).for_each(|i| out[i] = 0.1 * x[i] + 0.9 * x[(i + self.0 - 1) % self.0]);
///     }
///     fn apply_transpose(&self, _: &(), x: &[f64], out: &mut [f64]) {
///         (0..self.0).for_each(|j| out[j] = 0.1 * x[j] + 0.9 * x[(j + 1) % self.0]);
///     }
/// }
///
/// let prior = Prior::BeforeFirstTransition(Belief::certain(4, 0)?);
/// let hmm = Hmm::new(prior, Around(4), LikelihoodVector::linear(4))?;
/// let mut filter = hmm.filter();
/// filter.predict()?;
/// assert_eq!(filter.belief().as_slice(), [0.1, 0.9, 0.0, 0.0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// [`kit`](crate::transition::kit) lends memory for intermediate results, and checks that the methods
/// of an operator agree.
///
/// An operator with a control, the metres driven since the last observation, on a line of n places
/// 100 m apart. The vehicle stops at the end:
///
/// ```
/// use wayfix::{Transition, TransitionError};
///
/// struct Line(usize);
///
/// impl Line {
///     /// The places on either side of the new position.
///     fn reached(&self, from: usize, metres: f64) -> [(usize, f64); 2] {
///         let at = (from as f64 + metres / 100.0).min(self.0 as f64 - 1.0);
///         let share = at.fract();
///         [(at as usize, 1.0 - share), ((at as usize + 1).min(self.0 - 1), share)]
///     }
/// }
///
/// impl Transition for Line {
///     type Control = f64;
///     fn states(&self) -> usize {
///         self.0
///     }
///     fn apply(&self, &metres: &f64, x: &[f64], out: &mut [f64]) {
///         out.fill(0.0);
///         for (j, x) in x.iter().enumerate() {
///             self.reached(j, metres).iter().for_each(|(i, p)| out[*i] += p * x);
///         }
///     }
///     fn apply_transpose(&self, &metres: &f64, x: &[f64], out: &mut [f64]) {
///         for (j, out) in out.iter_mut().enumerate() {
///             *out = self.reached(j, metres).iter().map(|(i, p)| p * x[*i]).sum();
///         }
///     }
///     fn check_control(&self, &metres: &f64) -> Result<(), TransitionError> {
///         let valid = metres >= 0.0 && metres.is_finite();
///         if valid { Ok(()) } else { Err(TransitionError::Control(format!("{metres} m driven"))) }
///     }
/// }
/// # use wayfix::{Belief, Hmm, LikelihoodVector, Prior};
/// # let prior = Prior::BeforeFirstTransition(Belief::certain(4, 0)?);
/// # let hmm = Hmm::new(prior, Line(4), LikelihoodVector::linear(4))?;
/// let mut filter = hmm.filter();
/// filter.predict_with(&150.0)?;
/// assert_eq!(filter.belief().as_slice(), [0.0, 0.5, 0.5, 0.0]);
/// assert!(filter.predict_with(&f64::NAN).is_err());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub trait Transition {
    /// Input of a step, on which the operator depends. With `()` the operator must be the same at
    /// every step.
    type Control: 'static;

    /// Number of states, n.
    fn states(&self) -> usize;

    /// Computes `out = A x`, the distribution one step later. Overwrites all of `out`.
    ///
    /// Must be linear in `x`, for non-negative `x` of any scale. Inference calls it with two slices
    /// of n values, after [`check_control`](Self::check_control) has accepted the control; the
    /// operators of this crate panic on slices of another length.
    fn apply(&self, control: &Self::Control, x: &[f64], out: &mut [f64]);

    /// Computes `out = A' x` with the transpose (paper eq. 12). Overwrites all of `out`, under
    /// the same conditions as [`apply`](Self::apply).
    fn apply_transpose(&self, control: &Self::Control, x: &[f64], out: &mut [f64]);

    /// Computes `A x` in logarithms: `out[i]` = ln Σ over j of A\[i, j\] exp(`x[j]`), for `x` of
    /// any range, with −∞ for 0.
    ///
    /// Used where a belief is out of the range of doubles. The default calls
    /// [`apply`](Self::apply) once for every 600 nats of range, and allocates.
    fn apply_log(&self, control: &Self::Control, x: &[f64], out: &mut [f64]) {
        log::by_bands(x, out, |x, out| self.apply(control, x, out));
    }

    /// Computes `A' x` in logarithms, as [`apply_log`](Self::apply_log).
    fn apply_transpose_log(&self, control: &Self::Control, x: &[f64], out: &mut [f64]) {
        log::by_bands(x, out, |x, out| self.apply_transpose(control, x, out));
    }

    /// Declares that a control is evidence on the move.
    ///
    /// `None`, the default, if the control only chooses the operator; its columns are then
    /// distributions, and are checked. `Some(log_factor)` if the control is a measurement u; the
    /// entries of this step are then
    ///
    /// ```text
    /// A[i, j] p(u | X_{k-1} = j, X_k = i) exp(−log_factor)
    /// ```
    /// They are finite and at least 0, and their columns may have any sum, including 0. Inference
    /// normalises the belief, not the columns: the sum of a prediction is p(u | y_1 … y_{k-1}),
    /// whose logarithm, plus `log_factor`, is added to the log-likelihood.
    ///
    /// All methods use these entries, including those of
    /// [`TransitionEntries`](super::TransitionEntries). The factor should bring the largest entry
    /// near to 1: a step whose sum is above 2^7 or below 2^-100 is taken in logarithms, which is
    /// slower. This method is called with a control that [`check_control`](Self::check_control)
    /// has accepted, more than once a step, and should be cheap.
    fn evidence(&self, control: &Self::Control) -> Option<f64> {
        let _ = control;
        None
    }

    /// True if entries of a step with [evidence](Self::evidence) are out of the range of doubles:
    /// above 0 but below 2.2e-308, or above 1.7e308.
    ///
    /// Inference then takes the step in logarithms, and reads entries only by
    /// [`incoming_log2`](super::TransitionEntries::incoming_log2) and
    /// [`outgoing_log2`](super::TransitionEntries::outgoing_log2). With false, the default, entries
    /// below this range may be lost. That is at most 1e-277 of a prediction, since a prediction in
    /// doubles sums to at least 2^-100. Called a few times a step.
    fn needs_logs(&self, control: &Self::Control) -> bool {
        let _ = control;
        false
    }

    /// Computes [`apply`](Self::apply) block by block, and calls `take(first_state, values)` for
    /// each block while it is in the first-level cache. Each state is in one block.
    ///
    /// By default there is one block. A filter calls it instead of `apply` where
    /// [`smallest_entry`](Self::smallest_entry) is large enough.
    fn apply_in_blocks(
        &self,
        control: &Self::Control,
        x: &[f64],
        take: &mut dyn FnMut(usize, &[f64]),
    ) {
        buffers::with(self.states(), |out| {
            self.apply(control, x, out);
            take(0, out);
        });
    }

    /// Lower bound on the entries above 0 of a step, and on every intermediate factor within a
    /// product; 0, the default, if none is known.
    ///
    /// If it is at least 2^-100, products with beliefs keep full precision, so that a filter need
    /// not scale them: operators that also implement [`apply_in_blocks`](Self::apply_in_blocks)
    /// then take half the time. Called once a step.
    fn smallest_entry(&self, control: &Self::Control) -> f64 {
        let _ = control;
        0.0
    }

    /// Returns the matrix of a step if it is stored in a type of this crate, so that inference
    /// can fuse the product with its other loops.
    ///
    /// By default `None`. A wrapper may return the matrix of its inner operator if it equals its
    /// own. Ignored for steps with [evidence](Self::evidence).
    fn stored(&self, control: &Self::Control) -> Option<Stored<'_>> {
        let _ = control;
        None
    }

    /// True if some moves are [restarts](super::RestartTransition), which lead anywhere whatever
    /// state was left. False by default; a wrapper returns that of its inner operator.
    ///
    /// Evidence on moves says nothing of a restart, and there are n² of them. So
    /// [`EvidenceTransition`](super::EvidenceTransition) refuses such an operator.
    fn has_restarts(&self) -> bool {
        false
    }

    /// Checks that the operator accepts a control. The default accepts every control.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Control`] with the reason.
    fn check_control(&self, control: &Self::Control) -> Result<(), TransitionError> {
        let _ = control;
        Ok(())
    }
}

/// The type `()` as a trait, so that compiler errors name the method that takes a control.
#[diagnostic::on_unimplemented(
    message = "this model takes a control of type `{Self}` at each step",
    label = "call the method whose name ends in `_with`, which takes the control",
    note = "`step_with(&control, &observation)`, `predict_with(&control)`, `forecast_with(&controls)`"
)]
pub trait NoControl: Copy {
    /// The only value.
    const NONE: Self;
}

impl NoControl for () {
    const NONE: Self = ();
}

/// The only control of an operator that is the same at every step, by its type; `None` if the
/// operator depends on a control.
pub(crate) fn constant_control<A: Transition + ?Sized>() -> Option<&'static A::Control> {
    (&() as &'static dyn Any).downcast_ref()
}

/// A stored matrix that this crate has specialised loops for.
///
/// Returned by [`Transition::stored`](super::Transition::stored).
#[derive(Debug, Clone, Copy)]
pub struct Stored<'a>(Form<'a>);

/// Storage format.
#[derive(Debug, Clone, Copy)]
enum Form<'a> {
    Sparse(&'a SparseTransition),
    Dense(&'a DenseTransition),
}

impl<'a> Stored<'a> {
    pub(crate) fn sparse(matrix: &'a SparseTransition) -> Self {
        Self(Form::Sparse(matrix))
    }

    pub(crate) fn dense(matrix: &'a DenseTransition) -> Self {
        Self(Form::Dense(matrix))
    }

    /// A column of the matrix.
    pub(crate) fn column(self, from: usize) -> Vec<f64> {
        fn dense(states: usize, column: impl Iterator<Item = (usize, f64)>) -> Vec<f64> {
            let mut values = vec![0.0; states];
            column.for_each(|(to, p)| values[to] = p);
            values
        }
        match self.0 {
            Form::Sparse(matrix) => dense(matrix.states(), matrix.outgoing(&(), from)),
            Form::Dense(matrix) => dense(matrix.states(), matrix.outgoing(&(), from)),
        }
    }

    /// The matrix, if it is sparse.
    pub(crate) fn as_sparse(self) -> Option<&'a SparseTransition> {
        match self.0 {
            Form::Sparse(matrix) => Some(matrix),
            Form::Dense(_) => None,
        }
    }

    /// True if all values above 0 are at least 2^-100.
    pub(crate) fn has_no_tiny_entries(self) -> bool {
        match self.0 {
            Form::Sparse(matrix) => matrix.no_tiny_entries,
            Form::Dense(matrix) => matrix.no_tiny_entries,
        }
    }

    /// Rows and columns.
    pub(crate) fn lines(self) -> (Lines<'a>, Lines<'a>) {
        match self.0 {
            Form::Sparse(matrix) => matrix.lines(),
            Form::Dense(matrix) => matrix.lines(),
        }
    }
}

impl Transition for SparseTransition {
    type Control = ();

    fn states(&self) -> usize {
        self.rows.lines()
    }

    fn apply(&self, (): &(), x: &[f64], out: &mut [f64]) {
        self.sliced_rows.multiply(x, out);
    }

    fn apply_transpose(&self, (): &(), x: &[f64], out: &mut [f64]) {
        self.sliced_columns.multiply(x, out);
    }

    fn stored(&self, (): &()) -> Option<Stored<'_>> {
        Some(Stored::sparse(self))
    }

    // Row by row, not by bands: rows are short, and one band costs as much as all of their sums
    // (see "The product in logarithms" in the formulas).

    fn apply_log(&self, (): &(), x: &[f64], out: &mut [f64]) {
        for (i, out) in out.iter_mut().enumerate() {
            *out = log::sum(self.rows.line(i), x);
        }
    }

    fn apply_transpose_log(&self, (): &(), x: &[f64], out: &mut [f64]) {
        for (j, out) in out.iter_mut().enumerate() {
            *out = log::sum(self.columns.line(j), x);
        }
    }
}

impl TransitionEntries for SparseTransition {
    fn incoming(&self, (): &(), to: usize) -> impl Iterator<Item = (usize, f64)> {
        self.rows.line(to)
    }

    fn outgoing(&self, (): &(), from: usize) -> impl Iterator<Item = (usize, f64)> {
        self.columns.line(from)
    }

    fn max_product(&self, (): &(), x: &[f64], out: &mut [f64], from: &mut [u32]) {
        // Without likelihoods: the caller adds its own.
        self.maximize(x, None, out, from);
    }
}

impl Transition for DenseTransition {
    type Control = ();

    fn states(&self) -> usize {
        self.matrix.states()
    }

    fn apply(&self, (): &(), x: &[f64], out: &mut [f64]) {
        check_slices(self.states(), x, out);
        self.matrix.multiply(x, out);
    }

    fn apply_transpose(&self, (): &(), x: &[f64], out: &mut [f64]) {
        check_slices(self.states(), x, out);
        self.matrix.multiply_transpose(x, out);
    }

    fn stored(&self, (): &()) -> Option<Stored<'_>> {
        Some(Stored::dense(self))
    }

    fn apply_log(&self, (): &(), x: &[f64], out: &mut [f64]) {
        check_slices(self.states(), x, out);
        log::by_lines(x, out, |x, out| self.matrix.multiply(x, out), |i| self.row(i));
    }

    fn apply_transpose_log(&self, (): &(), x: &[f64], out: &mut [f64]) {
        check_slices(self.states(), x, out);
        let product = |x: &[f64], out: &mut [f64]| self.matrix.multiply_transpose(x, out);
        log::by_lines(x, out, product, |j| self.column(j));
    }
}

impl TransitionEntries for DenseTransition {
    fn incoming(&self, (): &(), to: usize) -> impl Iterator<Item = (usize, f64)> {
        self.row(to)
    }

    fn outgoing(&self, (): &(), from: usize) -> impl Iterator<Item = (usize, f64)> {
        self.column(from)
    }

    fn max_product(&self, (): &(), x: &[f64], out: &mut [f64], from: &mut [u32]) {
        check_slices(self.states(), x, out);
        // Logarithms are taken once, by the first decoding, and cost as much memory as the matrix.
        let entry = |i, j| self.matrix.column(j)[i];
        self.log2.get_or_init(|| Panels::log2(self.states(), entry)).maximize(x, out, from);
    }
}
