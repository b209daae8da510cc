//! The methods of an operator against its matrix.

use proptest::prelude::*;
use proptest::test_runner::{TestCaseError, TestCaseResult};

use super::super::{Matrix, NEVER, close, close_logs, log_sum, transposed};
use super::{EachStep, Inputs, Rounding, Steps};
use wayfix::transition::kit;

pub fn check(
    a: &dyn Steps,
    step: usize,
    m: &Matrix,
    inputs: &Inputs,
    rounding: Rounding,
) -> TestCaseResult {
    // All methods agree; so what follows shows that they are right, and to more digits.
    kit::check(&EachStep(a), &step).map_err(|error| TestCaseError::fail(error.to_string()))?;
    products(|x, out| a.apply(step, x, out), m, inputs, rounding)?;
    logarithms(|x, out| a.apply_log(step, x, out), m, inputs, rounding)?;
    entries(|state| a.incoming(step, state), m, rounding)?;
    let columns = transposed(m);
    products(|x, out| a.apply_transpose(step, x, out), &columns, inputs, rounding)?;
    logarithms(|x, out| a.apply_transpose_log(step, x, out), &columns, inputs, rounding)?;
    entries(|state| a.outgoing(step, state), &columns, rounding)?;
    let linear = |logs: Vec<(usize, f64)>| logs.into_iter().map(|(j, log2)| (j, log2.exp2()));
    entries(|state| linear(a.incoming_log2(step, state)).collect(), m, rounding)?;
    entries(|state| linear(a.outgoing_log2(step, state)).collect(), &columns, rounding)?;
    best_predecessors(a, step, m, inputs, rounding)
}

fn products(
    apply: impl Fn(&[f64], &mut [f64]),
    m: &Matrix,
    inputs: &Inputs,
    Rounding { entries, least, .. }: Rounding,
) -> TestCaseResult {
    for scale in [1.0, 2.0_f64.powi(1000), 2.0_f64.powi(-800)] {
        let x: Vec<f64> = inputs.numbers.iter().map(|x| x * scale).collect();
        let mut out = vec![f64::NAN; m.len()];
        apply(&x, &mut out);
        for (found, row) in out.iter().zip(m) {
            let expected: f64 = row.iter().zip(&inputs.numbers).map(|(a, x)| a * x).sum();
            // At other scales, values far below the largest may underflow.
            let least = if scale == 1.0 { least } else { least.max(1e-30) };
            if expected == 0.0 || expected > least {
                close(found / scale, expected, entries, f64::MIN_POSITIVE)?;
            }
        }
    }
    Ok(())
}

fn logarithms(
    apply_log: impl Fn(&[f64], &mut [f64]),
    m: &Matrix,
    inputs: &Inputs,
    rounding: Rounding,
) -> TestCaseResult {
    let n = m.len();
    let near: Vec<f64> = inputs.logs.iter().map(|log| log / 1000.0).collect();
    for x in [&inputs.logs[..], &near, &vec![NEVER; n], &vec![-2000.0; n]] {
        let mut out = vec![f64::NAN; n];
        apply_log(x, &mut out);
        for (found, row) in out.iter().zip(m) {
            let expected = log_sum(row.iter().zip(x).map(|(a, x)| a.ln() + x));
            close(*found, expected, rounding.entries.max(1e-12), 1.0)?;
        }
    }
    Ok(())
}

/// Checks that entries ascend, and that only those above 0 are listed.
fn entries(
    list: impl Fn(usize) -> Vec<(usize, f64)>,
    m: &Matrix,
    rounding: Rounding,
) -> TestCaseResult {
    for (state, row) in m.iter().enumerate() {
        let found = list(state);
        let expected = row.iter().copied().enumerate().filter(|entry| entry.1 > 0.0);
        let (states, values): (Vec<_>, Vec<_>) = expected.unzip();
        prop_assert_eq!(found.iter().map(|e| e.0).collect::<Vec<_>>(), states, "of {}", state);
        for (found, expected) in found.iter().zip(values) {
            close(found.1, expected, rounding.entries, f64::MIN_POSITIVE)?;
        }
    }
    Ok(())
}

/// Checks the step of Viterbi against the matrix, and against decoders that list entries.
fn best_predecessors(
    a: &dyn Steps,
    step: usize,
    m: &Matrix,
    inputs: &Inputs,
    Rounding { exact, least, .. }: Rounding,
) -> TestCaseResult {
    let n = m.len();
    let tolerance = if least > 0.0 { 1e-10 } else { 1e-12 };
    let near: Vec<f64> = inputs.logs.iter().map(|log| (log / 64.0).round()).collect();
    for x in [&inputs.scores[..], &vec![0.0; n], &vec![NEVER; n], &near] {
        let (mut out, mut from) = (vec![f64::NAN; n], vec![u32::MAX; n]);
        a.max_product(step, x, &mut out, &mut from);
        for (i, row) in m.iter().enumerate() {
            let values: Vec<f64> = row.iter().zip(x).map(|(a, x)| a.log2() + x).collect();
            let best = values.iter().copied().fold(NEVER, f64::max);
            close_logs(out[i], best, tolerance)?;
            let listed = a.incoming_log2(step, i).into_iter().map(|(j, log2)| (log2 + x[j], j));
            let listed =
                listed.fold((NEVER, 0), |best, one| if one.0 > best.0 { one } else { best });
            // Sums of logarithms below 256 are exact, and terms may be 100 below this one.
            if least == 0.0 || best.abs() < 100.0 {
                prop_assert_eq!(out[i], listed.0);
            }
            if best == NEVER {
                continue;
            }
            let named = from[i] as usize;
            prop_assert!(
                values[named] >= best - tolerance * best.abs().max(1.0),
                "{named} of {values:?}"
            );
            if best.abs() < 100.0 {
                prop_assert_eq!(named, listed.1);
            }
            if exact {
                prop_assert_eq!(Some(named), values.iter().position(|v| *v >= best - 1e-12));
            }
        }
    }
    Ok(())
}
