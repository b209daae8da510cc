//! Special functions, to the last digits over the whole range of their arguments.

mod integral;
#[cfg(test)]
mod tests;

pub(super) use integral::{Circle, Odds, mass};

use std::f64::consts::{FRAC_2_PI, TAU};
use std::sync::LazyLock;

/// u − ln(1 + u), which is 0 at 0 and above it elsewhere, for u ≥ −1; ∞ at −1.
///
/// Near 0 by the series of 2 artanh(u / (2 + u)) = ln(1 + u), whose first term is taken out
/// exactly.
pub(super) fn log_excess(u: f64) -> f64 {
    if !(-0.4..=0.6).contains(&u) {
        return if u == f64::INFINITY { u } else { u - u.ln_1p() };
    }
    let v = u / (2.0 + u);
    let square = v * v;
    u * v - 2.0 * v * square * artanh_rest(square)
}

/// Σ x^k / (2 k + 3), for x up to 1/16, where terms from the sixteenth on are below 1e-19.
///
/// By pairs of terms, as Estrin does: a sum term by term waits for each.
fn artanh_rest(x: f64) -> f64 {
    let pair = |k: u32| {
        let of = |k: u32| 1.0 / f64::from(2 * k + 3);
        of(k) + x * of(k + 1)
    };
    let x2 = x * x;
    let x4 = x2 * x2;
    let four = |k: u32| pair(k) + x2 * pair(k + 2);
    let eight = |k: u32| four(k) + x4 * four(k + 4);
    eight(0) + x4 * x4 * eight(8)
}

/// (u − ln(1 + u)) / u², which falls from ∞ at −1 by ½ at 0 to 0.
pub(super) fn excess_ratio(u: f64) -> f64 {
    // There the square of u may underflow, and its next term is below the last digit.
    if u.abs() < 1e-8 { 0.5 - u / 3.0 } else { log_excess(u) / u / u }
}

/// ln(1 + 1 / a) for a > 0, also where 1 / a is beyond the range of doubles.
fn ln_next(a: f64) -> f64 {
    if a < 1.0 { a.ln_1p() - a.ln() } else { a.recip().ln_1p() }
}

/// Argument from which on the asymptotic series hold to the last digit.
const ASYMPTOTIC: f64 = 16.0;

/// Error of Stirling's formula, ln Γ(a) − (a − ½) ln a + a − ½ ln 2π, for a > 0.
///
/// Binet's series (Abramowitz and Stegun 1964, 6.1.40); below 16 by its recurrence.
pub(super) fn stirling(mut a: f64) -> f64 {
    let mut sum = 0.0;
    while a < ASYMPTOTIC {
        sum += (a + 0.5) * ln_next(a) - 1.0;
        a += 1.0;
    }
    let (x, square) = (a.recip(), a.powi(-2));
    let series = [-1.0 / 1680.0, 1.0 / 1260.0, -1.0 / 360.0, 1.0 / 12.0];
    sum + x * series.iter().fold(1.0 / 1188.0, |sum, term| sum * square + term)
}

/// 2^52: doubles from here on have no fraction.
pub(super) const INTEGERS: f64 = (1_u64 << 52) as f64;

/// Number of factorials that are kept, of 0 and the counts after it.
const KEPT: usize = 256;

static FACTORIALS: LazyLock<[(f64, f64); KEPT]> =
    LazyLock::new(|| std::array::from_fn(|n| computed_ln_factorial(n as f64)));

/// ln(n!) of a whole number n, and n (ln n − 1) less than that.
#[inline]
pub(super) fn ln_factorial(n: f64) -> (f64, f64) {
    if n < KEPT as f64 {
        // The last bits of 2^52 + n are those of n; a cast would be checked.
        FACTORIALS[(n + INTEGERS).to_bits() as usize % KEPT]
    } else {
        computed_ln_factorial(n)
    }
}

fn computed_ln_factorial(n: f64) -> (f64, f64) {
    if n == 0.0 {
        return (0.0, 0.0);
    }
    let rest = 0.5 * (TAU * n).ln() + stirling(n);
    (if n == 1.0 { 0.0 } else { n * (n.ln() - 1.0) + rest }, rest)
}

/// ln a − ψ(a), which falls from ∞ to 0, and its derivative with respect to ln a.
///
/// Asymptotic series (Abramowitz and Stegun 1964, 6.3.18); below 16 by the recurrence of ψ.
pub(super) fn ln_minus_digamma(start: f64) -> (f64, f64) {
    let (mut a, mut value, mut slope) = (start, 0.0, 0.0);
    while a < ASYMPTOTIC {
        value += if a < 1.0 { a.recip() - ln_next(a) } else { log_excess(a.recip()) };
        slope -= start / a / (a * (a + 1.0));
        a += 1.0;
    }
    let (x, square) = (a.recip(), a.powi(-2));
    let series = [-1.0 / 240.0, 1.0 / 252.0, -1.0 / 120.0, 1.0 / 12.0];
    value += 0.5 * x + square * series.iter().fold(1.0 / 132.0, |sum, term| sum * square + term);
    let series = [-1.0 / 42.0, 1.0 / 30.0, -1.0 / 6.0];
    let series = series.iter().fold(1.0 / 30.0, |sum, term| sum * square + term);
    slope += start * square * (x * series - 0.5);
    (value, slope)
}

/// The a at which ln a − ψ(a) has this value, above 0. It falls as 1 / a, and as 1 / 2a for large
/// a, so that Newton's method on logarithms is nearly exact.
pub(super) fn inverse_ln_minus_digamma(value: f64, start: f64) -> f64 {
    let mut log = start.ln();
    for _ in 0..50 {
        let (found, slope) = ln_minus_digamma(log.exp());
        let step = (value / found).ln() * found / slope;
        log += step;
        if step.abs() <= 1e-14 * log.abs().max(1.0) {
            break;
        }
    }
    log.exp()
}

/// ln(Γ(a + h) / (Γ(a) a^h)) for k = 2 h components, by Stirling's formula with its error, in
/// which what is large cancels.
pub(super) fn ln_rising(a: f64, k: usize) -> f64 {
    let h = k as f64 / 2.0;
    let ratio = h / a;
    (h - 0.5) * ratio - (a + h - 0.5) * log_excess(ratio) + stirling(a + h) - stirling(a)
}

/// Modified Bessel function I of the first kind.
pub(super) struct Bessel {
    /// ln(exp(−x) x^−ν I_ν(x)), which is finite at 0.
    pub(super) log: f64,
    /// I_{ν+1}(x) / I_ν(x), and 1 less that.
    pub(super) ratio: f64,
    pub(super) complement: f64,
}

impl Bessel {
    /// Returns the values for a finite x ≥ 0 and an order ν ≥ 0 that is a multiple of ½. O(ν + √x)
    /// where x < 2ν², otherwise O(1).
    pub(super) fn new(order: f64, x: f64) -> Self {
        if x >= (2.0 * order * order).max(40.0) { hankel(order, x) } else { recur(order, x) }
    }
}

/// Hankel's expansion for large arguments (Abramowitz and Stegun 1964, 9.7.1).
fn hankel(order: f64, x: f64) -> Bessel {
    let (mut sum, mut difference) = (1.0, 0.0);
    let (mut term, mut next) = (1.0, 1.0);
    for k in 1..60 {
        let k = f64::from(k);
        let odd = 2.0 * k - 1.0;
        let factor = |order: f64| (odd - 2.0 * order) * (odd + 2.0 * order) / k / 8.0 / x;
        term *= factor(order);
        next *= factor(order + 1.0);
        sum += term;
        difference += term - next;
        if f64::max(term.abs(), next.abs()) < 1e-18 / x {
            break;
        }
    }
    let complement = difference / sum;
    let log = sum.ln() - 0.5 * TAU.ln() - (order + 0.5) * x.ln();
    Bessel { log, ratio: 1.0 - complement, complement }
}

/// Ratios of neighbouring orders by the recurrence downward, which is stable; it starts so far up
/// that its start, between the bounds of Amos (1974), is forgotten. Their product leads to order 0
/// or ½.
fn recur(order: f64, x: f64) -> Bessel {
    let above = ((order * order + 40.0 * x).sqrt() - order).ceil() + 20.0;
    let mut k = order + above;
    // I_{k+1}(x) / (x I_k(x))
    let mut ratio = (k + 0.5 + x.hypot(k + 1.5)).recip();
    while k > order {
        ratio = (2.0 * k + x * x * ratio).recip();
        k -= 1.0;
    }
    let found = x * ratio;
    let (mut log, mut product) = (0.0, 1.0);
    while k >= 1.0 {
        ratio = (2.0 * k + x * x * ratio).recip();
        k -= 1.0;
        product *= ratio;
        if product < 1e-200 {
            log += f64::ln(product);
            product = 1.0;
        }
    }
    log += product.ln();
    log += if k == 0.5 {
        0.5 * FRAC_2_PI.ln() + if x == 0.0 { 0.0 } else { (-(-2.0 * x).exp_m1() / (2.0 * x)).ln() }
    } else if x >= 40.0 {
        hankel(0.0, x).log
    } else {
        power_series(x).ln() - x
    };
    Bessel { log, ratio: found, complement: 1.0 - found }
}

/// I_0(x), whose series has no cancellation.
fn power_series(x: f64) -> f64 {
    let (mut sum, mut term, mut k) = (1.0, 1.0, 1.0);
    while term > 1e-18 * sum {
        term *= (0.5 * x / k).powi(2);
        sum += term;
        k += 1.0;
    }
    sum
}

/// Solves f(x) = 0 for x > 0, by Newton's method in ln x within a bracket. `f` returns its value,
/// which rises with x, and its derivative with respect to ln x.
pub(super) fn root(start: f64, f: impl Fn(f64) -> (f64, f64)) -> f64 {
    let (mut low, mut high) = (0.0, f64::INFINITY);
    let mut x = start;
    for _ in 0..200 {
        let (value, slope) = f(x);
        if value < 0.0 {
            low = x;
        } else if value > 0.0 {
            high = x;
        } else {
            break;
        }
        let step = -value / slope;
        let mut next = x * step.clamp(-20.0, 20.0).exp();
        if !(next > low && next < high) {
            next = if low == 0.0 {
                high / 16.0
            } else {
                f64::sqrt(low) * high.min(low * 256.0).sqrt()
            };
        }
        let moved = (next - x).abs();
        x = next;
        if moved <= 2.0 * f64::EPSILON * x || high - low <= 2.0 * f64::EPSILON * x {
            break;
        }
    }
    x
}
