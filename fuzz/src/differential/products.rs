//! Products, entries and steps of Viterbi of an operator against its matrix.

use wayfix::TransitionEntries;

use super::close;
use crate::counts::Counts;
use crate::draw::Draw;
use crate::model::Matrix;
use crate::reference::{logarithms, sum};

pub(super) fn check<A: TransitionEntries>(
    draw: &mut Draw<'_>,
    a: &A,
    control: &A::Control,
    matrix: &Matrix,
    counts: &mut Counts,
) {
    let n = a.states();
    assert_eq!(n, matrix.len());
    a.check_control(control).expect("a valid control");
    for from in 0..n {
        let column: f64 = matrix.iter().map(|row| row[from]).sum();
        let one = (column - 1.0).abs() < 2e-9;
        assert!(one || a.evidence(control).is_some(), "column {from} sums to {column:e}");
    }
    let transposed: Matrix =
        (0..n).map(|from| matrix.iter().map(|row| row[from]).collect()).collect();
    let logs: Vec<f64> =
        (0..n).map(|_| draw.pick(&[0.0, -1.0, -700.0, -5000.0, f64::NEG_INFINITY])).collect();
    let x: Vec<f64> = (0..n).map(|_| draw.pick(&[0.0, 1.0, 0.3, 1e-200])).collect();
    let (mut out, mut from) = (vec![f64::NAN; n], vec![0; n]);
    for (what, rows, is_transposed) in
        [("product", matrix, false), ("transposed product", &transposed, true)]
    {
        let each = |apply: &mut dyn FnMut(&mut [f64]), out: &mut [f64]| {
            out.fill(f64::NAN);
            apply(out);
        };
        let mut linear = |out: &mut [f64]| {
            if is_transposed {
                a.apply_transpose(control, &x, out);
            } else {
                a.apply(control, &x, out);
            }
        };
        each(&mut linear, &mut out);
        for (i, row) in rows.iter().enumerate() {
            let expected: f64 = row.iter().zip(&x).map(|(a, x)| a * x).sum();
            let close = (out[i] - expected).abs() <= 1e-10 * expected + 1e-290;
            assert!(close, "{what} {i}: {:e}, expected {expected:e}", out[i]);
        }
        let mut log = |out: &mut [f64]| {
            if is_transposed {
                a.apply_transpose_log(control, &logs, out);
            } else {
                a.apply_log(control, &logs, out);
            }
        };
        each(&mut log, &mut out);
        for (i, row) in logarithms(rows).iter().enumerate() {
            let expected = sum(&row.iter().zip(&logs).map(|(a, x)| a + x).collect::<Vec<_>>());
            close::log(&format!("{what} in logarithms, {i}"), out[i], expected, 1e4);
        }
    }
    for state in 0..n {
        let list = |line: &[f64]| {
            line.iter().copied().enumerate().filter(|entry| entry.1 > 0.0).collect::<Vec<_>>()
        };
        same(&a.incoming(control, state).collect::<Vec<_>>(), &list(&matrix[state]));
        same(&a.outgoing(control, state).collect::<Vec<_>>(), &list(&transposed[state]));
    }
    let scores: Vec<f64> = logs.iter().map(|log| log.round()).collect();
    a.max_product(control, &scores, &mut out, &mut from);
    for (i, row) in matrix.iter().enumerate() {
        let ways = row.iter().zip(&scores).map(|(a, x)| a.log2() + x);
        let best = ways.fold(f64::NEG_INFINITY, f64::max);
        close::log("step of Viterbi", out[i], best, 1e4);
        if best > f64::NEG_INFINITY {
            let way = row[from[i] as usize].log2() + scores[from[i] as usize];
            close::log("way of Viterbi", way, best, 1e4);
        }
    }
    counts.add("operators");
}

fn same(found: &[(usize, f64)], expected: &[(usize, f64)]) {
    let close = |(a, b): (&(usize, f64), &(usize, f64))| {
        a.0 == b.0 && (a.1 - b.1).abs() <= 1e-11 * b.1 + 1e-300
    };
    let equal = found.len() == expected.len() && found.iter().zip(expected).all(close);
    assert!(equal, "entries {found:?}, expected {expected:?}");
}
