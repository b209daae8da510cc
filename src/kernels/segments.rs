//! Eight segments of one sequence, one a lane, under a model of N states: a step
//! waits for the last one, but not for those of other segments.
//!
//! Values are scaled by powers of two, which is exact, and only now and then.

use super::abreast::Abreast;
use super::lanes::{Eight, Kernel, LANES, Lanes, run};
use crate::range::power;

/// The largest value of a vector is kept above the first and below the second.
const SCALES: [f64; 2] = [power(-40), power(40)];
/// Where a value above 0 is below this, the work ends: see [`Products`].
const LEAST: f64 = power(-300);
/// What is taken out of a scale at a time.
const SHIFT: i32 = 64;

/// A model of N states, and how often its scale is looked at: between two looks
/// no value may fall below 2^-500, nor grow beyond 2^500.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Few<'a, const N: usize> {
    /// A, column after column, and row after row.
    pub(crate) columns: &'a [[f64; N]; N],
    pub(crate) rows: &'a [[f64; N]; N],
    pub(crate) unlooked: usize,
}

/// A vector in each segment, times 2^exponent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Scaled<const N: usize> {
    pub(crate) values: [Eight; N],
    pub(crate) exponents: Eight,
}

/// The products B(y_k) A … B(y_1) A of each segment, column after column. `None` if
/// the range of a column has become too wide.
pub(super) struct Products<'a, const N: usize> {
    pub(super) model: Few<'a, N>,
    pub(super) likelihoods: &'a [[Abreast; N]],
}

impl<const N: usize> Kernel for Products<'_, N> {
    type Output = Option<[Scaled<N>; N]>;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Option<[Scaled<N>; N]> {
        let mut out = [Scaled { values: [[0.0; LANES]; N], exponents: [0.0; LANES] }; N];
        // As many columns at a time as registers hold.
        let done = if const { N <= 3 } {
            self.columns::<L, N>(lanes, &mut out)
        } else {
            assert!(N.is_multiple_of(2), "columns are taken in pairs");
            self.columns::<L, 2>(lanes, &mut out)
        };
        done.then_some(out)
    }
}

impl<const N: usize> Products<'_, N> {
    /// All, C at a time, where C divides N.
    #[inline(always)]
    fn columns<L: Lanes, const C: usize>(&self, lanes: L, out: &mut [Scaled<N>; N]) -> bool {
        for (number, out) in out.as_chunks_mut::<C>().0.iter_mut().enumerate() {
            let mut running =
                [Running { x: [lanes.splat(0.0); N], exponents: lanes.splat(0.0) }; C];
            for (c, running) in running.iter_mut().enumerate() {
                running.x[number * C + c] = lanes.splat(1.0);
            }
            for steps in self.likelihoods.chunks(self.model.unlooked) {
                for b in steps {
                    if C == N {
                        // The shorter way from x to x, in as many instructions.
                        let matrix = observed(lanes, self.model.columns, b);
                        for running in &mut running {
                            running.x = product(lanes, &matrix, &running.x);
                        }
                    } else {
                        for running in &mut running {
                            running.x = ahead(lanes, self.model.columns, b, &running.x);
                        }
                    }
                }
                if !look_at::<L, N, C>(lanes, &mut running) {
                    return false;
                }
            }
            for c in 0..C {
                for i in 0..N {
                    lanes.store(running[c].x[i], &mut out[c].values[i]);
                }
                lanes.store(running[c].exponents, &mut out[c].exponents);
            }
        }
        true
    }
}

/// The products of eight segments.
pub(crate) fn products<const N: usize>(
    model: Few<'_, N>,
    likelihoods: &[[Abreast; N]],
) -> Option<[Scaled<N>; N]> {
    run(Products { model, likelihoods })
}

/// A vector on its way through each segment, times 2^exponent.
#[derive(Clone, Copy)]
pub(super) struct Running<L: Lanes, const N: usize> {
    pub(super) x: [L::V; N],
    exponents: L::V,
}

impl<L: Lanes, const N: usize> Running<L, N> {
    #[inline(always)]
    pub(super) fn new(lanes: L, x: &[Eight; N]) -> Self {
        let mut running = Self { x: [lanes.splat(0.0); N], exponents: lanes.splat(0.0) };
        for (to, x) in running.x.iter_mut().zip(x) {
            *to = lanes.load(x);
        }
        running
    }

    /// Brings the scale back to its range. False if a value is too far below.
    #[inline(always)]
    pub(super) fn rescale(&mut self, lanes: L) -> bool {
        let (zero, one) = (lanes.splat(0.0), lanes.splat(1.0));
        let shift = f64::from(SHIFT);
        loop {
            let mut largest = self.x[0];
            for i in 1..N {
                largest = lanes.max(self.x[i], largest);
            }
            let low = lanes.less(largest, lanes.splat(SCALES[0]));
            let low = lanes.and(low, lanes.less(zero, largest));
            let high = lanes.less(lanes.splat(SCALES[1]), largest);
            if !lanes.any(lanes.or(low, high)) {
                break;
            }
            let down = lanes.select(high, lanes.splat(power(-i64::from(SHIFT))), one);
            let factor = lanes.select(low, lanes.splat(power(i64::from(SHIFT))), down);
            for i in 0..N {
                self.x[i] = lanes.mul(self.x[i], factor);
            }
            let up = lanes.select(low, lanes.splat(-shift), zero);
            let taken_out = lanes.select(high, lanes.splat(shift), up);
            self.exponents = lanes.add(self.exponents, taken_out);
        }
        let mut lost = lanes.less(zero, zero);
        for x in self.x {
            let below = lanes.less(x, lanes.splat(LEAST));
            lost = lanes.or(lost, lanes.and(below, lanes.less(zero, x)));
        }
        !lanes.any(lost)
    }
}

/// Looks at scales. False if a value is too far below.
#[inline(always)]
pub(super) fn look_at<L: Lanes, const N: usize, const C: usize>(
    lanes: L,
    running: &mut [Running<L, N>; C],
) -> bool {
    let mut kept = true;
    if !all_near(lanes, running) {
        for running in running {
            kept &= running.rescale(lanes);
        }
    }
    kept
}

/// Whether all values are in the range of scales: most often they are.
#[inline(always)]
pub(super) fn all_near<L: Lanes, const N: usize, const C: usize>(
    lanes: L,
    running: &[Running<L, N>; C],
) -> bool {
    let (mut least, mut largest) = (running[0].x[0], running[0].x[0]);
    for running in running {
        for &x in &running.x {
            least = lanes.min(x, least);
            largest = lanes.max(x, largest);
        }
    }
    let low = lanes.less(least, lanes.splat(SCALES[0]));
    !lanes.any(lanes.or(low, lanes.less(lanes.splat(SCALES[1]), largest)))
}

/// B(y) A, column after column.
#[inline(always)]
fn observed<L: Lanes, const N: usize>(
    lanes: L,
    columns: &[[f64; N]; N],
    b: &[Abreast; N],
) -> [[L::V; N]; N] {
    let mut out = [[lanes.splat(0.0); N]; N];
    for i in 0..N {
        let b = lanes.load(&b[i]);
        for j in 0..N {
            out[j][i] = lanes.mul(lanes.splat(columns[j][i]), b);
        }
    }
    out
}

/// The product of a matrix, column after column, with x.
#[inline(always)]
fn product<L: Lanes, const N: usize>(
    lanes: L,
    columns: &[[L::V; N]; N],
    x: &[L::V; N],
) -> [L::V; N] {
    let mut out = *x;
    for i in 0..N {
        let mut sum = lanes.mul(columns[0][i], x[0]);
        for j in 1..N {
            sum = lanes.add(sum, lanes.mul(columns[j][i], x[j]));
        }
        out[i] = sum;
    }
    out
}

/// The same with one matrix for all segments.
#[inline(always)]
fn common_product<L: Lanes, const N: usize>(
    lanes: L,
    columns: &[[f64; N]; N],
    x: &[L::V; N],
) -> [L::V; N] {
    let mut out = *x;
    for i in 0..N {
        let mut sum = lanes.mul(lanes.splat(columns[0][i]), x[0]);
        for j in 1..N {
            sum = lanes.add(sum, lanes.mul(lanes.splat(columns[j][i]), x[j]));
        }
        out[i] = sum;
    }
    out
}

/// Σ_i x_i.
#[inline(always)]
pub(super) fn sum<L: Lanes, const N: usize>(lanes: L, x: &[L::V; N]) -> L::V {
    let mut sum = x[0];
    for x in &x[1..] {
        sum = lanes.add(sum, *x);
    }
    sum
}

/// x ∘ y.
#[inline(always)]
fn times<L: Lanes, const N: usize>(lanes: L, x: &[L::V; N], y: &[Abreast; N]) -> [L::V; N] {
    let mut out = *x;
    for i in 0..N {
        out[i] = lanes.mul(out[i], lanes.load(&y[i]));
    }
    out
}

/// B(y) A x.
#[inline(always)]
pub(super) fn ahead<L: Lanes, const N: usize>(
    lanes: L,
    columns: &[[f64; N]; N],
    b: &[Abreast; N],
    x: &[L::V; N],
) -> [L::V; N] {
    times(lanes, &common_product(lanes, columns, x), b)
}

/// A' B(y) r.
#[inline(always)]
pub(super) fn back<L: Lanes, const N: usize>(
    lanes: L,
    rows: &[[f64; N]; N],
    b: &[Abreast; N],
    r: &[L::V; N],
) -> [L::V; N] {
    common_product(lanes, rows, &times(lanes, r, b))
}
