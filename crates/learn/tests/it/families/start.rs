//! Initial models for learning.

use proptest::collection::vec;
use proptest::prelude::*;
use rand::RngExt;
use wayfix::inference::{LearnError, LearningOptions, Simulation};
use wayfix::{Belief, DenseTransition, Fixed, Hmm, HmmError, Prior, TableLikelihood};
use wayfix_learn::{
    Clusters, EmissionError, Gaussian, GaussianMixture, Poisson, Product, Rows, StartFromClusters,
    StartKind, starts, table_starts,
};

use crate::kit::{cases, rng, says};

/// Rows of two numbers of very different units, some missing.
fn rows() -> impl Strategy<Value = Vec<Vec<f64>>> {
    let number = |unit: f64| prop_oneof![8 => (-9..10_i32).prop_map(move |k| unit * f64::from(k)), 1 => Just(f64::NAN)];
    vec((number(1e-7), number(1e9)).prop_map(|(a, b)| vec![a, b]), 1..40)
}

/// Square of the distance in standard deviations, over the known components.
fn distance(row: &[f64], centre: &[f64], deviations: &[f64]) -> f64 {
    let parts = row.iter().zip(centre).zip(deviations).filter(|((y, _), _)| !y.is_nan());
    parts.map(|((y, c), deviation)| ((y - c) / deviation).powi(2)).sum()
}

proptest! {
    #![proptest_config(cases())]

    /// Each observation is in the cluster of its nearest centre, centres are means, in ascending
    /// order.
    #[test]
    fn clusters_are_those_of_their_centres(rows in rows(), count in 1..5_usize, seed: u64) {
        let sequences = [&rows[..rows.len() / 2], &rows[rows.len() / 2..]];
        let Ok(clusters) = Clusters::new(&sequences, count, &mut rng(seed)) else {
            let mut different: Vec<String> = rows.iter().map(|row| format!("{row:?}")).collect();
            different.sort();
            different.dedup();
            // Rows with missing components may be at distance 0 from others.
            prop_assert!(different.len() < count || rows.iter().flatten().any(|y| y.is_nan()));
            return Ok(());
        };
        prop_assert_eq!(clusters.labels().iter().map(Vec::len).sum::<usize>(), rows.len());
        let centres: Vec<&[f64]> = (0..count).map(|cluster| clusters.centre(cluster)).collect();
        prop_assert!(centres.windows(2).all(|pair| pair[0][0] <= pair[1][0]));
        let deviations: Vec<f64> = (0..2).map(|component| {
            let known: Vec<f64> = rows.iter().map(|row| row[component]).filter(|y| !y.is_nan()).collect();
            let mean = known.iter().sum::<f64>() / known.len() as f64;
            let variance = known.iter().map(|y| (y - mean).powi(2)).sum::<f64>() / known.len() as f64;
            if variance > 0.0 { variance.sqrt() } else { 1.0 }
        }).collect();
        let labels: Vec<usize> = clusters.labels().concat();
        for (row, &label) in rows.iter().zip(&labels) {
            let own = distance(row, centres[label], &deviations);
            for centre in &centres {
                prop_assert!(own <= distance(row, centre, &deviations) + 1e-9);
            }
        }
        for (cluster, centre) in centres.iter().enumerate() {
            for component in 0..2 {
                let members = rows.iter().zip(&labels).filter(|(_, label)| **label == cluster);
                let known: Vec<f64> =
                    members.map(|(row, _)| row[component]).filter(|y| !y.is_nan()).collect();
                if !known.is_empty() {
                    let mean = known.iter().sum::<f64>() / known.len() as f64;
                    prop_assert!((mean - centre[component]).abs() <= 1e-9 * deviations[component]);
                }
            }
        }
    }
}

#[test]
fn clusters_that_cannot_be_are_errors() {
    let says = |rows: &[Vec<f64>], count, expected: &str| {
        says(Clusters::new(&[rows], count, &mut rng(1)), expected);
    };
    let one = vec![vec![1.0, 2.0]; 9];
    says(&one, 2, "1 different observations cannot start 2 clusters");
    let none =
        "a family needs at least one state and one component, found 0 states and 2 components";
    says(&one, 0, none);
    says(&[], 1, "there are no observations");
    let ragged = [vec![1.0, 2.0], vec![1.0]];
    says(&ragged, 1, "sequence 0, step 2: the observation has 1 components, expected 2");
    let infinite = [vec![1.0, 2.0], vec![1.0, f64::INFINITY]];
    let expected = "component 1 of the observation is inf, expected a finite value";
    says(&infinite, 1, &format!("sequence 0, step 2: {expected}"));
    let sequences = [&one[..], &infinite[..]];
    let second = Clusters::new(&sequences, 1, &mut rng(1));
    assert!(matches!(second, Err(EmissionError::Step { sequence: 1, step: 2, .. })));
}

/// Two well separated groups are told apart by their known components, and learning from all of
/// them finds the groups.
#[test]
fn learning_from_starts_finds_groups() {
    let family = Gaussian::diagonal(&[[0.0, 0.0]; 3], &[[1.0, 1.0]; 3]).unwrap();
    let truth = Gaussian::diagonal(
        &[[0.0, 0.0], [5.0, 50.0], [10.0, 0.0]],
        &[[0.5, 5.0], [0.5, 5.0], [0.5, 5.0]],
    );
    let transition = wayfix::DenseTransition::from_fn(3, |i, j| if i == j { 0.9 } else { 0.05 });
    let prior = wayfix::Prior::AtFirstObservation(wayfix::Belief::uniform(3).unwrap());
    let truth = Hmm::new(prior, transition.unwrap(), truth.unwrap()).unwrap();
    for seed in 0..5 {
        let mut rng = rng(seed);
        let drawn: Vec<_> = (0..4).map(|_| truth.simulate(200, &mut rng)).collect();
        let sequences: Vec<&[Vec<f64>]> = drawn.iter().map(Simulation::observations).collect();
        let starts = starts(&family, &sequences, 4, &mut rng).unwrap();
        let fits =
            Hmm::learn_best(&starts, &sequences, &LearningOptions::default(), |_, _| ()).unwrap();
        let model = fits.into_model();
        let mut right = 0;
        for (drive, sequence) in drawn.iter().zip(&sequences) {
            let path = model.viterbi(sequence).unwrap();
            right += path.states().iter().zip(drive.states()).filter(|(a, b)| a == b).count();
        }
        assert!(right >= 790, "seed {seed}: {right} of 800");
    }
}

#[test]
fn an_observation_that_the_family_refuses_is_named() {
    let family = Gaussian::diagonal(&[[0.0], [1.0]], &[[1.0], [1.0]]).unwrap();
    let values = [0.0, 1.0, f64::NAN, 2.0];
    let rows = Rows::new(&values, 1).unwrap();
    let error = starts(&family, &[rows], 1, &mut rng(1)).unwrap_err();
    assert!(matches!(&error, LearnError::Sequence(error) if error.sequence == 0), "{error}");
    assert!(starts(&family.with_missing(), &[rows], 1, &mut rng(1)).is_ok());
}

#[test]
fn rows_are_those_of_the_matrix() {
    use wayfix::Sequence;
    use wayfix_learn::EmissionError;
    let values: Vec<f64> = (0..12).map(f64::from).collect();
    let rows = Rows::new(&values, 3).unwrap();
    assert_eq!((rows.steps(), rows.width()), (4, 3));
    assert!(rows.iter().eq(values.chunks(3)));
    for order in 0..4 {
        let lagged = rows.lagged(order).unwrap();
        assert_eq!((lagged.steps(), lagged.width()), (4 - order, 3 * (order + 1)));
        for (step, row) in (1..).zip(lagged.iter()) {
            assert_eq!(row, &values[3 * (step - 1)..3 * (step + order)]);
            assert_eq!(row, lagged.observation(step));
        }
    }
    assert_eq!(rows.lagged(4), Err(EmissionError::TooFewRows { rows: 4, order: 4 }));
    assert_eq!(Rows::new(&values, 0), Err(EmissionError::NoComponents));
    assert_eq!(Rows::new(&values, 5), Err(EmissionError::Incomplete { values: 12, components: 5 }));
    assert_eq!(Rows::new(&[], 2).unwrap().steps(), 0);
    assert_eq!(
        Rows::new(&[], 2).unwrap().lagged(1),
        Err(EmissionError::TooFewRows { rows: 0, order: 1 })
    );
}

/// Centres are means of the given observations, however large others are.
#[test]
fn centres_keep_their_digits_beside_huge_values() {
    let (tiny, most) = (f64::from_bits(3), f64::MAX);
    for (values, count, centres) in [
        (vec![1e150, 0.25, 0.5, 0.75, 1e150], 2, vec![0.5, 1e150]),
        (vec![-1e20, 1.5, 2.5, -1e20, 2.0], 2, vec![-1e20, 2.0]),
        (vec![most, -most, most, -most, most], 2, vec![-most, most]),
        (vec![tiny, -tiny, tiny], 2, vec![-tiny, tiny]),
        (vec![most, 0.9 * most], 1, vec![0.95 * most]),
    ] {
        let series = [values.iter().map(|y| [*y]).collect::<Vec<[f64; 1]>>()];
        let clusters = Clusters::new(&series, count, &mut rng(4)).unwrap();
        for (k, expected) in centres.iter().enumerate() {
            let found = clusters.centre(k)[0];
            assert!((found / expected - 1.0).abs() < 1e-15, "{values:?}: {found}");
        }
    }
}

/// The family that fits the clusters; for a component that is never seen, the expected values are
/// kept.
#[test]
fn clusters_give_a_family_its_parameters() {
    let rows = [[0.0, f64::NAN], [0.2, f64::NAN], [9.0, f64::NAN], [9.2, f64::NAN], [f64::NAN; 2]];
    let sequences = [&rows[..]];
    let clusters = Clusters::new(&sequences, 2, &mut rng(1)).unwrap();
    let known: Vec<(f64, usize)> = clusters.iter().map(|(row, label)| (row[0], label)).collect();
    assert_eq!(known, [(0.0, 0), (0.2, 0), (9.0, 1), (9.2, 1)]);
    assert_eq!(clusters.labels().concat().len(), 5);
    // Labels and centres are equal, though missing components (NaN) are not.
    assert_eq!(clusters, clusters.clone());
    assert_ne!(clusters, Clusters::new(&sequences, 1, &mut rng(1)).unwrap());
    let family = Gaussian::diagonal(&[[1.0, 3.0]; 2], &[[1.0, 1.0]; 2]).unwrap().with_missing();
    let fitted = clusters.fit(&family).unwrap();
    assert_eq!(fitted.mean(0).unwrap()[1], 3.0);
    // A tenth of the weight is that of all observations, whose mean is 4.6.
    let mean = |near: f64| (near + 0.1 * 4.6) / 1.1;
    assert!((fitted.mean(0).unwrap()[0] - mean(0.1)).abs() < 1e-12);
    assert!((fitted.mean(1).unwrap()[0] - mean(9.1)).abs() < 1e-12);
}

#[test]
fn families_that_do_not_fit_clusters_are_errors() {
    let rows = [[0.0], [0.2], [9.0], [9.2]];
    let sequences = [&rows[..]];
    let clusters = Clusters::new(&sequences, 2, &mut rng(1)).unwrap();
    let counts = |n: usize| Poisson::family(&vec![[1.0]; n]).unwrap();
    for n in [1, 3] {
        let family = Gaussian::diagonal(&vec![[0.0]; n], &vec![[1.0]; n]).unwrap();
        let (means, variances) = (vec![[[0.0]; 2]; n], vec![[[1.0]; 2]; n]);
        let mixture = GaussianMixture::diagonal(&vec![[0.5; 2]; n], &means, &variances).unwrap();
        let both = Product::new(family.clone(), counts(n)).unwrap();
        for error in [
            clusters.fit(&family).unwrap_err(),
            clusters.fit(&Fixed(family)).unwrap_err(),
            mixture.start(&clusters, &mut rng(1)).unwrap_err(),
            both.start(&clusters, &mut rng(1)).unwrap_err(),
        ] {
            let expected = format!("the family has {n} states, expected 2 to match the clusters");
            assert_eq!(error.to_string(), expected);
            assert!(matches!(error.downcast_ref(), Some(HmmError::StateCount { .. })));
        }
    }
    let wide = Gaussian::diagonal(&[[0.0; 2]; 2], &[[1.0; 2]; 2]).unwrap();
    let both = Product::new(counts(2), counts(2)).unwrap();
    let wrong = [clusters.fit(&wide).unwrap_err(), both.start(&clusters, &mut rng(1)).unwrap_err()];
    for error in wrong {
        let expected = "the observation has 1 components, expected 2";
        assert!(error.to_string().ends_with(expected), "{error}");
    }
}

/// Regimes that differ in spread alone, 0.6, 1.2 and 3, for 60, 25 and 8 days at a time.
fn market(days: usize, seed: u64) -> Vec<Vec<f64>> {
    let moves = [[59.0 / 60.0, 0.032, 0.0], [1.0 / 60.0, 0.96, 0.125], [0.0, 0.008, 0.875]];
    let transition = DenseTransition::from_rows(&moves).unwrap();
    let prior = Prior::AtFirstObservation(Belief::new(vec![0.7, 0.25, 0.05]).unwrap());
    let family = Gaussian::diagonal(&[[0.0]; 3], &[[0.36], [1.44], [9.0]]).unwrap();
    let truth = Hmm::new(prior, transition, family).unwrap();
    truth.simulate(days, &mut rng(seed)).observations().to_vec()
}

/// Starts are as good as deviations of half, once and twice that of all, which a person would try.
#[test]
fn regimes_that_differ_in_spread_are_found() {
    for seed in 0..4 {
        let days = market(1000, seed);
        let sequences = [&days[..]];
        let mean = days.iter().map(|day| day[0]).sum::<f64>() / days.len() as f64;
        let variance =
            days.iter().map(|day| (day[0] - mean).powi(2)).sum::<f64>() / days.len() as f64;
        let by_hand = [0.25, 1.0, 4.0].map(|factor| [factor * variance]);
        let transition = DenseTransition::from_fn(3, |i, j| if i == j { 0.9 } else { 0.05 });
        let prior = Prior::AtFirstObservation(Belief::uniform(3).unwrap());
        let family = Gaussian::diagonal(&[[mean]; 3], &by_hand).unwrap();
        let by_hand = Hmm::new(prior, transition.unwrap(), family.clone()).unwrap();
        let learning = LearningOptions::default();
        let expected = by_hand.learn(&sequences, &learning).unwrap().objective();
        let starts = starts(&family, &sequences, 5, &mut rng(seed)).unwrap();
        let best = Hmm::learn_best(&starts, &sequences, &learning, |_, _| ()).unwrap();
        assert!(best.objective() > expected - 0.1, "seed {seed}: {best:?}");
    }
}

/// Each kind of start separates what it promises, on a series with both: at first it is low and
/// calm, then it fluctuates about the same mean, then it is high.
#[test]
fn kinds_of_starts_differ() {
    let mut noise = rng(3);
    let mut value = |k: usize| match k / 100 {
        0 => 0.1 * (noise.random::<f64>() - 0.5),
        1 => 4.0 * (noise.random::<f64>() - 0.5),
        _ => 5.0 + 0.1 * (noise.random::<f64>() - 0.5),
    };
    let series: Vec<[f64; 1]> = (0..300).map(|k| [value(k)]).collect();
    let family = Gaussian::diagonal(&[[0.0]; 2], &[[1.0]; 2]).unwrap();
    let all = starts(&family, &[&series], 10, &mut rng(1)).unwrap();
    let kinds: Vec<StartKind> = (0..10).map(StartKind::of).collect();
    assert_eq!(kinds[..5], kinds[5..]);
    let parameters = |start: &Hmm<DenseTransition, Gaussian>| {
        let family = start.likelihood();
        [family.means(), family.covariances()].concat().concat()
    };
    for (at, start) in all.iter().enumerate().take(5) {
        for other in &all[at + 1..5] {
            assert_ne!(parameters(start), parameters(other), "{}", kinds[at]);
        }
        // Means of clusters ascend.
        let means = start.likelihood().means().concat();
        assert!(means[0] <= means[1], "{}: {means:?}", kinds[at]);
    }
    let names: Vec<String> = kinds[..5].iter().map(StartKind::to_string).collect();
    assert_eq!(names, ["position", "random", "spread", "segments", "surroundings"]);
}

/// Every kind of start copes with gaps, short sequences and few distinct values.
#[test]
fn all_kinds_start_from_gaps_and_short_sequences() {
    let family = Gaussian::diagonal(&[[0.0; 2]; 3], &[[1.0; 2]; 3]).unwrap().with_missing();
    let row = |k: usize| {
        let y = f64::from(u8::from(k % 7 > 3)) + f64::from(u8::from(k.is_multiple_of(5)));
        [if k.is_multiple_of(3) { f64::NAN } else { y }, if k % 3 < 2 { f64::NAN } else { 2.0 * y }]
    };
    let all: Vec<[f64; 2]> = (0..60).map(row).collect();
    let sequences = [&all[..1], &all[1..1], &all[1..4], &all[4..60]];
    let found = starts(&family, &sequences, 10, &mut rng(2)).unwrap();
    let again = starts(&family, &sequences, 10, &mut rng(2)).unwrap();
    assert_eq!(format!("{found:?}"), format!("{again:?}"));
    for start in &found {
        let means = start.likelihood().means().concat();
        assert!(means.iter().all(|mean| mean.is_finite()), "{means:?}");
        assert!(start.transition().to_rows().concat().iter().all(|p| *p > 0.0));
    }
}

#[test]
fn tables_start_from_symbols() {
    // Symbols 0 and 1 for a while, then 1 and 2; symbol 3 is never seen, 4 is impossible.
    let mut drawn = rng(5);
    let symbol = |k: usize| k / 40 % 2 + drawn.random_range(0..2_usize);
    let seen: Vec<usize> = (0..400).map(symbol).collect();
    let table = TableLikelihood::from_rows(&[[0.25, 0.25, 0.25, 0.25, 0.0]; 2]).unwrap();
    let learning = LearningOptions::default().with_likelihood_pseudo_count(0.1);
    let starts = table_starts(&table, &[&seen], 5, &mut rng(1)).unwrap();
    for start in &starts {
        let table = start.likelihood();
        assert!(table.probability(0, 3).unwrap() > 0.0);
        assert_eq!(table.probability(1, 4), Some(0.0));
    }
    let best = Hmm::learn_best(&starts, &[&seen], &learning, |_, _| ()).unwrap();
    let learned = best.model().likelihood();
    let rare = [0, 1].map(|state| {
        learned.probability(state, 0).unwrap().min(learned.probability(state, 2).unwrap())
    });
    assert!(rare.iter().all(|p| *p < 0.02), "{learned:?}");
    assert!(best.model().transition().get(0, 0) > 0.9);

    // More states than symbols.
    let table = TableLikelihood::from_rows(&[[0.5, 0.5]; 3]).unwrap();
    let two: Vec<usize> = (0..90).map(|k| usize::from(k % (2 + k / 30) == 0)).collect();
    assert_eq!(table_starts(&table, &[&two], 5, &mut rng(1)).unwrap().len(), 5);
    let error = table_starts(&table, &[&seen], 1, &mut rng(1)).unwrap_err();
    assert!(matches!(&error, LearnError::Sequence(error) if error.sequence == 0), "{error}");
    let none: [&[usize]; 1] = [&[]];
    says(
        table_starts(&table, &none, 1, &mut rng(1)),
        "the sensor cannot be estimated: there are no observations",
    );
}
