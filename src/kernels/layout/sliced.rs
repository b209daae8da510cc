//! Sparse lines (rows of A, or its columns) in slices of eight, for products with eight lines at
//! a time (sliced ELLPACK, Monakov, Lokhmotov and Avetisyan 2010).
//!
//! Lines keep their order, so that results are written, and vectors beside them read, without
//! permutation. The entries of a slice fill slots of eight, one for each line. A *gathered* slot
//! has an index for each line. A *shifted* slot has one index, that of its first line; the others
//! follow it: on a map whose places are numbered along the roads many entries (all those of
//! staying) lie on such diagonals, and a load costs a fifth of a gather. *Overflow* entries, of
//! lines with many more than the rest of their slice, are stored line by line.
//!
//! In portable code, all entries may be stored as overflow instead, in the order in which slots
//! would add them: results are the same to the bit.

use std::sync::OnceLock;
use std::time::{Duration, Instant};

use super::values::{EntryValues, HalfLine, Value, Width};
use crate::kernels::simd::{Isa, LANES};

/// Relative costs of a shifted and of a gathered slot.
const SHIFTED_COST: usize = 2;
const GATHERED_COST: usize = 5;
/// Costs of having overflow entries in a slice at all, and of each.
const ANY_OVERFLOW_COST: usize = 30;
const OVERFLOW_COST: usize = 2;

/// Fewest lines of the first matrix, whose products choose the layout of all in portable code.
const FEWEST_TIMED: usize = 64;

/// Lines of a matrix of n lines and n columns, in slices of eight.
#[derive(Debug, Clone)]
pub(crate) struct Sliced {
    pub(super) lines: usize,
    pub(super) slices: Vec<Slice>,
    /// Index of the first line of each shifted slot.
    pub(super) bases: Vec<u32>,
    pub(super) indices: Vec<HalfLine<u32>>,
    pub(super) overflow: Vec<Overflow>,
    pub(super) overflow_indices: Vec<u32>,
    pub(super) values: Width<EntryValues<f64>, EntryValues<f32>>,
}

/// Ends of the slots and overflow lines of a slice.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Slice {
    pub(super) shifted: u32,
    pub(super) gathered: u32,
    pub(super) overflow: u32,
}

/// Overflow entries of a line, up to an end.
#[derive(Debug, Clone, Copy)]
pub(super) struct Overflow {
    pub(super) lane: u32,
    pub(super) end: u32,
}

/// Entry of a slice.
struct SlicedEntry<V> {
    /// Number of its diagonal: the index of lane 7 on it.
    diagonal: usize,
    lane: usize,
    index: u32,
    value: V,
}

impl Sliced {
    /// Builds slices from lines whose indices ascend and are below `lines`. O(n + entries), plus
    /// the sorting of the entries of each slice.
    pub(crate) fn new<'a, V: Value + 'a>(
        lines: usize,
        line: impl Fn(usize) -> (&'a [u32], &'a [V]),
    ) -> Self {
        /// Layout that was faster for the first matrix.
        static SLOTS: OnceLock<bool> = OnceLock::new();
        let portable = Isa::chosen() == Isa::Portable && !cfg!(target_family = "wasm");
        if portable && let Some(&slots) = SLOTS.get() {
            return Self::with_slots(slots, lines, line);
        }
        let slots = Self::with_slots(true, lines, &line);
        // A loop over rows ends at another place in each. Some processors foresee that: on Zen 5 a
        // scalar loop took 51 µs for a road graph on which Sapphire Rapids takes 242, and slots
        // 75. WebAssembly need not have a clock.
        if !portable || lines < FEWEST_TIMED {
            return slots;
        }
        let rows = Self::with_slots(false, lines, &line);
        let slots_are_faster = *SLOTS.get_or_init(|| slots.time() <= rows.time());
        if slots_are_faster { slots } else { rows }
    }

    /// Shortest time of a few products.
    fn time(&self) -> Duration {
        let (x, mut out) = (vec![1.0; self.lines], vec![0.0; self.lines]);
        let products = (0..16).map(|_| {
            let start = Instant::now();
            self.multiply(&x, &mut out);
            start.elapsed()
        });
        products.min().unwrap_or_default()
    }

    /// The same with slots of eight, or without.
    pub(crate) fn with_slots<'a, V: Value + 'a>(
        slots: bool,
        lines: usize,
        line: impl Fn(usize) -> (&'a [u32], &'a [V]),
    ) -> Self {
        assert!(i32::try_from(lines).is_ok(), "gathers take indices with a sign");
        let mut sliced = Self {
            lines,
            slices: Vec::with_capacity(lines.div_ceil(LANES)),
            bases: Vec::new(),
            indices: Vec::new(),
            overflow: Vec::new(),
            overflow_indices: Vec::new(),
            values: Width::Double(EntryValues::new()),
        };
        let mut stored = EntryValues::new();
        let (mut entries, mut keys) = (Vec::new(), Vec::new());
        for first in (0..lines).step_by(LANES) {
            entries.clear();
            for lane in 0..LANES.min(lines - first) {
                let (indices, values) = line(first + lane);
                // Products rely on it.
                assert!(indices.iter().all(|j| (*j as usize) < lines), "an index is too large");
                let entry = |(&index, &value): (&u32, &V)| {
                    let diagonal = index as usize + (LANES - 1) - lane;
                    SlicedEntry { diagonal, lane, index, value }
                };
                entries.extend(indices.iter().zip(values).map(entry));
            }
            sliced.push(slots, first, &entries, &mut keys, &mut stored);
        }
        sliced.bases.shrink_to_fit();
        sliced.indices.shrink_to_fit();
        stored.shifted.shrink_to_fit();
        stored.gathered.shrink_to_fit();
        sliced.values = V::of_width(stored);
        sliced
    }

    /// Adds a slice, with its entries lane by lane.
    fn push<V: Value>(
        &mut self,
        slots: bool,
        first: usize,
        entries: &[SlicedEntry<V>],
        keys: &mut Vec<usize>,
        stored: &mut EntryValues<V>,
    ) {
        let mut left = [0_usize; LANES];
        entries.iter().for_each(|entry| left[entry.lane] += 1);
        let shifted = self.diagonals(entries, keys, &mut left);
        // Overflow entries are those below the depth of the gathered slots.
        let overflow_cost = |depth: usize| {
            let deeper: usize = left.iter().map(|left| left.saturating_sub(depth)).sum();
            let any = if deeper > 0 { ANY_OVERFLOW_COST } else { 0 };
            depth * GATHERED_COST + any + deeper * OVERFLOW_COST
        };
        let depth = left.iter().copied().min_by_key(|&depth| overflow_cost(depth));
        let depth = if slots { depth.unwrap_or(0) } else { 0 };
        let (start, shifted_start) = (self.indices.len(), self.bases.len());
        if slots {
            self.bases.extend(shifted.iter().map(|diagonal| (diagonal - (LANES - 1)) as u32));
        }
        stored.shifted.resize(self.bases.len(), V::Slot::default());
        // Lanes without an entry take the first place of the slice, and 0 of it.
        self.indices.resize(start + depth, HalfLine([first as u32; LANES]));
        stored.gathered.resize(start + depth, V::Slot::default());
        for of_lane in entries.chunk_by(|a, b| a.lane == b.lane) {
            let (lane, overflow_start) = (of_lane[0].lane, self.overflow_indices.len());
            let diagonal = |entry: &SlicedEntry<V>| shifted.binary_search(&entry.diagonal);
            for entry in of_lane {
                match diagonal(entry) {
                    Ok(at) if slots => stored.shifted[shifted_start + at][lane] = entry.value,
                    Ok(_) => {
                        self.overflow_indices.push(entry.index);
                        stored.overflow.push(entry.value);
                    }
                    Err(_) => {}
                }
            }
            let others = of_lane.iter().filter(|entry| diagonal(entry).is_err());
            for (rank, entry) in others.enumerate() {
                if rank < depth {
                    self.indices[start + rank][lane] = entry.index;
                    stored.gathered[start + rank][lane] = entry.value;
                } else {
                    self.overflow_indices.push(entry.index);
                    stored.overflow.push(entry.value);
                }
            }
            let end = self.overflow_indices.len();
            if end > overflow_start {
                self.overflow.push(Overflow { lane: lane as u32, end: end as u32 });
            }
        }
        self.slices.push(Slice {
            shifted: self.bases.len() as u32,
            gathered: self.indices.len() as u32,
            overflow: self.overflow.len() as u32,
        });
    }

    /// Chooses the diagonals that are worth a shifted slot, ascending, and counts down the entries
    /// that are left in each lane.
    fn diagonals<V>(
        &self,
        entries: &[SlicedEntry<V>],
        keys: &mut Vec<usize>,
        left: &mut [usize; LANES],
    ) -> Vec<usize> {
        // Diagonal and lane in one number: sorting entries would take most of the time.
        keys.clear();
        keys.extend(entries.iter().map(|entry| entry.diagonal * LANES + entry.lane));
        keys.sort_unstable();
        let inside = |diagonal: usize| (LANES - 1..self.lines).contains(&diagonal);
        let mut diagonals: Vec<&[usize]> = keys
            .chunk_by(|a, b| a / LANES == b / LANES)
            .filter(|keys| keys.len() > 1 && inside(keys[0] / LANES))
            .collect();
        diagonals.sort_by_key(|keys| std::cmp::Reverse(keys.len()));
        let cost = |shifted: usize, left: &[usize; LANES]| {
            let deepest = left.iter().copied().max().unwrap_or(0);
            shifted * SHIFTED_COST + deepest * GATHERED_COST
        };
        let (mut least, mut taken, mut after) = (cost(0, left), 0, *left);
        for (keys, count) in diagonals.iter().zip(1..) {
            keys.iter().for_each(|key| after[key % LANES] -= 1);
            if cost(count, &after) < least {
                (least, taken, *left) = (cost(count, &after), count, after);
            }
        }
        let mut shifted: Vec<usize> = diagonals[..taken].iter().map(|d| d[0] / LANES).collect();
        shifted.sort_unstable();
        shifted
    }

    /// Returns the logarithms of all values, to base 2 as decoders add them; −∞ where there is no
    /// entry.
    pub(crate) fn log2(&self) -> EntryValues {
        match &self.values {
            Width::Double(values) => values.log2(),
            Width::Single(values) => values.log2(),
        }
    }

    /// Number of lines.
    pub(crate) fn lines(&self) -> usize {
        self.lines
    }
}
