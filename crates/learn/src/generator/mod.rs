//! [`GeneratorTransition`], continuous time: states are left at rates, and a step takes any time.
//!
//! | file | |
//! |---|---|
//! | `build.rs` | checks of rates, and the stochastic matrix of the sum |
//! | `series.rs` | exp(Q Δt) x by uniformisation, and where its sum ends |
//! | `poisson.rs` | the weights of the sum |
//! | `doubling.rs` | exp(Q Δt) as a matrix, where that is cheaper |
//! | `entries.rs` | rows and columns of exp(Q Δt) |
//! | `expected.rs` | expected moves and times in states, given both ends of a step |
//! | `learn.rs` | rates from these |
//!
//! Sums and products are of numbers that are not negative, so that errors stay relative for each
//! state. The only difference is P's diagonal, 1 − exit rate / Λ, in `build.rs`.

mod build;
mod doubling;
mod entries;
mod expected;
mod learn;
mod poisson;
mod series;

use std::fmt;

pub use learn::GeneratorStatistics;

use wayfix::TransitionError;
use wayfix::internal::{Compressed, check_slices};
use wayfix::{SparseTransition, Transition};

/// Largest Λ Δt for more than [`DENSE_STATES`](doubling::DENSE_STATES) states. The rounding of that
/// many products may add up to 1e-6, the tolerance for the sum of a prediction.
const MOST_PRODUCTS: f64 = (1_u64 << 30) as f64;

/// An operator for irregular and continuous time: exp(Q Δt), with the rates Q of moves and the time
/// Δt since the last observation, in any unit, as its control.
///
/// It is built from the rates q of legal moves; a state without moves is absorbing. Between
/// observations the vehicle may make any number of moves, at any moment: it leaves state j after an
/// exponential time of mean 1 / Σ_i q\[i, j\]. A gap is a step with a long Δt and needs no rows of
/// missing values. [`TransitionEntries`](super::TransitionEntries) lists the moves of a whole step,
/// between all pairs of connected states; learning estimates the rates.
///
/// ```
/// use wayfix::inference::LearningOptions;
/// use wayfix_learn::GeneratorTransition;
/// use wayfix::{Belief, Controlled, Fixed, Hmm, Prior, TableLikelihood};
///
/// // A bus waits at a stop, rides, or stands in the depot. Rates per minute: (to, from, rate).
/// let moves = [(1, 0, 2.0), (0, 1, 0.5), (2, 1, 0.0625), (1, 2, 0.01)];
/// let motion = GeneratorTransition::from_triplets(3, moves)?;
/// assert_eq!((motion.rate(0, 1), motion.exit_rate(1)), (0.5, 0.5625));
///
/// let sensor = TableLikelihood::from_rows(&[[0.9, 0.1], [0.2, 0.8], [0.9, 0.1]])?; // still, moving
/// let prior = Prior::AtFirstObservation(Belief::uniform(3)?);
/// let hmm = Hmm::new(prior, motion, Fixed(sensor))?;
///
/// // Observations at irregular times: minutes since the last one. A night is one long step.
/// let minutes = [0.0, 0.2, 0.7, 0.1, 3.0, 480.0, 0.5, 0.5];
/// let seen = [0, 0, 1, 1, 0, 0, 0, 0];
/// let drive = Controlled::new(&minutes, &seen)?;
/// let smoothing = hmm.smooth(&drive)?;
/// assert!(smoothing.posteriors().get(8).unwrap().as_slice()[2] > 0.5); // in the depot
/// let path = hmm.viterbi(&drive)?;
/// assert_eq!(path.states()[2..4], [1, 1]);
///
/// let learned = hmm.learn(&[drive], &LearningOptions::default())?;
/// assert!(learned.log_likelihood() > smoothing.log_likelihood());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # How exact
///
/// exp(Q Δt) x is computed by uniformisation (Jensen 1953), a sum without negative terms. With Λ
/// for 1.25 times the largest exit rate, a state's probability has a relative error of about (20 +
/// Λ Δt) 2^-52 for each entry in its row of Q, however small it is: the terms left out of the sum
/// are at most 2^-54 of it, for each state separately. Entries below 2.2e-308 have lost digits or
/// are 0, as with all operators. The sum of x is kept. For a Δt of 0 the step is the identity.
///
/// # Cost
///
/// A product with exp(Q Δt) takes about Λ Δt + 8 √(Λ Δt) + 20 products with Q, each O(n + E) for E
/// moves. It takes more if the belief has zeros or differs by many orders of magnitude from state
/// to state, until all reachable states are reached (up to some 170 for a Λ Δt of 1), and fewer if
/// Λ Δt is large and the belief stops changing earlier. For up to 512 states, a matrix is used
/// where it is cheaper, in O(n³ log(Λ Δt)) and n² numbers of memory. For more states, Λ Δt may be
/// at most 2^30.
///
/// A row or column of entries costs such a product, and allocates; a step of Viterbi costs n of
/// them. If Δt takes few values, a [`SwitchedTransition`](super::SwitchedTransition) of matrices is
/// faster.
///
/// # Learning
///
/// By expectation and maximisation (Hobolth and Jensen 2011): given the observations, a step of
/// time Δt has an expected number of each legal move and an expected time in each state, and the
/// rate of a move is the sum of the former over that of the latter.
/// [Statistics](GeneratorStatistics) are sums of both. A step adds to them by three series, without
/// listing moves, in O(√(Λ Δt) n + E) memory. For labelled drives, and for steps in logarithms,
/// moves are counted for each Δt, and converted to both by one product and three series for each
/// state that is left. A state without any time keeps its rates. A pseudo-count is added to the
/// number of each legal move, for a log-prior of pseudo-count times Σ ln q; with it, rates out of a
/// state that is hardly ever visited become large.
#[derive(Clone)]
pub struct GeneratorTransition {
    /// Rates of legal moves, by the state that is left.
    rates: Compressed,
    /// Σ of the rates out of each state.
    exits: Vec<f64>,
    /// Λ, the rate of steps of the chain.
    uniform_rate: f64,
    /// P = I + Q / Λ.
    chain: SparseTransition,
    /// Relative rounding error of a product with P: half an epsilon for each term of the longest
    /// sum, and four more.
    rounding: f64,
}

impl fmt::Debug for GeneratorTransition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut fields = f.debug_struct("GeneratorTransition");
        fields.field("states", &self.exits.len()).field("moves", &self.rates.entries());
        fields.finish_non_exhaustive()
    }
}

impl GeneratorTransition {
    /// Returns the rate of a move, or 0 if it is not legal or a state does not exist.
    /// O(log moves out of the state).
    #[must_use]
    pub fn rate(&self, to: usize, from: usize) -> f64 {
        if from >= self.exits.len() {
            return 0.0;
        }
        let at = self.rates.indices(from).binary_search_by_key(&to, |to| *to as usize).ok();
        at.and_then(|at| self.rates.line(from).nth(at)).map_or(0.0, |entry| entry.1)
    }

    /// Returns the sum of the rates out of a state, one over its mean stay; 0 if the state is
    /// absorbing or does not exist.
    #[must_use]
    pub fn exit_rate(&self, state: usize) -> f64 {
        self.exits.get(state).copied().unwrap_or(0.0)
    }

    /// Returns the rates as (to, from, rate), by the state that is left, as
    /// [`from_triplets`](Self::from_triplets) takes them.
    pub fn triplets(&self) -> impl Iterator<Item = (usize, usize, f64)> {
        let columns = 0..self.exits.len();
        columns.flat_map(|from| self.rates.line(from).map(move |(to, rate)| (to, from, rate)))
    }

    /// Λ Δt, the expected number of steps of the chain.
    fn mean_steps(&self, time: f64) -> f64 {
        self.uniform_rate * time
    }
}

impl Transition for GeneratorTransition {
    type Control = f64;

    fn states(&self) -> usize {
        self.exits.len()
    }

    fn apply(&self, &time: &f64, x: &[f64], out: &mut [f64]) {
        check_slices(self.states(), x, out);
        self.exponential(self.mean_steps(time), false, x, out);
    }

    fn apply_transpose(&self, &time: &f64, x: &[f64], out: &mut [f64]) {
        check_slices(self.states(), x, out);
        self.exponential(self.mean_steps(time), true, x, out);
    }

    fn check_control(&self, &time: &f64) -> Result<(), TransitionError> {
        if !(time >= 0.0 && time.is_finite()) {
            let text = format!("a time step of {time}, expected a finite one of at least 0");
            return Err(TransitionError::Control(text));
        }
        let large = self.states() > doubling::DENSE_STATES;
        let most = if large { MOST_PRODUCTS } else { f64::MAX };
        if self.mean_steps(time) > most {
            let longest = most / self.uniform_rate;
            let text =
                format!("a time step of {time}, expected at most {longest:e} at these rates");
            return Err(TransitionError::Control(text));
        }
        Ok(())
    }
}

#[cfg(feature = "serde")]
wayfix::stored! {
    [] GeneratorTransition: [], |a| {
        rates: Vec<Vec<(usize, f64)>> = {
            let mut rates = vec![Vec::new(); a.states()];
            a.triplets().for_each(|(to, from, rate)| rates[from].push((to, rate)));
            rates
        },
    } => {
        let columns = rates.iter().enumerate();
        let moves = columns.flat_map(|(from, out)| out.iter().map(move |&(to, rate)| (to, from, rate)));
        Self::from_triplets(rates.len(), moves)
    };
}
