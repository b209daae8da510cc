//! Initial parameters of families.

use rand::RngExt;
use wayfix::inference::LearningOptions;
use wayfix::likelihood::{GroupedLikelihood, Groups};
use wayfix::{Belief, DenseTransition, Fixed, Hmm, Prior};
use wayfix_learn::{
    Bernoulli, Binomial, CovarianceType, Exponential, Gamma, Gaussian, GaussianMixture,
    GaussianPrior, LinearRegression, LogNormal, Multinomial, NegativeBinomial, Poisson, Product,
    StartFromClusters, StudentT, VonMises, VonMisesFisher, Weibull, starts,
};

use crate::kit::{rng, says};

/// Standard normal numbers, as sums of uniform ones.
fn normal(seed: u64) -> impl FnMut() -> f64 {
    let mut rng = rng(seed);
    move || (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0
}

/// Two groups of correlated rows around an offset, with every fifth component missing at random.
fn gaps(offset: f64, rows: usize, seed: u64) -> Vec<Vec<f64>> {
    let (mut normal, mut rng) = (normal(seed), rng(seed + 1000));
    let mut missing = |y: f64| if rng.random::<f64>() < 0.2 { f64::NAN } else { y };
    let row = |k: usize| {
        let group = offset + 8.0 * (k / 10 % 2) as f64;
        let a = normal();
        let b = 0.8 * a + 0.6 * normal();
        vec![missing(group + a), missing(group - b), missing(3.0 * normal())]
    };
    (0..rows).map(row).collect()
}

/// Starts from both placeholders have the same parameters.
fn same<B: StartFromClusters>(
    placeholders: [B; 2],
    rows: &[Vec<f64>],
    parameters: impl Fn(&B) -> Vec<f64>,
) {
    let [first, second] = placeholders.map(|family| {
        let starts = starts(&family, &[rows], 3, &mut rng(5)).unwrap();
        starts.iter().flat_map(|hmm| parameters(hmm.likelihood())).collect::<Vec<f64>>()
    });
    assert_eq!(first.len(), second.len());
    for (a, b) in first.iter().zip(&second) {
        assert!((a - b).abs() <= 1e-9 * (1.0 + a.abs()), "{a} and {b} in\n{first:?}\n{second:?}");
    }
}

/// A valid covariance of each type in three dimensions, that of the second being larger.
fn covariances(kind: CovarianceType, variance: f64) -> Vec<Vec<f64>> {
    let matrix = |k: usize| if k / 3 == k % 3 { variance } else { 0.3 * variance };
    match kind {
        CovarianceType::Spherical => vec![vec![variance]; 2],
        CovarianceType::Diagonal => vec![vec![variance; 3]; 2],
        CovarianceType::Full => vec![(0..9).map(matrix).collect(); 2],
        CovarianceType::Tied => vec![(0..9).map(matrix).collect()],
    }
}

const KINDS: [CovarianceType; 4] = [
    CovarianceType::Spherical,
    CovarianceType::Diagonal,
    CovarianceType::Full,
    CovarianceType::Tied,
];

#[test]
fn placeholders_of_vectors_make_no_difference() {
    let rows = gaps(1000.0, 200, 1);
    let near = [[1000.0, 1000.0, 0.0], [1008.0, 1008.0, 1.0]];
    for kind in KINDS {
        let gaussian = |means: &[[f64; 3]; 2], variance| {
            Gaussian::new(kind, means, &covariances(kind, variance)).unwrap().with_missing()
        };
        let pair = [gaussian(&[[0.0; 3]; 2], 1.0), gaussian(&near, 40.0)];
        same(pair.clone(), &rows, |b| [b.means(), b.covariances()].concat().concat());
        let prior = GaussianPrior::new(3).unwrap().with_covariance(2.0, &[1.0, 2.0, 3.0]).unwrap();
        let pair = pair.map(|family| family.with_prior(prior.clone()).unwrap());
        same(pair, &rows, |b| [b.means(), b.covariances()].concat().concat());
        let student = |means: &[[f64; 3]; 2], variance| {
            StudentT::new(&[5.0, 9.0], gaussian(means, variance)).unwrap()
        };
        let pair = [student(&[[0.0; 3]; 2], 1.0), student(&near, 40.0)];
        let parameters =
            |b: &StudentT| [b.gaussian().means(), b.gaussian().covariances()].concat().concat();
        same(pair, &rows, parameters);
    }
    let mixture = |far: f64, weight: f64| {
        let means = [[[far; 3], [far + 1.0; 3]], [[far + 5.0; 3], [far + 5.0; 3]]];
        let weights = [[weight, 1.0 - weight]; 2];
        [
            GaussianMixture::diagonal(&weights, &means, &[[[1.0 + weight; 3]; 2]; 2]).unwrap(),
            GaussianMixture::full(&weights, &means, &vec![covariances(KINDS[2], weight); 2])
                .unwrap(),
            GaussianMixture::spherical(&weights, &means, &[[1.0 + weight; 2]; 2]).unwrap(),
            GaussianMixture::tied(&weights, &means, &covariances(KINDS[2], weight)).unwrap(),
        ]
        .map(GaussianMixture::with_missing)
    };
    for (near, far) in mixture(0.0, 0.5).into_iter().zip(mixture(1003.0, 0.1)) {
        let pair = [near, far];
        same(pair, &rows, |b| {
            let parts = [b.means(), b.covariances()].concat().concat().concat();
            let weights = (0..2).flat_map(|state| b.weights(state).unwrap().to_vec());
            parts.into_iter().chain(weights).collect()
        });
    }
}

#[test]
fn placeholders_of_regressions_make_no_difference() {
    // Inputs are complete.
    let mut rows = gaps(1000.0, 200, 2);
    let mut inputs = normal(3);
    rows.iter_mut().for_each(|row| row[0] = 1000.0 + inputs());
    let pair = [0.0, 3.0].map(|slope| {
        LinearRegression::diagonal(&[[slope; 2]; 2], &[[slope; 2]; 2], &[[1.0 + slope; 2]; 2])
    });
    let parameters = |b: &LinearRegression| {
        let state =
            |state| [b.coefficients(state).unwrap(), b.noise().covariance(state).unwrap()].concat();
        [state(0), state(1)].concat()
    };
    same(pair.map(|family| family.unwrap().with_missing()), &rows, parameters);
    let pair = [0.0, 3.0].map(|slope| {
        let covariance = [1.0 + slope, 0.1 * slope, 0.1 * slope, 1.0];
        LinearRegression::full(&[[slope; 2]; 2], &[[slope; 2]; 2], &[covariance; 2])
    });
    same(pair.map(|family| family.unwrap().with_missing()), &rows, parameters);
}

#[test]
fn placeholders_of_counts_and_directions_make_no_difference() {
    let numbers = gaps(50.0, 200, 4);
    let positive: Vec<Vec<f64>> =
        numbers.iter().map(|row| row[..2].iter().map(|y| y.abs() + 0.1).collect()).collect();
    let counts: Vec<Vec<f64>> =
        positive.iter().map(|row| row.iter().map(|y| y.round()).collect()).collect();
    let events: Vec<Vec<f64>> =
        counts.iter().map(|row| row.iter().map(|y| y % 2.0).collect()).collect();
    let pair = [0.1, 0.9].map(|p| Bernoulli::family(&[[p; 2]; 2]).unwrap().with_missing());
    same(pair, &events, |b| b.parameters(Bernoulli::probability).concat());
    let pair = [1.0, 900.0].map(|rate| Poisson::family(&[[rate; 2]; 2]).unwrap().with_missing());
    same(pair, &counts, |b| b.parameters(Poisson::rate).concat());
    let pair =
        [1.0, 9.0].map(|k| Gamma::family(&[[k; 2]; 2], &[[k; 2]; 2]).unwrap().with_missing());
    same(pair, &positive, |b| {
        [b.parameters(Gamma::shape), b.parameters(Gamma::scale)].concat().concat()
    });
    let pair =
        [0.5, 9.0].map(|k| LogNormal::family(&[[k; 2]; 2], &[[k; 2]; 2]).unwrap().with_missing());
    same(pair, &positive, |b| {
        [b.parameters(LogNormal::mean), b.parameters(LogNormal::deviation)].concat().concat()
    });
    let pair =
        [0.1, 3.0].map(|k| VonMises::family(&[[k; 2]; 2], &[[k; 2]; 2]).unwrap().with_missing());
    same(pair, &positive, |b| {
        [b.parameters(VonMises::mean), b.parameters(VonMises::concentration)].concat().concat()
    });
    let pair = [0.1, 3.0].map(|k| Exponential::family(&[[k; 2]; 2]).unwrap().with_missing());
    same(pair, &positive, |b| b.parameters(Exponential::rate).concat());
    let pair =
        [0.1, 0.9].map(|p| Binomial::family(&[500; 2], &[[p; 2]; 2]).unwrap().with_missing());
    same(pair, &counts, |b| b.parameters(Binomial::probability).concat());
    let pair =
        [0.5, 9.0].map(|k| Weibull::family(&[[k; 2]; 2], &[[k; 2]; 2]).unwrap().with_missing());
    same(pair, &positive, |b| {
        [b.parameters(Weibull::shape), b.parameters(Weibull::scale)].concat().concat()
    });
    let pair = [0.0, 9.0].map(|k| {
        NegativeBinomial::family(&[[k + 1.0; 2]; 2], &[[k; 2]; 2]).unwrap().with_missing()
    });
    same(pair, &counts, |b| {
        let means = b.parameters(NegativeBinomial::mean);
        [means, b.parameters(NegativeBinomial::dispersion)].concat().concat()
    });
    // Only whole rows may be missing.
    let rows: Vec<Vec<f64>> = counts
        .iter()
        .map(|row| if row.iter().any(|y| y.is_nan()) { vec![f64::NAN; 2] } else { row.clone() })
        .collect();
    let pair = [0.1, 0.7].map(|p| Multinomial::new(&[[p, 1.0 - p]; 2]).unwrap().with_missing());
    same(pair, &rows, |b| b.probabilities().concat());
    let directions: Vec<Vec<f64>> =
        rows.iter().map(|row| row[0].sin_cos()).map(|(sin, cos)| vec![sin, cos]).collect();
    let pair = [0.6, 0.8].map(|x: f64| {
        let mean = [x, (1.0 - x * x).sqrt()];
        VonMisesFisher::new(&[mean; 2], &[x, 90.0 * x]).unwrap().with_missing()
    });
    same(pair, &directions, |b| [b.means().concat(), b.concentrations().to_vec()].concat());
}

/// Learning ends at the same maximum as from known good parameters.
#[test]
fn learning_far_from_the_placeholder_ends_at_the_same_maximum() {
    for seed in [11, 12, 13] {
        let rows = gaps(100_000.0, 300, seed);
        let options = LearningOptions::default().with_iterations(300);
        for kind in KINDS {
            let family = |means: &[[f64; 3]; 2]| {
                Gaussian::new(kind, means, &covariances(kind, 4.0)).unwrap().with_missing()
            };
            let prior = Prior::AtFirstObservation(Belief::uniform(2).unwrap());
            let transition = DenseTransition::from_rows(&[[0.9, 0.1], [0.1, 0.9]]).unwrap();
            let near = [[1e5, 1e5, 0.0], [100_008.0, 100_008.0, 0.0]];
            let near = Hmm::new(prior, transition, family(&near)).unwrap();
            let expected = near.learn(&[&*rows], &options).unwrap().log_likelihood();
            let starts = starts(&family(&[[0.0; 3]; 2]), &[&*rows], 3, &mut rng(seed)).unwrap();
            let fits = Hmm::learn_best(&starts, &[&*rows], &options, |_, _| ()).unwrap();
            let found = fits.log_likelihood();
            assert!(found > expected - 0.1, "{kind:?}: {found} instead of {expected}");
        }
    }
}

/// The second component is missing in the lower cluster.
#[test]
fn a_component_that_a_cluster_never_sees_is_that_of_all() {
    let low = (0..20).map(|k| vec![f64::from(k % 3), f64::NAN]);
    let high = (0..20).map(|k| vec![50.0 + f64::from(k % 3), 7.0 + f64::from(k % 4)]);
    let rows: Vec<Vec<f64>> = low.chain(high).collect();
    for kind in KINDS {
        let values = if kind == CovarianceType::Spherical { 1 } else { 2 };
        let covariances: Vec<Vec<f64>> = match kind {
            CovarianceType::Full => vec![vec![1.0, 0.0, 0.0, 1.0]; 2],
            CovarianceType::Tied => vec![vec![1.0, 0.0, 0.0, 1.0]],
            _ => vec![vec![1.0; values]; 2],
        };
        let family = Gaussian::new(kind, &[[-300.0; 2]; 2], &covariances).unwrap().with_missing();
        let starts = starts(&family, &[&*rows], 5, &mut rng(1)).unwrap();
        let means = starts.iter().map(|start| start.likelihood().mean(0).unwrap());
        // Other starts divide the upper cluster.
        let found: Vec<&[f64]> = means.filter(|mean| mean[0] < 6.0).collect();
        assert!(!found.is_empty());
        for mean in found {
            assert!((mean[1] - 8.5).abs() < 0.5, "{kind:?}: {mean:?}");
        }
    }
}

/// Parts at -1 and 1 of one state, at 20 and 23 of the other, around an offset.
fn parts(offset: f64, seed: u64) -> Vec<[f64; 1]> {
    let mut normal = normal(seed);
    let value = |k: usize| {
        let part = [[-1.0, 1.0], [20.0, 23.0]][k / 15 % 2][k % 2];
        [offset + part + 0.2 * normal()]
    };
    (0..300).map(value).collect()
}

#[test]
fn parts_of_mixtures_are_found_from_equal_ones() {
    for (offset, seed) in [(0.0, 21), (1000.0, 22), (-1e6, 23)] {
        let rows = parts(offset, seed);
        for far in [0.0, 3.0] {
            let means = [[[-far], [far]]; 2];
            let family =
                GaussianMixture::diagonal(&[[0.5; 2]; 2], &means, &[[[1.0]; 2]; 2]).unwrap();
            let starts = starts(&family, &[&*rows], 2, &mut rng(seed)).unwrap();
            let fits = Hmm::learn_best(&starts, &[&*rows], &LearningOptions::default(), |_, _| ());
            let found = fits.unwrap().into_model();
            for (state, expected) in [[-1.0, 1.0], [20.0, 23.0]].iter().enumerate() {
                let mean = |part| found.likelihood().mean(state, part).unwrap()[0] - offset;
                let (low, high) = (mean(0).min(mean(1)), mean(0).max(mean(1)));
                let is_near = (low - expected[0]).abs() < 0.1 && (high - expected[1]).abs() < 0.1;
                assert!(is_near, "state {state} at {offset}: {low} and {high}");
            }
        }
    }
}

/// Clusters of one and of two observations, which have fewer distinct ones than parts.
#[test]
fn mixtures_start_from_clusters_of_few_observations() {
    let mut rows: Vec<[f64; 1]> = (0..40).map(|k| [f64::from(k % 7)]).collect();
    rows.extend([[5000.0], [9000.0], [9001.0]]);
    let family = |weights: [f64; 3]| {
        let [means, variances] = [[[[0.0]; 3]; 3], [[[1.0]; 3]; 3]];
        GaussianMixture::diagonal(&[weights; 3], &means, &variances).unwrap()
    };
    let first = starts(&family([0.2, 0.3, 0.5]), &[&*rows], 1, &mut rng(1)).unwrap();
    for (state, near) in [3.0, 5000.0, 9000.0].into_iter().enumerate() {
        let found = first[0].likelihood();
        let mut means: Vec<f64> = (0..3).map(|part| found.mean(state, part).unwrap()[0]).collect();
        means.sort_by(f64::total_cmp);
        assert!(means[0] < means[1] && means[1] < means[2], "{state}: {means:?}");
        assert!(means.iter().any(|mean| (mean - near).abs() < 1000.0), "{state}: {means:?}");
        assert!(found.weights(state).unwrap().iter().all(|weight| *weight > 0.0));
    }
    // An impossible part stays impossible.
    let found = &starts(&family([0.5, 0.0, 0.5]), &[&*rows], 1, &mut rng(1)).unwrap()[0];
    for state in 0..3 {
        let found = found.likelihood();
        assert_eq!(
            (found.weights(state).unwrap()[1], found.mean(state, 1).unwrap()),
            (0.0, &[0.0][..])
        );
        assert!(found.mean(state, 0) != found.mean(state, 2));
    }
    let few = [[1.0], [2.0], [3.0]];
    let family = GaussianMixture::diagonal(&[[0.25; 4]; 2], &[[[0.0]; 4]; 2], &[[[1.0]; 4]; 2]);
    says(
        starts(&family.unwrap(), &[&few], 1, &mut rng(1)),
        "the sensor cannot be estimated: 3 different observations cannot start 4 parts of a state",
    );
}

/// Outliers do not decide degrees of freedom before means are found.
#[test]
fn students_t_starts_with_its_degrees() {
    let mut normal = normal(31);
    let value = |k: usize| {
        let outlier = if k.is_multiple_of(29) { 30.0 } else { 1.0 };
        [1000.0 + 60.0 * (k / 20 % 2) as f64 + outlier * normal()]
    };
    let rows: Vec<[f64; 1]> = (0..600).map(value).collect();
    let family = Gaussian::diagonal(&[[0.0]; 2], &[[1.0]; 2]).unwrap();
    let family = StudentT::new(&[4.0, 6.0], family).unwrap();
    let first = starts(&family, &[&*rows], 1, &mut rng(1)).unwrap();
    assert_eq!(first[0].likelihood().degrees(), [4.0, 6.0]);
    assert!(!first[0].likelihood().has_fixed_degrees());
    let learned = first[0].learn(&[&*rows], &LearningOptions::default()).unwrap();
    assert!(learned.converged());
    assert!(learned.iterations() < 40, "{}", learned.iterations());
    let means = learned.model().likelihood().gaussian().means().concat();
    assert!((means[0] - 1000.0).abs() < 0.3 && (means[1] - 1060.0).abs() < 0.3, "{means:?}");
    let fixed = starts(&family.with_fixed_degrees(), &[&*rows], 1, &mut rng(1)).unwrap();
    assert!(fixed[0].likelihood().has_fixed_degrees());
}

/// Starts have the settings of the placeholder, and keep what learning keeps.
#[test]
fn starts_keep_what_is_fixed() {
    let rows = parts(100.0, 51);
    let means = [[[99.0], [101.0]], [[120.0], [123.0]]];
    let family = GaussianMixture::diagonal(&[[0.5; 2]; 2], &means, &[[[0.3]; 2]; 2]).unwrap();
    let started = |family: GaussianMixture| {
        starts(&family, &[&*rows], 1, &mut rng(1)).unwrap().remove(0).into_parts().2
    };
    let fixed = started(family.clone().with_missing().with_fixed_means());
    assert!(fixed.takes_missing() && fixed.has_fixed_means() && !fixed.has_fixed_covariances());
    assert_eq!(fixed.means().concat().concat(), [99.0, 101.0, 120.0, 123.0]);
    assert!(fixed.covariance(0, 0).unwrap()[0] != 0.3);
    let fixed = started(family.with_fixed_covariances());
    assert!(!fixed.has_fixed_means() && fixed.has_fixed_covariances());
    assert_eq!(fixed.covariances().concat().concat(), [0.3; 4]);
    assert!(fixed.mean(0, 0).unwrap()[0] != 99.0);
    let family = Gaussian::diagonal(&[[0.0]; 2], &[[0.3]; 2]).unwrap().with_fixed_covariances();
    let family = StudentT::new(&[5.0; 2], family).unwrap();
    let starts = starts(&family, &[&*rows], 1, &mut rng(1)).unwrap();
    let found = starts[0].likelihood();
    assert!(found.gaussian().has_fixed_covariances() && !found.has_fixed_degrees());
    assert_eq!(found.gaussian().covariances().concat(), [0.3; 2]);
}

#[test]
fn the_same_seed_gives_the_same_starts() {
    let rows = parts(0.0, 41);
    let family =
        GaussianMixture::diagonal(&[[0.5; 2]; 2], &[[[0.0]; 2]; 2], &[[[1.0]; 2]; 2]).unwrap();
    let [first, second] = [7, 7].map(|seed| starts(&family, &[&*rows], 3, &mut rng(seed)).unwrap());
    assert_eq!(format!("{first:?}"), format!("{second:?}"));
    // States of one group share a part, and a sensor that is kept stays.
    let gaussian = Gaussian::diagonal(&[[0.0], [1.0]], &[[1.0]; 2]).unwrap();
    let grouped =
        GroupedLikelihood::new(gaussian.clone(), Groups::new(vec![0, 1, 1]).unwrap()).unwrap();
    assert_eq!(starts(&grouped, &[&*rows], 1, &mut rng(1)).unwrap()[0].states(), 3);
    let fixed = starts(&Fixed(gaussian), &[&*rows], 1, &mut rng(1)).unwrap();
    assert_eq!(fixed[0].likelihood().0.means(), [[0.0], [1.0]]);
}

#[test]
fn what_cannot_start_is_named() {
    let family = |n: usize| Gaussian::diagonal(&vec![[0.0; 2]; n], &vec![[1.0; 2]; n]).unwrap();
    let fails = |n: usize, rows: &[Vec<f64>], expected: &str| {
        says(
            starts(&family(n).with_missing(), &[rows], 1, &mut rng(1)),
            &format!("the sensor cannot be estimated: {expected}"),
        );
    };
    fails(2, &[], "there are no observations");
    let six: Vec<Vec<f64>> = (0..24).map(|k| vec![f64::from(k % 6), 1.0]).collect();
    fails(8, &six, "6 different observations cannot start 8 states");
    let missing: Vec<Vec<f64>> = (0..24).map(|k| vec![f64::from(k % 6), f64::NAN]).collect();
    fails(2, &missing, "component 1 is missing in all observations");
    fails(2, &vec![vec![f64::NAN; 2]; 9], "component 0 is missing in all observations");
    let constant: Vec<Vec<f64>> = (0..24).map(|k| vec![f64::from(k % 6), 5.0]).collect();
    let error = starts(&family(2), &[&*constant], 1, &mut rng(1)).unwrap_err().to_string();
    let expected = "component 1 is always 5; leave it out, or give a prior: the variance of state";
    assert!(error.contains(expected), "{error}");
    let prior = GaussianPrior::new(2).unwrap().with_covariance(0.0, &[0.01, 0.01]).unwrap();
    let with_prior = family(2).with_prior(prior).unwrap();
    assert!(starts(&with_prior, &[&*constant], 1, &mut rng(1)).is_ok());
    let mixture =
        GaussianMixture::diagonal(&[[0.5; 2]; 2], &[[[0.0; 2]; 2]; 2], &[[[1.0; 2]; 2]; 2]);
    let error = starts(&mixture.unwrap(), &[&*constant], 1, &mut rng(1)).unwrap_err().to_string();
    let expected = "component 1 is always 5; leave it out, or give a prior: part 0 of a mixture: ";
    assert!(error.contains(expected), "{error}");
    let positive = Gamma::family(&[[1.0; 2]; 2], &[[1.0; 2]; 2]).unwrap();
    let rows: Vec<Vec<f64>> = (0..24).map(|k| vec![f64::from(k % 6 + 1), 5.0]).collect();
    let error = starts(&positive, &[&*rows], 1, &mut rng(1)).unwrap_err().to_string();
    assert!(error.contains("component 1 is always 5; leave it out, or give a prior"), "{error}");
    // Of two families in a row, the second has the constant one.
    let both = Product::new(Poisson::family(&[[1.0]; 2]).unwrap(), family(2)).unwrap();
    let rows: Vec<Vec<f64>> = rows.iter().map(|row| vec![7.0, row[0], row[1]]).collect();
    let error = starts(&both, &[&*rows], 1, &mut rng(1)).unwrap_err().to_string();
    assert!(error.contains("component 2 is always 5; leave it out, or give a prior"), "{error}");
    // Sequence and step of an invalid observation.
    let good = vec![vec![0.0, 1.0], vec![2.0, 5.0], vec![4.0, 3.0]];
    for (row, expected) in [
        (vec![1.0], "the observation has 1 components, expected 2"),
        (
            vec![1.0, f64::INFINITY],
            "component 1 of the observation is inf, expected a finite value (NaN for a missing one only with `with_missing`)",
        ),
    ] {
        let mut bad = good.clone();
        bad[1] = row;
        says(
            starts(&family(2), &[&*good, &*bad], 1, &mut rng(1)),
            &format!(
                "sequence 1 failed: step 2 has no valid likelihood: the sensor failed: {expected}"
            ),
        );
    }
}

#[test]
fn factors_of_a_product_start_by_themselves() {
    // A mixture whose parts are equal in the placeholder, and a count.
    let mut normal = normal(3);
    let row = |k: usize| {
        let group = (k / 20 % 2) as f64;
        let part = if k.is_multiple_of(3) { 6.0 } else { 0.0 };
        vec![1000.0 + 40.0 * group + part + normal(), 3.0 + 20.0 * group + (k % 2) as f64]
    };
    let rows: Vec<Vec<f64>> = (0..200).map(row).collect();
    let placeholder = |mean: f64, rate: f64| {
        let mixture =
            GaussianMixture::diagonal(&[[0.5; 2]; 2], &[[[mean]; 2]; 2], &[[[1.0]; 2]; 2]).unwrap();
        let counts = Poisson::family(&[[rate]; 2]).unwrap();
        Product::new(mixture, counts).unwrap()
    };
    same([placeholder(0.0, 1.0), placeholder(-7.0, 30.0)], &rows, |product| {
        [
            product.first().means().concat().concat(),
            product.second().parameters(Poisson::rate).concat(),
        ]
        .concat()
    });
    let start = &starts(&placeholder(0.0, 1.0), &[&rows], 1, &mut rng(1)).unwrap()[0];
    let mut means = start.likelihood().first().means().concat().concat();
    means.sort_by(f64::total_cmp);
    for (found, expected) in means.iter().zip([1000.0, 1006.0, 1040.0, 1046.0]) {
        assert!((found - expected).abs() < 5.0, "{means:?}");
    }
    // The constant component is that of the row.
    let family = Product::new(Poisson::family(&[[1.0]; 2]).unwrap(), {
        Gaussian::diagonal(&[[0.0; 2]; 2], &[[1.0; 2]; 2]).unwrap()
    });
    let rows: Vec<Vec<f64>> =
        (0..20).map(|k| vec![f64::from(k), 0.1 * f64::from(k), 7.5]).collect();
    let error = starts(&family.unwrap(), &[&rows], 1, &mut rng(1)).unwrap_err().to_string();
    assert!(error.contains("component 2 is always 7.5"), "{error}");
}
