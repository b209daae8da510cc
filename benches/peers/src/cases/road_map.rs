//! The Canberra map, with likelihoods given.

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use wayfix::canberra;

use crate::model::{Answers, Entry, Numbers};
use crate::race::Races;
use crate::{Failure, Folders};

pub(crate) const CASE: &str = "road map";

pub(crate) fn run(races: &mut Races, folders: &Folders) -> Result<(), Failure> {
    let numbers =
        Numbers::new(canberra::PLACES, entries(), 1000, &mut ChaCha8Rng::seed_from_u64(1));
    let (hmm, ys) = (numbers.sparse()?, numbers.observations());
    let folder = folders.out.join(CASE);
    numbers.write(&folder, 1)?;
    Answers::of(&hmm, &ys)?.write(&folder, numbers.states)?;
    super::alone(races, CASE, &hmm, &ys);
    Ok(())
}

/// The moves of the map.
pub(super) fn entries() -> Vec<Entry> {
    let (n, transition) = (canberra::PLACES, canberra::turning().into_transition());
    let all = (0..n).flat_map(|from| (0..n).map(move |to| (to, from)));
    let entries = all.map(|(to, from)| (to, from, transition.get(to, from)));
    entries.filter(|entry| entry.2 > 0.0).collect()
}
