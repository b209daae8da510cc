//! Values of a matrix in 64 bits, or in 32.

use super::lanes::{Eight, LANES, Lanes};
use super::sliced::Values;

/// A number as it is stored; products take it as a double, which is exact.
pub(crate) trait Value: Copy + Default + Into<f64> {
    /// Eight of them.
    fn load<L: Lanes>(lanes: L, values: &[Self; LANES]) -> L::V;

    /// Values in this width.
    fn of_width(values: Values<Self>) -> Width<Values<f64>, Values<f32>>;
}

impl Value for f64 {
    #[inline(always)]
    fn load<L: Lanes>(lanes: L, values: &Eight) -> L::V {
        lanes.load(values)
    }

    fn of_width(values: Values<f64>) -> Width<Values<f64>, Values<f32>> {
        Width::Double(values)
    }
}

impl Value for f32 {
    #[inline(always)]
    fn load<L: Lanes>(lanes: L, values: &[f32; LANES]) -> L::V {
        lanes.load_single(values)
    }

    fn of_width(values: Values<f32>) -> Width<Values<f64>, Values<f32>> {
        Width::Single(values)
    }
}

/// What there is for values of 64 bits, or for those of 32.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Width<D, S> {
    Double(D),
    Single(S),
}
