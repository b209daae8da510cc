//! The federal funds rate, in percent, by quarters from 1954 to 2010 (Board of Governors of the
//! Federal Reserve System, by FRED): two states with a mean each and one variance. The fit is that of
//! Stata's manual of `mswitch`, which statsmodels' tests reproduce; both start in the stationary
//! distribution.

use wayfix::inference::LearningOptions;
use wayfix::{DenseTransition, Hmm, Prior};
use wayfix_learn::Gaussian;

#[rustfmt::skip]
const RATES: [f64; 226] = [
    1.03, 0.99, 1.34, 1.5, 1.94, 2.36, 2.48, 2.69, 2.81, 2.93, 2.93, 3.0, 3.23, 3.25, 1.86, 0.94,
    1.32, 2.16, 2.57, 3.08, 3.58, 3.99, 3.93, 3.7, 2.94, 2.3, 2.0, 1.73, 1.68, 2.4, 2.46, 2.61,
    2.85, 2.92, 2.97, 2.96, 3.33, 3.45, 3.46, 3.49, 3.46, 3.58, 3.97, 4.08, 4.07, 4.17, 4.56,
    4.91, 5.41, 5.56, 4.82, 3.99, 3.89, 4.17, 4.79, 5.98, 5.94, 5.92, 6.57, 8.33, 8.98, 8.94,
    8.57, 7.88, 6.7, 5.57, 3.86, 4.56, 5.47, 4.75, 3.54, 4.3, 4.74, 5.14, 6.54, 7.82, 10.56, 10.0,
    9.32, 11.25, 12.09, 9.35, 6.3, 5.42, 6.16, 5.41, 4.83, 5.2, 5.28, 4.87, 4.66, 5.16, 5.82,
    6.51, 6.76, 7.28, 8.1, 9.58, 10.07, 10.18, 10.95, 13.58, 15.05, 12.69, 9.84, 15.85, 16.57,
    17.78, 17.58, 13.59, 14.23, 14.51, 11.01, 9.29, 8.65, 8.8, 9.46, 9.43, 9.69, 10.56, 11.39,
    9.27, 8.48, 7.92, 7.9, 8.1, 7.83, 6.92, 6.21, 6.27, 6.22, 6.65, 6.84, 6.92, 6.66, 7.16, 7.98,
    8.47, 9.44, 9.73, 9.08, 8.61, 8.25, 8.24, 8.16, 7.74, 6.43, 5.86, 5.64, 4.82, 4.02, 3.77,
    3.26, 3.04, 3.04, 3.0, 3.06, 2.99, 3.21, 3.94, 4.49, 5.17, 5.81, 6.02, 5.8, 5.72, 5.36, 5.24,
    5.31, 5.28, 5.28, 5.52, 5.53, 5.51, 5.52, 5.5, 5.53, 4.86, 4.73, 4.75, 5.09, 5.31, 5.68, 6.27,
    6.52, 6.47, 5.59, 4.33, 3.5, 2.13, 1.73, 1.75, 1.74, 1.44, 1.25, 1.25, 1.02, 1.0, 1.0, 1.01,
    1.43, 1.95, 2.47, 2.94, 3.46, 3.98, 4.46, 4.91, 5.25, 5.25, 5.26, 5.25, 5.07, 4.5, 3.18, 2.09,
    1.94, 0.51, 0.18, 0.18, 0.16, 0.12, 0.13, 0.19, 0.19, 0.19,
];

fn model(stay: [f64; 2], means: [f64; 2], variance: f64) -> Hmm<DenseTransition, Gaussian> {
    let a = DenseTransition::from_rows(&[[stay[0], 1.0 - stay[1]], [1.0 - stay[0], stay[1]]]);
    let a = a.unwrap();
    let sensor = Gaussian::tied(&means.map(|mean| [mean]), &[variance]).unwrap();
    Hmm::new(Prior::stationary(&a).unwrap(), a, sensor).unwrap()
}

#[test]
fn the_published_fit_is_found() {
    let rates = RATES.map(|rate| [rate]);
    let printed = model([0.9820939, 1.0 - 0.0503587], [3.70877, 9.556793], 2.107562 * 2.107562);
    let found = printed.log_likelihood(&rates[..]).unwrap();
    assert!((found + 508.63592).abs() < 1e-5, "{found}");

    let start = model([0.9, 0.9], [2.0, 8.0], 9.0);
    let learning = LearningOptions::default().with_iterations(2000).with_tolerance(1e-11);
    let learned = start.learn(&[&rates[..]], &learning).unwrap();
    assert!((learned.objective() + 508.63592).abs() < 1e-5, "{}", learned.objective());
    let model = learned.model();
    for (found, printed, digit) in [
        (model.transition().get(0, 0), 0.9820939, 1e-6),
        (model.transition().get(0, 1), 0.0503587, 1e-6),
        (model.likelihood().mean(0).unwrap()[0], 3.70877, 1e-5),
        (model.likelihood().mean(1).unwrap()[0], 9.556793, 1e-5),
        (model.likelihood().covariance(0).unwrap()[0].sqrt(), 2.107562, 1e-5),
    ] {
        assert!((found - printed).abs() < digit, "{found}, printed {printed}");
    }
}
