//! Results of many sequences: those of each alone, on any number of threads.

use std::panic::{AssertUnwindSafe, catch_unwind};

use wayfix::inference::{FilteredSequence, SmoothedSequence};
use wayfix::likelihood::LogLikelihoodFn;
use wayfix::{Belief, Hmm, Prior, canberra};

use crate::kit::{all_close, close, rng, same_results, still};

/// Drives of 0 to 36 steps, in several chunks; every 50th has a symbol that does not exist.
fn drives() -> Vec<Vec<usize>> {
    let hmm = canberra::hmm(5, 1.0).unwrap();
    let mut rng = rng(7);
    let drive = |k: usize| match k % 50 {
        20 => vec![4, 999, 4],
        _ => hmm.simulate(k * 31 % 37, &mut rng).observations().to_vec(),
    };
    (0..700).map(drive).collect()
}

/// Runs the same work in pools of one thread and of three, and outside of a pool.
fn on_threads<R: Send>(work: impl Fn() -> R + Send + Sync) -> Vec<R> {
    #[cfg(feature = "rayon")]
    {
        let pooled = [1, 3].map(|threads| crate::threads::with_threads(threads, &work));
        pooled.into_iter().chain([work()]).collect()
    }
    #[cfg(not(feature = "rayon"))]
    vec![work()]
}

#[test]
fn results_are_those_of_each() {
    let (hmm, drives) = (canberra::hmm(5, 1.0).unwrap(), drives());
    let near = |found: &SmoothedSequence, expected: &SmoothedSequence| {
        let [a, b] = [found, expected].map(|smoothed| smoothed.posteriors().as_slice());
        all_close(a, b, 1e-12, 1e-288).is_ok()
            && close(found.log_likelihood(), expected.log_likelihood(), 1e-12, 1.0).is_ok()
    };
    let smoothed = on_threads(|| hmm.smooth_all(&drives));
    for found in &smoothed {
        assert_eq!(found.iter().filter(|result| result.is_err()).count(), 14);
        same_results(found, drives.len(), |i| hmm.smooth(&drives[i]), near).unwrap();
        // To the bit, on any number of threads.
        let first = |i: usize| smoothed[0][i].clone().map_err(|error| error.source);
        same_results(found, drives.len(), first, PartialEq::eq).unwrap();
    }
    let near_log = |a: &f64, b: &f64| close(*a, *b, 1e-12, 1.0).is_ok();
    on_threads(|| {
        let found = hmm.log_likelihood_all(&drives);
        same_results(&found, drives.len(), |i| hmm.log_likelihood(&drives[i]), near_log).unwrap();
        let found = hmm.viterbi_all(&drives);
        same_results(&found, drives.len(), |i| hmm.viterbi(&drives[i]), PartialEq::eq).unwrap();
        let found = hmm.forward_all(&drives);
        let near = |a: &FilteredSequence, b: &FilteredSequence| {
            all_close(a.posteriors().as_slice(), b.posteriors().as_slice(), 1e-12, 1e-288).is_ok()
                && all_close(a.log_likelihoods(), b.log_likelihoods(), 1e-12, 1.0).is_ok()
        };
        same_results(&found, drives.len(), |i| hmm.forward(&drives[i]), near).unwrap();
        assert!(hmm.viterbi_all(&drives[..0]).is_empty());
    });
}

/// A panic of a sensor reaches the caller, without a deadlock.
#[test]
fn panics_are_passed_on() {
    let sensor = LogLikelihoodFn::new(9, |y: &f64, _| {
        assert!(*y < 1.0, "the sensor panics");
        0.0
    });
    let prior = Prior::AtFirstObservation(Belief::uniform(9).unwrap());
    let hmm = Hmm::new(prior, still(9), sensor).unwrap();
    let drives: Vec<_> = (0..1000).map(|k| [if k == 300 { 2.0 } else { 0.0 }; 3]).collect();
    let text = catch_unwind(AssertUnwindSafe(|| hmm.log_likelihood_all(&drives)))
        .unwrap_err()
        .downcast::<&str>()
        .map(|text| text.to_string());
    assert_eq!(text.unwrap(), "the sensor panics");
}
