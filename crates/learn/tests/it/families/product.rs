//! Products of families against their factors.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::inference::{LearnError, LearningOptions, Simulation};
use wayfix::likelihood::{LearnLikelihood, SampleObservation};
use wayfix::{Belief, DenseTransition, Fixed, Hmm, Likelihood, Prior, ReorderStates};
use wayfix_learn::{
    Bernoulli, EmissionError, Family, Gamma, Gaussian, Independent, LinearRegression, Multinomial,
    Poisson, Product, VonMises, VonMisesFisher, starts,
};

use crate::kit::{cases, close_logs, rng, says, text};

const DRAWS: usize = 20_000;

/// Two correlated numbers, an angle and a count.
type Sensors = Product<Gaussian, Product<Independent<VonMises>, Independent<Poisson>>>;

/// A product of n states from numbers between −1 and 1, eight a state.
fn sensors(n: usize, numbers: &[f64]) -> Sensors {
    let of = |k: usize| (0..n).map(move |state| numbers[8 * state + k]);
    let means: Vec<[f64; 2]> = of(0).zip(of(1)).map(|(a, b)| [3.0 * a, 9.0 * b]).collect();
    let covariances: Vec<[f64; 4]> = of(2).map(|c| [2.0, c, c, 1.0 + c * c]).collect();
    let angles: Vec<[f64; 1]> = of(3).map(|a| [3.0 * a]).collect();
    let concentrations: Vec<[f64; 1]> = of(4).map(|a| [(3.0 * a).exp()]).collect();
    let rates: Vec<[f64; 1]> = of(5).map(|a| [(3.0 * a).exp()]).collect();
    let places = Gaussian::full(&means, &covariances).unwrap().with_missing();
    let headings = VonMises::family(&angles, &concentrations).unwrap().with_missing();
    let counts = Poisson::family(&rates).unwrap().with_missing();
    Product::new(places, Product::new(headings, counts).unwrap()).unwrap()
}

fn numbers() -> impl Strategy<Value = Vec<f64>> {
    vec(-1.0..1.0, 32)
}

/// Rows that the states emit in turn, without some components.
fn rows(family: &Sensors, missing: &[[bool; 4]], seed: u64) -> Vec<Vec<f64>> {
    let mut rng = rng(seed);
    let row = |(step, missing): (usize, &[bool; 4])| {
        let drawn = family.sample(step % family.states(), &mut rng);
        let known = drawn.iter().zip(missing);
        known.map(|(y, missing)| if *missing { f64::NAN } else { *y }).collect()
    };
    missing.iter().enumerate().map(row).collect()
}

fn missing() -> impl Strategy<Value = Vec<[bool; 4]>> {
    vec(proptest::array::uniform4(proptest::bool::weighted(0.25)), 1..12)
}

fn still<B: Likelihood>(family: B, prior: Belief) -> Hmm<DenseTransition, B> {
    let n = family.states();
    let transition = DenseTransition::from_fn(n, |i, j| f64::from(u8::from(i == j))).unwrap();
    Hmm::new(Prior::AtFirstObservation(prior), transition, family).unwrap()
}

/// Log-density of a row in a state.
fn log_density<B: Likelihood<Observation = [f64]>>(family: &B, state: usize, row: &[f64]) -> f64 {
    let prior = Belief::certain(family.states(), state).unwrap();
    still(family, prior).log_likelihood(&[row]).unwrap()
}

/// Error of a row.
fn refused<B: Likelihood<Observation = [f64]>>(family: &B, row: &[f64]) -> String {
    let prior = Belief::uniform(family.states()).unwrap();
    text(still(family, prior).log_likelihood(&[row]))
}

proptest! {
    #![proptest_config(cases())]

    /// Log-densities add up, whatever is missing.
    #[test]
    fn the_density_is_the_product_of_the_densities(
        n in 1..5_usize, numbers in numbers(), missing in missing(), seed: u64
    ) {
        let family = sensors(n, &numbers);
        prop_assert_eq!(family.components(), 4);
        let (place, (heading, count)) = (family.first(), family.second().clone().into_parts());
        for row in rows(&family, &missing, seed) {
            for state in 0..n {
                let expected = log_density(place, state, &row[..2])
                    + log_density(&heading, state, &row[2..3])
                    + log_density(&count, state, &row[3..]);
                close_logs(log_density(&family, state, &row), expected, 1e-12)?;
            }
        }
    }

    /// A re-estimation is that of each factor from its own components with the same posteriors.
    #[test]
    fn learning_is_that_of_each_factor(
        n in 1..4_usize, numbers in numbers(), missing in missing(), seed: u64
    ) {
        let prior = wayfix_learn::GaussianPrior::new(2).unwrap();
        let prior = prior.with_covariance(3.0, &[1.0, 0.2, 0.2, 1.0]).unwrap();
        let (place, others) = sensors(n, &numbers).into_parts();
        let (heading, count) = others.into_parts();
        let place = place.with_prior(prior).unwrap();
        let heading = heading.with_prior(VonMises::family(&[[0.3]], &[[2.0]]).unwrap(), 0.5).unwrap();
        let parts = Product::new(heading.clone(), count.clone()).unwrap();
        let family = Product::new(place.clone(), parts).unwrap();
        prop_assert_eq!(family.log_prior(0.7), place.log_prior(0.7) + (heading.log_prior(0.7) + count.log_prior(0.7)));
        prop_assert_eq!(
            family.free_parameters(),
            place.free_parameters() + heading.free_parameters() + count.free_parameters()
        );

        let rows = rows(&family, &missing, seed);
        let transition = DenseTransition::from_fn(n, |i, j| if i == j { 0.7 } else { 0.3 / (n - 1) as f64 });
        let transition = if n == 1 { DenseTransition::from_rows(&[[1.0]]) } else { transition };
        let prior = Prior::AtFirstObservation(Belief::uniform(n).unwrap());
        let hmm = Hmm::new(prior, transition.unwrap(), family).unwrap();
        let smoothed = hmm.smooth(&rows).unwrap();

        let mut of_place = place.statistics();
        let mut of_heading = [heading.statistics(), heading.statistics()];
        let mut of_count = count.statistics();
        let mut of_all = [hmm.likelihood().statistics(), hmm.likelihood().statistics()];
        for (step, (row, posterior)) in rows.iter().zip(smoothed.posteriors().iter()).enumerate() {
            place.add(&mut of_place, &row[..2], posterior.as_slice());
            heading.add(&mut of_heading[step % 2], &row[2..3], posterior.as_slice());
            count.add(&mut of_count, &row[3..], posterior.as_slice());
            hmm.likelihood().add(&mut of_all[usize::from(step >= 5)], row, posterior.as_slice());
        }
        let [mut all, rest] = of_all;
        hmm.likelihood().merge(&mut all, &rest);
        let [mut headings, rest] = of_heading;
        heading.merge(&mut headings, &rest);
        let learned = hmm.likelihood().maximize(&all, 0.0).unwrap();

        let place = place.maximize(&of_place, 0.0).unwrap();
        let heading = heading.maximize(&headings, 0.0).unwrap();
        let count = count.maximize(&of_count, 0.0).unwrap();
        for state in 0..n {
            let pairs = learned.first().mean(state).unwrap().iter().zip(place.mean(state).unwrap());
            for (found, expected) in pairs {
                close_logs(*found, *expected, 1e-9)?;
            }
            let found = learned.first().covariance(state).unwrap();
            for (found, expected) in found.iter().zip(place.covariance(state).unwrap()) {
                close_logs(*found, expected, 1e-9)?;
            }
            let found = learned.second().first().component(state, 0).unwrap();
            let expected = heading.component(state, 0).unwrap();
            close_logs(found.concentration(), expected.concentration(), 1e-9)?;
            close_logs((found.mean() - expected.mean()).cos(), 1.0, 1e-12)?;
            let found = learned.second().second().component(state, 0).unwrap().rate();
            close_logs(found, count.component(state, 0).unwrap().rate(), 1e-12)?;
        }
    }
}

/// A single iteration of learning, by hand.
#[test]
fn an_iteration_of_learning_learns_each_factor() {
    let family = Product::new(
        Gamma::family(&[[2.0], [2.0]], &[[1.0], [5.0]]).unwrap(),
        Poisson::family(&[[1.0], [4.0]]).unwrap(),
    );
    let family = family.unwrap();
    let transition = DenseTransition::from_rows(&[[0.8, 0.3], [0.2, 0.7]]).unwrap();
    let prior = Prior::AtFirstObservation(Belief::uniform(2).unwrap());
    let hmm = Hmm::new(prior.clone(), transition.clone(), family.clone()).unwrap();
    let rows = [[1.5, 0.0], [3.0, 2.0], [12.0, 5.0], [9.0, 3.0], [2.0, 1.0], [8.0, 4.0]];
    let options = LearningOptions::default().with_iterations(1);
    let learned = hmm.learn(&[rows], &options).unwrap().into_model();

    let smoothed = hmm.smooth(&rows).unwrap();
    for state in 0..2 {
        let weights = || smoothed.posteriors().iter().map(|p| p.as_slice()[state]).zip(&rows);
        let weight: f64 = weights().map(|(w, _)| w).sum();
        let mean = |c: usize| weights().map(|(w, row)| w * row[c]).sum::<f64>() / weight;
        let speeds = learned.likelihood().first();
        let speed = speeds.component(state, 0).unwrap();
        let found = speed.shape() * speed.scale();
        assert!((found - mean(0)).abs() < 1e-9);
        assert!(
            (learned.likelihood().second().component(state, 0).unwrap().rate() - mean(1)).abs()
                < 1e-12
        );
    }

    // A factor that is fixed stays, while the other is learned.
    let (speeds, counts) = family.into_parts();
    let family = Product::new(Fixed(speeds.clone()), counts.clone()).unwrap();
    assert_eq!(family.free_parameters(), counts.free_parameters());
    let hmm = Hmm::new(prior, transition, family).unwrap();
    let fixed = hmm.learn(&[rows], &options).unwrap().into_model();
    assert_eq!(fixed.likelihood().first().0, speeds);
    assert_eq!(fixed.likelihood().second(), learned.likelihood().second());
}

/// A factor without a value contributes nothing, and learns nothing.
#[test]
fn a_factor_that_is_missing_is_integrated_out() {
    let speeds = Gamma::family(&[[2.0], [2.0]], &[[1.0], [5.0]]).unwrap();
    let directions = VonMisesFisher::new(&[[1.0, 0.0], [0.0, 1.0]], &[2.0, 3.0]).unwrap();
    let family = Product::new(speeds.clone(), directions.clone().with_missing()).unwrap();
    let row = [3.0, f64::NAN, f64::NAN];
    for state in 0..2 {
        assert_eq!(log_density(&family, state, &row), log_density(&speeds, state, &row[..1]));
    }
    let mut statistics = family.statistics();
    for (speed, posterior) in [(3.0, [0.5, 0.5]), (4.0, [0.25, 0.75])] {
        family.add(&mut statistics, &[speed, f64::NAN, f64::NAN], &posterior);
    }
    let learned = family.maximize(&statistics, 0.0).unwrap();
    assert_eq!(learned.second().means(), directions.means());
    assert_eq!(learned.second().concentrations(), directions.concentrations());
    let gamma = learned.first().component(1, 0).unwrap();
    let mean = gamma.shape() * gamma.scale();
    assert!((mean - (0.5 * 3.0 + 0.75 * 4.0) / 1.25).abs() < 1e-12);
    // Only partly missing, which is not taken as missing.
    assert_eq!(
        refused(&family, &[3.0, 1.0, f64::NAN]),
        "step 1 has no valid likelihood: the sensor failed: component 2 of the observation is NaN, expected a finite value"
    );
    assert!(refused(&family, &[f64::NAN, 1.0, 0.0]).contains("component 0 of the observation"));
}

/// States that one factor rules out are ruled out, and large distances do not underflow.
#[test]
fn zeros_and_small_densities_stay_exact() {
    let events = Bernoulli::family(&[[1.0], [0.5]]).unwrap();
    let far = Gaussian::diagonal(&[[0.0], [1.0]], &[[1e-4], [1e-4]]).unwrap();
    let family = Product::new(events, far.clone()).unwrap();
    let hmm = still(&family, Belief::uniform(2).unwrap());
    let mut filter = hmm.filter();
    filter.step([0.0, -30.0].as_slice()).unwrap();
    assert_eq!(filter.belief().as_slice(), [0.0, 1.0]);
    let both = log_density(&family, 1, &[1.0, -300.0]);
    let expected = 0.5_f64.ln() + log_density(&far, 1, &[-300.0]);
    assert!(expected < -4e8 && (both - expected).abs() <= 1e-12 * expected.abs());
}

#[test]
fn errors_count_components_from_the_start_of_the_row() {
    let headings =
        || VonMises::family(&[[0.0, 1.0], [1.0, 2.0]], &[[1.0, 1.0], [1.0, 1.0]]).unwrap();
    let speeds = || Gamma::family(&[[2.0], [2.0]], &[[1.0], [5.0]]).unwrap();
    let counts = || Poisson::family(&[[1.0, 2.0], [4.0, 3.0]]).unwrap();
    let family = Product::new(headings(), Product::new(speeds(), counts()).unwrap()).unwrap();
    let step = "step 1 has no valid likelihood: the sensor failed: ";
    for (component, value, expected) in [
        (1, f64::INFINITY, "a finite angle in radians"),
        (2, -1.5, "a finite value above 0"),
        (4, 0.5, "a whole number from 0 to 2^53"),
    ] {
        let mut row = [0.0, 0.0, 1.0, 1.0, 1.0];
        row[component] = value;
        let error = refused(&family, &row);
        let start = format!(
            "{step}component {component} of the observation is {value}, expected {expected}"
        );
        assert!(error.starts_with(&start), "{error}");
    }
    for found in [0, 1, 4, 6] {
        let error = refused(&family, &vec![1.0; found]);
        assert_eq!(error, format!("{step}the observation has {found} components, expected 5"));
    }
    // Nothing is added, and nothing panics.
    let mut statistics = family.statistics();
    family.add(&mut statistics, &[1.0], &[1.0, 0.0]);
    assert_eq!(family.maximize(&statistics, 0.0).unwrap(), family);

    // Errors that are not about one component name the components.
    let directions = VonMisesFisher::new(&[[1.0, 0.0], [0.0, 1.0]], &[2.0, 3.0]).unwrap();
    let mixed = Product::new(counts(), Product::new(speeds(), directions).unwrap()).unwrap();
    assert_eq!(
        refused(&mixed, &[0.0, 0.0, 1.0, 3.0, 4.0]),
        format!(
            "{step}components 3 to 4 of the row: the observation has length 5, expected 1 within 1e-6"
        )
    );
    let mut statistics = mixed.statistics();
    mixed.add(&mut statistics, &[0.0, 1.0, 2.0, 0.6, 0.8], &[0.5, 0.5]);
    let error = mixed.maximize(&statistics, 0.0).unwrap_err();
    assert!(
        matches!(
            error.downcast_ref::<EmissionError>(),
            Some(EmissionError::Factor { from: 2, to: 3, cause })
                if matches!(**cause, EmissionError::TooFew { state: Some(0), component: Some(0), .. })
        ),
        "{error:?}"
    );
    assert!(
        error.to_string().starts_with("component 2 of the row: the shape of state 0"),
        "{error}"
    );

    // An input and an output.
    let lines = LinearRegression::diagonal(&[[1.0], [2.0]], &[[0.0], [0.0]], &[[1.0], [1.0]]);
    let family = Product::new(counts(), lines.unwrap()).unwrap();
    assert_eq!(family.components(), 4);
    assert!(
        refused(&family, &[1.0, 1.0, f64::NAN, 0.0]).contains("component 2 of the observation")
    );
    assert!(
        refused(&family, &[1.0, 1.0, 0.0, f64::NAN]).contains("component 3 of the observation")
    );
}

#[test]
fn factors_with_different_states_are_refused() {
    let two = Poisson::family(&[[1.0], [4.0]]).unwrap();
    let three = Poisson::family(&[[1.0], [4.0], [9.0]]).unwrap();
    says(
        Product::new(two, three),
        "the list of states of the second factor has 3 values, expected 2",
    );
}

/// Families that are chosen at run time, or shared by reference.
#[test]
fn factors_may_be_behind_pointers() {
    let counts = Poisson::family(&[[1.0], [4.0]]).unwrap();
    let kinds = Multinomial::new(&[[0.2, 0.8], [0.5, 0.5]]).unwrap();
    let chosen: Box<dyn Family> = Box::new(kinds.clone());
    let family = Product::new(&counts, chosen).unwrap();
    assert_eq!(family.components(), 3);
    let direct = Product::new(counts.clone(), kinds).unwrap();
    let row = [2.0, 1.0, 3.0];
    assert_eq!(log_density(&family, 1, &row), log_density(&direct, 1, &row));
}

#[test]
fn states_are_put_in_order_in_both_factors() {
    let values: Vec<f64> = (0..32).map(|k| f64::from(k * 7 % 19) / 19.0).collect();
    let family = sensors(3, &values);
    let other = family.reordered(&[2, 0, 1]);
    let row = [0.5, -1.0, 2.0, 3.0];
    for (new, old) in [2, 0, 1].into_iter().enumerate() {
        assert_eq!(log_density(&other, new, &row), log_density(&family, old, &row));
    }
}

#[cfg(feature = "serde")]
#[test]
fn products_come_back_from_files() {
    let values: Vec<f64> = (0..32).map(|k| f64::from(k * 5 % 17) / 17.0).collect();
    let family = sensors(2, &values);
    let text = serde_json::to_string(&family).unwrap();
    let read: Sensors = serde_json::from_str(&text).unwrap();
    assert_eq!(serde_json::to_string(&read).unwrap(), text);
    assert_eq!(read.second(), family.second());
    let row = [0.5, f64::NAN, 2.0, 3.0];
    assert_eq!(log_density(&read, 1, &row), log_density(&family, 1, &row));

    let counts =
        |rates: &str| format!(r#"{{"version":1,"rates":{rates},"missing":false,"prior":null}}"#);
    let both = format!(
        r#"{{"version":1,"first":{},"second":{}}}"#,
        counts("[[1.0]]"),
        counts("[[1.0],[2.0]]")
    );
    let error = serde_json::from_str::<Product<Independent<Poisson>, Independent<Poisson>>>(&both)
        .unwrap_err();
    assert_eq!(
        error.to_string(),
        "the list of states of the second factor has 2 values, expected 1"
    );
}

/// Means are within five standard errors, and factors are independent.
#[test]
fn draws_have_the_moments_of_both_factors() {
    let speeds = Gamma::family(&[[4.0]], &[[0.5]]).unwrap();
    let counts = Poisson::family(&[[3.0]]).unwrap();
    let family = Product::new(speeds, counts).unwrap();
    for seed in 0..4 {
        let mut rng = rng(seed);
        let rows: Vec<Vec<f64>> = (0..DRAWS).map(|_| family.sample(0, &mut rng)).collect();
        assert!(rows.iter().all(|row| row.len() == 2));
        let within = |value: &dyn Fn(&[f64]) -> f64, expected: f64, variance: f64| {
            let mean = rows.iter().map(|row| value(row)).sum::<f64>() / DRAWS as f64;
            let error = (variance / DRAWS as f64).sqrt();
            assert!((mean - expected).abs() < 5.0 * error, "seed {seed}: {mean}, {expected}");
        };
        within(&|row| row[0], 2.0, 1.0);
        within(&|row| row[1], 3.0, 3.0);
        within(&|row| (row[0] - 2.0) * (row[1] - 3.0), 0.0, 3.0);
    }
}

/// Clusters of rows give all factors initial parameters, which lead learning to the states.
#[test]
fn learning_starts_from_clusters_of_rows() {
    let truth = Product::new(
        VonMises::family(&[[-1.0], [0.5], [2.0]], &[[30.0]; 3]).unwrap(),
        Product::new(
            Gamma::family(&[[20.0]; 3], &[[0.1], [1.0], [0.4]]).unwrap(),
            Poisson::family(&[[4.0], [12.0], [8.0]]).unwrap(),
        )
        .unwrap(),
    );
    let truth = truth.unwrap();
    let transition = DenseTransition::from_fn(3, |i, j| if i == j { 0.9 } else { 0.05 }).unwrap();
    let prior = Prior::AtFirstObservation(Belief::uniform(3).unwrap());
    let hmm = Hmm::new(prior, transition, truth.clone()).unwrap();
    for seed in 0..3 {
        let mut rng = rng(seed);
        let drawn: Vec<_> = (0..3).map(|_| hmm.simulate(200, &mut rng)).collect();
        let sequences: Vec<&[Vec<f64>]> = drawn.iter().map(Simulation::observations).collect();
        let starts = starts(&truth, &sequences, 3, &mut rng).unwrap();
        let fits = Hmm::learn_best(&starts, &sequences, &LearningOptions::default(), |_, _| ());
        let model = fits.unwrap().into_model();
        // Clusters are numbered by heading, as the states are.
        let mut right = 0;
        for (drive, sequence) in drawn.iter().zip(&sequences) {
            let path = model.viterbi(sequence).unwrap();
            right += path.states().iter().zip(drive.states()).filter(|(a, b)| a == b).count();
        }
        assert!(right >= 570, "seed {seed}: {right} of 600");
    }
    let broken = [vec![0.1, 2.0, 3.0], vec![0.2, 20.0, 2.5], vec![0.4, 10.0, 8.0]];
    let error = starts(&truth, &[&broken[..]], 1, &mut rng(1)).unwrap_err();
    assert!(matches!(&error, LearnError::Sequence(_)), "{error}");
    assert!(error.to_string().contains("component 2 of the observation is 2.5"), "{error}");
}
