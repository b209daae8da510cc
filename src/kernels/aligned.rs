//! Doubles that begin on a cache line.

use std::ops::{Deref, DerefMut};

use super::pages::{LARGE, LARGE_PAGE, PAGE, in_large_pages};

/// Of a cache line, in bytes.
const LINE: usize = 64;

/// Vectors of so many bytes begin on a page: a load waits for a store before it if
/// their addresses differ by pages alone, as those of places beside each other in two
/// vectors otherwise might.
const SEVERAL_PAGES: usize = 16 * PAGE;

/// Doubles that begin on a cache line: loads of eight that straddle two of them
/// take twice as long. Many begin on a page, and very many on a large page, and there is room to the end of the
/// last one, so that none has to come in small pages.
pub(crate) struct Aligned {
    /// They end with it.
    values: Vec<f64>,
    start: usize,
}

impl Aligned {
    /// So many, all of them `value`.
    pub(crate) fn new(len: usize, value: f64) -> Self {
        let (unit, room) = match len * size_of::<f64>() {
            LARGE.. => (LARGE_PAGE, 2),
            SEVERAL_PAGES.. => (PAGE, 1),
            _ => (LINE, 1),
        };
        let spare = room * unit / size_of::<f64>() - 1;
        let mut values = in_large_pages(vec![value; len + spare]);
        // Nothing depends on it but the time that loads take.
        let start = values.as_ptr().align_offset(unit).min(spare);
        values.truncate(start + len);
        Self { values, start }
    }
}

impl Deref for Aligned {
    type Target = [f64];

    #[inline(always)]
    fn deref(&self) -> &[f64] {
        &self.values[self.start..]
    }
}

impl DerefMut for Aligned {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [f64] {
        &mut self.values[self.start..]
    }
}

/// Begins on a cache line too.
impl Clone for Aligned {
    fn clone(&self) -> Self {
        let mut copy = Self::new(self.len(), 0.0);
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
