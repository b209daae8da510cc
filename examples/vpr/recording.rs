//! A recording to be located, and answers about it.

use std::ops::RangeInclusive;

use wayfix::evaluate;

/// A query pass along a mapped route: how unlike each image is to each image
/// of the map, and where it truly was.
#[derive(Debug, Clone, Default)]
pub(crate) struct Recording {
    /// What the outputs call it.
    pub(crate) name: String,
    /// How many places the map has, n.
    pub(crate) references: usize,
    /// T × n, a row for each step of the query; smaller = more alike.
    pub(crate) distances: Vec<f32>,
    /// The places that are right at each step; `None`: it is off the map.
    pub(crate) truth: Vec<Option<RangeInclusive<usize>>>,
    /// How many references the vehicle advanced before each step, as measured;
    /// the first is 0 and means nothing.
    pub(crate) odometry: Option<Vec<f64>>,
    /// Does the last reference lie before the first one?
    pub(crate) closed: bool,
}

/// What one method says, a value for each step.
#[derive(Debug, Default)]
pub(crate) struct Answers {
    pub(crate) method: String,
    /// `None`: "not on the map".
    pub(crate) places: Vec<Option<usize>>,
    /// Of any scale, larger = surer.
    pub(crate) confidence: Vec<f64>,
    /// For each tolerance: the probability that the answer is right.
    pub(crate) probability: Option<Vec<Vec<f64>>>,
    /// For each tolerance: the probability given to what is true.
    pub(crate) truth_mass: Option<Vec<Vec<f64>>>,
    /// The probability of being on the map.
    pub(crate) on_map: Option<Vec<f64>>,
    /// How long a step takes, in milliseconds, once images are compared.
    pub(crate) step_ms: Option<f64>,
}

impl Recording {
    /// How many steps the query has, T.
    pub(crate) fn steps(&self) -> usize {
        self.truth.len()
    }

    /// How unlike the image of a step is to each place.
    pub(crate) fn row(&self, step: usize) -> &[f32] {
        &self.distances[step * self.references..][..self.references]
    }

    /// The rows of all steps.
    pub(crate) fn rows(&self) -> Vec<&[f32]> {
        self.distances.chunks_exact(self.references).collect()
    }

    /// How far the vehicle drove before a step, if that was measured.
    pub(crate) fn reading(&self, step: usize) -> Option<f64> {
        self.odometry.as_ref()?.get(step).copied().filter(|_| step > 0)
    }

    /// The readings of all steps; empty if there are none.
    pub(crate) fn readings(&self) -> Vec<Option<f64>> {
        let count = self.odometry.as_ref().map_or(0, Vec::len);
        (0..count).map(|step| self.reading(step)).collect()
    }

    /// Is an answer right, to a tolerance in references?
    pub(crate) fn is_right(&self, step: usize, answer: Option<usize>, tolerance: usize) -> bool {
        let (Some(truth), Some(place)) = (&self.truth[step], answer) else {
            return self.truth[step].is_none() && answer.is_none();
        };
        // On a closed route, the places also lie one round ahead and one behind.
        let n = if self.closed { self.references } else { 0 };
        let ahead = truth.start() + n..=truth.end() + n;
        let near = |truth, place| evaluate::is_within(truth, place, tolerance) == Ok(true);
        near(truth, place) || near(truth, place + n) || near(&ahead, place)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_near_the_short_way_on_a_closed_route() {
        let mut recording =
            Recording { references: 10, truth: vec![Some(0..=2), None], ..Recording::default() };
        let right = |recording: &Recording, tolerance| {
            (0..10).filter(|i| recording.is_right(0, Some(*i), tolerance)).collect::<Vec<_>>()
        };
        assert_eq!(right(&recording, 0), [0, 1, 2]);
        assert_eq!(right(&recording, 2), [0, 1, 2, 3, 4]);
        recording.closed = true;
        assert_eq!(right(&recording, 0), [0, 1, 2]);
        assert_eq!(right(&recording, 2), [0, 1, 2, 3, 4, 8, 9]);
        recording.truth[0] = Some(8..=9);
        assert_eq!(right(&recording, 1), [0, 7, 8, 9]);
        assert!(!recording.is_right(0, None, 9) && recording.is_right(1, None, 0));
        assert!(!recording.is_right(1, Some(3), 9));
    }
}
