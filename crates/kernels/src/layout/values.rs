//! Values of a matrix in 64 bits, or in 32, and vectors of eight in memory.

use std::ops::{Deref, DerefMut};

use crate::ops::log2;
use crate::simd::{Eight, LANES, Simd};

/// Eight doubles on a cache line, so that no load of them touches two.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[repr(align(64))]
pub struct Packed(pub Eight);

/// Eight numbers of 32 bits on half a cache line.
#[derive(Debug, Clone, Copy, Default)]
#[repr(align(32))]
pub struct HalfLine<T>(pub(super) [T; LANES]);

impl Deref for Packed {
    type Target = Eight;

    #[inline(always)]
    fn deref(&self) -> &Eight {
        &self.0
    }
}

impl DerefMut for Packed {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut Eight {
        &mut self.0
    }
}

impl<T> Deref for HalfLine<T> {
    type Target = [T; LANES];

    #[inline(always)]
    fn deref(&self) -> &[T; LANES] {
        &self.0
    }
}

impl<T> DerefMut for HalfLine<T> {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [T; LANES] {
        &mut self.0
    }
}

/// Number in its stored form; products convert it to a double, which is exact.
pub trait Value: Copy + Default + Into<f64> {
    /// Eight of them.
    type Slot: Copy + Default + std::fmt::Debug + DerefMut<Target = [Self; LANES]>;

    fn load<S: Simd>(s: S, slot: &Self::Slot) -> S::V;

    fn of_width(values: EntryValues<Self>) -> Width<EntryValues<f64>, EntryValues<f32>>;
}

impl Value for f64 {
    type Slot = Packed;

    #[inline(always)]
    fn load<S: Simd>(s: S, slot: &Packed) -> S::V {
        s.load(slot)
    }

    fn of_width(values: EntryValues<f64>) -> Width<EntryValues<f64>, EntryValues<f32>> {
        Width::Double(values)
    }
}

impl Value for f32 {
    type Slot = HalfLine<f32>;

    #[inline(always)]
    fn load<S: Simd>(s: S, slot: &HalfLine<f32>) -> S::V {
        s.load_f32(slot)
    }

    fn of_width(values: EntryValues<f32>) -> Width<EntryValues<f64>, EntryValues<f32>> {
        Width::Single(values)
    }
}

/// Values of 64 bits, or of 32.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Width<D, S> {
    Double(D),
    Single(S),
}

/// Values of a matrix of this structure.
#[derive(Debug, Clone)]
pub struct EntryValues<V: Value = f64> {
    pub(super) shifted: Vec<V::Slot>,
    pub(super) gathered: Vec<V::Slot>,
    pub(super) overflow: Vec<V>,
}

impl<V: Value> EntryValues<V> {
    pub(super) fn new() -> Self {
        Self { shifted: Vec::new(), gathered: Vec::new(), overflow: Vec::new() }
    }

    /// Logarithms of all values; −∞ in places without an entry.
    pub(super) fn log2(&self) -> EntryValues {
        // Empty places of slots are 0, and their logarithms −∞: no maximum takes them.
        let eight = |slot: &V::Slot| Packed(slot.map(|p| log2(p.into())));
        EntryValues {
            shifted: self.shifted.iter().map(eight).collect(),
            gathered: self.gathered.iter().map(eight).collect(),
            overflow: self.overflow.iter().map(|&p| log2(p.into())).collect(),
        }
    }
}
