//! Sparse lines (rows of A, or its columns) in slices of eight, for products with eight lines at
//! a time (sliced ELLPACK, Monakov, Lokhmotov and Avetisyan 2010): the products A x and A' x of
//! formulas 2, 3 and 7 of the guide.
//!
//! Lines keep their order, so that results are written, and vectors beside them read, without
//! permutation. The entries of a slice fill slots of eight, one for each line. A *gathered* slot
//! has an index for each line. A *shifted* slot has one index, that of its first line; the others
//! follow it: on a map whose places are numbered along the roads, many entries (all those of
//! staying) lie on such diagonals, and a load costs a fifth of a gather. A line with many more
//! entries than the rest of its slice has *overflow* entries, which are stored line by line.
//!
//! Lines of different lengths leave places in slots empty. *Groups*, the other
//! [arrangement](Arrangement), leave almost none: they are gathered slots of eight lines of one
//! length, out of a window of consecutive lines (SELL-C-σ, Kreutzer et al. 2014). The sums of a
//! window are put in the order of its lines before they are passed on. Groups read fewer bytes, but
//! gather every entry of a diagonal.
//!
//! Invariants, which [`Sliced::arranged`] establishes and products rely on without a check: ends of slices
//! ascend and lie within the slots; all indices are below `lines`, which is below 2^31; eight
//! values of x begin at each base. Both arrangements add the entries of a line in the same order
//! (those of shifted slots first, then the others, each by ascending index): results are the same
//! to the bit.

use std::ops::{Deref, DerefMut};

use crate::log2::log2;
use crate::simd::LANES;
use crate::vector::Packed;

/// Relative costs of a shifted and of a gathered slot.
const SHIFTED_COST: usize = 2;
const GATHERED_COST: usize = 5;
/// Cost of overflow entries in a slice, and of each entry.
const ANY_OVERFLOW_COST: usize = 30;
const OVERFLOW_COST: usize = 2;
/// Cost of putting the sums of a group in order.
const ORDERING_COST: usize = 5;

/// Smallest size of the slots of a matrix for which groups are considered, in bytes.
const FEWEST_BYTES_GROUPED: usize = 1 << 20;
/// Lines of a window: as many as one byte can number.
pub(super) const WINDOW: usize = 1 << u8::BITS;

/// Lines of a matrix of n lines and n columns, in slices of eight.
#[derive(Debug, Clone)]
pub struct Sliced {
    pub(super) lines: usize,
    pub(super) slices: Vec<Slice>,
    /// Lines of each group, numbered from the first of their window. Empty without groups.
    pub(super) order: Vec<[u8; LANES]>,
    /// Index of the first line of each shifted slot.
    pub(super) bases: Vec<u32>,
    pub(super) indices: Vec<HalfLine>,
    pub(super) overflow: Vec<Overflow>,
    pub(super) overflow_indices: Vec<u32>,
    pub(super) values: EntryValues,
}

/// Values of a matrix of this structure.
#[derive(Debug, Clone)]
pub struct EntryValues {
    pub(super) shifted: Vec<Packed>,
    pub(super) gathered: Vec<Packed>,
    pub(super) overflow: Vec<f64>,
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

/// Eight indices on half a cache line.
#[derive(Debug, Clone, Copy, Default)]
#[repr(align(32))]
pub(super) struct HalfLine(pub(super) [u32; LANES]);

/// Arrangement of entries.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arrangement {
    /// Slots of eight consecutive lines.
    Slices,
    /// Gathered slots of eight lines of a window.
    Groups,
}

impl Sliced {
    /// Builds slices from lines whose indices ascend and are below `lines`, or groups if their
    /// products cost less. O(n + entries), plus the sorting of the entries of each slice.
    ///
    /// The choice depends only on the matrix. Costs are those of Viterbi, which gains least from
    /// groups: of twelve matrices of 30,000 lines on Zen 4, those for which groups cost less took
    /// 0.74 to 0.95 of the time of slices for a product with AVX-512, and 0.75 to 0.97 for Viterbi;
    /// the others 0.96 to 1.15 and 1.03 to 1.17. On a road graph both are slower in groups, as on
    /// Sapphire Rapids. Portable code was slower line by line, without slots, for both (Zen 4: 73
    /// instead of 40 µs for a product with that graph, Sapphire Rapids: 242 instead of 75).
    pub fn new<'a>(lines: usize, line: impl Fn(usize) -> (&'a [u32], &'a [f64])) -> Self {
        let slices = Self::arranged(Arrangement::Slices, lines, &line);
        // Smaller matrices stay in the second cache as slices. Groups of such matrices were
        // measured on Zen 4 alone, where they gain as much.
        let is_large = slices.bytes() > FEWEST_BYTES_GROUPED;
        if is_large && cost_in_groups(lines, |number| line(number).0.len()) < slices.cost() {
            return Self::arranged(Arrangement::Groups, lines, line);
        }
        slices
    }

    /// Size of all slots and overflow entries.
    fn bytes(&self) -> usize {
        let entry = size_of::<u32>() + size_of::<f64>();
        // A shifted slot has one index for its eight values.
        self.bases.len() * (size_of::<u32>() + LANES * size_of::<f64>())
            + (self.indices.len() * LANES + self.overflow_indices.len()) * entry
    }

    /// Cost of a product in slices.
    fn cost(&self) -> usize {
        let mut start = 0;
        let overflow = self.slices.iter().filter(|slice| {
            // Ends never decrease from slice to slice: a slice with an end above the previous one
            // has entries of its own.
            let any = slice.overflow > start;
            start = slice.overflow;
            any
        });
        overflow.count() * ANY_OVERFLOW_COST
            + self.overflow_indices.len() * OVERFLOW_COST
            + self.bases.len() * SHIFTED_COST
            + self.indices.len() * GATHERED_COST
    }

    /// Returns the logarithms of all values, to base 2 as decoders add them; −∞ in places without
    /// an entry.
    pub fn log2(&self) -> EntryValues {
        self.values.log2()
    }

    /// Number of lines.
    pub fn lines(&self) -> usize {
        self.lines
    }
}

/// Entries of a window's lines that are not in shifted slots, in the order of addition.
struct Others {
    entries: Vec<(u32, f64)>,
    /// Starts of lines, and the end.
    starts: Vec<usize>,
}

impl Others {
    fn of_line(&self, line: u8) -> &[(u32, f64)] {
        &self.entries[self.starts[line as usize]..self.starts[line as usize + 1]]
    }
}

/// Entry of a slice.
struct SlicedEntry {
    /// Number of its diagonal: the index of lane 7 on it.
    diagonal: usize,
    lane: usize,
    index: u32,
    value: f64,
}

impl Sliced {
    /// Builds a matrix in this arrangement, from lines whose indices ascend.
    pub fn arranged<'a>(
        arrangement: Arrangement,
        lines: usize,
        line: impl Fn(usize) -> (&'a [u32], &'a [f64]),
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
            values: EntryValues::new(),
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
                    // Products don't check indices again: they rely on this assertion.
                    assert!(indices.iter().all(|j| (*j as usize) < lines), "an index is too large");
                    let entry = |(&index, &value): (&u32, &f64)| {
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
        sliced.values = stored;
        sliced
    }

    /// Adds the shifted slots of a slice, given its entries lane by lane, and passes on the others.
    ///
    /// Groups have no shifted slots. They gather the entries on the same diagonals, before the
    /// others, so that sums are added up in the same order in either arrangement.
    fn push_shifted(
        &mut self,
        arrangement: Arrangement,
        entries: &[SlicedEntry],
        keys: &mut Vec<usize>,
        stored: &mut EntryValues,
        others: &mut Others,
    ) {
        let shifted = self.diagonals(entries, keys);
        let (start, slots) = (self.bases.len(), arrangement == Arrangement::Slices);
        if slots {
            // `diagonals` takes none below 7, whose first lanes would lie before x, nor one beyond
            // the last line: eight values of x begin at each base.
            self.bases.extend(shifted.iter().map(|diagonal| (diagonal - (LANES - 1)) as u32));
        }
        // Lanes without an entry on the diagonal keep a 0, which adds nothing.
        stored.shifted.resize(self.bases.len(), Packed::default());
        let diagonal = |entry: &SlicedEntry| shifted.binary_search(&entry.diagonal);
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
            // The last slice has fewer lines: its lanes beyond are lines without entries.
            others.starts.push(others.entries.len());
        }
        self.slices.push(Slice { shifted: self.bases.len() as u32, ..Slice::default() });
    }

    /// Adds the gathered slots and the overflow of a window, or of the one slice that begins here.
    fn push_others(
        &mut self,
        arrangement: Arrangement,
        first: usize,
        others: &Others,
        stored: &mut EntryValues,
    ) {
        let mut order: [u8; WINDOW] = std::array::from_fn(|line| line as u8);
        let order = &mut order[..others.starts.len() - 1];
        if arrangement == Arrangement::Groups {
            // A stable sort: lines of the same length, which most have, stay near their neighbours'
            // values of x.
            order.sort_by_key(|line| std::cmp::Reverse(others.of_line(*line).len()));
            self.order.extend(order.as_chunks().0);
        }
        for (lines, number) in order.chunks(LANES).zip(first / LANES..) {
            let (depth, _) = gathered_depth(&lines.iter().map(|line| others.of_line(*line).len()));
            let start = self.indices.len();
            // Lanes without an entry have the index of the first line of the window or slice, which
            // is a valid one, and the value 0.
            self.indices.resize(start + depth, HalfLine([first as u32; LANES]));
            stored.gathered.resize(start + depth, Packed::default());
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
            // `push_shifted` has pushed all slices of the window: this one is among them.
            self.slices[number].gathered = self.indices.len() as u32;
            self.slices[number].overflow = self.overflow.len() as u32;
        }
    }

    /// Chooses the diagonals that are worth a shifted slot, ascending.
    fn diagonals(&self, entries: &[SlicedEntry], keys: &mut Vec<usize>) -> Vec<usize> {
        let mut left = [0_usize; LANES];
        entries.iter().for_each(|entry| left[entry.lane] += 1);
        // Diagonal and lane are packed in one number: sorting entries would take most of the time.
        keys.clear();
        keys.extend(entries.iter().map(|entry| entry.diagonal * LANES + entry.lane));
        keys.sort_unstable();
        let inside = |diagonal: usize| (LANES - 1..self.lines).contains(&diagonal);
        // Diagonals of one entry are left out: a slot for one lane saves a gathered slot only if
        // that lane alone is the longest.
        let mut diagonals: Vec<&[usize]> = keys
            .chunk_by(|a, b| a / LANES == b / LANES)
            .filter(|keys| keys.len() > 1 && inside(keys[0] / LANES))
            .collect();
        diagonals.sort_by_key(|keys| std::cmp::Reverse(keys.len()));
        // There are as many gathered slots as the longest lane has entries left.
        let cost = |shifted: usize, left: &[usize; LANES]| {
            let deepest = left.iter().copied().max().unwrap_or(0);
            shifted * SHIFTED_COST + deepest * GATHERED_COST
        };
        // Diagonals are taken fullest first, and all prefixes of that order are tried. The choice
        // is greedy, not the best of all sets.
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
}

/// Cost of a product in groups, by the lengths of lines. Building groups to count their slots
/// would double the time for a matrix, which learning makes anew in each iteration.
fn cost_in_groups(lines: usize, length: impl Fn(usize) -> usize) -> usize {
    let (mut lengths, mut cost) = (Vec::with_capacity(WINDOW), 0);
    for start in (0..lines).step_by(WINDOW) {
        lengths.clear();
        lengths.extend((start..lines.min(start + WINDOW)).map(&length));
        lengths.sort_unstable();
        // Groups are built from the longest line down, so count them that way: only the last, with
        // the shortest lines, may have fewer than eight.
        for group in lengths.rchunks(LANES) {
            cost += gathered_depth(&group.iter().copied()).1 + ORDERING_COST;
        }
    }
    cost
}

/// Returns the cheapest number of gathered slots for eight lines with these numbers of entries, and
/// its cost. Entries beyond the slots are overflow entries.
fn gathered_depth(lengths: &(impl Iterator<Item = usize> + Clone)) -> (usize, usize) {
    let cost = |depth: usize| {
        let deeper: usize = lengths.clone().map(|length| length.saturating_sub(depth)).sum();
        let any = if deeper > 0 { ANY_OVERFLOW_COST } else { 0 };
        depth * GATHERED_COST + any + deeper * OVERFLOW_COST
    };
    // Between two lengths, costs are linear in the depth, so one of the lengths attains the
    // minimum.
    let depths = lengths.clone().map(|depth| (depth, cost(depth)));
    depths.min_by_key(|depth| depth.1).unwrap_or((0, 0))
}

impl EntryValues {
    fn new() -> Self {
        Self { shifted: Vec::new(), gathered: Vec::new(), overflow: Vec::new() }
    }

    /// Logarithms of all values; −∞ in places without an entry.
    fn log2(&self) -> Self {
        // Empty places of slots are 0, and their logarithms −∞: no maximum takes them.
        let eight = |slot: &Packed| Packed(slot.map(log2));
        Self {
            shifted: self.shifted.iter().map(eight).collect(),
            gathered: self.gathered.iter().map(eight).collect(),
            overflow: self.overflow.iter().map(|&p| log2(p)).collect(),
        }
    }
}

impl Deref for HalfLine {
    type Target = [u32; LANES];

    #[inline(always)]
    fn deref(&self) -> &[u32; LANES] {
        &self.0
    }
}

impl DerefMut for HalfLine {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [u32; LANES] {
        &mut self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lines with no entries, with a few, and occasionally with very many.
    #[test]
    fn groups_cost_what_their_lengths_say() {
        for lines in [1, 7, 8, 250, 263, 600] {
            let length = |i: usize| if i.is_multiple_of(97) { 40 } else { i * 7919 % 13 };
            let entries = |i: usize| -> Vec<u32> {
                let first = (i * 31 + 5) % lines;
                let mut line: Vec<u32> =
                    (0..length(i)).map(|k| ((first + 3 * k) % lines) as u32).collect();
                line.sort_unstable();
                line.dedup();
                line
            };
            let all: Vec<(Vec<u32>, Vec<f64>)> =
                (0..lines).map(entries).map(|line| (line.clone(), vec![0.5; line.len()])).collect();
            let line = |i: usize| (&all[i].0[..], &all[i].1[..]);
            let groups = Sliced::arranged(Arrangement::Groups, lines, line);
            let cost = groups.cost() + groups.order.len() * ORDERING_COST;
            assert_eq!(cost_in_groups(lines, |i| all[i].0.len()), cost);
        }
    }

    /// A matrix of few diagonals, with lines of different lengths.
    #[test]
    fn the_matrix_decides() {
        let lines = 20_000;
        let scattered: Vec<Vec<u32>> = (0..lines)
            .map(|i: usize| {
                let places = (0..=i * 7919 % 12).map(|k| ((i * 31 + k * k) % lines) as u32);
                places.collect::<std::collections::BTreeSet<u32>>().into_iter().collect()
            })
            .collect();
        let values = [0.5; 12];
        let large = Sliced::new(lines, |i| (&scattered[i][..], &values[..scattered[i].len()]));
        assert!(!large.order.is_empty());
        let near: Vec<Vec<u32>> =
            (0..lines as u32).map(|i| (i..(i + 5).min(20_000)).collect()).collect();
        let diagonal = Sliced::new(lines, |i| (&near[i][..], &values[..near[i].len()]));
        assert!(diagonal.order.is_empty());
    }
}
