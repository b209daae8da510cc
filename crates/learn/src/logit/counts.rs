//! [`InputCounts`]: expected moves by the inputs of their steps.

use std::cmp::Ordering;
use std::collections::BTreeMap;

use wayfix::transition::MoveCounts;

/// Expected number of moves for each distinct row of inputs: the statistics of a
/// [`LogitTransition`](super::LogitTransition).
///
/// Rows are compared by their bits, and listed in ascending order. So the cost of a category, or of
/// a time of day by the hour, is that of its distinct values; inputs that never repeat cost the
/// moves of every step.
///
/// ```
/// use wayfix_learn::InputCounts;
/// use wayfix::transition::MoveCounts;
///
/// let mut counts = InputCounts::default();
/// counts.add(&[1.0, 0.0], &MoveCounts::of_path(&[0, 1]));
/// counts.add(&[0.0, 0.0], &MoveCounts::of_path(&[1, 1]));
/// counts.add(&[1.0, 0.0], &MoveCounts::of_path(&[0, 1]));
/// let all: Vec<_> = counts.rows().map(|(inputs, moves)| (inputs[0], moves.get(0, 1))).collect();
/// assert_eq!(all, [(0.0, 0.0), (1.0, 2.0)]);
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub struct InputCounts {
    rows: BTreeMap<Row, MoveCounts>,
}

/// A row of inputs as a key.
#[derive(Debug, Clone)]
struct Row(Vec<f64>);

impl Ord for Row {
    fn cmp(&self, other: &Self) -> Ordering {
        // Lexicographic in the total order of doubles, in which −0 and 0 differ, and a NaN is equal
        // to itself: a key must be.
        let pairs = self.0.iter().zip(&other.0);
        let mut different = pairs.map(|(a, b)| a.total_cmp(b)).filter(|order| order.is_ne());
        different.next().unwrap_or_else(|| self.0.len().cmp(&other.0.len()))
    }
}

impl PartialOrd for Row {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Row {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Row {}

impl InputCounts {
    /// The rows of inputs with the moves of their steps, in ascending order.
    #[must_use]
    pub fn rows(&self) -> impl ExactSizeIterator<Item = (&[f64], &MoveCounts)> {
        self.rows.iter().map(|(row, counts)| (&row.0[..], counts))
    }

    /// Adds moves made at these inputs. O(log rows + moves).
    pub fn add(&mut self, inputs: &[f64], counts: &MoveCounts) {
        self.at(inputs).merge(counts);
    }

    /// Adds other counts. O(rows log rows + moves).
    pub fn merge(&mut self, other: &Self) {
        other.rows().for_each(|(inputs, counts)| self.add(inputs, counts));
    }

    /// Counts at these inputs.
    pub(super) fn at(&mut self, inputs: &[f64]) -> &mut MoveCounts {
        self.rows.entry(Row(inputs.to_vec())).or_default()
    }
}
