//! A full matrix and symbols, for the crates bio and hmmm.

use std::hint::black_box;

use bio::stats::hmm as bio_hmm;
use bio::stats::hmm::discrete_emission::Model as BioModel;
use hmmm::HMM as Hmmm;
use ndarray_of_hmmm::{Array1, Array2};
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use rand_distr::{Distribution, Uniform};
use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood, canberra};

use super::ANSWERED;
use crate::check::{TOLERANCE, of_distributions, of_numbers, of_paths, within};
use crate::model::{distribution, full, matrix, observed};
use crate::race::{Contender, Races};
use crate::{Failure, Folders};

pub(crate) const CASE: &str = "dense 105";
const N: usize = canberra::PLACES;
const STEPS: usize = 1000;
/// Tolerance for the crate bio, which adds logarithms with a polynomial for the exponential.
const OF_BIO: f64 = 1e-5;

type Model = Hmm<DenseTransition, TableLikelihood>;

pub(crate) fn run(races: &mut Races, _: &Folders) -> Result<(), Failure> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let matrix = matrix(N, &full(N, &mut rng));
    let table: Vec<Vec<f64>> = (0..N).map(|_| distribution(N, &mut rng)).collect();
    let symbols = Uniform::new(0, N)?;
    let ys: Vec<usize> = (0..STEPS).map(|_| symbols.sample(&mut rng)).collect();
    let prior = 1.0 / N as f64;

    let hmm = Hmm::new(
        Prior::AtFirstObservation(Belief::uniform(N)?),
        DenseTransition::from_row_major(N, &matrix)?,
        TableLikelihood::from_rows(&table)?,
    )?;
    let bio = {
        use ndarray_of_bio::{Array1, Array2};
        let transition = Array2::from_shape_fn((N, N), |(from, to)| matrix[to * N + from]);
        let emission = Array2::from_shape_fn((N, N), |(i, symbol)| table[i][symbol]);
        BioModel::with_float(&transition, &emission, &Array1::from_elem(N, prior))?
    };
    let hmmm = Hmmm::new(
        Array2::from_shape_fn((N, N), |(from, to)| matrix[to * N + from]),
        Array2::from_shape_fn((N, N), |(i, symbol)| table[i][symbol]),
        Array1::from_elem(N, prior),
    );
    forward(races, &hmm, &bio, &ys)?;
    filter(races, &hmm, &hmmm, &ys)?;
    smooth(races, &hmm, &bio, &hmmm, &ys)?;
    viterbi(races, &hmm, &bio, &hmmm, &ys)
}

fn forward(races: &mut Races, hmm: &Model, bio: &BioModel, ys: &[usize]) -> Result<(), Failure> {
    let expected = hmm.forward(ys)?.log_likelihood();
    let (_, found) = bio_hmm::forward(bio, ys);
    let off = within(OF_BIO, "forward of bio", of_numbers(&[*found], &[expected]))?;
    let contenders = vec![
        Contender::wayfix(|| drop(black_box(hmm.forward(black_box(ys))))),
        Contender::peer("bio", off, || drop(black_box(bio_hmm::forward(bio, black_box(ys))))),
    ];
    races.run(CASE, "forward", STEPS, contenders);
    Ok(())
}

fn filter(races: &mut Races, hmm: &Model, hmmm: &Hmmm, ys: &[usize]) -> Result<(), Failure> {
    // The fields of an item are private, but printed.
    let mut found = Vec::with_capacity(STEPS * N);
    for item in hmmm.filter(ys.iter().copied()) {
        let text = format!("{item:?}");
        let numbers = text.split_once('[').and_then(|(_, rest)| rest.split_once(']'));
        let (numbers, _) = numbers.ok_or("an item of hmmm prints otherwise")?;
        for number in numbers.split(',') {
            found.push(number.trim().parse::<f64>()?);
        }
    }
    let expected = observed(hmm.forward(ys)?.posteriors());
    let off = within(TOLERANCE, "filter of hmmm", of_distributions(N, &found, &expected))?;
    let mut filter = hmm.filter();
    let step_by_step = move || {
        filter.restart();
        for y in ys {
            black_box(filter.step(black_box(y)).expect(ANSWERED));
        }
    };
    let of_hmmm = || hmmm.filter(black_box(ys).iter().copied()).for_each(|b| drop(black_box(b)));
    let contenders = vec![Contender::wayfix(step_by_step), Contender::peer("hmmm", off, of_hmmm)];
    races.run(CASE, "filter", STEPS, contenders);
    Ok(())
}

fn smooth(
    races: &mut Races,
    hmm: &Model,
    bio: &BioModel,
    hmmm: &Hmmm,
    ys: &[usize],
) -> Result<(), Failure> {
    // Forward and backward are bio's own; their product is taken here.
    let smooth_by_bio = |ys: &[usize]| -> Vec<f64> {
        let (forward, log) = bio_hmm::forward(bio, ys);
        let (backward, _) = bio_hmm::backward(bio, ys);
        let rows = forward.rows().into_iter().zip(backward.rows().into_iter().rev());
        rows.flat_map(|(f, b)| {
            f.iter().zip(b).map(|(f, b)| (**f + **b - *log).exp()).collect::<Vec<_>>()
        })
        .collect()
    };
    let array = Array1::from(ys.to_vec());
    let expected = observed(hmm.smooth(ys)?.posteriors());
    let bio_off = of_distributions(N, &smooth_by_bio(ys), &expected);
    let bio_off = within(OF_BIO, "forward and backward of bio", bio_off)?;
    let found: Vec<f64> = hmmm.smooth(&array).iter().copied().collect();
    let off = within(TOLERANCE, "smooth of hmmm", of_distributions(N, &found, &expected))?;
    let contenders = vec![
        Contender::wayfix(|| drop(black_box(hmm.smooth(black_box(ys))))),
        Contender::peer("bio", bio_off, || drop(black_box(smooth_by_bio(black_box(ys))))),
        Contender::peer("hmmm", off, || drop(black_box(hmmm.smooth(black_box(&array))))),
    ];
    races.run(CASE, "smooth", STEPS, contenders);
    Ok(())
}

fn viterbi(
    races: &mut Races,
    hmm: &Model,
    bio: &BioModel,
    hmmm: &Hmmm,
    ys: &[usize],
) -> Result<(), Failure> {
    let array = Array1::from(ys.to_vec());
    let expected = hmm.viterbi(ys)?;
    let (path, log) = bio_hmm::viterbi(bio, ys);
    let path: Vec<usize> = path.into_iter().map(|state| *state).collect();
    let bio_off = of_numbers(&[*log], &[expected.log_probability()]);
    let bio_off = bio_off.max(of_paths(&path, expected.states()));
    let bio_off = within(TOLERANCE, "viterbi of bio", bio_off)?;
    let path = hmmm.most_likely_sequence(&array).to_vec();
    let off = within(TOLERANCE, "viterbi of hmmm", of_paths(&path, expected.states()))?;
    let contenders = vec![
        Contender::wayfix(|| drop(black_box(hmm.viterbi(black_box(ys))))),
        Contender::peer("bio", bio_off, || drop(black_box(bio_hmm::viterbi(bio, black_box(ys))))),
        Contender::peer("hmmm", off, || {
            drop(black_box(hmmm.most_likely_sequence(black_box(&array))));
        }),
    ];
    races.run(CASE, "viterbi", STEPS, contenders);
    Ok(())
}
