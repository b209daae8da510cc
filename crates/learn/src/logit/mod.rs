//! Moves whose probabilities depend on inputs: a multinomial logit out of each state
//! (sections 9 and 10 of the [formulas](wayfix::guide::formulas)).
//!
//! | file | |
//! |---|---|
//! | `mod.rs` | intercepts and slopes: how they are made, set and read |
//! | `operator.rs` | log-odds of the moves out of a state, valid inputs, products and entries |
//! | `learn.rs` | expected moves by inputs, and the M-step |
//! | `newton.rs` | its maximum, by Newton's method |

mod learn;
mod newton;
mod operator;

use std::collections::BTreeMap;

use wayfix::error::OutOfRange;
use wayfix::internal::{refuse_evidence, validate_with};
use wayfix::transition::kit::check_count;
use wayfix::{SparseTransition, Transition, TransitionEntries, TransitionError};
use wayfix_kernels::limits;

pub use learn::InputCounts;

/// An operator whose moves depend on inputs: the control of a step is a row of p numbers u, and the
/// moves out of a state j are a multinomial logit,
///
/// ```text
/// A[i, j](u) = exp(a_ij + b_ij · u) / Σ over the legal moves k of exp(a_kj + b_kj · u)
/// ```
///
/// with an **intercept** a and p **slopes** b for each legal move. For the time of day, the
/// weather, a dose: an input–output HMM (Bengio and Frasconi 1995), or a Markov switching model
/// with time-varying probabilities (Filardo 1994).
///
/// One of the moves out of a state is the *reference*: the stay if it is legal, else the move to
/// the lowest state. It has no slopes, so that those of the other moves change the log-odds against
/// it. [`with_shared_slopes`](Self::with_shared_slopes) makes other choices, and lets several moves
/// share slopes. Inputs are best centred and of similar size; a category with c values becomes c −
/// 1 inputs of 0 and 1, a time of day the sine and cosine of its angle. A missing input (NaN) is an
/// error: fill it in, or add an input that says that it is missing.
///
/// A product is O(E p); listing the entries into a state is O(p) for each move out of the states
/// that lead there. A step where an entry is below the range of doubles (log-odds of about 700)
/// is taken in logarithms: to inference it is [evidence](wayfix::Transition::evidence) with a factor
/// of 1, which simulation, and operators that take no evidence, refuse.
/// [Learning](wayfix::Hmm::learn) finds intercepts and slopes by Newton's method, and counts moves
/// by distinct rows of inputs ([`InputCounts`]).
///
/// ```
/// use wayfix_learn::LogitTransition;
/// use wayfix::{Belief, Hmm, LikelihoodVector, Prior, SparseTransition};
///
/// // A shop is quiet (0) or busy (1); noise from the street. At noon it fills up, at night it
/// // empties. Inputs are the sine and the cosine of the time of day.
/// let still = SparseTransition::from_rows(&[[0.8, 0.3], [0.2, 0.7]])?;
/// let moves = LogitTransition::new(&still, 2)?
///     .with_slopes(0, 1, &[0.0, -2.0])?
///     .with_slopes(1, 0, &[0.0, 2.0])?;
/// let at = |hour: f64| {
///     let angle = hour / 24.0 * std::f64::consts::TAU;
///     vec![angle.sin(), angle.cos()]
/// };
/// let noon = moves.at(&at(12.0))?;
/// assert!(noon.get(1, 0) > 0.64 && noon.get(0, 1) < 0.06);
///
/// let prior = Prior::BeforeFirstTransition(Belief::uniform(2)?);
/// let hmm = Hmm::new(prior, moves, LikelihoodVector::linear(2))?;
/// let mut filter = hmm.filter();
/// filter.step_with(&at(11.5), &[0.3, 0.6])?;
/// filter.step_with(&at(12.0), &[0.4, 0.5])?;
/// assert!(filter.belief().as_slice()[1] > 0.9);
/// assert!(filter.step_with(&vec![f64::NAN, 1.0], &[0.4, 0.5]).is_err());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Starting probabilities that depend on inputs
///
/// Add a state that is left and never entered, as the state before the first transition: the inputs
/// of step 1 then choose the state that a sequence starts in. The added state is never observed, so
/// that the sensor's parameters there are not learned; as the last state, it leaves the numbers of
/// the others as they are.
///
/// ```
/// use wayfix::inference::LearningOptions;
/// use wayfix_learn::LogitTransition;
/// use wayfix::{Belief, Controlled, Hmm, Prior, SparseTransition, TableLikelihood};
///
/// // States 0 and 1, and the start, 2, which leads to either.
/// let start = 2;
/// let moves = SparseTransition::from_rows(&[[0.9, 0.2, 0.5], [0.1, 0.8, 0.5], [0.0, 0.0, 0.0]])?;
/// let moves = LogitTransition::new(&moves, 1)?
///     .with_shared_slopes(|from, to| (from == start && to == 1).then_some(0));
/// let seen = TableLikelihood::from_rows(&[[0.9, 0.1], [0.2, 0.8], [0.5, 0.5]])?;
/// let prior = Prior::BeforeFirstTransition(Belief::certain(3, start)?);
/// let hmm = Hmm::new(prior, moves, seen)?;
///
/// // Sequences begin in state 1 more often where the input is 1 (its later values play no role).
/// let (low, high) = ([vec![0.0], vec![0.0]], [vec![1.0], vec![1.0]]);
/// let sequences = [
///     Controlled::new(&low, &[0, 0])?,
///     Controlled::new(&low, &[0, 1])?,
///     Controlled::new(&low, &[1, 1])?,
///     Controlled::new(&high, &[1, 1])?,
///     Controlled::new(&high, &[1, 0])?,
///     Controlled::new(&high, &[0, 0])?,
/// ];
/// let options = LearningOptions::default().with_iterations(5);
/// let learned = hmm.learn(&sequences, &options)?;
/// let model = learned.model();
/// assert!(model.transition().slopes(start, 1).is_some_and(|slopes| slopes[0] > 0.5));
/// assert_eq!(model.likelihood().probability(start, 1), Some(0.5)); // as it was
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct LogitTransition {
    /// The moves out of state j are `starts[j]..starts[j + 1]`.
    starts: Vec<u32>,
    /// The state that each move reaches; ascending within those out of a state.
    to: Vec<u32>,
    /// The moves into state i are `rows[row_starts[i]..row_starts[i + 1]]`: pairs (from, number of
    /// the move), ascending.
    row_starts: Vec<u32>,
    rows: Vec<(u32, u32)>,
    /// One for each move.
    intercepts: Vec<f64>,
    /// For each move the number of its group of slopes, from 1; 0 if it has none.
    groups: Vec<u32>,
    /// p slopes for each group.
    slopes: Vec<f64>,
    inputs: usize,
    ridge: f64,
    /// Bounds on the scores: the largest intercept, and the largest slope on each input.
    largest_intercept: f64,
    largest_slopes: Vec<f64>,
    /// Largest number of moves out of a state.
    widest: usize,
}

// Construction from another operator, or from parts.

/// A move as it is stored: from, to, intercept, and the number of its group of slopes, from 1, or 0
/// for none.
type Stored = (u32, u32, f64, u32);

impl LogitTransition {
    /// Creates an operator with the moves of another one, and its probabilities at inputs of 0:
    /// slopes are 0. Each legal move but the reference gets p slopes of its own. O(E p).
    ///
    /// # Errors
    ///
    /// [`TransitionError`] for no inputs, an operator that is not stochastic or has evidence on
    /// moves, or more than 2^32 − 1 moves.
    pub fn new<A>(moves: &A, inputs: usize) -> Result<Self, TransitionError>
    where
        A: TransitionEntries<Control = ()>,
    {
        validate_with(moves, &())?;
        refuse_evidence(moves, &(), "LogitTransition")?;
        let (mut stored, mut groups) = (Vec::new(), 0);
        for from in 0..moves.states() {
            let reference = reference(from, moves.outgoing(&(), from).map(|entry| entry.0));
            // Intercepts are log-odds against the reference, whose own is 0.
            let at_reference = |entry: &(usize, f64)| Some(entry.0) == reference;
            let base = moves.outgoing(&(), from).find(at_reference).map_or(1.0, |entry| entry.1);
            for (to, p) in moves.outgoing(&(), from) {
                let group = if Some(to) == reference { 0 } else { groups + 1 };
                groups = groups.max(group);
                // A difference of logarithms: a quotient may leave the range of doubles.
                let odds = if group == 0 { 0.0 } else { p.ln() - base.ln() };
                stored.push((from as u32, to as u32, odds, group));
            }
            check_count("moves", stored.len())?;
        }
        let slopes = vec![0.0; groups as usize * inputs];
        Self::from_parts(moves.states(), &stored, slopes, inputs, 0.0)
    }

    /// Creates an operator from moves, column by column, and checks coefficients.
    pub(crate) fn from_parts(
        states: usize,
        moves: &[Stored],
        slopes: Vec<f64>,
        inputs: usize,
        ridge: f64,
    ) -> Result<Self, TransitionError> {
        if inputs == 0 {
            return Err(OutOfRange::new("the number of inputs", 0.0, "at least 1").into());
        }
        let mut starts = vec![0_u32; states + 1];
        let mut row_starts = starts.clone();
        for &(from, to, ..) in moves {
            starts[from as usize + 1] += 1;
            row_starts[to as usize + 1] += 1;
        }
        // `starts` still holds the lengths of columns, one place late. The loop turns them into
        // running sums.
        let widest = starts.iter().copied().max().unwrap_or(0) as usize;
        for starts in [&mut starts, &mut row_starts] {
            (1..=states).for_each(|state| starts[state] += starts[state - 1]);
        }
        // Moves come by ascending origin, so those into each state do as well.
        let (mut rows, mut next) = (vec![(0, 0); moves.len()], row_starts.clone());
        for (at, &(from, to, ..)) in (0..).zip(moves) {
            let slot = &mut next[to as usize];
            rows[*slot as usize] = (from, at);
            *slot += 1;
        }
        let mut a = Self {
            starts,
            to: moves.iter().map(|m| m.1).collect(),
            row_starts,
            rows,
            intercepts: moves.iter().map(|m| m.2).collect(),
            groups: moves.iter().map(|m| m.3).collect(),
            slopes,
            inputs,
            ridge: 0.0,
            largest_intercept: 0.0,
            largest_slopes: Vec::new(),
            widest,
        };
        a.check_and_bound()?;
        a.with_ridge(ridge)
    }

    /// Checks coefficients, and computes their bounds.
    fn check_and_bound(&mut self) -> Result<(), TransitionError> {
        let wrong = |value: &f64| !limits::is_log(*value);
        let expected = "a value from -1e300 to 1e300";
        if let Some(at) = self.intercepts.iter().position(wrong) {
            let what = format!("the intercept of {}", self.name(at));
            return Err(OutOfRange::new(what, self.intercepts[at], expected).into());
        }
        if let Some(at) = self.slopes.iter().position(wrong) {
            let group = (at / self.inputs + 1) as u32;
            let first = self.groups.iter().position(|other| *other == group);
            let name = first.map_or_else(|| "no move".to_owned(), |first| self.name(first));
            let what = format!("the slope of {name} on input {}", at % self.inputs);
            return Err(OutOfRange::new(what, self.slopes[at], expected).into());
        }
        let largest = |a: f64, b: &f64| a.max(b.abs());
        self.largest_intercept = self.intercepts.iter().fold(0.0, largest);
        let column = |k: usize| self.slopes.iter().skip(k).step_by(self.inputs);
        let with_slopes = if self.slopes.is_empty() { 0 } else { self.inputs };
        self.largest_slopes = (0..with_slopes).map(|k| column(k).fold(0.0, largest)).collect();
        Ok(())
    }

    /// Shares slopes by labels, `label(from, to)`: moves with the same label have the same slopes,
    /// and those with `None` have none. Each move keeps its own intercept. All slopes become 0.
    /// O(E log E).
    ///
    /// Only differences within a state matter: give one of its moves, such as the stay, no slopes,
    /// unless you want a [ridge](Self::with_ridge) to decide.
    ///
    /// ```
    /// use wayfix_learn::LogitTransition;
    /// use wayfix::SparseTransition;
    ///
    /// // A loop of three places: rain changes how readily a vehicle moves on, in all alike.
    /// let moves = (0..3).flat_map(|j| [(j, j, 0.5), ((j + 1) % 3, j, 0.5)]);
    /// let road = SparseTransition::from_triplets(3, moves)?;
    /// let road = LogitTransition::new(&road, 1)?
    ///     .with_shared_slopes(|from, to| (from != to).then_some(0))
    ///     .with_slopes(0, 1, &[-1.0])?;
    /// assert_eq!(road.slopes(1, 2), Some(&[-1.0][..]));
    /// assert!(road.at(&[1.0])?.get(0, 2) < 0.27);
    /// # Ok::<(), wayfix::TransitionError>(())
    /// ```
    #[must_use]
    pub fn with_shared_slopes(
        mut self,
        mut label: impl FnMut(usize, usize) -> Option<usize>,
    ) -> Self {
        let mut known = BTreeMap::new();
        for from in 0..self.states() {
            for at in self.column(from) {
                let next = known.len() as u32 + 1;
                let label = label(from, self.to[at] as usize);
                self.groups[at] = label.map_or(0, |label| *known.entry(label).or_insert(next));
            }
        }
        self.slopes = vec![0.0; known.len() * self.inputs];
        self.largest_slopes = vec![0.0; if known.is_empty() { 0 } else { self.inputs }];
        self
    }
}

/// The stay if it is among the moves out of a state, else the first of them.
fn reference(from: usize, mut ways: impl Iterator<Item = usize>) -> Option<usize> {
    let first = ways.next()?;
    Some(if first == from || ways.any(|to| to == from) { from } else { first })
}

// Intercepts and slopes of the moves: setting and reading them. Every change ends in
// `check_and_bound`, which checks all coefficients and computes the bounds on scores anew.

impl LogitTransition {
    /// Name of a move in errors.
    fn name(&self, at: usize) -> String {
        // The last column that starts at or before the move.
        let from = self.starts.partition_point(|start| *start as usize <= at) - 1;
        format!("the move from state {from} to state {}", self.to[at])
    }

    /// Number of a move among all moves, column by column.
    fn find(&self, from: usize, to: usize) -> Option<usize> {
        if from >= self.states() {
            return None;
        }
        let column = self.column(from);
        let found = self.to[column.clone()].binary_search_by_key(&to, |to| *to as usize);
        found.ok().map(|at| column.start + at)
    }

    fn legal(&self, from: usize, to: usize) -> Result<usize, TransitionError> {
        self.find(from, to).ok_or(TransitionError::Forbidden { to, from })
    }

    /// Sets the intercept of a move. O(E p), since the bounds on all coefficients are computed
    /// anew.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Forbidden`] for a move that is not legal, or
    /// [`TransitionError::Parameter`] for a value beyond ±1e300.
    pub fn with_intercept(
        mut self,
        from: usize,
        to: usize,
        intercept: f64,
    ) -> Result<Self, TransitionError> {
        let at = self.legal(from, to)?;
        self.intercepts[at] = intercept;
        self.check_and_bound()?;
        Ok(self)
    }

    /// Sets the slopes of a move, and of all moves that share them. O(E p).
    ///
    /// # Errors
    ///
    /// [`TransitionError::Forbidden`] for a move that is not legal, or
    /// [`TransitionError::Parameter`] for a move without slopes, a number of slopes other than that
    /// of inputs, or a value beyond ±1e300.
    pub fn with_slopes(
        mut self,
        from: usize,
        to: usize,
        slopes: &[f64],
    ) -> Result<Self, TransitionError> {
        let at = self.legal(from, to)?;
        let held = self.slopes_at(at).len();
        if slopes.len() != held {
            let what = format!("the number of slopes given for {}", self.name(at));
            let expected =
                if held == 0 { "0, as the move has none" } else { "the number of inputs" };
            return Err(OutOfRange::new(what, slopes.len() as f64, expected).into());
        }
        if held > 0 {
            let first = (self.groups[at] as usize - 1) * self.inputs;
            self.slopes[first..first + held].copy_from_slice(slopes);
        }
        self.check_and_bound()?;
        Ok(self)
    }

    /// Sets the precision λ of a Gaussian prior on the slopes, with mean 0 and variance 1 / λ; 0,
    /// the default, for no prior. Intercepts have no prior. It is part of the objective of
    /// learning.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Parameter`] for a value that is NaN, negative or infinite.
    pub fn with_ridge(mut self, precision: f64) -> Result<Self, TransitionError> {
        if !(precision >= 0.0 && precision.is_finite()) {
            let expected = "a finite value of at least 0";
            return Err(OutOfRange::new("the precision of the ridge", precision, expected).into());
        }
        self.ridge = precision;
        Ok(self)
    }

    /// Number of inputs, p.
    #[must_use]
    pub fn inputs(&self) -> usize {
        self.inputs
    }

    /// Precision of the prior on slopes.
    #[must_use]
    pub fn ridge(&self) -> f64 {
        self.ridge
    }

    /// Legal moves (from, to), column by column.
    pub fn moves(&self) -> impl Iterator<Item = (usize, usize)> {
        let states = 0..self.states();
        states
            .flat_map(|from| self.to[self.column(from)].iter().map(move |to| (from, *to as usize)))
    }

    /// Intercept of a move; `None` if it is not legal.
    #[must_use]
    pub fn intercept(&self, from: usize, to: usize) -> Option<f64> {
        self.find(from, to).map(|at| self.intercepts[at])
    }

    /// Slopes of a move, empty if it has none; `None` if the move is not legal.
    #[must_use]
    pub fn slopes(&self, from: usize, to: usize) -> Option<&[f64]> {
        self.find(from, to).map(|at| self.slopes_at(at))
    }

    /// Index of the slopes of a move, from 0, the same for all moves that share them; `None` if the
    /// move has none, or is not legal.
    #[must_use]
    pub fn slope_group(&self, from: usize, to: usize) -> Option<usize> {
        self.find(from, to).and_then(|at| (self.groups[at] as usize).checked_sub(1))
    }

    /// The reference of a state, the move whose intercept learning keeps: the stay if it is legal,
    /// else the move to the lowest state; `None` for a state that does not exist.
    #[must_use]
    pub fn reference(&self, from: usize) -> Option<usize> {
        let exists = from < self.states();
        exists
            .then(|| self.to[self.column(from)].iter().map(|to| *to as usize))
            .and_then(|ways| reference(from, ways))
    }

    /// Intercepts of all moves, column by column.
    #[cfg(feature = "serde")]
    pub(crate) fn intercepts(&self) -> &[f64] {
        &self.intercepts
    }

    /// Slopes of each group.
    #[cfg(feature = "serde")]
    pub(crate) fn groups(&self) -> impl Iterator<Item = Vec<f64>> {
        self.slopes.chunks_exact(self.inputs).map(<[f64]>::to_vec)
    }

    /// The matrix at inputs u. O(E p).
    ///
    /// # Errors
    ///
    /// [`TransitionError::Control`] for inputs that are not valid.
    pub fn at(&self, inputs: &[f64]) -> Result<SparseTransition, TransitionError> {
        self.check_inputs(inputs)?;
        let columns = (0..self.states()).map(|from| (from, self.list(inputs, from)));
        let entries = columns.flat_map(|(from, column)| column.map(move |(to, p)| (to, from, p)));
        SparseTransition::from_triplets(self.states(), entries)
    }
}

#[cfg(feature = "serde")]
wayfix::stored! {
    [] LogitTransition: [], |a| {
        states: usize = a.states(),
        inputs: usize = a.inputs(),
        to: Vec<u32> = a.moves().map(|(_, to)| to as u32).collect::<Vec<_>>(),
        from: Vec<u32> = a.moves().map(|(from, _)| from as u32).collect::<Vec<_>>(),
        intercept: Vec<f64> = a.intercepts(),
        group: Vec<Option<u32>> = {
            let group = |(from, to)| a.slope_group(from, to).map(|group| group as u32);
            a.moves().map(group).collect::<Vec<_>>()
        },
        slopes: Vec<Vec<f64>> = a.groups().collect::<Vec<_>>(),
        ridge: f64 = a.ridge(),
    } => logit(states, inputs, [&to, &from], (&intercept, &group, &slopes), ridge);
}

/// Coefficients of moves: intercepts, numbers of slopes, and the slopes.
#[cfg(feature = "serde")]
type Coefficients<'a> = (&'a [f64], &'a [Option<u32>], &'a [Vec<f64>]);

#[cfg(feature = "serde")]
fn logit(
    states: usize,
    inputs: usize,
    [to, from]: [&[u32]; 2],
    (intercept, group, slopes): Coefficients<'_>,
    ridge: f64,
) -> Result<LogitTransition, wayfix::TransitionError> {
    for (what, found) in
        [("from", from.len()), ("intercept", intercept.len()), ("group", group.len())]
    {
        if found != to.len() {
            let what = format!("the number of values in `{what}`");
            let expected = "as many as in `to`";
            return Err(wayfix::error::OutOfRange::new(what, found as f64, expected).into());
        }
    }
    if states == 0 {
        return Err(wayfix::TransitionError::Empty);
    }
    // Column by column: each move comes after the previous one, and no state is skipped, since none
    // is without a move.
    let mut last = None;
    for (&from, &to) in from.iter().zip(to) {
        let (to, from) = (to as usize, from as usize);
        if to >= states || from >= states {
            return Err(wayfix::TransitionError::OutOfRange { to, from, states });
        }
        let next = last.map_or(0, |(before, _)| before + 1);
        match last {
            Some(before) if (from, to) == before => {
                return Err(wayfix::TransitionError::Duplicate { to, from });
            }
            Some(before) if (from, to) < before => {
                let what = format!("the state left by a move from state {from} to state {to}");
                let expected = "moves column by column, in ascending order";
                return Err(wayfix::error::OutOfRange::new(what, from as f64, expected).into());
            }
            _ if from > next => return Err(wayfix::TransitionError::NoWeight { column: next }),
            _ => last = Some((from, to)),
        }
    }
    let left = last.map_or(0, |(from, _)| from + 1);
    if left < states {
        return Err(wayfix::TransitionError::NoWeight { column: left });
    }
    let mut used = vec![false; slopes.len()];
    for &group in group.iter().flatten() {
        let used = used.get_mut(group as usize);
        *used.ok_or_else(|| {
            let expected = "the number of one of the rows of `slopes`, from 0";
            wayfix::error::OutOfRange::new(
                "a number of slopes in `group`",
                f64::from(group),
                expected,
            )
        })? = true;
    }
    if let Some(unused) = used.iter().position(|used| !used) {
        let expected = "a number in `group`";
        return Err(wayfix::error::OutOfRange::new(
            "a row of `slopes` without a move",
            unused as f64,
            expected,
        )
        .into());
    }
    if let Some(row) = slopes.iter().find(|row| row.len() != inputs) {
        let expected = "the number of inputs";
        return Err(wayfix::error::OutOfRange::new(
            "the number of slopes in a row",
            row.len() as f64,
            expected,
        )
        .into());
    }
    let moves = from.iter().zip(to).zip(intercept.iter().zip(group));
    let moves = moves.map(|((&from, &to), (&a, group))| (from, to, a, group.map_or(0, |g| g + 1)));
    LogitTransition::from_parts(states, &moves.collect::<Vec<_>>(), slopes.concat(), inputs, ridge)
}
