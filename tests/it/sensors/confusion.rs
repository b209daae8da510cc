//! Confusions as sensors, against tables of the same numbers.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::inference::{LearningOptions, Pruning};
use wayfix::likelihood::{LocalLikelihood, SampleObservation};
use wayfix::map::{Place, PlanePosition, Road, RoadClass, RoadMap};
use wayfix::observation::Confusion;
use wayfix::{Belief, Hmm, Likelihood, Prior, Scratch, SparseTransition, TableLikelihood};

use crate::kit::{Matrix, bits, cases, rng, says, sparse, stochastic, text};

/// `rows[place][seen]` as entries, including zeros, in arbitrary order.
fn entries(rows: &Matrix) -> Vec<(usize, usize, f64)> {
    let row = |(place, row): (usize, &Vec<f64>)| {
        row.iter().enumerate().map(|(seen, p)| (place, seen, *p)).collect::<Vec<_>>()
    };
    let mut entries: Vec<_> = rows.iter().enumerate().flat_map(row).collect();
    entries.sort_by_key(|(place, seen, _)| (place * 7 + seen * 5) % 11);
    entries
}

/// Moves, rows of a confusion, sightings.
fn drives() -> impl Strategy<Value = (Matrix, Matrix, Vec<usize>)> {
    (1..6_usize).prop_flat_map(|n| {
        let rows = stochastic(false, n).prop_map(|columns| {
            (0..columns.len()).map(|i| columns.iter().map(|row| row[i]).collect()).collect()
        });
        (stochastic(false, n), rows, vec(0..n, 1..8))
    })
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn as_the_table_of_its_numbers((moves, rows, ys) in drives()) {
        let n = rows.len();
        let confusion = Confusion::from_entries(n, entries(&rows)).unwrap();
        let table = TableLikelihood::from_rows(&rows).unwrap();
        prop_assert_eq!(confusion.entries(), rows.concat().iter().filter(|p| **p > 0.0).count());
        for (place, row) in rows.iter().enumerate() {
            for (seen, p) in row.iter().enumerate() {
                prop_assert_eq!(confusion.probability(place, seen), Some(*p));
            }
            let draw = |seed| (confusion.sample(place, &mut rng(seed)), table.sample(place, &mut rng(seed)));
            prop_assert!((0..20).map(draw).all(|(found, expected)| found == expected));
        }
        let written = confusion.clone().into_table().unwrap();
        prop_assert!((0..n * n).all(|at| written.probability(at / n, at % n) == Some(rows[at / n][at % n])));

        let prior = || Prior::BeforeFirstTransition(Belief::uniform(n).unwrap());
        let sparse_hmm = Hmm::new(prior(), sparse(&moves), &confusion).unwrap();
        let dense_hmm = Hmm::new(prior(), sparse(&moves), &table).unwrap();
        let (mut filter, mut expected) = (sparse_hmm.filter(), dense_hmm.filter());
        let mut pruned = sparse_hmm.pruned_filter(Pruning::default());
        let mut pruned_expected = dense_hmm.pruned_filter(Pruning::default());
        for y in &ys {
            match expected.step(y) {
                Ok(n) => prop_assert_eq!(filter.step(y).unwrap().to_bits(), n.to_bits()),
                Err(error) => prop_assert_eq!(text(filter.step(y)), error.to_string()),
            }
            prop_assert_eq!(bits(filter.belief().as_slice()), bits(expected.belief().as_slice()));
            prop_assert_eq!(pruned.step(y).is_ok(), pruned_expected.step(y).is_ok());
            for state in 0..n {
                let (found, expected) = (pruned.probability(state), pruned_expected.probability(state));
                prop_assert!((found.unwrap_or(0.0) - expected.unwrap_or(0.0)).abs() <= 1e-12);
            }
        }
        match (sparse_hmm.viterbi(&ys), dense_hmm.viterbi(&ys)) {
            (Ok(found), Ok(expected)) => prop_assert_eq!(found.states(), expected.states()),
            (found, expected) => prop_assert_eq!(text(found), text(expected)),
        }
        match (sparse_hmm.beam_viterbi(&ys, 1e9), dense_hmm.beam_viterbi(&ys, 1e9)) {
            (Ok(found), Ok(expected)) => {
                prop_assert_eq!(found.path().states(), expected.path().states());
            }
            (found, expected) => prop_assert_eq!(found.is_ok(), expected.is_ok()),
        }
    }

    #[test]
    fn learned_as_the_table_is((moves, rows, ys) in drives(), pseudo_count in 0..3_u8) {
        let n = rows.len();
        let prior = || Prior::AtFirstObservation(Belief::uniform(n).unwrap());
        let learning = LearningOptions::default().with_iterations(2).with_likelihood_pseudo_count(f64::from(pseudo_count) / 2.0);
        let confusion = Confusion::from_entries(n, entries(&rows)).unwrap();
        let found = Hmm::new(prior(), sparse(&moves), confusion).unwrap().learn(&[&ys[..]], &learning);
        let table = TableLikelihood::from_rows(&rows).unwrap();
        let expected = Hmm::new(prior(), sparse(&moves), table).unwrap().learn(&[&ys[..]], &learning);
        match (found, expected) {
            (Ok(found), Ok(expected)) => {
                let (found, expected) = (found.model().likelihood(), expected.model().likelihood());
                for place in 0..n {
                    for seen in 0..n {
                        let p = expected.probability(place, seen).unwrap();
                        prop_assert!((found.probability(place, seen).unwrap() - p).abs() <= 1e-9);
                    }
                }
            }
            (found, expected) => prop_assert_eq!(text(found), text(expected)),
        }
    }

    /// The bound is the largest likelihood of the states that are not listed.
    #[test]
    fn a_few_states_only((_, rows, ys) in drives(), asked in vec(any::<bool>(), 6)) {
        let n = rows.len();
        let confusion = Confusion::from_entries(n, entries(&rows)).unwrap();
        let states: Vec<usize> = (0..n).filter(|i| asked[*i]).collect();
        let mut scratch = Scratch::default();
        for y in &ys {
            let (found, others) = confusion.local(y, &states, &mut scratch).unwrap();
            let column = |i: &usize| rows[*i][*y];
            prop_assert_eq!(found.as_slice(), states.iter().map(column).collect::<Vec<_>>());
            let rest = (0..n).filter(|i| !asked[*i]).map(|i| rows[i][*y]).fold(0.0, f64::max);
            prop_assert_eq!(others, rest);
            let mut outstanding = Vec::new();
            confusion.listed_states(y, &mut outstanding);
            prop_assert_eq!(outstanding, (0..n).filter(|i| rows[*i][*y] > 0.0).collect::<Vec<_>>());
        }
    }

    /// Weights of any scale are those of a table after division.
    #[test]
    fn weights_are_divided_by_their_sums(
        given in vec((0..4_usize, 0..4_usize, 0..5_u8), 0..30), exponent in -300..300_i32,
    ) {
        let scale = 10_f64.powi(exponent);
        let mut counts = vec![vec![0.0; 4]; 4];
        (0..4).for_each(|i| counts[i][i] = 1.0);
        given.iter().for_each(|(place, seen, count)| counts[*place][*seen] += f64::from(*count));
        let given = given.iter().map(|(place, seen, count)| (*place, *seen, f64::from(*count)));
        let weights = given.chain((0..4).map(|i| (i, i, 1.0))).map(|(i, j, w)| (i, j, w * scale));
        let confusion = Confusion::from_weights(4, weights).unwrap();
        for (place, counts) in counts.iter().enumerate() {
            let sum: f64 = counts.iter().sum();
            for (seen, count) in counts.iter().enumerate() {
                let found = confusion.probability(place, seen).unwrap();
                prop_assert!((found - count / sum).abs() <= 1e-14, "{place} {seen} {found}");
            }
        }
    }
}

#[test]
fn a_place_that_does_not_exist() {
    let confusion = Confusion::from_entries(2, [(0, 0, 1.0), (1, 0, 1.0)]).unwrap();
    assert_eq!(confusion.probability(0, 2), None);
    assert_eq!(confusion.probability(2, 0), None);
    let beyond = "symbol 2 does not exist, the table has 2 symbols (0 to 1)";
    let scratch = &mut Scratch::default();
    says(confusion.diagonal(&2, scratch).map(drop), beyond);
    says(confusion.local(&2, &[], &mut Scratch::default()).map(drop), beyond);
    let mut states = Vec::new();
    confusion.listed_states(&2, &mut states);
    assert!(states.is_empty());
    // Nothing is ever seen as place 1: an observation that the model rules out.
    let prior = Prior::AtFirstObservation(Belief::uniform(2).unwrap());
    let motion = SparseTransition::from_rows(&[[0.5; 2]; 2]).unwrap();
    let hmm = Hmm::new(prior, motion, &confusion).unwrap();
    let mut filter = hmm.filter();
    assert!(filter.step(&1).is_err());
    assert!(filter.step(&0).is_ok());
}

#[cfg(feature = "serde")]
#[test]
fn stored_and_read() {
    let confusion =
        Confusion::from_weights(3, [(0, 0, 2.0), (0, 1, 1.0), (1, 1, 1.0), (2, 1, 1.0)]).unwrap();
    let stored = serde_json::to_string(&confusion).unwrap();
    assert_eq!(serde_json::from_str::<Confusion>(&stored).unwrap(), confusion);
    let refused = |text: &str, expected: &str| {
        assert_eq!(serde_json::from_str::<Confusion>(text).unwrap_err().to_string(), expected);
    };
    refused(
        r#"{"version":1,"places":2,"place":[0,1],"seen_as":[0,1],"probability":[0.5,1]}"#,
        "the sum of the symbol probabilities of state 0 is 0.5, expected 1",
    );
    refused(
        r#"{"version":1,"places":2,"place":[0,1],"seen_as":[0],"probability":[1,1]}"#,
        "the number of values in `seen_as` is 1, expected as many as in `place`",
    );
    refused(
        r#"{"version":1,"places":2000000000,"place":[0],"seen_as":[0],"probability":[1]}"#,
        "the number of places is 2000000000, expected at most as many as entries",
    );
}

/// A road of 100,000 places, filtered and pruned.
#[test]
fn a_hundred_thousand_places() {
    let n = 100_000;
    let place = |i| Place {
        id: i as u64,
        position: PlanePosition { x: i as f64, y: 0.0 },
        name: String::new(),
    };
    let road = |i| Road { from: i as u64, to: i as u64 + 1, class: RoadClass::Street, metres: 1.0 };
    let map = RoadMap::new((0..n).map(place), (0..n - 1).map(road)).unwrap();
    let confusion = Confusion::new(&map, 0.7).unwrap();
    assert_eq!(confusion.entries(), n + 2 * (n - 1));
    assert_eq!(confusion.places(), n);
    let correct = |i: usize| confusion.probability(i, i).unwrap();
    let mean = (0..n).map(correct).sum::<f64>() / n as f64;
    assert!((mean - 0.7).abs() <= 1e-12);

    let on = (0..n - 1).flat_map(|i| [(i, i, 1.0), (i + 1, i, 3.0)]).chain([(n - 1, n - 1, 1.0)]);
    let motion = SparseTransition::from_weights(n, on).unwrap();
    let prior = Prior::AtFirstObservation(Belief::uniform(n).unwrap());
    let hmm = Hmm::new(prior, motion, confusion).unwrap();
    let (mut filter, mut pruned) = (hmm.filter(), hmm.pruned_filter(Pruning::default()));
    for y in [50_000, 50_001, 50_001, 50_003] {
        filter.step(&y).unwrap();
        pruned.step(&y).unwrap();
    }
    // The numbers come from the same product and the same sums.
    for i in 49_995..50_010 {
        let found = pruned.probability(i).unwrap_or(0.0);
        assert!((filter.belief().as_slice()[i] - found).abs() <= 1e-12, "{i}");
    }
    assert!(filter.belief().mode().abs_diff(50_002) <= 1);
}
