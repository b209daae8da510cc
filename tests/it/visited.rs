//! Results of many sequences, passed to a visitor: in order, for any number, without keeping them.

use std::cell::Cell;
use std::ops::ControlFlow;
use std::panic::{AssertUnwindSafe, catch_unwind};

use wayfix::inference::SmoothedSequence;
use wayfix::likelihood::LogLikelihoodFn;
use wayfix::{Belief, Hmm, Prior, canberra};

use crate::kit::{all_close, close, rng, same_results, still, visited};

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
fn results_are_those_of_each_and_of_all() {
    let (hmm, drives) = (canberra::hmm(5, 1.0).unwrap(), drives());
    let near = |found: &SmoothedSequence, expected: &SmoothedSequence| {
        let [a, b] = [found, expected].map(|smoothed| smoothed.posteriors().as_slice());
        all_close(a, b, 1e-12, 1e-288).is_ok()
            && close(found.log_likelihood(), expected.log_likelihood(), 1e-12, 1.0).is_ok()
    };
    let smooth = || {
        let owned = visited(|visit| hmm.smooth_map_all(drives.iter().cloned(), visit));
        same_results(&owned, drives.len(), |i| hmm.smooth(&drives[i]), near).unwrap();
        assert_eq!(owned.iter().filter(|result| result.is_err()).count(), 14);
        owned
    };
    for found in on_threads(smooth) {
        let borrowed = visited(|visit| hmm.smooth_map_all(&drives, visit));
        same_results(
            &found,
            drives.len(),
            |i| borrowed[i].clone().map_err(|e| e.source),
            PartialEq::eq,
        )
        .unwrap();
    }
    same_results(&hmm.smooth_all(&drives), drives.len(), |i| hmm.smooth(&drives[i]), near).unwrap();
    let near_log = |a: &f64, b: &f64| close(*a, *b, 1e-12, 1.0).is_ok();
    on_threads(|| {
        let found = visited(|visit| hmm.log_likelihood_map_all(&drives, visit));
        same_results(&found, drives.len(), |i| hmm.log_likelihood(&drives[i]), near_log).unwrap();
        let found = visited(|visit| hmm.viterbi_map_all(&drives, visit));
        same_results(&found, drives.len(), |i| hmm.viterbi(&drives[i]), PartialEq::eq).unwrap();
        let found = visited(|visit| hmm.forward_map_all(&drives, visit));
        let near = |a: &wayfix::inference::FilteredSequence,
                    b: &wayfix::inference::FilteredSequence| {
            all_close(a.posteriors().as_slice(), b.posteriors().as_slice(), 1e-12, 1e-288).is_ok()
                && all_close(a.log_likelihoods(), b.log_likelihoods(), 1e-12, 1.0).is_ok()
        };
        same_results(&found, drives.len(), |i| hmm.forward(&drives[i]), near).unwrap();
    });
}

/// Memory is reused only if no one has kept the result in it.
#[test]
fn a_result_that_is_kept_stays_as_it_is() {
    let hmm = canberra::hmm(5, 1.0).unwrap();
    let drives: Vec<_> = drives().into_iter().filter(|drive| !drive.contains(&999)).collect();
    on_threads(|| {
        let mut kept = Vec::new();
        let flow = hmm.smooth_map_all(drives.iter().cycle().take(3000), |index, smoothed| {
            let smoothed = smoothed.unwrap();
            if index % 173 == 5 {
                kept.push((index, smoothed.clone(), smoothed));
            }
            ControlFlow::<()>::Continue(())
        });
        assert!(flow.is_continue());
        assert_eq!(kept.len(), 18);
        for (index, copy, smoothed) in kept {
            assert_eq!(smoothed, copy);
            let expected = hmm.smooth(&drives[index % drives.len()]).unwrap();
            let [a, b] = [&smoothed, &expected].map(|s| s.posteriors().as_slice());
            all_close(a, b, 1e-12, 1e-288).unwrap();
        }
    });
}

/// An endless source is read a few chunks ahead, and not further.
#[test]
fn a_visitor_stops() {
    let (hmm, small) = (canberra::hmm(5, 1.0).unwrap(), canberra::hmm(5, 1.0).unwrap());
    on_threads(|| {
        let (taken, mut seen) = (Cell::new(0_usize), 0);
        let source = std::iter::repeat_with(|| taken.replace(taken.get() + 1)).map(|_| vec![4, 5]);
        let flow = hmm.forward_map_all(source, |index, result| {
            assert!(result.is_ok());
            seen += 1;
            if index == 1000 { ControlFlow::Break("enough") } else { ControlFlow::Continue(()) }
        });
        assert_eq!((flow, seen), (ControlFlow::Break("enough"), 1001));
        #[cfg(feature = "rayon")]
        let threads = rayon::current_num_threads();
        #[cfg(not(feature = "rayon"))]
        let threads = 1;
        assert!(taken.get() <= 1001 + 64 * (4 * threads + 1), "{}", taken.get());

        let none = small.viterbi_map_all(Vec::<Vec<usize>>::new(), |_, _| ControlFlow::Break(()));
        assert_eq!(none, ControlFlow::Continue(()));
    });
}

/// A panic of a sensor or of the visitor reaches the caller, without a deadlock.
#[test]
fn panics_are_passed_on() {
    let sensor = LogLikelihoodFn::new(9, |y: &f64, _| {
        assert!(*y < 1.0, "the sensor panics");
        0.0
    });
    let prior = Prior::AtFirstObservation(Belief::uniform(9).unwrap());
    let hmm = Hmm::new(prior, still(9), sensor).unwrap();
    // One of them panics at a sequence: if both did, either could be first.
    let run = |bad_sensor: usize, bad_visitor: usize| {
        let seen = |k: usize| vec![if k == bad_sensor { 2.0 } else { 0.0 }; 3];
        catch_unwind(AssertUnwindSafe(|| {
            hmm.log_likelihood_map_all((0..1000).map(seen), |index, _| {
                assert!(index != bad_visitor, "the visitor panics");
                ControlFlow::<()>::Continue(())
            })
        }))
        .unwrap_err()
        .downcast::<&str>()
        .map(|text| text.to_string())
        .unwrap()
    };
    assert_eq!(run(300, 1000), "the sensor panics");
    assert_eq!(run(1000, 10), "the visitor panics");
}
