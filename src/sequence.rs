//! [`Sequence`], the input of batch methods: observations and controls by step, from 1 to T.

use std::borrow::Borrow;

use crate::error::HmmError;

/// A sequence of steps 1 to T, each with an observation of type `Y` and a
/// control of type `U`.
///
/// Arrays, slices and vectors of observations are sequences for models without a control. Their
/// elements may be anything that borrows as an observation, such as `Vec<f64>` for observations
/// of type `[f64]`. [`Controlled`] adds a control to each observation.
///
/// # Implement it yourself
///
/// ```
/// use wayfix::Sequence;
///
/// /// A log of pairs (metres driven since the last observation, place seen).
/// struct Log(Vec<(f64, usize)>);
///
/// impl Sequence<f64, usize> for Log {
///     fn steps(&self) -> usize {
///         self.0.len()
///     }
///     fn control(&self, step: usize) -> &f64 {
///         &self.0[step - 1].0
///     }
///     fn observation(&self, step: usize) -> &usize {
///         &self.0[step - 1].1
///     }
/// }
/// # assert_eq!(Log(vec![(10.0, 3)]).observation(1), &3);
/// ```
#[diagnostic::on_unimplemented(
    message = "`{Self}` is not a sequence of observations of type `{Y}` with controls of type `{U}`",
    note = "an operator with a control takes a `wayfix::Controlled`, with a control for each observation"
)]
pub trait Sequence<U, Y: ?Sized> {
    /// Number of steps, T.
    fn steps(&self) -> usize;

    /// Control of the transition from `step` − 1 to `step`, before the observation of `step`;
    /// steps are counted from 1.
    fn control(&self, step: usize) -> &U;

    /// Observation of a step, from 1 to T.
    fn observation(&self, step: usize) -> &Y;
}

/// Returns the order of sequences by their numbers of steps; equal ones stay in order. It takes the
/// numbers, not the sequences: a sort is much code, and would be compiled for each type of
/// sequence.
pub(crate) fn by_length(steps: &[usize]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..steps.len()).collect();
    order.sort_by_key(|&sequence| steps[sequence]);
    order
}

impl<Y: ?Sized, T: Borrow<Y>> Sequence<(), Y> for [T] {
    fn steps(&self) -> usize {
        self.len()
    }

    fn control(&self, _: usize) -> &() {
        &()
    }

    fn observation(&self, step: usize) -> &Y {
        self[step - 1].borrow()
    }
}

/// Implements sequences that delegate to another one.
macro_rules! as_another {
    ($([$($generics:tt)*] $type:ty => $other:ty, $control:ty, [$($bound:tt)*];)*) => {$(
        impl<Y: ?Sized, $($generics)*> Sequence<$control, Y> for $type where $($bound)* {
            fn steps(&self) -> usize {
                <$other as Sequence<$control, Y>>::steps(self)
            }

            fn control(&self, step: usize) -> &$control {
                <$other as Sequence<$control, Y>>::control(self, step)
            }

            fn observation(&self, step: usize) -> &Y {
                <$other as Sequence<$control, Y>>::observation(self, step)
            }
        }
    )*};
}

// A reference to a sequence is a sequence with any control; owned ones are those of their slice.
as_another! {
    [T, const N: usize] [T; N] => [T], (), [T: Borrow<Y>];
    [T] Vec<T> => [T], (), [T: Borrow<Y>];
    [U, S: ?Sized] &S => S, U, [S: Sequence<U, Y>];
}

/// Observations with one control each: `controls[k - 1]` drives the transition from k − 1 to k,
/// before `observations[k - 1]`.
///
/// Under [`Prior::AtFirstObservation`](crate::Prior::AtFirstObservation) no transition leads to
/// step 1, and the first control is ignored.
///
/// ```
/// use wayfix::transition::SwitchedTransition;
/// use wayfix::{Belief, Controlled, DenseTransition, Hmm, LikelihoodVector, Prior};
///
/// let park = DenseTransition::from_rows(&[[1.0, 0.0], [0.0, 1.0]])?;
/// let drive = DenseTransition::from_rows(&[[0.2, 0.0], [0.8, 1.0]])?;
/// let gears = SwitchedTransition::new(vec![park, drive])?;
/// let prior = Prior::BeforeFirstTransition(Belief::certain(2, 0)?);
/// let hmm = Hmm::new(prior, gears, LikelihoodVector::linear(2))?;
///
/// let ys = [[0.5, 0.5], [0.5, 0.5]];
/// let smoothing = hmm.smooth(&Controlled::new(&[0, 1], &ys)?)?;
/// assert_eq!(smoothing.posteriors().modes(), [0, 1]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Controlled<'a, U, T> {
    controls: &'a [U],
    observations: &'a [T],
}

impl<'a, U, T> Controlled<'a, U, T> {
    /// Pairs each observation with a control.
    ///
    /// # Errors
    ///
    /// [`HmmError::ControlCount`] if their numbers differ.
    pub fn new(controls: &'a [U], observations: &'a [T]) -> Result<Self, HmmError> {
        if controls.len() != observations.len() {
            let (controls, observations) = (controls.len(), observations.len());
            return Err(HmmError::ControlCount { controls, observations });
        }
        Ok(Self { controls, observations })
    }

    /// Controls, one per observation.
    #[must_use]
    pub fn controls(&self) -> &'a [U] {
        self.controls
    }

    /// Observations.
    #[must_use]
    pub fn observations(&self) -> &'a [T] {
        self.observations
    }
}

impl<U, T> Clone for Controlled<'_, U, T> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<U, T> Copy for Controlled<'_, U, T> {}

impl<U, Y: ?Sized, T: Borrow<Y>> Sequence<U, Y> for Controlled<'_, U, T> {
    fn steps(&self) -> usize {
        self.observations.len()
    }

    // Steps are counted from 1. `new` has checked that both slices have the same length.

    fn control(&self, step: usize) -> &U {
        &self.controls[step - 1]
    }

    fn observation(&self, step: usize) -> &Y {
        self.observations[step - 1].borrow()
    }
}

/// The T columns of a d × T matrix, each an observation of d numbers, without copying them.
/// `try_as_col_major` of a matrix of faer gives this form of it, unless the values of a column do
/// not lie one after another.
///
/// A T × d matrix with an observation in each row has its values in the wrong order for faer, which
/// stores columns; keep its transpose, or copy it.
///
/// ```
/// use wayfix::Sequence;
///
/// let values = [1.0, 10.0, 2.0, 20.0, 3.0, 30.0];
/// let matrix = faer::MatRef::from_column_major_slice(&values, 2, 3);
/// let columns = matrix.try_as_col_major().expect("stored by columns");
/// assert_eq!(columns.steps(), 3);
/// assert_eq!(columns.observation(2), [2.0, 20.0]);
/// assert!(matrix.transpose().try_as_col_major().is_none());
/// ```
#[cfg(feature = "faer")]
impl Sequence<(), [f64]> for faer::MatRef<'_, f64, usize, usize, faer::ContiguousFwd> {
    fn steps(&self) -> usize {
        self.ncols()
    }

    fn control(&self, _: usize) -> &() {
        &()
    }

    fn observation(&self, step: usize) -> &[f64] {
        self.col(step - 1).as_slice()
    }
}
