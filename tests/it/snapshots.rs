//! States of streams, and those of filters as bytes: they come back to the bit, and damage is
//! detected.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::inference::FilterSnapshot;
use wayfix::{Belief, Hmm, HmmError, LikelihoodVector, Prior, SparseTransition};

use crate::kit::{Kind, cases, models};

/// The checksum of the format.
fn checksum(bytes: &[u8]) -> u64 {
    let mut padded = bytes.to_vec();
    padded.resize((bytes.len() / 8 + 1) * 8, 0);
    let words = padded.as_chunks::<8>().0.iter().map(|word| u64::from_le_bytes(*word));
    words.fold(bytes.len() as u64, |sum, word| {
        (sum ^ word).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29)
    })
}

/// Bytes with their right checksum.
fn sealed(mut bytes: Vec<u8>) -> Vec<u8> {
    bytes.extend(checksum(&bytes).to_le_bytes());
    bytes
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn states_come_back_to_the_bit(model in models(Kind::Extreme)) {
        let hmm = model.hmm(model.sparse());
        let mut filter = hmm.filter();
        let mut kept = filter.snapshot();
        for k in 0..model.steps() {
            let bytes = filter.snapshot().to_bytes();
            let state = FilterSnapshot::from_bytes(&bytes).unwrap();
            prop_assert_eq!(&state, &filter.snapshot());
            prop_assert_eq!(&state.to_bytes(), &bytes);
            // Into a stream with another state.
            filter.snapshot_to(&mut kept);
            prop_assert_eq!(&kept, &state);
            let (n, p) = (hmm.states(), state.belief().as_slice());
            let possible = p.iter().filter(|p| **p > 0.0).count();
            // Without logarithms: header, two counts, a sum, lengths, mask and checksum.
            let has_logs = bytes.len() > 8 + 2 * 8 + 16 + 2 * 8 + 8 * n.div_ceil(64) + 8 * possible + 8;
            prop_assert_eq!(state.heap_bytes(), 8 * n * if has_logs { 2 } else { 1 });
            if filter.step_with(&k, &model.logs[k]).is_err() {
                break;
            }
        }
    }

    /// A decoder that continues from a snapshot commits the same states, to the end.
    #[test]
    fn a_decoder_goes_on_as_if_it_had_never_stopped(
        model in models(Kind::Extreme),
        stop in 0..7_usize,
    ) {
        let hmm = model.hmm(model.sparse());
        let (mut decoder, mut other) = (hmm.online_viterbi(), hmm.online_viterbi());
        let mut path = Vec::new();
        for k in 0..model.steps() {
            if k >= stop {
                let snapshot = decoder.snapshot();
                prop_assert_eq!(snapshot.steps(), k);
                if k == stop {
                    other.restore(&snapshot).unwrap();
                }
                prop_assert_eq!(other.snapshot(), snapshot);
                prop_assert_eq!(other.undecided(), decoder.undecided());
            } else {
                // (It has another state until then.)
                let _ = other.predict_with(&k);
            }
            let step = decoder.step_with(&k, &model.logs[k]).map(<[usize]>::to_vec);
            if k >= stop {
                let found = other.step_with(&k, &model.logs[k]).map(<[usize]>::to_vec);
                prop_assert_eq!(format!("{found:?}"), format!("{step:?}"));
                let logs = [&other, &decoder].map(|decoder| decoder.log_probability().to_bits());
                prop_assert_eq!(logs[0], logs[1]);
                prop_assert_eq!(decoder.snapshot().log_probability().to_bits(), logs[0]);
            }
            let Ok(step) = step else { return Ok(()) };
            path.extend(step);
        }
        path.extend(if stop < model.steps() { other.undecided() } else { decoder.undecided() });
        let batch = hmm.viterbi(&model).unwrap();
        prop_assert_eq!(path, batch.states());
    }

    /// Damaged bytes are an error or a state that a stream can continue from, even if the checksum
    /// is that of the damaged bytes, as if they were written so.
    #[test]
    fn damaged_bytes_are_refused_or_work(
        model in models(Kind::Extreme),
        changes in vec((any::<prop::sample::Index>(), any::<u8>(), any::<bool>()), 1..4),
        cut in prop_oneof![3 => Just(None), 1 => any::<prop::sample::Index>().prop_map(Some)],
        special in prop_oneof![2 => Just(None), 1 => prop::sample::select(vec![
            0, 1, u64::MAX, 1 << 63, 1 << 40, f64::NAN.to_bits(), f64::INFINITY.to_bits(), 1,
            (-1.0_f64).to_bits(), 1e300_f64.to_bits(), 1.0_f64.to_bits(), (1 << 53) + 1, 1 << 53,
        ]).prop_map(Some)],
    ) {
        let hmm = model.hmm(model.sparse());
        let mut filter = hmm.filter();
        for k in 0..=model.steps() {
            let bytes = filter.snapshot().to_bytes();
            let mut damaged = bytes.clone();
            for (at, with, add) in &changes {
                let at = at.index(damaged.len());
                if *add { damaged.insert(at, *with) } else { damaged[at] ^= with }
            }
            if let Some(cut) = cut {
                damaged.truncate(cut.index(damaged.len()));
            }
            // A number of eight bytes is replaced.
            let mut replaced = bytes[..bytes.len() - 8].to_vec();
            if let Some(special) = special {
                let at = 8 + changes[0].0.index(replaced.len() / 8 - 1) * 8;
                replaced[at..at + 8].copy_from_slice(&special.to_le_bytes());
            }
            let resealed = damaged[..damaged.len().saturating_sub(8)].to_vec();
            for (sealed, damaged) in
                [(false, damaged), (true, sealed(resealed)), (true, sealed(replaced))]
            {
                let sealed = sealed || damaged == bytes;
                if let Ok(state) = FilterSnapshot::from_bytes(&damaged) {
                    prop_assert!(sealed);
                    let mut other = hmm.filter();
                    if other.restore(&state).is_ok() {
                        let _ = other.step_with(&0, &model.logs.first().cloned().flatten());
                        check(other.belief().as_slice())?;
                        prop_assert!(!other.log_likelihood().is_nan());
                    }
                }
            }
            let Some(y) = model.logs.get(k) else { break };
            if filter.step_with(&k, y).is_err() {
                break;
            }
        }
    }
}

fn check(belief: &[f64]) -> Result<(), TestCaseError> {
    let sum: f64 = belief.iter().sum();
    prop_assert!((sum - 1.0).abs() < 1e-6 && belief.iter().all(|p| *p >= 0.0), "{belief:?}");
    Ok(())
}

fn ring(n: usize) -> Hmm<SparseTransition, LikelihoodVector> {
    let moves = (0..n).flat_map(|j| [(j, j, 0.25), ((j + 1) % n, j, 0.75)]);
    let motion = SparseTransition::from_triplets(n, moves).unwrap();
    let prior = Prior::AtFirstObservation(Belief::certain(n, 10).unwrap());
    Hmm::new(prior, motion, LikelihoodVector::linear(n)).unwrap()
}

/// Bytes that were written by any earlier build are read: the format is fixed.
#[test]
fn bytes_are_those_of_version_1() {
    let hmm = ring(70);
    let mut filter = hmm.filter();
    (0..2).for_each(|_| _ = filter.step(&[0.5; 70][..]).unwrap());
    // From state 10 the second step leads to 10 or 11.
    let mut expected = b"wayfix\x01\x01".to_vec();
    let log_likelihood = filter.log_likelihood();
    let words = [
        2,
        0,
        log_likelihood.to_bits(),
        0.0_f64.to_bits(), // steps, those in logarithms, sum
        70,
        1 << 10 | 1 << 11,
        0,
        0.25_f64.to_bits(),
        0.75_f64.to_bits(), // the belief
        0,                  // no logarithms
    ];
    words.iter().for_each(|word: &u64| expected.extend(word.to_le_bytes()));
    assert_eq!(filter.snapshot().to_bytes(), sealed(expected));
}

#[test]
fn states_that_are_ruled_out_take_a_bit() {
    let n = 8930;
    let hmm = ring(n);
    let mut filter = hmm.filter();
    (0..3).for_each(|_| _ = filter.step(&vec![0.5; n][..]).unwrap());
    // Three states, a bit for each, four numbers of steps and sums, two lengths, and the
    // ends.
    let expected = 8 * (3 + n.div_ceil(64) + 4 + 2 + 2);
    assert_eq!(filter.snapshot().to_bytes().len(), expected);
}

#[test]
fn bytes_of_something_else_say_what_they_are() {
    let hmm = ring(20);
    let mut filter = hmm.filter();
    filter.step(&[0.5; 20]).unwrap();
    let bytes = filter.snapshot().to_bytes();
    let refused = |bytes: &[u8], expected: &str| {
        let error = FilterSnapshot::from_bytes(bytes).unwrap_err().to_string();
        assert_eq!(error, format!("not a valid snapshot: {expected}"));
    };
    refused(b"", "it ends after 0 bytes, expected at least 16");
    refused(b"wayf", "it ends after 4 bytes, expected at least 16");
    refused(b"{}", "its bytes do not begin with the header of one");
    refused(b"a long text that is no snapshot", "its bytes do not begin with the header of one");
    let changed = |at: usize, to: u8| {
        let mut changed = bytes.clone();
        changed[at] = to;
        changed
    };
    refused(&changed(6, 5), "its bytes are of kind 5, expected 1, a filter");
    refused(&changed(6, 99), "its bytes are of kind 99, expected 1, a filter");
    refused(&changed(7, 2), "its bytes are of version 2, expected 1");
    for damaged in [&changed(40, 5)[..], &bytes[..bytes.len() - 1]] {
        let error = FilterSnapshot::from_bytes(damaged).unwrap_err().to_string();
        assert!(error.starts_with("not a valid snapshot: its checksum is 0x"), "{error}");
    }
    let within = &bytes[..bytes.len() - 8];
    let expected =
        format!("it ends after {} bytes, expected at least {}", bytes.len() - 8, bytes.len());
    refused(&sealed(within[..within.len() - 8].to_vec()), &expected);
    refused(&sealed([within, &[0; 3]].concat()), "3 bytes follow it, expected 0");
    // A length beyond any memory.
    let mut long = within.to_vec();
    long[40..48].copy_from_slice(&(1_u64 << 60).to_le_bytes());
    let error = FilterSnapshot::from_bytes(&sealed(long)).unwrap_err().to_string();
    assert!(error.starts_with("not a valid snapshot: it ends after"), "{error}");
}

#[test]
fn a_decoder_of_another_model_is_refused() {
    let mut decoder = ring(20).online_viterbi().snapshot();
    let hmm = ring(21);
    let mut other = hmm.online_viterbi();
    other.predict().unwrap();
    let before = other.snapshot();
    let error = other.restore(&decoder).unwrap_err();
    assert!(matches!(error, HmmError::StateCount { found: 20, expected: 21, .. }));
    assert_eq!(other.snapshot(), before);
    decoder = before.clone();
    other.restart();
    other.restore(&decoder).unwrap();
    assert_eq!(other.snapshot(), before);
}
