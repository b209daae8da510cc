//! Outputs that are linear in inputs, or in earlier outputs.

use wayfix_learn::{CovarianceType, Gaussian, LinearRegression, Rows};

use super::gaussian::{covariances, round};
use super::{Array, Case, Model, SMALL, generator, model, normals, sums};
use crate::race::Races;
use crate::{Failure, Folders};

pub(super) const REGRESSION: &str = "regression";
pub(super) const AUTOREGRESSION: &str = "autoregression";

/// Components of inputs and of outputs.
const INPUTS: usize = 2;
const OUTPUTS: usize = 3;
/// Number of earlier outputs that an output depends on.
const ORDER: usize = 2;

/// Noise of all steps, and the lines that it is added to.
struct Drawn {
    noise: Model<Gaussian>,
    lines: LinearRegression,
    start: Model<LinearRegression>,
}

/// A random model with a number of inputs, and one to start from.
fn drawn(inputs: usize, slopes: f64) -> Result<(Drawn, rand_chacha::ChaCha8Rng), Failure> {
    let (n, d, kind, mut rng) = (SMALL.states, OUTPUTS, CovarianceType::Full, generator());
    let mut random = |columns, scale| normals(n, columns, scale, &mut rng);
    let (coefficients, intercepts) = (random(d * inputs, slopes), random(d, 1.5));
    let moved = sums(&coefficients, &random(d * inputs, 0.3 * slopes));
    let others = sums(&intercepts, &random(d, 0.45));
    let noise = covariances(kind, n, d, &mut rng);
    let lines = LinearRegression::full(&coefficients, &intercepts, &noise)?;
    let start = LinearRegression::full(&moved, &others, &vec![round(kind, d); n])?;
    let noise = model(Gaussian::full(&vec![vec![0.0; d]; n], &noise)?, &mut rng)?;
    let start = model(start, &mut rng)?;
    Ok((Drawn { noise, lines, start }, rng))
}

fn arrays(family: &LinearRegression) -> Vec<Array> {
    let (n, p, d) = (SMALL.states, family.inputs(), family.outputs());
    let coefficients: Vec<_> = (0..n).filter_map(|state| family.coefficients(state)).collect();
    let intercepts: Vec<_> = (0..n).filter_map(|state| family.intercept(state)).collect();
    vec![
        Array::rows("coefficients", &coefficients, &[d, p]),
        Array::rows("intercepts", &intercepts, &[d]),
        Array::rows("covariances", &family.noise().covariances(), &[d, d]),
    ]
}

/// Rows hold inputs, then outputs.
pub(super) fn regression(races: &mut Races, folders: &Folders) -> Result<(), Failure> {
    let (Drawn { noise, lines, start }, mut rng) = drawn(INPUTS, 1.0)?;
    let mut all = Vec::new();
    for _ in 0..SMALL.sequences {
        let drawn = noise.simulate(SMALL.steps, &mut rng);
        let mut rows = normals(SMALL.steps, INPUTS, 1.0, &mut rng);
        for ((row, noise), &state) in rows.iter_mut().zip(drawn.observations()).zip(drawn.states())
        {
            let expected = lines.predict(state, row)?;
            row.extend(expected.iter().zip(noise).map(|(y, noise)| y + noise));
        }
        all.push(rows);
    }
    Case { name: REGRESSION, sizes: SMALL, start, arrays }.learn_rows(&all, races, folders)
}

/// Rows hold outputs; those before the first are zeros and given.
pub(super) fn autoregression(races: &mut Races, folders: &Folders) -> Result<(), Failure> {
    let (Drawn { noise, lines, start }, mut rng) = drawn(ORDER * OUTPUTS, 0.2)?;
    let mut all = Vec::new();
    for _ in 0..SMALL.sequences {
        let drawn = noise.simulate(SMALL.steps, &mut rng);
        let mut values = vec![0.0; ORDER * OUTPUTS];
        for (noise, &state) in drawn.observations().iter().zip(drawn.states()) {
            let expected = lines.predict(state, &values[values.len() - ORDER * OUTPUTS..])?;
            values.extend(expected.iter().zip(noise).map(|(y, noise)| y + noise));
        }
        all.push(values);
    }
    let case = Case { name: AUTOREGRESSION, sizes: SMALL, start, arrays };
    case.write_rows(&all, OUTPUTS, folders)?;
    let lagged = |values| Ok(Rows::new(values, OUTPUTS)?.lagged(ORDER)?);
    let seen = all.iter().map(|values| lagged(values)).collect::<Result<Vec<_>, Failure>>()?;
    case.learn(&seen, races, folders)
}
