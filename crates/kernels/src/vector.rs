//! Vectors: their memory, aligned to cache lines, and in large pages if a vector is large; and sums and
//! scales in plain loops, which are called rarely, not in each step.
//!
//! As in kernels, sums have eight lanes, joined by [`total`], followed by the rest in order: so the
//! compiler can vectorise them without a licence to reorder.

use std::ops::{Deref, DerefMut};

use crate::limits::{LIFT, TINY};
use crate::simd::{Eight, LANES, total};

/// Usual sizes of a cache line, a page and a large page, in bytes.
pub(crate) const LINE: usize = 64;
const PAGE: usize = 4096;
const LARGE_PAGE: usize = 2 << 20;
/// Smallest size of a vector that asks for large pages.
pub(crate) const LARGE: usize = 2 * LARGE_PAGE;
/// Smallest size of a vector that begins on a page. A load waits for an earlier store if their
/// addresses differ by whole pages; without this, that could happen at neighbouring places of two
/// vectors.
const SEVERAL_PAGES: usize = 16 * PAGE;

/// Doubles that begin on a cache line: loads of eight that straddle two lines take twice as long.
/// A large vector begins on a page, and a very large one on a large page, with room to the end of
/// its last one, so that no part of it comes in small pages.
pub struct Aligned {
    /// Memory up to the end of the vector, which begins at `start`.
    values: Vec<f64>,
    start: usize,
}

impl Aligned {
    /// Creates `len` values.
    pub fn new(len: usize, value: f64) -> Self {
        // The larger a vector is, the more loads gain from alignment, and the less the memory
        // before its start matters.
        let (unit, room) = match len * size_of::<f64>() {
            LARGE.. => (LARGE_PAGE, 2),
            SEVERAL_PAGES.. => (PAGE, 1),
            _ => (LINE, 1),
        };
        // The allocator aligns to 8 or 16 bytes: an aligned start is less than a unit away. One
        // value less than a unit is enough, as starts are multiples of a value.
        let spare = room * unit / size_of::<f64>() - 1;
        let mut values = in_large_pages(vec![value; len + spare]);
        // `align_offset` may give up and return a huge number. Only speed depends on the alignment:
        // then the vector begins where it can.
        let start = values.as_ptr().align_offset(unit).min(spare);
        values.truncate(start + len);
        Self { values, start }
    }

    /// Number of values that fit into the memory.
    pub fn capacity(&self) -> usize {
        self.values.capacity()
    }
}

impl From<Vec<f64>> for Aligned {
    /// Takes values as they are, without alignment: for values at rest, which take no more memory
    /// than their numbers.
    fn from(values: Vec<f64>) -> Self {
        Self { values, start: 0 }
    }
}

impl PartialEq for Aligned {
    fn eq(&self, other: &Self) -> bool {
        self[..] == other[..]
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

impl Clone for Aligned {
    fn clone(&self) -> Self {
        // Not a copy of the fields: the same distance from another address is not aligned.
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

/// Eight doubles on a cache line, so that no load of them touches two.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[repr(align(64))]
pub struct Packed(pub Eight);

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

/// Returns the same vector; if it is large, asks for large pages for the memory that is not yet
/// written to.
///
/// A system provides memory at the first write, usually 4 KB at a time, and each page costs as much
/// as 2,000 additions. Linux can provide 2 MB at a time, on most machines only on request.
pub fn in_large_pages<T>(vec: Vec<T>) -> Vec<T> {
    let bytes = vec.capacity() * size_of::<T>();
    if bytes >= LARGE {
        request(vec.as_ptr().addr(), bytes);
    }
    vec
}

#[cfg(all(target_os = "linux", any(target_arch = "x86_64", target_arch = "aarch64")))]
fn request(start: usize, bytes: usize) {
    use std::ffi::{c_int, c_void};

    #[allow(unsafe_code, reason = "a declaration that the compiler can't check")]
    unsafe extern "C" {
        /// madvise(2), of the C library that the standard library links.
        fn madvise(start: *mut c_void, bytes: usize, advice: c_int) -> c_int;
    }
    /// `MADV_HUGEPAGE`, on these architectures.
    const HUGE_PAGE: c_int = 14;
    // The call takes whole pages. The first may begin before the vector; advice on more memory is
    // harmless. On machines with pages above 4 KB the call may fail.
    let first = start & !(PAGE - 1);
    let end = (start + bytes) & !(PAGE - 1);
    #[allow(unsafe_code, reason = "a system call with the address of a vector")]
    // SAFETY: the signature is that of the C library's function. This advice changes how memory is
    // provided, never its contents, whoever owns it, and the system checks the addresses, so every
    // range is sound. A failure (older systems have no such pages) does not matter.
    unsafe {
        madvise(std::ptr::without_provenance_mut(first), end - first, HUGE_PAGE);
    }
}

#[cfg(not(all(target_os = "linux", any(target_arch = "x86_64", target_arch = "aarch64"))))]
fn request(_start: usize, _bytes: usize) {}

/// Σ xᵢ.
pub fn sum(x: &[f64]) -> f64 {
    let (blocks, rest) = x.as_chunks::<LANES>();
    let mut lanes = [0.0; LANES];
    for block in blocks {
        for l in 0..LANES {
            lanes[l] += block[l];
        }
    }
    total(lanes) + rest.iter().sum::<f64>()
}

/// Σ xᵢ yᵢ.
pub fn dot(x: &[f64], y: &[f64]) -> f64 {
    let ((xs, x_rest), (ys, y_rest)) = (x.as_chunks::<LANES>(), y.as_chunks::<LANES>());
    let mut lanes = [0.0; LANES];
    for (x, y) in xs.iter().zip(ys) {
        for l in 0..LANES {
            lanes[l] += x[l] * y[l];
        }
    }
    total(lanes) + x_rest.iter().zip(y_rest).map(|(x, y)| x * y).sum::<f64>()
}

/// ln Σ eˣ without overflow or underflow; ±∞ if the largest x is.
pub fn log_sum(terms: impl Iterator<Item = f64> + Clone) -> f64 {
    let largest = terms.clone().fold(f64::NEG_INFINITY, f64::max);
    if largest.is_infinite() {
        return largest;
    }
    let mut sum = 0.0;
    for term in terms {
        let below = term - largest;
        // The sum is at least 1, and e^-45 is 3e-20: thousands of such terms do not change its last
        // digit.
        if below > -45.0 {
            sum += if below == 0.0 { 1.0 } else { below.exp() };
        }
    }
    largest + sum.ln()
}

/// Writes x, lifted.
pub fn lift(x: &[f64], out: &mut [f64]) {
    out.iter_mut().zip(x).for_each(|(out, x)| *out = x * LIFT);
}

/// True if a probability is above 0 and below 2^-900.
pub fn any_tiny(x: &[f64]) -> bool {
    x.iter().any(|&x| 0.0 < x && x < TINY)
}

/// Divides a vector by its sum, `sum`. Values that would be below the smallest normal double become
/// 0: the far tails of a Gaussian sensor alone would double the time of a step.
pub fn normalize(x: &mut [f64], sum: f64) {
    let (factor, least) = (1.0 / sum, f64::MIN_POSITIVE * sum);
    // Selected before the product: no quotient below the normal doubles is ever computed.
    x.iter_mut().for_each(|x| *x = if *x >= least { *x } else { 0.0 } * factor);
}
