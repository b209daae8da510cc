//! Values of a matrix in 64 bits, or in 32.

use std::ops::{Deref, DerefMut};

use super::abreast::Abreast;
use super::lanes::{LANES, Lanes};
use super::sliced::Values;

/// A number as it is stored; products take it as a double, which is exact.
pub(crate) trait Value: Copy + Default + Into<f64> {
    /// Eight of them, where no load of them takes two lines of a cache.
    type Slot: Copy + Default + std::fmt::Debug + DerefMut<Target = [Self; LANES]>;

    fn load<L: Lanes>(lanes: L, slot: &Self::Slot) -> L::V;

    /// Values in this width.
    fn of_width(values: Values<Self>) -> Width<Values<f64>, Values<f32>>;
}

impl Value for f64 {
    type Slot = Abreast;

    #[inline(always)]
    fn load<L: Lanes>(lanes: L, slot: &Abreast) -> L::V {
        lanes.load(slot)
    }

    fn of_width(values: Values<f64>) -> Width<Values<f64>, Values<f32>> {
        Width::Double(values)
    }
}

impl Value for f32 {
    type Slot = Half<f32>;

    #[inline(always)]
    fn load<L: Lanes>(lanes: L, slot: &Half<f32>) -> L::V {
        lanes.load_single(slot)
    }

    fn of_width(values: Values<f32>) -> Width<Values<f64>, Values<f32>> {
        Width::Single(values)
    }
}

/// Eight numbers of 32 bits: half a line of a cache.
#[derive(Debug, Clone, Copy, Default)]
#[repr(align(32))]
pub(crate) struct Half<T>(pub(super) [T; LANES]);

impl<T> Deref for Half<T> {
    type Target = [T; LANES];

    #[inline(always)]
    fn deref(&self) -> &[T; LANES] {
        &self.0
    }
}

impl<T> DerefMut for Half<T> {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [T; LANES] {
        &mut self.0
    }
}

/// What there is for values of 64 bits, or for those of 32.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Width<D, S> {
    Double(D),
    Single(S),
}
