//! Linear combinations of vectors, several in a pass, so that `out` is read and written once for
//! them. The order of additions is the same in all instruction sets.

use crate::kernels::{Eight, LANES, Simd, WithSimd, run};

/// Number of vectors taken side by side.
const TERMS: usize = 4;

/// Sets `out` to the sum of factors times vectors of its length.
pub(crate) fn combine(out: &mut [f64], terms: &[(f64, &[f64])]) {
    run(Combine { out, terms, keep: false });
}

/// Adds factors times vectors of its length to `out`.
pub(crate) fn add_combined(out: &mut [f64], terms: &[(f64, &[f64])]) {
    run(Combine { out, terms, keep: true });
}

struct Combine<'a> {
    out: &'a mut [f64],
    terms: &'a [(f64, &'a [f64])],
    /// True to add to what is there.
    keep: bool,
}

impl WithSimd for Combine<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Self { out, terms, mut keep } = self;
        let (fours, rest) = terms.as_chunks::<TERMS>();
        for terms in fours {
            add(s, out, terms, keep);
            keep = true;
        }
        match *rest {
            [a, b, c] => add(s, out, &[a, b, c], keep),
            [a, b] => add(s, out, &[a, b], keep),
            [a] => add(s, out, &[a], keep),
            _ if keep => {}
            _ => out.fill(0.0),
        }
    }
}

#[inline(always)]
fn add<S: Simd, const C: usize>(s: S, out: &mut [f64], terms: &[(f64, &[f64]); C], keep: bool) {
    let count = out.len();
    let factors: [S::V; C] = std::array::from_fn(|c| s.splat(terms[c].0));
    let (outs, out_rest) = out.as_chunks_mut::<LANES>();
    let whole: [&[Eight]; C] =
        std::array::from_fn(|c| &terms[c].1[..count].as_chunks::<LANES>().0[..outs.len()]);
    for (number, out) in outs.iter_mut().enumerate() {
        let mut sum = if keep { s.load(out) } else { s.splat(0.0) };
        for c in 0..C {
            sum = s.add(sum, s.mul(s.load(&whole[c][number]), factors[c]));
        }
        s.store(sum, out);
    }
    for (at, out) in (count - out_rest.len()..).zip(out_rest) {
        *out = if keep { *out } else { 0.0 };
        for (factor, x) in terms {
            *out += factor * x[at];
        }
    }
}
