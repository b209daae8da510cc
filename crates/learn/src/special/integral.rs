//! Integrals of densities whose logarithm is concave: the incomplete gamma and beta functions, and
//! arcs of a circle, with all digits in either tail.
//!
//! A density has its mode at 0 and is integrated away from it, in panels over which it falls by a
//! few powers of e, until what is left is below the last digit. In logarithms of odds (of numbers
//! above 0, their logarithms) the densities are smooth on the scale of 1 and on that of their width,
//! whatever their parameters. They are divided by their whole integrals, so that they need no
//! constants.

use std::f64::consts::PI;
use std::sync::LazyLock;

use super::log_excess;

/// A density on the line, or a part of it, whose logarithm is concave with its mode at 0.
pub(crate) trait LogConcave {
    /// Ends of the part of the line where it is above 0.
    const ENDS: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

    /// Logarithm of the density at u, less that at the mode.
    fn log(&self, u: f64) -> f64;

    /// Derivative of the logarithm.
    fn slope(&self, u: f64) -> f64;

    /// Most that the logarithm bends between two places: a bound of −1 times its second derivative.
    fn bend(&self, from: f64, to: f64) -> f64;
}

/// Logarithm of the odds x / (1 − x) of a number x with the beta distribution of these two shapes,
/// less that of the odds a / b, which are the mode; with an infinite second shape the logarithm of a
/// number with the gamma distribution of shape a, less ln a. Shapes are above 1e-300, and at least one
/// is above 1e-200.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Odds {
    a: f64,
    b: f64,
    /// a / (a + b)
    share: f64,
    ln_share: f64,
    /// True if the shapes have changed places, so that a is not above b.
    mirrored: bool,
}

impl Odds {
    pub(crate) fn beta(a: f64, b: f64) -> Self {
        let mirrored = a > b;
        let (a, mut b) = if mirrored { (b, a) } else { (a, b) };
        // There the density is that of the gamma distribution, wherever it is above 0.
        if a / (a + b) < 1e-290 {
            b = f64::INFINITY;
        }
        Self { a, b, share: a / (a + b), ln_share: a.ln() - (a + b).ln(), mirrored }
    }

    pub(crate) fn gamma(a: f64) -> Self {
        Self::beta(a, f64::INFINITY)
    }

    /// Probabilities that a number with Student's t distribution is further from 0 than e, and that it
    /// is nearer: ν / (ν + e²) has a beta distribution.
    pub(crate) fn student(degrees: f64, e: f64) -> [f64; 2] {
        Self::beta(0.5 * degrees, 0.5).sides(-2.0 * e.abs().ln())
    }

    /// Probabilities below and above u.
    pub(crate) fn sides(&self, u: f64) -> [f64; 2] {
        if self.mirrored {
            let [below, above] = sides(self, -u);
            return [above, below];
        }
        sides(self, u)
    }
}

/// exp(u) − 1 − u, exact also near 0.
fn exp_excess(u: f64) -> f64 {
    if u.abs() > 0.5 {
        return u.exp_m1() - u;
    }
    let (mut sum, mut term, mut k) = (0.0, 0.5 * u * u, 3.0);
    while term.abs() > 1e-18 * f64::abs(sum) {
        sum += term;
        term *= u / k;
        k += 1.0;
    }
    sum
}

impl LogConcave for Odds {
    // With s the share of a, ln f = a u − (a + b) ln(1 + s (e^u − 1)).
    fn log(&self, u: f64) -> f64 {
        let &Self { a, b, share, ln_share, .. } = self;
        if b == f64::INFINITY {
            return -a * exp_excess(u);
        }
        if u.abs() <= 0.5 {
            return (a + b) * log_excess(share * u.exp_m1()) - a * exp_excess(u);
        }
        let ln_odds = u + ln_share;
        let denominator = if ln_odds > 40.0 { ln_odds } else { (share * u.exp_m1()).ln_1p() };
        a * u - (a + b) * denominator
    }

    fn slope(&self, u: f64) -> f64 {
        let &Self { a, b, share, .. } = self;
        if b == f64::INFINITY {
            return -a * u.exp_m1();
        }
        let v = share * u.exp_m1();
        if v > 1e300 { -b } else { -b * v / (1.0 + v) }
    }

    fn bend(&self, from: f64, to: f64) -> f64 {
        let &Self { a, b, ln_share, .. } = self;
        if b == f64::INFINITY {
            return a * from.max(to).exp();
        }
        // (a + b) x (1 − x) at the place nearest to even odds.
        let middle = (b / (a + b)).ln() - ln_share;
        let odds = (middle.clamp(from.min(to), from.max(to)) - middle).abs();
        (a + b) * (-odds).exp() / (1.0 + (-odds).exp()).powi(2)
    }
}

/// Angle from the mean direction of the von Mises distribution with this concentration.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Circle(pub(crate) f64);

impl LogConcave for Circle {
    const ENDS: [f64; 2] = [-PI, PI];

    fn log(&self, u: f64) -> f64 {
        let root = self.0.sqrt() * (0.5 * u).sin();
        -2.0 * root * root
    }

    fn slope(&self, u: f64) -> f64 {
        -self.0 * u.sin()
    }

    fn bend(&self, _: f64, _: f64) -> f64 {
        self.0
    }
}

/// Points of Gauss's quadrature in a panel.
const POINTS: usize = 16;

/// Most powers of e by which a density falls in a panel, near to where it starts.
const FALL: f64 = 8.0;

/// Places from −1 to 1 and weights of Gauss and Legendre, by Newton's method.
static NODES: LazyLock<[[f64; 2]; POINTS]> = LazyLock::new(|| {
    std::array::from_fn(|i| {
        let n = POINTS as f64;
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

/// Integral from a place to an end that is not nearer to the mode, over the value at the mode.
fn outward(f: &impl LogConcave, from: f64, end: f64) -> f64 {
    let direction = if end < from { -1.0 } else { 1.0 };
    let (mut at, mut sum) = (from, 0.0);
    // More panels than there may be: they cover from 1e-320 to 1e320.
    for _ in 0..4000 {
        let steep = f.slope(at).abs().max(f.bend(at, at).sqrt() * 2.0);
        let rest = (end - at).abs();
        let mut width = rest.min(FALL / steep).min(1e300);
        // Exponential parts need short panels, unless they are below the last digit.
        loop {
            let bend = f.bend(at, at + direction * width);
            let is_straight = bend.sqrt() * width <= 4.0;
            if width == 0.0 || (is_straight && (width <= 3.0 || bend < 1e-18)) {
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
        // Also if nothing is left that a double holds.
        if part <= 1e-18 * sum || width >= rest || next == at {
            break;
        }
        at = next;
    }
    sum
}

/// Integral between two places, over the value at the mode; 0 if they are out of order.
pub(crate) fn mass(f: &impl LogConcave, from: f64, to: f64) -> f64 {
    if from >= to {
        0.0
    } else if to <= 0.0 {
        outward(f, to, from)
    } else if from >= 0.0 {
        outward(f, from, to)
    } else {
        outward(f, 0.0, from) + outward(f, 0.0, to)
    }
}

/// Shares of the whole below and above a place.
fn sides<F: LogConcave>(f: &F, u: f64) -> [f64; 2] {
    let [low, high] = F::ENDS;
    let [below, above] = [mass(f, low, u), mass(f, u, high)];
    let sum = below + above;
    [below / sum, above / sum]
}
