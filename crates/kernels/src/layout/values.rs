//! Values of a matrix, and vectors of eight in memory.

use std::ops::{Deref, DerefMut};

use crate::ops::log2;
use crate::simd::{Eight, LANES};

/// Eight doubles on a cache line, so that no load of them touches two.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[repr(align(64))]
pub struct Packed(pub Eight);

/// Eight indices on half a cache line.
#[derive(Debug, Clone, Copy, Default)]
#[repr(align(32))]
pub(super) struct HalfLine(pub(super) [u32; LANES]);

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

impl Deref for HalfLine {
    type Target = [u32; LANES];

    #[inline(always)]
    fn deref(&self) -> &[u32; LANES] {
        &self.0
    }
}

impl DerefMut for HalfLine {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [u32; LANES] {
        &mut self.0
    }
}

/// Values of a matrix of this structure.
#[derive(Debug, Clone)]
pub struct EntryValues {
    pub(super) shifted: Vec<Packed>,
    pub(super) gathered: Vec<Packed>,
    pub(super) overflow: Vec<f64>,
}

impl EntryValues {
    pub(super) fn new() -> Self {
        Self { shifted: Vec::new(), gathered: Vec::new(), overflow: Vec::new() }
    }

    /// Logarithms of all values; −∞ where there is no entry.
    pub(super) fn log2(&self) -> Self {
        // Empty places of slots are 0, and their logarithms −∞: no maximum takes them.
        let eight = |slot: &Packed| Packed(slot.map(log2));
        Self {
            shifted: self.shifted.iter().map(eight).collect(),
            gathered: self.gathered.iter().map(eight).collect(),
            overflow: self.overflow.iter().map(|&p| log2(p)).collect(),
        }
    }
}
