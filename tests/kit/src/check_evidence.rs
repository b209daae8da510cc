//! All routines of a model with evidence on its moves against the enumeration of all paths.

use proptest::prelude::*;
use wayfix::inference::Order;
use wayfix::{Hmm, HmmError, TransitionEntries};

use crate::{
    Model, Sensor, all_close, check_drawn, check_entropy, check_enumeration, check_fixed_lag,
    check_k_best, check_pairs, close_logs, same_results,
};

/// What is believed after a prediction alone, and p(u), for each step.
fn check_predictions<A: TransitionEntries<Control = usize>>(
    model: &Model,
    hmm: &Hmm<A, Sensor>,
) -> Result<(), TestCaseError> {
    let mut filter = hmm.filter();
    for k in 1..=model.steps() {
        let mut part = Model { logs: model.logs[..k].to_vec(), ..model.clone() };
        part.logs[k - 1] = None;
        let answer = part.enumerate();
        let before = filter.snapshot();
        match filter.predict_with(&(k - 1)) {
            Ok(()) => {
                all_close(filter.belief().as_slice(), &answer.filtered[k], 1e-11, 1e-290)?;
                close_logs(filter.log_likelihood(), answer.log_likelihood, 1e-12)?;
            }
            Err(error) => {
                let step_of = |error: &_| match error {
                    HmmError::ImpossibleMove { step } => Some(*step),
                    _ => None,
                };
                prop_assert_eq!(step_of(&error), answer.impossible_at);
                prop_assert_eq!(filter.snapshot(), before);
                return Ok(());
            }
        }
        // What was measured ahead is known: the forecast is given it.
        filter.restore(&before).unwrap();
        let ahead = filter.forecast_with(&[k - 1]).unwrap();
        all_close(ahead.as_slice(), &answer.filtered[k], 1e-11, 1e-290)?;
        if filter.step_with(&(k - 1), &model.logs[k - 1]).is_err() {
            return Ok(());
        }
        let mut other = hmm.filter();
        other.restore(&filter.snapshot()).unwrap();
        prop_assert_eq!(other.snapshot(), filter.snapshot());
    }
    Ok(())
}

/// The stream is the batch decoder, after every step.
fn check_online<A: TransitionEntries<Control = usize>>(
    model: &Model,
    hmm: &Hmm<A, Sensor>,
) -> Result<(), TestCaseError> {
    let (mut decoder, mut path) = (hmm.online_viterbi(), Vec::new());
    for k in 1..=model.steps() {
        let part = Model { logs: model.logs[..k].to_vec(), ..model.clone() };
        match (decoder.step_with(&(k - 1), &model.logs[k - 1]), hmm.viterbi(&part)) {
            (Ok(states), Ok(batch)) => {
                path.extend_from_slice(states);
                prop_assert_eq!([&path[..], &decoder.undecided()].concat(), batch.states());
                prop_assert_eq!(decoder.log_probability(), batch.log_probability());
            }
            (stream, batch) => {
                let (stream, batch) = (stream.map(|_| ()), batch.map(|_| ()));
                prop_assert_eq!(stream.unwrap_err().to_string(), batch.unwrap_err().to_string());
                break;
            }
        }
    }
    Ok(())
}

/// All routines of models with this operator.
pub fn check_evidence<A: TransitionEntries<Control = usize> + Sync>(
    model: &Model,
    transition: A,
    (lag, count, seed): (usize, usize, u64),
) -> Result<(), TestCaseError> {
    let hmm = model.hmm(transition);
    let answer = model.enumerate();
    check_enumeration(model, &hmm, &model.logs, &answer)?;
    check_predictions(model, &hmm)?;
    check_online(model, &hmm)?;
    check_fixed_lag(model, &hmm, lag)?;
    check_entropy(model, &hmm)?;
    check_k_best(model, &hmm, count)?;
    check_drawn(model, &hmm, seed)?;
    if answer.impossible_at.is_none() {
        let order = if seed % 2 == 0 { Order::Forward } else { Order::Backward };
        check_pairs(model, &hmm, order)?;
    }
    let drives = [model.clone(), model.clone(), Model { logs: Vec::new(), ..model.clone() }];
    let each = |i: usize| &drives[i];
    same_results(&hmm.forward_all(&drives), 3, |i| hmm.forward(each(i)), PartialEq::eq)?;
    same_results(&hmm.smooth_all(&drives), 3, |i| hmm.smooth(each(i)), PartialEq::eq)?;
    same_results(
        &hmm.log_likelihood_all(&drives),
        3,
        |i| hmm.log_likelihood(each(i)),
        PartialEq::eq,
    )?;
    same_results(&hmm.viterbi_all(&drives), 3, |i| hmm.viterbi(each(i)), PartialEq::eq)
}
