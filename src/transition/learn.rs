//! [`LearnTransition`]: operators that Baum-Welch re-estimates from expected moves. The E-step adds
//! the moves of each step to statistics, and the M-step turns the sums into an operator. For most
//! operators these statistics are the counts of moves alone: [`LearnFromMoves`].

use super::{Move, MoveCounts, TransitionEntries};
use crate::error::TransitionError;

/// A transition operator that can be estimated from expected moves.
///
/// An operator without a control whose parameters depend on the counts of its moves implements
/// [`LearnFromMoves`], which has two methods, and has this trait by it.
///
/// | operator | learned |
/// |---|---|
/// | [`SparseTransition`](crate::SparseTransition), [`DenseTransition`](crate::DenseTransition) | each entry above 0 |
/// | [`ConstrainedTransition`](crate::transition::ConstrainedTransition) | the same, but entries that are fixed, and tied ones together |
/// | [`DwellTransition`](crate::transition::DwellTransition) | moves and durations |
/// | [`SwitchedTransition`](crate::transition::SwitchedTransition) | each of its operators |
/// | [`RestartTransition`](crate::transition::RestartTransition), [`EvidenceTransition`](crate::transition::EvidenceTransition) | the operator within |
/// | [`Fixed`](crate::Fixed) | nothing |
///
/// With [`FreeParameters`](crate::inference::FreeParameters), learned parameters have standard
/// errors. These are in wayfix-learn, as are operators whose rates or coefficients of inputs are
/// learned.
#[diagnostic::on_unimplemented(
    message = "`{Self}` does not say how it is learned",
    note = "to keep it as it is, wrap it in `wayfix::Fixed`"
)]
pub trait LearnTransition: TransitionEntries + Sized {
    /// Sums over steps that [`maximize`](Self::maximize) needs: [`MoveCounts`], unless the
    /// operator depends on its control.
    type Statistics: Clone + Send;

    /// Empty statistics, for adding steps.
    fn statistics(&self) -> Self::Statistics;

    /// Adds the statistics of other steps.
    fn merge(&self, statistics: &mut Self::Statistics, other: &Self::Statistics);

    /// The counts to which the moves of a step with this control are added; `None` if nothing is
    /// learned from them.
    fn counts<'s>(
        &self,
        statistics: &'s mut Self::Statistics,
        control: &Self::Control,
    ) -> Option<&'s mut MoveCounts>;

    /// Adds the moves of a step without listing them, and returns their sum; `None`, the default,
    /// if moves have to be listed and [counted](Self::counts).
    ///
    /// The expected number of moves from j to i is `before[j]` A\[i, j\] `after[i]` `scale`. For
    /// states that no move reaches, `after` may be NaN. Meant for operators whose entries cost more
    /// than products.
    fn add_step(
        &self,
        statistics: &mut Self::Statistics,
        control: &Self::Control,
        before: &[f64],
        after: &[f64],
        scale: f64,
    ) -> Option<f64> {
        let _ = (statistics, control, before, after, scale);
        None
    }

    /// Lists the entries out of a state whose moves are counted. By default these are all entries;
    /// an operator with [restarts](Self::restart_log2), which are the same out of all states, lists
    /// those of its other moves.
    fn counted(&self, control: &Self::Control, from: usize) -> impl Iterator<Item = (usize, f64)> {
        self.outgoing(control, from)
    }

    /// Lists the same entries as pairs (to, log2 p), as
    /// [`outgoing_log2`](TransitionEntries::outgoing_log2) does.
    fn counted_log2(
        &self,
        control: &Self::Control,
        from: usize,
    ) -> impl Iterator<Item = (usize, f64)> {
        self.outgoing_log2(control, from)
    }

    /// The part of the entries of row `to` of A that is the same out of all states and is not
    /// counted, as log2 p; −∞, the default, if all moves are counted.
    ///
    /// So learning with restarts takes O(counted entries + n) a step, although there are n² moves.
    fn restart_log2(&self, control: &Self::Control, to: usize) -> f64 {
        let _ = (control, to);
        f64::NEG_INFINITY
    }

    /// Returns the operator that makes the moves behind the statistics most probable, with
    /// `pseudo_count` added to the count of each free parameter. Entries of 0 stay 0, and columns
    /// without counts (or less than 2.2e-308 in all) stay as they are.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Forbidden`] for a move that the operator does not
    /// allow.
    fn maximize(
        &self,
        statistics: &Self::Statistics,
        pseudo_count: f64,
    ) -> Result<Self, TransitionError>;

    /// Log-probability of the moves behind the statistics, which [`maximize`](Self::maximize)
    /// maximises together with the log-prior: Σ counts ln A\[i, j\], −∞ if a counted move has
    /// probability 0.
    ///
    /// Only learning with a [stationary prior](crate::Prior::Stationary) needs it. That also adds
    /// moves to [`counts`](Self::counts), which must affect `maximize` as they affect this sum.
    /// With `None`, the default, such learning is an error.
    fn log_probability(&self, statistics: &Self::Statistics) -> Option<f64> {
        let _ = statistics;
        None
    }

    /// Log-prior that the pseudo-counts stand for, a Dirichlet density up to a constant:
    /// `pseudo_count` Σ ln θ over the free parameters above 0.
    fn log_prior(&self, pseudo_count: f64) -> f64;

    /// Number of parameters that learning may change independently, as information criteria count
    /// them before learning: the entries above 0 less one for each column, if nothing is tied.
    fn free_parameters(&self) -> usize;
}

/// An operator without a control that is estimated from the expected numbers of its moves.
///
/// # Implement it yourself
///
/// A vehicle on a loop that moves on by one place with a probability that is learned, the same
/// everywhere:
///
/// ```
/// use wayfix::inference::LearningOptions;
/// use wayfix::transition::{LearnFromMoves, MoveCounts, kit};
/// use wayfix::{Belief, Hmm, Prior, TableLikelihood, Transition, TransitionEntries, TransitionError};
///
/// #[derive(Clone)]
/// struct Around {
///     places: usize,
///     moves: f64,
/// }
///
/// impl Around {
///     fn entries(&self, stay: usize, next: usize) -> impl Iterator<Item = (usize, f64)> {
///         let mut entries = [(stay, 1.0 - self.moves), (next, self.moves)];
///         entries.sort_by_key(|entry| entry.0);
///         entries.into_iter().filter(|entry| entry.1 > 0.0)
///     }
/// }
///
/// impl Transition for Around {
///     type Control = ();
///     fn states(&self) -> usize {
///         self.places
///     }
///     fn apply(&self, _: &(), x: &[f64], out: &mut [f64]) {
///         for (i, out) in out.iter_mut().enumerate() {
///             *out = self.incoming(&(), i).map(|(j, p)| p * x[j]).sum();
///         }
///     }
///     fn apply_transpose(&self, _: &(), x: &[f64], out: &mut [f64]) {
///         for (j, out) in out.iter_mut().enumerate() {
///             *out = self.outgoing(&(), j).map(|(i, p)| p * x[i]).sum();
///         }
///     }
/// }
///
/// impl TransitionEntries for Around {
///     fn incoming(&self, _: &(), to: usize) -> impl Iterator<Item = (usize, f64)> {
///         self.entries(to, (to + self.places - 1) % self.places)
///     }
///     fn outgoing(&self, _: &(), from: usize) -> impl Iterator<Item = (usize, f64)> {
///         self.entries(from, (from + 1) % self.places)
///     }
/// }
///
/// impl LearnFromMoves for Around {
///     fn maximize(&self, counts: &MoveCounts) -> Result<Self, TransitionError> {
///         // The share of moves among all steps is the most probable value.
///         let (mut stays, mut moves) = (0.0, 0.0);
///         for m in counts.moves() {
///             *(if m.from == m.to { &mut stays } else { &mut moves }) += m.weight;
///         }
///         let sum = stays + moves;
///         Ok(Self { moves: if sum > 0.0 { moves / sum } else { self.moves }, ..*self })
///     }
///     fn free_parameters(&self) -> usize {
///         1
///     }
/// }
///
/// let around = Around { places: 3, moves: 0.5 };
/// kit::check(&around, &())?;
/// let camera = TableLikelihood::from_rows(&[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])?;
/// let hmm = Hmm::new(Prior::AtFirstObservation(Belief::certain(3, 0)?), around, camera)?;
/// let learned = hmm.learn(&[[0, 1, 2, 2, 0]], &LearningOptions::default())?;
/// assert_eq!(learned.model().transition().moves, 0.75);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub trait LearnFromMoves: TransitionEntries<Control = ()> + Sized {
    /// Returns the operator that makes the counted moves most probable: the maximum of
    /// Σ counts ln A\[i, j\].
    ///
    /// In learning with [pseudo-counts](crate::inference::LearningOptions), these are already in the
    /// counts, one for each entry above 0, so that entries which share a parameter add up theirs.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Forbidden`] for a counted move that the operator does not allow, which
    /// learning never passes.
    fn maximize(&self, counts: &MoveCounts) -> Result<Self, TransitionError>;

    /// Number of parameters that learning may change independently: the entries above 0 less one
    /// for each column, if none are tied.
    fn free_parameters(&self) -> usize;
}

impl<A: LearnFromMoves> LearnTransition for A {
    type Statistics = MoveCounts;

    fn statistics(&self) -> MoveCounts {
        MoveCounts::default()
    }

    fn merge(&self, counts: &mut MoveCounts, other: &MoveCounts) {
        counts.merge(other);
    }

    fn counts<'s>(&self, counts: &'s mut MoveCounts, (): &()) -> Option<&'s mut MoveCounts> {
        Some(counts)
    }

    fn maximize(&self, counts: &MoveCounts, pseudo_count: f64) -> Result<Self, TransitionError> {
        if pseudo_count == 0.0 {
            return LearnFromMoves::maximize(self, counts);
        }
        let mut counts = counts.clone();
        counts.add(entries(self).map(|(from, to, _)| Move { from, to, weight: pseudo_count }));
        LearnFromMoves::maximize(self, &counts)
    }

    fn log_probability(&self, counts: &MoveCounts) -> Option<f64> {
        Some(log_probability(self, counts))
    }

    fn log_prior(&self, pseudo_count: f64) -> f64 {
        // The usual case, which need not compute E logarithms.
        if pseudo_count == 0.0 {
            return 0.0;
        }
        pseudo_count * entries(self).map(|(.., p)| p.ln()).sum::<f64>()
    }

    fn free_parameters(&self) -> usize {
        LearnFromMoves::free_parameters(self)
    }
}

/// Σ counts ln A\[i, j\]. O(E + moves).
pub(super) fn log_probability<A: TransitionEntries<Control = ()>>(
    transition: &A,
    counts: &MoveCounts,
) -> f64 {
    // A merge, as in `weights`. Counts of 0 are skipped, since 0 ln 0 counts as 0.
    let mut moves = counts.moves().filter(|m| m.weight > 0.0).peekable();
    let mut sum = 0.0;
    for from in 0..transition.states() {
        for (to, p) in transition.outgoing(&(), from) {
            if let Some(m) = moves.next_if(|m| (m.from, m.to) == (from, to)) {
                sum += m.weight * p.ln();
            }
        }
    }
    // A move without an entry, which has probability 0, stops the merge, and is left at the end.
    if moves.next().is_some() { f64::NEG_INFINITY } else { sum }
}

/// Lists the entries as (from, to, p), column by column.
fn entries<A: TransitionEntries<Control = ()>>(
    transition: &A,
) -> impl Iterator<Item = (usize, usize, f64)> {
    (0..transition.states())
        .flat_map(|from| transition.outgoing(&(), from).map(move |(to, p)| (from, to, p)))
}
