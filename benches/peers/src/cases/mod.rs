//! One file for each case, and a folder for the families of observations.

pub(crate) mod families;
pub(crate) mod graph;
pub(crate) mod many;
pub(crate) mod road_map;
pub(crate) mod switching;
pub(crate) mod symbols;
pub(crate) mod thousand;
pub(crate) mod two_states;

use std::hint::black_box;

use wayfix::{Hmm, LikelihoodVector, TransitionEntries};

use crate::race::{Contender, Races};

/// Message for a timed routine that fails, though it has given its answer before.
const ANSWERED: &str = "it has answered before";

/// A filter that goes through the observations, one at a time.
fn filter<'a, A: TransitionEntries<Control = ()>>(
    hmm: &'a Hmm<A, LikelihoodVector>,
    ys: &'a [&[f64]],
) -> Contender<'a> {
    let mut filter = hmm.filter();
    Contender::wayfix(move || {
        filter.restart();
        for &y in ys {
            black_box(filter.step(black_box(y)).expect(ANSWERED));
        }
    })
}

/// Routines of wayfix that are compared only with peers in Python.
fn alone<A: TransitionEntries<Control = ()>>(
    races: &mut Races,
    case: &'static str,
    hmm: &Hmm<A, LikelihoodVector>,
    ys: &[&[f64]],
) {
    races.run(case, "filter", ys.len(), vec![filter(hmm, ys)]);
    whole(races, case, hmm, ys);
}

/// Routines for a whole sequence.
fn whole<A: TransitionEntries<Control = ()>>(
    races: &mut Races,
    case: &'static str,
    hmm: &Hmm<A, LikelihoodVector>,
    ys: &[&[f64]],
) {
    let mut run = |routine, contender| races.run(case, routine, ys.len(), vec![contender]);
    run("forward", Contender::wayfix(|| drop(black_box(hmm.forward(black_box(ys))))));
    run("score", Contender::wayfix(|| drop(black_box(hmm.log_likelihood(black_box(ys))))));
    run("smooth", Contender::wayfix(|| drop(black_box(hmm.smooth(black_box(ys))))));
    // Decoders are given logarithms, as those of the peers are.
    let n = hmm.states();
    let logs: Vec<Vec<f64>> = ys.iter().map(|y| y.iter().map(|b| b.ln()).collect()).collect();
    let logs: Vec<&[f64]> = logs.iter().map(Vec::as_slice).collect();
    let decoder = Hmm::new(hmm.prior().clone(), hmm.transition(), LikelihoodVector::log(n));
    let decoder = decoder.expect("it is that of the other");
    let paths = [hmm.viterbi(ys), decoder.viterbi(&logs)].map(|path| path.expect(ANSWERED));
    assert_eq!(paths[0].states(), paths[1].states(), "logarithms must not change the path");
    run("viterbi", Contender::wayfix(|| drop(black_box(decoder.viterbi(black_box(&logs))))));
}
