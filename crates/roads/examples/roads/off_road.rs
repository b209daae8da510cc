//! Counts of points off the road: how many were recognised, and how many were not.

use std::fmt;

use wayfix_roads::matching::RoadAnswer;

use super::measures::ESTIMATORS;

/// Points truly off the road, and for each estimator the answers "off the road" that were right
/// and wrong.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct OffRoad {
    /// Points for which the truth is known.
    all: usize,
    points: usize,
    found: [usize; 3],
    wrong: [usize; 3],
}

impl OffRoad {
    /// Takes the answers for a point in the order of the [`ESTIMATORS`].
    pub(crate) fn push(&mut self, is_off_road: bool, answers: [RoadAnswer; 3]) {
        self.all += 1;
        self.points += usize::from(is_off_road);
        let counts = if is_off_road { &mut self.found } else { &mut self.wrong };
        for (count, answer) in counts.iter_mut().zip(answers) {
            *count += usize::from(answer.edge.is_none());
        }
    }

    pub(crate) fn add(&mut self, other: Self) {
        self.all += other.all;
        self.points += other.points;
        for (mine, other) in [(&mut self.found, other.found), (&mut self.wrong, other.wrong)] {
            mine.iter_mut().zip(other).for_each(|(mine, other)| *mine += other);
        }
    }
}

impl fmt::Display for OffRoad {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let of_each = |counts: [usize; 3]| {
            let each = ESTIMATORS.iter().zip(counts);
            let each = each.map(|(name, count)| format!("{name} {count}"));
            each.collect::<Vec<_>>().join(", ")
        };
        let Self { all, points, found, wrong } = *self;
        if all == 0 {
            return Ok(());
        }
        writeln!(f, "points off the road: {points} of {all}, found: {}", of_each(found))?;
        writeln!(f, "points on the road taken to be off it: {}", of_each(wrong))
    }
}
