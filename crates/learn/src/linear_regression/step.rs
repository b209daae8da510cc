//! Linear regression: its densities b_i(y) = N(y − B x − c; 0, Σ), section 1 of the guide's
//! formulas.

use super::LinearRegression;
use crate::check::{check_components, check_values};
use crate::normal::{Differences, eights};
use crate::{EmissionError, Family};
use wayfix::LikelihoodError;
use wayfix::{Diagonal, Likelihood, Scratch};
use wayfix_kernels::{Eight, Simd};

impl LinearRegression {
    pub(super) fn check_input(&self, input: &[f64], expected: usize) -> Result<(), EmissionError> {
        check_components(input, expected)?;
        // `check_components` has established the length.
        let expected = "a finite value (inputs may not be missing)";
        check_values(&input[..self.inputs], f64::is_finite, expected)
    }

    /// Checks a row, and returns its output and the number of components of the output that are not
    /// missing.
    #[inline]
    pub(super) fn output<'a>(&self, row: &'a [f64]) -> Result<(&'a [f64], usize), EmissionError> {
        self.check_input(row, self.inputs + self.outputs())?;
        let output = &row[self.inputs..];
        let observed = self.noise.normals().check(output);
        let observed = observed.map_err(|error| error.in_factor(self.inputs, row.len()))?;
        Ok((output, observed))
    }

    pub(super) fn differences<'a>(&'a self, row: &'a [f64]) -> FromLines<'a> {
        FromLines { row, inputs: self.inputs, lines: &self.blocks }
    }
}

/// Differences of outputs from their lines; 0 for missing ones.
pub(super) struct FromLines<'a> {
    row: &'a [f64],
    inputs: usize,
    lines: &'a [Eight],
}

impl Differences for FromLines<'_> {
    #[inline(always)]
    fn write<S: Simd>(&self, s: S, block: usize, out: &mut [Eight]) {
        let (input, output) = self.row.split_at(self.inputs);
        let width = 1 + self.inputs;
        let lines = &self.lines[block * width * out.len()..];
        // One output after the other, y_c − c_c − Σ_k B_ck x_k, for eight states at once.
        for ((out, &y), line) in out.iter_mut().zip(output).zip(lines.chunks_exact(width)) {
            if y.is_nan() {
                *out = Eight::default();
                continue;
            }
            let mut rest = s.sub(s.splat(y), s.load(&line[0]));
            for (slope, &x) in line[1..].iter().zip(input) {
                rest = s.sub(rest, s.mul(s.load(slope), s.splat(x)));
            }
            s.store(rest, out);
        }
    }
}

impl Likelihood for LinearRegression {
    type Observation = [f64];

    fn states(&self) -> usize {
        self.noise.states()
    }

    #[inline]
    fn diagonal<'a>(
        &'a self,
        row: &'a [f64],
        scratch: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        let normals = self.noise.normals();
        let values = scratch.values(normals.memory() * 8);
        let memory = eights(values);
        let (output, observed) = self.output(row)?;
        normals.distances_from(&self.differences(row), output, observed, memory)?;
        normals.logs(memory);
        Ok(Diagonal::log(&values[..normals.count()]))
    }
}

impl Family for LinearRegression {
    fn components(&self) -> usize {
        self.inputs + self.outputs()
    }
}
