//! Trellises against the sum and the maximum over all paths.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::inference::{Trellis, ViterbiPath};
use wayfix::{Belief, Controlled, DenseTransition, Hmm, HmmError, Prior, TableLikelihood};

use crate::kit::{Kind, NEVER, all_close, cases, close, close_logs, log_sum, models};

/// A state: its log-likelihood, and the moves into it as (from, log weight).
type State = (f64, Vec<(usize, f64)>);

#[derive(Debug, Clone)]
struct Steps(Vec<Vec<State>>);

impl Steps {
    fn trellis(&self) -> Trellis {
        let mut trellis = Trellis::new();
        self.add_to(&mut trellis);
        trellis
    }

    fn add_to(&self, trellis: &mut Trellis) {
        for states in &self.0 {
            trellis.begin_step();
            for (log, moves) in states {
                trellis.state(*log, moves.iter().copied()).unwrap();
            }
        }
    }

    fn prefix(&self, steps: usize) -> Self {
        Self(self.0[..steps].to_vec())
    }

    /// Every possible path with its log score, summed in the order of the steps.
    fn paths(&self) -> Vec<(Vec<usize>, f64)> {
        let mut paths: Vec<(Vec<usize>, f64)> = vec![(Vec::new(), 0.0)];
        for states in &self.0 {
            let mut longer = Vec::new();
            for (path, score) in &paths {
                for (state, (log, moves)) in states.iter().enumerate() {
                    let before = path.last().copied().unwrap_or(0);
                    for &(from, weight) in moves {
                        let score = score + weight + log;
                        if from == before && score > NEVER {
                            longer.push(([&path[..], &[state]].concat(), score));
                        }
                    }
                }
            }
            paths = longer;
        }
        paths
    }

    /// First step that no path reaches.
    fn impossible_at(&self) -> Option<usize> {
        (1..=self.0.len()).find(|&step| self.prefix(step).paths().is_empty())
    }

    /// p(X_step | y_1 … y_T) by all paths.
    fn posterior(&self, step: usize) -> Vec<f64> {
        let paths = self.paths();
        let total = log_sum(paths.iter().map(|path| path.1));
        let mut posterior = vec![0.0; self.0[step - 1].len()];
        paths.iter().for_each(|(path, log)| posterior[path[step - 1]] += (log - total).exp());
        posterior
    }

    fn log_likelihood(&self) -> f64 {
        log_sum(self.paths().iter().map(|path| path.1))
    }
}

/// Up to 5 steps of up to 4 states (`least` of them at least), with missing moves, and logarithms
/// from `logs`, shifted by one of `shifts` at each step.
fn steps_of(
    least: usize,
    logs: impl Strategy<Value = f64> + Clone + 'static,
    shifts: &'static [f64],
) -> impl Strategy<Value = Steps> {
    vec(least..=4_usize, 1..=5).prop_flat_map(move |counts| {
        let steps: Vec<_> = (0..counts.len())
            .map(|k| {
                let before = if k == 0 { 1 } else { counts[k - 1] };
                let state = (
                    logs.clone(),
                    vec(prop_oneof![1 => Just(None), 3 => logs.clone().prop_map(Some)], before),
                );
                (vec(state, counts[k]), proptest::sample::select(shifts))
            })
            .collect();
        steps.prop_map(|steps| {
            let state = |shift: f64, (log, moves): (f64, Vec<Option<f64>>)| {
                let moves = moves.into_iter().enumerate();
                (log + shift, moves.filter_map(|(from, weight)| Some((from, weight?))).collect())
            };
            let step = |(states, shift): (Vec<_>, f64)| {
                states.into_iter().map(|s| state(shift, s)).collect()
            };
            Steps(steps.into_iter().map(step).collect())
        })
    })
}

/// Logarithms of probabilities, of evidence above one, and of impossible moves.
fn logs() -> impl Strategy<Value = f64> + Clone {
    prop_oneof![1 => Just(NEVER), 6 => -8.0..0.0, 1 => 0.0..5.0, 1 => -200.0..-30.0]
}

fn any_steps() -> impl Strategy<Value = Steps> {
    steps_of(0, logs(), &[0.0, 0.0, -1e5, 1e3, 300.0])
}

/// Whole numbers, whose sums are exact: many paths are equally probable.
fn steps_with_ties() -> impl Strategy<Value = Steps> {
    let whole = prop_oneof![1 => Just(NEVER), 8 => (-2..=1_i32).prop_map(f64::from)];
    steps_of(1, whole, &[0.0, -1e5, 1e3])
}

fn impossible<T: std::fmt::Debug>(result: Result<T, HmmError>) -> Option<usize> {
    match result {
        Err(HmmError::Impossible { step }) => Some(step),
        Ok(_) => None,
        Err(other) => panic!("{other}"),
    }
}

/// Order of paths: the most probable first, ties by the last state, then by the one before, and so
/// on.
fn sorted(mut paths: Vec<(Vec<usize>, f64)>) -> Vec<(Vec<usize>, f64)> {
    paths.sort_by(|a, b| b.1.total_cmp(&a.1).then_with(|| a.0.iter().rev().cmp(b.0.iter().rev())));
    paths
}

fn same_path(found: &ViterbiPath, expected: &(Vec<usize>, f64)) -> bool {
    found.states() == expected.0 && found.log_probability() == expected.1
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn equals_enumeration(steps in any_steps(), lag in 0..6_usize) {
        let (trellis, all) = (steps.trellis(), steps.0.len());
        prop_assert_eq!(trellis.steps(), all);
        let at = steps.impossible_at();
        prop_assert_eq!(impossible(trellis.smooth()), at);
        prop_assert_eq!(impossible(trellis.viterbi()), at);
        prop_assert_eq!(impossible(trellis.k_best(2)), at);
        if at.is_some() {
            return Ok(());
        }
        let smoothed = trellis.smooth().unwrap();
        close_logs(smoothed.log_likelihood(), steps.log_likelihood(), 1e-12)?;
        for step in 1..=all {
            prop_assert_eq!(trellis.states(step), steps.0[step - 1].len());
            // Logarithms of size 1e5 have 11 digits after the point.
            let filtered = steps.prefix(step).posterior(step);
            all_close(smoothed.filtered(step), &filtered, 1e-9, 1e-290)?;
            all_close(smoothed.smoothed(step), &steps.posterior(step), 1e-9, 1e-290)?;
            let lagged = steps.prefix((step + lag).min(all)).posterior(step);
            all_close(&smoothed.lagged(&trellis, step, lag), &lagged, 1e-9, 1e-290)?;
            let prefix = steps.prefix(step);
            let normalizer = prefix.log_likelihood() - steps.prefix(step - 1).log_likelihood();
            close(smoothed.log_normalizer(step), normalizer, 1e-12, 1e6)?;

            let mut into = Vec::new();
            let mut out = vec![0.0; if step > 1 { trellis.states(step - 1) } else { 1 }];
            for (state, (_, moves)) in steps.0[step - 1].iter().enumerate() {
                let found: Vec<_> = smoothed.moves(&trellis, step, state).collect();
                let order: Vec<_> = found.iter().map(|pair| pair.0).collect();
                prop_assert_eq!(order, moves.iter().map(|pair| pair.0).collect::<Vec<_>>());
                into.push(found.iter().map(|pair| pair.1).sum::<f64>());
                found.iter().for_each(|pair| out[pair.0] += pair.1);
            }
            all_close(&into, smoothed.smoothed(step), 1e-9, 1e-200)?;
            let before = if step > 1 { smoothed.smoothed(step - 1) } else { &[1.0] };
            all_close(&out, before, 1e-9, 1e-200)?;
        }
        all_close(smoothed.filtered(all), smoothed.smoothed(all), 1e-14, 1e-290)?;
        prop_assert_eq!(&smoothed.lagged(&trellis, 1, usize::MAX), &smoothed.lagged(&trellis, 1, all));

        let best = steps.paths().iter().map(|path| path.1).fold(NEVER, f64::max);
        let path = trellis.viterbi().unwrap();
        close_logs(path.log_probability(), best, 1e-12)?;
        // The path is possible, and as probable as stated.
        let score = steps.paths().iter().find(|other| other.0 == path.states()).map(|path| path.1);
        close_logs(score.unwrap_or(NEVER), best, 1e-12)?;
    }

    #[test]
    fn best_paths_equal_enumeration(steps in steps_with_ties(), count in 0..20_usize) {
        let trellis = steps.trellis();
        if steps.impossible_at().is_some() {
            prop_assert!(trellis.viterbi().is_err());
            return Ok(());
        }
        let expected = sorted(steps.paths());
        prop_assert!(same_path(&trellis.viterbi().unwrap(), &expected[0]));
        let found = trellis.k_best(count).unwrap();
        prop_assert_eq!(found.len(), count.min(expected.len()));
        for (found, expected) in found.iter().zip(&expected) {
            prop_assert!(same_path(found, expected), "{found:?}, expected {expected:?}");
        }
        prop_assert_eq!(trellis.k_best(100_000).unwrap().len(), expected.len());
    }

    #[test]
    fn first_of_the_best_is_the_best(steps in any_steps()) {
        let trellis = steps.trellis();
        if steps.impossible_at().is_none() {
            let best = trellis.k_best(3).unwrap();
            prop_assert_eq!(&best[0], &trellis.viterbi().unwrap());
            let in_order = best.windows(2).all(|pair| {
                pair[0].log_probability() >= pair[1].log_probability()
                    && pair[0].states() != pair[1].states()
            });
            prop_assert!(in_order, "{best:?}");
        }
    }

    #[test]
    fn a_constant_changes_the_likelihood_alone(
        steps in steps_with_ties(), which in 0..5_usize, constant in -1000..1000_i32,
    ) {
        let constant = f64::from(constant);
        let mut moved = steps.clone();
        let which = which % steps.0.len();
        moved.0[which].iter_mut().for_each(|state| state.0 += constant);
        let [before, after] = [&steps, &moved].map(Steps::trellis);
        let (Ok(a), Ok(b)) = (before.smooth(), after.smooth()) else {
            prop_assert_eq!(steps.impossible_at(), moved.impossible_at());
            return Ok(());
        };
        close(b.log_likelihood(), a.log_likelihood() + constant, 1e-12, 1e3)?;
        for step in 1..=steps.0.len() {
            all_close(b.filtered(step), a.filtered(step), 1e-9, 1e-290)?;
            all_close(b.smoothed(step), a.smoothed(step), 1e-9, 1e-290)?;
        }
        let [a, b] = [before, after].map(|trellis| trellis.viterbi().unwrap());
        prop_assert_eq!(a.states(), b.states());
        prop_assert_eq!(a.log_probability() + constant, b.log_probability());
    }

    #[test]
    fn bad_values_leave_the_trellis_as_it_was(
        steps in steps_with_ties(), bad in prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(2e300), Just(-2e300)],
        good_moves in 0..3_usize,
    ) {
        let mut trellis = steps.trellis();
        let before = trellis.clone();
        let last = steps.0.len();
        let states = if last > 1 { trellis.states(last - 1) } else { 1 };
        let good = std::iter::repeat_n((0, -1.0), good_moves);
        let value = |result| match result {
            Err(HmmError::TrellisValue { step, value }) => {
                step == last && value.to_bits() == bad.to_bits()
            }
            _ => false,
        };
        prop_assert!(value(trellis.state(bad, good.clone())));
        prop_assert_eq!(&trellis, &before);
        prop_assert!(value(trellis.state(0.0, good.clone().chain([(0, bad)]))));
        prop_assert_eq!(&trellis, &before);
        let result = trellis.state(0.0, good.chain([(states, 0.0)]));
        let named = matches!(
            result,
            Err(HmmError::TrellisState { step, from, states: found })
                if (step, from, found) == (last, states, states)
        );
        prop_assert!(named, "{result:?}");
        prop_assert_eq!(&trellis, &before);
        trellis.state(NEVER, [(0, NEVER)]).unwrap();
        prop_assert_eq!(trellis.states(last), before.states(last) + 1);
    }

    #[test]
    fn equals_an_ordinary_model(model in models(Kind::Shifted)) {
        let ys = &model.logs;
        let first: Vec<f64> = match model.at_first {
            true => model.prior.clone(),
            false if ys.is_empty() => return Ok(()),
            false => {
                let predicted = |row: &Vec<f64>| row.iter().zip(&model.prior).map(|(a, p)| a * p).sum();
                model.matrices[0].iter().map(predicted).collect()
            }
        };
        let mut trellis = Trellis::new();
        for (k, y) in ys.iter().enumerate() {
            trellis.begin_step();
            for i in 0..model.states {
                let log = y.as_ref().map_or(0.0, |logs| logs[i]);
                let prior = [(0, first[i].ln())];
                let row = model.matrices[k][i].iter().map(|a| a.ln()).enumerate();
                if k == 0 { trellis.state(log, prior) } else { trellis.state(log, row) }.unwrap();
            }
        }
        let hmm = model.hmm(model.sparse());
        let controls = model.controls();
        let drive = Controlled::new(&controls, ys).unwrap();
        let (Ok(expected), Ok(found)) = (hmm.smooth(&drive), trellis.smooth()) else {
            prop_assert_eq!(impossible(hmm.smooth(&drive)), impossible(trellis.smooth()));
            return Ok(());
        };
        close_logs(found.log_likelihood(), expected.log_likelihood(), 1e-12)?;
        for step in 1..=ys.len() {
            let smoothed = expected.posteriors().get(step).unwrap();
            all_close(found.smoothed(step), smoothed.as_slice(), 1e-9, 1e-290)?;
        }
        let (found, path) = (trellis.viterbi().unwrap(), hmm.viterbi(&drive).unwrap());
        close_logs(found.log_probability(), path.log_probability(), 1e-12)?;
        let second = trellis.k_best(2).unwrap();
        let margin = second.get(1).map_or(f64::INFINITY, |second| {
            found.log_probability() - second.log_probability()
        });
        if margin > 1e-6 {
            prop_assert_eq!(found.states(), path.states());
        }
    }

    #[test]
    fn a_cleared_trellis_is_a_new_one(first in any_steps(), second in any_steps()) {
        let mut trellis = first.trellis();
        trellis.clear();
        prop_assert_eq!(&trellis, &Trellis::new());
        second.add_to(&mut trellis);
        prop_assert_eq!(trellis, second.trellis());
    }
}

#[test]
fn no_steps() {
    for trellis in [Trellis::new(), Trellis::default()] {
        assert_eq!((trellis.steps(), trellis.states(0), trellis.states(1)), (0, 0, 0));
        assert_eq!(trellis.smooth().unwrap().log_likelihood(), 0.0);
        let path = trellis.viterbi().unwrap();
        assert_eq!((path.states(), path.log_probability()), (&[][..], 0.0));
        assert_eq!(trellis.k_best(3).unwrap(), [path]);
    }
}

#[test]
fn default_is_new() {
    let mut trellis = Trellis::default();
    trellis.begin_step();
    trellis.state(-1.0, [(0, -2.0)]).unwrap();
    assert_eq!(trellis.smooth().unwrap().log_likelihood(), -3.0);
}

#[test]
fn a_state_without_a_step_is_an_error() {
    let mut trellis = Trellis::new();
    assert!(matches!(trellis.state(0.0, []), Err(HmmError::TrellisStep)));
    assert!(matches!(trellis.state(0.0, [(0, 0.0)]), Err(HmmError::TrellisStep)));
    assert_eq!(trellis, Trellis::new());
}

#[test]
fn a_step_without_states_is_impossible() {
    let mut trellis = Trellis::new();
    trellis.begin_step();
    trellis.state(0.0, [(0, 0.0)]).unwrap();
    trellis.begin_step();
    trellis.begin_step();
    assert_eq!(impossible(trellis.smooth()), Some(2));
    assert_eq!(impossible(trellis.viterbi()), Some(2));
    assert_eq!(impossible(trellis.k_best(1)), Some(2));
    assert_eq!(impossible(trellis.k_best(0)), Some(2));
}

/// A request for no paths returns none; impossible observations are an error as for one path or
/// many.
#[test]
fn no_path_of_an_impossible_model_is_an_error() {
    let table = TableLikelihood::from_rows(&[[1.0, 0.0], [1.0, 0.0]]).unwrap();
    let prior = Prior::AtFirstObservation(Belief::uniform(2).unwrap());
    let still = DenseTransition::from_rows(&[[1.0, 0.0], [0.0, 1.0]]).unwrap();
    let hmm = Hmm::new(prior, still, table).unwrap();
    for ys in [&[][..], &[0, 0, 0], &[0, 1, 0], &[1]] {
        let mut trellis = Trellis::new();
        for (k, y) in ys.iter().enumerate() {
            trellis.begin_step();
            for state in 0..2 {
                let log = if *y == 0 { 0.0 } else { NEVER };
                let before = if k == 0 { 0 } else { state };
                trellis.state(log, [(before, 0.0)]).unwrap();
            }
        }
        for count in 0..3 {
            let (one, other) = (hmm.k_best(ys, count), trellis.k_best(count));
            same_answers(&one, &other);
            assert_eq!(impossible(one), ys.iter().position(|y| *y == 1).map(|k| k + 1));
        }
    }
}

/// The same number of paths, or the same error.
fn same_answers(
    one: &Result<Vec<ViterbiPath>, HmmError>,
    other: &Result<Vec<ViterbiPath>, HmmError>,
) {
    let say = |result: &Result<Vec<ViterbiPath>, HmmError>| {
        result.as_ref().map(Vec::len).map_err(ToString::to_string)
    };
    assert_eq!(say(one), say(other));
}

/// Differences of 1e-7 between likelihoods, weights or both, after one of e^1e11, as in a model
/// with the same evidence.
#[test]
fn small_differences_survive_what_came_before() {
    for (common, weight) in [(1e11, 0.0), (-1e11, 0.0), (0.0, 1e11), (0.0, -1e11), (1e11, -2e11)] {
        let mut trellis = Trellis::new();
        for step in 0..6 {
            let large = if step == 2 { (common, weight) } else { (0.0, 0.0) };
            trellis.begin_step();
            for state in 0..2 {
                // State 1 is better by 1e-7 at steps 2 and 5, and both states keep to themselves.
                let better = if state == 1 && step % 3 == 1 { 1e-7 } else { 0.0 };
                let before = if step == 0 { 0 } else { state };
                trellis.state(better + large.0, [(before, large.1)]).unwrap();
            }
            trellis.state(1e12, [(0, NEVER)]).unwrap(); // unreachable
        }
        let case = format!("{common} {weight}");
        let best = trellis.viterbi().unwrap();
        assert_eq!(best.states(), [1; 6], "{case}");
        let both = trellis.k_best(5).unwrap();
        assert_eq!(both.len(), 2);
        assert_eq!(both[0], best);
        assert_eq!(both[1].states(), [0; 6]);
        let total = common + weight;
        assert!((best.log_probability() - total).abs() <= 1e-15 * total.abs(), "{case}");
        let smoothed = trellis.smooth().unwrap();
        for step in 1..=6 {
            let gained = if step < 2 {
                0.0
            } else if step < 5 {
                1e-7
            } else {
                2e-7
            };
            let p = smoothed.filtered(step);
            assert!(((p[1] / p[0]).ln() - gained).abs() < 1e-14, "{case} {step}: {p:?}");
            let p = smoothed.smoothed(step);
            assert!(((p[1] / p[0]).ln() - 2e-7).abs() < 1e-14, "{case} {step}: {p:?}");
            let lagged = smoothed.lagged(&trellis, 1, step);
            let gained = if step < 4 { 1e-7 } else { 2e-7 };
            assert!(((lagged[1] / lagged[0]).ln() - gained).abs() < 1e-14, "{case} {step}");
            let moves = (0..3).flat_map(|i| smoothed.moves(&trellis, step, i));
            let sum: f64 = moves.map(|entry| entry.1).sum();
            assert!((sum - 1.0).abs() < 1e-13, "{case} {step}: {sum}");
        }
        let log = total + 2.0_f64.ln() + 1e-7;
        assert!((smoothed.log_likelihood() - log).abs() <= 1e-15 * log.abs().max(1.0), "{case}");
    }
}

/// Steps that cancel in pairs of ±1e11.
#[test]
fn a_sum_that_cancels_keeps_its_digits() {
    let mut trellis = Trellis::new();
    for step in 0..10_000 {
        trellis.begin_step();
        let log = if step % 2 == 0 { 1e11 } else { -1e11 };
        trellis.state(log, [(0, -0.125 - 1e-9)]).unwrap();
    }
    let expected = -1250.0 - 1e-5;
    let logs = [
        trellis.viterbi().unwrap().log_probability(),
        trellis.k_best(1).unwrap()[0].log_probability(),
        trellis.smooth().unwrap().log_likelihood(),
    ];
    assert!(logs.iter().all(|log| (log - expected).abs() < 1e-11), "{logs:?}");
}

#[test]
fn a_small_difference_survives_a_large_likelihood() {
    // 1e-12 is below the last digit of 1e5: paths that differ by it are told apart before.
    let mut trellis = Trellis::new();
    trellis.begin_step();
    trellis.state(-1e-12, [(0, 0.0)]).unwrap();
    trellis.state(0.0, [(0, 0.0)]).unwrap();
    trellis.begin_step();
    trellis.state(-1e5, [(0, 0.0), (1, 0.0)]).unwrap();
    let best = trellis.viterbi().unwrap();
    assert_eq!(best.states(), [1, 0]);
    assert_eq!(trellis.k_best(1).unwrap(), [best]);
}

#[test]
fn long_trellis_keeps_its_digits() {
    // Two states that stay or change, 20,000 steps, likelihoods of e^-1000.
    let mut trellis = Trellis::new();
    let (stay, change) = (0.9_f64.ln(), 0.1_f64.ln());
    for k in 0..20_000 {
        trellis.begin_step();
        for i in 0..2 {
            let moves =
                [(0, if i == 0 { stay } else { change }), (1, if i == 0 { change } else { stay })];
            let count = if k == 0 { 1 } else { 2 };
            trellis.state(-1000.0, moves.into_iter().take(count)).unwrap();
        }
    }
    let smoothed = trellis.smooth().unwrap();
    let expected = -1000.0 * 20_000.0;
    assert!((smoothed.log_likelihood() - expected).abs() < 1e-6, "{}", smoothed.log_likelihood());
    assert!(smoothed.smoothed(10_000).iter().all(|p| (p - 0.5).abs() < 1e-9));
}
