//! Large pages for large results.
//!
//! The system hands out memory when it is first written, as a rule 4 KB at a time,
//! each of which costs as much as 2,000 additions. Linux can hand out 2 MB at a
//! time, but on most machines only where it is asked to.

#![allow(unsafe_code, reason = "a system call, which gets the address of a vector")]

/// The size of a page, as a rule, in bytes.
pub(super) const PAGE: usize = 4096;
/// The size of a large page, as a rule, in bytes.
pub(super) const LARGE_PAGE: usize = 2 << 20;
/// From so many bytes on, a vector is large; others are left alone.
pub(super) const LARGE: usize = 2 * LARGE_PAGE;

/// The same vector; if it is large, its memory comes in large pages from now on,
/// where the system has them.
pub(crate) fn in_large_pages<T>(vec: Vec<T>) -> Vec<T> {
    let bytes = vec.capacity() * size_of::<T>();
    if bytes >= LARGE {
        ask(vec.as_ptr().addr(), bytes);
    }
    vec
}

#[cfg(all(target_os = "linux", any(target_arch = "x86_64", target_arch = "aarch64")))]
fn ask(start: usize, bytes: usize) {
    use std::ffi::{c_int, c_void};

    unsafe extern "C" {
        /// madvise(2), of the C library that the standard library is linked to.
        fn madvise(start: *mut c_void, bytes: usize, advice: c_int) -> c_int;
    }
    /// `MADV_HUGEPAGE`, on these architectures.
    const HUGE_PAGE: c_int = 14;
    // On machines with larger pages the call may fail.
    let first = start & !(PAGE - 1);
    let end = (start + bytes) & !(PAGE - 1);
    // SAFETY: this advice changes no memory, whosever it is, only how it is
    // provided; addresses are checked by the system. Whether it did so (older
    // systems have no such pages) does not matter.
    unsafe {
        madvise(std::ptr::without_provenance_mut(first), end - first, HUGE_PAGE);
    }
}

#[cfg(not(all(target_os = "linux", any(target_arch = "x86_64", target_arch = "aarch64"))))]
fn ask(_start: usize, _bytes: usize) {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vectors_of_any_size_stay_as_they_are() {
        for count in [0, 1, 1000, LARGE / 8, 3 * LARGE / 8 + 5] {
            let mut vec = in_large_pages(vec![1.5; count]);
            assert_eq!(vec, vec![1.5; count]);
            vec.push(2.5);
            assert_eq!(vec.iter().sum::<f64>(), 1.5 * count as f64 + 2.5);
        }
        let mut empty = in_large_pages(Vec::with_capacity(LARGE));
        empty.resize(LARGE, 7_u8);
        assert!(empty.iter().all(|byte| *byte == 7));
        assert_eq!(in_large_pages(vec![(); 10]).len(), 10);
    }
}
