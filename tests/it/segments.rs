//! A long sequence that is cut into segments has the results of one piece.

use std::error::Error;
use std::ops::{Range, RangeInclusive};
use std::sync::atomic::{AtomicUsize, Ordering};

use proptest::prelude::*;
use rand::RngExt;
use wayfix::inference::Order;
use wayfix::likelihood::LearnLikelihood;
use wayfix::transition::{LearnTransition, MoveCounts};
use wayfix::{
    Belief, DenseTransition, Diagonal, Fixed, Hmm, Likelihood, LikelihoodError, LikelihoodVector,
    Prior, Scratch, Sequence, TableLikelihood, TransitionEntries,
};

use crate::kit::{Matrix, all_close, cases_of, close, dense, matrix, prior, rng, sparse, weighted};

/// Readings with one mean per state, and Gaussian noise of unit variance.
#[derive(Debug, Clone)]
struct Readings(Vec<f64>);

impl Likelihood for Readings {
    type Observation = f64;

    fn states(&self) -> usize {
        self.0.len()
    }

    fn diagonal<'a>(
        &'a self,
        y: &f64,
        s: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        let logs = s.values(self.0.len());
        logs.iter_mut().zip(&self.0).for_each(|(log, mean)| *log = -0.5 * (y - mean).powi(2));
        Ok(Diagonal::log(logs))
    }
}

impl LearnLikelihood for Readings {
    type Statistics = Vec<(f64, f64)>;

    fn statistics(&self) -> Self::Statistics {
        vec![(0.0, 0.0); self.0.len()]
    }

    fn add(&self, sums: &mut Self::Statistics, y: &f64, posterior: &[f64]) {
        sums.iter_mut().zip(posterior).for_each(|(s, p)| *s = (s.0 + p, s.1 + p * (y + 10.0)));
    }

    fn merge(&self, sums: &mut Self::Statistics, other: &Self::Statistics) {
        sums.iter_mut().zip(other).for_each(|(s, o)| *s = (s.0 + o.0, s.1 + o.1));
    }

    fn maximize(&self, _: &Self::Statistics, _: f64) -> Result<Self, Box<dyn Error + Send + Sync>> {
        Ok(self.clone())
    }

    fn free_parameters(&self) -> usize {
        self.0.len()
    }
}

/// Observations that count how often they are read, and how often not next to the read before.
struct Noted<'a, Y> {
    ys: &'a [Y],
    last: AtomicUsize,
    asked: AtomicUsize,
    jumps: AtomicUsize,
}

impl<'a, Y> Noted<'a, Y> {
    fn new(ys: &'a [Y]) -> Self {
        let zero = || AtomicUsize::new(0);
        Self { ys, last: zero(), asked: zero(), jumps: zero() }
    }
}

impl<Y> Sequence<(), Y> for Noted<'_, Y> {
    fn steps(&self) -> usize {
        self.ys.len()
    }

    fn control(&self, _: usize) -> &() {
        &()
    }

    fn observation(&self, step: usize) -> &Y {
        let last = self.last.swap(step, Ordering::Relaxed);
        self.asked.fetch_add(1, Ordering::Relaxed);
        self.jumps.fetch_add(usize::from(last.abs_diff(step) > 1), Ordering::Relaxed);
        &self.ys[step - 1]
    }
}

/// True if observations were read in the order of lanes, nearly always not next to the read before.
/// False after a routine that starts over in one piece.
fn in_lanes<Y>(ys: &[Y], routine: impl FnOnce(&[Noted<'_, Y>; 1])) -> bool {
    let noted = [Noted::new(ys)];
    routine(&noted);
    let [jumps, asked] =
        [&noted[0].jumps, &noted[0].asked].map(|count| count.load(Ordering::Relaxed));
    assert!(asked >= ys.len());
    jumps > asked / 10 * 9
}

/// Kinds of moves, by how fast a model forgets.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Moves {
    /// Any moves.
    Full,
    /// Half of the moves are impossible.
    Sparse,
    /// From each state to the next, and with probability `10^-n` to any.
    Ring(i32),
    /// To itself, and once in a thousand steps to any.
    Rare,
    /// Only between states of the same half.
    Apart,
    /// To itself, and to states with higher numbers.
    Upward,
}

impl Moves {
    /// Entry (to, from) from a random weight.
    fn entry(self, n: usize, to: usize, from: usize, weight: f64) -> f64 {
        match self {
            Self::Full => 0.05 + weight,
            Self::Sparse if to != from && weight < 0.5 => 0.0,
            Self::Sparse => weight + 0.1,
            Self::Ring(_) if to == (from + 1) % n => 1.0,
            Self::Ring(power) => weight * 10.0_f64.powi(power),
            Self::Rare if to == from => 1.0,
            Self::Rare => weight * 1e-3,
            Self::Apart if (2 * to < n) != (2 * from < n) => 0.0,
            Self::Apart => weight + 0.01,
            Self::Upward if to < from => 0.0,
            Self::Upward => 0.001 + if to == from { 1.0 } else { weight * 1e-3 },
        }
    }
}

/// A model and its observations.
#[derive(Debug, Clone)]
struct Case {
    matrix: Matrix,
    prior: Prior,
    table: Vec<Vec<f64>>,
    steps: usize,
    seed: u64,
}

fn instances(n: RangeInclusive<usize>) -> impl Strategy<Value = Case> {
    instances_of(n, 2048..5000)
}

fn instances_of(n: RangeInclusive<usize>, steps: Range<usize>) -> impl Strategy<Value = Case> {
    let moves = prop_oneof![
        4 => Just(Moves::Full), 4 => Just(Moves::Sparse), 3 => (-9..-1).prop_map(Moves::Ring),
        2 => Just(Moves::Rare), 1 => Just(Moves::Apart), 1 => Just(Moves::Upward),
    ];
    (n, 2..=4_usize, moves).prop_flat_map(move |(n, m, moves)| {
        let weights = proptest::collection::vec(0.0..1.0, n * n);
        let row = weighted(prop_oneof![1 => Just(0.0), 6 => 0.01..1.0], m);
        let table = proptest::collection::vec(row, n);
        let start = weighted(prop_oneof![1 => Just(0.0), 2 => 0.01..1.0], n);
        let parts = (weights, table, start, any::<bool>(), steps.clone(), any::<u64>());
        parts.prop_map(move |(weights, table, start, at_first, steps, seed)| {
            let entry = |to: usize, from: usize| moves.entry(n, to, from, weights[to * n + from]);
            let sum = |from| (0..n).map(|to| entry(to, from)).sum::<f64>();
            let matrix = matrix(n, |to, from| entry(to, from) / sum(from));
            Case { matrix, prior: prior(&start, at_first), table, steps, seed }
        })
    })
}

impl Case {
    fn symbols<A>(&self, transition: A) -> (Hmm<A, TableLikelihood>, Vec<usize>)
    where
        A: TransitionEntries<Control = ()>,
    {
        let table = TableLikelihood::from_rows(&self.table).unwrap();
        let hmm = Hmm::new(self.prior.clone(), transition, table).unwrap();
        let seen = hmm.simulate(self.steps, &mut rng(self.seed)).observations().to_vec();
        (hmm, seen)
    }

    fn readings<A>(&self, transition: A) -> (Hmm<A, Readings>, Vec<f64>)
    where
        A: TransitionEntries<Control = ()> + Clone,
    {
        let (hmm, _) = self.symbols(transition);
        let means: Vec<f64> = (0..hmm.states()).map(|i| i as f64).collect();
        let mut noise = rng(self.seed);
        let path = hmm.simulate(self.steps, &mut rng(self.seed)).states().to_vec();
        let seen = path.iter().map(|&i| means[i] + noise.random_range(-2.0..2.0)).collect();
        let (prior, transition, _) = hmm.into_parts();
        (Hmm::new(prior, transition, Readings(means)).unwrap(), seen)
    }
}

/// Expectations by the routine that takes every sequence in one piece; errors as text.
fn in_one_piece<A, B>(
    hmm: &Hmm<A, B>,
    ys: &[B::Observation],
) -> Result<(Vec<f64>, MoveCounts, B::Statistics, f64), String>
where
    A: LearnTransition<Control = ()> + TransitionEntries,
    B: LearnLikelihood + Likelihood<Observation: Sized>,
{
    let (mut first, mut sensor) = (Vec::new(), hmm.likelihood().statistics());
    let log = hmm.smooth_each(ys, Order::Backward, |step| match step.step() {
        0 => first = step.smoothed().as_slice().to_vec(),
        k => hmm.likelihood().add(&mut sensor, &ys[k - 1], step.smoothed().as_slice()),
    });
    let log = log.map_err(|error| error.to_string())?;
    Ok((first, hmm.expected_moves(ys).unwrap(), sensor, log))
}

/// Compares expectations with those in one piece, and the statistics of the sensor as numbers.
fn check_learning<A, B>(
    hmm: &Hmm<A, B>,
    ys: &[B::Observation],
    numbers: impl Fn(&B::Statistics) -> Vec<f64>,
) -> Result<(), TestCaseError>
where
    A: LearnTransition<Control = (), Statistics = MoveCounts> + TransitionEntries + Sync,
    B: LearnLikelihood + Likelihood<Observation: Sized + Sync> + Sync,
{
    let (found, errors) = hmm.expectations(&[ys]);
    let (first, moves, sensor, log) = match in_one_piece(hmm, ys) {
        Ok(expected) => expected,
        Err(error) => {
            prop_assert_eq!(errors.len(), 1);
            prop_assert_eq!(errors[0].source.to_string(), error);
            return Ok(());
        }
    };
    prop_assert!(errors.is_empty());
    close(found.log_likelihood(), log, 1e-12, 1.0)?;
    all_close(found.first(), &first, 1e-10, 1e-280)?;
    all_close(&numbers(found.sensor()), &numbers(&sensor), 1e-10, 1e-280)?;
    let n = hmm.states();
    for at in 0..n * n {
        let (found, expected) = (found.moves().get(at / n, at % n), moves.get(at / n, at % n));
        close(found, expected, 1e-10, 1e-280)?;
    }
    Ok(())
}

fn check_smoother<A, B>(hmm: &Hmm<A, B>, ys: &[B::Observation]) -> Result<(), TestCaseError>
where
    A: TransitionEntries<Control = ()>,
    B: Likelihood<Observation: Sized>,
{
    let found = hmm.smooth(ys);
    let mut rows = Vec::new();
    let log = hmm
        .smooth_each(ys, Order::Forward, |step| rows.extend(step.smoothed().as_slice().to_vec()));
    match (found, log) {
        (Ok(found), Ok(log)) => {
            close(found.log_likelihood(), log, 1e-12, 1.0)?;
            all_close(found.posteriors().as_slice(), &rows, 1e-10, 1e-280)
        }
        (found, log) => {
            prop_assert_eq!(found.unwrap_err().to_string(), log.unwrap_err().to_string());
            Ok(())
        }
    }
}

fn pairs(sums: &[(f64, f64)]) -> Vec<f64> {
    sums.iter().flat_map(|sum| [sum.0, sum.1]).collect()
}

/// A step, and the vector of likelihoods to put there.
fn spoiled(n: usize) -> impl Strategy<Value = (usize, Vec<f64>)> {
    let b = proptest::collection::vec(-1000.0..0.0, n)
        .prop_map(|logs| logs.iter().map(|log: &f64| (log / 2.0).exp()).collect::<Vec<f64>>());
    let short = Just(vec![0.5; n - 1]);
    let b = prop_oneof![
        2 => b, 1 => Just(vec![0.0; n]), 1 => Just(vec![f64::NAN; n]), 1 => Just(vec![-1.0; n]),
        1 => Just(vec![1e-250; n]), 1 => short
    ];
    (any::<usize>(), b)
}

proptest! {
    #![proptest_config(cases_of(400))]

    /// Up to eight states go through whole passes, and more through steps.
    #[test]
    fn learning_from_one_sequence_is_learning_in_one_piece(case in instances_of(1..=10, 1..2100)) {
        let (hmm, seen) = case.symbols(sparse(&case.matrix));
        check_learning(&hmm, &seen, Clone::clone)?;
        let (hmm, seen) = case.readings(dense(&case.matrix));
        check_learning(&hmm, &seen, |sums| pairs(sums))?;
    }

    #[test]
    fn learning_in_segments_is_learning_in_one_piece(case in instances(2..=12)) {
        let (hmm, seen) = case.symbols(sparse(&case.matrix));
        check_learning(&hmm, &seen, Clone::clone)?;
        let (hmm, seen) = case.symbols(dense(&case.matrix));
        check_learning(&hmm, &seen, Clone::clone)?;
        let (hmm, seen) = case.readings(dense(&case.matrix));
        check_learning(&hmm, &seen, |sums| pairs(sums))?;
    }

    #[test]
    fn smoothing_in_segments_is_smoothing_in_one_piece(case in instances(9..=16)) {
        let (hmm, seen) = case.symbols(sparse(&case.matrix));
        check_smoother(&hmm, &seen)?;
        let (hmm, seen) = case.readings(dense(&case.matrix));
        check_smoother(&hmm, &seen)?;
        check_smoother(&hmm.with_rounded_tails(), &seen)?;
    }

    /// Impossible, invalid or extreme observations are left to the general routine.
    #[test]
    fn errors_are_those_of_one_piece(
        (case, (at, b)) in prop_oneof![instances(9..=12), instances_of(2..=8, 1..2048)].prop_flat_map(|case| {
            let n = case.table.len();
            (Just(case), spoiled(n))
        })
    ) {
        let n = case.table.len();
        let (hmm, symbols) = case.symbols(dense(&case.matrix));
        let likelihood = |y: &usize| case.table.iter().map(|row| row[*y]).collect::<Vec<f64>>();
        let mut seen: Vec<Vec<f64>> = symbols.iter().map(likelihood).collect();
        let at = at % seen.len();
        seen[at] = b;
        let (prior, transition, _) = hmm.into_parts();
        let sensor = Fixed(LikelihoodVector::linear(n).owned());
        let hmm = Hmm::new(prior, transition, sensor).unwrap();
        check_learning(&hmm, &seen, |()| Vec::new())?;
        check_smoother(&hmm, &seen)?;
    }
}

/// A model of n states that show their own symbol with probability 0.7, and the others equally
/// often.
fn example(n: usize, moves: Moves) -> Hmm<DenseTransition, TableLikelihood> {
    let weight = |to: usize, from: usize| (to * 7 + from * 3) as f64 % 11.0 / 11.0;
    let entry = |to: usize, from: usize| moves.entry(n, to, from, weight(to, from));
    let sum = |from| (0..n).map(|to| entry(to, from)).sum::<f64>();
    let transition = DenseTransition::from_fn(n, |to, from| entry(to, from) / sum(from)).unwrap();
    let other = 0.3 / (n - 1) as f64;
    let table = matrix(n, |i, y| if i == y { 0.7 } else { other });
    let prior = Prior::AtFirstObservation(Belief::uniform(n).unwrap());
    Hmm::new(prior, transition, TableLikelihood::from_rows(&table).unwrap()).unwrap()
}

/// Long sequences run in lanes if the model forgets, and in one piece if it does not.
#[test]
fn models_that_forget_run_in_lanes() {
    let learns = |moves, steps| {
        let hmm = example(8, moves);
        let seen = hmm.simulate(steps, &mut rng(1)).observations().to_vec();
        in_lanes(&seen, |noted| drop(hmm.expectations(noted)))
    };
    for moves in [Moves::Full, Moves::Sparse, Moves::Rare, Moves::Ring(-7)] {
        assert!(learns(moves, 50_000), "{moves:?}");
    }
    assert!(!learns(Moves::Apart, 50_000));
    assert!(learns(Moves::Full, 2_100) && !learns(Moves::Full, 2_000));
    let smooths = |n, moves| {
        let hmm = example(n, moves);
        let seen = hmm.simulate(20_000, &mut rng(2)).observations().to_vec();
        in_lanes(&seen, |noted| drop(hmm.smooth(&noted[0]).unwrap()))
    };
    assert!(smooths(12, Moves::Full) && smooths(40, Moves::Full));
    // Few states have a faster way.
    assert!(!smooths(12, Moves::Apart) && !smooths(8, Moves::Full));
}

/// 150 of each 1,000 steps are uninformative: a warm-up that suffices elsewhere does not there.
#[test]
fn a_warm_up_that_is_too_short_is_made_longer() -> Result<(), TestCaseError> {
    let simulated = example(8, Moves::Rare).simulate(60_000, &mut rng(3));
    let mut seen = simulated.observations().to_vec();
    let stay = |to, from| if to == from { 0.93 } else { 0.01 };
    // The last symbol is uninformative.
    let value = |i, y| [0.03, 0.69, 0.1][usize::from(y == i) + 2 * usize::from(y == 8)];
    let table: Matrix = (0..8).map(|i| (0..9).map(|y| value(i, y)).collect()).collect();
    let prior = Prior::BeforeFirstTransition(Belief::certain(8, 2).unwrap());
    let transition = DenseTransition::from_fn(8, stay).unwrap();
    let hmm = Hmm::new(prior, transition, TableLikelihood::from_rows(&table).unwrap()).unwrap();
    for (k, y) in seen.iter_mut().enumerate() {
        if k % 1000 < 150 {
            *y = 8;
        }
    }
    assert!(in_lanes(&seen, |noted| drop(hmm.expectations(noted))));
    check_learning(&hmm, &seen, Clone::clone)
}

/// Several long sequences, too many steps for a lane each.
#[test]
fn each_of_several_long_sequences_is_cut() {
    let hmm = example(300, Moves::Full);
    let seen: Vec<Vec<usize>> =
        (0..3).map(|seed| hmm.simulate(2_500, &mut rng(seed)).observations().to_vec()).collect();
    let (together, errors) = hmm.expectations(&seen);
    assert!(errors.is_empty());
    let mut sum = hmm.no_expectations();
    for ys in &seen {
        sum.merge(&hmm, &hmm.expectations(&[ys]).0);
    }
    let near = |a: &[f64], b: &[f64]| all_close(a, b, 1e-10, 1e-280).unwrap();
    near(together.sensor(), sum.sensor());
    near(together.first(), sum.first());
    // An empty sequence beside a long one has no influence.
    let (beside, errors) = hmm.expectations(&[&seen[0][..], &[]]);
    assert!(errors.is_empty());
    assert_eq!(beside.sensor(), hmm.expectations(&[&seen[0]]).0.sensor());
    // Two would fit in two lanes, and leave six empty.
    let hmm = example(8, Moves::Sparse);
    let seen = hmm.simulate(20_000, &mut rng(5)).observations().to_vec();
    let two = [Noted::new(&seen[..9_000]), Noted::new(&seen[9_000..])];
    assert!(hmm.expectations(&two).1.is_empty());
    for noted in two {
        // Warm-ups are read again; in a lane, each observation is read twice.
        assert!(noted.asked.load(Ordering::Relaxed) > 2 * noted.ys.len() + 100);
    }
}

/// Results are the same to the bit for any number of threads.
#[cfg(feature = "rayon")]
#[test]
fn threads_do_not_change_a_bit_of_segments() {
    let hmm = example(8, Moves::Sparse);
    let seen = hmm.simulate(60_000, &mut rng(4)).observations().to_vec();
    let learn = || {
        let (sums, _) = hmm.expectations(&[&seen]);
        let moves: Vec<_> = sums.moves().moves().collect();
        format!("{:?} {moves:?} {:?} {:?}", sums.first(), sums.sensor(), sums.log_likelihood())
    };
    assert!(in_lanes(&seen, |noted| drop(hmm.expectations(noted))));
    assert_eq!(crate::threads::with_threads(1, learn), crate::threads::with_threads(4, learn));
}
