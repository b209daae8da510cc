//! Rows (or columns) of a sparse matrix, stored grouped by their number of
//! entries, so that the inner loop of a product has a constant length.

use std::ops::Range;

use super::best_of;

/// Sparse lines: rows of A, or its columns.
///
/// Lines are stored in order of their length, those of one length in
/// ascending order; within a line, indices ascend. Line i occupies
/// `indices[start..start + length]` with `(start, length) = spans[i]`.
#[derive(Debug, Clone)]
pub(super) struct Compressed {
    spans: Vec<(u32, u32)>,
    groups: Vec<Group>,
    order: Vec<u32>,
    indices: Vec<u32>,
    values: Vec<f64>,
}

/// The lines of one length: where they stand in `order`, and their entries.
#[derive(Debug, Clone)]
struct Group {
    length: usize,
    lines: Range<usize>,
    entries: Range<usize>,
}

impl Compressed {
    /// From entries (line, index, value) in any order, without duplicates, of
    /// which there are fewer than 2^32. O(n + entries).
    pub(super) fn new(
        lines: usize,
        entries: impl Iterator<Item = (u32, u32, f64)> + Clone,
    ) -> Self {
        let mut lengths = vec![0_u32; lines];
        for (line, ..) in entries.clone() {
            lengths[line as usize] += 1;
        }
        let mut order: Vec<u32> = (0..lines as u32).collect();
        order.sort_by_key(|&line| lengths[line as usize]); // stable
        let mut spans = vec![(0, 0); lines];
        let mut groups: Vec<Group> = Vec::new();
        let mut end = 0;
        for (position, &line) in order.iter().enumerate() {
            let length = lengths[line as usize];
            spans[line as usize] = (end, length);
            let start = end as usize;
            end += length;
            match groups.last_mut() {
                Some(group) if group.length == length as usize => {
                    group.lines.end = position + 1;
                    group.entries.end = end as usize;
                }
                _ => groups.push(Group {
                    length: length as usize,
                    lines: position..position + 1,
                    entries: start..end as usize,
                }),
            }
        }
        let mut indices = vec![0; end as usize];
        let mut values = vec![0.0; end as usize];
        let mut next: Vec<u32> = spans.iter().map(|span| span.0).collect();
        for (line, index, value) in entries {
            let at = &mut next[line as usize];
            indices[*at as usize] = index;
            values[*at as usize] = value;
            *at += 1;
        }
        let mut lines = Self { spans, groups, order, indices, values };
        lines.sort_each_line();
        lines
    }

    /// The lines of the transpose.
    pub(super) fn transposed(&self) -> Self {
        let lines = 0..self.spans.len() as u32;
        let entries = lines.flat_map(|line| {
            let (indices, values) = self.slices(line as usize);
            indices.iter().zip(values).map(move |(&index, &value)| (index, line, value))
        });
        Self::new(self.spans.len(), entries)
    }

    fn sort_each_line(&mut self) {
        let mut line = Vec::new();
        for &(start, length) in &self.spans {
            let range = start as usize..(start + length) as usize;
            let (indices, values) = (&mut self.indices[range.clone()], &mut self.values[range]);
            if indices.is_sorted() {
                continue;
            }
            line.clear();
            line.extend(indices.iter().copied().zip(values.iter().copied()));
            line.sort_unstable_by_key(|entry| entry.0);
            for (i, &(index, value)) in line.iter().enumerate() {
                (indices[i], values[i]) = (index, value);
            }
        }
    }

    /// How many lines there are.
    pub(super) fn lines(&self) -> usize {
        self.spans.len()
    }

    /// How many entries there are.
    pub(super) fn entries(&self) -> usize {
        self.indices.len()
    }

    /// The values in storage order.
    pub(super) fn values(&self) -> &[f64] {
        &self.values
    }

    /// Indices and values of a line.
    #[inline]
    pub(super) fn slices(&self, line: usize) -> (&[u32], &[f64]) {
        let (start, length) = self.spans[line];
        let range = start as usize..(start + length) as usize;
        (&self.indices[range.clone()], &self.values[range])
    }

    /// The entries of a line, in ascending order of their index.
    pub(super) fn line(&self, line: usize) -> impl Iterator<Item = (usize, f64)> + Clone {
        let (indices, values) = self.slices(line);
        indices.iter().map(|&index| index as usize).zip(values.iter().copied())
    }

    /// `out[line]` = Σ value · x\[index\] over each line.
    pub(super) fn multiply(&self, x: &[f64], out: &mut [f64]) {
        assert_eq!(x.len(), self.spans.len(), "x must have one value per state");
        assert_eq!(out.len(), self.spans.len(), "out must have one value per state");
        for group in &self.groups {
            let order = &self.order[group.lines.clone()];
            let indices = &self.indices[group.entries.clone()];
            let values = &self.values[group.entries.clone()];
            match group.length {
                0 => order.iter().for_each(|&line| out[line as usize] = 0.0),
                1 => multiply_group::<1>(order, indices, values, x, out),
                2 => multiply_group::<2>(order, indices, values, x, out),
                3 => multiply_group::<3>(order, indices, values, x, out),
                4 => multiply_group::<4>(order, indices, values, x, out),
                5 => multiply_group::<5>(order, indices, values, x, out),
                6 => multiply_group::<6>(order, indices, values, x, out),
                7 => multiply_group::<7>(order, indices, values, x, out),
                8 => multiply_group::<8>(order, indices, values, x, out),
                length => {
                    let lines = indices.chunks_exact(length).zip(values.chunks_exact(length));
                    for (&line, (indices, values)) in order.iter().zip(lines) {
                        let terms = indices.iter().zip(values).map(|(&i, v)| v * x[i as usize]);
                        out[line as usize] = terms.sum();
                    }
                }
            }
        }
    }

    /// [`TransitionEntries::max_product`](super::TransitionEntries::max_product)
    /// with the logarithms of the values, in storage order.
    pub(super) fn max_product(&self, log2: &[f64], x: &[f64], out: &mut [f64], from: &mut [u32]) {
        for group in &self.groups {
            let order = &self.order[group.lines.clone()];
            let indices = &self.indices[group.entries.clone()];
            let log2 = &log2[group.entries.clone()];
            let mut put = |line: u32, best: (f64, u32)| {
                (out[line as usize], from[line as usize]) = best;
            };
            match group.length {
                0 => order.iter().for_each(|&line| put(line, (f64::NEG_INFINITY, 0))),
                1 => max_group::<1>(order, indices, log2, x, put),
                2 => max_group::<2>(order, indices, log2, x, put),
                3 => max_group::<3>(order, indices, log2, x, put),
                4 => max_group::<4>(order, indices, log2, x, put),
                5 => max_group::<5>(order, indices, log2, x, put),
                6 => max_group::<6>(order, indices, log2, x, put),
                7 => max_group::<7>(order, indices, log2, x, put),
                8 => max_group::<8>(order, indices, log2, x, put),
                length => {
                    let lines = indices.chunks_exact(length).zip(log2.chunks_exact(length));
                    for (&line, (indices, log2)) in order.iter().zip(lines) {
                        let entries = indices.iter().copied().zip(log2.iter().copied());
                        put(line, best_of(entries, x));
                    }
                }
            }
        }
    }
}

#[inline]
fn multiply_group<const L: usize>(
    order: &[u32],
    indices: &[u32],
    values: &[f64],
    x: &[f64],
    out: &mut [f64],
) {
    let lines = indices.as_chunks::<L>().0.iter().zip(values.as_chunks::<L>().0);
    for (&line, (indices, values)) in order.iter().zip(lines) {
        let mut sum = 0.0;
        for l in 0..L {
            sum += values[l] * x[indices[l] as usize];
        }
        out[line as usize] = sum;
    }
}

#[inline]
fn max_group<const L: usize>(
    order: &[u32],
    indices: &[u32],
    log2: &[f64],
    x: &[f64],
    mut put: impl FnMut(u32, (f64, u32)),
) {
    let lines = indices.as_chunks::<L>().0.iter().zip(log2.as_chunks::<L>().0);
    for (&line, (indices, log2)) in order.iter().zip(lines) {
        put(line, best_of(indices.iter().copied().zip(log2.iter().copied()), x));
    }
}
