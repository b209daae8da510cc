//! The product in which a maximum stands for the sum, with eight lines at a
//! time: the step of Viterbi.

use std::f64::consts::LOG2_E;

use super::lanes::{Eight, Kernel, LANES, Lanes, run};
use super::product::eight;
use super::sliced::{Sliced, Values, Walk};
use super::{GRID_RANGE, GRID_STEPS, INTEGERS};

/// Scores of which each is to be lowered by `shift`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Shifted<'a> {
    pub(crate) scores: &'a [f64],
    pub(crate) shift: f64,
    /// If they are natural logarithms yet: the largest, which then is 0.
    pub(crate) natural: Option<f64>,
}

impl Shifted<'_> {
    /// Those of the eight with this number.
    #[inline(always)]
    fn eight<L: Lanes>(self, lanes: L, number: usize) -> L::V {
        let mut b = eight(lanes, self.scores.as_chunks(), number);
        if let Some(largest) = self.natural {
            b = log2_over(lanes, b, largest);
        }
        lanes.sub(b, lanes.splat(self.shift))
    }
}

/// `next` = max over j of log2 A\[i, j\] + `x[j]`, plus the likelihood of i if there
/// are some; `from[i]` the lowest j that attains it. Gives the largest of
/// `next`.
pub(crate) struct Maximize<'a> {
    pub(crate) matrix: &'a Sliced,
    /// The logarithms of its values.
    pub(crate) log2: &'a Values,
    pub(crate) x: &'a [f64],
    pub(crate) likelihoods: Option<Shifted<'a>>,
    pub(crate) next: &'a mut [f64],
    pub(crate) from: &'a mut [u32],
}

impl Kernel for Maximize<'_> {
    type Output = f64;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> f64 {
        let Self { matrix, log2, x, likelihoods, next, from } = self;
        let n = matrix.lines();
        assert!(x.len() == n && next.len() == n && from.len() == n, "one value per state");
        assert!(likelihoods.is_none_or(|b| b.scores.len() == n), "one likelihood per state");
        let mut each = MaximizeEach::<L> {
            likelihoods,
            next: next.as_chunks_mut(),
            from: from.as_chunks_mut(),
            largest: lanes.splat(f64::NEG_INFINITY),
        };
        matrix.walk_with(lanes, 0..n.div_ceil(LANES), log2, x, &mut each);
        let largest = lanes.to_array(each.largest).into_iter().chain(each.next.1.iter().copied());
        largest.fold(f64::NEG_INFINITY, f64::max)
    }
}

struct MaximizeEach<'a, L: Lanes> {
    likelihoods: Option<Shifted<'a>>,
    next: (&'a mut [Eight], &'a mut [f64]),
    from: (&'a mut [[u32; LANES]], &'a mut [u32]),
    /// Of whole eights.
    largest: L::V,
}

impl<L: Lanes> Walk<L> for MaximizeEach<'_, L> {
    type State = Ways<L>;

    #[inline(always)]
    fn nothing(&self, lanes: L) -> Ways<L> {
        let nothing = Best { value: lanes.splat(f64::NEG_INFINITY), index: lanes.ramp(0) };
        Ways { shifted: nothing, gathered: nothing }
    }

    #[inline(always)]
    fn take(&self, lanes: L, ways: &mut Ways<L>, log2: L::V, x: L::V, j: L::I) {
        ways.shifted.take(lanes, lanes.add(log2, x), j);
    }

    #[inline(always)]
    fn take_gathered(&self, lanes: L, ways: &mut Ways<L>, log2: L::V, x: L::V, j: L::I) {
        ways.gathered.take(lanes, lanes.add(log2, x), j);
    }

    #[inline(always)]
    fn take_apart(
        &self,
        lanes: L,
        Ways { gathered: best, .. }: &mut Ways<L>,
        lane: usize,
        entries: impl Iterator<Item = (f64, f64, u32)>,
    ) {
        let (mut values, mut lowest) = (lanes.to_array(best.value), [0; LANES]);
        lanes.store_index(best.index, &mut lowest);
        for (log2, x, j) in entries {
            let value = log2 + x;
            if value > values[lane] {
                (values[lane], lowest[lane]) = (value, j);
            }
        }
        *best = Best { value: lanes.load(&values), index: lanes.indices(&lowest) };
    }

    #[inline(always)]
    fn slice(&mut self, lanes: L, number: usize, ways: Ways<L>) {
        let Best { mut value, index } = ways.best(lanes);
        if let Some(likelihoods) = self.likelihoods {
            value = lanes.add(value, likelihoods.eight(lanes, number));
        }
        if let (Some(next), Some(from)) = (self.next.0.get_mut(number), self.from.0.get_mut(number))
        {
            lanes.store(value, next);
            lanes.store_index(index, from);
            self.largest = lanes.max(value, self.largest);
        } else {
            let mut indices = [0; LANES];
            lanes.store_index(index, &mut indices);
            self.from.1.copy_from_slice(&indices[..self.from.1.len()]);
            lanes.store_part(value, self.next.1);
        }
    }
}

/// The best ways so far, each the lowest of those that attain it.
struct Ways<L: Lanes> {
    shifted: Best<L>,
    gathered: Best<L>,
}

impl<L: Lanes> Ways<L> {
    #[inline(always)]
    fn best(self, lanes: L) -> Best<L> {
        let Self { shifted, gathered } = self;
        let tie = lanes.and(
            lanes.equal(gathered.value, shifted.value),
            lanes.index_less(gathered.index, shifted.index),
        );
        let better = lanes.or(lanes.less(shifted.value, gathered.value), tie);
        Best {
            value: lanes.max(gathered.value, shifted.value),
            index: lanes.select_index(better, gathered.index, shifted.index),
        }
    }
}

/// The best so far, and where it comes from.
#[derive(Clone, Copy)]
struct Best<L: Lanes> {
    value: L::V,
    index: L::I,
}

impl<L: Lanes> Best<L> {
    /// Of several that attain the maximum the first stays: indices ascend.
    #[inline(always)]
    fn take(&mut self, lanes: L, value: L::V, j: L::I) {
        let better = lanes.less(self.value, value);
        self.value = lanes.max(value, self.value);
        self.index = lanes.select_index(better, j, self.index);
    }
}

/// [`Maximize`] with the instructions chosen.
pub(crate) fn maximize(work: Maximize<'_>) -> f64 {
    run(work)
}

/// Adds to scores, and gives the largest.
pub(super) struct Add<'a> {
    pub(super) scores: &'a mut [f64],
    pub(super) added: Option<Shifted<'a>>,
}

impl Kernel for Add<'_> {
    type Output = f64;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> f64 {
        let Self { scores, added } = self;
        let count = scores.len().div_ceil(LANES);
        let (chunks, rest) = scores.as_chunks_mut::<LANES>();
        let mut largest = lanes.splat(f64::NEG_INFINITY);
        for number in 0..count {
            let mut score = eight(lanes, (chunks, rest), number);
            if let Some(added) = added {
                score = lanes.add(score, added.eight(lanes, number));
            }
            if let Some(chunk) = chunks.get_mut(number) {
                largest = lanes.max(score, largest);
                lanes.store(score, chunk);
            } else {
                lanes.store_part(score, rest);
            }
        }
        let largest = lanes.to_array(largest).into_iter().chain(rest.iter().copied());
        largest.fold(f64::NEG_INFINITY, f64::max)
    }
}

/// Adds to scores, and gives the largest.
pub(crate) fn add_scores(scores: &mut [f64], added: Option<Shifted<'_>>) -> f64 {
    run(Add { scores, added })
}

/// Logarithms to base 2, on the grid, of likelihoods over the largest.
pub(super) struct Log2OfLogs<'a> {
    pub(super) logs: &'a [f64],
    pub(super) largest: f64,
    pub(super) out: &'a mut [f64],
}

impl Kernel for Log2OfLogs<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self { logs, largest, out } = self;
        let n = logs.len();
        let (chunks, rest) = logs.as_chunks::<LANES>();
        let (outs, out_rest) = out[..n].as_chunks_mut::<LANES>();
        for (out, chunk) in outs.iter_mut().zip(chunks) {
            lanes.store(log2_over(lanes, lanes.load(chunk), largest), out);
        }
        lanes.store_part(log2_over(lanes, lanes.load_part(rest), largest), out_rest);
    }
}

/// As `on_grid`, for logarithms that are not above `largest`.
#[inline(always)]
fn log2_over<L: Lanes>(lanes: L, logs: L::V, largest: f64) -> L::V {
    let x = lanes.mul(lanes.sub(logs, lanes.splat(largest)), lanes.splat(LOG2_E));
    let whole = lanes.splat(INTEGERS);
    let steps = lanes.mul(x, lanes.splat(GRID_STEPS));
    let rounded = lanes.add(lanes.sub(steps, whole), whole);
    let on_grid = lanes.mul(rounded, lanes.splat(1.0 / GRID_STEPS));
    lanes.select(lanes.less(lanes.splat(-GRID_RANGE), x), on_grid, x)
}

/// Logarithms to base 2, on the grid of `log2`, from natural ones of which
/// `largest` is the largest, over that.
pub(crate) fn log2_of_logs(logs: &[f64], largest: f64, out: &mut [f64]) {
    run(Log2OfLogs { logs, largest, out });
}
