//! After its first step, a filter allocates nothing, whatever the family of its observations, and
//! neither do the statistics of learning.

use std::fmt::Debug;

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use wayfix::likelihood::{LearnLikelihood, Likelihood, SampleObservation, Scratch};
use wayfix::{Belief, DenseTransition, Hmm, Prior};
use wayfix_learn::{
    Bernoulli, Beta, Binomial, Exponential, Gamma, Gaussian, GaussianMixture, Hurdle, Independent,
    LinearRegression, LogNormal, Multinomial, NegativeBinomial, Poisson, Product, StudentT,
    VonMises, VonMisesFisher, Weibull, WrappedCauchy, ZeroInflated,
};

use crate::allocations;

type Rows = Vec<Vec<f64>>;

/// Filters rows that two states have emitted, and adds them to statistics, without allocations
/// after the first step.
fn steps_allocate_nothing<B>(name: &str, family: B, rows: &Rows)
where
    B: Likelihood<Observation = [f64]> + LearnLikelihood + Clone + Debug,
{
    let mut statistics = family.statistics();
    let mut scratch = Scratch::default();
    let found = {
        family.diagonal(&rows[0], &mut scratch).unwrap();
        family.add(&mut statistics, &rows[0], &[0.5, 0.5]);
        allocations(|| {
            for row in rows {
                std::hint::black_box(family.diagonal(row, &mut scratch).unwrap());
                family.add(&mut statistics, row, &[0.25, 0.75]);
            }
        })
    };
    assert_eq!(found, 0, "{name}: likelihoods and statistics");

    let prior = Prior::AtFirstObservation(Belief::uniform(2).unwrap());
    let transition = DenseTransition::from_rows(&[[0.8, 0.3], [0.2, 0.7]]).unwrap();
    let hmm = Hmm::new(prior, transition, family).unwrap();
    let mut filter = hmm.filter();
    filter.step(&rows[0]).unwrap();
    let found = allocations(|| rows.iter().for_each(|row| _ = filter.step(row).unwrap()));
    assert_eq!(found, 0, "{name}: steps of a filter");
}

/// The same for observations that the family draws, in full, and with components missing.
fn drawn<B>(name: &str, family: B, with_missing: Option<fn(B) -> B>)
where
    B: SampleObservation<Observation = [f64], Sample = Vec<f64>> + LearnLikelihood + Clone + Debug,
{
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut rows: Rows = (0..100).map(|k| family.sample(k % 2, &mut rng)).collect();
    steps_allocate_nothing(name, family.clone(), &rows);
    let Some(with_missing) = with_missing else { return };
    for (k, row) in rows.iter_mut().enumerate() {
        let d = row.len();
        row[k % d] = f64::NAN;
        if k % 3 == 0 {
            row.fill(f64::NAN);
        }
    }
    steps_allocate_nothing(&format!("{name}, missing"), with_missing(family), &rows);
}

/// Place, heading and count; any may be missing.
type Sensors = Product<Gaussian, Product<Independent<VonMises>, Independent<Poisson>>>;

fn with_missing(sensors: Sensors) -> Sensors {
    let (place, others) = sensors.into_parts();
    let (heading, count) = others.into_parts();
    let others = Product::new(heading.with_missing(), count.with_missing()).unwrap();
    Product::new(place.with_missing(), others).unwrap()
}

#[test]
fn families_allocate_nothing_in_a_step() {
    let means = [[0.0, 1.0, 2.0], [3.0, 1.0, -1.0]];
    let full = [2.0, 0.5, 0.1, 0.5, 1.0, 0.2, 0.1, 0.2, 1.5];
    let gaussians = [
        Gaussian::spherical(&means, &[1.0, 2.0]),
        Gaussian::diagonal(&means, &[[1.0, 2.0, 0.5]; 2]),
        Gaussian::full(&means, &[full; 2]),
        Gaussian::tied(&means, &full),
    ];
    for gaussian in gaussians {
        let gaussian = gaussian.unwrap();
        let name = format!("Gaussian, {:?}", gaussian.covariance_type());
        drawn(&name, gaussian, Some(Gaussian::with_missing));
    }
    let (weights, parts) = ([[0.3, 0.7]; 2], [means, means.map(|mean| mean.map(|m| m + 4.0))]);
    let mixture = GaussianMixture::diagonal(&weights, &parts, &[[[1.0; 3]; 2]; 2]).unwrap();
    drawn("mixture, diagonal", mixture, Some(GaussianMixture::with_missing));
    let mixture = GaussianMixture::full(&weights, &parts, &[[full; 2]; 2]).unwrap();
    drawn("mixture, full", mixture, Some(GaussianMixture::with_missing));
    let mixture = GaussianMixture::spherical(&weights, &parts, &[[1.0; 2]; 2]).unwrap();
    drawn("mixture, spherical", mixture, Some(GaussianMixture::with_missing));
    let mixture = GaussianMixture::tied(&weights, &parts, &[full; 2]).unwrap();
    drawn("mixture, tied", mixture, Some(GaussianMixture::with_missing));
    let missing = |heavy: StudentT| {
        StudentT::new(heavy.degrees(), heavy.gaussian().clone().with_missing()).unwrap()
    };
    let heavy = Gaussian::diagonal(&means, &[[1.0; 3]; 2]).unwrap();
    drawn("Student t, diagonal", StudentT::new(&[4.0, 8.0], heavy).unwrap(), Some(missing));
    let heavy = Gaussian::full(&means, &[full; 2]).unwrap();
    drawn("Student t, full", StudentT::new(&[4.0, 8.0], heavy).unwrap(), Some(missing));

    let rates = [[0.2, 0.9], [0.7, 0.1]];
    drawn("Bernoulli", Bernoulli::family(&rates).unwrap(), Some(Independent::with_missing));
    drawn(
        "Poisson",
        Poisson::family(&[[2.0, 30.0], [7.0, 1.0]]).unwrap(),
        Some(Independent::with_missing),
    );
    let counts = Binomial::family(&[9, 300], &rates).unwrap();
    drawn("binomial", counts, Some(Independent::with_missing));
    drawn("exponential", Exponential::family(&rates).unwrap(), Some(Independent::with_missing));
    let counts = NegativeBinomial::family(&[[2.0, 30.0], [7.0, 1.0]], &rates).unwrap();
    drawn("negative binomial", counts, Some(Independent::with_missing));
    let few = [[Poisson::new(2.0).unwrap(); 2], [Poisson::new(7.0).unwrap(); 2]];
    let counts = ZeroInflated::family(&rates, &few).unwrap();
    drawn("zero-inflated", counts, Some(Independent::with_missing));
    let counts = Hurdle::family(&rates, &few).unwrap();
    drawn("hurdle", counts, Some(Independent::with_missing));
    let gamma = Gamma::family(&[[2.0, 3.0], [0.5, 9.0]], &[[1.0, 2.0], [3.0, 4.0]]).unwrap();
    drawn("gamma", gamma, Some(Independent::with_missing));
    let shapes = [[2.0, 3.0], [0.5, 9.0]];
    let weibull = Weibull::family(&shapes, &shapes).unwrap();
    drawn("Weibull", weibull, Some(Independent::with_missing));
    let beta = Beta::family(&shapes, &shapes).unwrap();
    drawn("beta", beta, Some(Independent::with_missing));
    let turns = WrappedCauchy::family(&shapes, &rates).unwrap();
    drawn("wrapped Cauchy", turns, Some(Independent::with_missing));
    let log_normal =
        LogNormal::family(&[[0.0, 1.0], [2.0, 3.0]], &[[1.0, 0.5], [0.2, 1.0]]).unwrap();
    drawn("log-normal", log_normal, Some(Independent::with_missing));
    let headings = VonMises::family(&[[0.0, 1.0], [2.0, 3.0]], &[[1.0, 5.0], [0.0, 10.0]]).unwrap();
    drawn("von Mises", headings, Some(Independent::with_missing));
    let directions = [[0.0, 0.6, 0.8], [1.0, 0.0, 0.0]];
    let directions = VonMisesFisher::new(&directions, &[5.0, 20.0]).unwrap();
    drawn("von Mises-Fisher", directions, None);
    let counts = Multinomial::new(&[[0.2, 0.3, 0.5], [0.6, 0.3, 0.1]]).unwrap();
    drawn("multinomial", counts.with_trials(20), None);

    let place = Gaussian::full(&[[0.0, 1.0], [3.0, 4.0]], &[[2.0, 0.5, 0.5, 1.0]; 2]).unwrap();
    let heading = VonMises::family(&[[0.0], [2.0]], &[[1.0], [5.0]]).unwrap();
    let count = Poisson::family(&[[2.0], [7.0]]).unwrap();
    let sensors = Product::new(place, Product::new(heading, count).unwrap()).unwrap();
    drawn("product", sensors, Some(with_missing));

    let lines = LinearRegression::full(
        &[[0.5, 1.0], [-0.5, 2.0]],
        &[[0.0, 1.0], [1.0, 0.0]],
        &[[1.0, 0.2, 0.2, 1.0]; 2],
    );
    let mut lines = lines.unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let mut row = |k: usize| -> Vec<f64> {
        let x = [k as f64 * 0.1];
        let y = lines.sample(k % 2, &x, &mut rng).unwrap();
        x.into_iter().chain(y).collect()
    };
    let mut rows: Rows = (0..100).map(&mut row).collect();
    steps_allocate_nothing("regression", lines.clone(), &rows);
    rows.iter_mut().step_by(3).for_each(|row| row[2] = f64::NAN);
    lines = lines.with_missing();
    steps_allocate_nothing("regression, missing", lines, &rows);
}
