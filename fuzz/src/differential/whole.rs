//! Routines for a whole sequence, except those for paths.

use wayfix::inference::{Order, Posteriors};
use wayfix::{Hmm, TransitionEntries};

use super::{Drive, close, expect};
use crate::counts::Counts;
use crate::model::{Matrix, Sensor};
use crate::reference::Chain;

pub(super) fn check<A: TransitionEntries, S: Drive<A>>(
    hmm: &Hmm<A, Sensor>,
    sequence: &S,
    chain: &Chain,
    counts: &mut Counts,
) {
    let (size, expected) = (chain.size(), chain.log_likelihood());
    let (gamma, pairs) = chain.smoothed(chain.len());
    if let Some(score) = expect("score", hmm.log_likelihood(sequence), chain, counts) {
        close::log("score", score, expected, size);
        counts.add("scores");
    }
    if let Some(filtering) = expect("forward", hmm.forward(sequence), chain, counts) {
        close::log("forward", filtering.log_likelihood(), expected, size);
        for (found, expected) in filtering.log_likelihoods().iter().zip(&chain.steps) {
            close::log("forward, a step", *found, *expected, size);
        }
        rows("forward", filtering.posteriors(), &chain.filtered);
        counts.add("sequences filtered");
    }
    if let Some(smoothing) = expect("smooth", hmm.smooth(sequence), chain, counts) {
        close::log("smooth", smoothing.log_likelihood(), expected, size);
        rows("smooth", smoothing.posteriors(), &gamma);
        counts.add("sequences smoothed");
    }
    for order in [Order::Forward, Order::Backward] {
        let mut visited = Vec::new();
        let log = hmm.smooth_each(sequence, order, |step| {
            let k = step.step();
            visited.push(k);
            close::belief(
                "smooth_each, filtered",
                k,
                step.filtered().as_slice(),
                &chain.filtered[k],
            );
            close::belief("smooth_each", k, step.smoothed().as_slice(), &gamma[k]);
            for m in step.moves().into_iter().flatten() {
                let expected = pairs[k - 1][m.to][m.from].exp();
                close::number("weight of a pair", m.weight, expected, 1e-9);
            }
        });
        if let Some(log) = expect("smooth_each", log, chain, counts) {
            close::log("smooth_each", log, expected, size);
            let mut all: Vec<usize> = (0..=chain.len()).collect();
            if order == Order::Backward {
                all.reverse();
            }
            assert_eq!(visited, all);
            counts.add("sequences smoothed step by step");
        }
    }
    if let Some(moves) = expect("expected_moves", hmm.expected_moves(sequence), chain, counts) {
        let still = usize::from(matches!(hmm.prior(), wayfix::Prior::AtFirstObservation(_)));
        for (from, to) in (0..hmm.states()).flat_map(|j| (0..hmm.states()).map(move |i| (j, i))) {
            let expected: f64 =
                pairs.iter().skip(still).map(|pairs: &Matrix| pairs[to][from].exp()).sum();
            close::number("expected moves", moves.get(from, to), expected, 1e-9);
        }
        counts.add("expected moves");
    }
    if let Some(entropy) = expect("path_entropy", hmm.path_entropy(sequence), chain, counts) {
        // A difference of logarithms of this size, which may err by their rounding.
        let (expected, slack) = (chain.path_entropy(), 1e-15 * (1e3 + size));
        let near = (entropy - expected).abs() <= 1e-6 * expected.abs() + slack;
        assert!(near, "path_entropy: {entropy:e}, expected {expected:e}");
        counts.add("path entropies");
    }
}

pub(super) fn rows(what: &str, found: &Posteriors, expected: &[Vec<f64>]) {
    assert_eq!(found.steps() + 1, expected.len(), "{what}");
    for (step, expected) in expected.iter().enumerate() {
        let found = found.get(step).expect("a step");
        close::belief(what, step, found.as_slice(), expected);
    }
}
