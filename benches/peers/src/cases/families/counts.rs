//! Symbols, counts, events and durations.

use std::fs;

use rand_chacha::ChaCha8Rng;
use wayfix::TableLikelihood;
use wayfix_learn::{Bernoulli, EmissionError, Gamma, Independent, Multinomial, Poisson};
use wayfix::likelihood::{LearnLikelihood, Likelihood, SampleObservation};

use super::{Array, Case, SMALL, Sizes, draw, generator, model};
use crate::model::{distribution, weights};
use crate::race::Races;
use crate::{Failure, Folders, npy};

pub(super) const CATEGORICAL: &str = "learning";
pub(super) const POISSON: &str = "poisson";
pub(super) const BERNOULLI: &str = "bernoulli";
pub(super) const MULTINOMIAL: &str = "multinomial";
pub(super) const GAMMA: &str = "gamma";

/// Parameters, with a row for each state.
type Table = Vec<Vec<f64>>;

pub(super) fn categorical(races: &mut Races, folders: &Folders) -> Result<(), Failure> {
    let sizes = Sizes { states: 10, sequences: 50, steps: 100 };
    let mut rng = generator();
    let mut random = || {
        let rows: Table = (0..sizes.states).map(|_| distribution(20, &mut rng)).collect();
        model(TableLikelihood::from_rows(&rows)?, &mut rng)
    };
    let (truth, start) = (random()?, random()?);
    let drawn = draw(&truth, sizes, &mut rng);
    let arrays = |table: &TableLikelihood| {
        vec![Array::rows("probabilities", &table.to_rows(), &[table.symbols()])]
    };
    let folder = folders.out.join(CATEGORICAL);
    fs::create_dir_all(&folder)?;
    let shape = [sizes.sequences, sizes.steps, 1];
    npy::indices(&folder.join("rows.npy"), &shape, &drawn.concat())?;
    Case { name: CATEGORICAL, sizes, start, arrays }.learn(&drawn, races, folders)
}

pub(super) fn poisson(races: &mut Races, folders: &Folders) -> Result<(), Failure> {
    let arrays =
        |family: &Independent<Poisson>| vec![array("rates", &family.parameters(Poisson::rate))];
    run(POISSON, |rng| table(3, |x| 0.5 + 5.0 * x, rng), Poisson::family, arrays, races, folders)
}

pub(super) fn bernoulli(races: &mut Races, folders: &Folders) -> Result<(), Failure> {
    let arrays = |family: &Independent<Bernoulli>| {
        vec![array("probabilities", &family.parameters(Bernoulli::probability))]
    };
    run(
        BERNOULLI,
        |rng| table(6, |x| x / (1.0 + x), rng),
        Bernoulli::family,
        arrays,
        races,
        folders,
    )
}

pub(super) fn multinomial(races: &mut Races, folders: &Folders) -> Result<(), Failure> {
    let random = |rng: &mut ChaCha8Rng| (0..SMALL.states).map(|_| distribution(5, rng)).collect();
    let family = |rows: &[Vec<f64>]| Ok(Multinomial::new(rows)?.with_trials(8));
    let arrays = |family: &Multinomial| vec![array("probabilities", &family.probabilities())];
    run(MULTINOMIAL, random, family, arrays, races, folders)
}

pub(super) fn gamma(races: &mut Races, folders: &Folders) -> Result<(), Failure> {
    // A shape and a scale in each row.
    let column =
        |rows: &[Vec<f64>], at: usize| rows.iter().map(|row| [row[at]]).collect::<Vec<_>>();
    let family = |rows: &[Vec<f64>]| Gamma::family(&column(rows, 0), &column(rows, 1));
    let arrays = |family: &Independent<Gamma>| {
        let parameters = |of: fn(&Gamma) -> f64| family.parameters(of);
        vec![array("shapes", &parameters(Gamma::shape)), array("scales", &parameters(Gamma::scale))]
    };
    run(GAMMA, |rng| table(2, |x| 0.5 + 3.0 * x, rng), family, arrays, races, folders)
}

/// Draws from a family with random parameters, and starts learning from perturbed ones.
fn run<L>(
    name: &'static str,
    random: impl Fn(&mut ChaCha8Rng) -> Table,
    family: impl Fn(&[Vec<f64>]) -> Result<L, EmissionError>,
    arrays: fn(&L) -> Vec<Array>,
    races: &mut Races,
    folders: &Folders,
) -> Result<(), Failure>
where
    L: Likelihood<Observation = [f64]>,
    L: LearnLikelihood + SampleObservation<Sample = Vec<f64>> + Clone + Sync,
{
    let mut rng = generator();
    let (truth, others) = (random(&mut rng), random(&mut rng));
    let drawn = draw(&model(family(&truth)?, &mut rng)?, SMALL, &mut rng);
    let between = |(a, b): (&Vec<f64>, &Vec<f64>)| {
        a.iter().zip(b).map(|(a, b)| 0.7 * a + 0.3 * b).collect::<Vec<f64>>()
    };
    let moved: Table = truth.iter().zip(&others).map(between).collect();
    let start = model(family(&moved)?, &mut rng)?;
    Case { name, sizes: SMALL, start, arrays }.learn_rows(&drawn, races, folders)
}

fn array(name: &'static str, rows: &[Vec<f64>]) -> Array {
    Array::rows(name, rows, &[rows[0].len()])
}

/// Values of independent exponential numbers.
fn table(columns: usize, value: impl Fn(f64) -> f64, rng: &mut ChaCha8Rng) -> Table {
    let values: Vec<f64> = weights(SMALL.states * columns, rng).into_iter().map(value).collect();
    values.chunks(columns).map(<[_]>::to_vec).collect()
}
