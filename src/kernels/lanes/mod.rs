//! Eight doubles at a time, with what the machine has.
//!
//! A kernel is written once, for any [`Lanes`], and run with the one that
//! [`Isa::chosen`] names. All of them add in the same order and none
//! fuses a product with a sum, so that results are the same to the bit
//! with each.
//!
//! Why it is sound: [`Avx2`] and [`Avx512`] are proofs that the instructions are
//! there. They have a private field, and only [`run`] makes them, after detection.
//! Loads and stores take references to arrays, or slices of which they touch no more than
//! there is. A gather is unsafe: who calls it has checked the indices.
#![allow(unsafe_code, reason = "instructions that not every machine has")]

use std::mem::ManuallyDrop;
use std::sync::OnceLock;

/// How many doubles there are.
pub(crate) const LANES: usize = 8;

/// Eight doubles.
pub(crate) type Eight = [f64; LANES];

/// Sets of instructions, from the plainest to the widest.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Isa {
    /// Whatever the compiler makes of arrays.
    Plain,
    /// x86-64 with AVX2.
    Avx2,
    /// x86-64 with AVX-512 F and VL.
    Avx512,
}

impl Isa {
    const NAMES: [(&'static str, Self); 3] =
        [("plain", Self::Plain), ("avx2", Self::Avx2), ("avx512", Self::Avx512)];

    /// Whether this machine has it.
    pub(crate) fn is_here(self) -> bool {
        #[cfg(target_arch = "x86_64")]
        match self {
            Self::Plain => true,
            Self::Avx2 => is_x86_feature_detected!("avx2"),
            Self::Avx512 => {
                is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512vl")
            }
        }
        #[cfg(not(target_arch = "x86_64"))]
        matches!(self, Self::Plain)
    }

    /// The widest that this machine has, or a plainer one if the environment
    /// variable `WAYFIX_INSTRUCTIONS` names it. Looked up once.
    #[inline(always)]
    pub(crate) fn chosen() -> Self {
        static CHOSEN: OnceLock<Isa> = OnceLock::new();
        *CHOSEN.get_or_init(|| {
            let named = std::env::var("WAYFIX_INSTRUCTIONS").unwrap_or_default();
            let widest = Self::NAMES.iter().find(|(name, _)| *name == named);
            let widest = widest.map_or(Self::Avx512, |found| found.1);
            let here = Self::NAMES.iter().rev().map(|named| named.1);
            here.into_iter().find(|isa| *isa <= widest && isa.is_here()).unwrap_or(Self::Plain)
        })
    }
}

/// Work that is done with lanes.
pub(crate) trait Kernel {
    /// What it gives.
    type Output;

    /// Does it. Implementations are `#[inline(always)]`, so that they become
    /// part of a function that may use the instructions.
    fn run<L: Lanes>(self, lanes: L) -> Self::Output;
}

/// Runs a kernel with the instructions chosen.
#[inline(always)]
pub(crate) fn run<K: Kernel>(kernel: K) -> K::Output {
    // SAFETY: what is chosen is here.
    unsafe { run_unchecked(Isa::chosen(), kernel) }
}

/// Runs a kernel with these instructions, or plainly if they are not here.
#[cfg(test)]
pub(crate) fn run_on<K: Kernel>(isa: Isa, kernel: K) -> K::Output {
    let isa = if isa.is_here() { isa } else { Isa::Plain };
    // SAFETY: it is here.
    unsafe { run_unchecked(isa, kernel) }
}

/// Kernels are handed on by their address: a copy of one that has just been written would
/// wait until it is in memory, as long as a product with a tiny matrix takes.
///
/// # Safety
///
/// The instructions must be there.
#[inline(always)]
unsafe fn run_unchecked<K: Kernel>(isa: Isa, kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    unsafe fn avx2<K: Kernel>(kernel: *const K) -> K::Output {
        // SAFETY: the caller's.
        unsafe { kernel.read() }.run(Avx2(()))
    }
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx512f,avx512vl,avx2")]
    unsafe fn avx512<K: Kernel>(kernel: *const K) -> K::Output {
        // SAFETY: the caller's.
        unsafe { kernel.read() }.run(Avx512(()))
    }
    #[inline(never)]
    unsafe fn plain<K: Kernel>(kernel: *const K) -> K::Output {
        // SAFETY: the caller's.
        unsafe { kernel.read() }.run(Plain)
    }
    let kernel = ManuallyDrop::new(kernel);
    let kernel: *const K = &raw const *kernel;
    // SAFETY: it is read once, and not dropped here; the caller has detected the
    // instructions.
    unsafe {
        match isa {
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => avx512(kernel),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => avx2(kernel),
            _ => plain(kernel),
        }
    }
}

/// Operations on eight doubles (`V`), on comparisons of them (`M`) and on eight
/// indices (`I`).
pub(crate) trait Lanes: Copy {
    type V: Copy;
    type M: Copy;
    type I: Copy;

    fn splat(self, x: f64) -> Self::V;
    fn load(self, x: &Eight) -> Self::V;
    /// Eight of 32 bits, as doubles: exact.
    fn load_single(self, x: &[f32; LANES]) -> Self::V;
    fn store(self, v: Self::V, out: &mut Eight);
    /// Writes past the caches, if `out` is a line of them; else as [`store`](Self::store). For
    /// what is not read soon: a line need not be fetched to be written. After the last one
    /// comes [`fence`](Self::fence).
    #[inline(always)]
    fn stream(self, v: Self::V, out: &mut Eight) {
        self.store(v, out);
    }
    /// After this, what was streamed is seen by all as anything else.
    #[inline(always)]
    fn fence(self) {}
    fn add(self, a: Self::V, b: Self::V) -> Self::V;
    fn sub(self, a: Self::V, b: Self::V) -> Self::V;
    fn mul(self, a: Self::V, b: Self::V) -> Self::V;
    fn div(self, a: Self::V, b: Self::V) -> Self::V;
    /// The smaller of each two, `b` if one is NaN.
    fn min(self, a: Self::V, b: Self::V) -> Self::V;
    /// The larger of each two, `b` if one is NaN.
    fn max(self, a: Self::V, b: Self::V) -> Self::V;
    /// a < b, false if one is NaN.
    fn less(self, a: Self::V, b: Self::V) -> Self::M;
    /// a = b, false if one is NaN.
    fn equal(self, a: Self::V, b: Self::V) -> Self::M;
    fn and(self, a: Self::M, b: Self::M) -> Self::M;
    fn or(self, a: Self::M, b: Self::M) -> Self::M;
    fn any(self, m: Self::M) -> bool;
    fn all(self, m: Self::M) -> bool;
    /// `a` where the mask is set, else `b`.
    fn select(self, m: Self::M, a: Self::V, b: Self::V) -> Self::V;

    /// `x[index]` for each of eight.
    ///
    /// # Safety
    ///
    /// `x` has more values than each index says, and at most 2^31 − 1.
    unsafe fn gather(self, x: &[f64], indices: &[u32; LANES]) -> Self::V;

    /// In a loop of few turns: keeps the compiler from writing it out for two turns at a
    /// time, with a branch for what is left.
    #[inline(always)]
    fn turn(self) {}

    fn indices(self, indices: &[u32; LANES]) -> Self::I;
    /// base, base + 1, … base + 7.
    fn ramp(self, base: u32) -> Self::I;
    /// a < b, for indices below 2^31.
    fn index_less(self, a: Self::I, b: Self::I) -> Self::M;
    fn select_index(self, m: Self::M, a: Self::I, b: Self::I) -> Self::I;
    fn store_index(self, i: Self::I, out: &mut [u32; LANES]);

    /// Rows become columns: lane l of result r is lane r of row l.
    fn transpose(self, rows: [Self::V; LANES]) -> [Self::V; LANES];

    /// The lanes one after another.
    #[inline(always)]
    fn to_array(self, v: Self::V) -> Eight {
        let mut out = [0.0; LANES];
        self.store(v, &mut out);
        out
    }

    /// Fewer than eight, with 0 for those that miss.
    #[inline(always)]
    fn load_part(self, x: &[f64]) -> Self::V {
        let mut eight = [0.0; LANES];
        eight[..x.len()].copy_from_slice(x);
        self.load(&eight)
    }

    /// The first lanes, as many as there is room for.
    #[inline(always)]
    fn store_part(self, v: Self::V, out: &mut [f64]) {
        out.copy_from_slice(&self.to_array(v)[..out.len()]);
    }
}

/// Arrays.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Plain;

/// One for each lane. `std::array::from_fn`, written out, is many times as much to compile.
#[inline(always)]
fn lanes<R>(f: impl Fn(usize) -> R) -> [R; LANES] {
    [f(0), f(1), f(2), f(3), f(4), f(5), f(6), f(7)]
}

#[inline(always)]
fn each<T: Copy, R>(a: [T; LANES], b: [T; LANES], f: impl Fn(T, T) -> R) -> [R; LANES] {
    lanes(|l| f(a[l], b[l]))
}

impl Lanes for Plain {
    type V = Eight;
    type M = [bool; LANES];
    type I = [u32; LANES];

    #[inline(always)]
    fn splat(self, x: f64) -> Eight {
        [x; LANES]
    }
    #[inline(always)]
    fn load(self, x: &Eight) -> Eight {
        *x
    }
    #[inline(always)]
    fn load_single(self, x: &[f32; LANES]) -> Eight {
        lanes(|l| f64::from(x[l]))
    }
    #[inline(always)]
    fn store(self, v: Eight, out: &mut Eight) {
        *out = v;
    }
    #[inline(always)]
    fn add(self, a: Eight, b: Eight) -> Eight {
        each(a, b, |a, b| a + b)
    }
    #[inline(always)]
    fn sub(self, a: Eight, b: Eight) -> Eight {
        each(a, b, |a, b| a - b)
    }
    #[inline(always)]
    fn mul(self, a: Eight, b: Eight) -> Eight {
        each(a, b, |a, b| a * b)
    }
    #[inline(always)]
    fn div(self, a: Eight, b: Eight) -> Eight {
        each(a, b, |a, b| a / b)
    }
    #[inline(always)]
    fn min(self, a: Eight, b: Eight) -> Eight {
        each(a, b, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn max(self, a: Eight, b: Eight) -> Eight {
        each(a, b, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn less(self, a: Eight, b: Eight) -> [bool; LANES] {
        each(a, b, |a, b| a < b)
    }
    #[inline(always)]
    fn equal(self, a: Eight, b: Eight) -> [bool; LANES] {
        each(a, b, |a, b| a == b)
    }
    #[inline(always)]
    fn and(self, a: [bool; LANES], b: [bool; LANES]) -> [bool; LANES] {
        each(a, b, |a, b| a & b)
    }
    #[inline(always)]
    fn or(self, a: [bool; LANES], b: [bool; LANES]) -> [bool; LANES] {
        each(a, b, |a, b| a | b)
    }
    #[inline(always)]
    fn any(self, m: [bool; LANES]) -> bool {
        m.iter().fold(false, |any, m| any | m)
    }
    #[inline(always)]
    fn all(self, m: [bool; LANES]) -> bool {
        m.iter().fold(true, |all, m| all & m)
    }
    #[inline(always)]
    fn select(self, m: [bool; LANES], a: Eight, b: Eight) -> Eight {
        lanes(|l| if m[l] { a[l] } else { b[l] })
    }
    #[inline(always)]
    fn transpose(self, rows: [Eight; LANES]) -> [Eight; LANES] {
        lanes(|r| lanes(|l| rows[l][r]))
    }
    #[inline(always)]
    unsafe fn gather(self, x: &[f64], indices: &[u32; LANES]) -> Eight {
        lanes(|l| x[indices[l] as usize])
    }
    #[inline(always)]
    fn indices(self, indices: &[u32; LANES]) -> [u32; LANES] {
        *indices
    }
    #[inline(always)]
    fn ramp(self, base: u32) -> [u32; LANES] {
        lanes(|l| base + l as u32)
    }
    #[inline(always)]
    fn index_less(self, a: [u32; LANES], b: [u32; LANES]) -> [bool; LANES] {
        each(a, b, |a, b| a < b)
    }
    #[inline(always)]
    fn select_index(self, m: [bool; LANES], a: [u32; LANES], b: [u32; LANES]) -> [u32; LANES] {
        lanes(|l| if m[l] { a[l] } else { b[l] })
    }
    #[inline(always)]
    fn store_index(self, i: [u32; LANES], out: &mut [u32; LANES]) {
        *out = i;
    }
}

#[cfg(target_arch = "x86_64")]
pub(crate) use x86::{Avx2, Avx512};

#[cfg(target_arch = "x86_64")]
mod x86;
