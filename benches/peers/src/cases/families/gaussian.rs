//! Gaussian vectors and their mixtures.

use rand_chacha::ChaCha8Rng;
use wayfix_learn::{CovarianceType, Family, Gaussian, GaussianMixture};

use super::{Array, Case, SMALL, Sizes, draw, generator, model, normals, sums};
use crate::model::distribution;
use crate::race::Races;
use crate::{Failure, Folders};

pub(super) const FULL: &str = "gaussian";
pub(super) const TIED: &str = "tied gaussian";
pub(super) const DIAGONAL: &str = "diagonal gaussian";
pub(super) const SPHERICAL: &str = "spherical gaussian";
pub(super) const FULL_MIXTURE: &str = "mixture";
pub(super) const DIAGONAL_MIXTURE: &str = "diagonal mixture";

const COMPONENTS: usize = 3;
/// Number of Gaussians of a mixture.
const PARTS: usize = 2;

pub(super) fn full(races: &mut Races, folders: &Folders) -> Result<(), Failure> {
    let sizes = Sizes { states: 8, sequences: 50, steps: 1000 };
    run(FULL, CovarianceType::Full, sizes, 6, races, folders)
}

pub(super) fn tied(races: &mut Races, folders: &Folders) -> Result<(), Failure> {
    run(TIED, CovarianceType::Tied, SMALL, COMPONENTS, races, folders)
}

pub(super) fn diagonal(races: &mut Races, folders: &Folders) -> Result<(), Failure> {
    run(DIAGONAL, CovarianceType::Diagonal, SMALL, COMPONENTS, races, folders)
}

pub(super) fn spherical(races: &mut Races, folders: &Folders) -> Result<(), Failure> {
    run(SPHERICAL, CovarianceType::Spherical, SMALL, COMPONENTS, races, folders)
}

fn run(
    name: &'static str,
    kind: CovarianceType,
    sizes: Sizes,
    d: usize,
    races: &mut Races,
    folders: &Folders,
) -> Result<(), Failure> {
    let (n, mut rng) = (sizes.states, generator());
    let count = if kind == CovarianceType::Tied { 1 } else { n };
    let means = normals(n, d, 1.5, &mut rng);
    let truth = Gaussian::new(kind, &means, &covariances(kind, count, d, &mut rng))?;
    let drawn = draw(&model(truth, &mut rng)?, sizes, &mut rng);
    // From other transitions, round covariances and moved means.
    let moved = sums(&means, &normals(n, d, 0.45, &mut rng));
    let start = model(Gaussian::new(kind, &moved, &vec![round(kind, d); count])?, &mut rng)?;
    let arrays = |family: &Gaussian| {
        let d = family.components();
        let shape = shape(family.covariance_type(), d);
        vec![
            Array::rows("means", &family.means(), &[d]),
            Array::rows("covariances", &family.covariances(), &shape),
        ]
    };
    Case { name, sizes, start, arrays }.learn_rows(&drawn, races, folders)
}

pub(super) fn full_mixture(races: &mut Races, folders: &Folders) -> Result<(), Failure> {
    mixture(FULL_MIXTURE, CovarianceType::Full, races, folders)
}

pub(super) fn diagonal_mixture(races: &mut Races, folders: &Folders) -> Result<(), Failure> {
    mixture(DIAGONAL_MIXTURE, CovarianceType::Diagonal, races, folders)
}

fn mixture(
    name: &'static str,
    kind: CovarianceType,
    races: &mut Races,
    folders: &Folders,
) -> Result<(), Failure> {
    let (n, d, mut rng) = (SMALL.states, COMPONENTS, generator());
    let family = |weights: &[Vec<f64>], means: &[Vec<f64>], covariances: &[Vec<f64>]| {
        let (means, covariances) = (parts(means), parts(covariances));
        if kind == CovarianceType::Full {
            GaussianMixture::full(weights, &means, &covariances)
        } else {
            GaussianMixture::diagonal(weights, &means, &covariances)
        }
    };
    let weights: Vec<Vec<f64>> = (0..n).map(|_| distribution(PARTS, &mut rng)).collect();
    let means = normals(n * PARTS, d, 2.0, &mut rng);
    let truth = family(&weights, &means, &covariances(kind, n * PARTS, d, &mut rng))?;
    let drawn = draw(&model(truth, &mut rng)?, SMALL, &mut rng);
    let moved = sums(&means, &normals(n * PARTS, d, 0.45, &mut rng));
    let equal = vec![vec![1.0 / PARTS as f64; PARTS]; n];
    let start = model(family(&equal, &moved, &vec![round(kind, d); n * PARTS])?, &mut rng)?;
    let arrays = |family: &GaussianMixture| {
        let (n, m, d) = (family.means().len(), family.parts(), family.components());
        let weights = (0..n).filter_map(|state| family.weights(state)).collect::<Vec<_>>().concat();
        let shape = [&[n, m], &shape(family.covariance_type(), d)[..]].concat();
        let (means, covariances) = (family.means().concat(), family.covariances().concat());
        vec![
            Array { name: "weights", shape: vec![n, m], values: weights },
            Array { name: "means", shape: vec![n, m, d], values: means.concat() },
            Array { name: "covariances", shape, values: covariances.concat() },
        ]
    };
    Case { name, sizes: SMALL, start, arrays }.learn_rows(&drawn, races, folders)
}

/// Covariances of all states, state by state.
fn parts(all: &[Vec<f64>]) -> Vec<Vec<Vec<f64>>> {
    all.chunks(PARTS).map(<[_]>::to_vec).collect()
}

/// The axes of a covariance of this type.
fn shape(kind: CovarianceType, d: usize) -> Vec<usize> {
    match kind {
        CovarianceType::Spherical => vec![],
        CovarianceType::Diagonal => vec![d],
        _ => vec![d, d],
    }
}

/// Covariance in the form of this type: the matrix, its diagonal, or the mean of the diagonal.
fn of_kind(kind: CovarianceType, d: usize, matrix: Vec<f64>) -> Vec<f64> {
    let diagonal: Vec<f64> = matrix.iter().step_by(d + 1).copied().collect();
    match kind {
        CovarianceType::Spherical => vec![diagonal.iter().sum::<f64>() / d as f64],
        CovarianceType::Diagonal => diagonal,
        _ => matrix,
    }
}

/// Random covariances.
pub(super) fn covariances(
    kind: CovarianceType,
    count: usize,
    d: usize,
    rng: &mut ChaCha8Rng,
) -> Vec<Vec<f64>> {
    let covariance = |b: Vec<f64>| {
        let entry = |i: usize, j: usize| {
            let products = (0..d).map(|k| b[i * d + k] * b[j * d + k]).sum::<f64>();
            products + if i == j { 0.4 } else { 0.0 }
        };
        of_kind(kind, d, (0..d * d).map(|at| entry(at / d, at % d)).collect())
    };
    normals(count, d * d, 0.6, rng).into_iter().map(covariance).collect()
}

/// A covariance that is the same in all directions.
pub(super) fn round(kind: CovarianceType, d: usize) -> Vec<f64> {
    let entry = |at: usize| if at / d == at % d { 1.5 } else { 0.0 };
    of_kind(kind, d, (0..d * d).map(entry).collect())
}
