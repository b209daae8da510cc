//! Work on many lines, cut into blocks that several threads can do.
//!
//! Where blocks end, and in which order their results are put together, depends
//! on the number of lines alone: results are the same to the bit for any number of
//! threads, and without the feature `rayon`.

use super::lanes::{Kernel, LANES, run};

/// How many lines a block has: a multiple of eight.
pub(super) const BLOCK: usize = 4096 * LANES;

/// From how many lines on other threads help: to wake them takes time.
#[cfg(feature = "rayon")]
const PARALLEL: usize = 3 * BLOCK;

/// Work on lines that do not depend on each other.
pub(crate) trait Blocks: Kernel<Output: Send> + Sized + Send {
    /// How many there are.
    fn lines(&self) -> usize;

    /// The work on the lines before this one, a multiple of eight, and that on the
    /// others.
    fn split(self, at: usize) -> (Self, Self);

    /// What both give together.
    fn join(first: Self::Output, second: Self::Output) -> Self::Output;
}

/// Does it with the instructions chosen, on several threads if there is much of it.
#[inline(always)]
pub(crate) fn run_in_blocks<W: Blocks>(work: W) -> W::Output {
    let lines = work.lines();
    if lines <= BLOCK {
        return run(work);
    }
    #[cfg(feature = "rayon")]
    if lines >= PARALLEL {
        return on_threads(work);
    }
    run_in_turn(work)
}

/// Cuts where a block ends.
fn halves<W: Blocks>(work: W) -> (W, W) {
    let middle = work.lines().div_ceil(2 * BLOCK) * BLOCK;
    work.split(middle)
}

fn run_in_turn<W: Blocks>(work: W) -> W::Output {
    if work.lines() <= BLOCK {
        return run(work);
    }
    let (first, second) = halves(work);
    W::join(run_in_turn(first), run_in_turn(second))
}

#[cfg(feature = "rayon")]
fn on_threads<W: Blocks>(work: W) -> W::Output {
    if work.lines() <= BLOCK {
        return run(work);
    }
    let (first, second) = halves(work);
    let (first, second) = rayon::join(|| on_threads(first), || on_threads(second));
    W::join(first, second)
}

#[cfg(test)]
mod tests {
    use super::super::LIFT;
    use super::super::product::{Made, Part};
    use super::super::sliced::Sliced;
    use super::super::update::{Settle, Update, Updated, Watch};
    use super::*;

    /// Not a multiple of eight, nor of blocks.
    const LINES: usize = 4 * BLOCK + 1003;

    fn values(factor: f64) -> Vec<f64> {
        (1..=LINES).map(|i| (i as f64 * factor).fract()).collect()
    }

    fn work<'a>(p: &'a [f64], b: &'a [f64], out: &'a mut [f64]) -> Update<'a, Part<Made<'a>>> {
        Update {
            prediction: Part::all(Made(p)),
            lift: LIFT,
            likelihoods: b,
            watch: Watch::Products,
            out,
        }
    }

    #[test]
    fn blocks_give_what_all_lines_at_once_do() {
        let (p, b) = (values(0.618_033_988_7), values(0.414_213_562_3));
        let (mut at_once, mut in_blocks) = (vec![0.0; LINES], vec![0.0; LINES]);
        let (whole, parts) =
            (run(work(&p, &b, &mut at_once)), run_in_blocks(work(&p, &b, &mut in_blocks)));
        assert_eq!(at_once, in_blocks);
        assert!((whole.products - parts.products).abs() <= 1e-12 * whole.products);
        assert!((whole.predicted - parts.predicted).abs() <= 1e-12 * whole.predicted);
        let (products, predicted) = (parts.products, parts.predicted);
        assert_eq!(Updated { products, predicted, ..whole }, parts);
        // Threads do not change a bit.
        assert_eq!(run_in_turn(work(&p, &b, &mut in_blocks)), parts);

        let last = LINES - 1;
        for tiny in [None, Some(0), Some(BLOCK - 1), Some(BLOCK), Some(last)] {
            let mut x = vec![0.5; LINES];
            tiny.into_iter().for_each(|at| x[at] = 1e-280);
            assert_eq!(run_in_blocks(Settle { x: &mut x, sum: 0.5 }), tiny.is_some());
            assert_eq!(x[last], if tiny == Some(last) { 2e-280 } else { 1.0 });
        }
    }

    #[test]
    fn a_product_goes_on_where_the_block_before_ends() {
        // Neighbours, some of them far, and a few lines of many entries.
        let line = |i: usize| {
            let far = i.is_multiple_of(5).then_some((i * 7919) % LINES);
            let many =
                (0..if i.is_multiple_of(1009) { 40 } else { 0 }).map(|k| (i + 50 * k) % LINES);
            let mut indices: Vec<u32> =
                [i, (i + 1) % LINES].into_iter().chain(far).chain(many).map(|j| j as u32).collect();
            indices.sort_unstable();
            indices.dedup();
            let values = indices.iter().map(|j| f64::from(j % 13) + 1.0).collect();
            (indices, values)
        };
        let lines: Vec<(Vec<u32>, Vec<f64>)> = (0..LINES).map(line).collect();
        let sliced = Sliced::new(LINES, |i| (&lines[i].0, &lines[i].1));
        let x = values(0.618_033_988_7);
        let mut out = vec![f64::NAN; LINES];
        sliced.multiply(&x, &mut out);
        for ((indices, values), out) in lines.iter().zip(out) {
            let sum: f64 = indices.iter().zip(values).map(|(&j, a)| a * x[j as usize]).sum();
            assert!((sum - out).abs() <= 1e-13 * sum);
        }
    }
}
