//! Models to begin learning with, since EM (section 9 of the formulas) only finds a maximum near
//! its start: the best of several candidates after a few iterations, for several kinds of clusters.

use rand::{Rng, RngExt};
use wayfix::inference::{LearnError, LearningOptions, SequenceError};
use wayfix::internal::parallel;
use wayfix::{
    Belief, DenseTransition, Hmm, HmmError, Likelihood, Prior, Scratch, Sequence, TableLikelihood,
};

use crate::{Clusters, EmissionError, Multinomial, Rows, StartFromClusters, StartKind};

/// Candidates for each start.
const CANDIDATES: usize = 8;
/// Iterations of learning from each candidate. On random problems, fewer candidates or iterations
/// find the highest of ten ends less often: after fewer iterations, the rank says little about the
/// end.
const SHORT: usize = 15;

/// Returns `count` models to start learning from, of several [kinds](StartKind) in turn: the kind
/// of a start is [`StartKind::of`] its index.
///
/// Each start is the best of eight candidates after 15 iterations of learning (Biernacki, Celeux
/// and Govaert 2003, for mixtures). Each candidate comes from random [`Clusters`] of the kind,
/// whose observations give the family its parameters.
///
/// Parameters are estimated from the observations of each cluster, with a tenth of the weight from
/// all observations. The transition of every other candidate counts the moves between the clusters
/// of successive observations, plus one of each; the others have a random transition, where only a
/// few moves out of a state are probable. The prior is uniform at the first observation.
/// [`Hmm::learn_best`] learns from all starts and keeps the best:
///
/// ```
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// use wayfix_learn::{Gaussian, GaussianPrior, StartKind, starts};
/// use wayfix::inference::LearningOptions;
/// use wayfix::Hmm;
///
/// let calm = (0..40).map(|k| [0.1 * f64::from(k % 3)]);
/// let busy = (0..40).map(|k| [5.0 + 0.5 * f64::from(k % 5)]);
/// let series: Vec<[f64; 1]> = calm.chain(busy).collect();
///
/// let family = Gaussian::diagonal(&[[0.0], [0.0]], &[[1.0], [1.0]])?; // two states, one component
/// // 0.01 times the variance of all, so that no state becomes as narrow as one observation.
/// let family = family.with_prior(GaussianPrior::new(1)?.with_covariance(0.0, &[0.09])?)?;
/// let starts = starts(&family, &[&series], 5, &mut ChaCha8Rng::seed_from_u64(1))?;
/// let learned = Hmm::learn_best(&starts, &[&series], &LearningOptions::default(), |_, _| ())?;
/// let mean = |state| learned.model().likelihood().mean(state).unwrap()[0];
/// assert!((mean(0) - 0.1).abs() < 0.01 && (mean(1) - 6.0).abs() < 0.01);
/// assert_eq!(StartKind::of(learned.start()), StartKind::Position); // it was enough here
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # The family
///
/// `family` is a placeholder. It decides the number of states, the kind of covariance, the
/// [prior](crate::GaussianPrior) of its parameters, whether components may be missing, and the
/// number of a mixture's parts, which come from clusters within that of a state. It also keeps what
/// is fixed (put fixed means in ascending order, as clusters are) and what observations do not
/// determine: probabilities of 0, and, in the start but not in learning, the degrees of freedom of
/// a [`StudentT`](crate::StudentT). Its other parameters have no influence, except to break ties (a
/// mean direction of observations that have none).
///
/// Without a prior, a state may collapse onto a single observation, or several equal ones: the
/// likelihood is then unbounded, and learning ends there. `with_prior`, as above, avoids this in
/// starts and in learning.
///
/// Distances are Euclidean, so that a group of headings around ±π becomes two clusters
/// ([`Clusters`] says what to do about it).
///
/// # Another transition
///
/// To learn with a transition of your own, keep only the family. States are in ascending order of
/// the mean of the first component in their clusters, which means little where clusters differ in
/// something else; [`Hmm::reordered`] puts them in the order they follow each other.
///
/// ```
/// # use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// # use wayfix_learn::{Gaussian, starts};
/// # use wayfix::{Belief, DenseTransition, Hmm, HmmError, Prior};
/// # let series = [[0.0], [0.1], [0.2], [5.0], [5.1], [5.3]];
/// # let family = Gaussian::diagonal(&[[0.0], [0.0]], &[[1.0], [1.0]])?;
/// # let starts = starts(&family, &[&series], 2, &mut ChaCha8Rng::seed_from_u64(1))?;
/// // From state 0 to state 1, and never back.
/// let onward = DenseTransition::from_rows(&[[0.9, 0.0], [0.1, 1.0]])?;
/// let first = Prior::AtFirstObservation(Belief::new(vec![1.0, 0.0])?);
/// let own = |start: Hmm<_, _>| Hmm::new(first.clone(), onward.clone(), start.into_parts().2);
/// let starts = starts.into_iter().map(own).collect::<Result<Vec<_>, HmmError>>()?;
/// # assert_eq!(starts.len(), 2);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
///
/// [`LearnError::Sequence`] with sequence and step if the family rejects an observation;
/// [`LearnError::Likelihood`] without observations, for fewer distinct ones than states, if a
/// component is missing in all, or if clusters do not determine the parameters, where a prior may
/// help. The error then names a component that never changes.
///
/// # Complexity
///
/// Each start costs as much as eight [`Clusters`] and 128 iterations of learning, once or twice as
/// much as learning from it to the end. Parallel with the feature `rayon`.
pub fn starts<B, S, R>(
    family: &B,
    sequences: &[S],
    count: usize,
    rng: &mut R,
) -> Result<Vec<Hmm<DenseTransition, B>>, LearnError>
where
    B: StartFromClusters,
    S: Sequence<(), [f64]> + Sync,
    R: Rng + ?Sized,
{
    check(family, sequences)?;
    if count > 0 {
        // Kinds that cluster windows might manage with fewer distinct rows than states, but few
        // families would.
        clusters(StartKind::Position, sequences, family.states(), rng)?;
    }
    of_kinds(family, sequences, count, rng)
}

/// Checks that the family accepts all observations, and that no component is missing in all of
/// them.
fn check<B, S>(family: &B, sequences: &[S]) -> Result<(), LearnError>
where
    B: StartFromClusters,
    S: Sequence<(), [f64]>,
{
    let mut scratch = Scratch::default();
    let mut is_missing = Vec::new();
    for (sequence, observations) in sequences.iter().enumerate() {
        for step in 1..=observations.steps() {
            let row = observations.observation(step);
            if let Err(source) = family.diagonal(row, &mut scratch) {
                let source = HmmError::likelihood(step, source);
                return Err(SequenceError { sequence, source }.into());
            }
            is_missing.resize(row.len(), true);
            is_missing.iter_mut().zip(row).for_each(|(is_missing, y)| *is_missing &= y.is_nan());
        }
    }
    match is_missing.iter().position(|is_missing| *is_missing) {
        None => Ok(()),
        Some(component) => Err(LearnError::likelihood(EmissionError::AllMissing { component })),
    }
}

/// Returns a start of each kind in turn. Segments replace a kind that does not tell enough
/// observations apart.
pub(super) fn of_kinds<B, S, R>(
    family: &B,
    sequences: &[S],
    count: usize,
    rng: &mut R,
) -> Result<Vec<Hmm<DenseTransition, B>>, LearnError>
where
    B: StartFromClusters,
    S: Sequence<(), [f64]> + Sync,
    R: Rng + ?Sized,
{
    let mut of_kind = |kind| {
        let draw = |at| candidate(family, sequences, kind, at % 2 == 1, rng);
        furthest((0..CANDIDATES).map(draw).collect(), sequences)
    };
    // If segments fail as well, the error of the kind itself is returned.
    let mut start =
        |kind| of_kind(kind).or_else(|error| of_kind(StartKind::Segments).map_err(|_| error));
    (0..count).map(|index| start(StartKind::of(index))).collect()
}

/// Returns the candidate with the highest objective after a few iterations, the first among equals.
///
/// # Errors
///
/// The first candidate's error, if all are errors.
fn furthest<B, S>(
    candidates: Vec<Result<Hmm<DenseTransition, B>, LearnError>>,
    sequences: &[S],
) -> Result<Hmm<DenseTransition, B>, LearnError>
where
    B: StartFromClusters,
    S: Sequence<(), [f64]> + Sync,
{
    let few = LearningOptions::default().with_iterations(SHORT);
    let ranked = parallel::map(candidates, |start: Result<Hmm<_, _>, _>, (): &mut ()| {
        let start = start?;
        // A failed candidate ranks below all others: its likelihood may be unbounded.
        let rank = match start.learn(sequences, &few) {
            Ok(end) => (!end.failed(), end.objective()),
            Err(_) => (false, f64::NEG_INFINITY),
        };
        Ok((rank, start))
    });
    let further = |best, other| match (best, other) {
        (Ok((best, _)), Ok((rank, start))) if rank > best => Ok((rank, start)),
        (Err(_), other @ Ok(_)) => other,
        (best, _) => best,
    };
    let nothing = Err(LearnError::nothing(sequences.len(), None));
    ranked.into_iter().reduce(further).unwrap_or(nothing).map(|(_, start)| start)
}

/// Returns a model from random clusters of a kind.
fn candidate<B, S, R>(
    family: &B,
    sequences: &[S],
    kind: StartKind,
    draws_moves: bool,
    rng: &mut R,
) -> Result<Hmm<DenseTransition, B>, LearnError>
where
    B: StartFromClusters,
    S: Sequence<(), [f64]>,
    R: Rng + ?Sized,
{
    let n = family.states();
    let clusters = clusters(kind, sequences, n, rng)?;
    let likelihood = family
        .start(&clusters, rng)
        .map_err(|error| LearnError::likelihood(clusters.explain(error)))?;
    let moves =
        if draws_moves { random_moves(n, rng) } else { shown_moves(n, sequences, &clusters) };
    let sums: Vec<f64> = moves.chunks_exact(n).map(|row| row.iter().sum()).collect();
    let transition = DenseTransition::from_fn(n, |to, from| moves[from * n + to] / sums[from])?;
    let prior = Prior::AtFirstObservation(Belief::uniform(n)?);
    Ok(Hmm::new(prior, transition, likelihood)?)
}

fn clusters<'a, S, R>(
    kind: StartKind,
    sequences: &'a [S],
    states: usize,
    rng: &mut R,
) -> Result<Clusters<'a>, LearnError>
where
    S: Sequence<(), [f64]>,
    R: Rng + ?Sized,
{
    Clusters::of_kind(kind, sequences, states, rng).map_err(|error| match error {
        EmissionError::TooFewDifferent { found, expected, .. } => {
            let what = "states";
            LearnError::likelihood(EmissionError::TooFewDifferent { found, expected, what })
        }
        other => LearnError::likelihood(other),
    })
}

/// Counts of moves between the clusters of successive observations, plus one of each. The moves out
/// of a state are a row.
fn shown_moves<S: Sequence<(), [f64]>>(
    n: usize,
    sequences: &[S],
    clusters: &Clusters<'_>,
) -> Vec<f64> {
    let mut moves = vec![1.0; n * n];
    for (sequence, labels) in sequences.iter().zip(clusters.labels()) {
        // An observation whose components are all missing says nothing about its state.
        let is_known = |step: usize| sequence.observation(step).iter().any(|y| !y.is_nan());
        let pairs = (1..).zip(labels.windows(2));
        for (_, pair) in pairs.filter(|&(step, _)| is_known(step) && is_known(step + 1)) {
            moves[pair[0] * n + pair[1]] += 1.0;
        }
    }
    moves
}

/// Random weights of moves, few of them large: nearly a Dirichlet distribution with parameters 1/n.
/// The moves out of a state are a row. None is 0, since learning would keep it.
fn random_moves<R: Rng + ?Sized>(n: usize, rng: &mut R) -> Vec<f64> {
    // U^n is nearly a gamma variable of shape 1/n for small values. `1 − random` is at least 2^-53,
    // so its eighth power is at least 2^-424.
    let power = |p: f64| std::iter::repeat_n(p, n.min(8)).product::<f64>();
    (0..n * n).map(|_| power(1.0 - rng.random::<f64>())).collect()
}

// Starts of tables of symbols: a symbol is a [`Multinomial`] observation of one trial, with a
// component for each symbol.

/// Returns models of symbols to start learning from, of the same kinds as
/// [`starts`](crate::starts), which see one component for each symbol: 1 for the symbol of the step
/// and 0 for the others.
///
/// The table is a placeholder: it decides the numbers of states and symbols, and what it rules out
/// stays impossible. It counts as one more observation of each state, so that symbols that are
/// never seen do not become impossible. There may be fewer symbols than states.
///
/// ```
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// use wayfix_learn::table_starts;
/// use wayfix::inference::LearningOptions;
/// use wayfix::{Hmm, TableLikelihood};
///
/// let seen: Vec<usize> = (0..120).map(|k| k / 30 % 2 + k % 2).collect();
/// let table = TableLikelihood::from_rows(&[[1.0 / 3.0; 3]; 2])?;
/// let starts = table_starts(&table, &[&seen], 5, &mut ChaCha8Rng::seed_from_u64(1))?;
/// let learned = Hmm::learn_best(&starts, &[&seen], &LearningOptions::default(), |_, _| ())?;
/// assert!(learned.log_likelihood() > -100.0); // that of one state is -124.8
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
///
/// [`LearnError::Sequence`] with sequence and step for a symbol that the table does not have;
/// [`LearnError::Likelihood`] without observations.
///
/// # Complexity
///
/// That of [`starts`](crate::starts), with a number for each symbol of the table at each step.
pub fn table_starts<S, R>(
    table: &TableLikelihood,
    sequences: &[S],
    count: usize,
    rng: &mut R,
) -> Result<Vec<Hmm<DenseTransition, TableLikelihood>>, LearnError>
where
    S: Sequence<(), usize>,
    R: Rng + ?Sized,
{
    let (n, m) = (Likelihood::states(table), table.symbols());
    let mut scratch = Scratch::default();
    let mut values = Vec::with_capacity(sequences.len());
    for (at, sequence) in sequences.iter().enumerate() {
        let mut all = vec![0.0; sequence.steps() * m];
        for (step, row) in (1..).zip(all.chunks_exact_mut(m)) {
            let symbol = sequence.observation(step);
            if let Err(source) = table.diagonal(symbol, &mut scratch) {
                let source = HmmError::likelihood(step, source);
                return Err(SequenceError { sequence: at, source }.into());
            }
            row[*symbol] = 1.0;
        }
        values.push(all);
    }
    let rows: Result<Vec<Rows<'_>>, _> = values.iter().map(|all| Rows::new(all, m)).collect();
    let rows = rows.map_err(LearnError::likelihood)?;
    let placeholder = table.to_rows();
    let family = Multinomial::new(&placeholder).map_err(LearnError::likelihood)?;
    let steps = rows.iter().map(Rows::steps).sum::<usize>() as f64;
    let own = |start: Hmm<DenseTransition, Multinomial>| {
        let (prior, transition, family) = start.into_parts();
        // The weighted mean of the cluster's shares, for the T / n steps that a state has on
        // average, and of the table, for one step.
        let mut learned = family.probabilities();
        for (p, first) in learned.iter_mut().flatten().zip(placeholder.iter().flatten()) {
            *p = (steps / n as f64 * *p + first) / (steps / n as f64 + 1.0);
        }
        let table = TableLikelihood::from_rows(&learned).map_err(LearnError::likelihood)?;
        Ok(Hmm::new(prior, transition, table)?)
    };
    of_kinds(&family, &rows, count, rng)?.into_iter().map(own).collect()
}
