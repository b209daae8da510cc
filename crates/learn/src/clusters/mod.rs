//! Clusters of observations, and families fitted to them as starting points of learning.
//!
//! This file has the kinds of clusters and the observations in them; `k_means` the clustering, and
//! `fit` a family, or the parts of a mixture, from clusters.

mod fit;
mod k_means;

use std::borrow::Cow;
use std::fmt;
use std::ops::Range;

use rand::{Rng, RngExt};
use wayfix::Sequence;

use crate::EmissionError;
use crate::error::{check_components, check_values};
use k_means::{distance, k_means, means, standardize};

pub use fit::StartFromClusters;
pub(super) use fit::{Outcome, ROUNDS};

// Kinds of clusters to begin learning with: most are k-means of a feature of the observations.

/// Kind of a [start](crate::starts): the feature that its states differ by.
///
/// Learning ends at a local maximum near its start, and no kind is near the highest one for all
/// data. Starts cycle through the kinds, and [`Hmm::learn_best`](wayfix::Hmm::learn_best) tells
/// which start its result came from:
///
/// ```
/// use wayfix_learn::StartKind;
/// assert_eq!(StartKind::of(2), StartKind::Spread); // that of starts 2, 7, 12, ...
/// assert_eq!(StartKind::of(7).to_string(), "spread");
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum StartKind {
    /// The observations themselves: the [`Clusters`](Clusters) of k-means.
    Position,
    /// The nearest of a few observations drawn at random.
    Random,
    /// The mean distance of observations from the overall mean, over a window: regimes of a market.
    Spread,
    /// Time: segments of the sequences, cut at random.
    Segments,
    /// The mean of the observations in a window, and the mean difference of successive ones.
    Surroundings,
}

impl StartKind {
    /// Returns the kind of the start with this index among the [starts](crate::starts).
    #[must_use]
    pub fn of(start: usize) -> Self {
        match start % 5 {
            0 => Self::Position,
            1 => Self::Random,
            2 => Self::Spread,
            3 => Self::Segments,
            _ => Self::Surroundings,
        }
    }
}

impl fmt::Display for StartKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Position => "position",
            Self::Random => "random",
            Self::Spread => "spread",
            Self::Segments => "segments",
            Self::Surroundings => "surroundings",
        })
    }
}

/// Returns the cluster of each row, of `count` clusters. There is at least one row, with at least
/// one component; the rows of a sequence are consecutive, and `lengths` are those of the sequences.
///
/// # Errors
///
/// The number of rows with distinct features, if it is below `count`.
fn labels<R: Rng + ?Sized>(
    kind: StartKind,
    rows: &[&[f64]],
    lengths: &[usize],
    count: usize,
    rng: &mut R,
) -> Result<Vec<usize>, usize> {
    let components = rows.first().map_or(1, |row| row.len());
    let mut scaled = rows.concat();
    if kind != StartKind::Position {
        standardize(&mut scaled, components);
    }
    // Half the width of a window. Dwell times are unknown, so all orders of magnitude are equally
    // likely, from one step to the time that each state would have if they shared it equally.
    let orders = (rows.len() / (2 * count)).max(1).ilog2();
    let half = |rng: &mut R| {
        let order = rng.random_range(0..=orders);
        rng.random_range(0..1_usize << order)
    };
    let features = match kind {
        StartKind::Position => return k_means(rows, count, rng),
        StartKind::Random => return nearest_of_random(&scaled, components, count, rng),
        StartKind::Segments => return Ok(segments(rows.len(), count, rng)),
        StartKind::Spread => {
            let sizes: Vec<f64> = scaled.iter().map(|z| z.abs()).collect();
            let mut means = window_means(&sizes, components, lengths, half(rng));
            // The square root keeps the largest spreads from deciding all distances.
            means.iter_mut().for_each(|mean| *mean = mean.sqrt());
            means
        }
        StartKind::Surroundings => {
            let half = 1 + half(rng);
            let means = window_means(&scaled, components, lengths, half);
            let changes = changes(&scaled, components, lengths);
            let changes = window_means(&changes, components, lengths, half);
            let pairs = means.chunks_exact(components).zip(changes.chunks_exact(components));
            pairs.flat_map(|(mean, change)| [mean, change].concat()).collect()
        }
    };
    let width = features.len() / rows.len();
    let features: Vec<&[f64]> = features.chunks_exact(width).collect();
    k_means(&features, count, rng)
}

/// Returns the nearest of `count` distinct rows drawn uniformly, for each row.
fn nearest_of_random<R: Rng + ?Sized>(
    scaled: &[f64],
    components: usize,
    count: usize,
    rng: &mut R,
) -> Result<Vec<usize>, usize> {
    let row = |at: usize| &scaled[at * components..][..components];
    let mut left: Vec<usize> = (0..scaled.len() / components).collect();
    let mut centres: Vec<Vec<f64>> = Vec::with_capacity(count);
    while centres.len() < count {
        if left.is_empty() {
            return Err(centres.len());
        }
        let drawn = row(left[rng.random_range(0..left.len())]);
        let centre: Vec<f64> = drawn.iter().map(|y| if y.is_nan() { 0.0 } else { *y }).collect();
        // Rows that coincide with this centre would make an empty cluster.
        left.retain(|&at| distance(&centre, row(at)) > 0.0);
        centres.push(centre);
    }
    let nearest = |row: &[f64]| {
        let centres = centres.iter().map(|centre| distance(centre, row)).enumerate();
        centres.fold((0, f64::INFINITY), |a, b| if b.1 < a.1 { b } else { a }).0
    };
    Ok(scaled.chunks_exact(components).map(nearest).collect())
}

/// Divides the rows into `count` segments at random cuts.
fn segments<R: Rng + ?Sized>(rows: usize, count: usize, rng: &mut R) -> Vec<usize> {
    let mut cuts: Vec<usize> = (1..count).map(|_| rng.random_range(0..=rows)).collect();
    cuts.sort_unstable();
    (0..rows).map(|at| cuts.partition_point(|cut| *cut <= at)).collect()
}

/// Absolute differences from the previous row; NaN for the first row of a sequence.
fn changes(scaled: &[f64], components: usize, lengths: &[usize]) -> Vec<f64> {
    let mut found = vec![f64::NAN; scaled.len()];
    let mut from = 0;
    for length in lengths {
        let to = from + length * components;
        for at in from + components..to {
            found[at] = (scaled[at] - scaled[at - components]).abs();
        }
        from = to;
    }
    found
}

/// Means of the known values of each component over `half` rows before, the row itself, and `half`
/// rows after it, within its sequence. NaN where nothing is known.
fn window_means(values: &[f64], components: usize, lengths: &[usize], half: usize) -> Vec<f64> {
    let mut means = Vec::with_capacity(values.len());
    let mut from = 0;
    for &length in lengths {
        let values = &values[from..from + length * components];
        from += values.len();
        // Prefix sums and counts of the known values before each row, so that a window of any width
        // is a difference of two.
        let mut sums = vec![(0.0, 0.0); components];
        for (at, y) in values.iter().enumerate() {
            let (sum, known) = sums[at];
            sums.push(if y.is_nan() { (sum, known) } else { (sum + y, known + 1.0) });
        }
        for at in 0..length {
            let (first, last) = (at.saturating_sub(half), (at + half + 1).min(length));
            means.extend((0..components).map(|component| {
                let (before, to) =
                    (sums[first * components + component], sums[last * components + component]);
                (to.0 - before.0) / (to.1 - before.1)
            }));
        }
    }
    means
}

// Observations in clusters, with what is needed to fit a family to them.

/// Weight of all observations together in a state's start, relative to its own cluster: even a
/// cluster of two observations then has a covariance.
const POOLED: f64 = 0.1;

/// Clusters of observations by k-means, from centres drawn by k-means++.
///
/// Distances are Euclidean, with each component divided by its standard deviation over all
/// observations, so that units have no influence. Missing components (NaN) are left out of
/// distances and means; an observation whose components are all missing gets an arbitrary cluster.
/// Clusters are numbered in ascending order of their centres, by the first component, then by the
/// next.
///
/// Angles have no Euclidean distance: headings near −π and π are far apart although they point the
/// same way, so that one group of them becomes two clusters. Give the cosine and the sine of an
/// angle as two components, or rotate angles so that few of them are near the cut.
///
/// A family [fits](Self::fit) its states to them, to begin learning there.
///
/// ```
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// use wayfix_learn::Clusters;
///
/// let sequences = [[[9.9], [0.1], [0.0], [10.1], [0.2]]];
/// let clusters = Clusters::new(&sequences, 2, &mut ChaCha8Rng::seed_from_u64(1))?;
/// assert_eq!(clusters.labels(), [[1, 0, 0, 1, 0]]);
/// assert!((clusters.centre(1)[0] - 10.0).abs() < 1e-12);
/// # Ok::<(), wayfix_learn::EmissionError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Clusters<'a> {
    labels: Vec<Vec<usize>>,
    centres: Vec<f64>,
    /// Observations with at least one known component.
    rows: Vec<&'a [f64]>,
    /// Cluster of each of these rows.
    assigned: Vec<usize>,
    /// The same rows with values of others in place of missing ones; empty if nothing is missing.
    completed: Vec<Cow<'a, [f64]>>,
    /// Weight that every observation has in a cluster, in addition to 1 for its own.
    pooled_weight: Vec<f64>,
}

impl<'a> Clusters<'a> {
    /// Divides the observations of all sequences into `count` clusters. Reads each observation
    /// O(`count` · rounds) times, with at most 50 rounds after the centres are drawn.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] without observations, or for fewer distinct ones than clusters; with
    /// the sequence and step if the number of components changes, or a value is infinite.
    pub fn new<S, R>(sequences: &'a [S], count: usize, rng: &mut R) -> Result<Self, EmissionError>
    where
        S: Sequence<(), [f64]>,
        R: Rng + ?Sized,
    {
        Self::of_kind(StartKind::Position, sequences, count, rng)
    }

    /// Divides the observations by the feature of a kind of start.
    pub(crate) fn of_kind<S, R>(
        kind: StartKind,
        sequences: &'a [S],
        count: usize,
        rng: &mut R,
    ) -> Result<Self, EmissionError>
    where
        S: Sequence<(), [f64]>,
        R: Rng + ?Sized,
    {
        let rows = rows(sequences)?;
        let components = rows.first().ok_or(EmissionError::NoObservations)?.len();
        if count == 0 || components == 0 {
            return Err(EmissionError::Empty { states: count, components });
        }
        let lengths: Vec<usize> = sequences.iter().map(S::steps).collect();
        let nearest = labels(kind, &rows, &lengths, count, rng).map_err(|found| {
            EmissionError::TooFewDifferent { found, expected: count, what: "clusters" }
        })?;
        let centres = means(&rows, &nearest, count);
        // Renumber in ascending order of the centres, lexicographically.
        let all: Vec<&[f64]> = centres.chunks_exact(components).collect();
        let ascending = |a: &[f64], b: &[f64]| {
            let pairs = a.iter().zip(b).map(|(a, b)| a.total_cmp(b));
            pairs.fold(std::cmp::Ordering::Equal, std::cmp::Ordering::then)
        };
        let mut order: Vec<usize> = (0..count).collect();
        order.sort_by(|&a, &b| ascending(all[a], all[b]));
        let new = wayfix::internal::positions(&order);
        let centres = order.iter().flat_map(|&old| all[old]).copied().collect();
        let nearest: Vec<usize> = nearest.into_iter().map(|label| new[label]).collect();
        let mut each = nearest.iter().copied();
        let labels = lengths.into_iter().map(|steps| each.by_ref().take(steps).collect()).collect();
        Ok(Self::of(labels, centres, count, rows.into_iter().zip(nearest)))
    }

    /// Creates clusters from observations of equal length, each with its cluster.
    fn of(
        labels: Vec<Vec<usize>>,
        centres: Vec<f64>,
        count: usize,
        observations: impl Iterator<Item = (&'a [f64], usize)>,
    ) -> Self {
        let known = observations.filter(|(row, _)| row.iter().any(|y| !y.is_nan()));
        let (rows, assigned): (Vec<&[f64]>, Vec<usize>) = known.unzip();
        let is_complete = !rows.iter().copied().flatten().any(|y| y.is_nan());
        let completed = if is_complete { Vec::new() } else { completed(&rows, &assigned, count) };
        let mut counts = vec![0; count];
        assigned.iter().for_each(|&cluster| counts[cluster] += 1);
        let total = rows.len() as f64;
        let pooled_weight =
            counts.into_iter().map(|count| pooled_weight_of(count, total)).collect();
        Self { labels, centres, rows, assigned, completed, pooled_weight }
    }

    /// The same clusters, restricted to the components of one of several families in a row.
    pub(crate) fn columns(&self, components: Range<usize>) -> Self {
        let count = self.pooled_weight.len();
        let centres = (0..count).flat_map(|cluster| &self.centre(cluster)[components.clone()]);
        let rows = self.iter().map(|(row, cluster)| (&row[components.clone()], cluster));
        Self::of(self.labels.clone(), centres.copied().collect(), count, rows)
    }

    /// Cluster of each observation, sequence by sequence.
    #[must_use]
    pub fn labels(&self) -> &[Vec<usize>] {
        &self.labels
    }

    /// Mean of the observations of a cluster. Panics if the cluster does not exist.
    #[must_use]
    pub fn centre(&self, cluster: usize) -> &[f64] {
        let components = self.centres.len() / self.pooled_weight.len();
        &self.centres[cluster * components..][..components]
    }

    /// Observations with their clusters, except those whose components are all missing.
    #[must_use]
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (&'a [f64], usize)> {
        self.rows.iter().copied().zip(self.assigned.iter().copied())
    }
}

/// Compares labels and centres, since missing components (NaN) are not equal even to themselves.
impl PartialEq for Clusters<'_> {
    fn eq(&self, other: &Self) -> bool {
        (&self.labels, &self.centres) == (&other.labels, &other.centres)
    }
}

/// Weight of every observation in a cluster of `count`, beside the cluster's own, where all weights
/// sum to `total`. A cluster without observations takes its parameters from all.
fn pooled_weight_of(count: usize, total: f64) -> f64 {
    if count == 0 { 1.0 / total } else { POOLED * count as f64 / total }
}

/// Rows with missing components filled by known values of the cluster, each in turn, or of all rows
/// where the cluster has none. So the family accepts them, and they vary as known values do.
fn completed<'a>(rows: &[&'a [f64]], clusters: &[usize], states: usize) -> Vec<Cow<'a, [f64]>> {
    let components = rows.first().map_or(0, |row| row.len());
    // Known values by cluster and component. One more cluster, the last, stands for all rows.
    let mut known = vec![Vec::new(); (states + 1) * components];
    for (row, &cluster) in rows.iter().zip(clusters) {
        for (component, &y) in row.iter().enumerate().filter(|y| !y.1.is_nan()) {
            known[cluster * components + component].push(y);
            known[states * components + component].push(y);
        }
    }
    let mut used = vec![0; known.len()];
    let complete = |(&row, &cluster): (&&'a [f64], &usize)| {
        if row.iter().all(|y| !y.is_nan()) {
            return Cow::Borrowed(row);
        }
        let mut row = row.to_vec();
        for (component, y) in row.iter_mut().enumerate().filter(|y| y.1.is_nan()) {
            let own = cluster * components + component;
            let at = if known[own].is_empty() { states * components + component } else { own };
            // A component that is missing in all rows stays missing.
            if let Some(&other) = known[at].get(used[at] % known[at].len().max(1)) {
                *y = other;
            }
            used[at] += 1;
        }
        Cow::Owned(row)
    };
    rows.iter().zip(clusters).map(complete).collect()
}

/// Checks the observations of all sequences, and returns them one after the other.
fn rows<S: Sequence<(), [f64]>>(sequences: &[S]) -> Result<Vec<&[f64]>, EmissionError> {
    let mut rows: Vec<&[f64]> = Vec::with_capacity(sequences.iter().map(S::steps).sum());
    for (at, sequence) in sequences.iter().enumerate() {
        for step in 1..=sequence.steps() {
            let row = sequence.observation(step);
            let components = rows.first().map_or(row.len(), |row| row.len());
            check_components(row, components)
                .and_then(|()| check_values(row, |y| !y.is_infinite(), "a finite value"))
                .map_err(|cause| {
                    let cause = Box::new(cause);
                    EmissionError::Step { sequence: at, step, cause }
                })?;
            rows.push(row);
        }
    }
    Ok(rows)
}
