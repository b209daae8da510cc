//! Places with several images, whose likelihood is the mean over the images.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::likelihood::{Groups, PooledLikelihood, SampleObservation};
use wayfix::{
    Belief, Diagonal, FusedLikelihood, Hmm, HmmError, Likelihood, LikelihoodError,
    LikelihoodVector, OptionalLikelihood, Prior, Scratch, TableLikelihood,
};

use crate::kit::{
    NEVER, all_close, cases_of, close_logs, dense, distribution, log_sum, matrix, rng, sparse,
    still, stochastic, text,
};

/// ln of the mean of numbers that are given as logarithms.
fn log_mean(logs: &[f64]) -> f64 {
    log_sum(logs.iter().copied()) - (logs.len() as f64).ln()
}

/// The place of each image; each of 0 … 2 has at least one.
fn albums() -> impl Strategy<Value = Vec<usize>> {
    vec(0..3_usize, 0..7).prop_map(|more| [more, vec![2, 0, 1]].concat()).prop_shuffle()
}

/// Logarithms of likelihoods, some of them extreme.
fn log_likelihoods() -> impl Strategy<Value = Vec<f64>> {
    let log = prop_oneof![1 => Just(NEVER), 2 => -2000.0..2000.0, 4 => -3.0..0.0];
    let none = Just(vec![NEVER; 9]);
    prop_oneof![1 => none, 9 => vec(log, 9)]
}

/// Sensor that takes a common factor out of given logarithms, or out of numbers.
struct Scaled {
    states: usize,
    log: bool,
}

impl Likelihood for Scaled {
    type Observation = (Vec<f64>, f64);

    fn states(&self) -> usize {
        self.states
    }

    fn diagonal<'a>(
        &'a self,
        (values, log_factor): &'a (Vec<f64>, f64),
        _: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        let diagonal = if self.log { Diagonal::log(values) } else { Diagonal::linear(values) };
        Ok(diagonal.with_log_factor(*log_factor))
    }
}

/// ln b of each place, −∞ where it is ruled out, as a model finds it.
fn found_logs<B: Likelihood>(sensor: &B, y: &B::Observation) -> Vec<f64> {
    let n = sensor.states();
    let log = |place: usize| {
        let prior = Prior::AtFirstObservation(Belief::certain(n, place).unwrap());
        let hmm = Hmm::new(prior, still(n), sensor).unwrap();
        let mut filter = hmm.filter();
        match filter.step(y) {
            Ok(_) => filter.log_likelihood(),
            Err(HmmError::Impossible { step: 1 }) => NEVER,
            Err(error) => panic!("{error}"),
        }
    };
    (0..n).map(log).collect()
}

proptest! {
    #![proptest_config(cases_of(1000))]

    #[test]
    fn pooled_likelihoods_are_means(
        places in albums(), logs in log_likelihoods(), log_factor in -50.0..50.0,
    ) {
        let logs = &logs[..places.len()];
        let mean = |place| {
            let of: Vec<f64> =
                logs.iter().zip(&places).filter(|e| *e.1 == place).map(|e| *e.0).collect();
            log_mean(&of) + log_factor
        };
        let groups = Groups::new(places.clone()).unwrap();
        let states = logs.len();
        let sensor = PooledLikelihood::new(Scaled { states, log: true }, groups.clone()).unwrap();
        prop_assert_eq!(sensor.states(), 3);
        let found = found_logs(&sensor, &(logs.to_vec(), log_factor));
        for (place, found) in found.iter().enumerate() {
            close_logs(*found, mean(place), 1e-12)?;
        }
        // The same as numbers, if doubles hold them.
        if logs.iter().all(|log| *log == NEVER || log.abs() < 700.0) {
            let sensor = PooledLikelihood::new(Scaled { states, log: false }, groups).unwrap();
            let numbers = logs.iter().map(|log| log.exp()).collect();
            let found = found_logs(&sensor, &(numbers, log_factor));
            for (place, found) in found.iter().enumerate() {
                close_logs(*found, mean(place), 1e-12)?;
            }
        }
    }

    /// Whole models, with a table and with logarithms, against the means.
    #[test]
    fn pooled_models_are_those_of_means(
        (places, m) in (albums(), stochastic(false, 3)),
        drives in vec((0..4_usize, log_likelihoods()), 1..6),
        rows in vec(distribution(false, 4), 9),
    ) {
        let (n, groups) = (places.len(), Groups::new(places).unwrap());
        let prior = Prior::AtFirstObservation(Belief::uniform(3).unwrap());
        let pool = |values: &[f64]| -> Vec<f64> {
            let of = |g| groups.states(g).map(|i| values[i]).collect::<Vec<_>>();
            (0..3).map(|g| log_mean(&of(g))).collect()
        };
        let plain = Hmm::new(prior.clone(), dense(&m), LikelihoodVector::log(3).owned()).unwrap();
        let table = TableLikelihood::from_rows(&rows[..n]).unwrap();
        let given = LikelihoodVector::log(n).owned();
        let fused = FusedLikelihood::new(table, OptionalLikelihood::new(given)).unwrap();
        let sensor = PooledLikelihood::new(fused, groups.clone()).unwrap();
        let hmm = Hmm::new(prior, sparse(&m), sensor).unwrap();
        // At every other step, only the table.
        let ys: Vec<_> = drives.iter().enumerate()
            .map(|(k, (y, logs))| (*y, (k % 2 == 1).then(|| logs[..n].to_vec()))).collect();
        let means: Vec<Vec<f64>> = ys.iter().map(|(y, logs)| {
            let log = |i: usize| rows[i][*y].ln() + logs.as_ref().map_or(0.0, |logs| logs[i]);
            pool(&(0..n).map(log).collect::<Vec<_>>())
        }).collect();
        let Ok(expected) = plain.smooth(&means) else {
            prop_assert!(hmm.smooth(&ys).is_err() && hmm.viterbi(&ys).is_err());
            return Ok(());
        };
        let found = hmm.smooth(&ys).unwrap();
        close_logs(found.log_likelihood(), expected.log_likelihood(), 1e-12)?;
        let [a, b] = [&found, &expected].map(|smoothing| smoothing.posteriors().as_slice());
        all_close(a, b, 1e-10, 1.0)?;
        let (path, best) = (hmm.viterbi(&ys).unwrap(), plain.viterbi(&means).unwrap());
        close_logs(path.log_probability(), best.log_probability(), 1e-11)?;
    }
}

#[test]
fn pooled_numbers_at_the_limits_are_not_lost() {
    let pool = |values: [f64; 4]| {
        let images = Groups::new(vec![0, 1, 1, 1]).unwrap();
        let sensor = PooledLikelihood::new(LikelihoodVector::linear(4), images).unwrap();
        found_logs(&sensor, &values)
    };
    // Sums overflow, and means underflow, but not their logarithms.
    let found = pool([1.0, f64::MAX, f64::MAX, f64::MAX]);
    assert!(found[0].abs() < 1e-12 && (found[1] - f64::MAX.ln()).abs() < 1e-12, "{found:?}");
    let least = 5e-324_f64;
    let found = pool([1.0, least, 0.0, 0.0]);
    assert!((found[1] - (least.ln() - 3.0_f64.ln())).abs() < 1e-12, "{found:?}");
    assert_eq!(pool([0.0; 4]), [NEVER; 2]);
    assert_eq!(pool([1.0, 0.0, 0.0, 0.0]), [0.0, NEVER]);
    assert_eq!(pool([0.5, 0.75, 0.75, 0.0]), [0.5_f64.ln(), 0.5_f64.ln()]);
}

#[test]
fn pooled_tails_are_rounded_if_the_model_says_so() {
    let modes = |rounded: bool| {
        let images = Groups::new(vec![0, 1, 1]).unwrap();
        let prior = Prior::AtFirstObservation(Belief::uniform(2).unwrap());
        let seen = [[0.0, -800.0, -800.0], [-1000.0, 0.0, 0.0]];
        let vector = LikelihoodVector::log(3);
        let sensor = PooledLikelihood::new(vector, images).unwrap();
        let hmm = Hmm::new(prior, still(2), sensor).unwrap();
        let hmm = if rounded { hmm.with_rounded_tails() } else { hmm };
        hmm.smooth(&seen).unwrap().posteriors().modes()
    };
    assert_eq!(modes(false), [1, 1]);
    assert_eq!(modes(true), [0, 0]);
}

#[test]
fn bad_pools_are_named() {
    let images = Groups::new(vec![0, 1, 1]).unwrap();
    assert_eq!(
        text(PooledLikelihood::new(LikelihoodVector::linear(2), images.clone())),
        "the grouping has 3 states, expected 2 to match the sensor"
    );
    let sensor = PooledLikelihood::new(LikelihoodVector::linear(3), images).unwrap();
    assert_eq!(sensor.groups().count(), 2);
    assert_eq!(sensor.sensor().states(), 3);
    let prior = Prior::AtFirstObservation(Belief::uniform(2).unwrap());
    let hmm = Hmm::new(prior, still(2), sensor).unwrap();
    let step = |y: &[f64]| {
        let error = hmm.filter().step(y).unwrap_err().to_string();
        error.strip_prefix("step 1 has no valid likelihood: ").unwrap().to_owned()
    };
    // Errors name the image, not the place.
    assert_eq!(
        step(&[0.5, 0.5, f64::NAN]),
        "state 2 has likelihood NaN, expected a finite value of at least 0"
    );
    assert_eq!(
        step(&[0.5, 0.75, -0.25]),
        "state 2 has likelihood -0.25, expected a finite value of at least 0"
    );
    assert_eq!(step(&[0.5; 2]), "the likelihood has 2 values, expected one for each of 3 states");
}

#[test]
fn pooled_sightings_are_drawn_from_all_images() {
    let images = Groups::new(vec![0, 1, 0, 1, 1]).unwrap();
    let names = matrix(5, |image, symbol| f64::from(u8::from(image == symbol)));
    let sensor = PooledLikelihood::new(TableLikelihood::from_rows(&names).unwrap(), images);
    let sensor = sensor.unwrap();
    let mut rng = rng(1);
    let mut seen = [[0; 5]; 2];
    for k in 0..6000 {
        seen[k % 2][sensor.sample(k % 2, &mut rng)] += 1;
    }
    let near = |count: i32, expected: i32| (count - expected).abs() < 150;
    assert!(near(seen[0][0], 1500) && near(seen[0][2], 1500), "{seen:?}");
    assert!([1, 3, 4].iter().all(|&image| near(seen[1][image], 1000)), "{seen:?}");
    assert_eq!(seen.iter().flatten().sum::<i32>(), 6000);
    assert_eq!((seen[0][1], seen[0][3], seen[0][4], seen[1][0], seen[1][2]), (0, 0, 0, 0, 0));
}
