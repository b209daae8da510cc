//! Sums of vectors, each times its factor.

use super::lanes::{Eight, Kernel, LANES, Lanes, run};

/// Number of vectors that are gone through side by side.
pub(crate) const TERMS: usize = 4;

/// `out = Σ` of factors times vectors, which are as long.
pub(crate) fn combine(out: &mut [f64], terms: &[(f64, &[f64])]) {
    run(Combine { out, terms, keep: false });
}

/// `out += Σ` of factors times vectors, which are as long.
pub(crate) fn add_combined(out: &mut [f64], terms: &[(f64, &[f64])]) {
    run(Combine { out, terms, keep: true });
}

struct Combine<'a> {
    out: &'a mut [f64],
    terms: &'a [(f64, &'a [f64])],
    /// True to add to what is there.
    keep: bool,
}

impl Kernel for Combine<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self { out, terms, mut keep } = self;
        let (fours, rest) = terms.as_chunks::<TERMS>();
        for terms in fours {
            add(lanes, out, terms, keep);
            keep = true;
        }
        match *rest {
            [a, b, c] => add(lanes, out, &[a, b, c], keep),
            [a, b] => add(lanes, out, &[a, b], keep),
            [a] => add(lanes, out, &[a], keep),
            _ if keep => {}
            _ => out.fill(0.0),
        }
    }
}

#[inline(always)]
fn add<L: Lanes, const C: usize>(
    lanes: L,
    out: &mut [f64],
    terms: &[(f64, &[f64]); C],
    keep: bool,
) {
    let count = out.len();
    let factors: [L::V; C] = std::array::from_fn(|c| lanes.splat(terms[c].0));
    let (outs, out_rest) = out.as_chunks_mut::<LANES>();
    let whole: [&[Eight]; C] =
        std::array::from_fn(|c| &terms[c].1[..count].as_chunks::<LANES>().0[..outs.len()]);
    for (number, out) in outs.iter_mut().enumerate() {
        let mut sum = if keep { lanes.load(out) } else { lanes.splat(0.0) };
        for c in 0..C {
            sum = lanes.add(sum, lanes.mul(lanes.load(&whole[c][number]), factors[c]));
        }
        lanes.store(sum, out);
    }
    for (at, out) in (count - out_rest.len()..).zip(out_rest) {
        *out = if keep { *out } else { 0.0 };
        for (factor, x) in terms {
            *out += factor * x[at];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_are_those_of_the_definition() {
        for n in 0..40_u8 {
            let x: Vec<Vec<f64>> = (0..9)
                .map(|t| (0..n).map(|i| f64::from(u16::from(i) * 7 + t) * 0.5).collect())
                .collect();
            for count in 0..9 {
                let terms: Vec<(f64, &[f64])> =
                    (1..).map(f64::from).zip(x[..count].iter().map(Vec::as_slice)).collect();
                let mut out = vec![3.0; n.into()];
                add_combined(&mut out, &terms);
                let sum = |i: usize| terms.iter().map(|(f, x)| f * x[i]).sum::<f64>();
                assert!(out.iter().enumerate().all(|(i, out)| *out == 3.0 + sum(i)));
                combine(&mut out, &terms);
                assert!(out.iter().enumerate().all(|(i, out)| *out == sum(i)));
            }
        }
    }
}
