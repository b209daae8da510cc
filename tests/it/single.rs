//! Sparse matrices with values of 32 bits: properties of their rounding, all routines, which take
//! them as doubles, and distances of beliefs from those of the exact matrix.

use proptest::collection::{btree_map, vec};
use proptest::prelude::*;
use wayfix::inference::LearningOptions;
use wayfix::{
    Belief, Fixed, Hmm, InferenceError, LikelihoodVector, Prior, SparseTransition, Transition,
    TransitionEntries, canberra,
};

use crate::kit::{bits, cases_of, rng};

type Triplets = Vec<(usize, usize, f64)>;

/// Columns of up to ten entries, of various sizes, equal, or so far apart that small ones are lost
/// in 32 bits.
fn triplets(spread: i32) -> impl Strategy<Value = (usize, Triplets)> {
    (1..40_usize).prop_flat_map(move |n| {
        let weight = prop_oneof![
            3 => 0.01..1.0,
            1 => Just(1.0),
            2 => (-spread..=0, 1.0..2.0).prop_map(|(e, m)| m * 2_f64.powi(e)),
        ];
        let column = btree_map(0..n, weight, 1..=10.min(n));
        vec(column, n).prop_map(move |columns| {
            let mut triplets = Triplets::new();
            for (from, column) in columns.into_iter().enumerate() {
                let sum: f64 = column.values().sum();
                let entries = column.into_iter().map(|(to, w)| (to, from, w / sum));
                triplets.extend(entries.filter(|entry| entry.2 > 0.0));
            }
            (n, triplets)
        })
    })
}

/// The entries, column by column.
fn entries(a: &SparseTransition) -> Triplets {
    let columns = (0..a.states()).map(|from| (from, a.outgoing(&(), from)));
    columns.flat_map(|(from, column)| column.map(move |(to, p)| (to, from, p))).collect()
}

/// Errors as their text.
fn told<R>(result: Result<R, InferenceError>) -> Result<R, String> {
    result.map_err(|error| error.to_string())
}

/// Checks the properties of any rounding.
fn check_rounding(exact: &SparseTransition) -> Result<(), TestCaseError> {
    let single = exact.clone().with_single_values();
    prop_assert_eq!(exact.rounding(), 0.0);
    let (before, after) = (entries(exact), entries(&single));
    prop_assert_eq!(before.len(), after.len());
    let (mut largest, mut least) = (0.0_f64, 1.0_f64);
    for (&(to, from, p), &(after_to, after_from, v)) in before.iter().zip(&after) {
        prop_assert_eq!((to, from), (after_to, after_from));
        prop_assert!(v > 0.0 && f64::from(v as f32) == v);
        prop_assert!((v - p).abs() < 1e-7, "{} became {}", p, v);
        prop_assert_eq!(v.to_bits(), single.get(to, from).to_bits());
        largest = largest.max((v / p - 1.0).abs());
        least = least.min(p);
    }
    prop_assert_eq!(single.rounding(), largest);
    prop_assert!(largest <= 1e-7 / least);
    for column in after.chunk_by(|a, b| a.1 == b.1) {
        // In steps of 2^-110, all values are whole numbers.
        let step = 2_f64.powi(-110);
        let whole = |v: f64| (v / step) as i128;
        prop_assert!(column.iter().all(|entry| whole(entry.2) as f64 * step == entry.2));
        prop_assert_eq!(column.iter().map(|entry| whole(entry.2)).sum::<i128>(), 1 << 110);
    }
    for to in 0..single.states() {
        for (from, v) in single.incoming(&(), to) {
            prop_assert_eq!(v.to_bits(), single.get(to, from).to_bits());
        }
    }
    let again = single.clone().with_single_values();
    prop_assert_eq!(entries(&again), after.clone());
    prop_assert_eq!(again.rounding(), single.rounding());
    // Rounding again changes nothing, except entries that are raised to 2^-60.
    if after.iter().any(|entry| entry.2 < 2_f64.powi(-60)) {
        return Ok(());
    }
    let same = SparseTransition::from_triplets_single(single.states(), after.clone()).unwrap();
    prop_assert_eq!(entries(&same), after);
    prop_assert_eq!(same.rounding(), 0.0);
    Ok(())
}

/// A model with this matrix and given likelihoods.
fn hmm(a: SparseTransition) -> Hmm<SparseTransition, LikelihoodVector> {
    let n = a.states();
    let prior = Prior::BeforeFirstTransition(Belief::uniform(n).unwrap());
    Hmm::new(prior, a, LikelihoodVector::linear(n)).unwrap()
}

/// Checks that a belief and a log-likelihood are within their bounds, up to rounding in doubles.
fn within(
    e: f64,
    steps: usize,
    exact: (&[f64], f64),
    rounded: (&[f64], f64),
) -> Result<(), TestCaseError> {
    let factor = ((1.0 + e) / (1.0 - e)).powi(i32::try_from(steps).unwrap()) + 1e-13;
    for (&p, &q) in exact.0.iter().zip(rounded.0) {
        prop_assert_eq!(p == 0.0, q == 0.0);
        prop_assert!(q <= p * factor && p <= q * factor, "{} became {}, {}", p, q, factor);
    }
    let most = -(steps as f64) * (1.0 - e).ln();
    prop_assert!((exact.1 - rounded.1).abs() <= most + 1e-13 * (1.0 + exact.1.abs()));
    Ok(())
}

proptest! {
    #![proptest_config(cases_of(300))]

    #[test]
    fn columns_sum_to_one_and_no_value_changes_much(
        (n, triplets) in prop_oneof![triplets(3), triplets(60), triplets(1000)],
    ) {
        check_rounding(&SparseTransition::from_triplets(n, triplets).unwrap())?;
    }

    /// Columns whose sums are only about one.
    #[test]
    fn sums_become_one((n, mut triplets) in triplets(20), off in -9e-10..9e-10) {
        triplets.iter_mut().for_each(|entry| entry.2 *= 1.0 + off);
        let exact = SparseTransition::from_triplets(n, triplets.iter().copied()).unwrap();
        check_rounding(&exact)?;
        let (single, direct) = (
            exact.with_single_values(),
            SparseTransition::from_triplets_single(n, triplets).unwrap(),
        );
        prop_assert_eq!(entries(&single), entries(&direct));
        prop_assert_eq!(single.rounding(), direct.rounding());
    }

    /// All routines give the same as with these values in 64 bits.
    #[test]
    fn they_are_taken_as_doubles(
        (n, triplets) in prop_oneof![triplets(3), triplets(1000)],
        seen in vec(vec(prop_oneof![1 => Just(0.0), 4 => 0.01..1.0, 1 => Just(1e-300)], 40), 1..6),
    ) {
        let single = SparseTransition::from_triplets_single(n, triplets).unwrap();
        let double = SparseTransition::from_triplets(n, entries(&single)).unwrap();
        let x = &seen[0][..n];
        let products = |a: &SparseTransition| {
            let (mut out, mut from) = (vec![vec![f64::NAN; n]; 5], vec![0; n]);
            a.apply(&(), x, &mut out[0]);
            a.apply_transpose(&(), x, &mut out[1]);
            a.apply_log(&(), x, &mut out[2]);
            a.apply_transpose_log(&(), x, &mut out[3]);
            a.max_product(&(), x, &mut out[4], &mut from);
            (out.iter().map(|out| bits(out)).collect::<Vec<_>>(), from)
        };
        prop_assert_eq!(products(&single), products(&double));
        let ys: Vec<Vec<f64>> = seen.iter().map(|b| b[..n].to_vec()).collect();
        let (single, double) = (hmm(single), hmm(double));
        let (mut a, mut b) = (single.filter(), double.filter());
        for y in &ys {
            prop_assert_eq!(a.step(y).is_ok(), b.step(y).is_ok());
            prop_assert_eq!(a.snapshot(), b.snapshot());
        }
        prop_assert_eq!(told(single.forward(&ys[..])), told(double.forward(&ys[..])));
        prop_assert_eq!(told(single.smooth(&ys[..])), told(double.smooth(&ys[..])));
        prop_assert_eq!(told(single.viterbi(&ys[..])), told(double.viterbi(&ys[..])));
        prop_assert_eq!(told(single.log_likelihood(&ys[..])), told(double.log_likelihood(&ys[..])));
        prop_assert_eq!(told(single.k_best(&ys[..], 3)), told(double.k_best(&ys[..], 3)));
    }

    /// Many sequences are the same as one by one.
    #[test]
    fn many_sequences((n, triplets) in triplets(3), seen in vec(vec(0.01..1.0, 40), 12)) {
        let ys: Vec<Vec<f64>> = seen.iter().map(|b| b[..n].to_vec()).collect();
        let drives: Vec<&[Vec<f64>]> = ys.chunks(2).collect();
        let model = hmm(SparseTransition::from_triplets_single(n, triplets).unwrap());
        for (drive, smoothing) in drives.iter().zip(model.smooth_all(&drives)) {
            prop_assert_eq!(smoothing.unwrap(), model.smooth(drive).unwrap());
        }
        for (drive, path) in drives.iter().zip(model.viterbi_all(&drives)) {
            prop_assert_eq!(path.unwrap(), model.viterbi(drive).unwrap());
        }
    }

    #[test]
    fn beliefs_are_as_near_as_is_said(
        (n, triplets) in prop_oneof![triplets(3), triplets(14)],
        seen in vec(vec(prop_oneof![1 => Just(0.0), 4 => 0.001..1.0], 40), 1..30),
    ) {
        let exact = SparseTransition::from_triplets(n, triplets).unwrap();
        let rounded = exact.clone().with_single_values();
        let e = rounded.rounding();
        prop_assert!(e < 0.1, "{}", e);
        let (exact, rounded) = (hmm(exact), hmm(rounded));
        let (mut p, mut q) = (exact.filter(), rounded.filter());
        let mut ys: Vec<Vec<f64>> = Vec::new();
        for b in &seen {
            let y = b[..n].to_vec();
            prop_assert_eq!(p.step(&y).is_ok(), q.step(&y).is_ok());
            if p.steps() == ys.len() {
                break;
            }
            ys.push(y);
            let known = (p.belief().as_slice(), p.log_likelihood());
            within(e, ys.len(), known, (q.belief().as_slice(), q.log_likelihood()))?;
        }
        let (p, q) = (exact.smooth(&ys[..]).unwrap(), rounded.smooth(&ys[..]).unwrap());
        for k in 0..=ys.len() {
            let (p, q) = (p.posteriors().get(k).unwrap(), q.posteriors().get(k).unwrap());
            within(e, ys.len(), (p.as_slice(), 0.0), (q.as_slice(), 0.0))?;
        }
        // The path that is found, and the best one, both in the exact model.
        if !ys.is_empty() {
            let best = exact.viterbi(&ys[..]).unwrap();
            let found = rounded.viterbi(&ys[..]).unwrap();
            let mut log = 0.0;
            for (k, y) in ys.iter().enumerate() {
                let to = found.states()[k];
                let p = if k == 0 {
                    let from_all = exact.transition().incoming(&(), to);
                    from_all.map(|entry| entry.1 / n as f64).sum::<f64>()
                } else {
                    exact.transition().get(to, found.states()[k - 1])
                };
                log += (p * y[to]).ln();
            }
            let least = ys.len() as f64 * ((1.0 - e) / (1.0 + e)).ln();
            let lost = log - best.log_probability();
            prop_assert!(lost >= least - 1e-11, "{} of {}", lost, least);
        }
    }
}

/// A drive of a thousand steps on a real map.
#[test]
fn canberra_is_kept_to_a_millionth() {
    let exact = canberra::hmm(5, 1.0).unwrap();
    let rounded = exact.transition().clone().with_single_values();
    let e = rounded.rounding();
    assert!(e > 1e-8 && e < 1e-6, "{e}");
    let rounded = Hmm::new(exact.prior().clone(), rounded, exact.likelihood().clone())
        .unwrap()
        .with_rounded_tails();
    let drive = exact.simulate(1000, &mut rng(1));
    let (mut p, mut q) = (exact.filter(), rounded.filter());
    let mut changed = 0.0_f64;
    for (k, y) in drive.observations().iter().enumerate() {
        p.step(y).unwrap();
        q.step(y).unwrap();
        let known = (p.belief().as_slice(), p.log_likelihood());
        within(e, k + 1, known, (q.belief().as_slice(), q.log_likelihood())).unwrap();
        let pairs = known.0.iter().zip(q.belief().as_slice());
        changed = pairs.map(|(p, q)| (p - q).abs()).fold(changed, f64::max);
    }
    assert!(changed > 0.0, "beliefs do change");
    assert_eq!(
        exact.viterbi(drive.observations()).unwrap().states(),
        rounded.viterbi(drive.observations()).unwrap().states()
    );
}

#[test]
fn what_32_bits_hold_stays() {
    let cases: [&[f64]; 4] =
        [&[1.0], &[0.5, 0.5], &[0.25, 0.625, 0.125], &[0.999_999_94, 5.960_464_5e-8]];
    for case in cases {
        let values: Vec<f64> = case.iter().map(|&p| f64::from(p as f32)).collect();
        let n = values.len();
        let triplets = |from: usize| values.iter().enumerate().map(move |(to, &p)| (to, from, p));
        let exact = SparseTransition::from_triplets(n, (0..n).flat_map(triplets)).unwrap();
        let single = exact.clone().with_single_values();
        assert_eq!(single.rounding(), 0.0, "{values:?}");
        assert_eq!(entries(&single), entries(&exact));
    }
    // Three equal entries can't stay equal.
    let third = (0..9).map(|at| (at % 3, at / 3, 1.0 / 3.0));
    let single = SparseTransition::from_triplets_single(3, third).unwrap();
    let step = 2_f64.powi(-25);
    let up = f64::from(1.0_f32 / 3.0);
    assert_eq!([0, 1, 2].map(|to| single.get(to, 1)), [up, up - step, up]);
    assert!(up + up + (up - step) == 1.0);
}

/// An entry that is small beside the others gets at least one step of the grid.
#[test]
fn nothing_becomes_zero() {
    let step = 2_f64.powi(-24);
    let one = 1.0 - step;
    for (ways, expected) in [
        (vec![1.0 - 1e-9, 1e-9], vec![one, step]),
        (vec![1.0, 1e-300], vec![one, step]),
        (vec![5e-324, 1.0], vec![step, one]),
        (vec![1e-30, 1.0, 1e-30], vec![step / 2.0, one, step / 2.0]),
    ] {
        let n = ways.len();
        let triplets =
            |from| ways.iter().enumerate().map(move |(to, &p): (usize, &f64)| (to, from, p));
        let single = SparseTransition::from_triplets_single(n, (0..n).flat_map(triplets)).unwrap();
        for from in 0..n {
            let found: Vec<f64> = (0..n).map(|to| single.get(to, from)).collect();
            assert_eq!(found, expected, "{ways:?}");
        }
        let least = ways.iter().copied().fold(1.0, f64::min);
        assert_eq!(single.rounding(), step * if n == 3 { 0.5 } else { 1.0 } / least - 1.0);
    }
}

#[test]
fn errors_are_those_of_triplets() {
    let refused = SparseTransition::from_triplets_single(2, [(0, 0, 1.0), (1, 1, 0.5)]);
    let text = refused.unwrap_err().to_string();
    assert_eq!(text, "column 1 (the transitions out of state 1) sums to 0.5, expected 1");
}

/// Learned values have 64 bits.
#[test]
fn what_is_learned_is_not_rounded() {
    let a = SparseTransition::from_triplets_single(2, [(0, 0, 0.7), (1, 0, 0.3), (0, 1, 1.0)]);
    let sensor = Fixed(LikelihoodVector::linear(2).owned());
    let prior = Prior::BeforeFirstTransition(Belief::uniform(2).unwrap());
    let model = Hmm::new(prior, a.unwrap(), sensor).unwrap();
    assert!(model.transition().rounding() > 0.0);
    let ys = [vec![0.9, 0.1], vec![0.4, 0.6], vec![0.7, 0.3]];
    let drives = [&ys[..]];
    let learned = model.learn(&drives, &LearningOptions::default()).unwrap();
    let a = learned.model().transition();
    assert_eq!(a.rounding(), 0.0);
    assert!(entries(a).iter().any(|entry| f64::from(entry.2 as f32) != entry.2));
}

#[cfg(feature = "serde")]
#[test]
fn it_is_read_again_with_its_values() {
    let third = (0..9).map(|at| (at % 3, at / 3, 1.0 / 3.0));
    let single = SparseTransition::from_triplets_single(3, third).unwrap();
    let text = serde_json::to_string(&single).unwrap();
    let read: SparseTransition = serde_json::from_str(&text).unwrap();
    assert_eq!(entries(&read), entries(&single));
    let again = read.with_single_values();
    assert_eq!((entries(&again), again.rounding()), (entries(&single), 0.0));
}
