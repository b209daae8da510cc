//! Observations in clusters, with what is needed to fit a family to them.

use std::borrow::Cow;
use std::ops::Range;

use rand::Rng;

use super::k_means::means;
use super::kinds::{StartKind, labels};
use crate::EmissionError;
use crate::check::{check_components, check_values};
use wayfix::Sequence;

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
    pub(super) rows: Vec<&'a [f64]>,
    /// Cluster of each of these rows.
    pub(super) assigned: Vec<usize>,
    /// The same rows with values of others in place of missing ones; empty if nothing is missing.
    pub(super) completed: Vec<Cow<'a, [f64]>>,
    /// Weight that every observation has in a cluster, in addition to 1 for its own.
    pub(super) pooled: Vec<f64>,
}

impl<'a> Clusters<'a> {
    /// Divides the observations of all sequences into `count` clusters. Reads each observation
    /// O(`count` · rounds) times, with at most 50 rounds after the centres are drawn.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] if there are no observations, or fewer distinct ones than clusters; with
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
        let pooled = counts.into_iter().map(|count| share(count, total)).collect();
        Self { labels, centres, rows, assigned, completed, pooled }
    }

    /// The same clusters, restricted to the components of one of several families in a row.
    pub(crate) fn columns(&self, components: Range<usize>) -> Self {
        let count = self.pooled.len();
        let centres = (0..count).flat_map(|cluster| &self.centre(cluster)[components.clone()]);
        let rows = self.iter().map(|(row, cluster)| (&row[components.clone()], cluster));
        Self::of(self.labels.clone(), centres.copied().collect(), count, rows)
    }

    /// Cluster of each observation, sequence by sequence.
    #[must_use]
    pub fn labels(&self) -> &[Vec<usize>] {
        &self.labels
    }

    /// Mean of the observations of a cluster. Panics if there is no such cluster.
    #[must_use]
    pub fn centre(&self, cluster: usize) -> &[f64] {
        let components = self.centres.len() / self.pooled.len();
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
pub(super) fn share(count: usize, total: f64) -> f64 {
    if count == 0 { 1.0 / total } else { POOLED * count as f64 / total }
}

/// Rows in which missing components are filled with known values of the cluster, each in turn, or
/// of all rows where the cluster has none. So they are values that the family accepts, and vary as
/// known ones.
fn completed<'a>(rows: &[&'a [f64]], clusters: &[usize], states: usize) -> Vec<Cow<'a, [f64]>> {
    let components = rows.first().map_or(0, |row| row.len());
    // Known values by cluster and component; the last cluster stands for all rows.
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
            // A component that is missing in all rows stays so.
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
