//! Segments of a sequence, eight at a time: their products of matrices, each
//! column with a scale of its own, and what leads from one to the next.

use std::ops::Range;

use super::chain::{Chain, Matrix};
use super::diagonals::{Diagonals, Factors, UNSCALED, one_by_one};
use super::halves::{Put, Stretch, ahead, back};
use super::power;
use crate::kernels::lockstep::{Abreast, gather};
use crate::kernels::segments::{Scaled, products};
use crate::kernels::survey::look;
use crate::kernels::{Eight, LANES};

/// The steps of a segment, where there are enough: eight of them stay in the
/// fastest cache, and products of a few matrices are nothing beside.
const LENGTH: usize = 128;
/// Fewer steps in each segment are not worth while.
const SHORTEST: usize = 8;
/// How far exponents of what is added may lie apart, so that no term is lost.
const APART: f64 = 400.0;

/// The length of the next eight segments, if as many steps are left.
pub(super) fn length(left: usize) -> Option<usize> {
    let length = (left / LANES).min(LENGTH);
    (length >= SHORTEST).then_some(length)
}

/// Whether there are enough steps for segments.
pub(super) fn enough(steps: usize) -> bool {
    steps > LANES * SHORTEST
}

/// Gathers likelihoods for eight segments.
pub(super) struct Source<'d, const N: usize> {
    pub(super) diagonals: &'d mut dyn Diagonals,
    pub(super) factors: Factors,
    rows: Vec<[f64; N]>,
}

impl<'d, const N: usize> Source<'d, N> {
    pub(super) fn new(diagonals: &'d mut dyn Diagonals) -> Self {
        Self { diagonals, factors: Factors::default(), rows: Vec::new() }
    }

    /// Those of the segments from a step on. Gives how many steps may be taken
    /// without a look.
    pub(super) fn gather(
        &mut self,
        matrix: &Matrix<N>,
        first: usize,
        out: &mut [[Abreast; N]],
    ) -> Option<usize> {
        if let Some(unlooked) = self.plain(matrix, first, out) {
            return Some(unlooked);
        }
        let steps = first..first + self.rows.len();
        self.diagonals.ahead(steps, self.rows.as_flattened_mut(), &mut self.factors)?;
        matrix.unlooked_from(self.interleave(out, 0.0))
    }

    /// The same, and the logarithm of what was taken out of the likelihoods of each
    /// step; `factors` does not have it.
    pub(super) fn gather_one_by_one(
        &mut self,
        matrix: &Matrix<N>,
        first: usize,
        out: &mut [[Abreast; N]],
        logs: &mut [f64],
    ) -> Option<usize> {
        logs.fill(0.0);
        if let Some(unlooked) = self.plain(matrix, first, out) {
            return Some(unlooked);
        }
        one_by_one(self.diagonals, first, &mut self.rows, logs)?;
        matrix.unlooked_from(self.interleave(out, 0.0))
    }

    /// If they can be used as they are.
    fn plain(
        &mut self,
        matrix: &Matrix<N>,
        first: usize,
        out: &mut [[Abreast; N]],
    ) -> Option<usize> {
        let steps = first..first + LANES * out.len();
        self.rows.resize(steps.len(), [0.0; N]);
        self.diagonals.plain(steps, self.rows.as_flattened_mut())?;
        matrix.unlooked_from(self.interleave(out, *UNSCALED.start()))
    }

    /// Those of the steps after all segments.
    pub(super) fn rest(&mut self, matrix: &Matrix<N>, steps: Range<usize>) -> Option<Rest<N>> {
        let mut diagonals = vec![[0.0; N]; steps.len()];
        self.diagonals.ahead(steps, diagonals.as_flattened_mut(), &mut self.factors)?;
        let unlooked = matrix.unlooked([&diagonals, &[]])?;
        Some(Rest { diagonals, unlooked })
    }

    /// The least likelihood above 0, or 0 if one can't be used as it is.
    fn interleave(&self, out: &mut [[Abreast; N]], least_largest: f64) -> f64 {
        let values = self.rows.as_flattened();
        let each = values.len() / LANES;
        gather(std::array::from_fn(|l| &values[l * each..][..each]), out.as_flattened_mut());
        let seen = look(out);
        let scaled = seen.largest <= *UNSCALED.end() && seen.least_largest >= least_largest;
        if scaled && !seen.nan { seen.least } else { 0.0 }
    }
}

/// The steps after all segments, one after another.
pub(super) struct Rest<const N: usize> {
    diagonals: Vec<[f64; N]>,
    unlooked: usize,
}

impl<const N: usize> Rest<N> {
    /// Takes each step, then puts it.
    pub(super) fn ahead(
        &self,
        matrix: &Matrix<N>,
        chain: &mut Chain<N>,
        places: &mut [[f64; N]],
    ) -> Option<()> {
        let stretch = Stretch { diagonals: &self.diagonals, places };
        ahead(matrix, chain, stretch, self.unlooked, Put::Vector)
    }

    /// Puts the posterior of each step, then takes it, from the last.
    pub(super) fn back(
        &self,
        matrix: &Matrix<N>,
        chain: &mut Chain<N>,
        places: &mut [[f64; N]],
    ) -> Option<()> {
        let stretch = Stretch { diagonals: &self.diagonals, places };
        back(matrix, chain, stretch, self.unlooked, Put::Posterior)
    }
}

/// What eight segments do to a vector.
pub(super) struct Segments<const N: usize>([Scaled<N>; N]);

impl<const N: usize> Segments<N> {
    /// `None` if the range of a column becomes too wide.
    pub(super) fn new(
        matrix: &Matrix<N>,
        likelihoods: &[[Abreast; N]],
        unlooked: usize,
    ) -> Option<Self> {
        products(matrix.few(unlooked), likelihoods).map(Self)
    }

    /// Takes x through all of them. Gives it as it is at the start of each.
    pub(super) fn ahead(&self, chain: &mut Chain<N>) -> Option<[Eight; N]> {
        let mut starts = [[0.0; LANES]; N];
        for segment in 0..LANES {
            put(&mut starts, segment, &chain.values);
            self.one_ahead(segment, chain)?;
        }
        Some(starts)
    }

    /// Takes r through all of them, from the last. Gives it as it is at the end of
    /// each.
    pub(super) fn back(&self, chain: &mut Chain<N>) -> Option<[Eight; N]> {
        let mut ends = [[0.0; LANES]; N];
        for segment in (0..LANES).rev() {
            put(&mut ends, segment, &chain.values);
            self.one_back(segment, chain)?;
        }
        Some(ends)
    }

    #[inline]
    fn one_ahead(&self, segment: usize, chain: &mut Chain<N>) -> Option<()> {
        let column = |j: usize| self.0[j].values.map(|x| x[segment]);
        let columns: [[f64; N]; N] = std::array::from_fn(column);
        let used =
            std::array::from_fn(|j| chain.values[j] > 0.0 && columns[j].iter().any(|x| *x > 0.0));
        let (by, powers) = self.powers(segment, &used)?;
        let mut out = [0.0; N];
        for j in 0..N {
            let weight = chain.values[j] * powers[j];
            (0..N).for_each(|i| out[i] += weight * columns[j][i]);
        }
        *chain = Chain { values: out, exponent: chain.exponent + by };
        chain.look()
    }

    #[inline]
    fn one_back(&self, segment: usize, chain: &mut Chain<N>) -> Option<()> {
        let mut out = [0.0; N];
        for (out, column) in out.iter_mut().zip(&self.0) {
            (0..N).for_each(|i| *out += column.values[i][segment] * chain.values[i]);
        }
        let (by, powers) = self.powers(segment, &out.map(|r| r > 0.0))?;
        (0..N).for_each(|j| out[j] *= powers[j]);
        *chain = Chain { values: out, exponent: chain.exponent + by };
        chain.look()
    }

    /// The largest exponent of the columns that are used, and what multiplies
    /// each column to have it, 0 for others. `None` if none is used, or one would
    /// be lost beside others.
    #[inline]
    fn powers(&self, segment: usize, used: &[bool; N]) -> Option<(i64, [f64; N])> {
        let exponents: [f64; N] = std::array::from_fn(|j| self.0[j].exponents[segment]);
        let mut largest = f64::NEG_INFINITY;
        for j in 0..N {
            largest = if used[j] && exponents[j] > largest { exponents[j] } else { largest };
        }
        let mut powers = used.map(f64::from);
        for j in 0..N {
            let below = largest - exponents[j];
            if below != 0.0 && used[j] {
                if below > APART {
                    return None;
                }
                powers[j] = power(-(below as i64));
            }
        }
        (largest > f64::NEG_INFINITY).then_some((largest as i64, powers))
    }
}

fn put<const N: usize>(lanes: &mut [Eight; N], segment: usize, x: &[f64; N]) {
    lanes.iter_mut().zip(x).for_each(|(lanes, x)| lanes[segment] = *x);
}

/// One after another, of the same length.
pub(super) fn eight(values: &mut [f64]) -> [&mut [f64]; LANES] {
    let mut parts = values.chunks_exact_mut(values.len() / LANES);
    std::array::from_fn(|_| parts.next().unwrap_or_default())
}
