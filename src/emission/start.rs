//! Starts of learning: observations in clusters by k-means++ (Arthur and Vassilvitskii 2007).

use rand::{Rng, RngExt};

use super::EmissionError;
use crate::belief::Belief;
use crate::error::LearnError;
use crate::hmm::{Hmm, Prior};
use crate::likelihood::LearnLikelihood;
use crate::random::index;
use crate::sequence::Sequence;
use crate::transition::DenseTransition;

/// Most rounds of moving centres; learning goes on from wherever they are.
const ROUNDS: usize = 50;
/// Weight of all observations in the start of a state, as a part of that of its cluster, so that
/// a cluster of two observations has a covariance.
const POOLED: f64 = 0.1;

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
        let scaled = scaled.chunks_exact(components);
        let mut centres = draw(&scaled, count, rng)?;
        let mut nearest = vec![0; scaled.len()];
        for round in 0..ROUNDS {
            let mut moved = round == 0;
            for (label, row) in nearest.iter_mut().zip(scaled.clone()) {
                let new = closest(&centres, row).0;
                moved |= *label != new;
                *label = new;
            }
            if !moved {
                break;
            }
            recentre(&mut centres, scaled.clone().zip(&nearest));
        }
        centres.chunks_exact_mut(components).for_each(|centre| {
            let units = centre.iter_mut().zip(&units);
            units.for_each(|(c, (mean, deviation))| *c = mean + *c * deviation);
        });
        // From the observations themselves, whose digits a deviation of 1e150 would cover.
        recentre(&mut centres, rows().zip(&nearest));
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
        for (y, (mean, deviation)) in row.iter_mut().zip(&units) {
            let difference = *y - mean;
            // In halves where the difference of two large values is infinite.
            *y = if difference.is_finite() {
                difference / deviation
            } else {
                (0.5 * *y - 0.5 * mean) / deviation * 2.0
            };
        }
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
fn recentre<'a>(centres: &mut [f64], rows: impl Iterator<Item = (&'a [f64], &'a usize)> + Clone) {
    let known = |(row, label): (&'a [f64], &'a usize)| {
        let first = label * row.len();
        row.iter().enumerate().filter(|(_, y)| !y.is_nan()).map(move |(c, y)| (first + c, *y))
    };
    // In units of the largest value, as above.
    let (mut units, mut sums) = (vec![0.0_f64; centres.len()], vec![(0.0, 0.0); centres.len()]);
    rows.clone().flat_map(known).for_each(|(at, y)| units[at] = units[at].max(y.abs()));
    rows.flat_map(known).for_each(|(at, y)| {
        let part = if units[at] == 0.0 { 0.0 } else { y / units[at] };
        sums[at] = (sums[at].0 + part, sums[at].1 + 1.0);
    });
    let counted =
        centres.iter_mut().zip(units.iter().zip(sums)).filter(|(_, (_, sum))| sum.1 > 0.0);
    counted.for_each(|(centre, (unit, (sum, count)))| *centre = sum / count * unit);
}

/// Models to start learning from: as many as asked for, each from other random
/// [`Clusters`], whose observations give the family its parameters.
///
/// `family` has the wanted number of states and tells everything but the parameters that are
/// learned: the kind of covariance, a prior, missing components. Its parameters are those of the
/// cluster, with a tenth of the weight from all observations. A transition is what the
/// clusters of successive observations show, with one more of each; the prior is uniform at the
/// first observation. [`Hmm::learn_best`] learns from all and keeps the best:
///
/// ```
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// use wayfix::emission::{Gaussian, starts};
/// use wayfix::inference::LearningOptions;
/// use wayfix::Hmm;
///
/// let calm = (0..40).map(|k| [0.1 * f64::from(k % 3)]);
/// let busy = (0..40).map(|k| [5.0 + 0.5 * f64::from(k % 5)]);
/// let series: Vec<[f64; 1]> = calm.chain(busy).collect();
///
/// let family = Gaussian::diagonal(&[[0.0], [0.0]], &[[1.0], [1.0]])?; // two states, one component
/// let starts = starts(&family, &[&series], 5, &mut ChaCha8Rng::seed_from_u64(1))?;
/// let fits = Hmm::learn_best(&starts, &[&series], &LearningOptions::default(), |_, _| ())?;
/// let learned = fits.into_best();
/// let mean = |state| learned.model().likelihood().mean(state).unwrap()[0];
/// assert!((mean(0) - 0.1).abs() < 0.01 && (mean(1) - 6.0).abs() < 0.01);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
///
/// [`LearnError::Likelihood`] as [`Clusters::new`], if the family refuses an observation, or if
/// clusters do not determine its parameters, which a prior may help.
pub fn starts<B, S, R>(
    family: &B,
    sequences: &[S],
    count: usize,
    rng: &mut R,
) -> Result<Vec<Hmm<DenseTransition, B>>, LearnError>
where
    B: LearnLikelihood<Observation = [f64]>,
    S: Sequence<(), [f64]>,
    R: Rng + ?Sized,
{
    (0..count).map(|_| start(family, sequences, rng)).collect()
}

fn start<B, S, R>(
    family: &B,
    sequences: &[S],
    rng: &mut R,
) -> Result<Hmm<DenseTransition, B>, LearnError>
where
    B: LearnLikelihood<Observation = [f64]>,
    S: Sequence<(), [f64]>,
    R: Rng + ?Sized,
{
    let n = family.states();
    let wrong = |error: EmissionError| LearnError::Likelihood(error.into());
    let clusters = Clusters::new(sequences, n, rng).map_err(wrong)?;
    let mut statistics = family.statistics();
    let mut moves = vec![1.0; n * n];
    let labels = clusters.labels();
    let mut pooled = vec![0.0; n];
    labels.iter().flatten().for_each(|&label| pooled[label] += 1.0);
    let all: f64 = pooled.iter().sum();
    pooled.iter_mut().for_each(|count| *count *= POOLED / all);
    let mut weights = pooled.clone();
    let mut scratch = crate::likelihood::Scratch::default();
    for (number, (sequence, labels)) in sequences.iter().zip(labels).enumerate() {
        for (step, &label) in (1..).zip(labels) {
            let observation = sequence.observation(step);
            // The family's own check of the observation.
            if let Err(source) = family.diagonal(observation, &mut scratch) {
                let source = crate::error::InferenceError::Likelihood { step, source };
                let sequence = number;
                return Err(crate::error::SequenceError { sequence, source }.into());
            }
            weights[label] = 1.0 + pooled[label];
            family.add(&mut statistics, observation, &weights);
            weights[label] = pooled[label];
        }
        labels.windows(2).for_each(|pair| moves[pair[0] * n + pair[1]] += 1.0);
    }
    let sums: Vec<f64> = moves.chunks_exact(n).map(|row| row.iter().sum()).collect();
    let transition = DenseTransition::from_fn(n, |to, from| moves[from * n + to] / sums[from])?;
    let likelihood = family.reestimate(&statistics, 0.0).map_err(LearnError::Likelihood)?;
    let prior = Prior::AtFirstObservation(Belief::uniform(n)?);
    Ok(Hmm::new(prior, transition, likelihood)?)
}
