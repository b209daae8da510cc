//! [`assert_operator`] detects an operator that is wrong in a single method.

use wayfix::{Transition, TransitionEntries, TransitionError};

use crate::kit::{Expected, Matrix, Own, assert_operator};

/// The wrong method.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Fault {
    None,
    Product,
    Transpose,
    Logarithms,
    TransposeInLogarithms,
    Incoming,
    Outgoing,
    Ties,
    Control,
}

/// Two equal states, each leading to both.
struct Faulty(Own, Fault);

impl Transition for Faulty {
    type Control = usize;
    fn states(&self) -> usize {
        self.0.states()
    }
    fn apply(&self, _: &usize, x: &[f64], out: &mut [f64]) {
        self.0.apply(&(), x, out);
        out[0] *= if self.1 == Fault::Product { 1.0 + 1e-11 } else { 1.0 };
    }
    fn apply_transpose(&self, _: &usize, x: &[f64], out: &mut [f64]) {
        self.0.apply_transpose(&(), x, out);
        // Columns still sum to one.
        out[1] += if self.1 == Fault::Transpose { 1e-9 * (x[0] - x[1]) } else { 0.0 };
    }
    fn apply_log(&self, _: &usize, x: &[f64], out: &mut [f64]) {
        self.0.apply_log(&(), x, out);
        out[1] += if self.1 == Fault::Logarithms { 1e-7 } else { 0.0 };
    }
    fn apply_transpose_log(&self, _: &usize, x: &[f64], out: &mut [f64]) {
        self.0.apply_transpose_log(&(), x, out);
        out[2] += if self.1 == Fault::TransposeInLogarithms { 1e-7 } else { 0.0 };
    }
    fn check_control(&self, u: &usize) -> Result<(), TransitionError> {
        let refused = self.1 == Fault::Control && *u == 2;
        if refused { Err(TransitionError::Control("refused".into())) } else { Ok(()) }
    }
}

impl TransitionEntries for Faulty {
    fn incoming(&self, _: &usize, to: usize) -> impl Iterator<Item = (usize, f64)> {
        let skipped = usize::from(self.1 == Fault::Incoming && to == 2);
        self.0.incoming(&(), to).skip(skipped)
    }
    fn outgoing(&self, _: &usize, from: usize) -> impl Iterator<Item = (usize, f64)> {
        let wrong = self.1 == Fault::Outgoing && from == 0;
        self.0.outgoing(&(), from).map(move |(to, p)| (to, if wrong { 1.0 / 3.0 } else { p }))
    }
    fn max_product(&self, _: &usize, x: &[f64], out: &mut [f64], from: &mut [u32]) {
        self.0.max_product(&(), x, out, from);
        if self.1 == Fault::Ties && x[0] == x[1] {
            from[0] = 1;
        }
    }
}

#[test]
fn each_method_that_is_wrong_is_found() {
    let matrix: Matrix = vec![vec![0.5, 0.5, 0.25], vec![0.25, 0.25, 0.25], vec![0.25, 0.25, 0.5]];
    let expected = Expected::each(&[0, 1, 2], &vec![matrix.clone(); 3]).with_exact_ties(true);
    let found = |fault| assert_operator(Faulty(Own(matrix.clone()), fault), expected.clone());
    found(Fault::None).unwrap();
    for fault in [
        Fault::Product,
        Fault::Transpose,
        Fault::Logarithms,
        Fault::TransposeInLogarithms,
        Fault::Incoming,
        Fault::Outgoing,
        Fault::Ties,
        Fault::Control,
    ] {
        assert!(found(fault).is_err(), "{fault:?}");
    }
}

/// An operator with another matrix is detected.
#[test]
fn another_matrix_is_found() {
    let still = vec![vec![1.0, 0.0], vec![0.0, 1.0]];
    let away = vec![vec![0.0, 1.0], vec![1.0, 0.0]];
    assert_operator(Own(still.clone()), &still).unwrap();
    assert!(assert_operator(Own(still), &away).is_err());
}
