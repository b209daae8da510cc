//! Distributions of durations, by the ratios of their successive probabilities.
//!
//! Each family is given by r_d = p(d + 1) / p(d). The inverse hazard m_d = P(D ≥ d) / p(d) is then
//! 1 + r_d m_{d+1}: a backward recursion with positive terms. So the hazard 1 / m_d and its
//! complement r_d m_{d+1} / m_d keep all their digits, however small the probabilities are. Beyond
//! the oldest age the ratio stays constant, which gives the recursion its start.

use crate::error::{OutOfRange, TransitionError};
use crate::free_parameters::Displacement;

/// Distribution of the number of steps of a stay, d = 1, 2, …, by parameters that can be learned.
///
/// ```
/// use wayfix::transition::{Durations, DwellTransition};
/// use wayfix::SparseTransition;
///
/// // A lift stands for 20 steps on average, and travels for 5, hardly ever for 1 or for 15.
/// let moves = SparseTransition::from_rows(&[[0.0, 1.0], [1.0, 0.0]])?;
/// let stands = Durations::Geometric { mean: 20.0 };
/// let travels = Durations::ShiftedPoisson { mean: 5.0 };
/// let lift = DwellTransition::from_durations(moves, &[stands, travels], 40)?;
/// assert_eq!(lift.durations(1), Some(Durations::ShiftedPoisson { mean: 5.0 }));
/// # Ok::<(), wayfix::TransitionError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
#[non_exhaustive]
pub enum Durations {
    /// p(d) = (1 − 1/m)^(d − 1) / m: a stay ends with the same probability at each step.
    Geometric {
        /// The mean m, at least 1.
        mean: f64,
    },
    /// d − 1 has a Poisson distribution.
    ShiftedPoisson {
        /// Mean of d, at least 1.
        mean: f64,
    },
    /// d − 1 has a negative binomial distribution, p(d) ∝ Γ(r + d − 1) / (d − 1)! q^(d − 1) with
    /// q = (m − 1) / (m − 1 + r), and variance m − 1 + (m − 1)² / r.
    NegativeBinomial {
        /// Mean m of d, at least 1.
        mean: f64,
        /// The size r, above 0; 1 is a geometric distribution.
        size: f64,
    },
    /// p(d) ∝ d^(a − 1) exp(−d / s): the gamma density at whole numbers of steps, normalised.
    Gamma {
        /// The shape a, above 0.
        shape: f64,
        /// The scale s in steps, above 0.
        scale: f64,
    },
}

impl Durations {
    /// r_d = p(d + 1) / p(d).
    fn ratio(self, d: f64) -> f64 {
        match self {
            Self::Geometric { mean } => (mean - 1.0) / mean,
            Self::ShiftedPoisson { mean } => (mean - 1.0) / d,
            Self::NegativeBinomial { mean, size } => {
                let q = (mean - 1.0) / (mean - 1.0 + size);
                q * ((size + d - 1.0) / d)
            }
            Self::Gamma { shape, scale } => {
                ((shape - 1.0) * d.recip().ln_1p() - scale.recip()).exp()
            }
        }
    }

    /// Checks the parameters of a place with `longest` ages.
    pub(super) fn check(self, place: usize, longest: usize) -> Result<(), TransitionError> {
        let check = |what: &str, value: f64, least: f64, expected| {
            let valid = value.is_finite() && value >= least;
            let what = || format!("the {what} of the durations in place {place}");
            if valid { Ok(()) } else { Err(OutOfRange::new(what(), value, expected)) }
        };
        let mean = |mean| check("mean", mean, 1.0, "a finite value of at least 1");
        let positive =
            |what, value| check(what, value, f64::MIN_POSITIVE, "a finite value above 0");
        match self {
            Self::Geometric { mean: m } | Self::ShiftedPoisson { mean: m } => mean(m)?,
            Self::NegativeBinomial { mean: m, size } => {
                mean(m)?;
                positive("size", size)?;
            }
            Self::Gamma { shape, scale } => {
                positive("shape", shape)?;
                positive("scale", scale)?;
            }
        }
        // A geometric tail needs a ratio below 1: ages must reach beyond the mode. (The ratio of a
        // geometric distribution with a huge mean may round to 1; its tail is known without it.)
        let ratio = self.ratio(longest as f64);
        if ratio < 1.0 || matches!(self, Self::Geometric { .. }) {
            return Ok(());
        }
        let what =
            format!("the ratio p({}) / p({longest}) of durations in place {place}", longest + 1);
        Err(OutOfRange::new(what, ratio, "a value below 1: more ages than the likeliest stay")
            .into())
    }

    /// Calls a function with the hazard and its complement for each step from `longest` down to 1.
    pub(super) fn for_each_hazard(self, longest: usize, mut take: impl FnMut(usize, f64, f64)) {
        // m_d − 1, kept without the 1 so that small tails have all their digits. It starts with the
        // tail of a constant ratio r, where m = 1 + r m, so m − 1 = r / (1 − r).
        let mut more = if let Self::Geometric { mean } = self {
            mean - 1.0
        } else {
            let ratio = self.ratio(longest as f64);
            ratio / (1.0 - ratio)
        };
        for d in (1..=longest).rev() {
            if d < longest {
                more = self.ratio(d as f64) * (1.0 + more);
            }
            take(d, (1.0 + more).recip(), more / (1.0 + more));
        }
    }

    /// Log-likelihood of the numbers of stays that ended at each step, and of those that went on.
    /// The hazard of the last step holds for all later ones.
    fn log_likelihood(self, ended: &[f64], went_on: &[f64]) -> f64 {
        let mut sum = 0.0;
        self.for_each_hazard(ended.len(), |d, hazard, rest| {
            // 0 ln 0 is 0: what never happened may be impossible.
            let term = |weight: f64, p: f64| if weight == 0.0 { 0.0 } else { weight * p.ln() };
            sum += term(ended[d - 1], hazard) + term(went_on[d - 1], rest);
        });
        sum
    }

    /// Number of parameters.
    pub(super) fn parameters(self) -> usize {
        match self {
            Self::Geometric { .. } | Self::ShiftedPoisson { .. } => 1,
            Self::NegativeBinomial { .. } | Self::Gamma { .. } => 2,
        }
    }

    /// Returns the distribution with displaced parameters.
    pub(super) fn displaced(self, by: &mut Displacement<'_>) -> Self {
        let mut above_one = |mean: f64| 1.0 + by.positive(mean - 1.0);
        match self {
            Self::Geometric { mean } => Self::Geometric { mean: above_one(mean) },
            Self::ShiftedPoisson { mean } => Self::ShiftedPoisson { mean: above_one(mean) },
            Self::NegativeBinomial { mean, size } => {
                Self::NegativeBinomial { mean: above_one(mean), size: by.positive(size) }
            }
            Self::Gamma { shape, scale } => {
                Self::Gamma { shape: by.positive(shape), scale: by.positive(scale) }
            }
        }
    }

    /// Returns the parameters that make these stays most probable, near the present ones.
    pub(super) fn maximize(self, ended: &[f64], went_on: &[f64]) -> Self {
        let likelihood = |durations: Self| {
            let valid = durations.check(0, ended.len()).is_ok();
            if valid { durations.log_likelihood(ended, went_on) } else { f64::NEG_INFINITY }
        };
        let best = match self {
            Self::Geometric { .. } => {
                let (ended, on): (f64, f64) = (ended.iter().sum(), went_on.iter().sum());
                // Closed form: each step is a trial with success probability 1 / mean. If no stay
                // ended, the likelihood rises with the mean without bound.
                if ended < f64::MIN_POSITIVE {
                    self
                } else {
                    Self::Geometric { mean: 1.0 + on / ended }
                }
            }
            // The others are searched in logarithms of the parameters, which are then unbounded.
            Self::ShiftedPoisson { mean } => {
                let of = |x: f64| Self::ShiftedPoisson { mean: 1.0 + x.exp() };
                of(maximum((mean - 1.0).ln(), |x| likelihood(of(x))).0)
            }
            Self::NegativeBinomial { mean, size } => {
                let of =
                    |x: f64, y: f64| Self::NegativeBinomial { mean: 1.0 + x.exp(), size: y.exp() };
                let (x, y) =
                    maximum_of_two([(mean - 1.0).ln(), size.ln()], |x, y| likelihood(of(x, y)));
                of(x, y)
            }
            Self::Gamma { shape, scale } => {
                // Searched over the mean of the density and the shape, which are nearly
                // independent.
                let of = |x: f64, y: f64| Self::Gamma { shape: y.exp(), scale: (x - y).exp() };
                let start = [(shape * scale).ln(), shape.ln()];
                let (x, y) = maximum_of_two(start, |x, y| likelihood(of(x, y)));
                of(x, y)
            }
        };
        // EM must not lower the likelihood: a search that ended at a worse point is discarded.
        if likelihood(best) >= likelihood(self) { best } else { self }
    }
}

/// Bound on the magnitude of the logarithms of parameters.
const LIMIT: f64 = 18.0;
/// The larger part of a golden section.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// Maximum of a function of two numbers: over the first one for each value of the second.
fn maximum_of_two([x, y]: [f64; 2], f: impl Fn(f64, f64) -> f64) -> (f64, f64) {
    // The profile max over x of f(x, y) is maximised over y. Each inner search starts where the
    // last one ended, since nearby y have nearby maxima.
    let mut last = x;
    let (y, _) = maximum(y, |y| {
        let (x, value) = maximum(last, |x| f(x, y));
        last = x;
        value
    });
    (maximum(last, |x| f(x, y)).0, y)
}

/// Maximum of a unimodal function near `start`: a bracket by steps that double, then golden
/// section, until values around the maximum differ by less than their rounding.
fn maximum(start: f64, mut f: impl FnMut(f64) -> f64) -> (f64, f64) {
    let start = start.clamp(-LIMIT, LIMIT);
    let (mut middle, mut best) = (start, f(start));
    let mut bracket = [start; 2];
    // Invariant: f(middle) = best is the largest value seen. On each side, a better point becomes
    // the middle, and the previous middle the opposite end of the bracket. A point that is not
    // better stays as the near end.
    for (side, sign) in [(0, -1.0), (1, 1.0)] {
        let mut step = 0.1;
        loop {
            let next = (middle + sign * step).clamp(-LIMIT, LIMIT);
            let value = f(next);
            bracket[side] = next;
            if value <= best || next.abs() >= LIMIT {
                if value > best {
                    (middle, best) = (next, value);
                }
                break;
            }
            bracket[1 - side] = middle;
            (middle, best) = (next, value);
            step *= 2.0;
        }
    }
    // Golden section: of the inner points a < b, the one with the lower value becomes an end, and
    // the other one is an inner point of what is left. So each round takes one evaluation.
    let [mut low, mut high] = bracket;
    let (mut a, mut b) = (high - GOLDEN * (high - low), low + GOLDEN * (high - low));
    let (mut at_a, mut at_b) = (f(a), f(b));
    while high - low > 1e-9 * (1.0 + middle.abs()) {
        if at_a >= at_b {
            (high, b, at_b) = (b, a, at_a);
            a = high - GOLDEN * (high - low);
            at_a = f(a);
        } else {
            (low, a, at_a) = (a, b, at_b);
            b = low + GOLDEN * (high - low);
            at_b = f(b);
        }
    }
    let (x, value) = if at_a >= at_b { (a, at_a) } else { (b, at_b) };
    if value > best { (x, value) } else { (middle, best) }
}
