//! Moves given by a multinomial logit of inputs.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::inference::{LabelledSequence, LearningOptions};
use wayfix::transition::{LearnTransition, Move, MoveCounts};
use wayfix::{
    Belief, Controlled, Hmm, LikelihoodVector, Prior, SparseTransition, TableLikelihood,
    Transition, TransitionError,
};
use wayfix_learn::{InputCounts, LogitTransition};

use crate::kit::{
    Expected, Matrix, any_stochastic, assert_operator, cases, close, matrix, prior, rng, sparse,
    switched,
};

/// An operator with these moves and slopes, `slopes[to][from]`, and some of them shared.
fn logit(m: &Matrix, slopes: &[Vec<[f64; 2]>], shared: bool) -> LogitTransition {
    let mut a = LogitTransition::new(&sparse(m), 2).unwrap();
    if shared {
        a = a.with_shared_slopes(|from, to| (from != to).then_some((from + to) % 2));
    }
    for (from, to) in a.moves().collect::<Vec<_>>() {
        if a.slope_group(from, to).is_some() {
            a = a.with_slopes(from, to, &slopes[to][from]).unwrap();
        }
    }
    a
}

/// The matrix by definition, from the coefficients that the operator returns.
fn at(a: &LogitTransition, inputs: &[f64]) -> Matrix {
    let n = a.states();
    let score = |to: usize, from: usize| {
        let slopes = a.slopes(from, to)?.iter().zip(inputs);
        Some(a.intercept(from, to)? + slopes.map(|(b, u)| b * u).sum::<f64>())
    };
    matrix(n, |to, from| {
        let Some(own) = score(to, from) else { return 0.0 };
        let all = (0..n).filter_map(|other| score(other, from));
        1.0 / all.map(|score| (score - own).exp()).sum::<f64>()
    })
}

fn numbers() -> impl Strategy<Value = [f64; 2]> {
    (-3.0..3.0, prop_oneof![1 => Just(0.0), 3 => -1.0..1.0]).prop_map(|(a, b)| [a, b])
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn logits_equal_their_definition(
        m in any_stochastic(false, 6),
        slopes in vec(vec(numbers(), 6), 6),
        inputs in vec(vec(-2.0..2.0, 2), 3),
        shared in any::<bool>(),
    ) {
        let a = logit(&m, &slopes, shared);
        let matrices: Vec<Matrix> = inputs.iter().map(|inputs| at(&a, inputs)).collect();
        assert_operator(a, Expected::each(&inputs, &matrices))?;
    }

    /// At inputs of 0, the moves have the probabilities that the operator was made from.
    #[test]
    fn at_no_input_it_is_the_operator_it_was_made_from(m in any_stochastic(false, 6)) {
        let a = LogitTransition::new(&sparse(&m), 1).unwrap();
        let back = a.at(&[0.0]).unwrap();
        for (from, column) in (0..m.len()).flat_map(|from| (0..m.len()).map(move |to| (from, to))) {
            close(back.get(column, from), m[column][from], 1e-12, 1e-300)?;
        }
    }
}

/// Steps (inputs, from, to, weight) as statistics.
fn counts(steps: &[(Vec<f64>, usize, usize, f64)]) -> InputCounts {
    let mut counts = InputCounts::default();
    for (inputs, from, to, weight) in steps {
        let m = Move { from: *from, to: *to, weight: *weight };
        counts.add(inputs, &MoveCounts::from_moves([m]));
    }
    counts
}

/// ln p of the moves and of the coefficients: the objective.
fn objective(a: &LogitTransition, counts: &InputCounts, pseudo_count: f64) -> f64 {
    let moves = counts.rows().flat_map(|(inputs, moves)| {
        let m = at(a, inputs);
        moves.moves().map(move |step| step.weight * m[step.to][step.from].ln())
    });
    moves.sum::<f64>() + a.log_prior(pseudo_count)
}

/// Gradient of the objective: of the intercepts of all moves, and of each row of slopes.
fn gradient(
    a: &LogitTransition,
    counts: &InputCounts,
    pseudo_count: f64,
) -> (Vec<f64>, Vec<[f64; 2]>) {
    let all: Vec<(usize, usize)> = a.moves().collect();
    let groups = all.iter().filter_map(|m| a.slope_group(m.0, m.1)).max().map_or(0, |g| g + 1);
    let (mut of_moves, mut of_slopes) = (vec![0.0; all.len()], vec![[0.0; 2]; groups]);
    let prior = MoveCounts::from_moves(all.iter().map(|&(from, to)| Move {
        from,
        to,
        weight: pseudo_count,
    }));
    for (inputs, moves) in counts.rows().chain([(&[0.0, 0.0][..], &prior)]) {
        let m = at(a, inputs);
        for (slot, &(from, to)) in of_moves.iter_mut().zip(&all) {
            let out: f64 = moves.moves().filter(|m| m.from == from).map(|m| m.weight).sum();
            let residual = moves.get(from, to) - out * m[to][from];
            *slot += residual;
            if let Some(group) = a.slope_group(from, to) {
                (0..2).for_each(|k| of_slopes[group][k] += residual * inputs[k]);
            }
        }
    }
    for &(from, to) in &all {
        if let Some(group) = a.slope_group(from, to)
            && all.iter().find(|m| a.slope_group(m.0, m.1) == Some(group)) == Some(&(from, to))
        {
            let slopes = a.slopes(from, to).unwrap();
            (0..2).for_each(|k| of_slopes[group][k] -= a.ridge() * slopes[k]);
        }
    }
    (of_moves, of_slopes)
}

proptest! {
    #![proptest_config(cases())]

    /// Checks the maximum for any moves, including coefficients without a finite maximum.
    #[test]
    fn learning_ends_where_the_gradient_vanishes(
        m in any_stochastic(false, 4),
        slopes in vec(vec(numbers(), 4), 4),
        steps in vec((vec(prop_oneof![-1.0..1.0, Just(0.0), Just(1.0)], 2), 0..4_usize, 0..4_usize, 0.1..4.0), 0..30),
        shared in any::<bool>(),
        ridge in prop_oneof![Just(0.0), 0.01..2.0],
        pseudo_count in prop_oneof![Just(0.0), 0.01..2.0],
    ) {
        let a = logit(&m, &slopes, shared).with_ridge(ridge).unwrap();
        let n = m.len();
        let legal = steps.into_iter().filter(|s| s.1 < n && s.2 < n && m[s.2][s.1] > 0.0);
        let counts = counts(&legal.collect::<Vec<_>>());
        let learned = a.maximize(&counts, pseudo_count).unwrap();
        let before = objective(&a, &counts, pseudo_count);
        let after = objective(&learned, &counts, pseudo_count);
        prop_assert!(after >= before - 1e-12 * before.abs(), "{before} to {after}");
        let (of_moves, of_slopes) = gradient(&learned, &counts, pseudo_count);
        for slope in of_moves.iter().chain(of_slopes.iter().flatten()) {
            prop_assert!(slope.abs() < 3e-5, "{of_moves:?} {of_slopes:?} at {learned:?}");
        }
        // No step gains anything, or little if coefficients run to infinity at very different
        // rates.
        let again = objective(&learned.maximize(&counts, pseudo_count).unwrap(), &counts, pseudo_count);
        close(again, after, 1e-7, 1.0)?;
        if ridge > 0.0 && pseudo_count > 0.0 {
            prop_assert_eq!(learned.separated(&counts, pseudo_count).unwrap(), []);
        }
    }

    /// A category, with one input for each value (one of them redundant), gives a matrix of
    /// relative frequencies for each value, in any units.
    #[test]
    fn categories_are_relative_frequencies(
        weights in vec(vec(vec(0.1..5.0, 3), 3), 4),
        unit in prop_oneof![Just(1.0), Just(1e-9), Just(1e12)],
        offset in prop_oneof![Just(0.0), Just(100.0)],
    ) {
        let row = |value: usize| -> Vec<f64> {
            (0..4).map(|k| unit * (offset + f64::from(k == value))).collect()
        };
        let mut steps = Vec::new();
        for (value, columns) in weights.iter().enumerate() {
            for (from, column) in columns.iter().enumerate() {
                steps.extend((0..3).map(|to| (row(value), from, to, column[to])));
            }
        }
        let third = SparseTransition::from_rows(&[[1.0 / 3.0; 3]; 3]).unwrap();
        let a = LogitTransition::new(&third, 4).unwrap();
        let learned = a.maximize(&counts(&steps), 0.0).unwrap();
        for (value, columns) in weights.iter().enumerate() {
            let found = learned.at(&row(value)).unwrap();
            for (from, column) in columns.iter().enumerate() {
                for (to, weight) in column.iter().enumerate() {
                    let expected = weight / column.iter().sum::<f64>();
                    close(found.get(to, from), expected, 1e-10, 1e-300)?;
                }
            }
        }
    }

    /// Expected moves are those of one matrix for each row of inputs, and are listed by these rows;
    /// no iteration lowers the objective.
    #[test]
    fn expected_moves_are_those_of_matrices(
        m in any_stochastic(false, 4),
        slopes in vec(vec(numbers(), 4), 4),
        rows in vec(vec(-2.0..2.0, 2), 3),
        sequences in vec(vec((0..3_usize, 0..2_usize), 1..6), 1..4),
        shared in any::<bool>(),
        ridge in prop_oneof![Just(0.0), 0.01..2.0],
        transition_pseudo_count in prop_oneof![Just(0.0), 0.01..2.0],
    ) {
        let n = m.len();
        let a = logit(&m, &slopes, shared).with_ridge(ridge).unwrap();
        let matrices: Vec<Matrix> = rows.iter().map(|row| at(&a, row)).collect();
        let table: Vec<[f64; 2]> =
            (0..n).map(|i| [0.2 + 0.15 * i as f64, 0.8 - 0.15 * i as f64]).collect();
        let table = TableLikelihood::from_rows(&table).unwrap();
        let prior = || prior(&vec![1.0 / n as f64; n], false);
        let own = Hmm::new(prior(), a, table.clone()).unwrap();
        let other = Hmm::new(prior(), switched(&matrices), table).unwrap();
        let symbols: Vec<Vec<usize>> =
            sequences.iter().map(|s| s.iter().map(|step| step.1).collect()).collect();
        let numbers: Vec<Vec<usize>> =
            sequences.iter().map(|s| s.iter().map(|step| step.0).collect()).collect();
        let inputs: Vec<Vec<Vec<f64>>> =
            numbers.iter().map(|s| s.iter().map(|u| rows[*u].clone()).collect()).collect();
        let driven: Vec<_> =
            inputs.iter().zip(&symbols).map(|(u, y)| Controlled::new(u, y).unwrap()).collect();
        let by_number: Vec<_> =
            numbers.iter().zip(&symbols).map(|(u, y)| Controlled::new(u, y).unwrap()).collect();
        let (expected, failed) = other.expectations(&by_number);
        prop_assert!(failed.is_empty());
        let (found, failed) = own.expectations(&driven);
        prop_assert!(failed.is_empty());
        close(found.log_likelihood(), expected.log_likelihood(), 1e-12, 1e-12)?;
        for (u, row) in rows.iter().enumerate() {
            let seen = found.moves().rows().find(|found| found.0 == row);
            prop_assert_eq!(seen.is_some(), expected.moves()[u].moves().len() > 0);
            for m in expected.moves()[u].moves() {
                close(seen.unwrap().1.get(m.from, m.to), m.weight, 1e-10, 1e-12)?;
            }
        }
        let learning = LearningOptions::default().with_iterations(8).with_tolerance(0.0).with_transition_pseudo_count(transition_pseudo_count);
        let learned = own.learn(&driven, &learning).unwrap();
        let rises = learned.objectives().windows(2);
        for pair in rises {
            prop_assert!(pair[1] >= pair[0] - 1e-11 * pair[0].abs().max(1.0), "{pair:?}");
        }
    }
}

/// Newton's steps along a direction where coefficients run to infinity are too long: shortened
/// steps come close.
#[test]
fn inputs_that_nearly_separate_moves_are_climbed() {
    let a = SparseTransition::from_triplets(2, [(0, 0, 0.5), (1, 0, 0.5), (0, 1, 1.0)]).unwrap();
    let a = LogitTransition::new(&a, 2).unwrap().with_slopes(0, 1, &[1.63, -0.56]).unwrap();
    let steps = [
        (vec![1.0, 0.0], 0, 0, 2.465),
        (vec![0.0, -0.020_566], 0, 1, 2.808),
        (vec![-0.983_35, 1.0], 0, 1, 0.283),
        (vec![-0.438_33, 0.920_1], 0, 0, 0.515_3),
    ];
    let counts = counts(&steps);
    let learned = a.maximize(&counts, 0.051_835).unwrap();
    // Everything but the pseudo-counts is explained, and these are equal.
    let most = 2.0 * 0.051_835 * 0.5_f64.ln();
    assert!((objective(&learned, &counts, 0.051_835) - most).abs() < 1e-9);
}

fn two() -> LogitTransition {
    LogitTransition::new(&sparse(&vec![vec![0.5, 0.25], vec![0.5, 0.75]]), 2).unwrap()
}

#[test]
fn coefficients_are_set_and_read() {
    let a = two().with_slopes(0, 1, &[1.0, -2.0]).unwrap().with_intercept(1, 0, -0.5).unwrap();
    assert_eq!((a.inputs(), a.ridge(), a.free_parameters()), (2, 0.0, 6));
    assert_eq!(
        (a.intercept(0, 0), a.intercept(0, 1), a.intercept(1, 0)),
        (Some(0.0), Some(0.0), Some(-0.5))
    );
    assert_eq!((a.slopes(0, 0), a.slopes(0, 1)), (Some(&[][..]), Some(&[1.0, -2.0][..])));
    assert_eq!((a.slopes(0, 2), a.intercept(2, 0), a.reference(2)), (None, None, None));
    assert_eq!(
        (a.slope_group(0, 0), a.slope_group(0, 1), a.slope_group(1, 0)),
        (None, Some(0), Some(1))
    );
    assert_eq!((a.reference(0), a.reference(1)), (Some(0), Some(1)));
    let around =
        SparseTransition::from_triplets(3, [(1, 0, 0.5), (2, 0, 0.5), (0, 1, 1.0), (0, 2, 1.0)]);
    let around = LogitTransition::new(&around.unwrap(), 3).unwrap();
    assert_eq!((around.reference(0), around.free_parameters()), (Some(1), 1 + 3));
    // Equal slopes on all moves have no effect; if some moves have none, they do.
    let shared =
        |all: bool| two().with_shared_slopes(move |from, to| (all || from != to).then_some(7));
    assert_eq!((shared(true).free_parameters(), shared(false).free_parameters()), (2, 4));
    let other = wayfix::ReorderStates::reordered(&a, &[1, 0]);
    let (m, swapped) = (a.at(&[0.3, -0.7]).unwrap(), other.at(&[0.3, -0.7]).unwrap());
    for (to, from) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
        assert_eq!(m.get(to, from).to_bits(), swapped.get(1 - to, 1 - from).to_bits());
    }
}

#[test]
fn what_is_not_valid_says_where() {
    let error = |result: Result<LogitTransition, TransitionError>| result.unwrap_err().to_string();
    let still = sparse(&vec![vec![0.5, 0.25], vec![0.5, 0.75]]);
    assert_eq!(
        error(LogitTransition::new(&still, 0)),
        "the number of inputs is 0, expected at least 1"
    );
    assert_eq!(
        error(two().with_intercept(0, 1, f64::NAN)),
        "the intercept of the move from state 0 to state 1 is NaN, expected a value from -1e300 to 1e300",
    );
    assert_eq!(
        error(two().with_slopes(1, 0, &[0.0, f64::INFINITY])),
        "the slope of the move from state 1 to state 0 on input 1 is inf, expected a value from -1e300 to 1e300",
    );
    assert_eq!(
        error(two().with_slopes(0, 1, &[0.0])),
        "the number of slopes given for the move from state 0 to state 1 is 1, expected the number of inputs",
    );
    assert_eq!(
        error(two().with_slopes(1, 1, &[0.0, 0.0])),
        "the number of slopes given for the move from state 1 to state 1 is 2, expected 0, as the move has none",
    );
    assert_eq!(error(two().with_slopes(0, 2, &[])), error(two().with_intercept(0, 2, 0.0)));
    assert_eq!(
        error(two().with_ridge(-1.0)),
        "the precision of the ridge is -1, expected a finite value of at least 0",
    );
    let a = two().with_slopes(0, 1, &[1e200, 0.0]).unwrap();
    let refused = |inputs: &[f64], expected: &str| {
        assert_eq!(a.check_control(&inputs.to_vec()).unwrap_err().to_string(), expected);
        assert_eq!(a.at(inputs).unwrap_err().to_string(), expected);
        let step = counts(&[(inputs.to_vec(), 0, 1, 1.0)]);
        assert_eq!(a.maximize(&step, 0.0).unwrap_err().to_string(), expected);
    };
    refused(&[1.0], "1 inputs given, expected 2");
    refused(&[1.0, f64::NAN], "input 1 is NaN, expected a finite value");
    refused(&[f64::NEG_INFINITY, 1.0], "input 0 is -inf, expected a finite value");
    refused(&[1e150, 1.0], "input 0 is 1e150, with which log-odds of moves may exceed 1e300");
    let wrong = |from, to, weight| {
        two().maximize(&counts(&[(vec![0.0, 0.0], from, to, weight)]), 0.0).unwrap_err().to_string()
    };
    assert!(wrong(0, 5, 1.0).starts_with("the move from state 0 to state 5 is forbidden"));
    assert!(wrong(0, 1, f64::NAN).contains("has weight NaN"));
}

/// Log-odds of 900, and of 1e299: a nearly impossible state is found when it is observed.
#[test]
fn moves_below_the_range_of_doubles_are_not_lost() {
    for slope in [-900.0, -1e299] {
        let a = two().with_slopes(0, 1, &[slope, 0.0]).unwrap();
        let hmm = Hmm::new(
            Prior::BeforeFirstTransition(Belief::certain(2, 0).unwrap()),
            a.clone(),
            LikelihoodVector::linear(2),
        )
        .unwrap();
        let mut filter = hmm.filter();
        filter.step_with(&vec![1.0, 0.0], &[1.0, 0.5]).unwrap();
        filter.step_with(&vec![0.0, 0.0], &[0.0, 1.0]).unwrap();
        assert_eq!(filter.belief().mode(), 1);
        filter.step_with(&vec![1.0, 0.0], &[0.0, 1.0]).unwrap();
        let seen = vec![vec![1.0, 0.0], vec![0.0, 1.0]];
        let inputs = vec![vec![1.0, 0.0]; 2];
        let path = hmm.viterbi(&Controlled::new(&inputs, &seen).unwrap()).unwrap();
        assert_eq!(path.states(), [0, 1]);
        assert!((path.log_probability() / slope - 1.0).abs() < 1e-12);
        // Learning gives finite numbers.
        let step = counts(&[(vec![1.0, 0.0], 0, 1, 1.0), (vec![1.0, 1.0], 0, 0, 1.0)]);
        let learned = a.maximize(&step, 0.0).unwrap();
        assert!(learned.at(&[1.0, 0.0]).unwrap().get(1, 0) > 0.99);
    }
}

/// Numbers of any size end in a valid operator or an error.
#[test]
fn hostile_rows() {
    let values = [0.0, 1.0, -1e-320, 1e-160, 1e150, -1e299, f64::MAX];
    for first in values {
        for second in values {
            for weight in [f64::from_bits(1), 1e-200, 1.0, 1e300] {
                for (ridge, pseudo_count) in
                    [(0.0, 0.0), (1.0, 0.0), (1e-300, 1e-300), (1e300, 1.0)]
                {
                    let steps = [
                        (vec![first, second], 0, 1, weight),
                        (vec![second, first], 0, 0, 1.0),
                        (vec![1.0, second], 0, 1, weight),
                        (vec![0.5, 0.25], 1, 0, weight),
                    ];
                    let a = two().with_ridge(ridge).unwrap();
                    let counts = counts(&steps);
                    let Ok(learned) = a.maximize(&counts, pseudo_count) else { continue };
                    assert!(learned.log_prior(pseudo_count) < f64::INFINITY);
                    learned.separated(&counts, pseudo_count).unwrap_or_default();
                    for row in [&[first, second][..], &[0.0, 0.0]] {
                        if let Ok(m) = learned.at(row) {
                            assert!((m.get(0, 0) + m.get(1, 0) - 1.0).abs() < 1e-12);
                        }
                    }
                }
            }
        }
    }
}

/// A state without moves into it chooses the first state of sequences by their first inputs. With
/// labels, its coefficients are those of a logistic regression on the starts.
#[test]
fn starts_depend_on_inputs() {
    let start =
        SparseTransition::from_rows(&[[0.75, 0.5, 0.5], [0.25, 0.5, 0.5], [0.0; 3]]).unwrap();
    let a = LogitTransition::new(&start, 1).unwrap();
    let table = TableLikelihood::from_rows(&[[0.9, 0.1], [0.2, 0.8], [0.5, 0.5]]).unwrap();
    let prior = Prior::BeforeFirstTransition(Belief::certain(3, 2).unwrap());
    let hmm = Hmm::new(prior, a, table).unwrap();
    // In state 1 start one of four sequences with an input of 0, and three of five with 1.
    let starts =
        [(0.0, 0), (0.0, 0), (0.0, 1), (0.0, 0), (1.0, 1), (1.0, 1), (1.0, 0), (1.0, 1), (1.0, 0)];
    let inputs: Vec<Vec<Vec<f64>>> = starts.iter().map(|s| vec![vec![s.0]]).collect();
    let sequences: Vec<_> = inputs.iter().map(|u| Controlled::new(u, &[0]).unwrap()).collect();
    let states: Vec<[usize; 1]> = starts.iter().map(|s| [s.1]).collect();
    let drives: Vec<_> = sequences
        .iter()
        .zip(&states)
        .map(|(sequence, states)| LabelledSequence { initial: Some(2), states, sequence })
        .collect();
    let fitted = hmm.fit(&drives, &LearningOptions::default()).unwrap();
    let a = fitted.transition();
    assert!((a.at(&[0.0]).unwrap().get(1, 2) - 0.25).abs() < 1e-12);
    assert!((a.at(&[1.0]).unwrap().get(1, 2) - 0.6).abs() < 1e-12);
    assert_eq!(a.intercept(0, 1), hmm.transition().intercept(0, 1)); // never left
    // Neither an origin nor its slopes change a bit without counts, whatever the units of the
    // inputs.
    let a = two().with_slopes(1, 0, &[0.1, 0.7]).unwrap();
    let away = counts(&[(vec![3.0, 1e7], 0, 1, 0.3), (vec![-2.0, 3e6], 0, 0, 0.9)]);
    let kept = a.maximize(&away, 0.0).unwrap();
    assert_eq!((kept.slopes(1, 0), kept.intercept(1, 0)), (a.slopes(1, 0), a.intercept(1, 0)));
    assert_eq!(fitted.likelihood().probability(2, 0), Some(0.5));
    let learned = hmm.learn(&sequences, &LearningOptions::default()).unwrap();
    assert_eq!(learned.model().likelihood().probability(2, 0), Some(0.5));
}

/// For simulated data with a category and a time of day as inputs, the true parameters are as
/// likely as they should be: twice the log-likelihood ratio has a χ² distribution with eight
/// degrees of freedom, above 32 in one of 10,000 cases.
#[test]
fn learning_finds_simulated_coefficients() {
    let hmm = |coefficients: [[f64; 3]; 2], rows: [[f64; 2]; 2]| {
        let mut a = two();
        for (from, [intercept, slopes @ ..]) in coefficients.into_iter().enumerate() {
            let to = 1 - from;
            a = a
                .with_intercept(from, to, intercept)
                .unwrap()
                .with_slopes(from, to, &slopes)
                .unwrap();
        }
        let sensor = TableLikelihood::from_rows(&rows).unwrap();
        Hmm::new(prior(&[0.5, 0.5], true), a, sensor).unwrap()
    };
    let truth = hmm([[-1.5, 2.0, 1.0], [-1.0, -1.5, -1.0]], [[0.9, 0.1], [0.2, 0.8]]);
    let mut rng = rng(1);
    let inputs: Vec<Vec<f64>> = (0..3000)
        .map(|k| {
            vec![f64::from(k / 7 % 3 == 0), (f64::from(k) / 24.0 * std::f64::consts::TAU).sin()]
        })
        .collect();
    let seen = truth.simulate_with(&inputs, &mut rng).unwrap().observations().to_vec();
    let sequence = [Controlled::new(&inputs, &seen).unwrap()];
    let start = hmm([[-1.0, 0.0, 0.0]; 2], [[0.7, 0.3], [0.3, 0.7]]);
    let learning = LearningOptions::default().with_iterations(300).with_keep_prior(true);
    let learned = start.learn(&sequence, &learning).unwrap();
    let ratio = 2.0 * (learned.log_likelihood() - truth.log_likelihood(&sequence[0]).unwrap());
    assert!((0.0..32.0).contains(&ratio), "{ratio}");
    assert_eq!(learned.free_parameters(), 6 + 2);
    let far = 2.0 * (learned.log_likelihood() - start.log_likelihood(&sequence[0]).unwrap());
    assert!(far > 100.0, "{far}");
}
