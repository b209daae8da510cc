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
//! Invariants, which `build` establishes and products rely on without a check: ends of slices
//! ascend and lie within the slots; all indices are below `lines`, which is below 2^31; eight
//! values of x begin at each base. Both arrangements add the entries of a line in the same order
//! (those of shifted slots first, then the others, each by ascending index): results are the same
//! to the bit.

use super::values::{EntryValues, HalfLine, Value, Width};
use crate::simd::LANES;

/// Relative costs of a shifted and of a gathered slot.
pub(super) const SHIFTED_COST: usize = 2;
pub(super) const GATHERED_COST: usize = 5;
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
    pub fn new<'a, V: Value + 'a>(
        lines: usize,
        line: impl Fn(usize) -> (&'a [u32], &'a [V]),
    ) -> Self {
        let slices = Self::arranged(Arrangement::Slices, lines, &line);
        // Smaller matrices stay in the second cache as slices. Groups of such matrices were
        // measured on Zen 4 alone, where they gain as much.
        let is_large = slices.bytes::<V>() > FEWEST_BYTES_GROUPED;
        if is_large && cost_in_groups(lines, |number| line(number).0.len()) < slices.cost() {
            return Self::arranged(Arrangement::Groups, lines, line);
        }
        slices
    }

    /// Size of all slots and overflow entries.
    fn bytes<V: Value>(&self) -> usize {
        let entry = size_of::<u32>() + size_of::<V>();
        // A shifted slot has one index for its eight values.
        self.bases.len() * (size_of::<u32>() + LANES * size_of::<V>())
            + (self.indices.len() * LANES + self.overflow_indices.len()) * entry
    }

    /// Cost of a product in slices.
    fn cost(&self) -> usize {
        let mut start = 0;
        let overflow = self.slices.iter().filter(|slice| {
            // Ends ascend over all slices: one that is above the last has entries of its own.
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
        match &self.values {
            Width::Double(values) => values.log2(),
            Width::Single(values) => values.log2(),
        }
    }

    /// Number of lines.
    pub fn lines(&self) -> usize {
        self.lines
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
pub(super) fn gathered_depth(lengths: &(impl Iterator<Item = usize> + Clone)) -> (usize, usize) {
    let cost = |depth: usize| {
        let deeper: usize = lengths.clone().map(|length| length.saturating_sub(depth)).sum();
        let any = if deeper > 0 { ANY_OVERFLOW_COST } else { 0 };
        depth * GATHERED_COST + any + deeper * OVERFLOW_COST
    };
    // Costs are linear in the depth between two lengths: one of the lengths attains the minimum.
    let depths = lengths.clone().map(|depth| (depth, cost(depth)));
    depths.min_by_key(|depth| depth.1).unwrap_or((0, 0))
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
