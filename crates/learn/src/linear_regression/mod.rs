//! Linear regression on an input: parameters, predictions and draws of y = B x + c + noise. The
//! noise is a [`Gaussian`] of mean 0, whose steps take the differences y − B x − c in place of
//! y − μ.

mod learn;

use rand::Rng;
use wayfix::likelihood::{SampleNext, SampleObservation};
use wayfix::{Diagonal, Likelihood, LikelihoodError, ReorderStates, Scratch};
use wayfix_kernels::{Eight, LANES, Simd};

use crate::error::{check, check_components, check_length, check_values, flatten};
use crate::normal::{
    CovarianceType, Differences, GaussianPrior, Normals, Settings, as_blocks, flatten_covariances,
};
use crate::{EmissionError, Family, Gaussian};

/// Outputs that are linear in an input, with Gaussian noise: in each state y = B x + c + noise. An
/// observation is a row of the p numbers of the input x followed by the d numbers of the output y.
///
/// With the coefficients B (d × p), the intercept c and the covariance Σ of a state's noise, full
/// or diagonal, the density is that of the output given the input,
///
/// ```text
/// p(y | x) = (2π)^(−d/2) det(Σ)^(−1/2) exp(−½ (y − B x − c)' Σ⁻¹ (y − B x − c)).
/// ```
///
/// Inputs have no distribution, so [`Hmm::simulate`](wayfix::Hmm::simulate) is not available. But
/// [`sample`](Self::sample) draws an output for an input, and
/// [`Hmm::simulate_after`](wayfix::Hmm::simulate_after) a sequence whose inputs are the previous
/// outputs.
///
/// An intercept is the output at an input of 0. Inputs that are far from 0 relative to their
/// spread, such as clock times, lose digits in it: subtract a constant from them first.
///
/// Learning is weighted least squares in closed form (Quandt and Ramsey 1978; Hamilton 1989 for
/// states that follow a Markov chain). Inputs of a state that do not vary in all directions are an
/// error, unless there is [a ridge](Self::with_ridge). A step takes O(n d (p + d)), eight states
/// side by side, and allocates nothing; its statistics O(n (p + d)²).
///
/// [Missing components](Self::with_missing) of the output are integrated out; inputs must be
/// complete.
///
/// ```
/// use wayfix_learn::{LinearRegression, Rows};
/// use wayfix::inference::LearningOptions;
/// use wayfix::{Belief, DenseTransition, Hmm, Prior};
///
/// // One input and one output: y = x in state 0, y = -x in state 1.
/// let rows = [1.0, 1.1, 2.0, 1.9, 3.0, 3.1, 4.0, 3.9, 1.0, -1.1, 2.0, -1.9, 3.0, -3.1, 4.0, -4.0];
/// let family =
///     LinearRegression::diagonal(&[[0.5], [-0.5]], &[[0.0], [0.0]], &[[1.0], [1.0]])?;
/// let hmm = Hmm::new(
///     Prior::AtFirstObservation(Belief::uniform(2)?),
///     DenseTransition::from_rows(&[[0.8, 0.2], [0.2, 0.8]])?,
///     family,
/// )?;
/// let learned = hmm.learn(&[Rows::new(&rows, 2)?], &LearningOptions::default())?;
/// let found = learned.model().likelihood();
/// assert!((found.coefficients(0).unwrap()[0] - 1.0).abs() < 0.1);
/// assert!((found.coefficients(1).unwrap()[0] + 1.0).abs() < 0.1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Autoregressive Gaussians
///
/// With the previous observations as the input, from [`Rows::lagged`](crate::Rows::lagged), this is
/// an autoregressive Gaussian: B has d × (order · d) coefficients, those of the oldest observation
/// first. [`Hmm::simulate_after`](wayfix::Hmm::simulate_after) draws sequences from it, given the
/// first `order` values, and [`Filter::simulate_after`](wayfix::Filter::simulate_after)
/// continuations of a series.
///
/// ```
/// use wayfix_learn::{LinearRegression, Rows};
/// use wayfix::inference::LearningOptions;
/// use wayfix::{Belief, DenseTransition, Hmm, Prior};
///
/// // One state: each value is half the one before, plus one.
/// let values = [8.0, 5.1, 3.4, 2.8, 2.5, 2.2, 2.0, 2.1, 2.0];
/// let family = LinearRegression::diagonal(&[[0.0]], &[[0.0]], &[[1.0]])?;
/// let hmm = Hmm::new(
///     Prior::AtFirstObservation(Belief::uniform(1)?),
///     DenseTransition::from_rows(&[[1.0]])?,
///     family,
/// )?;
/// let rows = Rows::new(&values, 1)?.lagged(1)?;
/// let learned = hmm.learn(&[rows], &LearningOptions::default())?;
/// let found = learned.model().likelihood();
/// assert!((found.coefficients(0).unwrap()[0] - 0.5).abs() < 0.05);
/// assert!((found.intercept(0).unwrap()[0] - 1.0).abs() < 0.1);
/// assert!((found.predict(0, &[4.0])?[0] - 3.0).abs() < 0.1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct LinearRegression {
    noise: Gaussian,
    inputs: usize,
    /// State by state and output by output, the intercept and then the p coefficients: a line.
    coefficients_by_output: Vec<f64>,
    /// The same lines in blocks of eight states.
    blocks: Vec<Eight>,
    ridge: f64,
}

impl LinearRegression {
    /// Creates a family with diagonal noise covariances: for each state d × p coefficients, row
    /// after row, d intercepts and d variances.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] without states, inputs or outputs, for a wrong length, a value that is
    /// not finite, or a variance that is not above 2.2e-308.
    pub fn diagonal<M: AsRef<[f64]>, C: AsRef<[f64]>, V: AsRef<[f64]>>(
        coefficients: &[M],
        intercepts: &[C],
        variances: &[V],
    ) -> Result<Self, EmissionError> {
        Self::new(CovarianceType::Diagonal, coefficients, intercepts, variances)
    }

    /// Creates a family with full noise covariances: for each state d × p coefficients, row after
    /// row, d intercepts and d × d covariances, row after row.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] as for [`diagonal`](Self::diagonal), and for a covariance that is not
    /// symmetric within 1e-9 and positive definite.
    pub fn full<M: AsRef<[f64]>, C: AsRef<[f64]>, V: AsRef<[f64]>>(
        coefficients: &[M],
        intercepts: &[C],
        covariances: &[V],
    ) -> Result<Self, EmissionError> {
        Self::new(CovarianceType::Full, coefficients, intercepts, covariances)
    }

    pub(crate) fn new<M: AsRef<[f64]>, C: AsRef<[f64]>, V: AsRef<[f64]>>(
        kind: CovarianceType,
        coefficients: &[M],
        intercepts: &[C],
        covariances: &[V],
    ) -> Result<Self, EmissionError> {
        let states = intercepts.len();
        let d = intercepts.first().map_or(0, |first| first.as_ref().len());
        let first = coefficients.first().map_or(0, |first| first.as_ref().len());
        // A row of coefficients is d × p values; a remainder is caught by `flatten` below.
        let p = first.checked_div(d).unwrap_or(0);
        if states == 0 || p == 0 {
            return Err(EmissionError::Empty { states, components: d.min(p) });
        }
        check_length("list of coefficients", None, coefficients.len(), states)?;
        check_length("list of covariances", None, covariances.len(), states)?;
        let coefficients = flatten("list of coefficients", coefficients, d * p)?;
        let intercepts = flatten("intercept", intercepts, d)?;
        let covariances = flatten_covariances(kind, covariances, d)?;
        let zeros = vec![0.0; states * d];
        let noise = Gaussian::of(Normals::new(kind, d, zeros, covariances, Settings::default())?);
        let each = coefficients.chunks_exact(p).zip(&intercepts);
        let lines = each.flat_map(|(slopes, c)| [*c].into_iter().chain(slopes.iter().copied()));
        Ok(Self::of(noise, p, lines.collect(), 0.0))
    }

    fn of(noise: Gaussian, inputs: usize, lines: Vec<f64>, ridge: f64) -> Self {
        let each = noise.components() * (1 + inputs);
        // Transposed for the steps: value k of eight states side by side.
        let mut blocks = vec![Eight::default(); noise.normals().blocks() * each];
        for (at, line) in lines.chunks_exact(each).enumerate() {
            for (k, value) in line.iter().enumerate() {
                blocks[at / LANES * each + k][at % LANES] = *value;
            }
        }
        Self { noise, inputs, coefficients_by_output: lines, blocks, ridge }
    }

    /// Returns the family with missing components of the output allowed, given as NaN. They are
    /// integrated out. Without this setting, NaN is an error.
    #[must_use]
    pub fn with_missing(self) -> Self {
        Self { noise: self.noise.with_missing(), ..self }
    }

    /// Returns the family with a Gaussian prior of the coefficients, whose log density is
    /// −½ λ tr(B' Σ⁻¹ B): it draws B towards 0, and leaves intercepts free. λ is 0 by default.
    ///
    /// # Errors
    ///
    /// [`EmissionError::Parameter`] unless λ is finite and not negative.
    pub fn with_ridge(self, lambda: f64) -> Result<Self, EmissionError> {
        let valid = lambda >= 0.0 && lambda.is_finite();
        Ok(Self { ridge: check("ridge", lambda, valid, "a finite value of at least 0")?, ..self })
    }

    /// Returns the family with a prior of the noise covariance, for learning: ν and Ψ of a
    /// [`GaussianPrior`], whose mean is not used. By default there is none.
    ///
    /// # Errors
    ///
    /// [`EmissionError::Length`] if the prior has another number of components than the output.
    pub fn with_noise_prior(self, mut prior: GaussianPrior) -> Result<Self, EmissionError> {
        // The noise has mean 0 by definition; a prior on the mean would only add a constant to the
        // objective.
        prior.mean_weight = 0.0;
        Ok(Self { noise: self.noise.with_prior(prior)?, ..self })
    }

    /// Number of components of the input, p.
    #[must_use]
    pub fn inputs(&self) -> usize {
        self.inputs
    }

    /// Number of components of the output, d.
    #[must_use]
    pub fn outputs(&self) -> usize {
        self.noise.components()
    }

    /// Returns the coefficients of a state, d × p values row after row, or `None` if it does not
    /// exist.
    #[must_use]
    pub fn coefficients(&self, state: usize) -> Option<Vec<f64>> {
        let lines = self.lines_of(state)?.chunks_exact(1 + self.inputs);
        Some(lines.flat_map(|line| line[1..].to_vec()).collect())
    }

    /// Returns the intercept of a state, d values, or `None` if it does not exist.
    #[must_use]
    pub fn intercept(&self, state: usize) -> Option<Vec<f64>> {
        Some(self.lines_of(state)?.iter().step_by(1 + self.inputs).copied().collect())
    }

    /// The ridge λ.
    #[must_use]
    pub fn ridge(&self) -> f64 {
        self.ridge
    }

    /// Noise of the outputs: a Gaussian of mean 0 with the covariances, the prior, and the setting
    /// for missing components.
    #[must_use]
    pub fn noise(&self) -> &Gaussian {
        &self.noise
    }

    /// Expected output in a state, B x + c.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] if the input does not have p finite components, or
    /// [`EmissionError::Length`] if the state does not exist.
    pub fn predict(&self, state: usize, input: &[f64]) -> Result<Vec<f64>, EmissionError> {
        let lines = self.lines_of(state).ok_or(EmissionError::Length {
            what: "number of states up to the one asked for",
            state: None,
            found: state.saturating_add(1),
            expected: self.noise.states(),
        })?;
        self.check_input(input, self.inputs)?;
        Ok(lines.chunks_exact(1 + self.inputs).map(|line| predicted(line, input)).collect())
    }

    /// Draws an output for an input in a state.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] as for [`predict`](Self::predict).
    pub fn sample<R: Rng + ?Sized>(
        &self,
        state: usize,
        input: &[f64],
        rng: &mut R,
    ) -> Result<Vec<f64>, EmissionError> {
        let mut output = self.predict(state, input)?;
        let noise = self.noise.sample(state, rng);
        output.iter_mut().zip(noise).for_each(|(y, noise)| *y += noise);
        Ok(output)
    }

    /// Lines of a state, or `None` if it does not exist.
    fn lines_of(&self, state: usize) -> Option<&[f64]> {
        self.coefficients_by_output.chunks_exact(self.outputs() * (1 + self.inputs)).nth(state)
    }
}

/// Output of a line, which is an intercept followed by slopes.
fn predicted(line: &[f64], input: &[f64]) -> f64 {
    line[0] + line[1..].iter().zip(input).map(|(slope, x)| slope * x).sum::<f64>()
}

impl ReorderStates for LinearRegression {
    fn reordered(&self, order: &[usize]) -> Self {
        let lines = order.iter().flat_map(|state| self.lines_of(*state).expect("it exists"));
        Self::of(self.noise.reordered(order), self.inputs, lines.copied().collect(), self.ridge)
    }
}

// Linear regression on previous outputs: draws of autoregressive models (section 8 of the
// formulas).

/// For models whose inputs are the previous outputs, oldest first, as in
/// [`Rows::lagged`](crate::Rows::lagged).
impl SampleNext for LinearRegression {
    type Sample = Vec<f64>;

    /// Draws a row, an input followed by its output. The last p numbers of `before` are the input:
    /// `before` is the previous row, or for the first row the input itself.
    ///
    /// # Errors
    ///
    /// [`EmissionError`](crate::EmissionError) if the number of inputs is not a multiple
    /// of the number of outputs, if `before` has the length of neither a row nor an input, or if it
    /// or the output drawn is not finite.
    fn sample_next<R: Rng + ?Sized>(
        &self,
        state: usize,
        before: &[f64],
        rng: &mut R,
    ) -> Result<Vec<f64>, LikelihoodError> {
        let (p, d) = (self.inputs(), self.outputs());
        let (what, valid) = ("number of components of the input", p.is_multiple_of(d));
        check(what, p as f64, valid, "a multiple of that of the output")?;
        if before.len() != p + d {
            check_components(before, p)?;
        }
        // Dropping the first d numbers of the previous row shifts its lags by one step.
        let input = &before[before.len() - p..];
        let row = [input, &self.sample(state, input, rng)?].concat();
        check_values(&row, f64::is_finite, "a finite value, but the model diverges")?;
        Ok(row)
    }
}

// Linear regression: its densities b_i(y) = N(y − B x − c; 0, Σ), section 1 of the guide's
// formulas.

impl LinearRegression {
    fn check_input(&self, input: &[f64], expected: usize) -> Result<(), EmissionError> {
        check_components(input, expected)?;
        // `check_components` has established the length.
        let expected = "a finite value (inputs may not be missing)";
        check_values(&input[..self.inputs], f64::is_finite, expected)
    }

    /// Checks a row, and returns its output and the number of components of the output that are not
    /// missing.
    #[inline]
    fn output<'a>(&self, row: &'a [f64]) -> Result<(&'a [f64], usize), EmissionError> {
        self.check_input(row, self.inputs + self.outputs())?;
        let output = &row[self.inputs..];
        let observed = self.noise.normals().check(output);
        let observed = observed.map_err(|error| error.in_factor(self.inputs, row.len()))?;
        Ok((output, observed))
    }

    fn differences<'a>(&'a self, row: &'a [f64]) -> FromLines<'a> {
        FromLines { row, inputs: self.inputs, coefficients: &self.blocks }
    }
}

/// Differences of outputs from their lines; 0 for missing ones.
struct FromLines<'a> {
    row: &'a [f64],
    inputs: usize,
    coefficients: &'a [Eight],
}

impl Differences for FromLines<'_> {
    #[inline(always)]
    fn write<S: Simd>(&self, s: S, block: usize, out: &mut [Eight]) {
        let (input, output) = self.row.split_at(self.inputs);
        let width = 1 + self.inputs;
        let coefficients = &self.coefficients[block * width * out.len()..];
        // One output after the other, y_c − c_c − Σ_k B_ck x_k, for eight states at once.
        for ((out, &y), line) in out.iter_mut().zip(output).zip(coefficients.chunks_exact(width)) {
            if y.is_nan() {
                *out = Eight::default();
                continue;
            }
            let mut rest = s.sub(s.splat(y), s.load(&line[0]));
            for (slope, &x) in line[1..].iter().zip(input) {
                rest = s.sub(rest, s.mul(s.load(slope), s.splat(x)));
            }
            s.store(rest, out);
        }
    }
}

impl Likelihood for LinearRegression {
    type Observation = [f64];

    fn states(&self) -> usize {
        self.noise.states()
    }

    #[inline]
    fn diagonal<'a>(
        &'a self,
        row: &'a [f64],
        scratch: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        let normals = self.noise.normals();
        let values = scratch.values(normals.scratch_blocks() * 8);
        let memory = as_blocks(values);
        let (output, observed) = self.output(row)?;
        normals.distances_from(&self.differences(row), output, observed, memory)?;
        normals.logs(memory);
        Ok(Diagonal::log(&values[..normals.count()]))
    }
}

impl Family for LinearRegression {
    fn components(&self) -> usize {
        self.inputs + self.outputs()
    }
}

#[cfg(feature = "serde")]
wayfix::stored! {
    [] LinearRegression: [], |family| {
        full: bool = (family.noise().covariance_type() == CovarianceType::Full),
        coefficients: Vec<Vec<f64>> = crate::family::by_state(|state| family.coefficients(state)),
        intercepts: Vec<Vec<f64>> = crate::family::by_state(|state| family.intercept(state)),
        covariances: Vec<Vec<f64>> = family.noise().covariances(),
        missing: bool = family.noise().takes_missing(),
        ridge: f64 = family.ridge(),
        noise_prior: Option<crate::GaussianPrior> = family.noise().prior(),
    } => Self::new(matrices(full), &coefficients, &intercepts, &covariances)
        .and_then(|new| new.with_ridge(ridge))
        .map(|new| crate::family::when(missing, new, Self::with_missing))
        .and_then(|new| noise_prior.into_iter().try_fold(new, Self::with_noise_prior));
}

/// Type of covariances that are matrices, or variances.
#[cfg(feature = "serde")]
fn matrices(full: bool) -> CovarianceType {
    if full { CovarianceType::Full } else { CovarianceType::Diagonal }
}
