//! Eight doubles at a time, with the widest instructions of the machine.
//!
//! A kernel is written once, for any [`Simd`] (`lanes.rs`), and compiled for each instruction set;
//! [`run`] chooses one. All add in the same order and none fuses a product with a sum, so that
//! results are the same to the bit with each.
//!
//! Soundness: methods of [`Avx2`] and [`Avx512`] call intrinsics that not every x86-64 processor
//! has, so a value of either is the proof that this one does. Their fields are private to this
//! module, and only [`run_unchecked`] makes them, whose callers pass an [`Isa`] that has been
//! [detected](Isa::is_here). "`self` proves AVX2" in comments means this.

#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code, reason = "instructions that not every machine has")]
mod avx2;
#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code, reason = "instructions that not every machine has")]
mod avx512;
mod lanes;
#[allow(unsafe_code, reason = "a gather does not check its indices, whatever the instructions")]
mod portable;

use std::mem::ManuallyDrop;
use std::sync::OnceLock;

#[cfg(target_arch = "x86_64")]
use avx2::Avx2;
#[cfg(target_arch = "x86_64")]
use avx512::Avx512;
pub(crate) use lanes::{
    Blocks, BlocksMut, row_block, row_block_ahead, store, store_indices, total,
};
pub use lanes::{Eight, LANES, Simd};
use portable::Portable;

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
