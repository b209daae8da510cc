//! Sparse lines (rows of A, or its columns) cut into slices of eight, for
//! products with eight lines at a time (sliced ELLPACK, Monakov, Lokhmotov and
//! Avetisyan 2010).
//!
//! Lines stay in their order, so that results are written, and vectors beside
//! them read, without permutation. The entries of a slice fill slots of eight, one for
//! each line, of two kinds. A *gathered* slot has an index for each line. A
//! *shifted* slot has one index, that of its first line; the others follow it: on a
//! map whose places are numbered along the roads many entries (all those of staying)
//! lie on such diagonals, and a load costs a fifth of a gather. What few lines have more
//! of than the rest of their slice is kept apart, line by line.

mod walk;

use super::abreast::Abreast;
use super::lanes::LANES;
use super::value::{Half, Value, Width};

pub(super) use walk::Walk;

/// A shifted slot is worth while if it saves two fifths of a gathered one.
const SHIFTED_COST: usize = 2;
const GATHERED_COST: usize = 5;
/// To keep entries apart costs some gathered slots, and half of one for each.
const SOME_APART_COST: usize = 30;
const APART_COST: usize = 2;

/// Lines of a matrix of n lines and n columns, in slices of eight.
#[derive(Debug, Clone)]
pub(crate) struct Sliced {
    lines: usize,
    slices: Vec<Slice>,
    /// The index of the first line of each shifted slot.
    bases: Vec<u32>,
    indices: Vec<Half<u32>>,
    apart: Vec<Apart>,
    apart_indices: Vec<u32>,
    values: Width<Values<f64>, Values<f32>>,
}

/// Values of a matrix of this structure.
#[derive(Debug, Clone)]
pub(crate) struct Values<V: Value = f64> {
    shifted: Vec<V::Slot>,
    gathered: Vec<V::Slot>,
    apart: Vec<V>,
}

/// Where the slots of a slice end.
#[derive(Debug, Clone, Copy, Default)]
struct Slice {
    shifted: u32,
    gathered: u32,
    apart: u32,
}

/// What a lane has more of.
#[derive(Debug, Clone, Copy)]
struct Apart {
    lane: u32,
    end: u32,
}

impl Sliced {
    /// From lines whose indices ascend and are below `lines`. O(n + entries), and
    /// the entries of each slice are sorted.
    pub(crate) fn new<'a, V: Value + 'a>(
        lines: usize,
        line: impl Fn(usize) -> (&'a [u32], &'a [V]),
    ) -> Self {
        assert!(i32::try_from(lines).is_ok(), "gathers take indices with a sign");
        let mut sliced = Self {
            lines,
            slices: Vec::with_capacity(lines.div_ceil(LANES)),
            bases: Vec::new(),
            indices: Vec::new(),
            apart: Vec::new(),
            apart_indices: Vec::new(),
            values: Width::Double(Values::new()),
        };
        let mut stored = Values::new();
        let (mut entries, mut places) = (Vec::new(), Vec::new());
        for first in (0..lines).step_by(LANES) {
            entries.clear();
            for lane in 0..LANES.min(lines - first) {
                let (indices, values) = line(first + lane);
                // What goes through them relies on it.
                assert!(indices.iter().all(|j| (*j as usize) < lines), "an index is too large");
                // What lies on one diagonal has the same number.
                let of = |(&index, &value): (&u32, &V)| Entry {
                    diagonal: index as usize + (LANES - 1) - lane,
                    lane,
                    index,
                    value,
                };
                entries.extend(indices.iter().zip(values).map(of));
            }
            sliced.push(first, &entries, &mut places, &mut stored);
        }
        sliced.bases.shrink_to_fit();
        sliced.indices.shrink_to_fit();
        stored.shifted.shrink_to_fit();
        stored.gathered.shrink_to_fit();
        sliced.values = V::of_width(stored);
        sliced
    }

    /// Adds a slice, whose entries come lane by lane.
    fn push<V: Value>(
        &mut self,
        first: usize,
        entries: &[Entry<V>],
        places: &mut Vec<usize>,
        stored: &mut Values<V>,
    ) {
        // Diagonal and lane in one number: to sort entries would take most of the time.
        places.clear();
        places.extend(entries.iter().map(|entry| entry.diagonal * LANES + entry.lane));
        places.sort_unstable();
        let (diagonal, lane) = (|place: usize| place / LANES, |place: usize| place % LANES);
        // Its base is the index that lane 0 has, or would have.
        let base = |diagonal: usize| diagonal.checked_sub(LANES - 1);
        let inside = |diagonal| base(diagonal).is_some_and(|base| base + LANES <= self.lines);
        let mut diagonals: Vec<&[usize]> = places
            .chunk_by(|&a, &b| diagonal(a) == diagonal(b))
            .filter(|places| inside(diagonal(places[0])))
            .collect();
        // As many as lower the cost.
        fullest_first(&mut diagonals);
        let mut left = [0_usize; LANES];
        entries.iter().for_each(|entry| left[entry.lane] += 1);
        let cost = |shifted: usize, left: &[usize; LANES]| {
            let deepest = left.iter().copied().max().unwrap_or(0);
            shifted * SHIFTED_COST + deepest * GATHERED_COST
        };
        let (mut best, mut taken) = (cost(0, &left), 0);
        let mut after = left;
        for (count, places) in diagonals.iter().enumerate().take_while(|(_, d)| d.len() > 1) {
            places.iter().for_each(|&place| after[lane(place)] -= 1);
            if cost(count + 1, &after) < best {
                (best, taken, left) = (cost(count + 1, &after), count + 1, after);
            }
        }
        let mut shifted: Vec<usize> = diagonals[..taken].iter().map(|d| diagonal(d[0])).collect();
        shifted.sort_unstable();
        for base in shifted.iter().filter_map(|&diagonal| base(diagonal)) {
            self.bases.push(base as u32);
            stored.shifted.push(V::Slot::default());
        }
        // How deep the gathered slots are: what is deeper is kept apart.
        let apart_cost = |depth: usize| {
            let deeper: usize = left.iter().map(|left| left.saturating_sub(depth)).sum();
            let some = if deeper > 0 { SOME_APART_COST } else { 0 };
            depth * GATHERED_COST + some + deeper * APART_COST
        };
        let depth = left.iter().copied().min_by_key(|&depth| apart_cost(depth)).unwrap_or(0);
        let start = self.indices.len();
        // Lanes without an entry take some place of the slice, and 0 of it.
        self.indices.resize(start + depth, Half([first as u32; LANES]));
        stored.gathered.resize(start + depth, V::Slot::default());
        let shifted_start = self.bases.len() - shifted.len();
        for of_lane in entries.chunk_by(|a, b| a.lane == b.lane) {
            let (lane, mut rank) = (of_lane[0].lane, 0);
            for entry in of_lane {
                if let Ok(at) = shifted.binary_search(&entry.diagonal) {
                    stored.shifted[shifted_start + at][lane] = entry.value;
                    continue;
                }
                if rank < depth {
                    self.indices[start + rank][lane] = entry.index;
                    stored.gathered[start + rank][lane] = entry.value;
                } else {
                    self.apart_indices.push(entry.index);
                    stored.apart.push(entry.value);
                }
                rank += 1;
            }
            if rank > depth {
                let end = self.apart_indices.len() as u32;
                self.apart.push(Apart { lane: lane as u32, end });
            }
        }
        self.slices.push(Slice {
            shifted: self.bases.len() as u32,
            gathered: self.indices.len() as u32,
            apart: self.apart.len() as u32,
        });
    }

    /// The logarithms of all values, to base 2 as decoders add them; −∞ where
    /// there is no entry.
    pub(crate) fn log2(&self) -> Values {
        match &self.values {
            Width::Double(values) => values.log2(),
            Width::Single(values) => values.log2(),
        }
    }

    /// How many lines there are.
    pub(crate) fn lines(&self) -> usize {
        self.lines
    }
}

fn fullest_first(diagonals: &mut [&[usize]]) {
    diagonals.sort_by_key(|places| std::cmp::Reverse(places.len()));
}

impl<V: Value> Values<V> {
    /// None yet.
    fn new() -> Self {
        Self { shifted: Vec::new(), gathered: Vec::new(), apart: Vec::new() }
    }

    fn log2(&self) -> Values {
        let eight = |slot: &V::Slot| Abreast(slot.map(|p| super::log2(p.into())));
        Values {
            shifted: self.shifted.iter().map(eight).collect(),
            gathered: self.gathered.iter().map(eight).collect(),
            apart: self.apart.iter().map(|&p| super::log2(p.into())).collect(),
        }
    }
}

/// An entry of a slice.
struct Entry<V> {
    /// The index that lane 7 would have on it.
    diagonal: usize,
    lane: usize,
    index: u32,
    value: V,
}
