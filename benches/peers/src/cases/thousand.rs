//! A thousand states with a full matrix and given likelihoods. A step of the filter is compared
//! with faer's product of matrix and vector, which is most of a step.

use std::hint::black_box;

use faer::linalg::matmul::matmul;
use faer::{Accum, ColMut, ColRef, Mat, Par};
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use wayfix::Transition;

use crate::model::{Answers, Numbers, full, matrix};
use crate::race::{Contender, Races};
use crate::{Failure, Folders, check};

pub(crate) const CASE: &str = "dense 1000";

pub(crate) fn run(races: &mut Races, folders: &Folders) -> Result<(), Failure> {
    let (n, mut rng) = (1000, ChaCha8Rng::seed_from_u64(1));
    let entries = full(n, &mut rng);
    let numbers = Numbers::new(n, entries, 100, &mut rng);
    let (hmm, ys) = (numbers.dense()?, numbers.observations());
    let folder = folders.out.join(CASE);
    numbers.write(&folder, 1)?;
    let answers = Answers::of(&hmm, &ys)?;
    answers.write(&folder, n)?;

    let rows = matrix(n, &numbers.entries);
    let of_faer = Mat::from_fn(n, n, |to, from| rows[to * n + from]);
    let product = |x: &[f64], out: &mut [f64]| {
        let (x, out) = (ColRef::from_slice(x), ColMut::from_slice_mut(out));
        matmul(out, Accum::Replace, of_faer.as_ref(), x, 1.0, Par::Seq);
    };
    let x = &answers.filtered[..n];
    let (mut found, mut expected) = (vec![0.0; n], vec![0.0; n]);
    product(x, &mut found);
    hmm.transition().apply(&(), x, &mut expected);
    let off = check::of_distributions(n, &found, &expected);
    let off = check::within(check::TOLERANCE, "faer's product", off)?;

    let mut into = vec![0.0; n];
    let products = || {
        for x in answers.filtered.chunks(n) {
            product(black_box(x), black_box(&mut into));
        }
    };
    let faer = Contender::peer("faer (product alone)", off, products);
    races.run(CASE, "filter", ys.len(), vec![super::filter(&hmm, &ys), faer]);
    super::whole(races, CASE, &hmm, &ys);
    Ok(())
}
