//! Likelihoods of a linear regression.

use super::LinearRegression;
use crate::emission::EmissionError;
use crate::emission::normal::{Differences, eights};
use crate::error::LikelihoodError;
use crate::kernels::{Eight, Simd};
use crate::likelihood::{Diagonal, Likelihood, Scratch};

impl LinearRegression {
    pub(super) fn check_input(&self, input: &[f64], expected: usize) -> Result<(), EmissionError> {
        let found = input.len();
        if found != expected {
            return Err(EmissionError::Components { found, expected });
        }
        match input.iter().take(self.inputs).position(|x| !x.is_finite()) {
            None => Ok(()),
            Some(component) => {
                let (value, expected) = (input[component], "a finite value, as all of the input");
                Err(EmissionError::Observation { component, value, expected })
            }
        }
    }

    /// Checks a row, and returns its output and the number of that one's components that are not
    /// missing.
    #[inline]
    pub(super) fn output<'a>(&self, row: &'a [f64]) -> Result<(&'a [f64], usize), EmissionError> {
        self.check_input(row, self.inputs + self.outputs())?;
        let output = &row[self.inputs..];
        let observed = self.noise.check(output).map_err(|error| match error {
            EmissionError::Observation { component, value, expected } => {
                let component = component + self.inputs;
                EmissionError::Observation { component, value, expected }
            }
            other => other,
        })?;
        Ok((output, observed))
    }

    pub(super) fn differences<'a>(&'a self, row: &'a [f64]) -> FromLines<'a> {
        FromLines { row, inputs: self.inputs, lines: &self.blocks }
    }
}

/// Differences of outputs from their expectations; 0 for missing ones.
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
        self.noise.count()
    }

    #[inline]
    fn diagonal<'a>(
        &'a self,
        row: &'a [f64],
        scratch: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        let values = scratch.values(self.noise.memory() * 8);
        let memory = eights(values);
        let (output, observed) = self.output(row)?;
        self.noise.distances_from(&self.differences(row), output, observed, memory)?;
        self.noise.logs(memory);
        Ok(Diagonal::log(&values[..self.noise.count()]))
    }
}
