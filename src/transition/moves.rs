//! Moves between states, and their expected numbers.
//!
//! Invariant of [`MoveCounts`]: moves are sorted by (from, to), each at most once, as operators
//! list their columns. Adding and looking up are merges and searches.

use wayfix_kernels::Lines;

/// One move between two steps, with its probability or expected number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Move {
    /// The state that is left.
    pub from: usize,
    /// The state that is reached.
    pub to: usize,
    /// p(from, to), or an expected number.
    pub weight: f64,
}

/// Sorts by `from`, then by `to`. A function of its own, since each closure would instantiate a
/// sort.
fn sort(moves: &mut [Move]) {
    moves.sort_by_key(|m| (m.from, m.to));
}

/// Expected numbers of moves between states.
///
/// Sums of [pairwise posteriors](crate::inference::SmoothedStep::moves), or counts of the moves of
/// known paths. Returned by [`Hmm::expected_moves`](crate::Hmm::expected_moves),
/// [`MoveCounts::of_path`] and [`MoveCounts::from_moves`].
///
/// ```
/// use wayfix::transition::MoveCounts;
///
/// let mut counts = MoveCounts::of_path(&[0, 1, 1, 2]);
/// counts.merge(&MoveCounts::of_path(&[1, 2]));
/// assert_eq!(counts.get(1, 2), 2.0);
/// assert_eq!(counts.moves().map(|step| step.weight).sum::<f64>(), 4.0);
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MoveCounts {
    /// Sorted by `from`, then by `to`.
    moves: Vec<Move>,
}

impl MoveCounts {
    /// Counts the moves of a path of known states.
    #[must_use]
    pub fn of_path(states: &[usize]) -> Self {
        let moves = states.windows(2).map(|pair| Move { from: pair[0], to: pair[1], weight: 1.0 });
        Self::from_moves(moves)
    }

    /// Adds up moves in any order. O(moves log moves).
    pub fn from_moves(moves: impl IntoIterator<Item = Move>) -> Self {
        let mut moves: Vec<Move> = moves.into_iter().collect();
        sort(&mut moves);
        let mut counts = Self::default();
        counts.add(moves);
        counts
    }

    /// Counts of the moves of all entries of a matrix, given its columns. The weight of an entry is
    /// `weight(position among all stored values, value)`.
    pub(crate) fn of_entries(
        columns: Lines<'_>,
        states: usize,
        weight: impl Fn(usize, f64) -> f64,
    ) -> Self {
        let mut moves = Self::default();
        match columns {
            Lines::Sparse { starts, indices, values } => {
                let column = |j: usize| starts[j] as usize..starts[j + 1] as usize;
                let entries = (0..states).flat_map(|j| column(j).map(move |at| (j, at)));
                moves.add(entries.map(|(from, at)| Move {
                    from,
                    to: indices[at] as usize,
                    weight: weight(at, values[at]),
                }));
            }
            Lines::Dense { values } | Lines::DenseTransposed { values } => {
                let stride = values.len() / states;
                // Entries of 0, and the padding of lines, are not moves, but would be listed as
                // moves.
                let entries = values.iter().enumerate().filter(|entry| *entry.1 > 0.0);
                moves.add(entries.map(|(at, p)| Move {
                    from: at / stride,
                    to: at % stride,
                    weight: weight(at, *p),
                }));
            }
        }
        moves
    }

    /// The moves with their counts, sorted by the state that is left, then by the one reached.
    #[must_use]
    pub fn moves(&self) -> impl ExactSizeIterator<Item = Move> {
        self.moves.iter().copied()
    }

    /// The expected number of a move; 0 if it was never seen. O(log moves).
    #[must_use]
    pub fn get(&self, from: usize, to: usize) -> f64 {
        let found = self.moves.binary_search_by_key(&(from, to), |m| (m.from, m.to));
        found.map_or(0.0, |at| self.moves[at].weight)
    }

    /// Adds other counts. O(moves).
    pub fn merge(&mut self, other: &Self) {
        self.add(other.moves());
    }

    /// Adds a move that comes after all others or is the last of them.
    pub(crate) fn append(&mut self, m: Move) {
        match self.moves.last_mut() {
            Some(last) if (last.from, last.to) == (m.from, m.to) => last.weight += m.weight,
            _ => self.moves.push(m),
        }
    }

    /// Adds moves in ascending order, and returns the sum of their weights. A move that is there
    /// already costs one comparison.
    pub(crate) fn add(&mut self, moves: impl IntoIterator<Item = Move>) -> f64 {
        // A merge in place: `at` only goes forward through the moves known before, and new moves
        // are collected behind them, to be sorted in at the end. After the first step of a sequence
        // there are usually none.
        let known = self.moves.len();
        let (mut at, mut sum) = (0, 0.0);
        for m in moves {
            sum += m.weight;
            let key = (m.from, m.to);
            while at < known && (self.moves[at].from, self.moves[at].to) < key {
                at += 1;
            }
            if at < known && (self.moves[at].from, self.moves[at].to) == key {
                self.moves[at].weight += m.weight;
                continue;
            }
            // New moves also ascend, so a repeated one is the last.
            match self.moves[known..].last_mut() {
                Some(last) if (last.from, last.to) == key => last.weight += m.weight,
                _ => self.moves.push(m),
            }
        }
        if self.moves.len() > known {
            sort(&mut self.moves);
        }
        sum
    }
}
