//! Recordings to be located, and the answers of methods.

use std::ops::RangeInclusive;

use wayfix::evaluate;

/// A query pass along a mapped route: the distance of each image to each image of the map, and
/// the true places.
#[derive(Debug, Clone, Default)]
pub(crate) struct Recording {
    /// Name of the recording in the outputs.
    pub(crate) name: String,
    /// Number of places of the map, n.
    pub(crate) references: usize,
    /// Distances, T × n, one row per step of the query; smaller = more alike.
    pub(crate) distances: Vec<f32>,
    /// Right places at each step; `None` if it is off the map.
    pub(crate) truth: Vec<Option<RangeInclusive<usize>>>,
    /// Measured number of references that the vehicle advanced before each step; the first is 0
    /// and ignored.
    pub(crate) odometry: Option<Vec<f64>>,
    /// True if the last reference is followed by the first one.
    pub(crate) closed: bool,
}

/// Answers of one method, one value per step.
#[derive(Debug, Default)]
pub(crate) struct Answers {
    pub(crate) method: String,
    /// Places; `None` means "not on the map".
    pub(crate) places: Vec<Option<usize>>,
    /// Confidence on any scale; larger = surer.
    pub(crate) confidence: Vec<f64>,
    /// Probability that the answer is right, for each tolerance.
    pub(crate) probability: Option<Vec<Vec<f64>>>,
    /// Probability of the true places, for each tolerance.
    pub(crate) truth_mass: Option<Vec<Vec<f64>>>,
    /// Probability of being on the map.
    pub(crate) on_map: Option<Vec<f64>>,
    /// Time of a step in milliseconds, without the comparison of images.
    pub(crate) step_ms: Option<f64>,
}

impl Recording {
    /// Number of steps of the query, T.
    pub(crate) fn steps(&self) -> usize {
        self.truth.len()
    }

    /// Distances of the image of a step to each place.
    pub(crate) fn row(&self, step: usize) -> &[f32] {
        &self.distances[step * self.references..][..self.references]
    }

    /// Rows of all steps.
    pub(crate) fn rows(&self) -> Vec<&[f32]> {
        self.distances.chunks_exact(self.references).collect()
    }

    /// Measured distance driven before a step, if any.
    pub(crate) fn reading(&self, step: usize) -> Option<f64> {
        self.odometry.as_ref()?.get(step).copied().filter(|_| step > 0)
    }

    /// Readings of all steps; empty if there are none.
    pub(crate) fn readings(&self) -> Vec<Option<f64>> {
        let count = self.odometry.as_ref().map_or(0, Vec::len);
        (0..count).map(|step| self.reading(step)).collect()
    }

    /// True if an answer is right to a tolerance in references.
    pub(crate) fn is_right(&self, step: usize, answer: Option<usize>, tolerance: usize) -> bool {
        let (Some(truth), Some(place)) = (&self.truth[step], answer) else {
            return self.truth[step].is_none() && answer.is_none();
        };
        // On a closed route, the places are also repeated one round ahead and one behind.
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
