//! Integrals of log-concave densities: the incomplete gamma and beta functions, and arcs of a
//! circle, with full precision in either tail.
//!
//! A density has its mode at 0 and is integrated outwards from there by Gauss–Legendre quadrature,
//! in panels over which it falls by a few powers of e, until the rest is below the last digit. In
//! log-odds (for positive numbers, logarithms) the densities are smooth on the scale of 1 and of
//! their own width, whatever their parameters. Each is divided by its integral over the whole line,
//! so no normalising constant is needed.

use std::f64::consts::PI;
use std::sync::LazyLock;

use super::log_excess;

/// A log-concave density on the line, or on part of it, with its mode at 0.
pub(crate) trait LogConcave {
    /// Ends of the support.
    const ENDS: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

    /// Logarithm of the density at u relative to the mode.
    fn log(&self, u: f64) -> f64;

    /// Derivative of the logarithm.
    fn slope(&self, u: f64) -> f64;

    /// Upper bound of the curvature, −1 times the second derivative of the logarithm, between two
    /// points.
    fn max_curvature(&self, from: f64, to: f64) -> f64;
}

/// Density of the log-odds ln(x / (1 − x)) of a beta variable x with shapes a and b, relative to
/// the mode ln(a / b). With an infinite second shape it is that of ln x for a gamma variable x of
/// shape a, relative to ln a. Shapes are above 1e-300, and at least one is above 1e-200.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Odds {
    a: f64,
    b: f64,
    /// a / (a + b)
    mean: f64,
    ln_mean: f64,
    /// True if the shapes were exchanged, so that a ≤ b.
    mirrored: bool,
}

impl Odds {
    pub(crate) fn beta(a: f64, b: f64) -> Self {
        let mirrored = a > b;
        let (a, mut b) = if mirrored { (b, a) } else { (a, b) };
        // Beta(a, b) tends to a gamma distribution as b / a grows. Beyond this limit the two agree
        // wherever a double holds the density.
        if a / (a + b) < 1e-290 {
            b = f64::INFINITY;
        }
        Self { a, b, mean: a / (a + b), ln_mean: a.ln() - (a + b).ln(), mirrored }
    }

    pub(crate) fn gamma(a: f64) -> Self {
        Self::beta(a, f64::INFINITY)
    }

    /// Probabilities that a Student's t variable is further from 0 than e, and that it is nearer.
    pub(crate) fn student(degrees: f64, e: f64) -> [f64; 2] {
        // For a t variable T, x = ν / (ν + T²) is Beta(ν/2, ½). Its odds are ν / T² and those of
        // the mode ν, so |T| = e lies at ln(ν / e²) − ln ν, and small x is large |T|.
        Self::beta(0.5 * degrees, 0.5).tail_probabilities(-2.0 * e.abs().ln())
    }

    /// Probabilities below and above u.
    pub(crate) fn tail_probabilities(&self, u: f64) -> [f64; 2] {
        if self.mirrored {
            let [below, above] = tail_probabilities(self, -u);
            return [above, below];
        }
        tail_probabilities(self, u)
    }
}

/// exp(u) − 1 − u, to full precision also near 0.
fn exp_excess(u: f64) -> f64 {
    if u.abs() > 0.5 {
        return u.exp_m1() - u;
    }
    // Σ u^k / k! from k = 2 onwards: the two terms of the difference would cancel.
    let (mut sum, mut term, mut k) = (0.0, 0.5 * u * u, 3.0);
    while term.abs() > 1e-18 * f64::abs(sum) {
        sum += term;
        term *= u / k;
        k += 1.0;
    }
    sum
}

impl LogConcave for Odds {
    // With s = a / (a + b), ln f = a u − (a + b) ln(1 + s (e^u − 1)), which is 0 at u = 0. As b
    // grows, (a + b) s = a, and the limit is a u − a (e^u − 1).
    fn log(&self, u: f64) -> f64 {
        let &Self { a, b, mean, ln_mean, .. } = self;
        if b == f64::INFINITY {
            return -a * exp_excess(u);
        }
        if u.abs() <= 0.5 {
            // With v = s (e^u − 1) and (a + b) v = a (e^u − 1), the parts linear in u cancel
            // exactly: (a + b) (v − ln(1 + v)) − a (e^u − 1 − u).
            return (a + b) * log_excess(mean * u.exp_m1()) - a * exp_excess(u);
        }
        // Beyond s e^u = e^40 the other term of 1 + s (e^u − 1), 1 − s, is below the last digit,
        // and e^u may overflow.
        let ln_odds = u + ln_mean;
        let denominator = if ln_odds > 40.0 { ln_odds } else { (mean * u.exp_m1()).ln_1p() };
        a * u - (a + b) * denominator
    }

    fn slope(&self, u: f64) -> f64 {
        let &Self { a, b, mean, .. } = self;
        if b == f64::INFINITY {
            return -a * u.exp_m1();
        }
        // a − (a + b) s e^u / (1 + v), where s e^u = v + s: the two a cancel on paper.
        let v = mean * u.exp_m1();
        if v > 1e300 { -b } else { -b * v / (1.0 + v) }
    }

    fn max_curvature(&self, from: f64, to: f64) -> f64 {
        let &Self { a, b, ln_mean, .. } = self;
        if b == f64::INFINITY {
            // The curvature is a e^u, largest at the upper end.
            return a * from.max(to).exp();
        }
        // The curvature is (a + b) x (1 − x), largest where the odds are nearest to even: there
        // u = ln(b / a).
        let middle = (b / (a + b)).ln() - ln_mean;
        let odds = (middle.clamp(from.min(to), from.max(to)) - middle).abs();
        (a + b) * (-odds).exp() / (1.0 + (-odds).exp()).powi(2)
    }
}

/// Density of the angle from the mean direction, for a von Mises distribution of this
/// concentration.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Circle(pub(crate) f64);

impl LogConcave for Circle {
    const ENDS: [f64; 2] = [-PI, PI];

    fn log(&self, u: f64) -> f64 {
        // κ (cos u − 1) = −2 κ sin²(u / 2). √κ is multiplied in before squaring: sin² alone could
        // underflow where κ is large.
        let root = self.0.sqrt() * (0.5 * u).sin();
        -2.0 * root * root
    }

    fn slope(&self, u: f64) -> f64 {
        -self.0 * u.sin()
    }

    fn max_curvature(&self, _: f64, _: f64) -> f64 {
        self.0
    }
}

/// Gauss–Legendre points of a panel.
const POINTS: usize = 16;

/// Largest fall of a density over a panel, in powers of e, at the slope with which the panel
/// starts.
const FALL: f64 = 8.0;

/// Gauss–Legendre nodes in [−1, 1] with their weights.
static NODES: LazyLock<[[f64; 2]; POINTS]> = LazyLock::new(|| {
    std::array::from_fn(|i| {
        let n = POINTS as f64;
        // Newton's method on the Legendre polynomial P_n from the classical guess, which is close
        // enough to reach the i-th root. The recurrence is k P_k = (2k − 1) x P_{k−1} − (k − 1)
        // P_{k−2}, the slope n (x P_n − P_{n−1}) / (x² − 1), and the weight 2 / ((1 − x²) P_n'²)
        // (Abramowitz and Stegun 1964, 22.7.10, 22.8.5 and 25.4.29).
        let mut x = (PI * (i as f64 + 0.75) / (n + 0.5)).cos();
        let mut slope = 1.0;
        for _ in 0..10 {
            let (mut before, mut value) = (1.0, x);
            for k in 2..=POINTS {
                let k = k as f64;
                (before, value) = (value, ((2.0 * k - 1.0) * x * value - (k - 1.0) * before) / k);
            }
            slope = n * (x * value - before) / (x * x - 1.0);
            x -= value / slope;
        }
        [x, 2.0 / ((1.0 - x * x) * slope * slope)]
    })
});

/// Integral from a point outwards to an end at least as far from the mode, relative to the density
/// at the mode.
fn integrate_outwards(f: &impl LogConcave, from: f64, end: f64) -> f64 {
    let direction = if end < from { -1.0 } else { 1.0 };
    let (mut at, mut sum) = (from, 0.0);
    // This limit on the panels is never reached, even where they grow from 1e-320 to 1e320.
    for _ in 0..4000 {
        // At the mode the slope is 0; there the curvature sets the scale.
        let steep = f.slope(at).abs().max(f.max_curvature(at, at).sqrt() * 2.0);
        let rest = (end - at).abs();
        let mut width = rest.min(FALL / steep).min(1e300);
        // Over a width w the logarithm deviates from its tangent by at most curvature · w² / 2, so
        // curvature · w² ≤ 16 bounds the fall by twice `FALL`, and the polynomial of the quadrature
        // follows it. A width above 3 would span too much of an e^u in the logarithm, unless the
        // curvature is below the last digit.
        loop {
            let curvature = f.max_curvature(at, at + direction * width);
            let is_straight = curvature.sqrt() * width <= 4.0;
            if width == 0.0 || (is_straight && (width <= 3.0 || curvature < 1e-18)) {
                break;
            }
            width *= 0.5;
        }
        let half = 0.5 * width;
        let value =
            |[x, weight]: &[f64; 2]| weight * f.log(at + direction * half * (1.0 + x)).exp();
        let part = half * NODES.iter().map(value).sum::<f64>();
        sum += part;
        let next = at + direction * width;
        // The slope only steepens outwards, so what follows is at most of the order of this panel.
        // A point that no longer moves means that the width is below its last digit.
        if part <= 1e-18 * sum || width >= rest || next == at {
            break;
        }
        at = next;
    }
    sum
}

/// Integral between two points, relative to the density at the mode; 0 if they are out of order.
pub(crate) fn mass(f: &impl LogConcave, from: f64, to: f64) -> f64 {
    if from >= to {
        0.0
    } else if to <= 0.0 {
        integrate_outwards(f, to, from)
    } else if from >= 0.0 {
        integrate_outwards(f, from, to)
    } else {
        // Both halves start at the mode (0), so the integrand decreases monotonically along each.
        integrate_outwards(f, 0.0, from) + integrate_outwards(f, 0.0, to)
    }
}

/// Shares of the whole integral below and above a point.
fn tail_probabilities<F: LogConcave>(f: &F, u: f64) -> [f64; 2] {
    let [low, high] = F::ENDS;
    let [below, above] = [mass(f, low, u), mass(f, u, high)];
    // Neither is 1 less the other: the smaller tail keeps all its digits.
    let sum = below + above;
    [below / sum, above / sum]
}
