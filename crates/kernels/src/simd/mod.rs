//! Eight doubles at a time, with the widest instructions of the machine.
//!
//! A kernel is written once, for any [`Simd`], and compiled for each instruction set;
//! [`run`] chooses one. All add in the same order and none fuses a product with a sum, so that
//! results are the same to the bit with each.
//!
//! Soundness: methods of [`Avx2`] and [`Avx512`] call intrinsics that not every x86-64 processor
//! has, so a value of either is the proof that this one does. Their fields are private to this
//! module, and only [`run_unchecked`] makes them, whose callers pass an [`Isa`] that has been
//! [detected](Isa::is_here). "`self` proves AVX2" in comments means this. Of the operations of [`Simd`]
//! only a gather is unsafe, whose caller vouches for the indices, and a hint to the caches, which
//! takes an address.
//!
//! A loop over many lines runs in [parts](run_in_parts) that several threads can share. Where they end,
//! and how their results are joined, depends only on the number of lines: results are the same to
//! the bit for any number of threads, and without the feature `rayon`.

#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code, reason = "instructions that not every machine has")]
mod avx2;
#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code, reason = "instructions that not every machine has")]
mod avx512;
#[allow(unsafe_code, reason = "a gather does not check its indices, whatever the instructions")]
mod portable;

use std::mem::ManuallyDrop;
use std::sync::OnceLock;

#[cfg(target_arch = "x86_64")]
use avx2::Avx2;
#[cfg(target_arch = "x86_64")]
use avx512::Avx512;
use portable::Portable;

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
    #[allow(unsafe_code, reason = "an index is not checked: that would cost a fifth of a product")]
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
        // A copy, as eight doubles may reach beyond the vector.
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

/// A slice in blocks of eight, and the rest.
pub(crate) type Blocks<'a> = (&'a [Eight], &'a [f64]);
pub(crate) type BlocksMut<'a> = (&'a mut [Eight], &'a mut [f64]);

/// Loads the block with this number, or the rest.
#[inline(always)]
pub(crate) fn row_block<S: Simd>(s: S, (blocks, rest): Blocks<'_>, number: usize) -> S::V {
    // One comparison both checks the index and tells whole blocks from the rest.
    match blocks.get(number) {
        Some(block) => s.load(block),
        None => s.load_partial(rest),
    }
}

/// Loads as [`row_block`], and asks the caches for a block further on: for vectors that are new in
/// each step and are read beside many other streams, such as those of a matrix, so that the
/// processor does not detect one more. With `BEYOND` it also asks for blocks beyond the vector,
/// which belong to the next row if rows are contiguous.
#[inline(always)]
pub(crate) fn row_block_ahead<S: Simd, const BEYOND: bool>(
    s: S,
    blocks: Blocks<'_>,
    number: usize,
) -> S::V {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        /// Distance in blocks from a load to the block that is asked for: more than the time of a
        /// cache miss, in steps on a large map (16 was fastest on Zen 4, 48 nearly as fast).
        const AHEAD: usize = 16;
        let number = number + AHEAD;
        let number = if BEYOND { number } else { number.min(blocks.0.len()) };
        let ahead = blocks.0.as_ptr().wrapping_add(number);
        #[allow(unsafe_code, reason = "a hint that takes an address")]
        // SAFETY: a hint, part of all x86-64 processors. It takes any address, and reads nothing
        // that a program could see.
        unsafe {
            _mm_prefetch::<_MM_HINT_T0>(ahead.cast());
        }
    }
    row_block(s, blocks, number)
}

/// Stores to the block with this number, or to the rest.
#[inline(always)]
pub(crate) fn store<S: Simd>(s: S, (blocks, rest): &mut BlocksMut<'_>, number: usize, v: S::V) {
    match blocks.get_mut(number) {
        Some(block) => s.store(v, block),
        None => s.store_partial(v, rest),
    }
}

/// Stores indices to the block with this number, or to the rest.
#[inline(always)]
pub(crate) fn store_indices<S: Simd>(
    s: S,
    (blocks, rest): &mut (&mut [[u32; LANES]], &mut [u32]),
    block: usize,
    indices: S::I,
) {
    if let Some(block) = blocks.get_mut(block) {
        s.store_indices(indices, block);
    } else {
        // Lanes beyond the last row also have an index: only those of rows are copied.
        let mut last = [0; LANES];
        s.store_indices(indices, &mut last);
        rest.copy_from_slice(&last[..rest.len()]);
    }
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
            // Searched from the widest down, since the named one may not be available.
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
        #[allow(unsafe_code, reason = "an instruction that reads the processor's name")]
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
#[allow(unsafe_code, reason = "instructions that not every machine has")]
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

/// Lines of a part: a multiple of eight.
pub(crate) const PART: usize = 4096 * LANES;

/// Fewest lines for several threads: waking them takes time.
#[cfg(feature = "rayon")]
const PARALLEL: usize = 3 * PART;

/// Kernel over independent lines.
pub(crate) trait Splits: WithSimd<Output: Send> + Sized + Send {
    /// Number of lines.
    fn lines(&self) -> usize;

    /// Splits before this line, a multiple of eight.
    fn split(self, at: usize) -> (Self, Self);

    /// Joins the results of two parts.
    fn join(first: Self::Output, second: Self::Output) -> Self::Output;
}

/// Runs a kernel with the chosen instructions, on several threads if there are many lines.
#[inline(always)]
pub(crate) fn run_in_parts<K: Splits>(kernel: K) -> K::Output {
    // This test comes first, as most models are one part, and should pay nothing for the others.
    let lines = kernel.lines();
    if lines <= PART {
        return run(kernel);
    }
    #[cfg(feature = "rayon")]
    if lines >= PARALLEL {
        return on_threads(kernel);
    }
    in_turn(kernel)
}

/// Splits in the middle, at the end of a part.
fn halves<K: Splits>(kernel: K) -> (K, K) {
    // Half of the parts, rounded up: at least one, and less than all, as there are two or more. The
    // middle depends only on the number of lines, so any number of threads adds sums in one order.
    let middle = kernel.lines().div_ceil(2 * PART) * PART;
    kernel.split(middle)
}

pub(crate) fn in_turn<K: Splits>(kernel: K) -> K::Output {
    if kernel.lines() <= PART {
        return run(kernel);
    }
    // Not all lines in one run: that would add sums in another order than threads do.
    let (first, second) = halves(kernel);
    K::join(in_turn(first), in_turn(second))
}

#[cfg(feature = "rayon")]
fn on_threads<K: Splits>(kernel: K) -> K::Output {
    if kernel.lines() <= PART {
        return run(kernel);
    }
    let (first, second) = halves(kernel);
    let (first, second) = rayon::join(|| on_threads(first), || on_threads(second));
    K::join(first, second)
}

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
#[allow(unsafe_code, reason = "instructions that not every machine has, a kernel read by address")]
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
    // Never inlined, as the other two can't be: this would otherwise be part of every caller, for
    // the rare machine that takes it.
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
