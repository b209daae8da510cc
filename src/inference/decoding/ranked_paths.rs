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

/// Appends the paths to the state `from`, each extended by a move with this score.
pub(crate) fn extend(paths: &mut Vec<RankedPath>, from: usize, before: &[RankedPath], added: f64) {
    paths.extend((0..).zip(before).map(|(rank, path)| RankedPath {
        score: path.score + added,
        from: from as u32,
        rank,
    }));
}

/// Keeps the best paths, in order; ties go to the lowest `from`, then to the best rank. The order is
/// total: an unstable selection and sort, which are faster, find the same.
pub(crate) fn keep_best(paths: &mut Vec<RankedPath>, count: usize) {
    let order = |a: &RankedPath, b: &RankedPath| {
        b.score.total_cmp(&a.score).then((a.from, a.rank).cmp(&(b.from, b.rank)))
    };
    if count < paths.len() {
        // The best are selected before they are sorted: of E K paths K are kept.
        paths.select_nth_unstable_by(count, order);
        paths.truncate(count);
    }
    paths.sort_unstable_by(order);
    paths.shrink_to_fit();
}

/// Returns the best of the paths to all states of the last step.
pub(crate) fn best_ends(last: &[Vec<RankedPath>], count: usize) -> Vec<RankedPath> {
    let mut ends = Vec::new();
    last.iter().enumerate().for_each(|(state, paths)| extend(&mut ends, state, paths, 0.0));
    keep_best(&mut ends, count);
    ends
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
