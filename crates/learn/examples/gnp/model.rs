//! Hamilton's model (*A new approach to the economic analysis of nonstationary time series and the
//! business cycle*, 1989): a mean that switches, and four lags of the deviation from it.
//!
//! The deviation of a quarter depends on the means of the four quarters before, so that a state of the
//! chain is that of five quarters: bit k is the state of the quarter k before.

use std::error::Error;

use wayfix::likelihood::LearnLikelihood;
use wayfix::transition::ConstrainedTransition;
use wayfix::{
    Diagonal, Hmm, Likelihood, LikelihoodError, Prior, Scratch, SparseTransition, TransitionError,
};

/// Number of states, those of five quarters.
pub(crate) const STATES: usize = 32;
/// Values in the square of a row: five growths, five states, and 1.
const WIDTH: usize = 11;

/// Moves of the chain that leaves states 0 and 1 for state 0 with these probabilities; it starts as
/// if it had been running for long, in the stationary distribution.
pub(crate) fn model(
    to_0: [f64; 2],
    sensor: SwitchingMean,
) -> Result<Hmm<ConstrainedTransition, SwitchingMean>, Box<dyn Error>> {
    let moves = moves(to_0)?;
    Ok(Hmm::new(Prior::stationary(&moves)?, moves, sensor)?)
}

fn moves(to_0: [f64; 2]) -> Result<ConstrainedTransition, TransitionError> {
    let out_of = |from: usize| {
        let (after, p) = ((from << 1) % STATES, to_0[from & 1]);
        [(after, from, p), (after | 1, from, 1.0 - p)]
    };
    let moves = SparseTransition::from_triplets(STATES, (0..STATES).flat_map(out_of))?;
    // Only the present state matters.
    Ok(ConstrainedTransition::new(moves).with_ties(|from, to| 2 * (from & 1) + (to & 1)))
}

/// Growth with a mean in each of two states; its deviation from this is the sum of those of the four
/// quarters before, each times a coefficient, and of noise. An observation has five quarters, the
/// present one last.
#[derive(Debug, Clone)]
pub(crate) struct SwitchingMean {
    pub(crate) means: [f64; 2],
    /// Coefficients of the quarters before, the last one first.
    pub(crate) lags: [f64; 4],
    pub(crate) variance: f64,
}

type Row = [f64; WIDTH];

/// Growth of the present quarter and of those before, their states, and 1.
fn row(growth: &[f64], state: usize) -> Row {
    let mut row = [1.0; WIDTH];
    for k in 0..5 {
        row[k] = growth[4 - k];
        row[5 + k] = f64::from(u8::from(state >> k & 1 == 1));
    }
    row
}

impl SwitchingMean {
    /// Deviation from the mean k quarters before, as a function of a row.
    fn deviation(&self, k: usize) -> Row {
        let mut function = [0.0; WIDTH];
        function[k] = 1.0;
        function[5 + k] = self.means[0] - self.means[1];
        function[10] = -self.means[0];
        function
    }

    /// Noise as a function of a row.
    fn noise(&self) -> Row {
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
    /// Σ weight row row'.
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

    /// The means for the old coefficients, then the coefficients for the new means, each by least
    /// squares, then the variance (Meng and Rubin 1993): no step lowers the likelihood.
    fn maximize(&self, squares: &Vec<Row>, _: f64) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let mut learned = self.clone();
        let of_means = |means: [f64; 2]| Self { means, ..self.clone() }.noise();
        let none = of_means([0.0; 2]);
        let mean = |means: [f64; 2]| difference(&of_means(means), &none);
        let means = least_squares(squares, &none, &[mean([1.0, 0.0]), mean([0.0, 1.0])])?;
        learned.means = [means[0], means[1]];
        let before: Vec<Row> =
            (1..5).map(|k| difference(&[0.0; WIDTH], &learned.deviation(k))).collect();
        let lags = least_squares(squares, &learned.deviation(0), &before)?;
        learned.lags.copy_from_slice(&lags);
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

/// The x for which fixed + Σ x_k terms_k has the least sum of squares.
fn least_squares(
    squares: &[Row],
    fixed: &Row,
    terms: &[Row],
) -> Result<Vec<f64>, Box<dyn Error + Send + Sync>> {
    let n = terms.len();
    let mut equations: Vec<Vec<f64>> = terms
        .iter()
        .map(|term| {
            let left = terms.iter().map(|other| product(squares, term, other));
            left.chain([-product(squares, term, fixed)]).collect()
        })
        .collect();
    // Gauss and Jordan: the matrix is positive definite, so that no pivot is 0.
    for k in 0..n {
        let pivot = equations[k].clone();
        if pivot[k] <= 0.0 {
            return Err("the quarters do not determine the parameters".into());
        }
        for (i, equation) in equations.iter_mut().enumerate() {
            let times = if i == k { 1.0 - 1.0 / pivot[k] } else { equation[k] / pivot[k] };
            equation.iter_mut().zip(&pivot).for_each(|(value, pivot)| *value -= times * pivot);
        }
    }
    Ok(equations.iter().map(|equation| equation[n]).collect())
}
