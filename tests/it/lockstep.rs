//! Many sequences in lock-step have the results of each by itself.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::inference::{LearningOptions, Posteriors};
use wayfix::transition::{LearnTransition, MoveCounts};
use wayfix::{
    Belief, DenseTransition, Fixed, Hmm, Likelihood, LikelihoodVector, OptionalLikelihood, Prior,
    SparseTransition, TableLikelihood, TransitionEntries,
};

use crate::kit::{Sensor, all_close, cases_of, close, prior, rng, same_results, weighted};

type Drive = Vec<Option<Vec<f64>>>;

/// Model with enough states for lock-step, and drives through it.
#[derive(Debug, Clone)]
struct Case {
    states: usize,
    at_first: bool,
    prior: Vec<f64>,
    /// `columns[from][to]`.
    columns: Vec<Vec<f64>>,
    drives: Vec<Drive>,
    log: bool,
}

/// Ordinary models, or some numbers that lock-step leaves to other routines.
fn instances(extreme: bool) -> impl Strategy<Value = Case> {
    (9..=20_usize, any::<bool>(), any::<bool>(), 0..=20_usize).prop_flat_map(
        move |(n, at_first, log, count)| {
            let weight = if extreme {
                prop_oneof![200 => Just(0.0), 200 => 0.01..1.0, 1 => Just(1e-300), 1 => Just(1e-50)]
                    .boxed()
            } else {
                prop_oneof![1 => Just(0.0), 1 => 0.01..1.0].boxed()
            };
            let column = || weighted(weight.clone(), n);
            let likelihood = prop_oneof![1 => Just(0.0), 9 => 0.001..1.0];
            let row = vec(likelihood, n);
            let usual = row.prop_map(move |b| {
                Some(if log { b.iter().map(|b: &f64| b.ln()).collect() } else { b })
            });
            let scale = if log {
                prop_oneof![Just(-1e5), Just(-400.0), Just(700.0)].boxed()
            } else {
                prop_oneof![Just(1e-250), Just(1e-100), Just(1e200)].boxed()
            };
            let scaled = (vec(0.001..1.0, n), scale).prop_map(move |(b, scale)| {
                let scaled = |b: &f64| if log { b.ln() + scale } else { b * scale };
                Some(b.iter().map(scaled).collect::<Vec<f64>>())
            });
            let wild = vec(-1500.0..0.0, n).prop_map(move |logs| {
                Some(logs.iter().map(|l: &f64| if log { *l } else { (l / 3.0).exp() }).collect())
            });
            let bad = (0..n, prop_oneof![Just(f64::NAN), Just(-1.0), Just(f64::INFINITY)])
                .prop_map(move |(at, bad)| {
                    let bad = if log && bad < 0.0 { 2e300 } else { bad };
                    Some((0..n).map(|i| if i == at { bad } else { 0.5 }).collect())
                });
            let nothing = Just(Some(vec![if log { f64::NEG_INFINITY } else { 0.0 }; n]));
            let short = Just(Some(vec![0.5; n - 1]));
            let rare = u32::from(extreme);
            let y = prop_oneof![
                200 => usual, 10 => Just(None), 10 => scaled,
                rare => wild, rare => bad, rare => nothing, rare => short
            ];
            let drives = vec(vec(y, 0..40), count);
            (column(), vec(column(), n), drives).prop_map(move |(prior, columns, drives)| Case {
                states: n,
                at_first,
                prior,
                columns,
                drives,
                log,
            })
        },
    )
}

impl Case {
    fn prior(&self) -> Prior {
        prior(&self.prior, self.at_first)
    }

    fn sensor(&self) -> Sensor {
        let vectors = if self.log { LikelihoodVector::log } else { LikelihoodVector::linear };
        OptionalLikelihood::new(vectors(self.states).owned())
    }

    fn sparse(&self) -> SparseTransition {
        let entries = self.columns.iter().enumerate();
        let entries = entries.flat_map(|(j, c)| c.iter().enumerate().map(move |(i, p)| (i, j, *p)));
        SparseTransition::from_triplets(self.states, entries).unwrap()
    }

    fn dense(&self) -> DenseTransition {
        DenseTransition::from_fn(self.states, |to, from| self.columns[from][to]).unwrap()
    }
}

fn near(found: &Posteriors, expected: &Posteriors) -> bool {
    all_close(found.as_slice(), expected.as_slice(), 1e-12, 1e-288).is_ok()
}

/// A sum of logarithms, some of them large.
fn near_log(found: f64, expected: f64, size: f64) -> bool {
    close(found, expected, 1e-12, size).is_ok()
}

fn check<A, B>(hmm: &Hmm<A, B>, drives: &[Drive]) -> Result<(), TestCaseError>
where
    A: TransitionEntries<Control = ()> + Sync,
    B: Likelihood<Observation = Option<Vec<f64>>> + Sync,
{
    let filtered = hmm.forward_all(drives);
    let smoothed = hmm.smooth_all(drives);
    // Some results share a block.
    for (moved, kept) in hmm.smooth_all(drives).into_iter().zip(&smoothed) {
        if let (Ok(moved), Ok(kept)) = (moved, kept) {
            let moved = moved.into_posteriors().into_vec();
            prop_assert_eq!(moved.as_slice(), kept.posteriors().as_slice());
        }
    }
    same_results(
        &filtered,
        drives.len(),
        |i| hmm.forward(&drives[i]),
        |found, expected| {
            let size = expected.log_likelihoods().iter().map(|log| log.abs()).fold(1.0, f64::max);
            let mut logs = found.log_likelihoods().iter().zip(expected.log_likelihoods());
            near(found.posteriors(), expected.posteriors())
                && found.log_likelihoods().len() == expected.log_likelihoods().len()
                && logs.all(|(f, e)| near_log(*f, *e, size))
                && near_log(found.log_likelihood(), expected.log_likelihood(), size)
        },
    )?;
    same_results(
        &smoothed,
        drives.len(),
        |i| hmm.smooth(&drives[i]),
        |found, expected| {
            near(found.posteriors(), expected.posteriors())
                && near_log(found.log_likelihood(), expected.log_likelihood(), 1e5)
        },
    )?;
    same_results(
        &hmm.log_likelihood_all(drives),
        drives.len(),
        |i| hmm.log_likelihood(&drives[i]),
        |f, e| near_log(*f, *e, 1e5),
    )?;
    same_results(
        &hmm.viterbi_all(drives),
        drives.len(),
        |i| hmm.viterbi(&drives[i]),
        |found, expected| {
            found.states() == expected.states()
                && found.log_probability().to_bits() == expected.log_probability().to_bits()
        },
    )
}

/// Drives of symbols, with a table and the other parts of a model.
fn symbols() -> impl Strategy<Value = (Case, Vec<Vec<f64>>, Vec<Vec<usize>>)> {
    (instances(false), 2..=4_usize).prop_flat_map(|(case, m)| {
        let row = weighted(prop_oneof![1 => Just(0.0), 4 => 0.01..1.0], m);
        let drives = vec(vec(0..m, 0..30), 0..=20);
        (Just(case.clone()), vec(row, case.states), drives)
    })
}

/// Expected counts of each drive by itself, summed: X_0, moves (from, to), symbols.
#[derive(Debug)]
struct Counts {
    first: Vec<f64>,
    moves: Vec<f64>,
    symbols: Vec<f64>,
    log_likelihood: f64,
    left_out: Vec<usize>,
}

fn counts<A: LearnTransition<Control = ()>>(
    hmm: &Hmm<A, TableLikelihood>,
    drives: &[Vec<usize>],
) -> Counts {
    let (n, m) = (hmm.states(), hmm.likelihood().symbols());
    let mut counts = Counts {
        first: vec![0.0; n],
        moves: vec![0.0; n * n],
        symbols: vec![0.0; n * m],
        log_likelihood: 0.0,
        left_out: Vec::new(),
    };
    for (index, drive) in drives.iter().enumerate().filter(|drive| !drive.1.is_empty()) {
        let Ok(smoothing) = hmm.smooth(drive) else {
            counts.left_out.push(index);
            continue;
        };
        counts.log_likelihood += smoothing.log_likelihood();
        let rows = smoothing.posteriors().as_slice();
        counts.first.iter_mut().zip(rows).for_each(|(sum, p)| *sum += p);
        for (row, y) in rows.chunks(n).skip(1).zip(drive) {
            row.iter().enumerate().for_each(|(i, p)| counts.symbols[i * m + y] += p);
        }
        for step in hmm.expected_moves(drive).unwrap().moves() {
            counts.moves[step.from * n + step.to] += step.weight;
        }
    }
    counts
}

/// Normalises rows; empty ones stay as they were.
fn shares(counts: &[f64], width: usize, old: impl Fn(usize, usize) -> f64) -> Vec<f64> {
    let rows = counts.chunks(width).enumerate();
    rows.flat_map(|(row, counts)| {
        let sum: f64 = counts.iter().sum();
        let value = |(at, count): (usize, &f64)| if sum > 0.0 { count / sum } else { old(row, at) };
        counts.iter().enumerate().map(value).collect::<Vec<f64>>()
    })
    .collect()
}

/// One re-estimation follows from the counts of each drive by itself.
fn check_learning<A>(
    hmm: &Hmm<A, TableLikelihood>,
    drives: &[Vec<usize>],
    entry: impl Fn(&A, usize, usize) -> f64,
) -> Result<(), TestCaseError>
where
    A: LearnTransition<Control = ()> + Clone + Sync,
{
    let (n, m) = (hmm.states(), hmm.likelihood().symbols());
    let counts = counts(hmm, drives);
    prop_assume!(counts.first.iter().sum::<f64>() > 0.0);
    let learning = LearningOptions::default().with_iterations(1).with_tolerance(0.0);
    let learned = hmm.learn(drives, &learning).unwrap();
    let left_out: Vec<usize> = learned.left_out().iter().map(|error| error.sequence).collect();
    prop_assert_eq!(&left_out, &counts.left_out);
    let found = learned.objectives()[0];
    prop_assert!(near_log(found, counts.log_likelihood, 1.0), "{} {:?}", found, counts);
    let (model, old) = (learned.model(), hmm.transition());
    let near = |found: f64, expected: f64| (found - expected).abs() <= 1e-10;
    let moves = shares(&counts.moves, n, |from, to| entry(old, to, from));
    for (at, expected) in moves.into_iter().enumerate() {
        let found = entry(model.transition(), at % n, at / n);
        prop_assert!(near(found, expected), "{} to {}: {found} {expected}", at / n, at % n);
    }
    let table = hmm.likelihood();
    let symbols = shares(&counts.symbols, m, |i, y| table.probability(i, y).unwrap());
    for (at, expected) in symbols.into_iter().enumerate() {
        let found = model.likelihood().probability(at / m, at % m).unwrap();
        prop_assert!(near(found, expected), "{} in {}: {found} {expected}", at % m, at / m);
    }
    let first = shares(&counts.first, n, |_, _| 0.0);
    let found = model.prior().belief().as_slice();
    prop_assert!(found.iter().zip(&first).all(|(f, e)| near(*f, *e)), "{found:?} {first:?}");
    Ok(())
}

proptest! {
    #![proptest_config(cases_of(100))]

    #[test]
    fn sequences_together_are_those_alone(case in instances(false)) {
        check(&Hmm::new(case.prior(), case.sparse(), case.sensor()).unwrap(), &case.drives)?;
        check(&Hmm::new(case.prior(), case.dense(), case.sensor()).unwrap(), &case.drives)?;
    }

    /// Also if some are impossible, invalid, or beyond doubles.
    #[test]
    fn extremes_are_left_to_who_knows_them(case in instances(true)) {
        check(&Hmm::new(case.prior(), case.sparse(), case.sensor()).unwrap(), &case.drives)?;
        let rounded = Hmm::new(case.prior(), case.dense(), case.sensor()).unwrap();
        check(&rounded.with_rounded_tails(), &case.drives)?;
    }

    #[test]
    fn learning_together_is_learning_from_each((case, table, drives) in symbols()) {
        let table = TableLikelihood::from_rows(&table).unwrap();
        let sparse = Hmm::new(case.prior(), case.sparse(), table.clone()).unwrap();
        check_learning(&sparse, &drives, SparseTransition::get)?;
        let dense = Hmm::new(case.prior(), case.dense(), table).unwrap();
        check_learning(&dense, &drives, DenseTransition::get)?;
    }

    /// Results are the same to the bit for any number of threads.
    #[cfg(feature = "rayon")]
    #[test]
    fn threads_do_not_change_a_bit(case in instances(true)) {
        let hmm = Hmm::new(case.prior(), case.sparse(), case.sensor()).unwrap();
        let drives = &case.drives[..];
        let all = || format!(
            "{:?} {:?} {:?} {:?}",
            hmm.forward_all(drives), hmm.smooth_all(drives), hmm.log_likelihood_all(drives), hmm.viterbi_all(drives)
        );
        prop_assert_eq!(crate::threads::with_threads(1, all), crate::threads::with_threads(4, all));
    }
}

/// The second of the first eight sequences is impossible, and so leaves no numbers in its lane. In
/// the next group, the sequence in that lane is shorter than the longest.
#[test]
fn a_lane_that_does_not_hold_costs_no_other_sequence_its_counts() {
    let hmm = Hmm::new(
        Prior::AtFirstObservation(Belief::certain(2, 0).unwrap()),
        DenseTransition::from_rows(&[[0.7, 0.4], [0.3, 0.6]]).unwrap(),
        Fixed(LikelihoodVector::linear(2).owned()),
    )
    .unwrap();
    let seen = [vec![0.5, 0.5], vec![0.9, 0.2], vec![0.3, 0.8], vec![0.6, 0.6]];
    let mut drives = vec![seen[..2].to_vec(); 9];
    drives[1] = vec![vec![0.0, 1.0], vec![1.0, 1.0]];
    drives.extend([seen[..3].to_vec(), seen.to_vec()]);
    let learning = LearningOptions::default().with_iterations(1).with_keep_prior(true);
    let learned = hmm.learn(&drives, &learning).unwrap();
    assert_eq!(learned.left_out().len(), 1);
    let mut counts = MoveCounts::default();
    drives
        .iter()
        .filter_map(|drive| hmm.expected_moves(drive).ok())
        .for_each(|moves| counts.merge(&moves));
    let expected = hmm.transition().maximize(&counts, 0.0).unwrap();
    for (to, from) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
        let (found, expected) =
            (learned.model().transition().get(to, from), expected.get(to, from));
        assert!((found - expected).abs() < 1e-12, "{to} {from}: {found}, expected {expected}");
    }
}

/// More than caches hold: results share blocks of memory, and are written past the caches.
#[test]
fn many_results_stay_apart() {
    let hmm = wayfix::canberra::hmm(5, 1.0).unwrap();
    let mut rng = rng(5);
    let drives: Vec<Vec<usize>> = (0..1500)
        .map(|drive| hmm.simulate(20 + drive % 17, &mut rng).observations().to_vec())
        .collect();
    let mut smoothed = hmm.smooth_all(&drives);
    let kept = smoothed[0].as_ref().unwrap().clone();
    let own = hmm.smooth(&drives[7]).unwrap();
    for (together, drive) in smoothed.iter().zip(&drives).step_by(10) {
        let (together, alone) = (together.as_ref().unwrap(), hmm.smooth(drive).unwrap());
        assert_eq!(together.posteriors().steps(), drive.len());
        let pairs = together.posteriors().as_slice().iter().zip(alone.posteriors().as_slice());
        assert!(pairs.into_iter().all(|(a, b)| (a - b).abs() <= 1e-12));
    }
    // A result outlives the others of its block, and so does a copy.
    let last = smoothed.swap_remove(7).unwrap();
    drop(smoothed);
    assert_eq!(last.posteriors().modes(), own.posteriors().modes());
    assert_eq!(kept.posteriors().steps(), 20);
    let shown = format!("{:?}", last.posteriors());
    assert_eq!(shown.matches(',').count(), last.posteriors().as_slice().len());
}
