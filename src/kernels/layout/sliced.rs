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
//! Lines of unlike lengths leave slots empty. Two other [arrangements](Arrangement) have none, and
//! add in the same order, so that results are the same to the bit: all entries as overflow, for
//! portable code, or in gathered slots of *groups*, eight lines of one length out of a window of
//! consecutive ones (SELL-C-σ, Kreutzer et al. 2014). Sums of a window are brought into the order
//! of its lines before they are passed on. Groups read fewer bytes, and the ends of their loops are
//! foreseen, but every entry of a diagonal is gathered.

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

/// Fewest lines of the first matrix, whose products choose the arrangement of all in portable code.
const FEWEST_TIMED: usize = 64;
/// Time after which no other product is timed.
const LONGEST_TIMED: Duration = Duration::from_millis(10);
/// Fewest bytes of slots for groups: smaller matrices stay in the second cache as they are.
const FEWEST_BYTES_GROUPED: usize = 1 << 20;
/// Lines of a window: as many as a byte tells apart.
pub(super) const WINDOW: usize = 1 << u8::BITS;

/// Lines of a matrix of n lines and n columns, in slices of eight.
#[derive(Debug, Clone)]
pub(crate) struct Sliced {
    pub(super) lines: usize,
    pub(super) slices: Vec<Slice>,
    /// Lines of each group, numbered from the first of their window. Empty without groups.
    pub(super) order: Vec<[u8; LANES]>,
    /// Index of the first line of each shifted slot.
    pub(super) bases: Vec<u32>,
    pub(super) indices: Vec<HalfLine<u32>>,
    pub(super) overflow: Vec<Overflow>,
    pub(super) overflow_indices: Vec<u32>,
    pub(super) values: Width<EntryValues<f64>, EntryValues<f32>>,
}

/// Ends of the slots and overflow lines of a slice, or of a group.
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

/// Arrangement of entries.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Arrangement {
    /// Slots of eight consecutive lines.
    Slices,
    /// Gathered slots of eight lines of a window.
    Groups,
    /// Line by line.
    Rows,
}

/// Entries of the lines of a window outside shifted slots, in the order of addition.
struct Others<V> {
    entries: Vec<(u32, V)>,
    /// Starts of lines, and the end.
    starts: Vec<usize>,
}

impl<V> Others<V> {
    fn of_line(&self, line: u8) -> &[(u32, V)] {
        &self.entries[self.starts[line as usize]..self.starts[line as usize + 1]]
    }
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
        /// Arrangement that was faster for the first matrix.
        static CHOSEN: OnceLock<Arrangement> = OnceLock::new();
        let portable = Isa::chosen() == Isa::Portable;
        let other = if portable { Arrangement::Rows } else { Arrangement::Groups };
        if portable && CHOSEN.get() == Some(&other) {
            return Self::arranged(other, lines, line);
        }
        let slices = Self::arranged(Arrangement::Slices, lines, &line);
        let eligible = if portable {
            lines >= FEWEST_TIMED
        } else {
            let bytes = size_of::<u32>() + size_of::<V>();
            let slots = slices.bases.len() * (size_of::<u32>() + LANES * size_of::<V>())
                + (slices.indices.len() * LANES + slices.overflow_indices.len()) * bytes;
            let entries: usize = (0..lines).map(|number| line(number).0.len()).sum();
            slots > FEWEST_BYTES_GROUPED && entries * bytes < slots / 8 * 7
        };
        // WebAssembly need not have a clock.
        if !eligible || cfg!(target_family = "wasm") || CHOSEN.get() == Some(&Arrangement::Slices) {
            return slices;
        }
        let others = Self::arranged(other, lines, line);
        // A loop over rows ends at another place in each. Some processors foresee that: on Zen 5 a
        // scalar loop took 51 µs for a road graph on which Sapphire Rapids takes 242, and slots
        // 75. Of groups, a gain is asked that outweighs the loss of decoders. (Not timed inside
        // `get_or_init`: a thread that waits for others may build another matrix meanwhile.)
        let chosen = CHOSEN.get().copied().unwrap_or_else(|| {
            let time = if portable { others.time() } else { others.time() * 8 / 7 };
            let faster = if slices.time() <= time { Arrangement::Slices } else { other };
            *CHOSEN.get_or_init(|| faster)
        });
        if chosen == other { others } else { slices }
    }

    /// Shortest time of a few products; of fewer if they take long.
    fn time(&self) -> Duration {
        let (x, mut out) = (vec![1.0; self.lines], vec![0.0; self.lines]);
        let (begin, mut shortest) = (Instant::now(), Duration::MAX);
        for _ in 0..16 {
            let start = Instant::now();
            self.multiply(&x, &mut out);
            shortest = shortest.min(start.elapsed());
            if begin.elapsed() > LONGEST_TIMED {
                break;
            }
        }
        shortest
    }

    /// The same in this arrangement.
    pub(crate) fn arranged<'a, V: Value + 'a>(
        arrangement: Arrangement,
        lines: usize,
        line: impl Fn(usize) -> (&'a [u32], &'a [V]),
    ) -> Self {
        assert!(i32::try_from(lines).is_ok(), "gathers take indices with a sign");
        let mut sliced = Self {
            lines,
            slices: Vec::with_capacity(lines.div_ceil(LANES)),
            order: Vec::new(),
            bases: Vec::new(),
            indices: Vec::new(),
            overflow: Vec::new(),
            overflow_indices: Vec::new(),
            values: Width::Double(EntryValues::new()),
        };
        let mut stored = EntryValues::new();
        let (mut entries, mut keys) = (Vec::new(), Vec::new());
        let mut others = Others { entries: Vec::new(), starts: Vec::new() };
        let window = if arrangement == Arrangement::Groups { WINDOW } else { LANES };
        for start in (0..lines).step_by(window) {
            others.entries.clear();
            others.starts.clear();
            others.starts.push(0);
            for first in (start..lines.min(start + window)).step_by(LANES) {
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
                sliced.push_shifted(arrangement, &entries, &mut keys, &mut stored, &mut others);
            }
            sliced.push_others(arrangement, start, &others, &mut stored);
        }
        sliced.bases.shrink_to_fit();
        sliced.indices.shrink_to_fit();
        stored.shifted.shrink_to_fit();
        stored.gathered.shrink_to_fit();
        sliced.values = V::of_width(stored);
        sliced
    }

    /// Adds the shifted slots of a slice, with its entries lane by lane, and passes on the others.
    fn push_shifted<V: Value>(
        &mut self,
        arrangement: Arrangement,
        entries: &[SlicedEntry<V>],
        keys: &mut Vec<usize>,
        stored: &mut EntryValues<V>,
        others: &mut Others<V>,
    ) {
        let shifted = self.diagonals(entries, keys);
        let (start, slots) = (self.bases.len(), arrangement == Arrangement::Slices);
        if slots {
            self.bases.extend(shifted.iter().map(|diagonal| (diagonal - (LANES - 1)) as u32));
        }
        stored.shifted.resize(self.bases.len(), V::Slot::default());
        let diagonal = |entry: &SlicedEntry<V>| shifted.binary_search(&entry.diagonal);
        let mut left = entries;
        for lane in 0..LANES {
            let (of_lane, after) = left.split_at(left.partition_point(|e| e.lane == lane));
            left = after;
            for entry in of_lane {
                match diagonal(entry) {
                    Ok(at) if slots => stored.shifted[start + at][lane] = entry.value,
                    Ok(_) => others.entries.push((entry.index, entry.value)),
                    Err(_) => {}
                }
            }
            let rest = of_lane.iter().filter(|entry| diagonal(entry).is_err());
            others.entries.extend(rest.map(|entry| (entry.index, entry.value)));
            others.starts.push(others.entries.len());
        }
        self.slices.push(Slice { shifted: self.bases.len() as u32, ..Slice::default() });
    }

    /// Adds the gathered slots and the overflow of a window, or of the one slice that begins here.
    fn push_others<V: Value>(
        &mut self,
        arrangement: Arrangement,
        first: usize,
        others: &Others<V>,
        stored: &mut EntryValues<V>,
    ) {
        let mut order: [u8; WINDOW] = std::array::from_fn(|line| line as u8);
        let order = &mut order[..others.starts.len() - 1];
        if arrangement == Arrangement::Groups {
            order.sort_by_key(|line| std::cmp::Reverse(others.of_line(*line).len()));
            self.order.extend(order.as_chunks().0);
        }
        for (lines, number) in order.chunks(LANES).zip(first / LANES..) {
            let left = lines.iter().map(|line| others.of_line(*line).len());
            // Overflow entries are those below the depth of the gathered slots.
            let overflow_cost = |depth: usize| {
                let deeper: usize = left.clone().map(|left| left.saturating_sub(depth)).sum();
                let any = if deeper > 0 { ANY_OVERFLOW_COST } else { 0 };
                depth * GATHERED_COST + any + deeper * OVERFLOW_COST
            };
            let depth = left.clone().min_by_key(|&depth| overflow_cost(depth)).unwrap_or(0);
            let depth = if arrangement == Arrangement::Rows { 0 } else { depth };
            let start = self.indices.len();
            // Lanes without an entry take the first place of the window or slice, and 0 of it.
            self.indices.resize(start + depth, HalfLine([first as u32; LANES]));
            stored.gathered.resize(start + depth, V::Slot::default());
            for (lane, line) in lines.iter().enumerate() {
                let entries = others.of_line(*line);
                let (gathered, deeper) = entries.split_at(depth.min(entries.len()));
                for (&(index, value), slot) in gathered.iter().zip(start..) {
                    self.indices[slot][lane] = index;
                    stored.gathered[slot][lane] = value;
                }
                self.overflow_indices.extend(deeper.iter().map(|entry| entry.0));
                stored.overflow.extend(deeper.iter().map(|entry| entry.1));
                if !deeper.is_empty() {
                    let end = self.overflow_indices.len() as u32;
                    self.overflow.push(Overflow { lane: lane as u32, end });
                }
            }
            self.slices[number].gathered = self.indices.len() as u32;
            self.slices[number].overflow = self.overflow.len() as u32;
        }
    }

    /// Chooses the diagonals that are worth a shifted slot, ascending.
    fn diagonals<V>(&self, entries: &[SlicedEntry<V>], keys: &mut Vec<usize>) -> Vec<usize> {
        let mut left = [0_usize; LANES];
        entries.iter().for_each(|entry| left[entry.lane] += 1);
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
        let (mut least, mut taken, mut after) = (cost(0, &left), 0, left);
        for (keys, count) in diagonals.iter().zip(1..) {
            keys.iter().for_each(|key| after[key % LANES] -= 1);
            if cost(count, &after) < least {
                (least, taken) = (cost(count, &after), count);
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
