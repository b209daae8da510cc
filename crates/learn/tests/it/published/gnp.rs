//! Growth of the real gross national product of the United States, in percent, by quarters from 1951 to
//! 1984 (US Bureau of Economic Analysis), as Hamilton (*A new approach to the economic analysis of
//! nonstationary time series and the business cycle*, 1989) uses it: a mean that switches and four
//! lags. Estimates and probabilities are those of statsmodels' tests, which come from EViews.

use wayfix::inference::LearningOptions;
use wayfix_learn::Rows;

use growth::GROWTH;
use model::{SwitchingMean, model};

use super::{lagged, present};

#[path = "../../../examples/gnp/growth.rs"]
mod growth;
#[path = "../../../examples/gnp/model.rs"]
mod model;

/// Printed filtered probabilities of state 1, from the fifth quarter.
#[rustfmt::skip]
const FILTERED: [f64; 131] = [
    0.776712, 0.949192, 0.99632, 0.990258, 0.940111, 0.537442, 0.140001, 0.008942, 0.04848,
    0.614097, 0.910889, 0.995463, 0.979465, 0.992324, 0.984561, 0.751038, 0.776268, 0.522048,
    0.814956, 0.821786, 0.472729, 0.673567, 0.029031, 0.001556, 0.433276, 0.985463, 0.995025,
    0.966067, 0.998445, 0.801467, 0.960997, 0.996431, 0.461365, 0.199357, 0.027398, 0.703626,
    0.946388, 0.985321, 0.998244, 0.989567, 0.98451, 0.986811, 0.793788, 0.973675, 0.984848,
    0.990418, 0.918427, 0.998769, 0.977647, 0.978742, 0.927635, 0.998691, 0.988934, 0.991654,
    0.999288, 0.999073, 0.918636, 0.98771, 0.966876, 0.910015, 0.82615, 0.969451, 0.844049,
    0.941525, 0.993363, 0.949978, 0.615206, 0.970915, 0.787585, 0.707818, 0.200476, 0.050835,
    0.140723, 0.80985, 0.086422, 0.990344, 0.785963, 0.817425, 0.659152, 0.996578, 0.99286,
    0.948501, 0.996883, 0.999712, 0.906694, 0.725013, 0.96369, 0.38696, 0.241302, 0.009078,
    0.015789, 0.000896, 0.54153, 0.928686, 0.953704, 0.992741, 0.935877, 0.918958, 0.977316,
    0.987941, 0.9873, 0.996769, 0.645469, 0.921285, 0.999917, 0.949335, 0.968914, 0.886025,
    0.777141, 0.904381, 0.368277, 0.607429, 0.002491, 0.22761, 0.871284, 0.987717, 0.288705,
    0.512124, 0.030329, 0.005177, 0.256183, 0.020955, 0.05162, 0.549009, 0.991715, 0.987892,
    0.995377, 0.999833, 0.993756, 0.956164, 0.927714,
];

/// Printed smoothed probabilities of state 1, from the fifth quarter.
#[rustfmt::skip]
const SMOOTHED: [f64; 131] = [
    0.968096, 0.991071, 0.998559, 0.958534, 0.540652, 0.072784, 0.010999, 0.006228, 0.172144,
    0.898574, 0.989054, 0.998293, 0.986434, 0.993248, 0.976868, 0.858521, 0.847452, 0.67567,
    0.596294, 0.165407, 0.03527, 0.127967, 0.007414, 0.004944, 0.815829, 0.998128, 0.998091,
    0.993227, 0.999283, 0.9211, 0.977171, 0.971757, 0.12468, 0.06371, 0.11457, 0.954701, 0.994852,
    0.997302, 0.999345, 0.995817, 0.996218, 0.99458, 0.93399, 0.996054, 0.998151, 0.996976,
    0.971489, 0.999786, 0.997362, 0.996755, 0.993053, 0.999947, 0.998469, 0.997987, 0.99983,
    0.99936, 0.953176, 0.992673, 0.975235, 0.938121, 0.946784, 0.986897, 0.905792, 0.969755,
    0.995379, 0.91448, 0.772814, 0.931385, 0.541742, 0.394596, 0.063428, 0.027829, 0.124527,
    0.286105, 0.069362, 0.99595, 0.961153, 0.962449, 0.945022, 0.999855, 0.998943, 0.980041,
    0.999028, 0.999838, 0.863305, 0.607421, 0.575983, 0.0133, 0.007562, 0.000635, 0.001806,
    0.002196, 0.80355, 0.972056, 0.984503, 0.998059, 0.985211, 0.988486, 0.994452, 0.994498,
    0.998873, 0.999192, 0.870482, 0.976282, 0.999961, 0.984283, 0.973045, 0.786176, 0.403673,
    0.275418, 0.115199, 0.25756, 0.004735, 0.493936, 0.90736, 0.873199, 0.052959, 0.076008,
    0.001653, 0.000847, 0.062027, 0.021257, 0.219547, 0.955654, 0.999851, 0.997685, 0.998324,
    0.999939, 0.996858, 0.969209, 0.927714,
];

#[rustfmt::skip]
const MEANS: [f64; 2] = [
    -0.358811, 1.163516,
];
#[rustfmt::skip]
const LAGS: [f64; 4] = [
    0.013486, -0.057521, -0.246983, -0.212923,
];
#[rustfmt::skip]
const TO_0: [f64; 2] = [
    0.754673, 0.095915,
];

fn variance() -> f64 {
    f64::exp(-0.262658 * 2.0)
}

#[test]
fn the_published_probabilities_are_found() {
    let sensor = SwitchingMean { means: MEANS, lags: LAGS, variance: variance() };
    let hmm = model(TO_0, sensor).unwrap();
    let rows = Rows::new(&GROWTH, 1).unwrap().lagged(4).unwrap();
    let found = hmm.log_likelihood(&rows).unwrap();
    assert!((found + 181.26339).abs() < 1e-5, "{found}");

    let filtered = hmm.forward(&rows).unwrap();
    let smoothed = hmm.smooth(&rows).unwrap();
    for k in 0..131 {
        let found = present(filtered.posteriors().get(k + 1).unwrap().as_slice(), 1);
        assert!((found - FILTERED[k]).abs() < 1e-5, "quarter {k}: {found}");
        let found = present(smoothed.posteriors().get(k + 1).unwrap().as_slice(), 1);
        assert!((found - SMOOTHED[k]).abs() < 1e-5, "quarter {k}: {found}");
    }

    // The same by linear regression with an intercept for each state.
    let (prior, a, _) = hmm.into_parts();
    let regression = wayfix::Hmm::new(prior, a, lagged(MEANS, LAGS, variance())).unwrap();
    assert!((regression.log_likelihood(&rows).unwrap() + 181.26339).abs() < 1e-5);
}

#[test]
fn learning_reaches_the_published_fit() {
    let rows = Rows::new(&GROWTH, 1).unwrap().lagged(4).unwrap();
    let start = SwitchingMean { means: [-0.5, 1.0], lags: [0.0; 4], variance: 1.0 };
    let start = model([0.7, 0.1], start).unwrap();
    let options = LearningOptions::default().with_iterations(1000).with_tolerance(1e-9);
    let learned = start.learn(&[rows], &options).unwrap();
    assert!((learned.log_likelihood() + 181.26339).abs() < 1e-5, "{}", learned.log_likelihood());
    let hmm = learned.model();
    let sensor = hmm.likelihood();
    let near = |found: f64, printed: f64| {
        assert!((found - printed).abs() < 2e-4, "{found}, printed {printed}");
    };
    near(hmm.transition().inner().get(0, 0), TO_0[0]);
    near(1.0 - hmm.transition().inner().get(31, 31), TO_0[1]);
    sensor.means.iter().zip(MEANS).for_each(|(found, printed)| near(*found, printed));
    sensor.lags.iter().zip(LAGS).for_each(|(found, printed)| near(*found, printed));
    near(sensor.variance, variance());
    assert_eq!(learned.criteria().parameters, 2 + 2 + 4 + 1);
}
