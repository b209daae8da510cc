//! 32-bit values, in columns that still sum to exactly one.
//!
//! Rounding each value by itself would leave sums off by 6e-8. So the values p_1 ≥ p_2 ≥ …
//! of a column are rounded one after another, each as its share of the remainder:
//! with r = 1 − (v_1 + … + v_{i-1}) and s = p_i + p_{i+1} + …, v_i is the 32-bit number
//! nearest to t_i = p_i r / s, and the last one is r itself.
//!
//! **The sum is exactly 1.** Let t_i be in \[b/2, b) for a power of two b: v_i is a
//! multiple of g = 2^-24 b, and so is r, if it was a multiple of the earlier steps. Rounding
//! errors are passed on to all later values, so that t_{i+1} ≤ t_i where v_i is
//! rounded up; where it is rounded down, v_i ≤ b − g and t_{i+1} ≤ t_i + g/2 ≤ v_i + g ≤ b.
//! So steps g never grow, and the last r is a multiple of its step, at most 2^24 times it:
//! a 32-bit number. If v_i would leave a remainder of 0, the next lower number is
//! taken, which leaves one step.
//!
//! **No value changes by as much as 1e-7.** With δ_i = v_i − t_i, v_i − p_i = δ_i −
//! p_i Σ δ_j / s_{j+1} over j < i, since each δ_j is shared in proportion. The ratio p_i / s_{j+1}
//! is at most 1, and |δ_j| at most 2^-24 t_j, so that |v_i − p_i| ≤ 2^-24 (t_1 + … + t_i),
//! where the sum in brackets is at most 1. If v_i is the next lower number, |δ_i| may be twice
//! that: then t_i is the whole remainder, at most 1/2 unless it is the first, and |v_i − p_i| is at
//! most 1.5 · 2^-24 = 9e-8; later values sum to one step, and were less. The rest up to 1e-7 is for
//! columns whose own sum is off by up to 1e-9, and for values below 2^-60, which count as 2^-60.

use super::SparseTransition;
use super::compressed::Compressed;
use crate::error::TransitionError;
use wayfix_kernels::limits::power;

/// 2^-60, the least value. Shares of the remainder are then far above the smallest 32-bit number:
/// they fall below their values only if the remainder is a few steps, by less than half each
/// time, and at most three times before 2^-60.
const LEAST: f64 = power(-60);

/// 32-bit values.
impl SparseTransition {
    /// Converts to 32-bit values, for maps of millions of places: two thirds of the memory (29
    /// bytes an entry instead of 46, on a map of ten million places with five entries each), and
    /// two thirds of the bytes that a product moves. O(n + E log of the entries of a column). A
    /// 32-bit matrix is returned unchanged.
    ///
    /// Values are rounded, each by less than 1e-7, so that **columns still sum to exactly one**;
    /// none becomes 0. All routines take them as doubles, and give, to the bit, the results of a
    /// 64-bit matrix with these values; everything that the docs say about exactness holds for that
    /// matrix. [`rounding`](Self::rounding) tells how far it is from the original.
    ///
    /// Differences: entries that were equal may now differ in the last bit (of three entries of
    /// 1/3, one becomes smaller), so that paths which tied may no longer tie. The logarithms that
    /// the first Viterbi computes are 64-bit. The verbs in `_all` and `learn` take sequences one by
    /// one, not eight at a time, and learned values are 64-bit. From storage (feature `serde`), a
    /// 64-bit matrix with the rounded values is read; if none is below 1e-18, this method then
    /// returns the same matrix again, with a `rounding` of 0.
    ///
    /// ```
    /// use wayfix::SparseTransition;
    ///
    /// let ways = [(0, 0, 0.7), (1, 0, 0.2), (2, 0, 0.1), (0, 1, 1.0), (0, 2, 1.0)];
    /// let a = SparseTransition::from_triplets(3, ways)?.with_single_values();
    /// assert_eq!(a.get(0, 0), f64::from(0.7_f32));
    /// assert_eq!(a.get(0, 0) + a.get(1, 0) + a.get(2, 0), 1.0);
    /// // After 1000 steps, relative errors of probabilities are below two ten-thousandths.
    /// let e = a.rounding();
    /// assert!(((1.0 + e) / (1.0 - e)).powi(1000) < 1.0002);
    /// # Ok::<(), wayfix::TransitionError>(())
    /// ```
    #[must_use]
    pub fn with_single_values(self) -> Self {
        if self.rows.is_single() {
            return self;
        }
        let Self { rows, columns, .. } = self;
        Self::rounded(rows, columns)
    }

    /// Builds a matrix as [`from_triplets`](Self::from_triplets) followed by
    /// [`with_single_values`](Self::with_single_values) would, without the 64-bit matrix in
    /// between: in less time, and with less memory on the way.
    ///
    /// # Errors
    ///
    /// [`TransitionError`] as [`from_triplets`](Self::from_triplets).
    pub fn from_triplets_single(
        states: usize,
        triplets: impl IntoIterator<Item = (usize, usize, f64)>,
    ) -> Result<Self, TransitionError> {
        let (rows, columns) = Self::compressed(states, triplets)?;
        Ok(Self::rounded(rows, columns))
    }

    fn rounded(rows: Compressed, columns: Compressed) -> Self {
        let (rows, columns, rounding) = round(rows, columns);
        Self::from_compressed(rows, columns, rounding)
    }

    /// The largest relative change e = |v / p − 1| of an entry p that
    /// [`with_single_values`](Self::with_single_values) rounded to v; 0 for 64-bit values.
    ///
    /// At most 1e-7 / p for the smallest entry p: 1e-5 if that is 0.01. (Beside an entry of
    /// 0.999_999_999, one of 1e-9 can't be kept: it becomes 6e-8, and e is 59. For entries below
    /// about 1e-315, e is infinite.)
    ///
    /// # Effect on beliefs
    ///
    /// For e below 1 and any likelihoods, after k transitions from the same prior
    ///
    /// - each probability of a filtered, predicted or smoothed (k = T) belief is the
    ///   exact one times a factor between ((1−e)/(1+e))^k and ((1+e)/(1−e))^k;
    /// - the log-likelihood changes by at most −k ln(1−e);
    /// - the Viterbi path has at least ((1−e)/(1+e))^k times the probability of the best one.
    ///
    /// The reason: the weight of a path, Π a b, has k factors a, each changed by a factor between
    /// 1−e and 1+e. Weights are not negative, so sums of them change by a factor between (1−e)^k
    /// and (1+e)^k; a probability is the ratio of two such sums.
    #[must_use]
    pub fn rounding(&self) -> f64 {
        self.rounding
    }
}

/// Rounds rows and columns to 32 bits; returns also the largest |v / p − 1|.
fn round(rows: Compressed, columns: Compressed) -> (Compressed, Compressed, f64) {
    let entries = columns.entries();
    let (mut by_column, mut by_row) = (Vec::with_capacity(entries), vec![0.0; entries]);
    // Position of the next entry of each row. Columns are visited in order, so that entries of a
    // row come in ascending order of their index, which is the order of its values.
    let mut next: Vec<u32> = rows.starts().to_vec();
    let (mut column, mut rounding) = (Column::default(), 0.0_f64);
    for from in 0..columns.lines() {
        column.values.clear();
        column.values.extend(columns.line(from).map(|entry| entry.1));
        column.round();
        for ((to, p), &v) in columns.line(from).zip(&column.rounded) {
            rounding = rounding.max((f64::from(v) / p - 1.0).abs());
            by_column.push(v);
            by_row[next[to] as usize] = v;
            next[to] += 1;
        }
    }
    (rows.with_single(by_row), columns.with_single(by_column), rounding)
}

/// A column, and scratch memory to round it.
#[derive(Default)]
struct Column {
    values: Vec<f64>,
    rounded: Vec<f32>,
    order: Vec<usize>,
    /// Sum of each value and all later ones, in descending order.
    sums: Vec<f64>,
}

impl Column {
    fn round(&mut self) {
        let Self { values, rounded, order, sums } = self;
        values.iter_mut().for_each(|p| *p = p.max(LEAST));
        order.clear();
        order.extend(0..values.len());
        // The largest first; of equal ones, the first.
        order.sort_unstable_by(|&a, &b| values[b].total_cmp(&values[a]).then(a.cmp(&b)));
        sums.clear();
        sums.extend(order.iter().rev().scan(0.0, |sum, &at| {
            *sum += values[at];
            Some(*sum)
        }));
        sums.reverse();
        rounded.clear();
        rounded.resize(values.len(), 0.0);
        // The remainder is exact: less than 2^53 steps, for fewer than 2^29 values.
        let mut left = 1.0;
        for (number, (&at, sum)) in order.iter().zip(&*sums).enumerate() {
            // v_i, the 32-bit number nearest to t_i = p_i r / s.
            let mut v = (values[at] * (left / sum)) as f32;
            if number + 1 == order.len() {
                // The remainder is a 32-bit number by then: the cast is exact.
                v = left as f32;
            } else if f64::from(v) >= left {
                // Leaves a step for the values to come, so that none becomes 0.
                v = (left as f32).next_down();
            }
            rounded[at] = v;
            left -= f64::from(v);
        }
    }
}
