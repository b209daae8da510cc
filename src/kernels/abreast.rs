//! Numbers of eight sequences side by side, from rows of their own and back.

use std::ops::{Deref, DerefMut};

use super::lanes::{Eight, Kernel, LANES, Lanes, run};
use super::update::{TINY, is_tiny};

/// A number of each of eight sequences; in memory where no load of them takes two
/// lines of a cache.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[repr(align(64))]
pub(crate) struct Abreast(pub(crate) Eight);

impl Deref for Abreast {
    type Target = Eight;

    #[inline(always)]
    fn deref(&self) -> &Eight {
        &self.0
    }
}

impl DerefMut for Abreast {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut Eight {
        &mut self.0
    }
}

/// Likelihoods of eight sequences side by side.
struct Gather<'a> {
    /// Of the same length as `out`.
    pub(crate) rows: [&'a [f64]; LANES],
    pub(crate) out: &'a mut [Abreast],
}

/// What a [`Gather`] has seen in each lane.
pub(crate) struct Gathered {
    /// NaN apart.
    pub(crate) least: Eight,
    pub(crate) largest: Eight,
    /// Whether one is above 0 and below 2^-900.
    pub(crate) tiny: [bool; LANES],
}

impl Kernel for Gather<'_> {
    type Output = Gathered;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Gathered {
        let Self { rows, out } = self;
        let n = out.len();
        let zero = lanes.splat(0.0);
        let mut seen = Seen { least: lanes.splat(f64::INFINITY), largest: zero };
        let mut chunks = [&[][..]; LANES];
        let mut rests = [&[][..]; LANES];
        for l in 0..LANES {
            (chunks[l], rests[l]) = rows[l][..n].as_chunks::<LANES>();
        }
        let (outs, out_rest) = out.as_chunks_mut::<LANES>();
        for (number, out) in outs.iter_mut().enumerate() {
            let mut eight = [zero; LANES];
            for l in 0..LANES {
                eight[l] = lanes.load(&chunks[l][number]);
            }
            let columns = lanes.transpose(eight);
            for r in 0..LANES {
                seen.look(lanes, columns[r]);
                lanes.store(columns[r], &mut out[r]);
            }
        }
        if !out_rest.is_empty() {
            let mut eight = [zero; LANES];
            for l in 0..LANES {
                eight[l] = lanes.load_part(rests[l]);
            }
            let columns = lanes.transpose(eight);
            for (r, out) in out_rest.iter_mut().enumerate() {
                seen.look(lanes, columns[r]);
                lanes.store(columns[r], out);
            }
        }
        let mut tiny = lanes.less(zero, zero);
        // Zeros are below, too: only now is it worth while to tell them apart.
        if lanes.any(lanes.less(seen.least, lanes.splat(TINY))) {
            for out in &*out {
                tiny = lanes.or(tiny, is_tiny(lanes, lanes.load(out)));
            }
        }
        Gathered {
            least: lanes.to_array(seen.least),
            largest: lanes.to_array(seen.largest),
            tiny: flags(lanes, tiny),
        }
    }
}

/// In which lanes a mask is set.
#[inline(always)]
pub(super) fn flags<L: Lanes>(lanes: L, mask: L::M) -> [bool; LANES] {
    let zero = lanes.splat(0.0);
    lanes.to_array(lanes.select(mask, lanes.splat(1.0), zero)).map(|flag| flag != 0.0)
}

struct Seen<L: Lanes> {
    least: L::V,
    largest: L::V,
}

impl<L: Lanes> Seen<L> {
    #[inline(always)]
    fn look(&mut self, lanes: L, b: L::V) {
        self.least = lanes.min(b, self.least);
        self.largest = lanes.max(b, self.largest);
    }
}

/// Eights back into a row for each lane.
struct Scatter<'a> {
    pub(crate) from: &'a [Abreast],
    /// Of the same length as `from`.
    pub(crate) rows: [&'a mut [f64]; LANES],
}

impl Kernel for Scatter<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self { from, rows } = self;
        let zero = lanes.splat(0.0);
        let (chunks, rest) = from.as_chunks::<LANES>();
        let outs = rows.map(|row| row[..from.len()].as_chunks_mut::<LANES>());
        for (number, chunk) in chunks.iter().enumerate() {
            let mut eight = [zero; LANES];
            for r in 0..LANES {
                eight[r] = lanes.load(&chunk[r]);
            }
            let columns = lanes.transpose(eight);
            for l in 0..LANES {
                lanes.store(columns[l], &mut outs[l].0[number]);
            }
        }
        if !rest.is_empty() {
            let mut eight = [zero; LANES];
            for (r, from) in rest.iter().enumerate() {
                eight[r] = lanes.load(from);
            }
            let columns = lanes.transpose(eight);
            for l in 0..LANES {
                lanes.store_part(columns[l], &mut *outs[l].1);
            }
        }
    }
}

/// All eights of a sequence of vectors into a row of its own for each lane: of no more than
/// `from` has, rounded up to eight.
pub(super) struct Unravel<'a> {
    pub(crate) from: &'a [Abreast],
    pub(crate) rows: [&'a mut [Eight]; LANES],
    /// Whether past the caches.
    pub(crate) stream: bool,
}

impl Kernel for Unravel<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self { from, rows, stream } = self;
        for (number, chunk) in from.as_chunks::<LANES>().0.iter().enumerate() {
            let mut eight = [lanes.splat(0.0); LANES];
            for r in 0..LANES {
                eight[r] = lanes.load(&chunk[r]);
            }
            let columns = lanes.transpose(eight);
            for l in 0..LANES {
                let Some(out) = rows[l].get_mut(number) else { continue };
                if stream {
                    lanes.stream(columns[l], out);
                } else {
                    lanes.store(columns[l], out);
                }
            }
        }
        if stream {
            lanes.fence();
        }
    }
}

/// [`Unravel`] with the instructions chosen.
pub(crate) fn unravel(from: &[Abreast], rows: [&mut [Eight]; LANES], stream: bool) {
    run(Unravel { from, rows, stream });
}

/// [`Gather`] with the instructions chosen.
pub(crate) fn gather(rows: [&[f64]; LANES], out: &mut [Abreast]) -> Gathered {
    run(Gather { rows, out })
}

/// [`Scatter`] with the instructions chosen.
pub(crate) fn scatter(from: &[Abreast], rows: [&mut [f64]; LANES]) {
    run(Scatter { from, rows });
}
