//! Lists of the best paths to each state, which the k-best decoders carry from step to step
//! (section 7 of the [formulas](crate::guide::formulas)).
//!
//! The invariant: a list is in descending order of scores, and paths with equal scores are in
//! ascending order of the state before, then of rank. So ties go to the lowest states.

/// A path to a state: its score, the state before, and the rank, in the list of that state, of the
/// path that it extends.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RankedPath {
    pub(crate) score: f64,
    pub(crate) from: u32,
    rank: u32,
}

impl RankedPath {
    /// Creates a path of one step.
    pub(crate) fn start(score: f64) -> Self {
        Self { score, from: 0, rank: 0 }
    }
}

/// Largest number of paths that are kept sorted while others are added; longer lists are sorted at
/// the end.
const FEW: usize = 16;

/// Best paths to each state of a step.
#[derive(Debug, Clone, Default)]
pub(crate) struct Lists {
    paths: Vec<RankedPath>,
    /// Index of the first path to each state, and their number.
    ranges: Vec<(usize, u32)>,
}

impl Lists {
    pub(crate) fn with_capacity(states: usize, paths: usize) -> Self {
        Self { paths: Vec::with_capacity(paths), ranges: Vec::with_capacity(states) }
    }

    /// Appends the paths to the next state.
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

    /// Paths to a state. Their scores may be changed only in ways that keep their order.
    #[inline]
    pub(crate) fn of_mut(&mut self, state: usize) -> &mut [RankedPath] {
        let (start, count) = self.ranges[state];
        &mut self.paths[start..start + count as usize]
    }

    /// Removes the paths to a state.
    pub(crate) fn clear(&mut self, state: usize) {
        self.ranges[state].1 = 0;
    }

    /// Lists of all states, in the order of the states.
    pub(crate) fn iter(&self) -> impl Iterator<Item = &[RankedPath]> {
        (0..self.ranges.len()).map(|state| self.of(state))
    }
}

/// Collector of the best paths to one state, while moves into it are added.
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
        // Many: collected now, selected and sorted in `finish`.
        if self.count > FEW {
            return self.paths.extend(all);
        }
        for path in all {
            // Insertion sort from the end of a short list.
            let worse = |other: &RankedPath| order(&path, other).is_lt();
            let after = self.paths.iter().rev().take_while(|other| worse(other)).count();
            let place = self.paths.len() - after;
            // The list is full of better ones, and later paths from the same state are worse still.
            if place == self.count {
                break;
            }
            if self.paths.len() == self.count {
                self.paths.pop();
            }
            self.paths.insert(place, path);
        }
    }

    /// Keeps only the best paths, sorted, once all moves are added. The order is total, so that
    /// unstable selection and sorting, which are faster, give the same as sorted insertion.
    pub(crate) fn finish(&mut self) {
        if self.count <= FEW {
            return;
        }
        if self.count < self.paths.len() {
            // Selection first, since only K of up to E K paths have to be sorted.
            self.paths.select_nth_unstable_by(self.count, order);
            self.paths.truncate(self.count);
        }
        self.paths.sort_unstable_by(order);
    }
}

/// Compares paths: best first; ties go to the lowest `from`, then to the best rank. A total order.
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

/// Returns the states of a path by going back from its end; `paths` returns the list of a state at
/// a step, counted from 0.
pub(crate) fn states<'a>(
    end: RankedPath,
    steps: usize,
    paths: impl Fn(usize, usize) -> &'a [RankedPath],
) -> Vec<usize> {
    // An end comes from `best_ends`: its `from` is the last state itself, and its `rank` a place in
    // that state's list. From there each path names the state before it in the same way.
    let (mut states, mut path) = (vec![0; steps], end);
    for step in (0..steps).rev() {
        states[step] = path.from as usize;
        path = paths(step, states[step])[path.rank as usize];
    }
    states
}
