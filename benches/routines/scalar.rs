//! A baseline that anyone would write: the filter as a loop over compressed rows, one number at a
//! time, without checks. Portable code should not be slower (`WAYFIX_INSTRUCTIONS=plain`).

use std::cell::LazyCell;
use std::hint::black_box;

use wayfix::SparseTransition;

use crate::models::{Given, Model};
use crate::timed::Group;

/// Rows of A: row i has the entries `starts[i]..starts[i + 1]`.
struct Rows {
    starts: Vec<u32>,
    indices: Vec<u32>,
    values: Vec<f64>,
}

impl Rows {
    fn new(a: &SparseTransition, states: usize) -> Self {
        let (mut starts, mut indices, mut values) = (vec![0; states + 1], vec![], vec![]);
        for (to, from, p) in a.triplets() {
            starts[to + 1] += 1;
            indices.push(from as u32);
            values.push(p);
        }
        for i in 0..states {
            starts[i + 1] += starts[i];
        }
        Self { starts, indices, values }
    }

    fn step(&self, x: &[f64], b: &[f64], out: &mut [f64]) -> f64 {
        let mut sum = 0.0;
        for (i, out) in out.iter_mut().enumerate() {
            let entries = self.starts[i] as usize..self.starts[i + 1] as usize;
            let row = self.indices[entries.clone()].iter().zip(&self.values[entries]);
            *out = row.map(|(j, p)| p * x[*j as usize]).sum::<f64>() * b[i];
            sum += *out;
        }
        out.iter_mut().for_each(|out| *out /= sum);
        sum.ln()
    }
}

pub(crate) fn bench<F>(group: &mut Group<'_>, model: &LazyCell<Model<SparseTransition, Given>, F>)
where
    F: FnOnce() -> Model<SparseTransition, Given>,
{
    group.single("scalar filter", 1, || {
        let Model { hmm, seen } = &**model;
        let rows = Rows::new(hmm.transition(), hmm.states());
        let (mut x, mut out) = (hmm.prior().belief().as_slice().to_vec(), vec![0.0; hmm.states()]);
        let mut seen = seen.iter().cycle();
        move || {
            let log = seen.next().map(|b| rows.step(black_box(&x), b, &mut out));
            std::mem::swap(&mut x, &mut out);
            log
        }
    });
}
