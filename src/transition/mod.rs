//! Transition operators: linear maps on distributions, with columns that sum
//! to one (paper eq. 6).

pub(crate) mod buffers;
mod compressed;
mod dense;
mod distance;
mod dwell;
mod evidence;
mod kronecker;
mod log;
mod odometry;
mod off_map;
mod power;
mod reestimate;
mod restart;
mod shared;
mod single;
mod sparse;
mod stored;
mod switched;
mod tied;
mod weights;
mod window;

pub(crate) use compressed::Compressed;
pub use dense::DenseTransition;
pub use distance::DistanceTransition;
pub use dwell::DwellTransition;
pub use evidence::EvidenceTransition;
pub use kronecker::KroneckerTransition;
pub use odometry::Odometry;
pub use off_map::OffMapTransition;
pub use power::PowerTransition;
pub use restart::RestartTransition;
pub use sparse::SparseTransition;
pub use stored::Stored;
pub use switched::SwitchedTransition;
pub use tied::TiedTransition;
pub use window::{Ends, WindowTransition};

use std::any::Any;

use crate::belief::{Belief, SUM_TOLERANCE};
use crate::error::TransitionError;
use crate::kernels::{self, log2};

/// A transition operator A, whose columns sum to one:
/// A\[i, j\] = p(`X_k` = i | `X_{k-1}` = j), as in the paper's eq. 6.
///
/// Two products are all that filter and smoother need, so an operator does not
/// have to store a matrix. What also needs single entries (Viterbi,
/// simulation) asks for [`TransitionEntries`].
///
/// An operator may depend on a **control**: what drives the step from k − 1 to
/// k, such as odometry, elapsed time or a gear. An operator without one has
/// `Control = ()`, and its columns are checked when a model is built from it.
///
/// A control may also be **evidence on the move**: what was measured between two
/// steps, such as odometry or a compass. It does not choose an operator; it has a
/// likelihood p(u | `X_{k-1}`, `X_k`) that multiplies the entries of A, whose
/// columns then do not sum to one. [`evidence`](Self::evidence) says so, and
/// [`EvidenceTransition`](crate::EvidenceTransition) puts a likelihood of moves on
/// any operator.
///
/// Entries below 2.2e-308 have lost digits, and what they lead to may be lost.
///
/// An operator behind a reference, `Box`, `Rc` or `Arc` is an operator too, so
/// that models can share a large one.
///
/// # Implement it yourself
///
/// A drive around a loop: one place on with probability 0.9, else stay.
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
/// With a control, the metres driven since the last sighting, on a line of
/// places 100 m apart (n of them; what comes near the end stays there):
///
/// ```
/// use wayfix::{Transition, TransitionError};
///
/// struct Line(usize);
///
/// impl Line {
///     /// The places on either side of where the vehicle comes to.
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
    /// What the operator of a step depends on; `()` if on nothing.
    type Control: 'static;

    /// The number of states, n.
    fn states(&self) -> usize;

    /// `out = A x`: the distribution one step later. Overwrites all of `out`.
    ///
    /// Must be linear in `x`, for `x` of any non-negative scale. Inference
    /// calls it with two slices of n values, after
    /// [`check_control`](Self::check_control) has accepted the control; the
    /// operators of this crate panic on slices of another length.
    fn apply(&self, control: &Self::Control, x: &[f64], out: &mut [f64]);

    /// `out = A' x`, the transpose (paper eq. 12). Overwrites all of `out`.
    /// The rest is as for [`apply`](Self::apply).
    fn apply_transpose(&self, control: &Self::Control, x: &[f64], out: &mut [f64]);

    /// The same product in logarithms: `out[i]` = ln Σ over j of A\[i, j\]
    /// exp(`x[j]`), for `x` of any range, with −∞ for 0.
    ///
    /// Inference takes it where a double does not hold a belief. The default
    /// calls [`apply`](Self::apply) once for every 600 nats of range, and
    /// allocates; the operators of this crate sum entry by entry.
    fn apply_log(&self, control: &Self::Control, x: &[f64], out: &mut [f64]) {
        log::by_bands(x, out, |x, out| self.apply(control, x, out));
    }

    /// As [`apply_log`](Self::apply_log), with A'.
    fn apply_transpose_log(&self, control: &Self::Control, x: &[f64], out: &mut [f64]) {
        log::by_bands(x, out, |x, out| self.apply_transpose(control, x, out));
    }

    /// The evidence on the move in a control: `None`, as by default, if the control
    /// only chooses the operator, whose columns are then distributions; they are
    /// checked to be so. `Some(log_factor)` if something was measured, u: the entries
    /// of this step then are
    ///
    /// ```text
    /// A[i, j] p(u | X_{k-1} = j, X_k = i) exp(−log_factor)
    /// ```
    ///
    /// They are finite and at least 0, and their columns may have any sum, also 0.
    /// Inference normalises the belief, not the columns: the sum of a prediction is
    /// p(u | y_1 … y_{k-1}), and its logarithm becomes part of the log-likelihood,
    /// with `log_factor` added.
    ///
    /// All methods give these entries, those of
    /// [`TransitionEntries`] too. The factor should be such that the largest
    /// entry is near 1: a step whose sum is above 2^7 or below 2^-100 is taken in
    /// logarithms, which takes longer. Called with a control that
    /// [`check_control`](Self::check_control) has accepted, more than once a step: it
    /// should cost little.
    fn evidence(&self, control: &Self::Control) -> Option<f64> {
        let _ = control;
        None
    }

    /// Whether entries of a step with [evidence](Self::evidence) are beyond doubles:
    /// above 0 but below 2.2e-308, or above 1.7e308. Inference then takes the step in
    /// logarithms, and asks for entries by
    /// [`incoming_log2`](TransitionEntries::incoming_log2) and
    /// [`outgoing_log2`](TransitionEntries::outgoing_log2) alone. By default they never
    /// are: what is below then may be lost, which is at most 1e-277 of a prediction, since
    /// the sum of one that is taken in doubles is at least 2^-100. Called a few times a
    /// step.
    fn needs_logs(&self, control: &Self::Control) -> bool {
        let _ = control;
        false
    }

    /// [`apply`](Self::apply) block by block: hands over the first state of a block and its
    /// values, while they are in the processor's first cache; each state once. By default
    /// one block of all. A filter calls it in place of `apply` where
    /// [`smallest_entry`](Self::smallest_entry) allows.
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

    /// A bound from below on the entries above 0 of a step, and on all factors that a product
    /// multiplies by on its way to them; 0, as by default, if none is known. From 2^-100 on,
    /// products with beliefs keep their digits, so that a filter need not scale them:
    /// operators that also write [blocks](Self::apply_in_blocks) then take half the time.
    /// Called once a step.
    fn smallest_entry(&self, control: &Self::Control) -> f64 {
        let _ = control;
        0.0
    }

    /// The matrix of a step, if it is one that this crate stores: inference
    /// then goes through it by itself, and does with each product at once what
    /// else there is to do. `None`, unless an operator hands on that of another,
    /// which it must equal. It is not looked at where there is
    /// [evidence](Self::evidence).
    fn stored(&self, control: &Self::Control) -> Option<Stored<'_>> {
        let _ = control;
        None
    }

    /// Whether there is an operator for this control; all are accepted unless
    /// an implementation says otherwise.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Control`] with the reason.
    fn check_control(&self, control: &Self::Control) -> Result<(), TransitionError> {
        let _ = control;
        Ok(())
    }
}

/// A transition operator whose entries can be listed.
///
/// Only entries above 0 are listed, each state at most once, in ascending
/// order: ties in decoding then go to the lowest state. Entries are those of the
/// product; what lists others gives wrong results, or an error where pairs do not
/// sum to one, and what lists states that do not exist panics. Inference asks only for
/// states below [`states`](Transition::states); for others the operators of
/// this crate panic.
///
/// # Implement it yourself
///
/// ```
/// use wayfix::{Transition, TransitionEntries};
/// # struct Around(usize);
/// # impl Transition for Around {
/// #     type Control = ();
/// #     fn states(&self) -> usize { self.0 }
/// #     fn apply(&self, _: &(), x: &[f64], out: &mut [f64]) {}
/// #     fn apply_transpose(&self, _: &(), x: &[f64], out: &mut [f64]) {}
/// # }
///
/// // The loop of the example at `Transition`.
/// impl TransitionEntries for Around {
///     fn incoming(&self, _: &(), to: usize) -> impl Iterator<Item = (usize, f64)> {
///         let mut from = [((to + self.0 - 1) % self.0, 0.9), (to, 0.1)];
///         from.sort_by_key(|entry| entry.0);
///         from.into_iter()
///     }
///     fn outgoing(&self, _: &(), from: usize) -> impl Iterator<Item = (usize, f64)> {
///         let mut to = [((from + 1) % self.0, 0.9), (from, 0.1)];
///         to.sort_by_key(|entry| entry.0);
///         to.into_iter()
///     }
/// }
///
/// assert_eq!(Around(4).outgoing(&(), 3).collect::<Vec<_>>(), [(0, 0.9), (3, 0.1)]);
/// ```
pub trait TransitionEntries: Transition {
    /// The entries into a state, row `to` of A: pairs (from, probability).
    fn incoming(&self, control: &Self::Control, to: usize) -> impl Iterator<Item = (usize, f64)>;

    /// The entries out of a state, column `from` of A: pairs (to, probability).
    fn outgoing(&self, control: &Self::Control, from: usize) -> impl Iterator<Item = (usize, f64)>;

    /// The entries into a state as decoders add them: pairs (from, log2 p), in
    /// which an operator that is a product adds the logarithms of its factors.
    fn incoming_log2(
        &self,
        control: &Self::Control,
        to: usize,
    ) -> impl Iterator<Item = (usize, f64)> {
        self.incoming(control, to).map(|(from, p)| (from, log2(p)))
    }

    /// The entries out of a state as [`incoming_log2`](Self::incoming_log2) gives those
    /// into one: pairs (to, log2 p).
    fn outgoing_log2(
        &self,
        control: &Self::Control,
        from: usize,
    ) -> impl Iterator<Item = (usize, f64)> {
        self.outgoing(control, from).map(|(to, p)| (to, log2(p)))
    }

    /// The step of Viterbi, a product in which a maximum stands for the sum:
    /// `out[i]` = max over j of log2 A\[i, j\] + `x[j]`, and `from[i]` the j
    /// that attains it, the lowest one of several. Here and in the operators
    /// of this crate, logarithms are rounded to multiples of 2^-45: their sums
    /// are then exact, and paths with the same factors tie.
    ///
    /// Where nothing leads to i, or only states at −∞ do, `out[i]` is −∞ and
    /// `from[i]` means nothing. O(entries), unless an operator knows better.
    fn max_product(&self, control: &Self::Control, x: &[f64], out: &mut [f64], from: &mut [u32]) {
        for (i, (out, from)) in out.iter_mut().zip(from).enumerate() {
            let entries = self.incoming_log2(control, i).map(|(j, log2)| (j as u32, log2));
            (*out, *from) = best_of(entries, x);
        }
    }
}

/// The best of `log2 A[i, j] + x[j]` and its j: the first of several.
#[inline]
fn best_of(entries: impl Iterator<Item = (u32, f64)>, x: &[f64]) -> (f64, u32) {
    let mut best = (f64::NEG_INFINITY, 0);
    for (j, log2) in entries {
        let value = log2 + x[j as usize];
        if value > best.0 {
            best = (value, j);
        }
    }
    best
}

/// Checks an operator without a control: its columns sum to one, A' 1 = 1 (but for
/// evidence on moves), and its two products belong together, v' (A u) = u' (A' v). An
/// operator with a control can't be checked here, since there is none to ask it with.
pub(crate) fn validate<A: Transition>(transition: &A) -> Result<(), TransitionError> {
    let n = transition.states();
    if n == 0 {
        return Err(TransitionError::Empty);
    }
    let Some(control) = (&() as &dyn Any).downcast_ref::<A::Control>() else {
        return Ok(());
    };
    transition.check_control(control)?;
    let (mut ones, mut product) = (vec![1.0; n], vec![0.0; n]);
    transition.apply_transpose(control, &ones, &mut product);
    match transition.evidence(control) {
        None => check_columns(&product)?,
        Some(_) if transition.needs_logs(control) => return Ok(()),
        Some(_) => {}
    }
    // Two vectors without a pattern that an operator could share: multiples of
    // the golden ratio and of the square root of two, modulo one.
    let (golden, root) = (0.618_033_988_749_894_9, std::f64::consts::SQRT_2);
    let v: Vec<f64> = (1..=n).map(|i| 0.5 + (i as f64 * golden).fract()).collect();
    ones.iter_mut().zip(1..).for_each(|(u, i)| *u = 0.5 + (f64::from(i) * root).fract());
    transition.apply(control, &ones, &mut product);
    let forward = kernels::dot(&product, &v);
    transition.apply_transpose(control, &v, &mut product);
    let backward = kernels::dot(&product, &ones);
    let close = (forward - backward).abs() <= 1e-9 * forward.abs();
    if close { Ok(()) } else { Err(TransitionError::Transpose { forward, backward }) }
}

/// The first column whose sum is not one.
fn check_columns(sums: &[f64]) -> Result<(), TransitionError> {
    let one = 1.0 - SUM_TOLERANCE..=1.0 + SUM_TOLERANCE;
    match sums.iter().position(|sum| !one.contains(sum)) {
        Some(column) => Err(TransitionError::ColumnSum { column, sum: sums[column] }),
        None => Ok(()),
    }
}

/// The same of a matrix that is at hand: if its rows sum to one instead, it was given as
/// its transpose, and the error says so.
fn check_columns_of(sums: &[f64], row: impl Fn(usize) -> f64) -> Result<(), TransitionError> {
    check_columns(sums).map_err(|error| match error {
        TransitionError::ColumnSum { column, sum }
            if (0..sums.len()).all(|i| (row(i) - 1.0).abs() <= SUM_TOLERANCE) =>
        {
            TransitionError::RowsSumToOne { column, sum }
        }
        error => error,
    })
}

/// n as an index of 32 bits.
pub(crate) fn check_count(what: &'static str, count: usize) -> Result<(), TransitionError> {
    if u32::try_from(count).is_err() {
        return Err(TransitionError::TooMany { what, count });
    }
    Ok(())
}

/// Values that are probabilities and sum to one; errors call the sum `whole`.
pub(crate) fn check_sum(
    values: &[f64],
    whole: String,
    name: impl Fn(usize) -> String,
) -> Result<(), TransitionError> {
    if let Some(at) = values.iter().position(|&value| !(value >= 0.0 && value.is_finite())) {
        let expected = "a finite value of at least 0";
        return Err(TransitionError::Parameter { what: name(at), value: values[at], expected });
    }
    let sum = kernels::sum(values);
    if (sum - 1.0).abs() > SUM_TOLERANCE {
        return Err(TransitionError::Parameter { what: whole, value: sum, expected: "1" });
    }
    Ok(())
}

/// A belief times a rate, none of whose products may underflow.
fn scaled(belief: Belief, rate: f64, what: &str) -> Result<Vec<f64>, TransitionError> {
    let mut values = belief.into_vec();
    for (state, r) in values.iter_mut().enumerate() {
        let value = *r * rate;
        if *r > 0.0 && rate > 0.0 && value < f64::MIN_POSITIVE {
            let what = format!("the probability of {what} state {state}");
            let expected = "0 or at least 2.2e-308, the smallest normal double";
            return Err(TransitionError::Parameter { what, value, expected });
        }
        *r = value;
    }
    Ok(values)
}

pub(crate) fn check_probability(
    value: f64,
    what: impl FnOnce() -> String,
) -> Result<(), TransitionError> {
    if !(0.0..=1.0).contains(&value) {
        let expected = "a value from 0 to 1";
        return Err(TransitionError::Parameter { what: what(), value, expected });
    }
    Ok(())
}

/// Inference keeps this; whoever calls a product directly has to.
pub(crate) fn check_slices(states: usize, x: &[f64], out: &[f64]) {
    assert_eq!(x.len(), states, "x must have one value per state");
    assert_eq!(out.len(), states, "out must have one value per state");
}

/// For operators of which some moves would have no likelihood of what was measured.
fn refuse_evidence<A: Transition>(
    inner: &A,
    control: &A::Control,
    operator: &str,
) -> Result<(), TransitionError> {
    inner.check_control(control)?;
    if inner.evidence(control).is_some() {
        let text = format!("evidence on moves within a {operator}, which does not take it");
        return Err(TransitionError::Control(text));
    }
    Ok(())
}

/// Two lists of entries in ascending order as one, in which entries of the same
/// state are added.
fn merge(
    a: impl Iterator<Item = (usize, f64)>,
    b: impl Iterator<Item = (usize, f64)>,
    plus: impl Fn(f64, f64) -> f64,
) -> impl Iterator<Item = (usize, f64)> {
    let (mut a, mut b) = (a.peekable(), b.peekable());
    std::iter::from_fn(move || match (a.peek(), b.peek()) {
        (Some(x), Some(y)) if x.0 == y.0 => Some((x.0, plus(a.next()?.1, b.next()?.1))),
        (Some(x), Some(y)) if x.0 > y.0 => b.next(),
        (None, _) => b.next(),
        _ => a.next(),
    })
}
