//! Matrices of observations as sequences, without copying: a row begins each `stride` values and
//! has `width` of them. Lagged rows are wider than the stride, and overlap.

use super::EmissionError;
use wayfix::Sequence;

/// A T × d matrix, row after row, as a sequence of T observations of d numbers.
///
/// Borrows the values, so nothing is copied: a slice, `as_slice()` of a row-major array of
/// `ndarray`, or the vector that a crate such as `npyz` reads from a `.npy` file (float64, C
/// order). [`lagged`](Self::lagged) puts the previous observations in front of each one, for
/// autoregressive families.
///
/// ```
/// use wayfix::Sequence;
/// use wayfix_learn::Rows;
///
/// let values = [1.0, 10.0, 2.0, 20.0, 3.0, 30.0];
/// let rows = Rows::new(&values, 2)?;
/// assert_eq!(rows.steps(), 3);
/// assert_eq!(rows.observation(2), [2.0, 20.0]);
/// assert_eq!(rows.lagged(1)?.observation(1), [1.0, 10.0, 2.0, 20.0]);
/// # Ok::<(), wayfix_learn::EmissionError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rows<'a> {
    values: &'a [f64],
    /// Number of values of an observation.
    width: usize,
    /// Number of values from the start of one observation to the start of the next.
    stride: usize,
}

impl<'a> Rows<'a> {
    /// Divides values into observations with this number of components. O(1).
    ///
    /// # Errors
    ///
    /// [`EmissionError`] if `components` is 0 or does not divide the number of values.
    pub fn new(values: &'a [f64], components: usize) -> Result<Self, EmissionError> {
        match values.len().checked_rem(components) {
            None => Err(EmissionError::NoComponents),
            Some(0) => Ok(Self { values, width: components, stride: components }),
            Some(_) => Err(EmissionError::Incomplete { values: values.len(), components }),
        }
    }

    /// Divides values whose number is known to be a multiple of the number of components.
    #[cfg(feature = "csv")]
    pub(super) fn known(values: &'a [f64], components: usize) -> Self {
        Self { values, width: components, stride: components }
    }

    /// Returns rows of the `order` previous observations, oldest first, and the observation itself:
    /// T − order rows of (order + 1) d numbers. O(1), since they overlap.
    ///
    /// # Errors
    ///
    /// [`EmissionError::TooFewRows`] unless there are more than `order` rows.
    pub fn lagged(self, order: usize) -> Result<Self, EmissionError> {
        let rows = self.steps();
        if rows <= order {
            return Err(EmissionError::TooFewRows { rows, order });
        }
        Ok(Self { width: self.width + order * self.stride, ..self })
    }

    /// Number of rows.
    fn steps(&self) -> usize {
        // The last row ends with the last value. Added in this order, 0 values do not underflow.
        (self.values.len() + self.stride - self.width) / self.stride
    }

    /// Number of values of an observation: d, or (order + 1) d for lagged rows.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// The rows, in order.
    #[must_use]
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &'a [f64]> + use<'a> {
        let Self { values, width, stride } = *self;
        (0..self.steps()).map(move |row| &values[row * stride..row * stride + width])
    }
}

impl Sequence<(), [f64]> for Rows<'_> {
    fn steps(&self) -> usize {
        Rows::steps(self)
    }

    fn control(&self, _: usize) -> &() {
        &()
    }

    fn observation(&self, step: usize) -> &[f64] {
        let from = (step - 1) * self.stride;
        &self.values[from..from + self.width]
    }
}
