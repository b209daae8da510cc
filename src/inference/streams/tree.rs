//! Tree of the best paths to all present states, for an online decoder to commit from (Šrámek,
//! Brejová and Vinař 2007; section 7 of the [formulas](crate::guide::formulas)).
//!
//! The invariant: a node is alive (has at least one use) if and only if a best path to a possible
//! present state goes through it. So the oldest step is decided once one of its nodes is left.

use std::collections::VecDeque;

/// Tree of the best paths over the undecided steps.
#[derive(Debug, Clone, Default)]
pub(crate) struct Tree {
    /// Undecided steps, oldest first.
    levels: VecDeque<Level>,
    /// Memory of committed levels.
    spare: Vec<Level>,
    /// Predecessors of the nodes of the last level that no path extends.
    predecessors_of_removed: Vec<u32>,
}

/// A state on a surviving path.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Node {
    pub(crate) state: u32,
    /// Predecessor; 0 at the oldest undecided step.
    pub(crate) from: u32,
}

/// States of one step as nodes of the tree of best paths.
#[derive(Debug, Clone)]
struct Level {
    /// Best predecessor of each state.
    from: Vec<u32>,
    /// Number of living nodes of the next level that extend each node; at the last level, 1
    /// for a possible state and 0 for others.
    uses: Vec<u32>,
    /// Number of living nodes.
    alive: usize,
}

impl Level {
    fn new(states: usize) -> Self {
        Self { from: vec![0; states], uses: vec![0; states], alive: 0 }
    }
}

impl Tree {
    /// Number of undecided steps.
    pub(crate) fn len(&self) -> usize {
        self.levels.len()
    }

    pub(crate) fn clear(&mut self) {
        self.spare.extend(self.levels.drain(..));
    }

    /// Returns the states of the undecided steps on the best path to a present state.
    pub(crate) fn path(&self, mut state: usize) -> Vec<usize> {
        let mut states = vec![0; self.levels.len()];
        // `state` must be possible: then all nodes on its path are alive and their links valid,
        // whereas links of dead nodes may be stale.
        for (out, level) in states.iter_mut().zip(&self.levels).rev() {
            *out = state;
            state = level.from[state] as usize;
        }
        states
    }

    /// Returns the living nodes of each undecided step, in ascending order.
    pub(crate) fn nodes(&self) -> Vec<Vec<Node>> {
        let levels = self.levels.iter().enumerate().map(|(at, level)| {
            let nodes = (0..).zip(level.uses.iter().zip(&level.from));
            let alive = nodes.filter(|(_, (uses, _))| **uses > 0);
            // Steps before the oldest undecided one have been committed.
            let node = |(state, (_, &from))| Node { state, from: if at == 0 { 0 } else { from } };
            alive.map(node).collect()
        });
        levels.collect()
    }

    /// Replaces the tree by one with these nodes, over n states each step.
    pub(crate) fn restore(&mut self, n: usize, levels: &[Vec<Node>]) {
        self.clear();
        for nodes in levels {
            let mut level = self.spare.pop().unwrap_or_else(|| Level::new(n));
            level.from.fill(0);
            level.uses.fill(0);
            level.alive = nodes.len();
            for &Node { state, from } in nodes {
                level.from[state as usize] = from;
                // At the last level, one use marks a possible state.
                level.uses[state as usize] = 1;
            }
            // The previous level now has a successor: the uses of its nodes are the nodes that
            // extend them.
            if let Some(before) = self.levels.back_mut() {
                before.uses.fill(0);
                nodes.iter().for_each(|node| before.uses[node.from as usize] += 1);
            }
            self.levels.push_back(level);
        }
    }

    /// Adds the present step to the tree, and removes the nodes that no path to it goes through.
    pub(crate) fn grow(&mut self, scores: &[f64], from: &[u32]) {
        let mut level = self.spare.pop().unwrap_or_else(|| Level::new(scores.len()));
        level.from.copy_from_slice(from);
        let possible = scores.iter().map(|score| u32::from(*score > f64::NEG_INFINITY));
        level.uses.iter_mut().zip(possible).for_each(|(uses, possible)| *uses = possible);
        level.alive = level.uses.iter().filter(|uses| **uses > 0).count();
        // First add all new uses, then remove the marks of the former last level: in the other
        // order a node could drop to 0 uses, and be removed, although a new node extends it.
        if let Some(last) = self.levels.back_mut() {
            // Impossible new states have no use and add none.
            for (&from, &uses) in level.from.iter().zip(&level.uses) {
                last.uses[from as usize] += uses;
            }
            // Every possible node of that level carries its mark, plus one for each extension.
            self.predecessors_of_removed.clear();
            for (uses, &from) in last.uses.iter_mut().zip(&last.from) {
                if *uses > 0 {
                    *uses -= 1;
                    if *uses == 0 {
                        self.predecessors_of_removed.push(from);
                    }
                }
            }
            last.alive -= self.predecessors_of_removed.len();
            // Their predecessors lose one use each, which may remove further nodes.
            if let Some(before) = self.levels.len().checked_sub(2) {
                for k in 0..self.predecessors_of_removed.len() {
                    self.release(before, self.predecessors_of_removed[k] as usize);
                }
            }
        }
        self.levels.push_back(level);
    }

    /// Removes one use of a node. A node without uses is removed, and in turn may remove its
    /// predecessors.
    fn release(&mut self, mut at: usize, mut state: usize) {
        // A loop instead of recursion: a dying path may be as long as the tree is deep. Each node
        // is removed at most once, so the cost is O(1) for each node ever added.
        loop {
            let level = &mut self.levels[at];
            level.uses[state] -= 1;
            if level.uses[state] > 0 {
                return;
            }
            level.alive -= 1;
            state = level.from[state] as usize;
            match at.checked_sub(1) {
                Some(before) => at = before,
                // Steps before the oldest undecided one have been committed.
                None => return,
            }
        }
    }

    /// Commits the oldest steps with only one living node: all surviving paths go through that
    /// node.
    pub(crate) fn commit(&mut self, committed: &mut Vec<usize>) {
        committed.clear();
        // The last level may also be committed: if only one present state is possible, every later
        // path goes through it.
        while self.levels.front().is_some_and(|level| level.alive == 1) {
            if let Some(level) = self.levels.pop_front() {
                committed.extend(level.uses.iter().position(|uses| *uses > 0));
                self.spare.push(level);
            }
        }
    }
}
