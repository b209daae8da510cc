//! Packing of vectors of eight chains side by side, and back: a transposition in registers for each
//! eight values of eight rows, instead of 64 moves.

use crate::limits::TINY;
use crate::memory::Packed;
use crate::simd::{Eight, LANES, Simd, kernels, row_block_ahead, store};

/// Range of the packed values of each lane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PackedRange {
    /// Least value, NaN aside.
    pub least: Eight,
    pub largest: Eight,
    /// True if a value is above 0 and below 2^-900.
    pub tiny: [bool; LANES],
}

kernels! {
    /// Packs rows that are at least as long as `out`: value i of lane l is `rows[l][i]`.
    pub fn pack = pack_rows<'a>(
        rows: [&'a [f64]; LANES], out: &'a mut [Packed],
    ) -> PackedRange;

    /// Unpacks values into a row for each lane. Rows beyond the length of `from` stay as they are.
    pub fn unpack = unpack_lanes<'a>(from: &'a [Packed], rows: [&'a mut [f64]; LANES]) -> ();

    /// Unpacks a sequence of vectors into rows of any numbers of whole blocks; with `stream`,
    /// stores past the caches.
    pub fn unpack_rows = unpack_blocks<'a>(
        from: &'a [Packed], rows: [&'a mut [Eight]; LANES], stream: bool,
    ) -> ();
}

#[inline(always)]
fn pack_rows<S: Simd>(s: S, rows: [&[f64]; LANES], out: &mut [Packed]) -> PackedRange {
    let zero = s.splat(0.0);
    let (mut least, mut largest) = (s.splat(f64::INFINITY), zero);
    let mut blocks = [(&[][..], &[][..]); LANES];
    // A row that is too short fails here, before anything is read.
    for l in 0..LANES {
        blocks[l] = rows[l][..out.len()].as_chunks::<LANES>();
    }
    for (number, out) in out.chunks_mut(LANES).enumerate() {
        let mut eight = [zero; LANES];
        for l in 0..LANES {
            eight[l] = row_block_ahead::<S, true>(s, blocks[l], number);
        }
        // `row_block` pads the last block with zeros; `zip` ends with `out`, before these.
        for (packed, out) in s.transpose(eight).into_iter().zip(out) {
            least = s.min(packed, least);
            largest = s.max(packed, largest);
            s.store(packed, out);
        }
    }
    let mut tiny = s.lt(zero, zero);
    // Zeros compare below too, and are usually the only hits: values are read again only then.
    if s.any(s.lt(least, s.splat(TINY))) {
        for packed in &*out {
            tiny = s.or(tiny, s.is_small(s.load(packed), TINY));
        }
    }
    let (least, largest) = (s.to_array(least), s.to_array(largest));
    PackedRange { least, largest, tiny: flags(s.bits(tiny)) }
}

/// Bits of a mask, one for each lane.
#[inline(always)]
pub(super) fn flags(bits: u8) -> [bool; LANES] {
    let mut flags = [false; LANES];
    for (l, flag) in flags.iter_mut().enumerate() {
        *flag = bits >> l & 1 == 1;
    }
    flags
}

#[inline(always)]
fn unpack_lanes<S: Simd>(s: S, from: &[Packed], rows: [&mut [f64]; LANES]) {
    let mut outs = rows.map(|row| row[..from.len()].as_chunks_mut::<LANES>());
    for (number, from) in from.chunks(LANES).enumerate() {
        let mut eight = [s.splat(0.0); LANES];
        for (packed, from) in eight.iter_mut().zip(from) {
            *packed = s.load(from);
        }
        let lanes = s.transpose(eight);
        // The last block may be partial: `store` writes as many as the row has room for.
        for l in 0..LANES {
            store(s, &mut outs[l], number, lanes[l]);
        }
    }
}

#[inline(always)]
fn unpack_blocks<S: Simd>(s: S, from: &[Packed], rows: [&mut [Eight]; LANES], stream: bool) {
    let mut rows = rows.map(<[Eight]>::iter_mut);
    for from in from.as_chunks::<LANES>().0 {
        let mut eight = [s.splat(0.0); LANES];
        for r in 0..LANES {
            eight[r] = s.load(&from[r]);
        }
        let lanes = s.transpose(eight);
        for (row, lane) in rows.iter_mut().zip(lanes) {
            // Sequences of a group end at different steps: the row of a shorter one is full before
            // the others.
            let Some(out) = row.next() else { continue };
            // Results of large groups do not fit into the caches: fetching each line before
            // overwriting it would move twice the bytes.
            if stream {
                s.stream(lane, out);
            } else {
                s.store(lane, out);
            }
        }
    }
    // Another thread may take the results: streamed stores are not ordered otherwise.
    if stream {
        s.fence();
    }
}
