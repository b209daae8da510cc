//! Kinds of clusters to begin learning with: most are k-means of a feature of the observations.

use std::fmt;

use rand::{Rng, RngExt};

use super::k_means::{distance, k_means, standardize};

/// Kind of a [start](crate::starts): the feature by which its states differ.
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
    /// The observations themselves: the [`Clusters`](super::Clusters) of k-means.
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
pub(super) fn labels<R: Rng + ?Sized>(
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
            // The root keeps the largest spreads from deciding all distances.
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
