//! Sensors that list a few states agree with those that list all.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::likelihood::{SparseObservation, SparseTableLikelihood};
use wayfix::{
    Belief, Hmm, Likelihood, LikelihoodVector, OptionalLikelihood, Prior, Scratch,
    SparseLikelihood, TableLikelihood,
};

use crate::kit::{cases_of, distribution, sparse, stochastic};

/// Lists of some of n states, with zeros, and the value of the others.
fn lists(n: usize, count: usize) -> impl Strategy<Value = Vec<(Vec<(usize, f64)>, f64)>> {
    let likelihood = || prop_oneof![1 => Just(0.0), 4 => 0.01..1.0];
    let states = proptest::sample::subsequence((0..n).collect::<Vec<_>>(), 0..=n).prop_shuffle();
    let listed = (states, vec(likelihood(), n))
        .prop_map(|(states, values)| states.into_iter().zip(values).collect::<Vec<_>>());
    // Few values, so that some come twice in a row.
    vec((listed, prop_oneof![Just(0.0), Just(0.25), Just(1e-3)]), count)
}

/// A value for each state.
fn in_full(n: usize, (listed, elsewhere): &(Vec<(usize, f64)>, f64)) -> Vec<f64> {
    let mut values = vec![*elsewhere; n];
    listed.iter().for_each(|&(state, b)| values[state] = b);
    values
}

/// Results of all routines for whole sequences, errors as text.
fn outcomes<B: Likelihood>(
    hmm: &Hmm<wayfix::SparseTransition, B>,
    ys: &[B::Observation],
) -> [String; 5]
where
    B::Observation: Sized,
{
    let mut filter = hmm.filter();
    let steps: Vec<_> = ys
        .iter()
        .map(|y| {
            let log = filter.step(y).map_err(|error| error.to_string());
            (log, filter.belief().as_slice().to_vec())
        })
        .collect();
    let mut decoder = hmm.online_viterbi();
    let decoded: Vec<_> = ys
        .iter()
        .map(|y| decoder.step(y).map(<[usize]>::to_vec).map_err(|error| error.to_string()))
        .collect();
    [
        format!("{steps:?}"),
        format!("{:?}", hmm.forward(ys).map_err(|error| error.to_string())),
        format!("{:?}", hmm.smooth(ys).map_err(|error| error.to_string())),
        format!("{:?}", hmm.viterbi(ys).map_err(|error| error.to_string())),
        format!("{decoded:?}"),
    ]
}

proptest! {
    #![proptest_config(cases_of(1000))]

    /// To the bit, with up to eight states and with more, whatever the value for other states is.
    #[test]
    fn sparse_observations_are_full_ones(
        (n, prior, columns, seen) in (2..=12_usize).prop_flat_map(|n| {
            (Just(n), distribution(false, n), stochastic(false, n), (0..12_usize).prop_flat_map(move |t| lists(n, t)))
        }),
        missing in vec(any::<bool>(), 12),
    ) {
        let prior = Prior::AtFirstObservation(Belief::new(prior).unwrap());
        let full: Vec<_> = seen.iter().map(|seen| in_full(n, seen)).collect();
        let listed: Vec<_> = seen.iter().map(|(l, b)| SparseObservation::new(l.clone(), *b).unwrap()).collect();
        let vectors = Hmm::new(prior.clone(), sparse(&columns), LikelihoodVector::linear(n).owned()).unwrap();
        let lists = Hmm::new(prior.clone(), sparse(&columns), SparseLikelihood::new(n)).unwrap();
        let expected = outcomes(&vectors, &full);
        prop_assert_eq!(&outcomes(&lists, &listed), &expected);

        if !seen.is_empty() {
            let table = SparseTableLikelihood::from_lists(n, &seen).unwrap();
            let symbols: Vec<usize> = (0..seen.len()).collect();
            let tables = Hmm::new(prior.clone(), sparse(&columns), table).unwrap();
            prop_assert_eq!(&outcomes(&tables, &symbols), &expected);
        }

        let optional = |missing: &bool, y: usize| (!missing).then_some(y);
        let which: Vec<_> = missing.iter().zip(0..seen.len()).map(|(m, y)| optional(m, y)).collect();
        let full: Vec<_> = which.iter().map(|y| y.map(|y| full[y].clone())).collect();
        let listed: Vec<_> = which.iter().map(|y| y.map(|y| listed[y].clone())).collect();
        let vectors = OptionalLikelihood::new(LikelihoodVector::linear(n).owned());
        let lists = OptionalLikelihood::new(SparseLikelihood::new(n));
        let vectors = Hmm::new(prior.clone(), sparse(&columns), vectors).unwrap();
        let lists = Hmm::new(prior, sparse(&columns), lists).unwrap();
        prop_assert_eq!(outcomes(&lists, &listed), outcomes(&vectors, &full));
    }

    /// A table whose rows sum to one, in either form.
    #[test]
    fn a_sparse_table_is_a_table(
        (n, prior, columns, rows) in (2..=12_usize).prop_flat_map(|n| {
            (Just(n), distribution(false, n), stochastic(false, n), vec(distribution(false, 4), n))
        }),
        seen in vec(0..4_usize, 0..12),
    ) {
        let prior = Prior::BeforeFirstTransition(Belief::new(prior).unwrap());
        let dense = TableLikelihood::from_rows(&rows).unwrap();
        // The likelihood of state 0 stands for all states with the same.
        let list = |symbol: usize| {
            let column = rows.iter().map(|row| row[symbol]).enumerate();
            (column.filter(|entry| entry.1 != rows[0][symbol]).collect(), rows[0][symbol])
        };
        let lists: Vec<(Vec<(usize, f64)>, f64)> = (0..4).map(list).collect();
        let table = SparseTableLikelihood::from_lists(n, &lists).unwrap();
        prop_assert_eq!(table.symbols(), 4);
        prop_assert_eq!(table.to_lists(), lists);
        for (state, row) in rows.iter().enumerate() {
            for (symbol, p) in row.iter().enumerate() {
                prop_assert_eq!(table.likelihood(state, symbol), Some(*p));
            }
        }
        let a = Hmm::new(prior.clone(), sparse(&columns), dense).unwrap();
        let b = Hmm::new(prior, sparse(&columns), table).unwrap();
        prop_assert_eq!(outcomes(&a, &seen), outcomes(&b, &seen));
        let drives = vec![seen; 9];
        prop_assert_eq!(
            format!("{:?}", a.viterbi_all(&drives)),
            format!("{:?}", b.viterbi_all(&drives))
        );
        prop_assert_eq!(
            format!("{:?}", a.smooth_all(&drives)),
            format!("{:?}", b.smooth_all(&drives))
        );
    }
}

/// In the pruned filter and the beam, a symbol equals the observation that it stands for.
#[test]
fn a_symbol_is_its_list_where_few_states_are_asked_for() {
    let n = 200;
    let moves = (0..n).flat_map(|j| [(j, j, 0.25), ((j + 1) % n, j, 0.75)]);
    let motion = wayfix::SparseTransition::from_triplets(n, moves).unwrap();
    let symbols: Vec<_> = (0..40).map(|k| (vec![(5 * k + 1, 0.5), (5 * k, 0.9)], 1e-3)).collect();
    let table = SparseTableLikelihood::from_lists(n, &symbols).unwrap();
    let seen: Vec<usize> = (0..60).map(|k| 3 + k / 7).collect();
    let listed: Vec<_> = seen.iter().map(|&y| table.symbol(y).unwrap().clone()).collect();
    let prior = Prior::AtFirstObservation(Belief::certain(n, 15).unwrap());
    let a = Hmm::new(prior.clone(), &motion, SparseLikelihood::new(n)).unwrap();
    let b = Hmm::new(prior, &motion, table).unwrap();
    let pruning = wayfix::inference::Pruning::default();
    let (mut lists, mut names) = (a.pruned_filter(pruning), b.pruned_filter(pruning));
    for (y, list) in seen.iter().zip(&listed) {
        assert_eq!(names.step(y).unwrap(), lists.step(list).unwrap());
        assert_eq!(names.probabilities(), lists.probabilities());
    }
    assert!(names.active().len() < n);
    let paths = [a.beam_viterbi(&listed, 1e-6).unwrap(), b.beam_viterbi(&seen, 1e-6).unwrap()];
    assert_eq!(format!("{:?}", paths[0]), format!("{:?}", paths[1]));
}

#[test]
fn what_is_no_sparse_table_is_refused() {
    let text = |states, symbols: &[(Vec<(usize, f64)>, f64)]| {
        SparseTableLikelihood::from_lists(states, symbols).unwrap_err().to_string()
    };
    let good = (vec![(1, 0.5)], 0.25);
    assert_eq!(
        text(0, std::slice::from_ref(&good)),
        "the number of states of a table is 0, expected at least 1"
    );
    assert_eq!(text(2, &[]), "the number of symbols of a table is 0, expected at least 1");
    assert_eq!(
        text(2, &[good.clone(), (vec![(1, -0.5)], 0.25)]),
        "the probability of symbol 1 in state 1 is -0.5, expected a finite value of at least 0"
    );
    assert_eq!(
        text(2, &[good.clone(), (vec![], f64::NAN)]),
        "the probability of symbol 1 in unlisted states is NaN, expected a finite value of at least 0"
    );
    assert_eq!(
        text(2, &[good.clone(), (vec![(1, 0.5), (0, 0.5), (1, 0.25)], 0.0)]),
        "the number of times that symbol 1 lists state 1 is 2, expected 1"
    );
    assert_eq!(
        text(2, &[(vec![(2, 0.5)], 0.0), good.clone()]),
        "a state that symbol 0 lists is 2, expected 0 to 1"
    );
    let infinite = SparseTableLikelihood::from_lists(2, &[(vec![(0, f64::INFINITY)], 0.0)]);
    assert_eq!(
        infinite.unwrap_err().to_string(),
        "the probability of symbol 0 in state 0 is inf, expected a finite value of at least 0"
    );
    let table = SparseTableLikelihood::from_lists(2, &[good]).unwrap();
    assert_eq!((table.likelihood(2, 0), table.likelihood(0, 1)), (None, None));
    assert!(table.symbol(1).is_none());
    let error = table.diagonal(&1, &mut Scratch::default()).unwrap_err().to_string();
    assert_eq!(error, "symbol 1 does not exist, the table has 1 symbols (0 to 0)");
}
