//! Smoothers, decoders and samplers against the enumeration of all paths.

use std::collections::{BTreeMap, HashMap};

use proptest::prelude::*;
use wayfix::inference::Order;
use wayfix::transition::SwitchedTransition;
use wayfix::{Hmm, SparseTransition, TransitionEntries};

use crate::kit::{Kind, Model, Sensor, cases, close, dyadic_models, log_add, models, rng};

fn sparse(model: &Model) -> Hmm<SwitchedTransition<SparseTransition>, Sensor> {
    model.hmm(model.sparse())
}

pub(crate) fn possible(model: &Model) -> bool {
    model.enumerate().impossible_at.is_none()
}

/// p(X_{k-1} = j, X_k = i | all), for each k.
fn pairs(model: &Model) -> Vec<HashMap<(usize, usize), f64>> {
    let mut pairs = vec![HashMap::new(); model.steps() + 1];
    for (path, log) in model.posterior_paths() {
        for k in 1..path.len() {
            *pairs[k].entry((path[k - 1], path[k])).or_insert(0.0) += log.exp();
        }
    }
    pairs
}

pub(crate) fn check_pairs<A: TransitionEntries<Control = usize>>(
    model: &Model,
    hmm: &Hmm<A, Sensor>,
    order: Order,
) -> Result<(), TestCaseError> {
    let expected = pairs(model);
    let (filtering, smoothing) = (hmm.forward(model).unwrap(), hmm.smooth(model).unwrap());
    let mut visited = Vec::new();
    let mut result = Ok(());
    let mut counts: BTreeMap<(usize, usize), f64> = BTreeMap::new();
    let log_likelihood = hmm.smooth_each(model, order, |step| {
        visited.push(step.step());
        let mut check = || {
            prop_assert_eq!(Some(step.smoothed()), smoothing.posteriors().get(step.step()));
            prop_assert_eq!(Some(step.filtered()), filtering.posteriors().get(step.step()));
            let moves = step.step() > 1 || (step.step() == 1 && !model.at_first);
            prop_assert_eq!(step.moves().is_some(), moves);
            let Some(listed) = step.moves() else { return Ok(()) };
            // The sums over either index are the posteriors of the two steps.
            let mut sums = [vec![0.0; model.states], vec![0.0; model.states]];
            let mut found = HashMap::new();
            let mut last = None;
            for m in listed {
                prop_assert!(last < Some((m.from, m.to)), "in ascending order");
                last = Some((m.from, m.to));
                sums[0][m.from] += m.weight;
                sums[1][m.to] += m.weight;
                found.insert((m.from, m.to), m.weight);
                *counts.entry((m.from, m.to)).or_insert(0.0) += m.weight;
            }
            for (back, sums) in [1, 0].into_iter().zip(&sums) {
                let smoothed = smoothing.posteriors().get(step.step() - back).unwrap();
                for (sum, p) in sums.iter().zip(smoothed.as_slice()) {
                    close(*sum, *p, 1e-10, 1e-290)?;
                }
            }
            for (pair, p) in &expected[step.step()] {
                close(found.get(pair).copied().unwrap_or(0.0), *p, 1e-10, 1e-290)?;
            }
            for (pair, p) in found {
                close(p, expected[step.step()].get(&pair).copied().unwrap_or(0.0), 1e-10, 1e-290)?;
            }
            Ok(())
        };
        if result.is_ok() {
            result = check();
        }
    });
    result?;
    prop_assert_eq!(log_likelihood.unwrap(), smoothing.log_likelihood());
    if order == Order::Backward {
        visited.reverse();
    }
    prop_assert_eq!(visited, (0..=model.steps()).collect::<Vec<_>>());

    let expected = hmm.expected_moves(model).unwrap();
    for m in expected.moves() {
        close(m.weight, counts.remove(&(m.from, m.to)).unwrap(), 1e-10, 1e-290)?;
        prop_assert_eq!(expected.get(m.from, m.to), m.weight);
    }
    prop_assert!(counts.is_empty());
    Ok(())
}

/// The product of the probabilities of a path x_1 … x_T, X_0 summed over:
/// exact for dyadic models.
fn exact(model: &Model, path: &[usize]) -> f64 {
    let into_first = |i: usize| {
        if model.at_first {
            return model.prior[i];
        }
        model.matrices[0][i].iter().zip(&model.prior).map(|(a, p)| a * p).sum()
    };
    let b = |k: usize| model.logs[k].as_ref().map_or(1.0, |logs| logs[path[k]].exp());
    let start = into_first(path[0]) * b(0);
    (1..path.len()).fold(start, |p, k| p * model.matrices[k][path[k]][path[k - 1]] * b(k))
}

/// All possible paths of a length, best first; ties by the last state, then the last but one, and
/// so on.
fn ranked(model: &Model, steps: usize) -> Vec<(Vec<usize>, f64)> {
    let mut paths: Vec<Vec<usize>> = vec![vec![]];
    for _ in 0..steps {
        let longer = |path: &Vec<usize>| {
            let path = path.clone();
            (0..model.states).map(move |i| [&path[..], &[i]].concat())
        };
        paths = paths.iter().flat_map(longer).collect();
    }
    let mut ranked: Vec<_> = paths
        .into_iter()
        .map(|path| {
            let p = exact(model, &path);
            (path, p)
        })
        .filter(|path| path.1 > 0.0)
        .collect();
    ranked
        .sort_by(|(a, p), (b, q)| q.total_cmp(p).then_with(|| a.iter().rev().cmp(b.iter().rev())));
    ranked
}

/// The entropy of the path equals that by enumeration.
pub(crate) fn check_entropy<A: TransitionEntries<Control = usize>>(
    model: &Model,
    hmm: &Hmm<A, Sensor>,
) -> Result<(), TestCaseError> {
    let found = hmm.path_entropy(model);
    prop_assert_eq!(found.is_ok(), possible(model));
    if let Ok(found) = found {
        let mut paths: BTreeMap<Vec<usize>, f64> = BTreeMap::new();
        for (path, log) in model.posterior_paths() {
            *paths.entry(path[1..].to_vec()).or_insert(0.0) += log.exp();
        }
        let terms = paths.values().filter(|p| **p > 0.0).map(|p| -p * p.ln());
        let expected: f64 = terms.sum();
        // Logarithms of 2000 have digits down to 4e-13.
        prop_assert!((found - expected).abs() <= 1e-10 * expected + 2e-12, "{found} {expected}");
        prop_assert!(found >= 0.0);
    }
    Ok(())
}

/// With every lag, after every step, the fixed-lag smoother is the batch smoother.
pub(crate) fn check_fixed_lag<A: TransitionEntries<Control = usize>>(
    model: &Model,
    hmm: &Hmm<A, Sensor>,
    lag: usize,
) -> Result<(), TestCaseError> {
    let mut smoother = hmm.fixed_lag(lag);
    let mut other = hmm.fixed_lag(3);
    for k in 1..=model.steps() {
        let before = smoother.snapshot();
        let (control, y) = (k - 1, &model.logs[k - 1]);
        if smoother.step_with(&control, y).is_err() {
            prop_assert_eq!(smoother.snapshot(), before);
            prop_assert_eq!(model.enumerate().impossible_at, Some(k));
            break;
        }
        let part = Model { logs: model.logs[..k].to_vec(), ..model.clone() };
        let batch = hmm.smooth(&part).unwrap();
        for j in 0..=k {
            let expected = if j + lag >= k { batch.posteriors().get(j) } else { None };
            prop_assert_eq!(smoother.get(j), expected);
        }
        prop_assert_eq!(Some(smoother.lagged()), batch.posteriors().get(k.saturating_sub(lag)));
        prop_assert_eq!(smoother.filter().log_likelihood(), batch.log_likelihood());
        other.restore(&smoother.snapshot()).unwrap();
        prop_assert_eq!(other.snapshot(), smoother.snapshot());
        prop_assert_eq!(other.lagged(), smoother.lagged());
    }
    smoother.restart();
    prop_assert_eq!(smoother.snapshot(), hmm.fixed_lag(lag).snapshot());
    Ok(())
}

/// The best paths are the best of all paths.
pub(crate) fn check_k_best<A: TransitionEntries<Control = usize>>(
    model: &Model,
    hmm: &Hmm<A, Sensor>,
    count: usize,
) -> Result<(), TestCaseError> {
    let found = hmm.k_best(model, count);
    prop_assert_eq!(found.is_ok(), possible(model));
    let Ok(found) = found else { return Ok(()) };
    let mut all: BTreeMap<Vec<usize>, f64> = BTreeMap::new();
    for (path, log) in model.posterior_paths() {
        log_add(all.entry(path[1..].to_vec()).or_insert(f64::NEG_INFINITY), log);
    }
    let log_likelihood = model.enumerate().log_likelihood;
    let mut expected: Vec<f64> = all.values().map(|log| log + log_likelihood).collect();
    expected.sort_by(|p, q| q.total_cmp(p));
    prop_assert_eq!(found.len(), count.min(expected.len()));
    for (path, expected) in found.iter().zip(&expected) {
        let size = expected.abs().max(1.0);
        prop_assert!((path.log_probability() - expected).abs() <= 1e-12 * size + 1e-11);
        if model.steps() > 0 {
            let own = model.log_probability(path.states());
            prop_assert!((path.log_probability() - own).abs() <= 1e-12 * size + 1e-11);
        }
    }
    let distinct: std::collections::BTreeSet<_> =
        found.iter().map(wayfix::inference::ViterbiPath::states).collect();
    prop_assert_eq!(distinct.len(), found.len());
    if let Some(first) = found.first() {
        prop_assert_eq!(first, &hmm.viterbi(model).unwrap());
    }
    Ok(())
}

/// Only possible paths are drawn.
pub(crate) fn check_drawn<A: TransitionEntries<Control = usize>>(
    model: &Model,
    hmm: &Hmm<A, Sensor>,
    seed: u64,
) -> Result<(), TestCaseError> {
    let sampler = hmm.path_sampler(model);
    prop_assert_eq!(sampler.is_ok(), possible(model));
    let Ok(sampler) = sampler else { return Ok(()) };
    let path = sampler.draw(&mut rng(seed)).unwrap();
    prop_assert_eq!(&path, &sampler.draw(&mut rng(seed)).unwrap());
    prop_assert_eq!(path.len(), model.steps());
    if model.steps() > 0 {
        let log = model.log_probability(&path) - model.enumerate().log_likelihood;
        // One in 1e15 paths is less probable than 1e-15 / their number.
        prop_assert!(log > (1e-15 / 5_f64.powi(6)).ln(), "{log}");
    }
    Ok(())
}

/// A chi-square test of the frequencies of drawn paths; false if there are too few cells to test.
pub(crate) fn check_frequencies<A: TransitionEntries<Control = usize>>(
    model: &Model,
    hmm: &Hmm<A, Sensor>,
    seed: u64,
) -> bool {
    let mut expected: BTreeMap<Vec<usize>, f64> = BTreeMap::new();
    for (path, log) in model.posterior_paths() {
        *expected.entry(path[1..].to_vec()).or_insert(0.0) += log.exp();
    }
    let sampler = hmm.path_sampler(model).unwrap();
    let mut rng = rng(seed);
    let draws = 20_000;
    let mut counts: BTreeMap<Vec<usize>, f64> = BTreeMap::new();
    for _ in 0..draws {
        *counts.entry(sampler.draw(&mut rng).unwrap()).or_insert(0.0) += 1.0;
    }
    assert!(counts.keys().all(|path| expected.contains_key(path)), "a path that cannot be");
    // Rare paths together, so that each cell expects at least 10.
    let draws = f64::from(draws);
    let (mut chi_square, mut cells, mut rare) = (0.0, 0, (0.0, 0.0));
    let mut cell = |count: f64, expected: f64| {
        chi_square += (count - expected).powi(2) / expected;
        cells += 1;
    };
    for (path, p) in &expected {
        let count = counts.get(path).copied().unwrap_or(0.0);
        if p * draws < 10.0 {
            rare = (rare.0 + count, rare.1 + p * draws);
        } else {
            cell(count, p * draws);
        }
    }
    if rare.1 >= 10.0 {
        cell(rare.0, rare.1);
    }
    if cells < 2 {
        return false;
    }
    let freedom = f64::from(cells - 1);
    let spread = 2.0 / (9.0 * freedom);
    let quantile = freedom * (1.0 - spread + 3.719 * spread.sqrt()).powi(3);
    assert!(chi_square < quantile, "model {seed}: {chi_square} of {quantile}");
    true
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn pairwise_posteriors_equal_enumeration(model in models(Kind::Shifted), forward: bool) {
        prop_assume!(possible(&model));
        let order = if forward { Order::Forward } else { Order::Backward };
        check_pairs(&model, &sparse(&model), order)?;
    }

    #[test]
    fn pairwise_posteriors_of_extremes_equal_enumeration(model in models(Kind::Extreme), forward: bool) {
        prop_assume!(possible(&model));
        let order = if forward { Order::Forward } else { Order::Backward };
        check_pairs(&model, &model.hmm(model.dense()), order)?;
    }

    #[test]
    fn the_entropy_of_the_path_equals_enumeration(model in models(Kind::Extreme)) {
        check_entropy(&model, &sparse(&model))?;
    }

    /// With every lag, after every step, to the bit.
    #[test]
    fn fixed_lag_is_the_batch_smoother_cut_off(model in models(Kind::Extreme), lag in 0..8_usize) {
        check_fixed_lag(&model, &sparse(&model), lag)?;
    }

    #[test]
    fn k_best_paths_are_the_best_of_all(model in models(Kind::Extreme), count in 0..40_usize) {
        check_k_best(&model, &sparse(&model), count)?;
    }

    /// Ties between paths are in the documented order, exactly.
    #[test]
    fn k_best_and_viterbi_break_ties_as_they_say(model in dyadic_models(), count in 1..60_usize) {
        prop_assume!(model.steps() > 0);
        let expected = ranked(&model, model.steps());
        let hmm = sparse(&model);
        match hmm.k_best(&model, count) {
            Err(_) => prop_assert!(expected.is_empty()),
            Ok(found) => {
                let states: Vec<_> = found.iter().map(|path| path.states().to_vec()).collect();
                let best: Vec<_> = expected.iter().take(count).map(|path| path.0.clone()).collect();
                prop_assert_eq!(&states, &best);
                let viterbi = hmm.viterbi(&model).unwrap();
                prop_assert_eq!(viterbi.states(), &best[0][..]);
            }
        }
    }

    /// The streaming decoder commits exactly the states that the best paths to all possible present
    /// states share; together with the rest, it is the batch decoder, at every step.
    #[test]
    fn online_viterbi_commits_as_soon_as_it_can(model in dyadic_models()) {
        let hmm = sparse(&model);
        let mut decoder = hmm.online_viterbi();
        let mut committed = Vec::new();
        for k in 1..=model.steps() {
            let all = ranked(&model, k);
            let before = (decoder.undecided(), decoder.log_probability(), decoder.steps());
            // A missing observation is the same as a step without one.
            let step = match &model.logs[k - 1] {
                None => decoder.predict_with(&(k - 1)),
                seen => decoder.step_with(&(k - 1), seen),
            };
            match step {
                Err(_) => {
                    prop_assert!(all.is_empty());
                    let after = (decoder.undecided(), decoder.log_probability(), decoder.steps());
                    prop_assert_eq!(before, after);
                    break;
                }
                Ok(states) => committed.extend_from_slice(states),
            }
            let part = Model { logs: model.logs[..k].to_vec(), ..model.clone() };
            let batch = hmm.viterbi(&part).unwrap();
            prop_assert_eq!([&committed[..], &decoder.undecided()].concat(), batch.states());
            prop_assert_eq!(decoder.log_probability(), batch.log_probability());
            // The best path to each state: the first of those that end there.
            let best = |i: usize| all.iter().find(|path| path.0[k - 1] == i).map(|path| &path.0);
            let survivors: Vec<_> = (0..model.states).filter_map(best).collect();
            let agree = |at: &usize| survivors.iter().all(|path| path[*at] == survivors[0][*at]);
            prop_assert_eq!(committed.len(), (0..k).take_while(agree).count());
        }
        decoder.restart();
        let fresh = hmm.online_viterbi();
        prop_assert_eq!(decoder.undecided(), fresh.undecided());
        prop_assert_eq!(decoder.log_probability(), fresh.log_probability());
        if let (1.., Some(logs)) = (model.steps(), model.logs.first()) {
            let mut fresh = fresh;
            let (a, b) = (decoder.step_with(&0, logs).is_ok(), fresh.step_with(&0, logs).is_ok());
            prop_assert_eq!(a, b);
            prop_assert_eq!(decoder.undecided(), fresh.undecided());
            prop_assert_eq!(decoder.log_probability(), fresh.log_probability());
        }
    }

    /// Only possible paths are drawn, also for extreme models, and the same path for the same seed.
    #[test]
    fn drawn_paths_are_possible(model in models(Kind::Extreme), seed: u64) {
        check_drawn(&model, &sparse(&model), seed)?;
    }
}

/// All paths of random models, by one chi-square test each. The seeds are fixed; with others, a
/// correct program fails each test with a probability of about 1e-4 (Wilson and Hilferty's
/// approximation of the quantile).
#[test]
fn drawn_paths_have_their_frequencies() {
    use proptest::strategy::ValueTree;
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    let mut tested = 0;
    while tested < 20 {
        let model = models(Kind::Plain).new_tree(&mut runner).unwrap().current();
        if !possible(&model) || model.steps() < 2 {
            continue;
        }
        tested += u64::from(check_frequencies(&model, &sparse(&model), tested));
    }
}

/// Results do not depend on the segments: they are the same to the bit, in both orders.
#[test]
fn checkpoints_change_nothing() {
    let hmm = wayfix::canberra::hmm(5, 1.0).unwrap();
    let steps = 4_321; // 454,000 numbers: 66 segments
    let drive = hmm.simulate(steps, &mut rng(1));
    let ys = drive.observations();
    let smoothing = hmm.smooth(ys).unwrap();
    for order in [Order::Forward, Order::Backward] {
        let mut visited = Vec::new();
        let mut moves = 0.0;
        let log_likelihood = hmm
            .smooth_each(ys, order, |step| {
                assert_eq!(Some(step.smoothed()), smoothing.posteriors().get(step.step()));
                moves += step.moves().map_or(0.0, |moves| moves.map(|m| m.weight).sum());
                visited.push(step.step());
            })
            .unwrap();
        assert_eq!(log_likelihood, smoothing.log_likelihood());
        assert!((moves - steps as f64).abs() < 1e-8);
        if order == Order::Backward {
            visited.reverse();
        }
        assert!(visited.into_iter().eq(0..=steps));
    }
}
