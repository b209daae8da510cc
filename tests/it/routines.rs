//! Smoothers, decoders and samplers against the enumeration of all paths.

use proptest::prelude::*;
use wayfix::inference::Order;
use wayfix::transition::SwitchedTransition;
use wayfix::{Hmm, SparseTransition};

use crate::kit::{
    Kind, Model, Sensor, cases, check_drawn, check_entropy, check_fixed_lag, check_frequencies,
    check_k_best, check_pairs, dyadic_models, models, possible, ranked, rng,
};

fn sparse(model: &Model) -> Hmm<SwitchedTransition<SparseTransition>, Sensor> {
    model.hmm(model.sparse())
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
