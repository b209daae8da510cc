//! Doubles that begin on a cache line.

use std::ops::{Deref, DerefMut};

use super::pages::{LARGE, LARGE_PAGE, in_large_pages};

/// Of a cache line, in bytes.
const LINE: usize = 64;

/// Doubles that begin on a cache line: loads of eight that straddle two of them
/// take twice as long. Many begin on a large page, and there is room to the end of the
/// last one, so that none has to come in small pages.
pub(crate) struct Aligned {
    values: Vec<f64>,
    start: usize,
    len: usize,
}

impl Aligned {
    /// So many, all of them `value`.
    pub(crate) fn new(len: usize, value: f64) -> Self {
        let many = len >= LARGE / size_of::<f64>();
        let (unit, room) = if many { (LARGE_PAGE, 2) } else { (LINE, 1) };
        let spare = room * unit / size_of::<f64>() - 1;
        let values = in_large_pages(vec![value; len + spare]);
        // Nothing depends on it but the time that loads take.
        let start = values.as_ptr().align_offset(unit).min(spare);
        Self { values, start, len }
    }
}

impl Deref for Aligned {
    type Target = [f64];

    #[inline]
    fn deref(&self) -> &[f64] {
        &self.values[self.start..self.start + self.len]
    }
}

impl DerefMut for Aligned {
    fn deref_mut(&mut self) -> &mut [f64] {
        &mut self.values[self.start..self.start + self.len]
    }
}

/// Begins on a cache line too.
impl Clone for Aligned {
    fn clone(&self) -> Self {
        let mut copy = Self::new(self.len, 0.0);
        copy.copy_from_slice(self);
        copy
    }
}

impl std::fmt::Debug for Aligned {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self[..].fmt(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn they_begin_on_a_line_and_a_copy_does() {
        for len in 0..40 {
            let mut aligned = Aligned::new(len, 2.0);
            aligned.iter_mut().zip(0..).for_each(|(value, i)| *value += f64::from(i));
            let copy = aligned.clone();
            assert_eq!(copy[..], *(0..len).map(|i| 2.0 + i as f64).collect::<Vec<_>>());
            for values in [&aligned, &copy] {
                assert_eq!(values.as_ptr().addr() % LINE, 0);
            }
        }
    }
}
