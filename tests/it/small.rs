//! Models of a few states over whole sequences, against enumeration and the streams, which take
//! each step by itself.

use std::cell::Cell;

use proptest::prelude::*;
use rand::{Rng, RngExt};
use wayfix::inference::{Order, Posteriors};
use wayfix::transition::{KroneckerTransition, RestartTransition};
use wayfix::{
    Belief, DenseTransition, Hmm, Likelihood, LikelihoodVector, Prior, SparseTransition,
    TableLikelihood, Transition, TransitionEntries,
};

use crate::kit::{
    Kind, Matrix, Model, Own, bits, cases_of, close, close_logs, dense, models, rng, sensor,
    transposed, with_causes,
};

/// Compares whole-sequence routines with the streams, including errors.
fn check<A, B>(hmm: &Hmm<A, B>, ys: &[B::Observation]) -> Result<(), TestCaseError>
where
    A: TransitionEntries<Control = ()>,
    B: Likelihood<Observation: Sized>,
{
    check_path(hmm, ys)?;
    let mut filter = hmm.filter();
    let mut beliefs = filter.belief().as_slice().to_vec();
    let mut logs = Vec::new();
    for y in ys {
        match filter.step(y) {
            Ok(log) => logs.push(log),
            Err(error) => {
                let expected = with_causes(&error);
                prop_assert_eq!(
                    with_causes(&hmm.log_likelihood(ys).unwrap_err()),
                    expected.clone()
                );
                prop_assert_eq!(with_causes(&hmm.forward(ys).unwrap_err()), expected.clone());
                prop_assert_eq!(with_causes(&hmm.smooth(ys).unwrap_err()), expected);
                return Ok(());
            }
        }
        beliefs.extend_from_slice(filter.belief().as_slice());
    }
    let filtering = hmm.forward(ys).unwrap();
    if ys.len() <= 64 {
        prop_assert_eq!(bits(filtering.posteriors().as_slice()), bits(&beliefs));
        prop_assert_eq!(bits(filtering.log_likelihoods()), bits(&logs));
        prop_assert_eq!(filtering.log_likelihood().to_bits(), filter.log_likelihood().to_bits());
    }
    prop_assert_eq!(filtering.posteriors().steps(), ys.len());
    for (&found, &expected) in filtering.posteriors().as_slice().iter().zip(&beliefs) {
        prop_assert_eq!(found == 0.0, expected == 0.0);
        close(found, expected, 1e-14 * ys.len().max(1000) as f64, 1e-280)?;
    }
    prop_assert_eq!(filtering.log_likelihoods().len(), ys.len());
    for (&found, &expected) in filtering.log_likelihoods().iter().zip(&logs) {
        close_logs(found, expected, 1e-12)?;
    }

    let tolerance = 1e-13 * logs.iter().map(|log| log.abs()).sum::<f64>().max(10.0);
    let found = filtering.log_likelihood();
    prop_assert!((found - filter.log_likelihood()).abs() <= tolerance, "{found}");
    let score = hmm.log_likelihood(ys).unwrap();
    prop_assert!((score - filter.log_likelihood()).abs() <= tolerance, "{score}");

    let mut smoothed = vec![Vec::new(); ys.len() + 1];
    hmm.smooth_each(ys, Order::Backward, |step| {
        smoothed[step.step()] = step.smoothed().as_slice().to_vec();
    })
    .unwrap();
    let smoothing = hmm.smooth(ys).unwrap();
    let found = smoothing.log_likelihood();
    prop_assert!((found - filter.log_likelihood()).abs() <= tolerance, "{found}");
    let tolerance = 1e-14 * ys.len().max(1000) as f64;
    for (found, expected) in smoothing.posteriors().with_start().zip(&smoothed) {
        prop_assert!((found.as_slice().iter().sum::<f64>() - 1.0).abs() <= 1e-14);
        for (&found, &expected) in found.as_slice().iter().zip(expected) {
            prop_assert_eq!(found == 0.0, expected == 0.0);
            close(found, expected, tolerance, 1e-280)?;
        }
    }
    Ok(())
}

/// The path and its probability, to the bit.
fn check_path<A, B>(hmm: &Hmm<A, B>, ys: &[B::Observation]) -> Result<(), TestCaseError>
where
    A: TransitionEntries<Control = ()>,
    B: Likelihood<Observation: Sized>,
{
    let mut decoder = hmm.online_viterbi();
    let mut states = Vec::new();
    for y in ys {
        match decoder.step(y) {
            Ok(decided) => states.extend_from_slice(decided),
            Err(error) => {
                prop_assert_eq!(with_causes(&hmm.viterbi(ys).unwrap_err()), with_causes(&error));
                return Ok(());
            }
        }
    }
    states.extend(decoder.undecided());
    let path = hmm.viterbi(ys).unwrap();
    prop_assert_eq!(path.states(), &states[..]);
    prop_assert_eq!(path.log_probability().to_bits(), decoder.log_probability().to_bits());
    Ok(())
}

/// One matrix at all steps, and repeated observations, for as long as enumeration allows.
fn longer(kind: Kind) -> impl Strategy<Value = Model> {
    let few = models(kind).prop_filter("few states", |m| m.states <= 3 && m.steps() > 0);
    few.prop_map(|mut model| {
        let steps = if model.states < 3 { 10 } else { 8 };
        model.logs = model.logs.iter().cycle().take(steps).cloned().collect();
        model.matrices = vec![model.matrices[0].clone(); steps];
        model
    })
}

proptest! {
    #![proptest_config(cases_of(300))]

    #[test]
    fn small_models_equal_enumeration(
        model in prop_oneof![longer(Kind::Plain), longer(Kind::Shifted), longer(Kind::Extreme)]
    ) {
        let n = model.states;
        let m = &model.matrices[0];
        let sensor = sensor(n);
        let motion = dense(m);
        let hmm = Hmm::new(model.prior(), motion, sensor).unwrap();
        check(&hmm, &model.logs)?;
        let answer = model.enumerate();
        if answer.impossible_at.is_some() {
            return Ok(()); // the same error as from the stream
        }
        close_logs(hmm.log_likelihood(&model.logs).unwrap(), answer.log_likelihood, 1e-12)?;
        let smoothing = hmm.smooth(&model.logs).unwrap();
        close_logs(smoothing.log_likelihood(), answer.log_likelihood, 1e-12)?;
        for (found, expected) in smoothing.posteriors().with_start().zip(&answer.smoothed) {
            for (&found, &expected) in found.as_slice().iter().zip(expected) {
                close(found, expected, 1e-11, 1e-280)?;
            }
        }
        let path = hmm.viterbi(&model.logs).unwrap();
        close_logs(path.log_probability(), answer.viterbi, 1e-12)?;
        close_logs(model.log_probability(path.states()), answer.viterbi, 1e-12)?;
    }
}

/// Columns that are distributions, with zeros and small entries.
fn draw_matrix(n: usize, zeros: bool, rng: &mut impl Rng) -> Matrix {
    let columns: Vec<Vec<f64>> = (0..n)
        .map(|j| {
            let mut column: Vec<f64> = (0..n).map(|_| rng.random_range(0.01..1.0)).collect();
            for (i, p) in column.iter_mut().enumerate() {
                if zeros && i != j && rng.random_bool(0.4) {
                    *p = if rng.random_bool(0.2) { 1e-12 } else { 0.0 };
                }
            }
            Belief::from_weights(column).unwrap().into_vec()
        })
        .collect();
    transposed(&columns)
}

fn draw_prior(n: usize, rng: &mut impl Rng) -> Prior {
    let belief = match rng.random_range(0..3) {
        0 => Belief::certain(n, rng.random_range(0..n)).unwrap(),
        1 => Belief::uniform(n).unwrap(),
        _ => Belief::from_weights((0..n).map(|_| rng.random_range(0.1..1.0)).collect()).unwrap(),
    };
    if rng.random_bool(0.5) {
        Prior::AtFirstObservation(belief)
    } else {
        Prior::BeforeFirstTransition(belief)
    }
}

/// Log-likelihoods, some of them missing, with levels far from 0, and occasionally at the limits of
/// doubles.
fn sightings(n: usize, steps: usize, wild: f64, rng: &mut impl Rng) -> Vec<Option<Vec<f64>>> {
    let level = [0.0, -400.0, 700.0, -1e5][rng.random_range(0..4)];
    (0..steps)
        .map(|_| {
            let spread = if rng.random_bool(wild) { 2000.0 } else { 4.0 };
            let logs = (0..n).map(|_| {
                let ruled_out = wild > 0.0 && rng.random_bool(0.02);
                if ruled_out { f64::NEG_INFINITY } else { level - rng.random_range(0.0..spread) }
            });
            let logs = logs.collect();
            rng.random_bool(0.9).then_some(logs)
        })
        .collect()
}

proptest! {
    #![proptest_config(cases_of(400))]

    /// Long enough to cross all block boundaries.
    #[test]
    fn small_models_equal_the_streams(
        n in 1..=8_usize,
        steps in prop_oneof![0..40_usize, 200..300_usize, 1000..2000_usize],
        seed in any::<u64>(),
        zeros in any::<bool>(),
        wild in prop_oneof![2 => Just(0.0), 1 => Just(0.003), 1 => Just(0.1)],
    ) {
        let rng = &mut rng(seed);
        let m = draw_matrix(n, zeros, rng);
        let ys = sightings(n, steps, wild, rng);
        let start = draw_prior(n, rng);
        let sensor = sensor(n);
        let dense = dense(&m);
        check(&Hmm::new(start.clone(), &dense, sensor.clone()).unwrap(), &ys)?;
        let rounded = Hmm::new(start.clone(), &dense, sensor.clone()).unwrap();
        check(&rounded.with_rounded_tails(), &ys)?;
        let sparse = SparseTransition::from_operator(&dense).unwrap();
        check(&Hmm::new(start.clone(), &sparse, sensor.clone()).unwrap(), &ys)?;
        check(&Hmm::new(start.clone(), Own(m), sensor.clone()).unwrap(), &ys)?;
        let restart = RestartTransition::new(sparse, 0.01, Belief::uniform(n).unwrap()).unwrap();
        check(&Hmm::new(start, restart, sensor).unwrap(), &ys)?;
    }

    /// Likelihoods as numbers, at any level, and from a table with zeros.
    #[test]
    fn numbers_and_symbols_equal_the_streams(
        n in 1..=8_usize,
        steps in 1..1200_usize,
        seed in any::<u64>(),
        level in -300..300_i32,
    ) {
        let rng = &mut rng(seed);
        let dense = |m: Vec<Vec<f64>>| dense(&m);
        let motion = dense(draw_matrix(n, false, rng));
        let scale = 10_f64.powi(level);
        let ys: Vec<Vec<f64>> = (0..steps)
            .map(|_| (0..n).map(|_| scale * rng.random_range(1e-4..1.0)).collect())
            .collect();
        let sensor = LikelihoodVector::linear(n).owned();
        check(&Hmm::new(draw_prior(n, rng), &motion, sensor).unwrap(), &ys)?;

        let rows: Vec<Vec<f64>> = (0..n)
            .map(|_| {
                let mut weights: Vec<f64> = (0..5).map(|_| rng.random_range(0.01..1.0)).collect();
                weights.iter_mut().take(4).for_each(|w| *w *= f64::from(rng.random_bool(0.8)));
                Belief::from_weights(weights).unwrap().into_vec()
            })
            .collect();
        let table = TableLikelihood::from_rows(&rows).unwrap();
        let hmm = Hmm::new(draw_prior(n, rng), &motion, table).unwrap();
        let drive = hmm.simulate(steps, rng).observations().to_vec();
        check(&hmm, &drive)?;
        let mut broken = drive;
        broken[rng.random_range(0..steps)] = 5; // no such symbol
        check(&hmm, &broken)?;
    }

    /// Powers of two: many paths tie.
    #[test]
    fn ties_go_where_those_of_the_stream_go(n in 1..=8_usize, seed in any::<u64>()) {
        let rng = &mut rng(seed);
        let shares: Vec<usize> = (0..n).map(|_| rng.random_range(0..=n.ilog2())).map(|s| 1 << s).collect();
        let turn = rng.random_range(0..n);
        let entry = |to: usize, from: usize| {
            let reached = (to + n - (from + turn) % n) % n < shares[from];
            if reached { 1.0 / shares[from] as f64 } else { 0.0 }
        };
        let motion = DenseTransition::from_fn(n, entry).unwrap();
        let ys: Vec<Vec<f64>> = (0..300)
            .map(|_| (0..n).map(|_| [1.0, 0.5, 0.25][rng.random_range(0..3)]).collect())
            .collect();
        let hmm = Hmm::new(draw_prior(n, rng), motion, LikelihoodVector::linear(n).owned()).unwrap();
        check(&hmm, &ys)?;
    }
}

proptest! {
    #![proptest_config(cases_of(120))]

    /// Around the ends of segments, eight of 8 to 128 steps; likelihoods of any range, some of them
    /// 0, and some that need a check at every step.
    #[test]
    fn segments_equal_the_streams(
        n in 1..=8_usize,
        steps in prop_oneof![
            60..84_usize, 124..132_usize, 1018..1036_usize, 1084..1100_usize, 2044..2056_usize,
            3066..3080_usize,
        ],
        seed in any::<u64>(),
        zeros in any::<bool>(),
        decades in prop_oneof![Just(0), Just(10), Just(40), Just(250)],
        impossible in any::<bool>(),
    ) {
        let rng = &mut rng(seed);
        let m = draw_matrix(n, zeros, rng);
        let motion = dense(&m);
        let mut ys: Vec<Vec<f64>> = (0..steps)
            .map(|_| {
                let sharp = rng.random_bool(0.05);
                let likelihood = |_| {
                    let low = if sharp { -rng.random_range(0..=decades) } else { 0 };
                    let seen = decades < 40 || rng.random_bool(0.999);
                    f64::from(seen) * rng.random_range(0.01..1.0) * 10_f64.powi(low)
                };
                (0..n).map(likelihood).collect()
            })
            .collect();
        if impossible {
            ys[rng.random_range(0..steps)] = vec![0.0; n];
        }
        let hmm = Hmm::new(draw_prior(n, rng), motion, LikelihoodVector::linear(n).owned()).unwrap();
        check(&hmm, &ys)?;
        let logs: Vec<Vec<f64>> =
            ys.iter().map(|y| y.iter().map(|b| b.ln() + 900.0).collect()).collect();
        let (prior, motion, _) = hmm.into_parts();
        check(&Hmm::new(prior, motion, LikelihoodVector::log(n).owned()).unwrap(), &logs)?;
    }
}

/// A left-to-right model: the probability of abandoned states falls without bound.
#[test]
fn what_falls_behind_is_not_lost() {
    [2, 3, 4, 5].into_iter().for_each(falls_behind);
}

fn falls_behind(n: usize) {
    let motion = DenseTransition::from_fn(n, |to, from| match (to, from) {
        (to, from) if to == n - 1 && from == n - 1 => 1.0,
        (to, from) if to == from => 0.9,
        (to, from) if to == from + 1 => 0.1,
        _ => 0.0,
    })
    .unwrap();
    let prior = Prior::AtFirstObservation(Belief::certain(n, 0).unwrap());
    let hmm = Hmm::new(prior, motion, LikelihoodVector::linear(n).owned()).unwrap();
    let at = |state: usize| (0..n).map(|i| if i == state { 0.9 } else { 0.01 }).collect();
    for pause in [3, 40, 400, 3000] {
        let mut ys: Vec<Vec<f64>> = (0..n).flat_map(|i| vec![at(i); pause]).collect();
        check(&hmm, &ys).unwrap();
        // In the end, it was at the first place all the time.
        ys.push((0..n).map(|i| f64::from(i == 0)).collect());
        check(&hmm, &ys).unwrap();
        assert_eq!(hmm.viterbi(&ys).unwrap().states(), vec![0; ys.len()]);
        assert_eq!(hmm.smooth(&ys).unwrap().posteriors().modes(), vec![0; ys.len()]);
    }
}

/// Entries of 1e-400 are found, though a product of one state rounds them to 0.
#[test]
fn entries_beyond_a_double_are_kept() {
    let half = SparseTransition::from_triplets(2, [(1, 0, 1e-200), (0, 0, 1.0), (0, 1, 1.0)]);
    let half = half.unwrap();
    let both = KroneckerTransition::new(&half, &half).unwrap();
    let prior = Prior::AtFirstObservation(Belief::certain(4, 0).unwrap());
    let hmm = Hmm::new(prior, both, LikelihoodVector::linear(4).owned()).unwrap();
    let mut ys = vec![vec![1.0; 4]; 300];
    ys[150] = vec![0.0, 0.0, 0.0, 1.0];
    let expected = -400.0 * 10.0_f64.ln();
    assert!((hmm.log_likelihood(&ys).unwrap() - expected).abs() < 1e-9);
    assert_eq!(hmm.viterbi(&ys).unwrap().states()[150], 3);
}

/// An operator that counts its products.
struct Counting<A>(A, Cell<usize>);

impl<A: Transition<Control = ()>> Transition for Counting<A> {
    type Control = ();
    fn states(&self) -> usize {
        self.0.states()
    }
    fn apply(&self, (): &(), x: &[f64], out: &mut [f64]) {
        self.1.set(self.1.get() + 1);
        self.0.apply(&(), x, out);
    }
    fn apply_transpose(&self, (): &(), x: &[f64], out: &mut [f64]) {
        self.1.set(self.1.get() + 1);
        self.0.apply_transpose(&(), x, out);
    }
}

/// The matrix of a small operator is read once, not at each step.
#[test]
fn long_sequences_take_few_products() {
    let rng = &mut rng(1);
    for n in 1..=8 {
        let motion = Counting(Own(draw_matrix(n, false, rng)), Cell::new(0));
        let hmm = Hmm::new(draw_prior(n, rng), motion, LikelihoodVector::log(n).owned()).unwrap();
        let ys: Vec<_> = sightings(n, 3000, 0.0, rng).into_iter().flatten().collect();
        hmm.transition().1.set(0);
        hmm.log_likelihood(&ys).unwrap();
        hmm.smooth(&ys).unwrap();
        hmm.forward(&ys).unwrap();
        assert_eq!(hmm.transition().1.take(), 3 * n);
    }
}

/// For most sizes, score and smoother run the same recursion, whatever they store on the way.
#[test]
fn score_and_smoother_agree() {
    let rng = &mut rng(3);
    for n in 1..=8 {
        let m = draw_matrix(n, false, rng);
        let motion = dense(&m);
        let sensor = sensor(n);
        let hmm = Hmm::new(draw_prior(n, rng), motion, sensor).unwrap();
        let ys = sightings(n, 20_000 + n, 0.0, rng);
        let (smoothing, filtering) = (hmm.smooth(&ys).unwrap(), hmm.forward(&ys).unwrap());
        let (score, beside) = (hmm.log_likelihood(&ys).unwrap(), smoothing.log_likelihood());
        assert!((score - beside).abs() <= 1e-14 * score.abs(), "{score} and {beside}");
        assert!(n == 4 || score.to_bits() == beside.to_bits());
        let last = |p: &Posteriors| p.get(ys.len()).unwrap().as_slice().to_vec();
        let (smoothed, filtered) = (last(smoothing.posteriors()), last(filtering.posteriors()));
        assert!(smoothed.iter().zip(filtered).all(|(a, b)| (a - b).abs() <= 1e-14));
    }
}
