//! Descriptors of the reference images, and their distances to a query. Distances are sums of
//! squared differences, so none is negative and a copy of a reference has 0. One loop computes them
//! all: every reference has a sum of its own and a fixed order of terms, so results are the same to
//! the bit on all machines.

use super::error::ViewError;
use wayfix_kernels::{Simd, WithSimd, run};

/// Distance of two descriptors; smaller is more alike.
///
/// Both come from the differences of the elements, not from products, so similar descriptors lose
/// no digits to cancellation: no distance is ever negative, and a copy of a reference has distance
/// 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Distance {
    /// 1 − cos of the angle between them, from 0 (the same direction) to 2
    /// (opposite), as ½ |x / |x| − r / |r||².
    ///
    /// Its error is below 2^-23 √(2c) + (36 + d/32) 2^-24 c + 2^-46 for a true value c and
    /// dimension d: 2.6e-6 for c = 1 and d = 128. Rounding may take it slightly above 2.
    Cosine,
    /// |x − r|, in the unit of the elements.
    ///
    /// Its relative error is below (20 + d/64) 2^-24: 1.3e-6 for d = 128 and
    /// 1.7e-6 for d = 512. Squares that overflow or underflow 32 bits are
    /// summed again in doubles, which takes some eight times as long.
    Euclidean,
}

/// Descriptors of N reference images, each of d numbers of 32 bits, to be matched with those of
/// queries.
///
/// Descriptors may come from anywhere: a network, or the pixels of a small image.
///
/// ```
/// use wayfix_recognition::observation::{Distance, ReferenceDescriptors};
///
/// // Three places, with descriptors of two elements.
/// let rows = [[1.0, 0.0], [0.0, 2.0], [-3.0, 0.0]];
/// let references = ReferenceDescriptors::from_rows(&rows, Distance::Cosine)?;
/// assert_eq!(references.distances(&[0.5, 0.0])?, [0.0, 1.0, 2.0]);
/// # Ok::<(), wayfix_recognition::observation::ViewError>(())
/// ```
///
/// # Cost
///
/// A distance takes 3 d operations. Memory is that of the N d numbers, with N rounded up to a
/// multiple of 32. One query reads all of it: 51.2 MB at N = 100,000 and d = 128, in 2 ms on a core
/// of 2023, at the bandwidth of its memory (25 GB/s). Of many queries at once, 16 share each
/// reading.
///
/// The loop uses the widest registers of the machine. Distances are the same to the bit on every
/// machine, one query at a time or many.
#[derive(Debug, Clone, PartialEq)]
pub struct ReferenceDescriptors {
    dimension: usize,
    count: usize,
    distance: Distance,
    /// Element k of references 32 g to 32 g + 31 at `groups[g * dimension + k]`,
    /// scaled to length 1 for the cosine. The last group is padded with zeros.
    groups: Vec<[f32; GROUP]>,
}

/// Number of queries compared in one pass over the references.
const BLOCK: usize = 16;

/// Number of references stored side by side. Each has a sum of its own, so the compiler can use
/// registers of any width, with the same result to the bit.
pub(super) const GROUP: usize = 32;

/// Number of terms of a partial sum: the error grows with PART + d / PART, not with d.
const PART: usize = 32;

impl ReferenceDescriptors {
    /// Stores N d values, given reference after reference. O(N d) time, and twice the memory
    /// meanwhile.
    ///
    /// # Errors
    ///
    /// [`ViewError`] if the dimension is 0, if the number of values is 0 or not a multiple of it,
    /// if an element is NaN or infinite, if a reference is 0 in every element and the distance is
    /// [`Distance::Cosine`], and if there are two or more references and all are equal (with the
    /// cosine: have one direction, to 32 bits).
    pub fn new(
        dimension: usize,
        mut values: Vec<f32>,
        distance: Distance,
    ) -> Result<Self, ViewError> {
        if dimension == 0 {
            return Err(ViewError::NoDimension);
        }
        if values.is_empty() {
            return Err(ViewError::NoReferences);
        }
        let count = descriptor_count(&values, dimension)?;
        for (index, row) in values.chunks_exact_mut(dimension).enumerate() {
            let scale = scale(distance, row, "reference", index)?;
            row.iter_mut().for_each(|x| *x = scaled(*x, scale));
        }
        // Compared after scaling: for the cosine, multiples of one direction are equal.
        let first = &values[..dimension];
        if count > 1 && values.chunks_exact(dimension).all(|row| row == first) {
            return Err(ViewError::AllEqual { references: count });
        }
        // Transposed within groups: element k of 32 references side by side, which the loop
        // compares with one element of the query.
        let mut groups = vec![[0.0; GROUP]; count.div_ceil(GROUP) * dimension];
        for (reference, row) in values.chunks_exact(dimension).enumerate() {
            let group = &mut groups[reference / GROUP * dimension..];
            group.iter_mut().zip(row).for_each(|(group, &x)| group[reference % GROUP] = x);
        }
        Ok(Self { dimension, count, distance, groups })
    }

    /// Stores a descriptor for each reference. O(N d).
    ///
    /// # Errors
    ///
    /// As [`new`](Self::new), and if a row differs in length from the first.
    pub fn from_rows<R: AsRef<[f32]>>(rows: &[R], distance: Distance) -> Result<Self, ViewError> {
        let expected = rows.first().ok_or(ViewError::NoReferences)?.as_ref().len();
        if expected == 0 {
            return Err(ViewError::NoDimension);
        }
        let mut values = Vec::with_capacity(rows.len() * expected);
        for (index, row) in rows.iter().map(AsRef::as_ref).enumerate() {
            if row.len() != expected {
                let (which, length) = ("reference", row.len());
                return Err(ViewError::Length { which, index, length, expected });
            }
            values.extend_from_slice(row);
        }
        Self::new(expected, values, distance)
    }

    /// Number of references, N.
    #[must_use]
    pub fn count(&self) -> usize {
        self.count
    }

    /// Returns the descriptor of a reference as stored, scaled to length 1 for the cosine; `None`
    /// if the reference does not exist. O(d).
    #[must_use]
    pub fn descriptor(&self, reference: usize) -> Option<Vec<f32>> {
        let start = reference / GROUP * self.dimension;
        let group = self.groups.get(start..start + self.dimension)?;
        let values = group.iter().map(|group| group[reference % GROUP]);
        (reference < self.count).then(|| values.collect())
    }

    /// Number of elements of a descriptor, d.
    #[must_use]
    pub fn dimension(&self) -> usize {
        self.dimension
    }

    /// Distance that is computed.
    #[must_use]
    pub fn distance(&self) -> Distance {
        self.distance
    }

    /// Computes the distances of one query to all references, in their order. O(N d).
    ///
    /// # Errors
    ///
    /// [`ViewError`] if the query does not have d elements, if one is NaN or
    /// infinite, if all are 0 and the distance is [`Distance::Cosine`], and if
    /// a distance is too large for 32 bits.
    pub fn distances(&self, query: &[f32]) -> Result<Vec<f32>, ViewError> {
        let mut out = vec![0.0; self.count];
        self.distances_into(query, &mut out)?;
        Ok(out)
    }

    /// Computes [`distances`](Self::distances) into a slice of N numbers. Allocates nothing.
    ///
    /// # Errors
    ///
    /// As [`distances`](Self::distances), and if `out` does not have N elements. The contents of
    /// `out` are then unspecified.
    pub fn distances_into(&self, query: &[f32], out: &mut [f32]) -> Result<(), ViewError> {
        if query.len() != self.dimension {
            let (length, expected) = (query.len(), self.dimension);
            return Err(ViewError::Length { which: "query", index: 0, length, expected });
        }
        self.distances_all_into(query, out)
    }

    /// Computes the distances of Q queries, given one after the other in Q d numbers,
    /// into Q N numbers, query after query. Allocates nothing. O(Q N d).
    ///
    /// # Errors
    ///
    /// As [`distances_into`](Self::distances_into), for each query, and if the
    /// last query is incomplete.
    pub fn distances_all_into(&self, queries: &[f32], out: &mut [f32]) -> Result<(), ViewError> {
        let expected = descriptor_count(queries, self.dimension)?.saturating_mul(self.count);
        if out.len() != expected {
            return Err(ViewError::Room { found: out.len(), expected });
        }
        let blocks = queries.chunks(BLOCK * self.dimension).zip(out.chunks_mut(BLOCK * self.count));
        for (first, (queries, out)) in (0..).step_by(BLOCK).zip(blocks) {
            self.block(first, queries, out)?;
        }
        Ok(())
    }

    /// Calls a visitor with the index and the N distances of each of Q queries, in order: as fast
    /// as [`distances_all_into`](Self::distances_all_into), in memory for 16 N distances.
    ///
    /// ```
    /// use wayfix_recognition::observation::{Distance, ReferenceDescriptors};
    ///
    /// let rows = [[1.0, 0.0], [4.0, 4.0]];
    /// let references = ReferenceDescriptors::from_rows(&rows, Distance::Euclidean)?;
    /// let mut nearest = vec![];
    /// references.distances_each(&[1.0, 4.0, 1.0, 3.0], |_, distances| {
    ///     nearest.push(if distances[0] <= distances[1] { 0 } else { 1 });
    /// })?;
    /// assert_eq!(nearest, [1, 0]);
    /// # Ok::<(), wayfix_recognition::observation::ViewError>(())
    /// ```
    ///
    /// # Errors
    ///
    /// As [`distances_all_into`](Self::distances_all_into). Some of the queries before the invalid
    /// one may have been visited.
    pub fn distances_each(
        &self,
        queries: &[f32],
        mut visit: impl FnMut(usize, &[f32]),
    ) -> Result<(), ViewError> {
        let together = descriptor_count(queries, self.dimension)?.min(BLOCK);
        let mut out = vec![0.0; together * self.count];
        for (first, queries) in (0..).step_by(BLOCK).zip(queries.chunks(BLOCK * self.dimension)) {
            let out = &mut out[..queries.len() / self.dimension * self.count];
            self.block(first, queries, out)?;
            (first..).zip(out.chunks_exact(self.count)).for_each(|(query, out)| visit(query, out));
        }
        Ok(())
    }

    /// Computes the distances of at most [`BLOCK`] queries; the first has the index `first`.
    fn block(&self, first: usize, queries: &[f32], out: &mut [f32]) -> Result<(), ViewError> {
        // Scaling checks the queries, so all errors but that of a distance come before the loop.
        let mut scales = [1.0; BLOCK];
        let each = queries.chunks_exact(self.dimension);
        for ((query, x), out) in (first..).zip(each).zip(&mut scales) {
            *out = scale(self.distance, x, "query", query)?;
        }
        run(Pass { references: self, first, queries, scales: &scales, out })
    }
}

/// Number of descriptors in these values.
fn descriptor_count(values: &[f32], dimension: usize) -> Result<usize, ViewError> {
    if !values.len().is_multiple_of(dimension) {
        return Err(ViewError::Values { values: values.len(), dimension });
    }
    Ok(values.len() / dimension)
}

/// Checks a query that may become a reference, as [`ReferenceDescriptors::new`] checks references.
pub(crate) fn check_descriptor(query: &[f32], distance: Distance) -> Result<(), ViewError> {
    if query.is_empty() {
        return Err(ViewError::NoDimension);
    }
    scale(distance, query, "query", 0).map(drop)
}

/// Scale factor of a descriptor: 1 / |x| for the cosine, else 1. Errors name it as `which` number
/// `index`.
fn scale(
    distance: Distance,
    x: &[f32],
    which: &'static str,
    index: usize,
) -> Result<f64, ViewError> {
    if let Some(element) = x.iter().position(|x| !x.is_finite()) {
        return Err(ViewError::Element { which, index, element, value: x[element] });
    }
    match distance {
        Distance::Euclidean => Ok(1.0),
        Distance::Cosine => {
            // In doubles, squares of 32-bit numbers neither overflow nor underflow.
            let squares: f64 = x.iter().map(|&x| f64::from(x) * f64::from(x)).sum();
            if squares == 0.0 {
                return Err(ViewError::Zero { which, index });
            }
            Ok(1.0 / squares.sqrt())
        }
    }
}

/// Scales an element. References and queries are scaled alike, so that a copy has distance 0.
#[inline]
fn scaled(x: f32, scale: f64) -> f32 {
    (f64::from(x) * scale) as f32
}

/// A block of queries against all references, which are read once.
struct Pass<'a> {
    references: &'a ReferenceDescriptors,
    /// Index of the first query, for errors.
    first: usize,
    queries: &'a [f32],
    /// Scale factor of each query.
    scales: &'a [f64],
    /// A row of distances for each query.
    out: &'a mut [f32],
}

impl WithSimd for Pass<'_> {
    type Output = Result<(), ViewError>;

    // The compiler vectorises the loop anew for each width: the same operations in the same order.
    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> Result<(), ViewError> {
        let &ReferenceDescriptors { dimension, count, distance, ref groups } = self.references;
        // Terms that underflow lose up to `MIN_POSITIVE` each; from this sum upwards, that is less
        // than what rounding loses.
        let least = dimension as f32 * f32::MIN_POSITIVE;
        for (start, rows) in (0..count).step_by(GROUP).zip(groups.chunks_exact(dimension)) {
            let members = GROUP.min(count - start);
            let queries = self.queries.chunks_exact(dimension).zip(self.scales);
            let outs = self.out.chunks_exact_mut(count);
            for (query, ((x, &scale), out)) in (self.first..).zip(queries.zip(outs)) {
                let squares = squares(x, scale, rows);
                let mut distances = match distance {
                    Distance::Cosine => squares.map(|square| 0.5 * square),
                    Distance::Euclidean => squares.map(f32::sqrt),
                };
                // Padding and infinities are also out of range; a fold without an early exit
                // vectorises.
                let in_range = |square: f32| (least..=f32::MAX).contains(&square);
                if distance == Distance::Euclidean
                    && !squares.iter().fold(true, |all, &square| all & in_range(square))
                {
                    for member in (0..members).filter(|&member| !in_range(squares[member])) {
                        distances[member] = in_doubles(x, rows, member).map_err(|distance| {
                            let reference = start + member;
                            ViewError::TooFar { query, reference, distance }
                        })?;
                    }
                }
                out[start..start + members].copy_from_slice(&distances[..members]);
            }
        }
        Ok(())
    }
}

/// |x − r|² for each reference of a group.
#[inline(always)]
fn squares(x: &[f32], scale: f64, rows: &[[f32; GROUP]]) -> [f32; GROUP] {
    let mut total = [0.0; GROUP];
    // Pairwise in two levels: short partial sums of PART terms, then the sum of these.
    for (x, rows) in x.chunks(PART).zip(rows.chunks(PART)) {
        let mut part = [0.0; PART];
        part.iter_mut().zip(x).for_each(|(part, &x)| *part = scaled(x, scale));
        let mut sum = [0.0; GROUP];
        for (x, row) in part.iter().zip(rows) {
            for l in 0..GROUP {
                let difference = row[l] - x;
                sum[l] += difference * difference;
            }
        }
        for l in 0..GROUP {
            total[l] += sum[l];
        }
    }
    total
}

/// x − r| in doubles, where its square is too large or too small for 32 bits. The error is the
/// distance itself, if that is too large.
#[cold]
#[inline(never)]
fn in_doubles(x: &[f32], rows: &[[f32; GROUP]], member: usize) -> Result<f32, f64> {
    let differences = x.iter().zip(rows).map(|(&x, row)| f64::from(row[member]) - f64::from(x));
    let distance = differences.fold(0.0, |sum, difference| sum + difference * difference).sqrt();
    let rounded = distance as f32;
    if rounded.is_finite() { Ok(rounded) } else { Err(distance) }
}
