//! k-means (Lloyd's algorithm) from the centres of k-means++ (Arthur and Vassilvitskii 2007).
//!
//! Distances are over the known components only, after each was divided by its standard deviation.
//! All sums are in units of the largest value, so that no data of finite doubles overflows.

use rand::{Rng, RngExt};

use wayfix::internal::index;

/// Largest number of rounds. Learning continues from wherever the centres are.
const ROUNDS: usize = 50;

/// Divides one row or more into `count` ≥ 1 clusters, and returns the cluster of each row. Rows
/// have the same length above 0; their values are finite, or NaN if missing.
///
/// # Errors
///
/// The number of distinct rows, if it is below the number of clusters.
pub(super) fn k_means<R: Rng + ?Sized>(
    rows: &[&[f64]],
    count: usize,
    rng: &mut R,
) -> Result<Vec<usize>, usize> {
    let components = rows.first().map_or(1, |row| row.len());
    let mut scaled = rows.concat();
    standardize(&mut scaled, components);
    let scaled = scaled.chunks_exact(components);
    let mut centres = draw(&scaled, count, rng)?;
    let mut nearest = vec![0; scaled.len()];
    for round in 0..ROUNDS {
        // Labels start at 0, so the first round does not tell whether anything changed.
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
    Ok(nearest)
}

/// Mean of each of `count` clusters, one after the other; for a component that is known in none of
/// its rows, the mean of all rows.
pub(super) fn means(rows: &[&[f64]], clusters: &[usize], count: usize) -> Vec<f64> {
    // From the rows as given: scaling centres back would lose digits where the deviation is as
    // large as 1e150.
    let mut all = vec![0.0; rows.first().map_or(0, |row| row.len())];
    recentre(&mut all, rows.iter().copied().zip(std::iter::repeat(&0)));
    let mut means = all.repeat(count);
    recentre(&mut means, rows.iter().copied().zip(clusters));
    means
}

/// Subtracts the mean of each component and divides by its standard deviation; returns both. A
/// constant component is not divided.
pub(super) fn standardize(values: &mut [f64], components: usize) -> Vec<(f64, f64)> {
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
        // In units of the largest value, so that squares neither overflow nor underflow.
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
            // Halved first where the difference of two large values overflows.
            *y = if difference.is_finite() {
                difference / deviation
            } else {
                (0.5 * *y - 0.5 * mean) / deviation * 2.0
            };
        }
    }
    units
}

/// Squared distance over the known components of a row.
pub(super) fn distance(centre: &[f64], row: &[f64]) -> f64 {
    let pairs = centre.iter().zip(row).filter(|(_, y)| !y.is_nan());
    pairs.map(|(c, y)| (c - y) * (c - y)).sum()
}

/// The nearest centre, the first among equals, and its squared distance.
fn closest(centres: &[f64], row: &[f64]) -> (usize, f64) {
    let centres = centres.chunks_exact(row.len()).map(|centre| distance(centre, row)).enumerate();
    centres.fold((0, f64::INFINITY), |best, found| if found.1 < best.1 { found } else { best })
}

/// Draws centres among the rows, each with probability proportional to the squared distance from
/// the nearest centre so far (k-means++). Missing components of a centre are those of the mean.
///
/// # Errors
///
/// The number of centres that can be drawn, if it is less than `count`: all rows coincide with one.
fn draw<'a, R: Rng + ?Sized>(
    rows: &(impl ExactSizeIterator<Item = &'a [f64]> + Clone),
    count: usize,
    rng: &mut R,
) -> Result<Vec<f64>, usize> {
    let mut centres = Vec::new();
    let mut squares = vec![f64::INFINITY; rows.len()];
    // Rows are standardised, so the mean is 0.
    let complete = |row: &[f64]| row.iter().map(|y| if y.is_nan() { 0.0 } else { *y }).collect();
    let mut next: usize = rng.random_range(0..rows.len());
    loop {
        let centre: Vec<f64> = rows.clone().nth(next).map(complete).unwrap_or_default();
        for (squares, row) in squares.iter_mut().zip(rows.clone()) {
            *squares = squares.min(distance(&centre, row));
        }
        centres.extend(centre);
        let drawn = centres.len() / rows.clone().next().map_or(1, <[f64]>::len);
        if drawn == count {
            return Ok(centres);
        }
        let total: f64 = squares.iter().sum();
        if total <= 0.0 {
            return Err(drawn);
        }
        next = index(squares.iter().copied().enumerate(), total, rng);
    }
}

/// Moves each centre to the mean of its rows, by component. Without known values it stays.
fn recentre<'a>(centres: &mut [f64], rows: impl Iterator<Item = (&'a [f64], &'a usize)> + Clone) {
    let known = |(row, label): (&'a [f64], &'a usize)| {
        let first = label * row.len();
        row.iter().enumerate().filter(|(_, y)| !y.is_nan()).map(move |(c, y)| (first + c, *y))
    };
    // In units of the largest value, as in `standardize`.
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
