//! Observations in clusters, by k-means from centres of k-means++ (Arthur and Vassilvitskii 2007).

use rand::{Rng, RngExt};

use super::EmissionError;
use crate::random::index;
use crate::sequence::Sequence;

/// Most rounds of moving centres; learning goes on from wherever they are.
const ROUNDS: usize = 50;
/// Clusters of observations: k-means from centres that k-means++ has drawn.
///
/// Distances are Euclidean, with each component divided by its standard deviation over all
/// observations, so that units have no influence. Missing components (NaN) are left out of
/// distances and means. Clusters are numbered in ascending order of their centres, by the first
/// component, then by the next.
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
    /// [`EmissionError`] if there are fewer different observations than clusters, if they differ in
    /// their number of components, or one is infinite.
    pub fn new<S, R>(sequences: &[S], count: usize, rng: &mut R) -> Result<Self, EmissionError>
    where
        S: Sequence<(), [f64]>,
        R: Rng + ?Sized,
    {
        let steps = |s: &S| s.steps();
        let rows = || sequences.iter().flat_map(|s| (1..=s.steps()).map(|k| s.observation(k)));
        let components = rows().next().map_or(0, <[f64]>::len);
        if count == 0 || components == 0 {
            return Err(EmissionError::Empty { states: count, components });
        }
        let mut scaled =
            Vec::with_capacity(sequences.iter().map(steps).sum::<usize>() * components);
        for row in rows() {
            if row.len() != components {
                let (found, expected) = (row.len(), components);
                return Err(EmissionError::Components { found, expected });
            }
            if let Some(component) = row.iter().position(|y| y.is_infinite()) {
                let (value, expected) = (row[component], "a finite value");
                return Err(EmissionError::Observation { component, value, expected });
            }
            scaled.extend_from_slice(row);
        }
        let units = standardize(&mut scaled, components);
        let rows = scaled.chunks_exact(components);
        let mut centres = draw(&rows, count, rng)?;
        let mut nearest = vec![0; rows.len()];
        for round in 0..ROUNDS {
            let mut moved = round == 0;
            for (label, row) in nearest.iter_mut().zip(rows.clone()) {
                let new = closest(&centres, row).0;
                moved |= *label != new;
                *label = new;
            }
            if !moved {
                break;
            }
            recentre(&mut centres, rows.clone().zip(&nearest));
        }
        centres.chunks_exact_mut(components).for_each(|centre| {
            let units = centre.iter_mut().zip(&units);
            units.for_each(|(c, (mean, deviation))| *c = mean + *c * deviation);
        });
        Ok(Self::sorted(components, &centres, nearest, sequences.iter().map(steps)))
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

/// Subtracts the mean of each component and divides by its standard deviation, and returns both.
/// A component that is always the same is not divided.
fn standardize(values: &mut [f64], components: usize) -> Vec<(f64, f64)> {
    let known = |values: &[f64], component: usize| {
        let column = values.iter().skip(component).step_by(components).copied();
        column.filter(|y| !y.is_nan()).collect::<Vec<f64>>()
    };
    let unit = |component: usize| {
        let column = known(values, component);
        let largest = column.iter().fold(0.0_f64, |largest, y| largest.max(y.abs()));
        if column.is_empty() || largest == 0.0 {
            return (0.0, 1.0);
        }
        // In units of the largest value, so that squares neither overflow nor vanish.
        let count = column.len() as f64;
        let mean = column.iter().map(|y| y / largest / count).sum::<f64>();
        let variance = column.iter().map(|y| (y / largest - mean).powi(2) / count).sum::<f64>();
        let deviation = variance.sqrt() * largest;
        (mean * largest, if deviation > 0.0 { deviation } else { 1.0 })
    };
    let units: Vec<(f64, f64)> = (0..components).map(unit).collect();
    for row in values.chunks_exact_mut(components) {
        row.iter_mut().zip(&units).for_each(|(y, (mean, deviation))| *y = (*y - mean) / deviation);
    }
    units
}

/// Square of the distance over the components that are known.
fn distance(centre: &[f64], row: &[f64]) -> f64 {
    let pairs = centre.iter().zip(row).filter(|(_, y)| !y.is_nan());
    pairs.map(|(c, y)| (c - y) * (c - y)).sum()
}

/// The nearest centre, the first of several, and the square of its distance.
fn closest(centres: &[f64], row: &[f64]) -> (usize, f64) {
    let centres = centres.chunks_exact(row.len()).map(|centre| distance(centre, row)).enumerate();
    centres.fold((0, f64::INFINITY), |best, found| if found.1 < best.1 { found } else { best })
}

/// Draws centres among the rows, each with a probability in proportion to the square of its
/// distance from those before (k-means++). Missing components of a centre are those of the mean.
fn draw<'a, R: Rng + ?Sized>(
    rows: &(impl ExactSizeIterator<Item = &'a [f64]> + Clone),
    count: usize,
    rng: &mut R,
) -> Result<Vec<f64>, EmissionError> {
    let mut centres = Vec::new();
    let mut apart = vec![f64::INFINITY; rows.len()];
    let complete = |row: &[f64]| row.iter().map(|y| if y.is_nan() { 0.0 } else { *y }).collect();
    let mut next: usize = rng.random_range(0..rows.len());
    loop {
        let centre: Vec<f64> = rows.clone().nth(next).map(complete).unwrap_or_default();
        for (apart, row) in apart.iter_mut().zip(rows.clone()) {
            *apart = apart.min(distance(&centre, row));
        }
        centres.extend(centre);
        let drawn = centres.len() / rows.clone().next().map_or(1, <[f64]>::len);
        if drawn == count {
            return Ok(centres);
        }
        let total: f64 = apart.iter().sum();
        if total <= 0.0 {
            return Err(EmissionError::TooFew {
                state: Some(drawn),
                component: None,
                what: "centre",
                weight: rows.len() as f64,
                reason: "they are no more different values than clusters",
            });
        }
        next = index(apart.iter().copied().enumerate(), total, rng);
    }
}

/// Moves each centre to the mean of its rows; one without rows stays.
fn recentre<'a>(centres: &mut [f64], rows: impl Iterator<Item = (&'a [f64], &'a usize)>) {
    let mut sums = vec![(0.0, 0.0); centres.len()];
    for (row, &label) in rows {
        for (sum, y) in sums[label * row.len()..].iter_mut().zip(row).filter(|(_, y)| !y.is_nan()) {
            *sum = (sum.0 + y, sum.1 + 1.0);
        }
    }
    let counted = centres.iter_mut().zip(sums).filter(|(_, sum)| sum.1 > 0.0);
    counted.for_each(|(centre, (sum, count))| *centre = sum / count);
}
