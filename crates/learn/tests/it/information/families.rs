//! Free parameters of families: as many as learning has, and each changes the densities.

use wayfix::Scratch;
use wayfix::inference::{Displacement, FreeParameters};
use wayfix::likelihood::{LearnLikelihood, Likelihood};
use wayfix_learn::{
    Bernoulli, Beta, Binomial, Exponential, Family, Gamma, Gaussian, GaussianMixture,
    GaussianPrior, Hurdle, LinearRegression, LogNormal, Multinomial, NegativeBinomial, Poisson,
    Product, StudentT, VonMises, VonMisesFisher, Weibull, WrappedCauchy, ZeroInflated,
};

/// Log densities of a row in all states.
fn densities<B: Likelihood<Observation = [f64]>>(family: &B, rows: &[&[f64]]) -> Vec<f64> {
    let mut scratch = Scratch::default();
    let mut all = Vec::new();
    for row in rows {
        let diagonal = family.diagonal(row, &mut scratch).unwrap();
        assert!(diagonal.is_log());
        all.extend(diagonal.as_slice().iter().map(|log| log + diagonal.log_factor()));
    }
    all
}

/// Checks a family without parameters at a bound, with rows that tell its parameters apart.
fn check<B>(name: &str, family: &B, rows: &[&[f64]])
where
    B: Family + LearnLikelihood + FreeParameters,
{
    let mut all = Displacement::new(&[]);
    let same = family.displaced(&mut all).unwrap();
    assert_eq!((all.count(), all.at_bound()), (family.free_parameters(), 0), "{name}");
    let before = densities(family, rows);
    let most = |now: &[f64]| before.iter().zip(now).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(most(&densities(&same, rows)) < 1e-12, "{name}");
    for at in 0..all.count() {
        for step in [-0.01, 0.01] {
            let mut by = vec![0.0; all.count()];
            by[at] = step;
            let now = family.displaced(&mut Displacement::new(&by)).unwrap();
            let change = most(&densities(&now, rows));
            assert!(change > 1e-6 && change < 1.0, "{name} {at}: {change}");
        }
    }
}

#[test]
fn distributions_of_numbers_have_as_many_as_learning() {
    let pairs: [&[f64]; 3] = [&[1.0, 0.0], &[0.0, 1.0], &[1.0, 1.0]];
    check("Bernoulli", &Bernoulli::family(&[[0.2, 0.6], [0.5, 0.3]]).unwrap(), &pairs);
    let counts: [&[f64]; 3] = [&[2.0], &[0.0], &[5.0]];
    let poisson = [[Poisson::new(2.0).unwrap()], [Poisson::new(4.0).unwrap()]];
    check("Binomial", &Binomial::family(&[9], &[[0.2], [0.5]]).unwrap(), &counts);
    check("Poisson", &Poisson::family(&[[2.0], [5.0]]).unwrap(), &counts);
    let negative = NegativeBinomial::family(&[[2.0], [5.0]], &[[0.5], [1.0]]).unwrap();
    check("NegativeBinomial", &negative, &counts);
    check("ZeroInflated", &ZeroInflated::family(&[[0.2], [0.4]], &poisson).unwrap(), &counts);
    check("Hurdle", &Hurdle::family(&[[0.2], [0.4]], &poisson).unwrap(), &counts);
    let positive: [&[f64]; 3] = [&[0.3], &[1.7], &[6.0]];
    check("Exponential", &Exponential::family(&[[1.0], [0.3]]).unwrap(), &positive);
    check("Gamma", &Gamma::family(&[[2.0], [3.0]], &[[0.5], [2.0]]).unwrap(), &positive);
    check("LogNormal", &LogNormal::family(&[[0.0], [1.0]], &[[1.0], [0.4]]).unwrap(), &positive);
    check("Weibull", &Weibull::family(&[[1.5], [0.8]], &[[1.0], [2.0]]).unwrap(), &positive);
    let shares: [&[f64]; 2] = [&[0.2], &[0.7]];
    check("Beta", &Beta::family(&[[2.0], [3.0]], &[[1.5], [2.0]]).unwrap(), &shares);
    let angles: [&[f64]; 3] = [&[0.2], &[1.5], &[-3.0]];
    check("VonMises", &VonMises::family(&[[0.0], [2.0]], &[[2.0], [1.0]]).unwrap(), &angles);
    let cauchy = WrappedCauchy::family(&[[0.0], [2.0]], &[[0.5], [0.2]]).unwrap();
    check("WrappedCauchy", &cauchy, &angles);
}

#[test]
fn vectors_have_as_many_as_learning() {
    let rows: [&[f64]; 4] = [&[0.3, -0.8], &[1.7, 0.4], &[-0.5, 0.9], &[2.0, 2.5]];
    let (means, matrix) = ([[0.0, 0.5], [1.0, 2.0]], [2.0, 0.5, 0.5, 1.0]);
    let full = Gaussian::full(&means, &[matrix, [1.0, -0.2, -0.2, 0.5]]).unwrap();
    check("full", &full, &rows);
    check("spherical", &Gaussian::spherical(&means, &[1.0, 2.0]).unwrap(), &rows);
    check("diagonal", &Gaussian::diagonal(&means, &[[1.0, 2.0], [0.5, 1.0]]).unwrap(), &rows);
    let tied = Gaussian::tied(&means, &matrix).unwrap();
    check("tied", &tied, &rows);
    check("fixed means", &full.clone().with_fixed_means(), &rows);
    check("fixed covariances", &tied.clone().with_fixed_covariances(), &rows);
    let prior = GaussianPrior::new(2).unwrap().with_mean(1.0, &[0.0, 0.0]).unwrap();
    let with_prior = full.clone().with_prior(prior).unwrap();
    check("with a prior", &with_prior, &rows);
    let moved = with_prior.displaced(&mut Displacement::new(&[1.0])).unwrap();
    assert!(moved.log_prior(0.0) < with_prior.log_prior(0.0));

    let t = StudentT::new(&[3.0, 5.0], full.clone()).unwrap();
    check("t", &t, &rows);
    check("t of known degrees", &t.with_fixed_degrees(), &rows);
    let weights = [[0.3, 0.7], [0.5, 0.5]];
    let parts = [[[0.0, 0.5], [1.0, 2.0]], [[-1.0, 0.0], [0.5, 0.5]]];
    let mixture = GaussianMixture::full(&weights, &parts, &[[matrix; 2]; 2]).unwrap();
    check("mixture", &mixture, &rows);
    check("tied mixture", &GaussianMixture::tied(&weights, &parts, &[matrix; 2]).unwrap(), &rows);
    let multinomial = Multinomial::new(&[[0.3, 0.7], [0.6, 0.4]]).unwrap();
    check("multinomial", &multinomial, &[&[2.0, 1.0], &[0.0, 3.0]]);
    let (slopes, intercepts) = ([[1.0], [-0.5]], [[0.0], [1.0]]);
    let lines = LinearRegression::diagonal(&slopes, &intercepts, &[[1.0], [2.0]]).unwrap();
    check("regression", &lines, &rows);
    let lines =
        LinearRegression::full(&[[1.0, 0.5], [-0.5, 0.0]], &[[0.0, 1.0], [1.0, 1.0]], &[matrix; 2]);
    check(
        "regressions",
        &lines.unwrap(),
        &[&[0.3, -0.8, 0.2], &[1.2, 0.3, 1.5], &[-0.4, 2.0, 0.1]],
    );
    let unit: [&[f64]; 3] = [&[0.6, 0.0, 0.8], &[0.0, -1.0, 0.0], &[0.48, 0.6, 0.64]];
    let directions =
        VonMisesFisher::new(&[[1.0, 0.0, 0.0], [-0.6, 0.0, -0.8]], &[2.0, 5.0]).unwrap();
    check("directions", &directions, &unit);
    let both = Product::new(Poisson::family(&[[2.0], [5.0]]).unwrap(), full).unwrap();
    check("product", &both, &[&[1.0, 0.3, -0.8], &[4.0, 1.7, 0.4], &[0.0, -0.5, 0.9]]);
}

/// A direction stays a unit vector, also over a long way, and covers the distance.
#[test]
fn directions_keep_their_length() {
    for mean in [[1.0, 0.0, 0.0], [-0.6, 0.0, -0.8], [0.48, -0.6, 0.64]] {
        let family = VonMisesFisher::new(&[mean], &[2.0]).unwrap();
        for by in [[0.3, 0.0], [0.0, -0.7], [1.0, 1.0], [-2.0, 0.5]] {
            let moved = family.displaced(&mut Displacement::new(&by)).unwrap();
            let now = &moved.means()[0];
            let length: f64 = now.iter().map(|x| x * x).sum();
            assert!((length - 1.0).abs() < 1e-14);
            let cosine: f64 = now.iter().zip(mean).map(|(a, b)| a * b).sum();
            assert!((cosine - by[0].hypot(by[1]).cos()).abs() < 1e-14);
        }
    }
}

/// Parameters at the ends of their ranges stay there, and are counted.
#[test]
fn parameters_at_bounds_stay() {
    let mut all = Displacement::new(&[]);
    Bernoulli::family(&[[0.0, 0.5], [1.0, 0.3]]).unwrap().displaced(&mut all).unwrap();
    assert_eq!((all.count(), all.at_bound()), (2, 2));
    let mut all = Displacement::new(&[]);
    Poisson::family(&[[0.0], [3.0]]).unwrap().displaced(&mut all).unwrap();
    assert_eq!((all.count(), all.at_bound()), (1, 1));
    let mut far = Displacement::new(&[2000.0, 0.0]);
    assert!(Poisson::family(&[[1.0], [3.0]]).unwrap().displaced(&mut far).is_err());
}
