//! Many sequences at once.

use wayfix::Hmm;
use wayfix::inference::SequenceError;

use super::{close, expect, paths, whole};
use crate::counts::Counts;
use crate::model::{Observation, Sensor};
use crate::operators::Plain;
use crate::reference::Chain;

pub(super) fn check(
    hmm: &Hmm<Plain, Sensor>,
    drives: &[Vec<Observation>],
    chains: &[Chain],
    counts: &mut Counts,
) {
    each("log_likelihood_all", hmm.log_likelihood_all(drives), chains, counts, |score, chain| {
        close::log("log_likelihood_all", score, chain.log_likelihood(), chain.size());
    });
    each("forward_all", hmm.forward_all(drives), chains, counts, |filtering, chain| {
        let (size, found) = (chain.size(), filtering.log_likelihood());
        close::log("forward_all", found, chain.log_likelihood(), size);
        for (found, expected) in filtering.log_likelihoods().iter().zip(&chain.steps) {
            close::log("forward_all, a step", *found, *expected, size);
        }
        whole::rows("forward_all", filtering.posteriors(), &chain.filtered);
    });
    each("smooth_all", hmm.smooth_all(drives), chains, counts, |smoothing, chain| {
        close::log("smooth_all", smoothing.log_likelihood(), chain.log_likelihood(), chain.size());
        whole::rows("smooth_all", smoothing.posteriors(), &chain.smoothed(chain.len()).0);
    });
    each("viterbi_all", hmm.viterbi_all(drives), chains, counts, |path, chain| {
        paths::legal("viterbi_all", &path, chain);
        let best = chain.best(chain.len(), 1)[0];
        close::log("viterbi_all", path.log_probability(), best, chain.size());
    });
    counts.add("batches");
}

fn each<R>(
    what: &str,
    results: Vec<Result<R, SequenceError>>,
    chains: &[Chain],
    counts: &mut Counts,
    check: impl Fn(R, &Chain),
) {
    assert_eq!(results.len(), chains.len(), "{what}");
    for (index, (result, chain)) in results.into_iter().zip(chains).enumerate() {
        let result = result.map_err(|error| {
            assert_eq!(error.sequence, index, "{what}: the sequence of an error");
            error.source
        });
        if let Some(result) = expect(what, result, chain, counts) {
            check(result, chain);
        }
        counts.add("sequences in batches");
    }
}
