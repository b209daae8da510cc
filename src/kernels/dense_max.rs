//! The product with a dense matrix in which a maximum stands for the sum: its step
//! of Viterbi.

use super::aligned::Aligned;
use super::lanes::{Eight, Kernel, LANES, Lanes, run};

/// The logarithms of a dense matrix, eight rows after eight, each of them by columns.
#[derive(Debug, Clone)]
pub(crate) struct DenseLogs {
    states: usize,
    /// Those of the rows from 8 g on and of column j from 8 (g n + j) on; −∞ beyond
    /// the last row.
    values: Aligned,
}

impl DenseLogs {
    /// From logarithms at (to, from).
    pub(crate) fn new(states: usize, log2: impl Fn(usize, usize) -> f64) -> Self {
        let length = states.next_multiple_of(LANES) * states;
        let mut values = Aligned::new(length, f64::NEG_INFINITY);
        for j in 0..states {
            for i in 0..states {
                values[(i / LANES * states + j) * LANES + i % LANES] = log2(i, j);
            }
        }
        Self { states, values }
    }

    /// `out[i]` = max over j of log2 A\[i, j\] + `x[j]`, and `from[i]` the lowest j
    /// that attains it.
    pub(crate) fn maximize(&self, x: &[f64], out: &mut [f64], from: &mut [u32]) {
        run(Maximize { matrix: self, x, out, from });
    }
}

struct Maximize<'a> {
    matrix: &'a DenseLogs,
    x: &'a [f64],
    out: &'a mut [f64],
    from: &'a mut [u32],
}

impl Kernel for Maximize<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self { matrix: DenseLogs { states, values }, x, out, from } = self;
        let (n, eights) = (*states, values.as_chunks().0);
        assert!(x.len() == n && out.len() == n && from.len() == n, "one value per state");
        let mut rows = Rows { eights, x, out, from };
        rows.best::<L, 4>(lanes);
        rows.best::<L, 2>(lanes);
        rows.best::<L, 1>(lanes);
    }
}

/// Rows that are still to be gone through.
struct Rows<'a> {
    eights: &'a [Eight],
    x: &'a [f64],
    out: &'a mut [f64],
    from: &'a mut [u32],
}

impl Rows<'_> {
    /// Takes G times eight side by side, as long as there are so many.
    #[inline(always)]
    #[allow(clippy::cast_sign_loss, reason = "indices are not below 0")]
    fn best<L: Lanes, const G: usize>(&mut self, lanes: L) {
        let x = self.x;
        while self.out.len() > (G - 1) * LANES {
            let eights = self.eights.split_off(..G * x.len()).expect("eight of each column");
            let length = self.out.len().min(G * LANES);
            let out = self.out.split_off_mut(..length).expect("so many are left");
            let from = self.from.split_off_mut(..length).expect("so many are left");
            let groups: [&[Eight]; G] =
                std::array::from_fn(|g| &eights[g * x.len()..(g + 1) * x.len()]);
            let mut best = [lanes.splat(f64::NEG_INFINITY); G];
            // As doubles, which hold every index.
            let mut index = [lanes.splat(0.0); G];
            for (j, &x) in x.iter().enumerate() {
                let (x, at) = (lanes.splat(x), lanes.splat(j as f64));
                for g in 0..G {
                    let value = lanes.add(lanes.load(&groups[g][j]), x);
                    index[g] = lanes.select(lanes.less(best[g], value), at, index[g]);
                    best[g] = lanes.max(value, best[g]);
                }
            }
            let sides = out.chunks_mut(LANES).zip(from.chunks_mut(LANES));
            for ((out, from), (best, index)) in sides.zip(best.into_iter().zip(index)) {
                lanes.store_part(best, out);
                let index = lanes.to_array(index);
                from.iter_mut().zip(index).for_each(|(from, index)| *from = index as u32);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::lanes::{Isa, run_on};
    use super::*;

    const ALL: [Isa; 3] = [Isa::Plain, Isa::Avx2, Isa::Avx512];

    fn values(count: usize, factor: f64) -> Vec<f64> {
        (1..=count).map(|i| (i as f64 * factor).fract()).collect()
    }

    fn sizes() -> impl Iterator<Item = usize> {
        (1..=40).chain([63, 64, 65, 100, 105, 131])
    }

    #[test]
    fn the_lowest_of_the_best_wins_on_every_instruction_set() {
        for n in sizes() {
            // Few values, so that many tie; some are impossible.
            let few = |value: f64| match (value * 6.0).floor() {
                0.0 => f64::NEG_INFINITY,
                value => -value,
            };
            let a: Vec<f64> = values(n * n, 0.618_033_988_7).into_iter().map(few).collect();
            let x: Vec<f64> = values(n, 0.414_213_562_3).into_iter().map(few).collect();
            let logs = DenseLogs::new(n, |i, j| a[j * n + i]);
            for isa in ALL {
                let (mut out, mut from) = (vec![f64::NAN; n], vec![u32::MAX; n]);
                let (matrix, x) = (&logs, &x[..]);
                run_on(isa, Maximize { matrix, x, out: &mut out, from: &mut from });
                for i in 0..n {
                    let mut best = (f64::NEG_INFINITY, 0);
                    for j in 0..n {
                        let value = a[j * n + i] + x[j];
                        if value > best.0 {
                            best = (value, j as u32);
                        }
                    }
                    assert_eq!((out[i], from[i]), best, "row {i} of {n} on {isa:?}");
                }
            }
        }
    }
}
