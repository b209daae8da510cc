//! Wrapped Cauchy distribution: turning angles, some of them far from the others.
//!
//! As complex numbers z = e^iΔ, Δ = y − μ, the Möbius transformation (z − ρ) / (1 − ρ z) makes
//! angles of this distribution uniform. For half angles it is
//! tan(Δ'/2) = (1 + ρ) / (1 − ρ) · tan(Δ/2), by which densities, statistics, tails and draws are
//! computed.

use std::f64::consts::{PI, TAU};

use rand::{Rng, RngExt};

use super::Independent;
use super::univariate::{Cumulative, Univariate};
use super::von_mises::{half, wrapped};
use crate::error::{check, check_spread};
use crate::{EmissionError, Tails};

/// Wrapped Cauchy distribution of an angle in radians, such as a turn: more peaked than a
/// [`VonMises`](super::VonMises) distribution, and with heavier tails.
///
/// With mean directions μ_c and concentrations ρ_c, the lengths of the mean vectors, a
/// [family](Self::family) of d angles has
/// p(y) = Π_c (1 − ρ_c²) / (2π (1 + ρ_c² − 2 ρ_c cos(y_c − μ_c))), of finite y_c.
///
/// The family has no finite-dimensional sufficient statistic. A learning step transforms the angles
/// so that their present distribution becomes uniform (McCullagh, 1996), and there maximises the
/// lower bound of Kent and Tyler (1988). So no step lowers the likelihood, and near the maximum
/// each about halves the distance that is left; learned directions are from −π to π. If half of the
/// observations or more are alike, they determine no concentration, an
/// [error](EmissionError::TooFew), unless there is a prior of c
/// [observations](Independent::with_prior).
///
/// ```
/// use wayfix_learn::WrappedCauchy;
/// use wayfix::{Belief, DenseTransition, Hmm, Prior};
///
/// let hmm = Hmm::new(
///     Prior::AtFirstObservation(Belief::uniform(2)?),
///     DenseTransition::from_rows(&[[0.9, 0.1], [0.1, 0.9]])?,
///     WrappedCauchy::family(&[[3.1], [0.0]], &[[0.2], [0.9]])?, // who searches, and who travels
/// )?;
/// // One sharp turn ends no journey.
/// let turns = [[2.0], [-3.0], [1.1], [0.05], [-0.02], [0.01], [2.5], [-0.03], [0.0]];
/// assert_eq!(hmm.viterbi(&turns)?.states(), [0, 0, 0, 1, 1, 1, 1, 1, 1]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WrappedCauchy {
    mean: f64,
    concentration: f64,
    /// Sine and cosine of half the mean.
    half: [f64; 2],
    /// ln((1 − ρ²) / 2π)
    constant: f64,
}

impl WrappedCauchy {
    /// Creates the distribution with this mean direction and concentration.
    ///
    /// # Errors
    ///
    /// [`EmissionError::Parameter`] unless the mean is finite and the concentration from 0 (all
    /// directions equally likely) to below 1.
    pub fn new(mean: f64, concentration: f64) -> Result<Self, EmissionError> {
        let mean = check("mean direction", mean, mean.is_finite(), "a finite value")?;
        let valid = (0.0..1.0).contains(&concentration);
        let rho = check("concentration", concentration, valid, "a value from 0 to below 1")?;
        let constant = ((1.0 - rho) * (1.0 + rho)).ln() - TAU.ln();
        Ok(Self { mean, concentration: rho, half: half(mean), constant })
    }

    /// Creates a family from one row for each state, with the mean direction of each component in
    /// radians, and one with the concentrations.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] for zero states or components, rows of different lengths, a mean that is
    /// not finite, or a concentration that is not at least 0 and below 1.
    pub fn family(
        means: &[impl AsRef<[f64]>],
        concentrations: &[impl AsRef<[f64]>],
    ) -> Result<Independent<Self>, EmissionError> {
        let lists = ["list of means", "list of concentrations"];
        Independent::of_two(lists, means, concentrations, Self::new)
    }

    /// Mean direction μ, in radians.
    #[must_use]
    pub fn mean(&self) -> f64 {
        self.mean
    }

    /// Concentration ρ, the length of the mean vector.
    #[must_use]
    pub fn concentration(&self) -> f64 {
        self.concentration
    }

    /// (1 + ρ) sin(Δ/2) and (1 − ρ) cos(Δ/2) for the angle Δ to μ: sine and cosine of half the
    /// transformed angle, times the root of 1 + ρ² − 2ρ cos Δ.
    fn transformed_half_angle(&self, [y, sin_half, cos_half]: [f64; 3]) -> [f64; 2] {
        let difference = y - self.mean;
        let [sin, cos] = if difference.abs() < 0.25 {
            // Near the mean the addition theorem would cancel.
            half(difference)
        } else {
            let (sin, cos) = (self.half[0], self.half[1]);
            [sin_half * cos - cos_half * sin, cos_half * cos + sin_half * sin]
        };
        [sin * (1.0 + self.concentration), cos * (1.0 - self.concentration)]
    }
}

impl Univariate for WrappedCauchy {
    const VALUES: &'static str = "a finite angle in radians";
    const EXACT: bool = false;
    /// The angle, and sine and cosine of half of it.
    type Point = [f64; 3];
    /// 1, sin Δ' and 1 − cos Δ' of the transformed angle, which is uniform under the present
    /// parameters, and the log density.
    type Statistics = [f64; 4];

    fn point(value: f64) -> Option<[f64; 3]> {
        let [sin, cos] = half(value);
        value.is_finite().then_some([value, sin, cos])
    }

    fn log_density(&self, &y: &[f64; 3]) -> f64 {
        let [sin, cos] = self.transformed_half_angle(y);
        self.constant - (sin * sin + cos * cos).ln()
    }

    #[inline]
    fn statistics(&self, &y: &[f64; 3]) -> [f64; 4] {
        let [sin, cos] = self.transformed_half_angle(y);
        let square = sin * sin + cos * cos;
        [1.0, 2.0 * sin * cos / square, 2.0 * sin * sin / square, self.constant - square.ln()]
    }

    // The mean vector z of a wrapped Cauchy distribution transforms as each angle does, to
    // (z − ρ) / (1 − ρ z), and E ln |1 − ρ e^iΔ|² is ln |1 − ρ z|²: both functions are harmonic.
    fn expectations(&self, of: &Self) -> [f64; 4] {
        let (rho, other) = (self.concentration, of.concentration);
        let sin_half = of.half[0] * self.half[1] - of.half[1] * self.half[0];
        let cos_half = of.half[1] * self.half[1] + of.half[0] * self.half[0];
        let (sin, rest) = (2.0 * sin_half * cos_half, 2.0 * sin_half * sin_half);
        // The real part of 1 − ρ z, z = r e^iδ, is 1 − ρ r + ρ r (1 − cos δ), which does not
        // cancel.
        let real = (1.0 - rho * other) + rho * other * rest;
        let imaginary = -rho * other * sin;
        let square = real * real + imaginary * imaginary;
        // 1 less the quotient is (1 + ρ) (1 − z) / (1 − ρ z).
        let (a, b) = ((1.0 - other) + other * rest, -other * sin);
        let share = (1.0 + rho) / square;
        let less = share * (a * real + b * imaginary);
        let sine = -share * (b * real - a * imaginary);
        [1.0, sine, less, self.constant - square.ln()]
    }

    fn expected_log_density(&self, &[_, _, _, log]: &[f64; 4]) -> f64 {
        log
    }

    fn maximize(&self, sums: &[f64; 4]) -> Result<Self, EmissionError> {
        let [_, sin, rest, _] = sums.map(|sum| sum / sums[0]);
        let variance = 2.0 * rest - rest * rest - sin * sin; // 1 − length²
        check_spread("concentration", sums[0], variance, 1.0)?;
        // The bound of Kent and Tyler at a uniform start has its maximum at the vector η where η /
        // (1 − |η|²) is the mean vector of the data. Here η = 2 z / (1 + |z|²) for the mean vector
        // z of the distribution. `eta` and `share` are |η| and |z| over the length of the mean
        // vector.
        let (cos, length) = (1.0 - rest, sin.hypot(1.0 - rest));
        let eta = 2.0 / (1.0 + (2.0 * length).hypot(1.0));
        let share = eta / (1.0 + ((1.0 - eta * length) * (1.0 + eta * length)).sqrt());
        // Back to the original angles: (z + ρ) / (1 + ρ z), and 1 less its squared length, which is
        // (1 − ρ²) (1 − |z|²) / |1 + ρ z|² without cancellation.
        let (rho, x, y) = (self.concentration, share * cos, share * sin);
        let (above, below) = ((rho + x, y), (1.0 + rho * x, rho * y));
        let square = below.0 * below.0 + below.1 * below.1;
        let complement = (1.0 - rho) * (1.0 + rho) * (1.0 - x * x - y * y) / square;
        let concentration = if complement < 0.5 {
            (1.0 - complement).sqrt()
        } else {
            above.0.hypot(above.1) / square.sqrt()
        };
        // Closer to 1 there is hardly a double left, so the concentration counts as without a
        // maximum below 1.
        check_spread("concentration", sums[0], 1.0 - concentration, 1.0)?;
        let change = above.1.atan2(above.0) - below.1.atan2(below.0);
        Self::new(wrapped(wrapped(self.mean) + change), concentration)
    }

    fn free_parameters(&self) -> usize {
        2
    }

    fn draw<R: Rng + ?Sized>(&self, rng: &mut R) -> f64 {
        // The inverse transformation of a uniform angle.
        let [sin, cos] = half(TAU * (rng.random::<f64>() - 0.5));
        let (a, b) = (1.0 - self.concentration, 1.0 + self.concentration);
        wrapped(wrapped(self.mean) + 2.0 * (sin * a).atan2(cos * b))
    }
}

impl Cumulative for WrappedCauchy {
    /// Probabilities between −π and y and between y and π.
    fn tails(&self, y: f64) -> Tails {
        let (y, mean) = (y.clamp(-PI, PI), wrapped(self.mean));
        let (less, more) = (1.0 - self.concentration, 1.0 + self.concentration);
        // Half the arc between two transformed angles, over π. It is the angle between the vectors
        // ((1 − ρ) cos, (1 + ρ) sin) of their halves, from cross and dot product.
        let share = |from: f64, to: f64| {
            let [a, b] = [from, to].map(|angle| half(angle - mean));
            let sin = less * more * (0.5 * (to - from)).sin();
            sin.atan2(less * less * (a[1] * b[1]) + more * more * (a[0] * b[0])) / PI
        };
        Tails::between([share(-PI, y), share(y, PI)])
    }

    fn principal(value: f64) -> f64 {
        wrapped(value)
    }
}

#[cfg(feature = "serde")]
wayfix::stored! {
    [] WrappedCauchy for Independent<self::WrappedCauchy>: [], |family| {
        means: Vec<Vec<f64>> = family.parameters(self::WrappedCauchy::mean),
        concentrations: Vec<Vec<f64>> = family.parameters(self::WrappedCauchy::concentration),
        missing: bool = family.takes_missing(),
        prior: Option<(Independent<self::WrappedCauchy>, f64)> = family.prior(),
    } => self::WrappedCauchy::family(&means, &concentrations)
        .and_then(|new| crate::independent::with_settings(new, missing, prior));
}
