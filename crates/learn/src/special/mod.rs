//! Special functions, accurate to the last digits over the whole range of their arguments.
//!
//! Families ask for small differences of large logarithms: u − ln(1 + u), ln a − ψ(a), the error of
//! Stirling's formula, 1 less a ratio of Bessel functions. Each is a function of its own here, from
//! a series where the large terms have cancelled on paper; the difference itself would lose
//! digits.

mod integral;
#[cfg(test)]
mod tests;

pub(super) use integral::{Circle, Odds, mass};

use std::f64::consts::{FRAC_2_PI, TAU};
use std::sync::LazyLock;

/// u − ln(1 + u) for u ≥ −1: 0 at 0, positive elsewhere, and ∞ at −1.
///
/// Near 0 by the series of ln(1 + u) = 2 artanh(u / (2 + u)), whose first term cancels exactly.
pub(super) fn log_excess(u: f64) -> f64 {
    if !(-0.4..=0.6).contains(&u) {
        return if u == f64::INFINITY { u } else { u - u.ln_1p() };
    }
    // With v = u / (2 + u), ln(1 + u) = 2 v + 2 v³ Σ v^2k / (2k + 3), and u − 2 v = u v. In this
    // range |v| ≤ 1/4, so v² ≤ 1/16.
    let v = u / (2.0 + u);
    let square = v * v;
    u * v - 2.0 * v * square * artanh_rest(square)
}

/// Σ x^k / (2 k + 3) for x ≤ 1/16: sixteen terms, after which the rest is below 1e-19.
///
/// By Estrin's scheme: pairs of terms are independent, where Horner's waits for each.
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

/// (u − ln(1 + u)) / u², which falls from ∞ at −1 through ½ at 0 to 0.
pub(super) fn excess_ratio(u: f64) -> f64 {
    // ½ − u/3 + u²/4 − …: for so small a u the third term is below the last digit, and u² might
    // underflow.
    if u.abs() < 1e-8 { 0.5 - u / 3.0 } else { log_excess(u) / u / u }
}

/// ln(1 + 1 / a) for a > 0, also where 1 / a overflows.
fn ln_next(a: f64) -> f64 {
    if a < 1.0 { a.ln_1p() - a.ln() } else { a.recip().ln_1p() }
}

/// Argument above which the asymptotic series are accurate to the last digit.
const ASYMPTOTIC: f64 = 16.0;

/// Error of Stirling's formula, ln Γ(a) − (a − ½) ln a + a − ½ ln 2π, for a > 0.
///
/// The asymptotic series (Abramowitz and Stegun 1964, 6.1.40); below 16 by recurrence.
pub(super) fn stirling(mut a: f64) -> f64 {
    // Γ(a + 1) = a Γ(a), so the errors at a and a + 1 differ by (a + ½) ln(1 + 1 / a) − 1.
    let mut sum = 0.0;
    while a < ASYMPTOTIC {
        sum += (a + 0.5) * ln_next(a) - 1.0;
        a += 1.0;
    }
    let (x, square) = (a.recip(), a.powi(-2));
    // Horner in 1 / a²: 1 / 12a − 1 / 360a³ + 1 / 1260a⁵ − 1 / 1680a⁷ + 1 / 1188a⁹.
    let series = [-1.0 / 1680.0, 1.0 / 1260.0, -1.0 / 360.0, 1.0 / 12.0];
    sum + x * series.iter().fold(1.0 / 1188.0, |sum, term| sum * square + term)
}

/// 2^52, above which doubles are whole numbers.
pub(super) const TWO_POW_52: f64 = (1_u64 << 52) as f64;

/// Number of factorials in the table, from 0! onwards.
const TABULATED: usize = 256;

static FACTORIALS: LazyLock<[(f64, f64); TABULATED]> =
    LazyLock::new(|| std::array::from_fn(|n| computed_ln_factorial(n as f64)));

/// ln(n!) of a whole number n, and ln(n!) − n (ln n − 1).
#[inline]
pub(super) fn ln_factorial(n: f64) -> (f64, f64) {
    if n < TABULATED as f64 {
        // The low bits of the double 2^52 + n are n itself. A cast would saturate, which costs a
        // comparison. The remainder proves the index in bounds.
        FACTORIALS[(n + TWO_POW_52).to_bits() as usize % TABULATED]
    } else {
        computed_ln_factorial(n)
    }
}

fn computed_ln_factorial(n: f64) -> (f64, f64) {
    if n == 0.0 {
        return (0.0, 0.0);
    }
    // n! = n Γ(n), so Stirling's formula is n (ln n − 1) + ½ ln(2π n) and its error.
    let rest = 0.5 * (TAU * n).ln() + stirling(n);
    (if n == 1.0 { 0.0 } else { n * (n.ln() - 1.0) + rest }, rest)
}

/// ln a − ψ(a), which falls from ∞ to 0, with its derivative with respect to ln a.
///
/// Asymptotic series (Abramowitz and Stegun 1964, 6.3.18); below 16 by the recurrence of ψ.
pub(super) fn ln_minus_digamma(start: f64) -> (f64, f64) {
    let (mut a, mut value, mut slope) = (start, 0.0, 0.0);
    // ψ(a + 1) = ψ(a) + 1 / a, so the values at a and a + 1 differ by 1 / a − ln(1 + 1 / a), whose
    // derivative is −1 / (a² (a + 1)). For the whole sum d / d ln a is `start` times d / da.
    while a < ASYMPTOTIC {
        value += if a < 1.0 { a.recip() - ln_next(a) } else { log_excess(a.recip()) };
        slope -= start / a / (a * (a + 1.0));
        a += 1.0;
    }
    let (x, square) = (a.recip(), a.powi(-2));
    // 1 / 2a + 1 / 12a² − 1 / 120a⁴ + 1 / 252a⁶ − 1 / 240a⁸ + 1 / 132a¹⁰, and its derivative.
    let series = [-1.0 / 240.0, 1.0 / 252.0, -1.0 / 120.0, 1.0 / 12.0];
    value += 0.5 * x + square * series.iter().fold(1.0 / 132.0, |sum, term| sum * square + term);
    let series = [-1.0 / 42.0, 1.0 / 30.0, -1.0 / 6.0];
    let series = series.iter().fold(1.0 / 30.0, |sum, term| sum * square + term);
    slope += start * square * (x * series - 0.5);
    (value, slope)
}

/// The a at which ln a − ψ(a) has this value, above 0.
pub(super) fn inverse_ln_minus_digamma(value: f64, start: f64) -> f64 {
    // The function falls as 1 / a for small a and as 1 / 2a for large a: its logarithm is nearly
    // linear in ln a, with a slope of −1 at both ends, so Newton's method there needs no bracket.
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

/// ln(Γ(a + h) / (Γ(a) a^h)) for k = 2 h components, by Stirling's formula and its error.
pub(super) fn ln_rising(a: f64, k: usize) -> f64 {
    let h = k as f64 / 2.0;
    // The large part is (a + h − ½) ln(1 + h/a) − h. With ln(1 + r) = r − log_excess(r) and r = h/a
    // its linear terms leave (h − ½) r.
    let ratio = h / a;
    (h - 0.5) * ratio - (a + h - 0.5) * log_excess(ratio) + stirling(a + h) - stirling(a)
}

/// Modified Bessel function of the first kind, I_ν(x), and the ratio of two neighbouring orders.
pub(super) struct Bessel {
    /// ln(exp(−x) x^−ν I_ν(x)), which is finite at x = 0.
    pub(super) log: f64,
    /// I_{ν+1}(x) / I_ν(x).
    pub(super) ratio: f64,
    /// 1 − I_{ν+1}(x) / I_ν(x).
    pub(super) complement: f64,
}

impl Bessel {
    /// Computes the values for a finite x ≥ 0 and an order ν ≥ 0 that is a multiple of ½. O(ν + √x)
    /// where x < 2ν², otherwise O(1).
    pub(super) fn new(order: f64, x: f64) -> Self {
        if x >= (2.0 * order * order).max(40.0) {
            hankel(order, x)
        } else {
            downward_recurrence(order, x)
        }
    }
}

/// Hankel's expansion for large arguments (Abramowitz and Stegun 1964, 9.7.1).
fn hankel(order: f64, x: f64) -> Bessel {
    // I_ν(x) = e^x / √(2πx) · S_ν, and the k-th term of S_ν is the previous one times ((2k − 1)² −
    // 4ν²) / 8kx. The first terms of S_ν and S_{ν+1} are both 1: the sum of the differences of the
    // others gives 1 − S_{ν+1} / S_ν with all its digits.
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

/// Ratios of neighbouring orders by downward recurrence, which is stable, from a bound of Amos
/// (1974) at an order high enough that the starting value is forgotten. Their product leads down to
/// order 0 or ½.
fn downward_recurrence(order: f64, x: f64) -> Bessel {
    let above = ((order * order + 40.0 * x).sqrt() - order).ceil() + 20.0;
    let mut k = order + above;
    // r_k = I_{k+1}(x) / (x I_k(x)). From I_{k−1} = (2k / x) I_k + I_{k+1} follows
    // r_{k−1} = 1 / (2k + x² r_k).
    let mut ratio = (k + 0.5 + x.hypot(k + 1.5)).recip();
    while k > order {
        ratio = (2.0 * k + x * x * ratio).recip();
        k -= 1.0;
    }
    let found = x * ratio;
    // Further down, the product of the r_k is x^−ν I_ν(x) divided by the same expression for order
    // 0 or ½. Its logarithm is taken before the product underflows.
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
    // x^−½ I_½(x) = √(2/π) sinh(x) / x. Order 0 comes from Hankel's expansion or the power series.
    log += if k == 0.5 {
        0.5 * FRAC_2_PI.ln() + if x == 0.0 { 0.0 } else { (-(-2.0 * x).exp_m1() / (2.0 * x)).ln() }
    } else if x >= 40.0 {
        hankel(0.0, x).log
    } else {
        power_series(x).ln() - x
    };
    // As x < 2ν² or x < 40, 1 less the ratio is at least about 1 / 2ν, and loses few digits.
    Bessel { log, ratio: found, complement: 1.0 - found }
}

/// I_0(x) = Σ ((x/2)^k / k!)², whose terms are all positive.
fn power_series(x: f64) -> f64 {
    let (mut sum, mut term, mut k) = (1.0, 1.0, 1.0);
    while term > 1e-18 * sum {
        term *= (0.5 * x / k).powi(2);
        sum += term;
        k += 1.0;
    }
    sum
}

/// Solves f(x) = 0 for x > 0 by Newton's method in ln x, kept within a bracket. `f` rises with x;
/// it returns its value and its derivative with respect to ln x.
pub(super) fn root(start: f64, f: impl Fn(f64) -> (f64, f64)) -> f64 {
    // Invariant: f(low) < 0 < f(high), where 0 and ∞ stand for bounds not yet found.
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
        // A flat f gives steps beyond the range of doubles, which are cut.
        let mut next = x * step.clamp(-20.0, 20.0).exp();
        if !(next > low && next < high) {
            // Bisection in ln x, or a factor of 16, down or up, towards a side without a bound.
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
