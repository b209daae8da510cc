//! Each kernel gives the same bits with every instruction set of the machine, and the result of a
//! plain loop over the entries.

mod dense;
mod few_states;
mod memory;
mod sparse;
mod steps;

use proptest::collection::vec;
use proptest::prelude::*;

use super::layout::{Arrangement, Sliced};
use super::simd::{Isa, with_isa};

const ZERO_SCORE: f64 = f64::NEG_INFINITY;

type EntryRows = Vec<Vec<(u32, f64)>>;

/// Rows with diagonals and scattered entries, and occasionally a very long one.
fn rows() -> impl Strategy<Value = EntryRows> {
    // Most matrices are one window of groups; some end near a multiple of 256 lines.
    let borders = (250..270_usize, 1..3_usize).prop_map(|(lines, windows)| lines * windows);
    prop_oneof![7 => 1..70_usize, 1 => borders].prop_flat_map(|n| {
        let few = vec((0..n as u32, 0.01..1.0), 0..6);
        let many = vec((0..n as u32, 0.01..1.0), 0..60);
        let near = vec(prop_oneof![Just(0.0), 0.01..1.0], 3);
        let row = (prop_oneof![9 => few, 1 => many], near);
        vec(row, n).prop_map(move |rows| {
            let lines = rows.into_iter().enumerate().map(|(i, (mut entries, near))| {
                let beside = near.iter().zip(i.saturating_sub(1)..).filter(|(p, _)| **p > 0.0);
                entries.extend(beside.filter(|(_, j)| *j < n).map(|(p, j)| (j as u32, *p)));
                entries.sort_by_key(|entry| entry.0);
                entries.dedup_by_key(|entry| entry.0);
                entries
            });
            lines.collect()
        })
    })
}

const ARRANGEMENTS: [Arrangement; 2] = [Arrangement::Slices, Arrangement::Groups];

/// The matrix in each arrangement.
fn sliced(rows: &EntryRows) -> [Sliced; 2] {
    let split: Vec<(Vec<u32>, Vec<f64>)> =
        rows.iter().map(|row| row.iter().copied().unzip()).collect();
    let line = |line: usize| (&split[line].0[..], &split[line].1[..]);
    ARRANGEMENTS.map(|arrangement| Sliced::arranged(arrangement, rows.len(), line))
}

fn product(rows: &EntryRows, x: &[f64]) -> Vec<f64> {
    let sum = |row: &Vec<(u32, f64)>| row.iter().map(|&(j, p)| p * x[j as usize]).sum();
    rows.iter().map(sum).collect()
}

/// Result of a kernel, the same with every instruction set.
fn everywhere<R: PartialEq + std::fmt::Debug>(call: impl Fn() -> R) -> R {
    // Compared by `==`, as bits but for NaN and the sign of 0, which results do not have.
    let expected = with_isa(Isa::Portable, &call);
    for (name, isa) in Isa::ALL.into_iter().filter(|(_, isa)| isa.is_here()) {
        assert_eq!(with_isa(isa, &call), expected, "{name}");
    }
    expected
}

/// Result of a kernel, the same with each arrangement of a sparse matrix.
fn in_layouts<R: PartialEq + std::fmt::Debug>(
    [slices, groups]: &[Sliced; 2],
    call: impl Fn(&Sliced) -> R,
) -> R {
    let expected = everywhere(|| call(slices));
    assert_eq!(everywhere(|| call(groups)), expected);
    expected
}

fn close(found: &[f64], expected: &[f64]) -> Result<(), TestCaseError> {
    for (i, (found, expected)) in found.iter().zip(expected).enumerate() {
        let error = (found - expected).abs();
        prop_assert!(error <= 1e-13 * expected.abs(), "{found}, expected {expected} at {i}");
    }
    Ok(())
}

fn sum_is(found: f64, terms: &[f64]) -> Result<(), TestCaseError> {
    close(&[found], &[terms.iter().sum()])
}

/// Repeats numbers up to a length.
fn numbers(from: &[f64], n: usize) -> Vec<f64> {
    from.iter().copied().cycle().take(n).collect()
}

fn some_zero() -> impl Strategy<Value = Vec<f64>> {
    vec(prop_oneof![1 => Just(0.0), 5 => 0.001..1.0], 71)
}

fn scores() -> impl Strategy<Value = Vec<f64>> {
    vec(prop_oneof![1 => Just(f64::NEG_INFINITY), 3 => (-4..4).prop_map(f64::from)], 71)
}

/// Number of cases in `WAYFIX_CASES`, or 256.
fn cases() -> ProptestConfig {
    let cases = std::env::var("WAYFIX_CASES").ok().and_then(|text| text.parse().ok());
    ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(cases.unwrap_or(256)) }
}
