//! Models for the benchmarks, and observations for them. All random numbers come from fixed seeds.
#![allow(dead_code, reason = "each bench uses its part")]

use std::path::{Path, PathBuf};

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use rand_distr::{Distribution, Exp1};
use wayfix::{
    Belief, DenseTransition, Fixed, Hmm, Likelihood, LikelihoodVector, Prior, SparseTransition,
    TableLikelihood, Transition, canberra,
};

/// Given likelihoods, which have no parameters to learn.
pub(crate) type Given = Fixed<LikelihoodVector<Vec<f64>>>;

/// Model with observations for as many steps as the longest measurement takes.
pub(crate) struct Model<A, B: Likelihood<Observation: Sized>> {
    pub(crate) hmm: Hmm<A, B>,
    pub(crate) seen: Vec<B::Observation>,
}

impl<A: Transition<Control = ()>, B: Likelihood<Observation: Sized>> Model<A, B> {
    /// Sequences of one length, one after another in the observations.
    pub(crate) fn sequences(&self, count: usize, steps: usize) -> Vec<&[B::Observation]> {
        self.seen.chunks_exact(steps).take(count).collect()
    }
}

fn random(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

fn uniform(n: usize) -> Belief {
    Belief::uniform(n).expect("there are states")
}

/// Independent exponential weights that sum to one, none of them near 0.
pub(crate) fn weights(count: usize, rng: &mut ChaCha8Rng) -> Vec<f64> {
    let mut weight = || -> f64 { Exp1.sample(rng) };
    let weights = (0..count).map(|_| 0.05 + weight()).collect();
    Belief::from_weights(weights).expect("weights are positive").into_vec()
}

/// The model with these moves, which starts anywhere, with a vector of likelihoods for each of
/// `steps` steps.
pub(crate) fn given<A: Transition>(transition: A, steps: usize) -> Model<A, Given> {
    let (n, mut rng) = (transition.states(), random(2));
    let sensor = Fixed(LikelihoodVector::linear(n).owned());
    let hmm = Hmm::new(Prior::BeforeFirstTransition(uniform(n)), transition, sensor);
    let seen = (0..steps).map(|_| weights(n, &mut rng)).collect();
    Model { hmm: hmm.expect("one size"), seen }
}

/// The same with a table of six symbols.
pub(crate) fn table(n: usize, steps: usize) -> Model<DenseTransition, TableLikelihood> {
    let mut rng = random(3);
    let rows: Vec<_> = (0..n).map(|_| weights(6, &mut rng)).collect();
    let sensor = TableLikelihood::from_rows(&rows).expect("a table");
    let prior = Prior::AtFirstObservation(uniform(n));
    let hmm = Hmm::new(prior, dense(n), sensor).expect("one size");
    let seen = hmm.simulate(steps, &mut rng).observations().to_vec();
    Model { hmm, seen }
}

/// The Canberra map, with its own sensor, from anywhere.
pub(crate) fn canberra_table(steps: usize) -> Model<SparseTransition, TableLikelihood> {
    let (_, transition, sensor) = canberra::hmm(5, 1.0).expect("place 5 exists").into_parts();
    let prior = Prior::BeforeFirstTransition(uniform(transition.states()));
    let hmm = Hmm::new(prior, transition, sensor).expect("one size").with_rounded_tails();
    let seen = hmm.simulate(steps, &mut random(4)).observations().to_vec();
    Model { hmm, seen }
}

/// The moves of the Canberra map.
pub(crate) fn canberra() -> SparseTransition {
    canberra::hmm(5, 1.0).expect("place 5 exists").into_parts().1
}

/// A matrix without zeros.
pub(crate) fn dense(n: usize) -> DenseTransition {
    let mut rng = random(1);
    let columns: Vec<_> = (0..n).map(|_| weights(n, &mut rng)).collect();
    DenseTransition::from_fn(n, |to, from| columns[from][to]).expect("a matrix")
}

/// Folder with a road graph of your own.
pub(crate) fn graph_folder() -> Option<PathBuf> {
    std::env::var_os("WAYFIX_GRAPH").map(PathBuf::from)
}

/// A random walk on a road graph: stops with 0.1, and takes all roads alike. The folder has
/// `nodes.csv` and `edges.csv` (from, to, …), with nodes numbered from 0.
pub(crate) fn graph(folder: &Path) -> SparseTransition {
    let read = |name: &str| csv::Reader::from_path(folder.join(name)).expect("the file opens");
    let nodes = read("nodes.csv").into_records().count();
    let mut ways = vec![Vec::new(); nodes];
    for edge in read("edges.csv").into_records() {
        let edge = edge.expect("a record");
        let end = |column: usize| edge[column].parse::<usize>().expect("a node number");
        if end(0) != end(1) && !ways[end(0)].contains(&end(1)) {
            ways[end(0)].push(end(1));
        }
    }
    let entries = ways.iter().enumerate().flat_map(|(from, ways)| {
        let stop = if ways.is_empty() { 1.0 } else { 0.1 };
        let go = (1.0 - stop) / ways.len().max(1) as f64;
        std::iter::once((from, from, stop)).chain(ways.iter().map(move |&to| (to, from, go)))
    });
    SparseTransition::from_triplets(nodes, entries).expect("a stochastic matrix")
}

/// A town like a grid, numbered street by street: from each place it stays, or
/// goes to one of four others. Three of a hundred roads lead elsewhere in the
/// neighbourhood.
pub(crate) fn town(places: usize) -> SparseTransition {
    let width = places.isqrt();
    let mut random = 1_u64;
    let mut draw = move |below: usize| {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695);
        (random >> 33) as usize % below
    };
    let roads = (0..places).flat_map(move |from| {
        let mut to = [0, 1, places - 1, width, places - width].map(|step| (from + step) % places);
        if draw(100) < 15 {
            to[1 + draw(4)] = (from + 2 + draw(width - 4)) % places;
        }
        to.map(|to| (to, from, 0.2))
    });
    SparseTransition::from_triplets(places, roads).expect("a town")
}
