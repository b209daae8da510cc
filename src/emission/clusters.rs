//! Observations in clusters.

use rand::Rng;

use super::EmissionError;
use super::k_means::{KMeans, k_means};
use crate::sequence::Sequence;

/// Clusters of observations: k-means from centres that k-means++ has drawn.
///
/// Distances are Euclidean, with each component divided by its standard deviation over all
/// observations, so that units have no influence. Missing components (NaN) are left out of
/// distances and means; an observation without any other is in the first of all clusters. Clusters
/// are numbered in ascending order of their centres, by the first component, then by the next.
///
/// An angle has no Euclidean distance: headings near −π and π are far apart, although they point
/// the same way, so that one group of them becomes two clusters. Give the cosine and the sine of an
/// angle as two components, or turn angles so that they are cut where few of them are.
///
/// ```
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// use wayfix::emission::Clusters;
///
/// let series = vec![[9.9], [0.1], [0.0], [10.1], [0.2]];
/// let clusters = Clusters::new(&[series], 2, &mut ChaCha8Rng::seed_from_u64(1))?;
/// assert_eq!(clusters.labels(), [[1, 0, 0, 1, 0]]);
/// assert!((clusters.centre(1)[0] - 10.0).abs() < 1e-12);
/// # Ok::<(), wayfix::emission::EmissionError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Clusters {
    components: usize,
    centres: Vec<f64>,
    labels: Vec<Vec<usize>>,
}

impl Clusters {
    /// Divides the observations of all sequences into `count` clusters. Reads each observation
    /// O(`count` · rounds) times, with at most 50 rounds after the centres are drawn.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] if there are no observations, or fewer different ones than clusters; with
    /// sequence and step if they differ in their number of components, or one is infinite.
    pub fn new<S, R>(sequences: &[S], count: usize, rng: &mut R) -> Result<Self, EmissionError>
    where
        S: Sequence<(), [f64]>,
        R: Rng + ?Sized,
    {
        let rows = rows(sequences)?;
        let components = rows.first().ok_or(EmissionError::NoObservations)?.len();
        if count == 0 || components == 0 {
            return Err(EmissionError::Empty { states: count, components });
        }
        let KMeans { centres, nearest } = k_means(&rows, count, rng).map_err(|found| {
            EmissionError::TooFewDifferent { found, expected: count, what: "clusters" }
        })?;
        Ok(Self::sorted(components, &centres, nearest, sequences.iter().map(S::steps)))
    }

    fn sorted(
        components: usize,
        centres: &[f64],
        nearest: Vec<usize>,
        steps: impl Iterator<Item = usize>,
    ) -> Self {
        let rows: Vec<&[f64]> = centres.chunks_exact(components).collect();
        let ascending = |a: &[f64], b: &[f64]| {
            let pairs = a.iter().zip(b).map(|(a, b)| a.total_cmp(b));
            pairs.fold(std::cmp::Ordering::Equal, std::cmp::Ordering::then)
        };
        let mut order: Vec<usize> = (0..rows.len()).collect();
        order.sort_by(|&a, &b| ascending(rows[a], rows[b]));
        let new = crate::reorder::positions(&order);
        let centres = order.iter().flat_map(|&old| rows[old]).copied().collect();
        let mut nearest = nearest.into_iter().map(|label| new[label]);
        let labels = steps.map(|steps| nearest.by_ref().take(steps).collect()).collect();
        Self { components, centres, labels }
    }

    /// Cluster of each observation, sequence by sequence.
    #[must_use]
    pub fn labels(&self) -> &[Vec<usize>] {
        &self.labels
    }

    /// Mean of the observations of a cluster. Panics if there is no such cluster.
    #[must_use]
    pub fn centre(&self, cluster: usize) -> &[f64] {
        &self.centres[cluster * self.components..][..self.components]
    }
}

/// Returns the observations of all sequences after checking them.
fn rows<S: Sequence<(), [f64]>>(sequences: &[S]) -> Result<Vec<&[f64]>, EmissionError> {
    let mut rows: Vec<&[f64]> = Vec::with_capacity(sequences.iter().map(S::steps).sum());
    for (at, sequence) in sequences.iter().enumerate() {
        for step in 1..=sequence.steps() {
            let row = sequence.observation(step);
            let wrong = |cause: EmissionError| {
                let cause = Box::new(cause);
                Err(EmissionError::Step { sequence: at, step, cause })
            };
            let (found, expected) = (row.len(), rows.first().map_or(row.len(), |row| row.len()));
            if found != expected {
                return wrong(EmissionError::Components { found, expected });
            }
            if let Some(component) = row.iter().position(|y| y.is_infinite()) {
                let (value, expected) = (row[component], "a finite value");
                return wrong(EmissionError::Observation { component, value, expected });
            }
            rows.push(row);
        }
    }
    Ok(rows)
}
