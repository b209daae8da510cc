//! Hamilton's model (*A new approach to the economic analysis of nonstationary time series and the
//! business cycle*, 1989): a mean that switches between two regimes s, and an autoregression of
//! four lags for the deviation from it,
//!
//! ```text
//! y_t − μ(s_t) = Σ_k φ_k (y_{t−k} − μ(s_{t−k})) + noise,    k = 1 … 4
//! ```
//!
//! The density of a quarter depends on the regimes of five quarters, so these make up a state of
//! the chain: bit k is the regime of the quarter k before.

use std::error::Error;

use wayfix::likelihood::LearnLikelihood;
use wayfix::transition::ConstrainedTransition;
use wayfix::{
    Diagonal, Hmm, Likelihood, LikelihoodError, Prior, Scratch, SparseTransition, TransitionError,
};

/// Number of states: two regimes in each of five quarters.
pub(crate) const STATES: usize = 32;
/// Length of a row: five growths, five regimes, and 1.
const WIDTH: usize = 11;

/// Creates the model of a chain that moves from the regimes 0 and 1 to regime 0 with these
/// probabilities. It starts in its stationary distribution, as if it had been running for long.
pub(crate) fn model(
    to_0: [f64; 2],
    sensor: SwitchingMean,
) -> Result<Hmm<ConstrainedTransition, SwitchingMean>, Box<dyn Error>> {
    let moves = moves(to_0)?;
    Ok(Hmm::new(Prior::stationary(&moves)?, moves, sensor)?)
}

/// Moves between states of five regimes, which shift by one quarter.
fn moves(to_0: [f64; 2]) -> Result<ConstrainedTransition, TransitionError> {
    let out_of = |from: usize| {
        // Each regime becomes one quarter older and the oldest drops out; bit 0 is the new one.
        let (after, p) = ((from << 1) % STATES, to_0[from & 1]);
        [(after, from, p), (after | 1, from, 1.0 - p)]
    };
    let moves = SparseTransition::from_triplets(STATES, (0..STATES).flat_map(out_of))?;
    // A move depends on the present regime alone: one label for each pair of present and next
    // regime.
    Ok(ConstrainedTransition::new(moves).with_ties(|from, to| 2 * (from & 1) + (to & 1)))
}

/// Growth with a mean in each of two regimes. Its deviation from the mean is a linear combination
/// of the deviations of the four previous quarters, plus noise. An observation has five quarters,
/// the present one last.
#[derive(Debug, Clone)]
pub(crate) struct SwitchingMean {
    pub(crate) means: [f64; 2],
    /// Coefficients of the previous quarters, the most recent first.
    pub(crate) lags: [f64; 4],
    pub(crate) variance: f64,
}

/// A vector of growths, regimes and 1, or a linear function of such a vector.
type Row = [f64; WIDTH];

/// Growth of the present and the previous quarters, most recent first, their regimes, and 1.
fn row(growth: &[f64], state: usize) -> Row {
    let mut row = [1.0; WIDTH];
    for k in 0..5 {
        row[k] = growth[4 - k];
        row[5 + k] = f64::from(u8::from(state >> k & 1 == 1));
    }
    row
}

impl SwitchingMean {
    /// Deviation from the mean k quarters before, as a linear function of a row.
    fn deviation(&self, k: usize) -> Row {
        // y − μ(s) = y + (μ_0 − μ_1) s − μ_0 for a regime s of 0 or 1.
        let mut function = [0.0; WIDTH];
        function[k] = 1.0;
        function[5 + k] = self.means[0] - self.means[1];
        function[10] = -self.means[0];
        function
    }

    /// Noise as a linear function of a row.
    fn noise(&self) -> Row {
        // The deviation less Σ_k φ_k times the deviation k quarters before.
        let mut function = self.deviation(0);
        for (k, lag) in (1..).zip(self.lags) {
            let before = self.deviation(k);
            function.iter_mut().zip(before).for_each(|(sum, value)| *sum -= lag * value);
        }
        function
    }
}

impl Likelihood for SwitchingMean {
    type Observation = [f64];

    fn states(&self) -> usize {
        STATES
    }

    fn diagonal<'a>(
        &'a self,
        growth: &[f64],
        scratch: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        let logs = scratch.values(STATES);
        let noise = self.noise();
        for (state, log) in logs.iter_mut().enumerate() {
            let noise = dot(&noise, &row(growth, state));
            let scale = (std::f64::consts::TAU * self.variance).ln();
            *log = -0.5 * (noise * noise / self.variance + scale);
        }
        Ok(Diagonal::log(logs))
    }
}

impl LearnLikelihood for SwitchingMean {
    /// Σ γ row row' over all states and quarters: noise is linear in a row, so its expected square
    /// is a quadratic form of this matrix for any parameters.
    type Statistics = Vec<Row>;

    fn statistics(&self) -> Vec<Row> {
        vec![[0.0; WIDTH]; WIDTH]
    }

    fn add(&self, squares: &mut Vec<Row>, growth: &[f64], posterior: &[f64]) {
        for (state, weight) in posterior.iter().enumerate() {
            let row = row(growth, state);
            for (sums, left) in squares.iter_mut().zip(row) {
                sums.iter_mut().zip(row).for_each(|(sum, right)| *sum += weight * left * right);
            }
        }
    }

    fn merge(&self, squares: &mut Vec<Row>, other: &Vec<Row>) {
        squares
            .iter_mut()
            .flatten()
            .zip(other.iter().flatten())
            .for_each(|(sum, more)| *sum += more);
    }

    /// Maximises over the means for the old coefficients, then over the coefficients for the new
    /// means, each by least squares, then over the variance: an ECM step (Meng and Rubin 1993),
    /// which does not lower the likelihood.
    fn maximize(&self, squares: &Vec<Row>, _: f64) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let mut learned = self.clone();
        // For fixed coefficients noise is affine in the means: its value at 0, and one term for
        // each mean.
        let of_means = |means: [f64; 2]| Self { means, ..self.clone() }.noise();
        let none = of_means([0.0; 2]);
        let mean = |means: [f64; 2]| difference(&of_means(means), &none);
        let means = least_squares(squares, &none, &[mean([1.0, 0.0]), mean([0.0, 1.0])])?;
        learned.means = [means[0], means[1]];
        // For fixed means it is affine in the coefficients: the present deviation, less each
        // previous one times its coefficient.
        let before: Vec<Row> =
            (1..5).map(|k| difference(&[0.0; WIDTH], &learned.deviation(k))).collect();
        let lags = least_squares(squares, &learned.deviation(0), &before)?;
        learned.lags.copy_from_slice(&lags);
        // The last entry of a row is 1, so that squares[10][10] is the number of quarters.
        let noise = learned.noise();
        learned.variance = product(squares, &noise, &noise) / squares[10][10];
        Ok(learned)
    }

    fn free_parameters(&self) -> usize {
        2 + 4 + 1
    }
}

fn dot(a: &Row, b: &Row) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn difference(a: &Row, b: &Row) -> Row {
    std::array::from_fn(|k| a[k] - b[k])
}

/// a' M b.
fn product(squares: &[Row], a: &Row, b: &Row) -> f64 {
    a.iter().zip(squares).map(|(a, squares)| a * dot(squares, b)).sum()
}

/// The x that minimises the weighted sum of squares of fixed + Σ x_k terms_k.
fn least_squares(
    squares: &[Row],
    fixed: &Row,
    terms: &[Row],
) -> Result<Vec<f64>, Box<dyn Error + Send + Sync>> {
    let n = terms.len();
    // Normal equations: Σ_j (t_i' M t_j) x_j = −t_i' M fixed, with the right-hand side as last
    // column.
    let mut equations: Vec<Vec<f64>> = terms
        .iter()
        .map(|term| {
            let left = terms.iter().map(|other| product(squares, term, other));
            left.chain([-product(squares, term, fixed)]).collect()
        })
        .collect();
    // Gauss–Jordan elimination. The matrix is positive definite unless the terms are collinear, so
    // that no exchange of rows is needed.
    for k in 0..n {
        let pivot = equations[k].clone();
        if pivot[k] <= 0.0 {
            return Err("the quarters do not determine the parameters".into());
        }
        for (i, equation) in equations.iter_mut().enumerate() {
            // Row k is divided by its pivot, which is subtracting (1 − 1 / pivot) times itself.
            let times = if i == k { 1.0 - 1.0 / pivot[k] } else { equation[k] / pivot[k] };
            equation.iter_mut().zip(&pivot).for_each(|(value, pivot)| *value -= times * pivot);
        }
    }
    Ok(equations.iter().map(|equation| equation[n]).collect())
}
