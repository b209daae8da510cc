//! Invalid generators and times.

use wayfix::transition::{LearnTransition, Move, MoveCounts};
use wayfix::{Belief, Hmm, HmmError, LikelihoodVector, Prior, Transition};
use wayfix_learn::GeneratorTransition;

use crate::kit::text;

#[test]
fn bad_rates_are_named() {
    let made = |n, rates: &[(usize, usize, f64)]| {
        text(GeneratorTransition::from_triplets(n, rates.iter().copied()))
    };
    assert_eq!(made(0, &[]), "a transition operator needs at least one state, found none");
    assert_eq!(
        made(2, &[(2, 0, 1.0)]),
        "the transition from state 0 to state 2 is out of range, there are 2 states (0 to 1)"
    );
    for (rate, shown) in [(-1.0, "-1"), (f64::NAN, "NaN"), (f64::INFINITY, "inf")] {
        assert_eq!(
            made(2, &[(1, 0, rate)]),
            format!(
                "the transition from state 0 to state 1 has rate {shown}, expected a finite value of at least 0"
            )
        );
    }
    assert_eq!(
        made(2, &[(1, 1, -2.0)]),
        "the rate from state 1 to itself is -2, expected none: the rates to other states say when a state is left"
    );
    assert_eq!(
        made(3, &[(1, 0, 1.0), (2, 0, 1.0), (1, 0, 0.5)]),
        "the transition from state 0 to state 1 is given twice"
    );
    assert_eq!(
        made(3, &[(1, 0, 1e308), (2, 0, 1e308)]),
        "the sum of the rates out of state 0 is inf, expected at most 1.4e308"
    );
    assert_eq!(
        made(2, &[(1, 0, 1e-100), (0, 1, 1e220)]),
        "the rate from state 0 to state 1 is 1e-100, expected at least 2.2e-308 of 1.25 times the largest sum of rates out of a state"
    );
    let fine =
        GeneratorTransition::from_triplets(2, [(1, 0, 0.5), (0, 0, 0.0), (0, 1, 0.0)]).unwrap();
    assert_eq!(fine.triplets().collect::<Vec<_>>(), [(1, 0, 0.5)]);
    assert_eq!(
        (fine.rate(1, 0), fine.rate(0, 1), fine.rate(0, 9), fine.rate(9, 0)),
        (0.5, 0.0, 0.0, 0.0)
    );
    assert_eq!((fine.exit_rate(0), fine.exit_rate(1), fine.exit_rate(2)), (0.5, 0.0, 0.0));
    assert_eq!(format!("{fine:?}"), "GeneratorTransition { states: 2, moves: 1, .. }");
}

#[test]
fn bad_times_leave_a_filter_as_it_is() {
    let a = GeneratorTransition::from_triplets(2, [(1, 0, 2.0), (0, 1, 1.0)]).unwrap();
    let prior = Prior::BeforeFirstTransition(Belief::certain(2, 0).unwrap());
    let hmm = Hmm::new(prior, a, LikelihoodVector::linear(2)).unwrap();
    let mut filter = hmm.filter();
    filter.step_with(&0.5, &[0.5, 0.4]).unwrap();
    let before = filter.snapshot();
    for time in [-1.0, f64::NAN, f64::INFINITY, 1e308] {
        let error = filter.step_with(&time, &[0.5, 0.4]).unwrap_err();
        assert!(matches!(error, HmmError::Control { .. }), "{error}");
        assert!(error.to_string().contains("a time step of"), "{error}");
        assert_eq!(filter.snapshot(), before);
    }
    // The longest and the shortest times.
    for time in [7e307, 1e300, 5e-324, 0.0] {
        filter.step_with(&time, &[0.5, 0.5]).unwrap();
    }
    assert!((filter.belief().as_slice()[0] - 1.0 / 3.0).abs() < 1e-14);
    // Many states, with as many products as a year of seconds takes.
    let large = GeneratorTransition::from_triplets(600, [(1, 0, 1.0)]).unwrap();
    assert!(large.check_control(&3e7).is_ok());
    assert_eq!(
        text(large.check_control(&1e9)),
        "a time step of 1000000000, expected at most 8.589934592e8 at these rates"
    );
}

#[test]
fn statistics_of_another_operator_are_refused() {
    let a = GeneratorTransition::from_triplets(2, [(1, 0, 2.0)]).unwrap();
    let b = GeneratorTransition::from_triplets(3, [(1, 0, 2.0)]).unwrap();
    assert_eq!(
        text(a.maximize(&b.statistics(), 0.0)),
        "the number of states and moves in the statistics is 4, expected as many as the operator has"
    );
    let forbidden = |time: f64, from: usize, to: usize| {
        let mut sums = a.statistics();
        let moves = [Move { from, to, weight: 1.0 }];
        a.counts(&mut sums, &time).unwrap().merge(&MoveCounts::from_moves(moves));
        text(a.maximize(&sums, 0.0))
    };
    let message = |from: usize, to: usize| {
        format!(
            "the move from state {from} to state {to} is forbidden, the transition operator has no such entry"
        )
    };
    assert_eq!(forbidden(1.0, 1, 0), message(1, 0));
    assert_eq!(forbidden(0.0, 0, 1), message(0, 1));
    assert_eq!(forbidden(1.0, 0, 7), message(0, 7));
    assert_eq!(forbidden(1.0, 7, 0), message(7, 0));
    // After no time, nothing has changed.
    let kept = a.maximize(&a.statistics(), 0.0).unwrap();
    assert_eq!(kept.rate(1, 0), 2.0);
}
