//! Operators with only the required methods.

use wayfix::{Transition, TransitionEntries};

use super::Matrix;

/// An operator as a user would write it: `matrix[to][from]`.
#[derive(Debug, Clone)]
pub struct Own(pub Matrix);

impl Transition for Own {
    type Control = ();
    fn states(&self) -> usize {
        self.0.len()
    }
    fn apply(&self, (): &(), x: &[f64], out: &mut [f64]) {
        for (out, row) in out.iter_mut().zip(&self.0) {
            *out = row.iter().zip(x).map(|(a, x)| a * x).sum();
        }
    }
    fn apply_transpose(&self, (): &(), x: &[f64], out: &mut [f64]) {
        for (j, out) in out.iter_mut().enumerate() {
            *out = self.0.iter().zip(x).map(|(row, x)| row[j] * x).sum();
        }
    }
}

impl TransitionEntries for Own {
    fn incoming(&self, (): &(), to: usize) -> impl Iterator<Item = (usize, f64)> {
        self.0[to].iter().copied().enumerate().filter(|entry| entry.1 > 0.0)
    }
    fn outgoing(&self, (): &(), from: usize) -> impl Iterator<Item = (usize, f64)> {
        self.0.iter().map(move |row| row[from]).enumerate().filter(|entry| entry.1 > 0.0)
    }
}

/// The operator with evidence on moves, with a log factor taken out.
#[derive(Debug, Clone)]
pub struct OwnMeasured {
    pub entries: Own,
    pub log_factor: f64,
}

impl Transition for OwnMeasured {
    type Control = ();
    fn states(&self) -> usize {
        self.entries.states()
    }
    fn apply(&self, (): &(), x: &[f64], out: &mut [f64]) {
        self.entries.apply(&(), x, out);
    }
    fn apply_transpose(&self, (): &(), x: &[f64], out: &mut [f64]) {
        self.entries.apply_transpose(&(), x, out);
    }
    fn evidence(&self, (): &()) -> Option<f64> {
        Some(self.log_factor)
    }
}

impl TransitionEntries for OwnMeasured {
    fn incoming(&self, (): &(), to: usize) -> impl Iterator<Item = (usize, f64)> {
        self.entries.incoming(&(), to)
    }
    fn outgoing(&self, (): &(), from: usize) -> impl Iterator<Item = (usize, f64)> {
        self.entries.outgoing(&(), from)
    }
}
