//! Products with a vector, which are handed over eight lines after eight.

use std::ops::Range;

use super::blocks::{Blocks, run_in_blocks};
use super::lanes::{Eight, Kernel, LANES, Lanes};
use super::retreat::{Retreat, retreat_with};
use super::sliced::{Sliced, Walk};
use super::update::{Update, Updated, update_with};

/// A product with a vector.
pub(crate) trait Product: Copy + Send {
    /// Whether it is known to be one of a distribution, with a stochastic matrix.
    const KNOWN: bool;

    /// The number of lines.
    fn lines(self) -> usize;

    /// Hands over some of the eights, numbered from the first of them; lines
    /// beyond the last have 0.
    fn each<L: Lanes>(self, lanes: L, eights: Range<usize>, each: &mut impl Each<L>);

    /// Does an [`Update`] with it. Here, so that loops are compiled with this crate, and
    /// not again with each one that uses it.
    fn update(update: Update<'_, Self>) -> Updated;

    /// Does a [`Retreat`] with it.
    fn retreat(retreat: Retreat<'_, Self>) -> f64;
}

/// What is done with eight lines of a product. (A closure might not become part
/// of the function that may use the instructions.)
pub(crate) trait Each<L: Lanes> {
    /// Takes those with this number. Implementations are `#[inline(always)]`.
    fn eight(&mut self, lanes: L, number: usize, product: L::V);
}

/// One that has been made.
#[derive(Clone, Copy)]
pub(crate) struct Made<'a>(pub(crate) &'a [f64]);

impl Product for Made<'_> {
    const KNOWN: bool = false;

    #[inline(always)]
    fn lines(self) -> usize {
        self.0.len()
    }

    #[inline(always)]
    fn each<L: Lanes>(self, lanes: L, eights: Range<usize>, each: &mut impl Each<L>) {
        let end = self.0.len().min(eights.end * LANES);
        let (chunks, rest) = self.0[eights.start * LANES..end].as_chunks::<LANES>();
        for (number, chunk) in chunks.iter().enumerate() {
            each.eight(lanes, number, lanes.load(chunk));
        }
        if !rest.is_empty() {
            each.eight(lanes, chunks.len(), lanes.load_part(rest));
        }
    }

    #[inline(never)]
    fn update(update: Update<'_, Self>) -> Updated {
        update_with(update)
    }

    #[inline(never)]
    fn retreat(retreat: Retreat<'_, Self>) -> f64 {
        retreat_with(retreat)
    }
}

/// One with a sparse matrix.
#[derive(Clone, Copy)]
pub(crate) struct Sparse<'a> {
    pub(crate) matrix: &'a Sliced,
    pub(crate) x: &'a [f64],
}

impl Product for Sparse<'_> {
    const KNOWN: bool = true;

    #[inline(always)]
    fn lines(self) -> usize {
        self.matrix.lines()
    }

    #[inline(always)]
    fn each<L: Lanes>(self, lanes: L, eights: Range<usize>, each: &mut impl Each<L>) {
        self.matrix.walk(lanes, eights, self.x, &mut Sums(each));
    }

    #[inline(never)]
    fn update(update: Update<'_, Self>) -> Updated {
        update_with(update)
    }

    #[inline(never)]
    fn retreat(retreat: Retreat<'_, Self>) -> f64 {
        retreat_with(retreat)
    }
}

/// Sums of products of values with those of x, of each line.
struct Sums<'a, E>(&'a mut E);

impl<L: Lanes, E: Each<L>> Walk<L> for Sums<'_, E> {
    type State = L::V;

    #[inline(always)]
    fn nothing(&self, lanes: L) -> L::V {
        lanes.splat(0.0)
    }

    #[inline(always)]
    fn take(&self, lanes: L, sum: &mut L::V, value: L::V, x: L::V, _: L::I) {
        *sum = lanes.add(*sum, lanes.mul(value, x));
    }

    #[inline(always)]
    fn take_apart(
        &self,
        lanes: L,
        sum: &mut L::V,
        lane: usize,
        entries: impl Iterator<Item = (f64, f64, u32)>,
    ) {
        // One after another, as in a slot: lines of the same values must have the
        // same sum.
        let mut sums = lanes.to_array(*sum);
        entries.for_each(|(value, x, _)| sums[lane] += value * x);
        *sum = lanes.load(&sums);
    }

    #[inline(always)]
    fn slice(&mut self, lanes: L, number: usize, sum: L::V) {
        self.0.eight(lanes, number, sum);
    }
}

/// Eight values of a slice, or what is left of them.
#[inline(always)]
pub(super) fn eight<L: Lanes>(lanes: L, (chunks, rest): (&[Eight], &[f64]), number: usize) -> L::V {
    match chunks.get(number) {
        Some(chunk) => lanes.load(chunk),
        None => lanes.load_part(rest),
    }
}

/// Writes eight values to a slice, or what there is room for.
#[inline(always)]
pub(super) fn put<L: Lanes>(
    lanes: L,
    (chunks, rest): (&mut [Eight], &mut [f64]),
    number: usize,
    v: L::V,
) {
    match chunks.get_mut(number) {
        Some(chunk) => lanes.store(v, chunk),
        None => lanes.store_part(v, rest),
    }
}

/// Some of the lines of a product.
#[derive(Clone, Copy)]
pub(crate) struct Part<P> {
    product: P,
    /// The first line, a multiple of eight.
    start: usize,
    end: usize,
}

impl<P: Product> Part<P> {
    pub(crate) fn all(product: P) -> Self {
        Self { product, start: 0, end: product.lines() }
    }

    /// The lines before this one, a multiple of eight, and the others.
    pub(super) fn split(self, at: usize) -> (Self, Self) {
        let middle = self.start + at;
        (Self { end: middle, ..self }, Self { start: middle, ..self })
    }

    #[inline(always)]
    pub(super) fn lines(self) -> usize {
        self.end - self.start
    }

    /// Hands over each eight, numbered from the first of the part.
    #[inline(always)]
    pub(super) fn each<L: Lanes>(self, lanes: L, each: &mut impl Each<L>) {
        self.product.each(lanes, self.start / LANES..self.end.div_ceil(LANES), each);
    }
}

impl Sliced {
    /// `out` = the product with x.
    pub(crate) fn multiply(&self, x: &[f64], out: &mut [f64]) {
        assert_eq!(out.len(), self.lines(), "out must have one value per state");
        run_in_blocks(Multiply { product: Part::all(Sparse { matrix: self, x }), out });
    }
}

/// `out` = a product.
pub(super) struct Multiply<'a> {
    pub(super) product: Part<Sparse<'a>>,
    pub(super) out: &'a mut [f64],
}

impl Kernel for Multiply<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        self.product.each(lanes, &mut Store(self.out.as_chunks_mut()));
    }
}

impl Blocks for Multiply<'_> {
    fn lines(&self) -> usize {
        self.out.len()
    }

    fn split(self, at: usize) -> (Self, Self) {
        let (product, (out, out_rest)) = (self.product.split(at), self.out.split_at_mut(at));
        (Self { product: product.0, out }, Self { product: product.1, out: out_rest })
    }

    fn join((): (), (): ()) {}
}

struct Store<'a>((&'a mut [Eight], &'a mut [f64]));

impl<L: Lanes> Each<L> for Store<'_> {
    #[inline(always)]
    fn eight(&mut self, lanes: L, number: usize, product: L::V) {
        put(lanes, (&mut *self.0.0, &mut *self.0.1), number, product);
    }
}
