//! [`GeneratorTransition`], continuous time: states are left at rates, and a step takes any time.
//!
//! | file | |
//! |---|---|
//! | `mod.rs` | rates and their checks, the stochastic matrix of the sum, the operator and its entries |
//! | `exponential.rs` | exp(Q Δt) x by uniformisation, its weights, and as a matrix where that is cheaper |
//! | `learn.rs` | expected moves and times in states, given both ends of a step, and rates from these |
//!
//! Sums and products are of numbers that are not negative, so that errors stay relative for each
//! state. The only difference is P's diagonal, 1 − exit rate / Λ, in `from_columns`.

mod exponential;
mod learn;

use std::fmt;

use wayfix::error::OutOfRange;
use wayfix::internal::{Compressed, buffers};
use wayfix::transition::kit::{best_of, check_count, check_slices};
use wayfix::{ReorderStates, SparseTransition, Transition, TransitionEntries, TransitionError};
use wayfix_kernels::limits::LIFT;
use wayfix_kernels::log2;

use exponential::multiply;

pub use learn::GeneratorStatistics;

/// Largest Λ Δt for more than [`DENSE_STATES`](exponential::DENSE_STATES) states. The rounding of that
/// many products may add up to 1e-6, the tolerance for the sum of a prediction.
const MOST_PRODUCTS: f64 = (1_u64 << 30) as f64;

/// An operator for irregular and continuous time: exp(Q Δt), with the rates Q of moves and the time
/// Δt since the last observation, in any unit, as its control.
///
/// It is built from the rates q of legal moves; a state without moves is absorbing. Between
/// observations the vehicle may make any number of moves, at any moment: it leaves state j after an
/// exponential time of mean 1 / Σ_i q\[i, j\]. A gap is a step with a long Δt and needs no rows of
/// missing values. [`TransitionEntries`](wayfix::TransitionEntries) lists the moves of a whole step,
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
/// them. If Δt takes few values, a [`SwitchedTransition`](wayfix::transition::SwitchedTransition) of matrices is
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
        let large = self.states() > exponential::DENSE_STATES;
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

// Generators from rates: P = I + Q / Λ, by columns, with Λ = 1.25 times the largest exit rate.

/// Λ over the largest exit rate. With 1, a diagonal entry of P could be 0, and beliefs could
/// alternate without ever settling; the larger it is, the more products a step takes.
const MARGIN: f64 = 1.25;

impl GeneratorTransition {
    /// Creates an operator from triplets (to, from, rate) of the moves between different states, in
    /// any order. Rates of 0 are skipped. O(n + moves).
    ///
    /// ```
    /// use wayfix_learn::GeneratorTransition;
    ///
    /// let error = GeneratorTransition::from_triplets(2, [(1, 0, 3.0), (0, 0, -3.0)]).unwrap_err();
    /// assert!(error.to_string().starts_with("the rate from state 0 to itself is -3, expected none"));
    /// ```
    ///
    /// # Errors
    ///
    /// [`TransitionError`] for no states, an index out of range, a rate that is NaN, negative or
    /// infinite, or below 2.2e-308 of the largest exit rate, a rate above 0 from a state to itself
    /// or given twice, an exit rate that overflows, or more than 2^31 − 1 states or 2^32 − 1 moves.
    pub fn from_triplets(
        states: usize,
        triplets: impl IntoIterator<Item = (usize, usize, f64)>,
    ) -> Result<Self, TransitionError> {
        let triplets: Vec<_> = triplets.into_iter().collect();
        let own =
            triplets.iter().find(|&&(to, from, rate)| to == from && from < states && rate != 0.0);
        if let Some(&(state, _, rate)) = own {
            let what = format!("the rate from state {state} to itself");
            let expected = "none: the rates to other states say when a state is left";
            return Err(OutOfRange::new(what, rate, expected).into());
        }
        // P also has a diagonal entry for each state, so the number of states is added.
        let wrong = |(to, from, value)| TransitionError::Rate { to, from, value };
        let entries = SparseTransition::above_zero(states, triplets, wrong)?;
        check_count("moves", entries.len().saturating_add(states))?;
        let rows = Compressed::new(states, entries.iter().copied()).transposed();
        for to in 0..states {
            if let Some(twice) = rows.indices(to).windows(2).find(|pair| pair[0] == pair[1]) {
                return Err(TransitionError::Duplicate { to, from: twice[0] as usize });
            }
        }
        Self::from_columns(rows.transposed())
    }

    /// Builds the operator from rates by the state that is left.
    fn from_columns(rates: Compressed) -> Result<Self, TransitionError> {
        let states = rates.lines();
        let exit = |from: usize| rates.line(from).map(|entry| entry.1).sum::<f64>();
        let exits: Vec<f64> = (0..states).map(exit).collect();
        if let Some(state) = exits.iter().position(|exit| *exit * MARGIN > f64::MAX) {
            let what = format!("the sum of the rates out of state {state}");
            return Err(OutOfRange::new(what, exits[state], "at most 1.4e308").into());
        }
        let uniform_rate = exits.iter().copied().fold(0.0, f64::max) * MARGIN;
        let mut entries = Vec::with_capacity(rates.entries() + states);
        for (from, exit) in exits.iter().enumerate() {
            for (to, rate) in rates.line(from) {
                // A legal move must stay possible, with all its digits.
                let p = rate / uniform_rate;
                if p < f64::MIN_POSITIVE {
                    let what = format!("the rate from state {from} to state {to}");
                    let expected =
                        "at least 2.2e-308 of 1.25 times the largest sum of rates out of a state";
                    return Err(OutOfRange::new(what, rate, expected).into());
                }
                entries.push((to, from, p));
            }
            // 1 − exit / Λ is at least 1 − 1 / 1.25 = 0.2, so little cancels.
            let stay = if uniform_rate > 0.0 { (uniform_rate - exit) / uniform_rate } else { 1.0 };
            entries.push((from, from, stay));
        }
        let chain = SparseTransition::from_triplets(states, entries)?;
        // A sum of m products has a relative error of up to m / 2 epsilons, in either direction.
        let lines = [chain.rows(), chain.columns()];
        let longest = lines.iter().flat_map(|lines| lines.starts().windows(2));
        let longest = longest.map(|ends| ends[1] - ends[0]).max().unwrap_or(0);
        let rounding = (4.0 + 0.5 * f64::from(longest)) * f64::EPSILON;
        Ok(Self { rates, exits, uniform_rate, chain, rounding })
    }
}

impl ReorderStates for GeneratorTransition {
    fn reordered(&self, order: &[usize]) -> Self {
        let new = wayfix::internal::positions(order);
        let entry =
            |(to, from, rate): (usize, usize, f64)| (new[from] as u32, new[to] as u32, rate);
        let entries: Vec<_> = self.triplets().map(entry).collect();
        let rates = Compressed::new(order.len(), entries.iter().copied());
        let chain = self.chain.reordered(order);
        let exits = order.iter().map(|&old| self.exits[old]).collect();
        let rates = rates.transposed().transposed();
        Self { rates, exits, chain, ..*self }
    }
}

// Rows and columns of exp(Q Δt), each by a product.

/// log2 of an entry that was computed from a lifted unit vector. With the lift, entries below the
/// smallest double have a logarithm, and the terms of an entry keep all their digits.
fn log2_of_lifted(entry: f64) -> f64 {
    log2(entry) - LIFT.log2()
}

impl GeneratorTransition {
    /// Lists the entries above 0 of a column, or of a row if `transposed`, times `unit`.
    fn line_by_product(
        &self,
        time: f64,
        transposed: bool,
        state: usize,
        unit: f64,
    ) -> impl Iterator<Item = (usize, f64)> + use<> {
        // The iterator outlives this call, so its values can't be in a lent buffer.
        let mut line = vec![0.0; self.states()];
        buffers::with(line.len(), |x| {
            x.fill(0.0);
            x[state] = unit;
            self.exponential(self.mean_steps(time), transposed, x, &mut line);
        });
        line.into_iter().enumerate().filter(|entry| entry.1 > 0.0)
    }

    fn line_by_product_log2(
        &self,
        time: f64,
        transposed: bool,
        state: usize,
    ) -> impl Iterator<Item = (usize, f64)> + use<> {
        let line = self.line_by_product(time, transposed, state, LIFT);
        line.map(|(other, entry)| (other, log2_of_lifted(entry)))
    }
}

impl TransitionEntries for GeneratorTransition {
    fn incoming(&self, &time: &f64, to: usize) -> impl Iterator<Item = (usize, f64)> {
        self.line_by_product(time, true, to, 1.0)
    }

    fn outgoing(&self, &time: &f64, from: usize) -> impl Iterator<Item = (usize, f64)> {
        self.line_by_product(time, false, from, 1.0)
    }

    fn incoming_log2(&self, &time: &f64, to: usize) -> impl Iterator<Item = (usize, f64)> {
        self.line_by_product_log2(time, true, to)
    }

    fn outgoing_log2(&self, &time: &f64, from: usize) -> impl Iterator<Item = (usize, f64)> {
        self.line_by_product_log2(time, false, from)
    }

    fn max_product(&self, &time: &f64, x: &[f64], out: &mut [f64], from: &mut [u32]) {
        const NEEDS_MATRIX: u32 = u32::MAX;
        let (n, mean) = (x.len(), self.mean_steps(time));
        buffers::with_two(n, |unit, row| {
            unit.fill(0.0);
            let best = |row: &[f64]| best_of((0..).zip(row.iter().map(|&p| log2_of_lifted(p))), x);
            // Row by row, by the series. A row whose series would cost more than the matrix is
            // marked for later.
            for (i, (out, from)) in out.iter_mut().zip(&mut *from).enumerate() {
                unit[i] = LIFT;
                let found = if mean == 0.0 {
                    row.copy_from_slice(unit);
                    true
                } else {
                    self.try_series(mean, true, unit, row)
                };
                unit[i] = 0.0;
                (*out, *from) = if found { best(row) } else { (0.0, NEEDS_MATRIX) };
            }
            if !from.contains(&NEEDS_MATRIX) {
                return;
            }
            // One matrix for all marked rows. `incoming_log2` makes the same choice for each row,
            // so that both give the same numbers.
            buffers::with(n * n, |matrix| {
                self.matrix(mean, matrix);
                for (i, (out, from)) in out.iter_mut().zip(&mut *from).enumerate() {
                    if *from == NEEDS_MATRIX {
                        unit[i] = LIFT;
                        multiply(matrix, true, unit, row);
                        unit[i] = 0.0;
                        (*out, *from) = best(row);
                    }
                }
            });
        });
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
