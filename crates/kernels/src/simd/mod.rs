//! Eight doubles at a time, with the widest instructions of the machine.
//!
//! A kernel is written once, for any [`Simd`], and compiled for each instruction set; [`run`]
//! chooses one. All add in the same order and none fuses a product with a sum, so that results
//! are the same to the bit with each.
//!
//! Soundness: [`Avx2`] and [`Avx512`] are proofs that the processor has the instructions. Their
//! fields are private to this module, and only [`run_unchecked`] makes them, whose callers pass an
//! [`Isa`] that has been [detected](Isa::is_here).
#![allow(unsafe_code, reason = "instructions that not every machine has")]

mod blocks;
mod portable;
#[cfg(target_arch = "x86_64")]
mod x86;

use std::mem::ManuallyDrop;
use std::sync::OnceLock;

pub(crate) use blocks::{Blocks, BlocksMut, row_block, row_block_ahead, store};
pub(crate) use portable::Portable;
#[cfg(target_arch = "x86_64")]
pub(crate) use x86::{Avx2, Avx512};

/// Number of lanes of a vector.
pub const LANES: usize = 8;

/// Eight doubles.
pub type Eight = [f64; LANES];

/// Operations on vectors of eight doubles (`V`), masks (`M`) and vectors of eight indices (`I`).
pub trait Simd: Copy {
    type V: Copy;
    type M: Copy;
    type I: Copy;

    fn splat(self, x: f64) -> Self::V;
    fn load(self, x: &Eight) -> Self::V;
    /// Eight values of 32 bits, as doubles: exact.
    fn load_f32(self, x: &[f32; LANES]) -> Self::V;
    fn store(self, v: Self::V, out: &mut Eight);
    /// Stores past the caches if `out` is a cache line, for results that are not read soon: the
    /// line need not be fetched. [`fence`](Self::fence) must follow the last one.
    #[inline(always)]
    fn stream(self, v: Self::V, out: &mut Eight) {
        self.store(v, out);
    }
    /// Orders streamed stores before all later ones.
    #[inline(always)]
    fn fence(self) {}
    fn add(self, a: Self::V, b: Self::V) -> Self::V;
    fn sub(self, a: Self::V, b: Self::V) -> Self::V;
    fn mul(self, a: Self::V, b: Self::V) -> Self::V;
    fn div(self, a: Self::V, b: Self::V) -> Self::V;
    /// Lane-wise minimum; `b` if one is NaN.
    fn min(self, a: Self::V, b: Self::V) -> Self::V;
    /// Lane-wise maximum; `b` if one is NaN.
    fn max(self, a: Self::V, b: Self::V) -> Self::V;
    /// a < b, false if one is NaN.
    fn lt(self, a: Self::V, b: Self::V) -> Self::M;
    /// a = b, false if one is NaN.
    fn eq(self, a: Self::V, b: Self::V) -> Self::M;
    fn and(self, a: Self::M, b: Self::M) -> Self::M;
    fn or(self, a: Self::M, b: Self::M) -> Self::M;
    /// Bit l is that of lane l.
    fn bits(self, m: Self::M) -> u8;
    #[inline(always)]
    fn any(self, m: Self::M) -> bool {
        self.bits(m) != 0
    }
    #[inline(always)]
    fn all(self, m: Self::M) -> bool {
        self.bits(m) == u8::MAX
    }
    /// Mask of the lanes above 0 and below a limit.
    #[inline(always)]
    fn is_small(self, v: Self::V, limit: f64) -> Self::M {
        self.and(self.lt(v, self.splat(limit)), self.lt(self.splat(0.0), v))
    }
    /// `a` where the mask is set, else `b`.
    fn select(self, m: Self::M, a: Self::V, b: Self::V) -> Self::V;
    /// Exponents, as doubles, and mantissas from 1 to 2, of normal positive numbers.
    fn split_exponent(self, v: Self::V) -> (Self::V, Self::V);
    /// 2^n of integers from −1022 to 1023, given as n + 1.5 · 2^52.
    fn power_of_two(self, n: Self::V) -> Self::V;

    /// True if there is an instruction for `gather`, which is faster than loads.
    #[inline(always)]
    fn gathers(self) -> bool {
        false
    }
    /// `x[index]` for each of eight indices, by one instruction or by loads.
    ///
    /// # Safety
    ///
    /// All indices must be below `x.len()`, which must not exceed 2^31 − 1.
    unsafe fn gather<const INSTRUCTION: bool>(self, x: &[f64], indices: &[u32; LANES]) -> Self::V;

    /// Keeps the compiler from unrolling a loop of few turns: it does not duplicate assembly, even
    /// if empty.
    #[inline(always)]
    fn no_unroll(self) {}

    fn load_indices(self, indices: &[u32; LANES]) -> Self::I;
    /// base, base + 1, … base + 7.
    fn iota(self, base: u32) -> Self::I;
    /// a < b, for indices below 2^31.
    fn lt_index(self, a: Self::I, b: Self::I) -> Self::M;
    fn select_index(self, m: Self::M, a: Self::I, b: Self::I) -> Self::I;
    fn store_indices(self, i: Self::I, out: &mut [u32; LANES]);

    /// Splats each lane.
    fn broadcast_lanes(self, v: Self::V) -> [Self::V; LANES];

    /// Transposes: lane l of result r is lane r of row l.
    fn transpose(self, rows: [Self::V; LANES]) -> [Self::V; LANES];

    #[inline(always)]
    fn to_array(self, v: Self::V) -> Eight {
        // Through memory, which the compiler replaces by moves between registers where it can.
        let mut out = [0.0; LANES];
        self.store(v, &mut out);
        out
    }

    /// Loads up to eight values, 0 in the other lanes.
    #[inline(always)]
    fn load_partial(self, x: &[f64]) -> Self::V {
        // A copy, as eight doubles from there on may lie beyond the vector.
        let mut eight = [0.0; LANES];
        eight[..x.len()].copy_from_slice(x);
        self.load(&eight)
    }

    /// Stores as many lanes as there is room for, up to eight.
    #[inline(always)]
    fn store_partial(self, v: Self::V, out: &mut [f64]) {
        out.copy_from_slice(&self.to_array(v)[..out.len()]);
    }
}

/// Sum over the lanes, in pairs.
#[inline(always)]
pub(crate) fn total([a, b, c, d, e, f, g, h]: Eight) -> f64 {
    // The parentheses fix the order: the sum is the same to the bit with any instructions, and in
    // the scalar loops of `vector`.
    ((a + b) + (c + d)) + ((e + f) + (g + h))
}

/// Instruction sets, from the plainest to the widest.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Isa {
    /// Arrays, as the compiler vectorises them.
    Portable,
    /// x86-64 with AVX2.
    Avx2,
    /// x86-64 with AVX-512 F and VL.
    Avx512,
}

impl Isa {
    pub(crate) const ALL: [(&'static str, Self); 3] =
        [("plain", Self::Portable), ("avx2", Self::Avx2), ("avx512", Self::Avx512)];

    /// True if the processor has the instruction set.
    pub(crate) fn is_here(self) -> bool {
        #[cfg(target_arch = "x86_64")]
        match self {
            Self::Portable => true,
            Self::Avx2 => is_x86_feature_detected!("avx2"),
            // No processor has AVX-512 without AVX2.
            Self::Avx512 => {
                is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512vl")
            }
        }
        #[cfg(not(target_arch = "x86_64"))]
        matches!(self, Self::Portable)
    }

    /// Returns the widest instruction set of the machine, or a plainer one that the environment
    /// variable `WAYFIX_INSTRUCTIONS` names. Looked up once.
    #[inline(always)]
    pub(crate) fn chosen() -> Self {
        static CHOSEN: OnceLock<Isa> = OnceLock::new();
        #[cfg(test)]
        if let Some(isa) = TESTED.get() {
            return isa;
        }
        *CHOSEN.get_or_init(|| {
            let named = std::env::var("WAYFIX_INSTRUCTIONS").unwrap_or_default();
            let widest = Self::ALL.iter().find(|(name, _)| *name == named);
            let widest = widest.map_or(Self::Avx512, |found| found.1);
            // From the widest: the one that is named may not be available.
            let here = Self::ALL.iter().rev().map(|named| named.1);
            here.into_iter().find(|isa| *isa <= widest && isa.is_here()).unwrap_or(Self::Portable)
        })
    }
}

/// True if gather instructions are faster than eight loads. On AMD's processors (Zen 1 to 5) they
/// are microcode: loads take 25% less time for a whole Viterbi step, 7 to 14% for a smoother.
#[cfg(target_arch = "x86_64")]
fn gathers() -> bool {
    static GATHERS: OnceLock<bool> = OnceLock::new();
    *GATHERS.get_or_init(|| {
        #[allow(unused_unsafe, reason = "safe in later versions of the standard library")]
        // SAFETY: all x86-64 processors have this instruction, and leaf 0 of it.
        let vendor = unsafe { std::arch::x86_64::__cpuid(0) };
        // "Auth" of AuthenticAMD, "Hygo" of HygonGenuine, in the order of bytes in a register.
        ![u32::from_le_bytes(*b"Auth"), u32::from_le_bytes(*b"Hygo")].contains(&vendor.ebx)
    })
}

/// Computation that is written for any instruction set.
pub trait WithSimd {
    type Output;

    /// Runs it. Implementations are `#[inline(always)]`, so that they become part of a function
    /// that may use the instructions.
    fn run<S: Simd>(self, s: S) -> Self::Output;
}

/// Runs a kernel with the chosen instructions.
#[inline(always)]
pub fn run<K: WithSimd>(kernel: K) -> K::Output {
    // SAFETY: `chosen` returns only what `is_here` has detected, or what a test has asserted to be.
    unsafe { run_unchecked(Isa::chosen(), kernel) }
}

/// Defines functions that run generic ones with the chosen instructions: they have the same
/// arguments but the first, `s: impl Simd`. The generic ones are `#[inline(always)]`.
macro_rules! kernels {
    ($(
        $(#[$doc:meta])*
        $vis:vis fn $name:ident = $generic:ident<
            $a:lifetime $(, type $r:ident: $bound:path)? $(, const $n:ident)?
        >($($arg:ident: $type:ty),* $(,)?) -> $out:ty;
    )*) => {$(
        $(#[$doc])*
        $vis fn $name<$a $(, $r: $bound)? $(, const $n: usize)?>($($arg: $type),*) -> $out {
            struct Kernel<$a $(, $r)? $(, const $n: usize)?> {
                $($arg: $type),*
            }
            impl<$a $(, $r: $bound)? $(, const $n: usize)?> $crate::simd::WithSimd
                for Kernel<$a $(, $r)? $(, $n)?>
            {
                type Output = $out;

                #[inline(always)]
                fn run<S: $crate::simd::Simd>(self, s: S) -> $out {
                    $generic(s, $(self.$arg),*)
                }
            }
            // A struct, not a closure: what a closure captures might be loaded in a function of its
            // own, without the instructions.
            $crate::simd::run(Kernel { $($arg),* })
        }
    )*};
}
pub(crate) use kernels;

#[cfg(test)]
thread_local! {
    /// Overrides the instructions of kernels on this thread.
    static TESTED: std::cell::Cell<Option<Isa>> = const { std::cell::Cell::new(None) };
}

/// Calls a function while kernels of this thread use these instructions, which must be available.
#[cfg(test)]
pub(crate) fn with_isa<R>(isa: Isa, call: impl FnOnce() -> R) -> R {
    assert!(isa.is_here());
    TESTED.set(Some(isa));
    let result = call();
    TESTED.set(None);
    result
}

/// Kernels are passed by address: a copy of one that has just been written would wait for the
/// store, as long as a product with a tiny matrix takes.
///
/// # Safety
///
/// The processor must have the instructions.
#[inline(always)]
unsafe fn run_unchecked<K: WithSimd>(isa: Isa, kernel: K) -> K::Output {
    // Functions that may use the instructions. `WithSimd::run` and all that it calls become part of
    // them, as all is `#[inline(always)]`: a function of its own would be compiled without the
    // instructions, and get vectors through memory.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    unsafe fn avx2<K: WithSimd>(kernel: *const K) -> K::Output {
        // SAFETY: the pointer is to the local `kernel` below, which outlives this call. Only this
        // function reads it, and only once.
        unsafe { kernel.read() }.run(Avx2(gathers()))
    }
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx512f,avx512vl,avx2")]
    unsafe fn avx512<K: WithSimd>(kernel: *const K) -> K::Output {
        // SAFETY: the pointer is to the local `kernel` below, which outlives this call. Only this
        // function reads it, and only once.
        unsafe { kernel.read() }.run(Avx512(gathers()))
    }
    // A call, as the other two must be: it would otherwise be part of every caller, for the rare
    // machine that takes it.
    #[inline(never)]
    unsafe fn portable<K: WithSimd>(kernel: *const K) -> K::Output {
        // SAFETY: the pointer is to the local `kernel` below, which outlives this call. Only this
        // function reads it, and only once.
        unsafe { kernel.read() }.run(Portable)
    }
    // The function that reads the kernel owns it afterwards, and drops it.
    let kernel = ManuallyDrop::new(kernel);
    let kernel: *const K = &raw const *kernel;
    // SAFETY: the caller has detected the instructions that the function may use. The address is
    // valid until the end of the call; one of the functions reads the kernel, once, and it is not
    // dropped here.
    unsafe {
        match isa {
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => avx512(kernel),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => avx2(kernel),
            _ => portable(kernel),
        }
    }
}
