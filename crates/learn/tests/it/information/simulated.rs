//! Standard errors of one long sequence, against the spread of estimates.

use wayfix::inference::LearningOptions;
use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
use wayfix_learn::StandardErrors;

use super::{Discrete, kept, probabilities};
use crate::kit::rng;

/// (number of sequences, steps of each): `WAYFIX_SPREAD=2000,5000` for a larger run.
fn size() -> (u64, usize) {
    let text = std::env::var("WAYFIX_SPREAD").unwrap_or_else(|_| "400,1500".to_owned());
    let (count, steps) = text.split_once(',').unwrap();
    (count.parse().unwrap(), steps.parse().unwrap())
}

fn truth() -> Discrete {
    Hmm::new(
        Prior::AtFirstObservation(Belief::uniform(2).unwrap()),
        DenseTransition::from_rows(&[[0.9, 0.2], [0.1, 0.8]]).unwrap(),
        TableLikelihood::from_rows(&[[0.8, 0.1, 0.1], [0.1, 0.3, 0.6]]).unwrap(),
    )
    .unwrap()
}

/// The prior of one sequence runs to the likelier first state: it is known, and all other errors
/// are those of a model whose prior was kept.
#[test]
fn the_prior_of_one_sequence_is_at_a_bound() {
    for seed in 0..5 {
        let sequence = truth().simulate(800, &mut rng(seed)).observations().to_vec();
        let [found, other] = [LearningOptions::default(), kept()].map(|options| {
            let options = options.with_tolerance(1e-4).with_iterations(1000);
            let learned = truth().learn(&[&sequence], &options).unwrap().into_model();
            StandardErrors::from_likelihood(&learned, &[&sequence], &options, probabilities)
                .unwrap()
        });
        assert_eq!((found.at_bound(), other.at_bound()), (1, 0), "{seed}");
        for (a, b) in found.errors().iter().zip(other.errors()) {
            assert!((a / b - 1.0).abs() < 0.05, "{a} {b}");
        }
    }
}

/// The mean variance is the variance of the estimates to within a fifth (a tenth of the standard
/// error); 400 estimates leave an error of 0.07 of it.
#[test]
fn errors_are_those_of_the_spread_of_estimates() {
    let truth = truth();
    let options = kept().with_tolerance(1e-4).with_iterations(1000);
    let (count, steps) = size();
    let expected = probabilities(&truth);
    let numbers = expected.len();
    let (mut sums, mut squares) = (vec![0.0; numbers], vec![0.0; numbers]);
    let (mut variances, mut covered) = (vec![0.0; numbers], vec![0; numbers]);
    for seed in 0..count {
        let sequence = truth.simulate(steps, &mut rng(seed)).observations().to_vec();
        let learned = truth.learn(&[&sequence], &options).unwrap().into_model();
        let found =
            StandardErrors::from_likelihood(&learned, &[&sequence], &options, probabilities)
                .unwrap();
        let intervals = found.intervals(0.95).unwrap();
        for at in 0..numbers {
            let error = found.values()[at] - expected[at];
            sums[at] += error;
            squares[at] += error * error;
            variances[at] += found.errors()[at].powi(2);
            covered[at] += u32::from((intervals[at].0..intervals[at].1).contains(&expected[at]));
        }
    }
    let n = count as f64;
    for at in 0..numbers {
        let spread = ((squares[at] - sums[at] * sums[at] / n) / (n - 1.0)).sqrt();
        let error = (variances[at] / n).sqrt();
        let share = f64::from(covered[at]) / n;
        println!("{:.2}: spread {spread:.5}, errors {error:.5}, covered {share:.3}", expected[at]);
        assert!((error / spread - 1.0).abs() < 0.1, "{at}: {error}, {spread}");
        assert!((0.9..0.99).contains(&share), "{at}: {share}");
    }
}
