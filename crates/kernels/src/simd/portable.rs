//! Arrays of eight, which the compiler vectorises as far as the target has vectors (SSE2, NEON,
//! WebAssembly's).
//!
//! Each operation gives the bits that the instructions of AVX2 and AVX-512 give, for NaN, infinite
//! values and zeros of either sign, too.

use super::{Eight, LANES, Simd};

/// Arrays.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Portable;

/// One value for each lane. `std::array::from_fn` takes many times longer to compile.
#[inline(always)]
fn lanes<R>(f: impl Fn(usize) -> R) -> [R; LANES] {
    [f(0), f(1), f(2), f(3), f(4), f(5), f(6), f(7)]
}

#[inline(always)]
fn mask(set: bool) -> u64 {
    if set { u64::MAX } else { 0 }
}

/// Methods that treat each lane alike.
macro_rules! lanewise {
    ($($name:ident: $in:ty => $out:ty, |$a:ident, $b:ident| $lane:expr;)*) => {$(
        #[inline(always)]
        fn $name(self, a: [$in; LANES], b: [$in; LANES]) -> [$out; LANES] {
            lanes(|l| {
                let ($a, $b) = (a[l], b[l]);
                $lane
            })
        }
    )*};
}

impl Simd for Portable {
    type V = Eight;
    /// All bits of a lane set, or none: comparisons are vectorised as well.
    type M = [u64; LANES];
    type I = [u32; LANES];

    lanewise! {
        add: f64 => f64, |a, b| a + b;
        sub: f64 => f64, |a, b| a - b;
        mul: f64 => f64, |a, b| a * b;
        div: f64 => f64, |a, b| a / b;
        // Not `f64::min`: that returns the number if one is NaN, whereas the instruction returns
        // the second operand.
        min: f64 => f64, |a, b| if a < b { a } else { b };
        max: f64 => f64, |a, b| if a > b { a } else { b };
        lt: f64 => u64, |a, b| mask(a < b);
        eq: f64 => u64, |a, b| mask(a == b);
        and: u64 => u64, |a, b| a & b;
        or: u64 => u64, |a, b| a | b;
        lt_index: u32 => u64, |a, b| mask(a < b);
    }

    #[inline(always)]
    fn splat(self, x: f64) -> Eight {
        [x; LANES]
    }
    #[inline(always)]
    fn load(self, x: &Eight) -> Eight {
        *x
    }
    #[inline(always)]
    fn store(self, v: Eight, out: &mut Eight) {
        *out = v;
    }
    #[inline(always)]
    fn bits(self, m: [u64; LANES]) -> u8 {
        // All bits of a lane are alike: the lowest stands for all of them.
        (0..LANES).fold(0, |bits, l| bits | ((m[l] & 1) << l) as u8)
    }
    #[inline(always)]
    fn any(self, m: [u64; LANES]) -> bool {
        m.iter().fold(0, |any, m| any | m) != 0
    }
    #[inline(always)]
    fn select(self, m: [u64; LANES], a: Eight, b: Eight) -> Eight {
        // Bits, not branches: the compiler does not vectorise a choice that may be a jump.
        lanes(|l| f64::from_bits(a[l].to_bits() & m[l] | b[l].to_bits() & !m[l]))
    }
    #[inline(always)]
    fn split_exponent(self, v: Eight) -> (Eight, Eight) {
        // The double 2^52 + e has the exponent e in its last bits. So the conversion from integers,
        // which SSE2 lacks for 64 bits, is a subtraction.
        const WHOLE: f64 = (1_u64 << 52) as f64;
        let exponent = |x: f64| f64::from_bits(x.to_bits() >> 52 | WHOLE.to_bits());
        let mantissa = |x: f64| f64::from_bits(x.to_bits() & (u64::MAX >> 12) | 1.0_f64.to_bits());
        (lanes(|l| exponent(v[l]) - (WHOLE + 1023.0)), lanes(|l| mantissa(v[l])))
    }
    #[inline(always)]
    fn power_of_two(self, n: Eight) -> Eight {
        // The last bits are those of n: shifted to the exponent and added to the bits of 1, they
        // make 2^n.
        lanes(|l| f64::from_bits((n[l].to_bits() << 52).wrapping_add(1.0_f64.to_bits())))
    }
    #[inline(always)]
    fn broadcast_lanes(self, v: Eight) -> [Eight; LANES] {
        lanes(|l| [v[l]; LANES])
    }
    #[inline(always)]
    fn transpose(self, rows: [Eight; LANES]) -> [Eight; LANES] {
        // Unrolled to 64 moves, which the compiler combines into the target's shuffles if it can.
        lanes(|r| lanes(|l| rows[l][r]))
    }
    #[inline(always)]
    unsafe fn gather<const INSTRUCTION: bool>(self, x: &[f64], indices: &[u32; LANES]) -> Eight {
        // SAFETY: the caller promises that all indices are below the number of values of x.
        lanes(|l| unsafe { *x.get_unchecked(indices[l] as usize) })
    }
    #[inline(always)]
    fn load_indices(self, indices: &[u32; LANES]) -> [u32; LANES] {
        *indices
    }
    #[inline(always)]
    fn iota(self, base: u32) -> [u32; LANES] {
        lanes(|l| base + l as u32)
    }
    #[inline(always)]
    fn select_index(self, m: [u64; LANES], a: [u32; LANES], b: [u32; LANES]) -> [u32; LANES] {
        lanes(|l| a[l] & m[l] as u32 | b[l] & !m[l] as u32)
    }
    #[inline(always)]
    fn store_indices(self, i: [u32; LANES], out: &mut [u32; LANES]) {
        *out = i;
    }
}
