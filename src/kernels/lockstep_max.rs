//! The step of Viterbi for eight sequences in lock-step.

use super::lanes::{Eight, Kernel, LANES, Lanes, run};
use super::lockstep::{Abreast, Lines};

/// How many lines of a dense matrix share the loads of the scores.
const BLOCK: usize = 4;

/// `next` = max over j of `log2` A\[i, j\] + `x[j]`, plus the likelihood of i; `from[i]`
/// the lowest j that attains it. Gives the largest of `next`.
pub(crate) struct Maximize<'a> {
    /// The logarithms of the rows.
    pub(crate) log2: Lines<'a>,
    pub(crate) x: &'a [Abreast],
    pub(crate) likelihoods: &'a [Abreast],
    /// By how much those of each lane are to be lowered.
    pub(crate) shifts: Eight,
    pub(crate) next: &'a mut [Abreast],
    pub(crate) from: &'a mut [[u32; LANES]],
}

impl Kernel for Maximize<'_> {
    type Output = Eight;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Eight {
        let Self { log2, x, likelihoods, shifts, next, from } = self;
        let n = x.len();
        let mut out = Out::<L> {
            likelihoods: &likelihoods[..n],
            shifts: lanes.load(&shifts),
            next: &mut next[..n],
            from: &mut from[..n],
            largest: lanes.splat(f64::NEG_INFINITY),
        };
        match log2 {
            Lines::Sparse { starts, indices, values } => {
                let mut start = 0;
                for (i, end) in starts[1..].iter().enumerate() {
                    let end = *end as usize;
                    let mut best = Best::new(lanes);
                    for (j, log2) in indices[start..end].iter().zip(&values[start..end]) {
                        best.take(lanes, *log2, lanes.load(&x[*j as usize]), *j);
                    }
                    start = end;
                    out.put(lanes, i, &best);
                }
            }
            Lines::Dense { values } => {
                for (i, line) in values.chunks_exact(values.len() / n).enumerate() {
                    let mut best = Best::new(lanes);
                    for ((x, log2), j) in x.iter().zip(line).zip(0..) {
                        best.take(lanes, *log2, lanes.load(x), j);
                    }
                    out.put(lanes, i, &best);
                }
            }
            Lines::DenseTransposed { values } => {
                let mut i = 0;
                while i + BLOCK <= n {
                    transposed::<L, BLOCK>(lanes, values, x, i, &mut out);
                    i += BLOCK;
                }
                while i < n {
                    transposed::<L, 1>(lanes, values, x, i, &mut out);
                    i += 1;
                }
            }
        }
        lanes.to_array(out.largest)
    }
}

/// Lines from i on, whose entries lie beside each other.
#[inline(always)]
fn transposed<L: Lanes, const R: usize>(
    lanes: L,
    values: &[f64],
    x: &[Abreast],
    i: usize,
    out: &mut Out<'_, L>,
) {
    let mut bests = [Best::new(lanes); R];
    for ((x, values), j) in x.iter().zip(values.chunks_exact(values.len() / x.len())).zip(0..) {
        let x = lanes.load(x);
        let values: &[f64; R] = values[i..].first_chunk().expect("a line is below n");
        for r in 0..R {
            bests[r].take(lanes, values[r], x, j);
        }
    }
    for (r, best) in bests.iter().enumerate() {
        out.put(lanes, i + r, best);
    }
}

/// The best so far, and where it comes from.
#[derive(Clone, Copy)]
struct Best<L: Lanes> {
    value: L::V,
    index: L::I,
}

impl<L: Lanes> Best<L> {
    #[inline(always)]
    fn new(lanes: L) -> Self {
        Self { value: lanes.splat(f64::NEG_INFINITY), index: lanes.indices(&[0; LANES]) }
    }

    /// Those come in ascending order, so that the first of several stays.
    #[inline(always)]
    fn take(&mut self, lanes: L, log2: f64, x: L::V, j: u32) {
        let value = lanes.add(lanes.splat(log2), x);
        let better = lanes.less(self.value, value);
        self.value = lanes.max(value, self.value);
        self.index = lanes.select_index(better, lanes.indices(&[j; LANES]), self.index);
    }
}

/// Where results go.
struct Out<'a, L: Lanes> {
    likelihoods: &'a [Abreast],
    shifts: L::V,
    next: &'a mut [Abreast],
    from: &'a mut [[u32; LANES]],
    largest: L::V,
}

impl<L: Lanes> Out<'_, L> {
    #[inline(always)]
    fn put(&mut self, lanes: L, i: usize, best: &Best<L>) {
        let b = lanes.sub(lanes.load(&self.likelihoods[i]), self.shifts);
        let score = lanes.add(best.value, b);
        lanes.store(score, &mut self.next[i]);
        lanes.store_index(best.index, &mut self.from[i]);
        self.largest = lanes.max(score, self.largest);
    }
}

/// [`Maximize`] with the instructions chosen.
pub(crate) fn maximize(work: Maximize<'_>) -> Eight {
    run(work)
}
