//! A road graph of your own, with likelihoods given.

use std::path::Path;

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};

use crate::model::{Answers, Entry, Numbers};
use crate::race::Races;
use crate::{Failure, Folders};

pub(crate) const CASE: &str = "graph";

pub(crate) fn run(races: &mut Races, folders: &Folders) -> Result<(), Failure> {
    let (states, entries) = walk(&folders.graph)?;
    let numbers = Numbers::new(states, entries, 50, &mut ChaCha8Rng::seed_from_u64(1));
    let (hmm, ys) = (numbers.sparse()?, numbers.observations());
    let folder = folders.out.join(CASE);
    numbers.write(&folder, 1)?;
    Answers::of(&hmm, &ys)?.write(&folder, states)?;
    super::alone(races, CASE, &hmm, &ys);
    Ok(())
}

/// The number of places, and the entries of a random walk: it stops with 0.1, and takes all roads
/// alike.
fn walk(graph: &Path) -> Result<(usize, Vec<Entry>), Failure> {
    let places = csv::Reader::from_path(graph.join("nodes.csv"))?.into_records().count();
    let mut ways = vec![Vec::new(); places];
    for edge in csv::Reader::from_path(graph.join("edges.csv"))?.into_records() {
        let edge = edge?;
        let (from, to): (usize, usize) = (edge[0].parse()?, edge[1].parse()?);
        if from.max(to) >= places {
            return Err(format!("there is no place {}", from.max(to)).into());
        }
        if from != to && !ways[from].contains(&to) {
            ways[from].push(to);
        }
    }
    let mut entries = Vec::new();
    for (from, ways) in ways.iter().enumerate() {
        let stop = if ways.is_empty() { 1.0 } else { 0.1 };
        let go = (1.0 - stop) / ways.len().max(1) as f64;
        entries.push((from, from, stop));
        entries.extend(ways.iter().map(|&to| (to, from, go)));
    }
    Ok((places, entries))
}
