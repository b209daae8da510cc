//! All routines give the same with an operator as with its dense matrices.

use proptest::prelude::*;
use proptest::test_runner::TestCaseResult;
use wayfix::inference::ViterbiPath;
use wayfix::{Controlled, Hmm, HmmError, LikelihoodVector, TransitionEntries};

use super::super::{Matrix, NEVER, all_close, close_logs, prior};
use super::{Inputs, Rounding};

/// An operator, and the control of each step.
type Driven<'a, A> = (&'a A, &'a [<A as wayfix::Transition>::Control]);

pub fn check<A, R>(
    operator: Driven<'_, A>,
    dense: Driven<'_, R>,
    matrices: &[Matrix],
    seen: &[Inputs],
    rounding: Rounding,
) -> TestCaseResult
where
    A: TransitionEntries<Control: Clone>,
    R: TransitionEntries<Control: Clone>,
{
    let scaled = |logs: &[f64]| logs.iter().map(|log| log / 50.0).collect();
    // Of usual ranges; at every third step, all are above 0.
    let near = seen.iter().enumerate().map(|(k, inputs)| match k % 3 {
        0 => scaled(&inputs.logs),
        1 => scaled(&inputs.scores),
        _ => {
            let logs = inputs.logs.iter().map(|log| log.max(-5000.0) / 50.0);
            inputs.numbers.iter().zip(logs).map(|(x, log)| x + log).collect()
        }
    });
    let near: Vec<Vec<f64>> = near.collect();
    let far = seen.iter().enumerate();
    let far = far.map(|(k, inputs)| if k % 2 == 0 { &inputs.scores } else { &inputs.logs });
    let far: Vec<Vec<f64>> = far.cloned().collect();
    let tolerance = if rounding.least > 0.0 { 1e-9 } else { 1e-11 };
    for (ys, tolerance) in
        [(near, [tolerance; 3]), (far, [1.0, 10.0, 100.0].map(|x| x * tolerance))]
    {
        match (Outcome::of(operator, &ys), Outcome::of(dense, &ys)) {
            (Ok(found), Ok(expected)) => {
                found.compare(&expected, tolerance)?;
                // Sums of logarithms below 256 are exact, but not where entries are tiny.
                let near = ys.iter().flatten().all(|log| *log == NEVER || log.abs() < 128.0);
                found.check_paths(&expected, matrices, tolerance[0], rounding.exact)?;
                if near && rounding.least == 0.0 {
                    prop_assert_eq!(&found.best[0], &found.path);
                }
            }
            (found, expected) => {
                let (found, expected) = (found.err(), expected.err());
                prop_assert_eq!(found.map(|e| e.to_string()), expected.map(|e| e.to_string()));
            }
        }
    }
    Ok(())
}

/// Results of all routines for one sequence.
struct Outcome {
    /// Log-likelihoods from the smoother and the score.
    log_likelihoods: [f64; 2],
    posteriors: Vec<f64>,
    /// Beliefs with a lag of two steps, after each step.
    lagged: Vec<f64>,
    /// Belief of X_0, with a lag as long as the sequence.
    first: Vec<f64>,
    entropy: f64,
    moves: Vec<f64>,
    path: ViterbiPath,
    /// States from the streaming decoder.
    online: Vec<usize>,
    best: Vec<ViterbiPath>,
}

impl Outcome {
    fn of<A: TransitionEntries<Control: Clone>>(
        (operator, controls): Driven<'_, A>,
        ys: &[Vec<f64>],
    ) -> Result<Self, HmmError> {
        let n = operator.states();
        let start = prior(&vec![1.0 / n as f64; n], false);
        let hmm = Hmm::new(start, operator, LikelihoodVector::log(n).owned()).unwrap();
        let drive = Controlled::new(controls, ys).unwrap();
        let smoothing = match hmm.smooth(&drive) {
            Ok(smoothing) => smoothing,
            Err(error) => {
                assert!(hmm.log_likelihood(&drive).is_err() && hmm.viterbi(&drive).is_err());
                return Err(error);
            }
        };
        let (mut two, mut all) = (hmm.fixed_lag(2), hmm.fixed_lag(ys.len()));
        let (mut lagged, mut decoder, mut online) = (Vec::new(), hmm.online_viterbi(), Vec::new());
        for (control, y) in controls.iter().zip(ys) {
            two.step_with(control, y)?;
            all.step_with(control, y)?;
            lagged.extend_from_slice(two.lagged().as_slice());
            online.extend_from_slice(decoder.step_with(control, y)?);
        }
        online.extend(decoder.undecided());
        let moves = hmm.expected_moves(&drive)?;
        Ok(Self {
            log_likelihoods: [smoothing.log_likelihood(), hmm.log_likelihood(&drive)?],
            posteriors: smoothing.posteriors().as_slice().to_vec(),
            lagged,
            first: all.lagged().as_slice().to_vec(),
            entropy: hmm.path_entropy(&drive)?,
            moves: (0..n * n).map(|at| moves.get(at / n, at % n)).collect(),
            path: hmm.viterbi(&drive)?,
            online,
            best: hmm.k_best(&drive, 7)?,
        })
    }

    /// Compares sums over paths: log-likelihoods, posteriors, and sums of these.
    fn compare(&self, expected: &Self, [logs, posteriors, sums]: [f64; 3]) -> TestCaseResult {
        let log_likelihood = expected.log_likelihoods[0];
        for found in self.log_likelihoods {
            close_logs(found, log_likelihood, logs)?;
        }
        all_close(&self.posteriors, &expected.posteriors, posteriors, 1.0)?;
        all_close(&self.lagged, &expected.lagged, posteriors, 1.0)?;
        prop_assert_eq!(&self.first[..], &self.posteriors[..self.first.len()]);
        close_logs(self.entropy, expected.entropy, sums)?;
        all_close(&self.moves, &expected.moves, sums, 1.0)
    }

    /// Both decoders find the same legal path, which is the first of the best.
    fn check_paths(
        &self,
        expected: &Self,
        matrices: &[Matrix],
        tolerance: f64,
        exact: bool,
    ) -> TestCaseResult {
        let states = self.path.states();
        prop_assert_eq!(&self.online[..], states);
        for (m, pair) in matrices[1..].iter().zip(states.windows(2)) {
            prop_assert!(m[pair[1]][pair[0]] > 0.0, "a move that there is not");
        }
        let log = self.path.log_probability();
        close_logs(log, expected.path.log_probability(), tolerance)?;
        if exact {
            prop_assert_eq!(states, expected.path.states());
        }
        prop_assert_eq!(self.best.len(), expected.best.len());
        for (found, expected) in self.best.iter().zip(&expected.best) {
            close_logs(found.log_probability(), expected.log_probability(), tolerance)?;
        }
        close_logs(self.best[0].log_probability(), log, tolerance)?;
        Ok(())
    }
}
