//! Lists of the best paths to each state, which the k-best decoders carry from step to step
//! (section 7 of the [formulas](crate::guide::formulas)).
//!
//! A list is in descending order of scores, and equal ones are in the order of the states before,
//! so that ties go to the lowest state.

/// A path to a state: its score, the state before, and the rank of the path to that state that it
/// extends.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RankedPath {
    pub(crate) score: f64,
    pub(crate) from: u32,
    rank: u32,
}

impl RankedPath {
    /// Creates a path that extends none.
    pub(crate) fn start(score: f64) -> Self {
        Self { score, from: 0, rank: 0 }
    }
}

/// Largest number of paths that are kept in order while others come.
const FEW: usize = 16;

/// Best paths to each state of a step.
#[derive(Debug, Clone, Default)]
pub(crate) struct Lists {
    paths: Vec<RankedPath>,
    /// Place of the first path to each state, and number of paths.
    ranges: Vec<(usize, u32)>,
}

impl Lists {
    pub(crate) fn with_capacity(states: usize, paths: usize) -> Self {
        Self { paths: Vec::with_capacity(paths), ranges: Vec::with_capacity(states) }
    }

    /// Adds the paths to the next state.
    #[inline]
    pub(crate) fn push(&mut self, paths: &[RankedPath]) {
        self.ranges.push((self.paths.len(), paths.len() as u32));
        self.paths.extend_from_slice(paths);
    }

    /// Paths to a state, best first.
    #[inline]
    pub(crate) fn of(&self, state: usize) -> &[RankedPath] {
        let (start, count) = self.ranges[state];
        &self.paths[start..start + count as usize]
    }

    /// Paths to a state, whose scores may change in a way that keeps their order.
    #[inline]
    pub(crate) fn of_mut(&mut self, state: usize) -> &mut [RankedPath] {
        let (start, count) = self.ranges[state];
        &mut self.paths[start..start + count as usize]
    }

    /// Removes the paths to a state.
    pub(crate) fn clear(&mut self, state: usize) {
        self.ranges[state].1 = 0;
    }

    /// Lists of all states, in order.
    pub(crate) fn iter(&self) -> impl Iterator<Item = &[RankedPath]> {
        (0..self.ranges.len()).map(|state| self.of(state))
    }
}

/// The best paths to a state, while moves to it are added.
#[derive(Debug)]
pub(crate) struct Best {
    pub(crate) paths: Vec<RankedPath>,
    count: usize,
}

impl Best {
    pub(crate) fn new(count: usize) -> Self {
        Self { paths: Vec::new(), count }
    }

    /// Adds the paths to the state `from`, best first, each extended by a move with this score.
    #[inline]
    pub(crate) fn extend(&mut self, from: usize, before: &[RankedPath], added: f64) {
        let extended = |(rank, path): (u32, &RankedPath)| RankedPath {
            score: path.score + added,
            from: from as u32,
            rank,
        };
        let all = (0..).zip(before).map(extended);
        if self.count > FEW {
            return self.paths.extend(all);
        }
        for path in all {
            let worse = |other: &RankedPath| order(&path, other).is_lt();
            let after = self.paths.iter().rev().take_while(|other| worse(other)).count();
            let place = self.paths.len() - after;
            // No later path from the same state is better.
            if place == self.count {
                break;
            }
            if self.paths.len() == self.count {
                self.paths.pop();
            }
            self.paths.insert(place, path);
        }
    }

    /// Keeps the best paths, in order, once all moves are added. The order is total: an unstable
    /// selection and sort, which are faster, find the same as a list that is kept in order.
    pub(crate) fn finish(&mut self) {
        if self.count <= FEW {
            return;
        }
        if self.count < self.paths.len() {
            // The best are selected before they are sorted: of E K paths K are kept.
            self.paths.select_nth_unstable_by(self.count, order);
            self.paths.truncate(self.count);
        }
        self.paths.sort_unstable_by(order);
    }
}

/// Best first; ties go to the lowest `from`, then to the best rank. A total order.
fn order(a: &RankedPath, b: &RankedPath) -> std::cmp::Ordering {
    b.score.total_cmp(&a.score).then((a.from, a.rank).cmp(&(b.from, b.rank)))
}

/// Returns the best of the paths to all states of the last step.
pub(crate) fn best_ends<'a>(
    last: impl Iterator<Item = &'a [RankedPath]>,
    count: usize,
) -> Vec<RankedPath> {
    let mut ends = Best::new(count);
    last.enumerate().for_each(|(state, paths)| ends.extend(state, paths, 0.0));
    ends.finish();
    ends.paths
}

/// Returns the states of a path, back from its end; `paths` has those to a state of a step, from 0.
pub(crate) fn states<'a>(
    end: RankedPath,
    steps: usize,
    paths: impl Fn(usize, usize) -> &'a [RankedPath],
) -> Vec<usize> {
    let (mut states, mut path) = (vec![0; steps], end);
    for step in (0..steps).rev() {
        states[step] = path.from as usize;
        path = paths(step, states[step])[path.rank as usize];
    }
    states
}
