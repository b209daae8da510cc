//! Moves whose probabilities depend on inputs: a multinomial logit out of each state
//! (sections 9 and 10 of the [formulas](wayfix::guide::formulas)).
//!
//! | file | |
//! |---|---|
//! | `build.rs`, `coefficients.rs` | intercepts and slopes: how they are made, set and read |
//! | `scores.rs` | log-odds of the moves out of a state, their sums, and what inputs are valid |
//! | `operator.rs`, `entries.rs` | products and entries |
//! | `counts.rs`, `data.rs`, `learn.rs` | expected moves by inputs, and the M-step |
//! | `newton.rs`, `expansion.rs`, `factor.rs` | its maximum, by Newton's method |

mod build;
mod coefficients;
mod counts;
mod data;
mod entries;
mod expansion;
mod factor;
mod learn;
mod newton;
mod operator;
mod scores;

pub use counts::InputCounts;

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
/// that lead there. A step in which an entry is below the range of doubles (log-odds of about 700)
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
/// of step 1 then choose the state in which a sequence starts. It is never observed, so that the
/// sensor's parameters there are not learned; as the last state, it leaves the numbers of the
/// others as they are.
///
/// ```
/// use wayfix::inference::LearningOptions;
/// use wayfix_learn::LogitTransition;
/// use wayfix::{Belief, Controlled, Hmm, Prior, SparseTransition, TableLikelihood};
///
/// // States 0 and 1, and the start, 2, from which sequences begin in either.
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

#[cfg(feature = "serde")]
use wayfix::Transition;

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
            return Err(wayfix::error::Parameter::new(what, found as f64, expected).into());
        }
    }
    if states == 0 {
        return Err(wayfix::TransitionError::Empty);
    }
    // Column by column: each move comes after the one before, and no state without a move is skipped.
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
                return Err(wayfix::error::Parameter::new(what, from as f64, expected).into());
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
            wayfix::error::Parameter::new(
                "a number of slopes in `group`",
                f64::from(group),
                expected,
            )
        })? = true;
    }
    if let Some(unused) = used.iter().position(|used| !used) {
        let expected = "a number in `group`";
        return Err(wayfix::error::Parameter::new(
            "a row of `slopes` without a move",
            unused as f64,
            expected,
        )
        .into());
    }
    if let Some(row) = slopes.iter().find(|row| row.len() != inputs) {
        let expected = "the number of inputs";
        return Err(wayfix::error::Parameter::new(
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
