//! Builds [`Sliced`] matrices, and establishes the invariants that their products rely on.

use super::sliced::{
    Arrangement, GATHERED_COST, Overflow, SHIFTED_COST, Slice, Sliced, WINDOW, gathered_depth,
};
use super::values::{EntryValues, HalfLine, Value, Width};
use crate::simd::LANES;

/// Entries of a window's lines that are not in shifted slots, in the order of addition.
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
    /// Builds a matrix in this arrangement, from lines whose indices ascend.
    pub fn arranged<'a, V: Value + 'a>(
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
                    // Products don't check indices again: this assertion is what they rely on.
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

    /// Adds the shifted slots of a slice, given its entries lane by lane, and passes on the others.
    ///
    /// Groups have no shifted slots. They gather the entries on the same diagonals, before the
    /// others, so that sums are added up in the same order in either arrangement.
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
            // `diagonals` takes none below 7, whose first lanes would lie before x, nor one beyond
            // the last line: eight values of x begin at each base.
            self.bases.extend(shifted.iter().map(|diagonal| (diagonal - (LANES - 1)) as u32));
        }
        // Lanes without an entry on the diagonal keep a 0, which adds nothing.
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
            // The last slice has fewer lines: its lanes beyond are lines without entries.
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
            // A stable sort: lines of one length, the most, stay near their neighbours' values of x.
            order.sort_by_key(|line| std::cmp::Reverse(others.of_line(*line).len()));
            self.order.extend(order.as_chunks().0);
        }
        for (lines, number) in order.chunks(LANES).zip(first / LANES..) {
            let (depth, _) = gathered_depth(&lines.iter().map(|line| others.of_line(*line).len()));
            let start = self.indices.len();
            // Lanes without an entry have the index of the first line of the window or slice, which
            // is a valid one, and the value 0.
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
            // `push_shifted` has pushed all slices of the window: this one is among them.
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
        // Diagonals of one entry are left out: a slot for one lane saves a gathered slot only if
        // that lane alone is the longest.
        let mut diagonals: Vec<&[usize]> = keys
            .chunk_by(|a, b| a / LANES == b / LANES)
            .filter(|keys| keys.len() > 1 && inside(keys[0] / LANES))
            .collect();
        diagonals.sort_by_key(|keys| std::cmp::Reverse(keys.len()));
        // Gathered slots are as many as the entries of the longest lane that is left.
        let cost = |shifted: usize, left: &[usize; LANES]| {
            let deepest = left.iter().copied().max().unwrap_or(0);
            shifted * SHIFTED_COST + deepest * GATHERED_COST
        };
        // Fullest first, all prefixes are tried: the choice is greedy, not the best of all sets.
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
