//! Curvature of an objective at its maximum, by central differences ("Standard errors" in section 9
//! of the [formulas](wayfix::guide::formulas)).
//!
//! Each coordinate has its own step, along which the objective falls by a few thousandths of a nat:
//! a few hundredths of the standard error of that parameter given the others. Differences at this
//! step and at half of it are extrapolated (Richardson 1911), so that the error of a second
//! derivative is of fourth order in the step, that is, of second order in the fall. The error by
//! rounding is inversely proportional to the fall, which is chosen so that both are small.

use wayfix::inference::LearnError;
use wayfix::internal::parallel;
use wayfix::internal::{ParameterScale, cholesky};

/// Longest step along a logarithm. However little information there is, derivatives of all orders
/// have the same size; at this step the sixth contributes 1e-7 of the difference.
const LONGEST: f64 = 0.1;
/// Least share of its information that a parameter must keep given the others, to be told apart
/// from them. It exceeds the error of differences, which may be 1e-7 of the information.
const LEAST_PIVOT: f64 = 1e-6;
/// Largest gain, in nats, by which the model may fall short of the maximum: half a nat is one
/// standard error.
const GAIN: f64 = 0.5;
/// Upper bound on the relative rounding error of an objective.
const ROUNDING: f64 = 1e-12;

/// An objective as a function of coordinates, relative to its value at 0.
pub(super) struct Objective<F> {
    /// Difference of the objective at the coordinates from that at 0.
    pub(super) difference: F,
    /// Scale of each coordinate.
    pub(super) scales: Vec<ParameterScale>,
    /// Sum of the sizes of the terms of the objective.
    pub(super) size: f64,
}

/// Reason for missing information.
pub(super) enum Fault {
    /// The objective does not change along this coordinate.
    Flat(usize),
    /// The objective rises along this coordinate.
    Rises(usize),
    /// The objective could not be evaluated.
    Failed(LearnError),
}

impl From<LearnError> for Fault {
    fn from(error: LearnError) -> Self {
        Self::Failed(error)
    }
}

/// Information of the coordinates that are not at a bound.
pub(super) struct Information {
    /// Numbers of these coordinates.
    pub(super) coordinates: Vec<usize>,
    /// Step along each of them.
    pub(super) steps: Vec<f64>,
    /// Root of the information of each of them.
    pub(super) scales: Vec<f64>,
    /// Cholesky factor of the information in units of 1 / scale.
    factor: Vec<f64>,
}

/// Differences along one coordinate.
#[derive(Clone, Copy)]
struct LineDifferences {
    step: f64,
    /// Sums of the objective at ± the step and at ± half of it.
    sums: [f64; 2],
    gradient: f64,
    information: f64,
}

/// Extrapolates differences at a step and at half of it: cancels their error of second order.
pub(super) fn extrapolated([whole, half]: [f64; 2]) -> f64 {
    (4.0 * half - whole) / 3.0
}

impl<F: Fn(&[f64]) -> Result<f64, LearnError> + Sync> Objective<F> {
    /// Computes the information, by O(p) evaluations of the objective to find steps and 2 p² more,
    /// with O(p²) memory and O(p³) operations.
    pub(super) fn information(&self) -> Result<Information, Fault> {
        let all: Vec<usize> = (0..self.scales.len()).collect();
        let lines = parallel::map(all, |at, (): &mut ()| self.along(at));
        let lines = lines.into_iter().collect::<Result<Vec<Option<LineDifferences>>, Fault>>()?;
        let kept = lines.into_iter().enumerate().filter_map(|(at, line)| Some((at, line?)));
        let (coordinates, lines): (Vec<usize>, Vec<LineDifferences>) = kept.unzip();
        let (p, row) = (coordinates.len(), |i: usize, (): &mut ()| {
            (0..i)
                .map(|j| self.mixed([coordinates[i], coordinates[j]], [lines[i], lines[j]]))
                .collect::<Result<Vec<f64>, LearnError>>()
        });
        let rows = parallel::map((0..p).collect(), row);
        let scales: Vec<f64> = lines.iter().map(|line| line.information.sqrt()).collect();
        // Scaled to a diagonal of ones, so that pivots are shares of information.
        let mut factor = vec![0.0; p * p];
        for (i, row) in rows.into_iter().enumerate() {
            for (j, value) in row?.into_iter().enumerate() {
                factor[i * p + j] = value / scales[i] / scales[j];
            }
            factor[i * p + i] = 1.0;
        }
        cholesky(p, &mut factor, LEAST_PIVOT).map_err(|row| Fault::Flat(coordinates[row]))?;
        let steps = lines.iter().map(|line| line.step).collect();
        let information = Information { coordinates, steps, scales, factor };
        let mut gradient: Vec<f64> = lines.iter().map(|line| line.gradient).collect();
        let steepest = |best: usize, at: usize| {
            let size = |at: usize| (lines[at].gradient / information.scales[at]).abs();
            if size(at) > size(best) { at } else { best }
        };
        let steepest = (0..p).fold(0, steepest);
        // A Newton step would gain g' I⁻¹ g / 2.
        information.solve(&mut gradient);
        if gradient.iter().map(|g| g * g).sum::<f64>() > 2.0 * GAIN {
            return Err(Fault::Rises(information.coordinates[steepest]));
        }
        Ok(information)
    }

    /// Returns the objective with some coordinates displaced.
    fn at(&self, displaced: &[(usize, f64)]) -> Result<f64, LearnError> {
        let mut by = vec![0.0; self.scales.len()];
        displaced.iter().for_each(|(at, value)| by[*at] = *value);
        (self.difference)(&by)
    }

    /// Returns the differences along a coordinate, or `None` if it is at a bound.
    fn along(&self, at: usize) -> Result<Option<LineDifferences>, Fault> {
        let Some(step) = self.step(at)? else {
            return if self.has_influence_far_away(at) { Ok(None) } else { Err(Fault::Flat(at)) };
        };
        let mut sums = [0.0; 2];
        let (mut gradients, mut curvatures) = ([0.0; 2], [0.0; 2]);
        for (level, h) in [step, step / 2.0].into_iter().enumerate() {
            let (up, down) = (self.at(&[(at, h)])?, self.at(&[(at, -h)])?);
            sums[level] = up + down;
            gradients[level] = (up - down) / h / 2.0;
            curvatures[level] = -sums[level] / h / h;
        }
        let gradient = extrapolated(gradients);
        let information = extrapolated(curvatures);
        // Near a bound at infinity the objective keeps rising, as −c e^±δ. Then gradient and
        // information are both of size c, however far away, so a Newton step is one unit long; and
        // c is less than the information of one observation. Odds relative to a larger number can
        // only fall.
        let ahead = match self.scales[at] {
            ParameterScale::Plain => 0.0,
            ParameterScale::Log => gradient.abs(),
            ParameterScale::Odds => -gradient,
        };
        if information < 1.0 && (0.5 * information..2.0 * information).contains(&ahead) {
            return Ok(None);
        }
        if information.is_nan() || information <= 0.0 {
            return Err(Fault::Rises(at));
        }
        Ok(Some(LineDifferences { step, sums, gradient, information }))
    }

    /// Returns a step along which the objective falls by the intended amount, within a factor of
    /// four; `None` if rounding hides every change.
    fn step(&self, at: usize) -> Result<Option<f64>, LearnError> {
        // The error of the differences grows as the square of the fall f, that of rounding as ε /
        // f: up to constants, they are equal at f = ε^(1/3).
        let aim = 10.0 * (f64::EPSILON * (1.0 + self.size)).cbrt();
        let plain = self.scales[at] == ParameterScale::Plain;
        let mut most = if plain { f64::INFINITY } else { LONGEST };
        let (mut step, mut found) = (1e-3, None);
        for _ in 0..100 {
            let both = self.at(&[(at, step)]).and_then(|up| Ok(up + self.at(&[(at, -step)])?));
            let factor = match both {
                Ok(sum) if sum.is_finite() => {
                    let fall = 0.5 * sum.abs();
                    let seen = fall > ROUNDING * (1.0 + self.size);
                    if (0.25 * aim..4.0 * aim).contains(&fall) || step == most {
                        return Ok(seen.then_some(step));
                    }
                    found = if seen { Some(step) } else { found };
                    // The fall is quadratic in the step.
                    if seen { (aim / fall).sqrt().clamp(1e-3, 1e3) } else { 1e3 }
                }
                // Too far: the displaced model is not valid, or rules out a sequence.
                Ok(_) | Err(LearnError::Displaced(_) | LearnError::Sequence(_)) => {
                    most = step / 2.0;
                    0.1
                }
                Err(error) => return Err(error),
            };
            step = (step * factor).min(most);
        }
        Ok(found)
    }

    /// Returns true if a logarithm without influence here has some far away: then it is at a bound.
    fn has_influence_far_away(&self, at: usize) -> bool {
        // The smallest double is e^-745, so the search ends there. Steps of 16 miss nothing:
        // between the size of rounding, 1e-12, and its full size an influence grows by e^28.
        let far = (1..=46).flat_map(|k| [f64::from(16 * k), -f64::from(16 * k)]);
        let changes = |by: f64| {
            // A failure, such as an overflow, proves nothing.
            self.at(&[(at, by)]).is_ok_and(|found| found.abs() > ROUNDING * (1.0 + self.size))
        };
        self.scales[at] != ParameterScale::Plain && far.into_iter().any(changes)
    }

    /// Returns the negative mixed derivative of two coordinates.
    fn mixed(&self, [i, j]: [usize; 2], lines: [LineDifferences; 2]) -> Result<f64, LearnError> {
        let mut found = [0.0; 2];
        for (level, part) in [1.0, 0.5].into_iter().enumerate() {
            let [a, b] = lines.map(|line| line.step * part);
            let both = self.at(&[(i, a), (j, b)])? + self.at(&[(i, -a), (j, -b)])?;
            // The sums along each coordinate alone are known from the lines.
            let alone = lines[0].sums[level] + lines[1].sums[level];
            found[level] = -(both - alone) / a / b / 2.0;
        }
        Ok(extrapolated(found))
    }
}

impl Information {
    /// Replaces the derivatives g of a number with respect to the coordinates by a vector whose
    /// squared norm is g' I⁻¹ g, the variance of the number. O(p²).
    pub(super) fn solve(&self, derivatives: &mut [f64]) {
        // With I = S L L' S, where S has the scales, the vector is L⁻¹ S⁻¹ g, by forward
        // substitution.
        let p = self.coordinates.len();
        derivatives.iter_mut().zip(&self.scales).for_each(|(g, scale)| *g /= scale);
        for i in 0..p {
            let row = &self.factor[i * p..][..=i];
            let dot: f64 = row[..i].iter().zip(&*derivatives).map(|(l, g)| l * g).sum();
            derivatives[i] = (derivatives[i] - dot) / row[i];
        }
    }
}
