//! Most probable paths.

use wayfix::inference::ViterbiPath;
use wayfix::{Hmm, TransitionEntries};

use super::{Drive, close, expect};
use crate::counts::Counts;
use crate::draw::Draw;
use crate::model::{Observation, Sensor};
use crate::reference::Chain;

pub(super) fn check<A: TransitionEntries, S: Drive<A>>(
    draw: &mut Draw<'_>,
    hmm: &Hmm<A, Sensor>,
    sequence: &S,
    chain: &Chain,
    counts: &mut Counts,
) {
    let count = draw.below(6);
    let best = chain.best(chain.len(), count.max(1));
    if let Some(path) = expect("viterbi", hmm.viterbi(sequence), chain, counts) {
        legal("viterbi", &path, chain);
        close::log("viterbi", path.log_probability(), best[0], chain.size());
        counts.add("paths decoded");
    }
    if let Some(paths) = expect("k_best", hmm.k_best(sequence, count), chain, counts) {
        assert_eq!(paths.len(), best.len().min(count), "number of best paths");
        for (at, (path, best)) in paths.iter().zip(&best).enumerate() {
            legal("k_best", path, chain);
            close::log("k_best", path.log_probability(), *best, chain.size());
            let again = paths[..at].iter().any(|other| other.states() == path.states());
            assert!(!again, "a path twice among the best");
        }
        counts.add("lists of best paths");
    }
}

/// Checks that the model allows a path, and that it is as probable as stated.
pub(super) fn legal(what: &str, path: &ViterbiPath, chain: &Chain) {
    assert_eq!(path.states().len(), chain.len(), "{what}");
    let log = if chain.len() == 0 { 0.0 } else { chain.log_probability(path.states()) };
    assert!(log > f64::NEG_INFINITY, "{what}: a path that is not possible");
    close::log(what, path.log_probability(), log, chain.size());
}

pub(super) fn online<A: TransitionEntries>(
    hmm: &Hmm<A, Sensor>,
    controls: &[A::Control],
    drive: &[Observation],
    chain: &Chain,
    counts: &mut Counts,
) {
    let (mut decoder, mut path) = (hmm.online_viterbi(), Vec::new());
    for (step, (control, observation)) in (1..).zip(controls.iter().zip(drive)) {
        if step > chain.len() {
            let undecided = decoder.undecided();
            let committed = decoder.step_with(control, observation).map(|_| ());
            assert!(expect("online_viterbi", committed, chain, counts).is_none());
            assert_eq!(decoder.undecided(), undecided, "the decoder after an error");
            break;
        }
        path.extend_from_slice(decoder.step_with(control, observation).expect("a possible step"));
    }
    path.extend(decoder.undecided());
    assert_eq!((path.len(), decoder.steps()), (chain.len(), chain.len()));
    if chain.len() > 0 {
        let best = chain.best(chain.len(), 1)[0];
        close::log("online_viterbi", decoder.log_probability(), best, chain.size());
        close::log("online_viterbi, path", chain.log_probability(&path), best, chain.size());
    }
    counts.add("paths decoded online");
}
