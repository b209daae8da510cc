//! Pseudo-residuals against enumeration of all paths, and their distribution under the true model.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::inference::LearningOptions;
use wayfix::likelihood::SampleObservation;
use wayfix::{Belief, DenseTransition, Hmm, OptionalLikelihood, Prior, TableLikelihood};
use wayfix_learn::{
    Exponential, Gaussian, Independent, Marginals, Poisson, Product, PseudoResiduals, Rows, Tails,
    VonMises,
};

use super::{Counts, FURTHEST, counts, distance_from_uniform};
use crate::kit::{Matrix, cases_of, close, distribution, prior, rng, says, stochastic};

/// Probabilities of all states at `step`, given the observations of some steps, by enumeration of all
/// paths; `None` if these are impossible. `likelihoods[k]` is a row of states.
fn enumerate(
    [start, moves]: [&Matrix; 2],
    at_first: bool,
    likelihoods: &[Vec<f64>],
    step: usize,
    is_known: impl Fn(usize) -> bool,
) -> Option<Vec<f64>> {
    let n = moves.len();
    let mut sums = vec![0.0; n];
    let mut paths: Vec<(Vec<usize>, f64)> = Vec::new();
    for first in 0..n {
        let from = (0..n).map(|j| moves[first][j] * start[0][j]).sum::<f64>();
        paths.push((vec![first], if at_first { start[0][first] } else { from }));
    }
    for k in 1..likelihoods.len() {
        let longer = |(path, p): &(Vec<usize>, f64)| {
            let (path, p) = (path.clone(), *p);
            (0..n).map(move |to| ([&path[..], &[to]].concat(), p * moves[to][path[k - 1]]))
        };
        paths = paths.iter().flat_map(longer).collect();
    }
    for (path, p) in paths {
        let known = path.iter().enumerate().filter(|(k, _)| is_known(*k));
        sums[path[step]] += p * known.map(|(k, &state)| likelihoods[k][state]).product::<f64>();
    }
    let total: f64 = sums.iter().sum();
    (total > 0.0).then(|| sums.iter().map(|sum| sum / total).collect())
}

/// Compares both kinds of residuals with enumeration.
fn compare<B: Marginals>(
    hmm: &Hmm<DenseTransition, B>,
    [start, moves]: [&Matrix; 2],
    observations: &[impl std::borrow::Borrow<B::Observation>],
    numbers: &[Option<f64>],
) -> Result<(), TestCaseError> {
    let (n, likelihood) = (hmm.states(), hmm.likelihood());
    let at_first = matches!(hmm.prior(), Prior::AtFirstObservation(_));
    let row = |y: &Option<f64>| -> Vec<f64> {
        let one = |i| y.map_or(1.0, |y| likelihood.log_density(i, 0, y).exp());
        (0..n).map(one).collect()
    };
    let likelihoods: Vec<Vec<f64>> = numbers.iter().map(row).collect();
    let given = |step: usize, is_known: &dyn Fn(usize) -> bool| {
        enumerate([start, moves], at_first, &likelihoods, step, is_known)
    };
    let found = PseudoResiduals::new(hmm, observations, 0);
    if !numbers.is_empty() && given(0, &|_| true).is_none() {
        prop_assert!(found.unwrap_err().to_string().contains("impossible"));
        return Ok(());
    }
    let found = found.unwrap();
    prop_assert_eq!(found.forecast().len(), numbers.len());
    prop_assert_eq!(found.ordinary().len(), numbers.len());
    for (k, number) in numbers.iter().enumerate() {
        let kinds = [
            (found.forecast()[k], given(k, &|other| other < k)),
            (found.ordinary()[k], given(k, &|other| other != k)),
        ];
        for (found, shares) in kinds {
            prop_assert_eq!(found.is_some(), number.is_some());
            let (Some(found), Some(y), Some(shares)) = (found, *number, shares) else { continue };
            let of = |side: fn(Tails) -> f64| -> f64 {
                let states = shares.iter().enumerate().filter(|(_, p)| **p > 0.0);
                states.map(|(state, p)| p * side(likelihood.tails(state, 0, y))).sum()
            };
            close(found.below, of(|tails| tails.below), 1e-10, 1e-12)?;
            close(found.at, of(|tails| tails.at), 1e-10, 1e-12)?;
            close(found.above, of(|tails| tails.above), 1e-10, 1e-12)?;
        }
    }
    Ok(())
}

/// Start, moves, convention, parameters and observations.
fn small() -> impl Strategy<Value = (Vec<f64>, Matrix, bool, Vec<f64>, Vec<Option<f64>>)> {
    (1..=3_usize, 0..=5_usize).prop_flat_map(|(n, steps)| {
        let parameters = vec(0.2..9.0_f64, n);
        let number = prop_oneof![1 => Just(None), 5 => (0.01..12.0_f64).prop_map(Some)];
        (
            distribution(false, n),
            stochastic(false, n),
            any::<bool>(),
            parameters,
            vec(number, steps),
        )
    })
}

proptest! {
    #![proptest_config(cases_of(1000))]

    #[test]
    fn are_those_of_all_paths((start, moves, at_first, parameters, numbers) in small()) {
        let rows: Vec<[f64; 1]> = parameters.iter().map(|p| [*p]).collect();
        let model = [&vec![start.clone()], &moves];
        let transition = || DenseTransition::from_rows(&moves).unwrap();
        let observed = |numbers: &[Option<f64>]| -> Vec<[f64; 1]> {
            numbers.iter().map(|y| [y.unwrap_or(f64::NAN)]).collect()
        };
        let times = Exponential::family(&rows).unwrap().with_missing();
        let hmm = Hmm::new(prior(&start, at_first), transition(), times).unwrap();
        compare(&hmm, model, &observed(&numbers), &numbers)?;

        let whole: Vec<Option<f64>> = numbers.iter().map(|y| y.map(f64::floor)).collect();
        let events = Poisson::family(&rows).unwrap().with_missing();
        let hmm = Hmm::new(prior(&start, at_first), transition(), events).unwrap();
        compare(&hmm, model, &observed(&whole), &whole)?;
    }

    /// With symbols that some states rule out and others still expect.
    #[test]
    fn are_those_of_all_paths_with_impossible_symbols(
        (start, moves, table, at_first, seen) in (1..=3_usize).prop_flat_map(|n| {
            let symbol = prop_oneof![1 => Just(None), 5 => (0..3_usize).prop_map(Some)];
            let table = vec(distribution(false, 3), n);
            (distribution(false, n), stochastic(false, n), table, any::<bool>(), vec(symbol, 0..6))
        })
    ) {
        let table = OptionalLikelihood::new(TableLikelihood::from_rows(&table).unwrap());
        let transition = DenseTransition::from_rows(&moves).unwrap();
        let hmm = Hmm::new(prior(&start, at_first), transition, table).unwrap();
        let numbers: Vec<Option<f64>> = seen.iter().map(|y| y.map(|y| y as f64)).collect();
        compare(&hmm, [&vec![start.clone()], &moves], &seen, &numbers)?;
    }
}

/// Uniform values of forecast residuals.
fn uniform(residuals: &[Option<Tails>]) -> Vec<f64> {
    residuals.iter().flatten().map(Tails::uniform).collect()
}

fn random<B>(hmm: &Hmm<DenseTransition, B>, steps: usize, seed: u64) -> Vec<Vec<f64>>
where
    B: SampleObservation<Sample = Vec<f64>>,
{
    hmm.simulate(steps, &mut rng(seed)).observations().to_vec()
}

fn gaussian(scale: f64) -> Hmm<DenseTransition, Gaussian> {
    let moves = [[0.95, 0.0, 0.2], [0.05, 0.9, 0.0], [0.0, 0.1, 0.8]];
    let variances = [1.0, 9.0, 0.25].map(|variance| variance * scale);
    Hmm::new(
        Prior::AtFirstObservation(Belief::uniform(3).unwrap()),
        DenseTransition::from_rows(&moves).unwrap(),
        Gaussian::spherical(&[[0.0], [-2.0], [4.0]], &variances).unwrap(),
    )
    .unwrap()
}

#[test]
fn are_uniform_and_independent_under_the_true_model() {
    for seed in 0..3 {
        let hmm = gaussian(1.0);
        let seen = random(&hmm, 4000, seed);
        let residuals = PseudoResiduals::new(&hmm, &seen, 0).unwrap();
        let distance = distance_from_uniform(uniform(residuals.forecast()));
        assert!(distance < FURTHEST, "{distance}");
        // Products of neighbours are uncorrelated, with a variance of 1: four standard errors,
        // which happens once in 16,000.
        let normal: Vec<f64> = residuals.forecast().iter().flatten().map(Tails::normal).collect();
        let products = normal.windows(2).map(|pair| pair[0] * pair[1]).sum::<f64>();
        assert!(products.abs() < 4.0 * 4000_f64.sqrt(), "{products}");
        let mean = normal.iter().sum::<f64>() / 4000_f64.sqrt();
        assert!(mean.abs() < 4.0, "{mean}");
        // Their quantiles are normal, and a wrong model is detected.
        let wrong = PseudoResiduals::new(&gaussian(1.5), &seen, 0).unwrap();
        let distance = distance_from_uniform(uniform(wrong.forecast()));
        assert!(distance > FURTHEST, "{distance}");
    }
}

#[test]
fn of_counts_are_uniform_if_randomized() {
    for seed in 0..3 {
        let hmm = counts();
        let seen = random(&hmm, 4000, seed);
        let (residuals, mut rng) = (PseudoResiduals::new(&hmm, &seen, 0).unwrap(), rng(seed + 100));
        let drawn = residuals.forecast().iter().flatten().map(|tails| {
            let drawn = tails.randomized(&mut rng);
            let [low, high] = tails.segment();
            assert!(low <= drawn.uniform() && drawn.uniform() <= high && drawn.at == 0.0);
            let [low, high] = tails.normal_segment();
            assert!(low <= drawn.normal() && drawn.normal() <= high);
            assert!(low <= tails.normal() && tails.normal() <= high);
            drawn.uniform()
        });
        let distance = distance_from_uniform(drawn.collect());
        assert!(distance < FURTHEST, "{distance}");
        // The midpoints of segments are not.
        let distance = distance_from_uniform(uniform(residuals.forecast()));
        assert!(distance > FURTHEST, "{distance}");
    }
}

/// A component of a row, of a family of several.
#[test]
fn of_components_are_uniform() {
    let angles = VonMises::family(&[[2.5], [-1.0]], &[[2.0], [0.5]]).unwrap();
    let pairs = [[1.0, 0.6, 0.6, 2.0], [3.0, -1.0, -1.0, 1.0]];
    let places = Gaussian::full(&[[0.0, 1.0], [2.0, -1.0]], &pairs).unwrap();
    let hmm = Hmm::new(
        Prior::BeforeFirstTransition(Belief::uniform(2).unwrap()),
        DenseTransition::from_rows(&[[0.9, 0.3], [0.1, 0.7]]).unwrap(),
        Product::new(angles, places).unwrap(),
    )
    .unwrap();
    let seen = random(&hmm, 3000, 5);
    for component in 0..3 {
        let residuals = PseudoResiduals::new(&hmm, &seen, component).unwrap();
        let distance = distance_from_uniform(uniform(residuals.forecast()));
        assert!(distance < FURTHEST, "{component}: {distance}");
    }
    // Angles beyond π are the same as those within.
    let turned: Vec<Vec<f64>> =
        seen.iter().map(|row| vec![row[0] + 4.0 * std::f64::consts::PI, row[1], row[2]]).collect();
    let [found, same] = [&seen, &turned].map(|rows| PseudoResiduals::new(&hmm, rows, 0).unwrap());
    for (found, same) in found.ordinary().iter().flatten().zip(same.ordinary().iter().flatten()) {
        assert!((found.below - same.below).abs() < 1e-12);
    }
}

#[test]
fn of_a_learned_model_and_far_outliers() {
    let mut seen: Vec<f64> = random(&gaussian(1.0), 400, 7).concat();
    seen[200] += 45.0;
    let rows = Rows::new(&seen, 1).unwrap();
    let options = LearningOptions::default().with_iterations(2);
    let learned = gaussian(1.0).learn(&[rows], &options);
    let learned = learned.unwrap();
    for hmm in [learned.model(), &gaussian(1.0)] {
        let residuals = PseudoResiduals::new(hmm, &rows, 0).unwrap();
        let all = residuals.forecast().iter().chain(residuals.ordinary()).flatten();
        assert!(all.clone().all(|tails| tails.normal().is_finite()));
        // The ordinary residual is extreme on either side.
        let largest = residuals.ordinary().iter().flatten().map(|tails| tails.normal().abs());
        let largest: Vec<f64> = largest.collect();
        assert!(largest.iter().all(|z| *z <= largest[200]), "{}", largest[200]);
    }
    // A residual of 14 is not infinite.
    let residuals = PseudoResiduals::new(&gaussian(1.0), &rows, 0).unwrap();
    let z = residuals.forecast()[200].unwrap().normal();
    assert!(z > 10.0 && z < 20.0, "{z}");
}

#[test]
fn name_what_is_wrong() {
    let hmm: Counts = counts();
    let found = PseudoResiduals::new(&hmm, &[[1.0], [2.5]], 0);
    says(
        found,
        "step 2 has no valid likelihood: the sensor failed: component 0 of the observation is 2.5, expected a whole number from 0 to 2^53",
    );
    let found = PseudoResiduals::new(&hmm, &[[1.0]], 1);
    says(
        found,
        "step 1 has no valid likelihood: the sensor failed: there is no component 1, observations have 1",
    );
    let found = PseudoResiduals::new(&hmm, &[[1.0, 2.0]], 0);
    says(
        found,
        "step 1 has no valid likelihood: the sensor failed: the observation has 2 components, expected 1",
    );
    let nothing: [[f64; 1]; 0] = [];
    assert!(PseudoResiduals::new(&hmm, &nothing, 0).unwrap().forecast().is_empty());
    let sure = Hmm::new(
        Prior::AtFirstObservation(Belief::certain(1, 0).unwrap()),
        DenseTransition::from_rows(&[[1.0]]).unwrap(),
        Poisson::family(&[[0.0]]).unwrap(),
    )
    .unwrap();
    let found = PseudoResiduals::new(&sure, &[[0.0], [1.0]], 0);
    says(found, "the observation of step 2 is impossible under the model");
    let residuals = PseudoResiduals::new(&sure, &[[0.0]], 0).unwrap();
    assert_eq!(residuals.ordinary()[0], Some(Tails { below: 0.0, at: 1.0, above: 0.0 }));
    let _: &Independent<Poisson> = hmm.likelihood();
}
