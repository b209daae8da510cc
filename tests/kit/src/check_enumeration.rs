//! Every routine of a model against the enumeration of all paths.

use proptest::prelude::*;
use wayfix::{Controlled, Hmm, HmmError, TransitionEntries};

use crate::{Answer, Model, Sensor, all_close, close_logs};

pub fn check_enumeration<A: TransitionEntries<Control = usize>>(
    model: &Model,
    hmm: &Hmm<A, Sensor>,
    ys: &[Option<Vec<f64>>],
    answer: &Answer,
) -> Result<(), TestCaseError> {
    let controls = model.controls();
    let drive = Controlled::new(&controls, ys).unwrap();
    let tolerance = 1e-11;
    let impossible = |error: HmmError| match error {
        HmmError::Impossible { step } | HmmError::ImpossibleMove { step } => Ok(step),
        other => Err(TestCaseError::fail(format!("{other}"))),
    };

    let mut filter = hmm.filter();
    for (index, (control, y)) in controls.iter().zip(ys).enumerate() {
        if answer.impossible_at == Some(index + 1) {
            let before = filter.snapshot();
            prop_assert_eq!(impossible(filter.step_with(control, y).unwrap_err())?, index + 1);
            prop_assert_eq!(filter.snapshot(), before);
            break;
        }
        filter.step_with(control, y).unwrap();
        all_close(filter.belief().as_slice(), &answer.filtered[index + 1], tolerance, 1e-290)?;
    }
    if let Some(step) = answer.impossible_at {
        prop_assert_eq!(impossible(hmm.smooth(&drive).unwrap_err())?, step);
        prop_assert_eq!(impossible(hmm.viterbi(&drive).unwrap_err())?, step);
        return Ok(());
    }
    close_logs(filter.log_likelihood(), answer.log_likelihood, 1e-12)?;

    let filtering = hmm.forward(&drive).unwrap();
    close_logs(filtering.log_likelihood(), answer.log_likelihood, 1e-12)?;
    close_logs(hmm.log_likelihood(&drive).unwrap(), answer.log_likelihood, 1e-12)?;
    let smoothing = hmm.smooth(&drive).unwrap();
    close_logs(smoothing.log_likelihood(), answer.log_likelihood, 1e-12)?;
    for k in 0..=model.steps() {
        let filtered = filtering.posteriors().get(k).unwrap();
        let smoothed = smoothing.posteriors().get(k).unwrap();
        all_close(filtered.as_slice(), &answer.filtered[k], tolerance, 1e-290)?;
        all_close(smoothed.as_slice(), &answer.smoothed[k], tolerance, 1e-290)?;
    }

    let path = hmm.viterbi(&drive).unwrap();
    prop_assert_eq!(path.states().len(), model.steps());
    if model.steps() > 0 {
        close_logs(path.log_probability(), answer.viterbi, 1e-12)?;
        // Legal, and as probable as it says.
        close_logs(model.log_probability(path.states()), answer.viterbi, 1e-12)?;
    }
    Ok(())
}
