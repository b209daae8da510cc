//! Stored values come back to the bit, and invalid ones are refused.

use proptest::prelude::*;
use serde::{Serialize, de::DeserializeOwned};
use wayfix::{Transition, TransitionEntries};

use crate::bits;

pub fn json<T: Serialize>(value: &T) -> String {
    serde_json::to_string(value).unwrap()
}

/// There and back. JSON tells any two doubles apart, so that it tells whether
/// all bits are the same.
pub fn stored<T: Serialize + DeserializeOwned>(value: &T) -> T {
    let text = json(value);
    let back: T = serde_json::from_str(&text).unwrap_or_else(|error| panic!("{error} in {text}"));
    assert_eq!(json(&back), text);
    back
}

/// All products and entries of an operator.
fn outcome<A: TransitionEntries>(a: &A, u: &A::Control) -> Vec<Vec<u64>> {
    let n = a.states();
    let x: Vec<f64> = (0..n).map(|i| (i as f64 * 0.618_033_988_7 + 0.1).fract()).collect();
    let logs: Vec<f64> = x.iter().map(|x| x.ln() * 700.0).collect();
    let product = |apply: &dyn Fn(&mut [f64])| {
        let mut out = vec![0.0; n];
        apply(&mut out);
        bits(&out)
    };
    let mut from = vec![0; n];
    let mut all = vec![
        product(&|out| a.apply(u, &x, out)),
        product(&|out| a.apply_transpose(u, &x, out)),
        product(&|out| a.apply_log(u, &logs, out)),
        product(&|out| a.apply_transpose_log(u, &logs, out)),
    ];
    let mut best = vec![0.0; n];
    a.max_product(u, &logs, &mut best, &mut from);
    all.push(bits(&best));
    all.push(from.into_iter().map(u64::from).collect());
    for state in 0..n {
        all.push(a.incoming(u, state).flat_map(|(j, p)| [j as u64, p.to_bits()]).collect());
        all.push(a.outgoing(u, state).flat_map(|(i, p)| [i as u64, p.to_bits()]).collect());
    }
    all
}

#[track_caller]
pub fn assert_stored_operator<A: TransitionEntries + Serialize + DeserializeOwned>(
    a: &A,
    u: &A::Control,
) {
    assert_eq!(outcome(&stored(a), u), outcome(a, u), "{}", json(a));
}

pub fn check_columns<A: Transition>(a: &A, u: &A::Control) -> Result<(), TestCaseError> {
    let mut sums = vec![0.0; a.states()];
    a.apply_transpose(u, &vec![1.0; a.states()], &mut sums);
    prop_assert!(sums.iter().all(|sum| (sum - 1.0).abs() < 1e-8), "{sums:?}");
    Ok(())
}

/// The text of the error for a JSON text.
#[track_caller]
pub fn refuses<T: DeserializeOwned>(text: &str, expected: &str) {
    let error = serde_json::from_str::<T>(text).err().expect("to be refused").to_string();
    let error = error.split(" at line").next().unwrap();
    assert_eq!(error, expected);
}
