//! Loops over vectors that more than one routine needs.
//!
//! Sums run in eight lanes: the compiler can then use vector registers, and
//! the order of the additions, so the result to the bit, is the same on every
//! machine.

const LANES: usize = 8;

/// Adds up the lanes.
#[inline]
fn total(lanes: [f64; LANES]) -> f64 {
    let [a, b, c, d, e, f, g, h] = lanes;
    ((a + b) + (c + d)) + ((e + f) + (g + h))
}

/// Σ xᵢ.
pub(crate) fn sum(x: &[f64]) -> f64 {
    let (chunks, rest) = x.as_chunks::<LANES>();
    let mut lanes = [0.0; LANES];
    for chunk in chunks {
        for l in 0..LANES {
            lanes[l] += chunk[l];
        }
    }
    total(lanes) + rest.iter().sum::<f64>()
}

/// Σ xᵢ yᵢ.
pub(crate) fn dot(x: &[f64], y: &[f64]) -> f64 {
    let ((xs, x_rest), (ys, y_rest)) = (x.as_chunks::<LANES>(), y.as_chunks::<LANES>());
    let mut lanes = [0.0; LANES];
    for (x, y) in xs.iter().zip(ys) {
        for l in 0..LANES {
            lanes[l] += x[l] * y[l];
        }
    }
    total(lanes) + x_rest.iter().zip(y_rest).map(|(x, y)| x * y).sum::<f64>()
}

/// `out = x ∘ y`, and the sum of it.
pub(crate) fn multiply(x: &[f64], y: &[f64], out: &mut [f64]) -> f64 {
    let (outs, out_rest) = out.as_chunks_mut::<LANES>();
    let ((xs, x_rest), (ys, y_rest)) = (x.as_chunks::<LANES>(), y.as_chunks::<LANES>());
    let mut lanes = [0.0; LANES];
    for ((out, x), y) in outs.iter_mut().zip(xs).zip(ys) {
        for l in 0..LANES {
            out[l] = x[l] * y[l];
            lanes[l] += out[l];
        }
    }
    let mut rest = 0.0;
    for ((out, x), y) in out_rest.iter_mut().zip(x_rest).zip(y_rest) {
        *out = x * y;
        rest += *out;
    }
    total(lanes) + rest
}

/// `x *= factor`.
pub(crate) fn scale(x: &mut [f64], factor: f64) {
    x.iter_mut().for_each(|x| *x *= factor);
}

/// `x /= sum`, where `sum` is that of x: makes it a distribution.
///
/// What is below the smallest normal double (2.2e-308) becomes 0. Below it a
/// double has no full precision, and each operation takes a hundred times as
/// long: the far tails of a Gaussian sensor alone would double the time of a
/// step.
pub(crate) fn normalise(x: &mut [f64], sum: f64) {
    let factor = 1.0 / sum;
    for x in x {
        let p = *x * factor;
        *x = if p >= f64::MIN_POSITIVE { p } else { 0.0 };
    }
}

/// The largest of values that are all finite and at least 0, or the index of
/// the first that is not.
pub(crate) fn largest(x: &[f64]) -> Result<f64, usize> {
    let valid = |x: f64| (0.0..=f64::MAX).contains(&x);
    let (chunks, rest) = x.as_chunks::<LANES>();
    let mut lanes = [0.0; LANES];
    let mut all_valid = rest.iter().all(|&x| valid(x));
    for chunk in chunks {
        for l in 0..LANES {
            all_valid &= valid(chunk[l]);
            lanes[l] = if chunk[l] > lanes[l] { chunk[l] } else { lanes[l] };
        }
    }
    if all_valid {
        return Ok(lanes.iter().chain(rest).copied().fold(0.0, f64::max));
    }
    // Only now is it worth while to know which.
    Err(x.iter().position(|&x| !valid(x)).unwrap_or(0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_length_is_handled_to_its_last_element() {
        for n in 0..40_usize {
            let x: Vec<f64> = (1..=n).map(|i| i as f64).collect();
            let y = vec![2.0; n];
            let expected = (n * (n + 1) / 2) as f64;
            assert_eq!(sum(&x), expected);
            assert_eq!(dot(&x, &y), 2.0 * expected);
            let mut out = vec![f64::NAN; n];
            assert_eq!(multiply(&x, &y, &mut out), 2.0 * expected);
            assert!(out.iter().zip(&x).all(|(out, x)| *out == 2.0 * x));
            assert_eq!(largest(&x), Ok(n as f64));
            for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -1e-300] {
                for at in 0..n {
                    let mut x = x.clone();
                    x[at] = bad;
                    assert_eq!(largest(&x), Err(at), "{bad} at {at} of {n}");
                }
            }
        }
    }
}
