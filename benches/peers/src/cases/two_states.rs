//! Two states and a long sequence, with likelihoods given.

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};

use crate::model::{Answers, Numbers};
use crate::race::Races;
use crate::{Failure, Folders};

pub(crate) const CASE: &str = "two states";

pub(crate) fn run(races: &mut Races, folders: &Folders) -> Result<(), Failure> {
    let entries = vec![(0, 0, 0.95), (1, 0, 0.05), (0, 1, 0.1), (1, 1, 0.9)];
    let numbers = Numbers::new(2, entries, 100_000, &mut ChaCha8Rng::seed_from_u64(1));
    let (hmm, ys) = (numbers.dense()?, numbers.observations());
    let folder = folders.out.join(CASE);
    numbers.write(&folder, 1)?;
    Answers::of(&hmm, &ys)?.write(&folder, numbers.states)?;
    super::alone(races, CASE, &hmm, &ys);
    Ok(())
}
