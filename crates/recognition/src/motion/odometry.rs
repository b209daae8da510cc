//! Likelihood of odometry given a speed: Student's t about scale · v + bias (`guide::formulas`,
//! Route), relative to its largest value, which is a constant of the model.

use wayfix::TransitionError;
use wayfix::error::Parameter;

/// Measurement model of odometry.
///
/// At a speed of v places a step, a reading, in places, is scale · v + bias with an error that
/// has heavier tails than a Gaussian (Student's t with four degrees of freedom, Lange, Little
/// and Taylor 1989): a wheel that slips once should not rule out the vehicle's place. Give
/// `None` for a step without a reading, and also while wheels are stuck or a counter has
/// stopped: a fault is not a slip, and each of its readings counts in full.
///
/// ```
/// use wayfix_recognition::motion::OdometryModel;
///
/// // Labelled steps: places moved on, and readings, which are 4% too large.
/// let moves: Vec<f64> = (0..300).map(|k| f64::from(k / 50 % 3)).collect();
/// let read: Vec<f64> = moves.iter().zip(0..).map(|(m, k)| 1.04 * m + [0.1, -0.1][k % 2]).collect();
/// let learned = OdometryModel::fit(&[(moves, read)])?;
/// assert!((learned.scale - 1.04).abs() < 0.01 && learned.bias.abs() < 0.02);
/// assert!(learned.deviation > 0.04 && learned.deviation < 0.2);
/// # Ok::<(), wayfix::TransitionError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct OdometryModel {
    /// Places read for each place driven.
    pub scale: f64,
    /// Places read while standing.
    pub bias: f64,
    /// Scale of the error, in places: two thirds of errors are within about 1.1 times this. For
    /// a grid speed that stands for a cell of speeds, the variance of an eighth of the cell is added
    /// to its square: (scale × width / 8)² / 12.
    pub deviation: f64,
}

impl Default for OdometryModel {
    /// Unbiased, with an error of 0.5 places: drives whose true error was 0.3 lost nothing by it,
    /// and with 0.3 the drives whose error was 1 went wrong.
    fn default() -> Self {
        Self { scale: 1.0, bias: 0.0, deviation: 0.5 }
    }
}

/// Density at 0 of Student's t with four degrees of freedom.
const PEAK: f64 = 0.375;
/// Largest absolute value of a valid reading.
const FARTHEST: f64 = 1e6;

/// Prior deviations of scale and bias: readings at a single speed could not tell them apart.
const SCALE_PRIOR_SD: f64 = 0.05;
const BIAS_PRIOR_SD: f64 = 0.005;
/// Smallest deviation that is learned.
const LEAST_DEVIATION: f64 = 0.05;
/// Steps of a span over which readings are compared with places: over fewer, the error of counting
/// in whole references dominates.
const SPAN: usize = 10;

impl OdometryModel {
    /// Learns the model from drives, given as the number of places that each step moved on, and the
    /// readings. Scale and bias are found by least squares over spans of ten steps, held near 1 and
    /// 0 by priors (deviations 0.05 and 0.005); the deviation comes from the errors, less the
    /// effect of counting in whole places. O(steps).
    ///
    /// # Errors
    ///
    /// [`TransitionError::PartStates`] for a drive whose moves and readings differ in number,
    /// or [`TransitionError::Parameter`] for a number that is NaN or beyond ±1e6.
    pub fn fit<M, R>(drives: &[(M, R)]) -> Result<Self, TransitionError>
    where
        M: AsRef<[f64]>,
        R: AsRef<[f64]>,
    {
        let mut spans = Vec::new();
        for (moves, read) in drives {
            let (moves, read) = (moves.as_ref(), read.as_ref());
            let (found, expected) = (read.len(), moves.len());
            if found != expected {
                return Err(TransitionError::PartStates { part: "readings", found, expected });
            }
            if let Some(&value) =
                moves.iter().chain(read).find(|x| x.is_nan() || x.abs() > FARTHEST)
            {
                let what = "a move or a reading";
                let expected = "a value from -1e6 to 1e6";
                return Err(Parameter::new(what, value, expected).into());
            }
            let sum = |x: &[f64]| x.iter().sum::<f64>();
            let pairs = moves.chunks(SPAN).zip(read.chunks(SPAN));
            spans.extend(pairs.map(|(m, r)| (m.len() as f64, sum(m), sum(r))));
        }
        let mut model = Self::default();
        // Iterated, since the weight of the priors depends on the deviation, and the deviation on
        // scale and bias.
        for _ in 0..4 {
            // Ridge regression: the priors enter the normal equations of r ≈ scale m + bias n as
            // pseudo- observations with the mean (1, 0), in units of the errors' variance. The sums
            // over a span have a variance in proportion to its length n, hence the weight 1 / n.
            let prior = [SCALE_PRIOR_SD, BIAS_PRIOR_SD].map(|sd| (model.deviation / sd).powi(2));
            let (mut mm, mut mn, mut nn) = (prior[0], 0.0, prior[1]);
            let (mut mr, mut nr) = (prior[0], 0.0);
            for &(n, m, r) in &spans {
                let weight = 1.0 / n;
                (mm, mn, nn) = (mm + weight * m * m, mn + weight * m * n, nn + weight * n * n);
                (mr, nr) = (mr + weight * m * r, nr + weight * n * r);
            }
            // Above 0, as the prior terms are on the diagonal of a matrix that is positive
            // semidefinite.
            let determinant = mm * nn - mn * mn;
            model.scale = (mr * nn - nr * mn) / determinant;
            model.bias = (nr * mm - mr * mn) / determinant;
            model.deviation = model.deviation_of(drives);
        }
        Ok(model)
    }

    /// Deviation by the moments of the errors. Counting in whole places makes the errors of
    /// successive steps negatively correlated, and adds twice as much to the variance as it takes
    /// from the covariance; so variance + 2 covariance is free of it.
    fn deviation_of<M: AsRef<[f64]>, R: AsRef<[f64]>>(&self, drives: &[(M, R)]) -> f64 {
        let (mut squares, mut products, mut count) = (0.0, 0.0, 0.0);
        for (moves, read) in drives {
            let pairs = moves.as_ref().iter().zip(read.as_ref());
            let errors: Vec<f64> = pairs.map(|(m, r)| r - self.scale * m - self.bias).collect();
            // Winsorised, so that a slip counts little, as in the density.
            let bound = 4.0 * median(errors.iter().map(|e| e.abs()).collect()).max(0.05);
            let errors: Vec<f64> = errors.iter().map(|e| e.clamp(-bound, bound)).collect();
            squares += errors.iter().map(|e| e * e).sum::<f64>();
            products += errors.windows(2).map(|pair| pair[0] * pair[1]).sum::<f64>();
            count += errors.len() as f64;
        }
        if count == 0.0 {
            return Self::default().deviation;
        }
        let (variance, covariance) = (squares / count, products / count);
        let own = (variance + 2.0 * covariance).clamp(0.25 * variance, variance);
        // Errors are between a Gaussian, whose variance is the scale squared, and a t with four
        // degrees of freedom, whose variance is twice that.
        (own / 1.4).sqrt().max(LEAST_DEVIATION)
    }

    pub(super) fn check(&self) -> Result<(), TransitionError> {
        let Self { scale, bias, deviation } = *self;
        let named = [("scale", scale, 0.01..=100.0), ("bias", bias, -FARTHEST..=FARTHEST)];
        for (name, value, range) in named {
            if !range.contains(&value) {
                let what = format!("the {name} of the odometry");
                let expected =
                    if name == "scale" { "from 0.01 to 100" } else { "from -1e6 to 1e6" };
                return Err(Parameter::new(what, value, expected).into());
            }
        }
        if !(1e-3..=1e6).contains(&deviation) {
            let what = "the deviation of the odometry";
            let expected = "from 0.001 to 1e6";
            return Err(Parameter::new(what, deviation, expected).into());
        }
        Ok(())
    }

    pub(super) fn check_reading(reading: f64) -> Result<(), TransitionError> {
        if reading.abs() <= FARTHEST {
            return Ok(());
        }
        let text = format!("an odometry of {reading} places, expected a value from -1e6 to 1e6");
        Err(TransitionError::Control(text))
    }

    /// Density of a reading at a speed known up to a cell of width `spacing`, relative to the
    /// largest density.
    pub(super) fn relative(&self, reading: f64, speed: f64, spacing: f64) -> f64 {
        let width = self.scale * spacing;
        // The variance of a uniform distribution over the cell is added.
        let s = (self.deviation * self.deviation + width * width / 12.0).sqrt();
        let r = (reading - self.scale * speed - self.bias) / s;
        // (1 + r² / 4)^(−5/2), the kernel of a t with four degrees of freedom; the ratio of the
        // scales is that of the peaks.
        let x = 1.0 + 0.25 * r * r;
        self.deviation / s / (x * x * x.sqrt())
    }

    /// Density of a reading given the mean of earlier readings at the same speed, relative to the
    /// largest density.
    pub(super) fn predictive_density(&self, reading: f64, mean: f64, count: u32) -> f64 {
        // Predictive density: the variance of the mean, 1 / count, adds to that of the reading.
        let width = (1.0 + 1.0 / f64::from(count)).sqrt();
        let r = (reading - mean) / (width * self.deviation);
        let x = 1.0 + 0.25 * r * r;
        1.0 / width / (x * x * x.sqrt())
    }

    /// Logarithm of the largest density.
    pub(super) fn log_peak(&self) -> f64 {
        (PEAK / self.deviation).ln()
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    let middle = values.len() / 2;
    if values.is_empty() {
        return 0.0;
    }
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_density_is_one() {
        let model = OdometryModel { scale: 1.1, bias: 0.2, deviation: 0.4 };
        let step = 1e-3;
        let sum: f64 =
            (-400_000..400_000).map(|k| step * model.relative(f64::from(k) * step, 1.5, 0.0)).sum();
        assert!((sum * model.log_peak().exp() - 1.0).abs() < 1e-6, "{sum}");
    }

    #[test]
    fn counting_in_whole_places_is_no_error_of_the_wheels() {
        // 0.7 places a step, read to a tenth.
        let moves: Vec<f64> = (1..400)
            .map(|k| (0.7 * f64::from(k)).round() - (0.7 * f64::from(k - 1)).round())
            .collect();
        let read: Vec<f64> = (1..400).map(|k| 0.7 + [0.1, 0.0, -0.1][k % 3]).collect();
        let learned = OdometryModel::fit(&[(&moves, &read)]).unwrap();
        assert!(learned.deviation < 0.3, "{learned:?}");
        let none: [(Vec<f64>, Vec<f64>); 0] = [];
        let default = OdometryModel::fit(&none).unwrap();
        assert!((default.scale - 1.0).abs() < 1e-12 && default.bias == 0.0);
        assert!(OdometryModel::fit(&[(&moves[1..], &read[..])]).is_err());
        assert!(OdometryModel::fit(&[([f64::NAN], [0.0])]).is_err());
    }
}
