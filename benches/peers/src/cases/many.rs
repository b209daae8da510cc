//! Many sequences on the Canberra map, smoothed.

use std::fs;
use std::hint::black_box;

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use serde_json::json;
use wayfix::canberra;

use crate::model::{Numbers, observed};
use crate::race::{Contender, Races};
use crate::{Failure, Folders, npy};

pub(crate) const CASE: &str = "road map 2000 x 50";
const SEQUENCES: usize = 2000;
const STEPS: usize = 50;

pub(crate) fn run(races: &mut Races, folders: &Folders) -> Result<(), Failure> {
    let (n, mut rng) = (canberra::PLACES, ChaCha8Rng::seed_from_u64(1));
    let numbers = Numbers::new(n, super::road_map::entries(), SEQUENCES * STEPS, &mut rng);
    let (hmm, ys) = (numbers.sparse()?, numbers.observations());
    let sequences: Vec<&[&[f64]]> = ys.chunks(STEPS).collect();
    let folder = folders.out.join(CASE);
    numbers.write(&folder, SEQUENCES)?;

    let (mut log_likelihoods, mut firsts, mut sums) = (Vec::new(), Vec::new(), Vec::new());
    for smoothing in hmm.smooth_all(&sequences) {
        let smoothing = smoothing?;
        log_likelihoods.push(smoothing.log_likelihood());
        let smoothed = observed(smoothing.posteriors());
        firsts.extend_from_slice(&smoothed[..n]);
        sums.extend((0..n).map(|i| smoothed[i..].iter().step_by(n).sum::<f64>()));
    }
    let sizes = json!({ "states": n, "steps": STEPS, "sequences": SEQUENCES });
    fs::write(folder.join("model.json"), serde_json::to_string_pretty(&sizes)?)?;
    npy::doubles(&folder.join("log_likelihoods.npy"), &[SEQUENCES], &log_likelihoods)?;
    npy::doubles(&folder.join("smoothed_first.npy"), &[SEQUENCES, n], &firsts)?;
    npy::doubles(&folder.join("smoothed_sum.npy"), &[SEQUENCES, n], &sums)?;

    let work = || drop(black_box(hmm.smooth_all(black_box(&sequences))));
    races.run(CASE, "smooth", SEQUENCES * STEPS, vec![Contender::wayfix(work)]);
    Ok(())
}
