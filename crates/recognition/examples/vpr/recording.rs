//! Recordings to locate.

use std::ops::RangeInclusive;

/// References that show a place; `None` if it is off the map.
pub(crate) type Label = Option<RangeInclusive<usize>>;

/// A drive along a mapped route: the distance of each image to each image of the map.
#[derive(Debug, Clone, Default)]
pub(crate) struct Recording {
    pub(crate) name: String,
    /// Number of places of the map, n.
    pub(crate) references: usize,
    /// Distances, T × n, one row per step; smaller is more alike.
    pub(crate) distances: Vec<f32>,
    /// Right places at each step, if they are known.
    pub(crate) truth: Option<Vec<Label>>,
    /// Measured number of references that the vehicle advanced before each step; empty if not
    /// measured.
    pub(crate) odometry: Vec<Option<f64>>,
    /// True if the first reference follows the last one.
    pub(crate) closed: bool,
}

impl Recording {
    pub(crate) fn steps(&self) -> usize {
        self.distances.len() / self.references
    }

    pub(crate) fn rows(&self) -> Vec<&[f32]> {
        self.distances.chunks_exact(self.references).collect()
    }

    /// Number of references between a place and a range, by the shorter way around a loop; 0
    /// inside.
    pub(crate) fn gap(&self, place: usize, range: &RangeInclusive<usize>) -> usize {
        let (n, start, end) = (self.references, *range.start(), *range.end());
        let beside = start.saturating_sub(place).max(place.saturating_sub(end));
        let around = (place + n - end).min(start + n - place);
        if self.closed { beside.min(around) } else { beside }
    }

    /// True if an answer is right within a tolerance, in references.
    pub(crate) fn is_right(&self, label: &Label, answer: Option<usize>, tolerance: usize) -> bool {
        match (label, answer) {
            (Some(range), Some(place)) => self.gap(place, range) <= tolerance,
            (label, answer) => label.is_none() && answer.is_none(),
        }
    }

    /// Probability within `reach` of a label, by a belief that may end in an entry for off the map.
    pub(crate) fn mass(&self, belief: &[f64], label: &Label, reach: usize) -> f64 {
        let n = self.references;
        let Some(range) = label else { return belief.get(n).map_or(0.0, |off| off.min(1.0)) };
        let near = belief[..n].iter().enumerate().filter(|(i, _)| self.gap(*i, range) <= reach);
        // A sum may exceed 1 by rounding.
        near.fold(0.0, |sum, (_, p)| sum + p).min(1.0)
    }
}
