//! A recording to be located, and answers about it.

use std::ops::RangeInclusive;

/// A query pass along a mapped route: how unlike each image is to each image
/// of the map, and where it truly was.
#[derive(Debug)]
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
#[derive(Debug)]
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

    /// How many references a place lies from the nearest right one of a step;
    /// `None` off the map.
    pub(crate) fn error(&self, step: usize, place: usize) -> Option<usize> {
        let truth = self.truth[step].as_ref()?;
        let (first, last) = (*truth.start(), *truth.end());
        if truth.contains(&place) {
            return Some(0);
        }
        let apart = first.abs_diff(place).min(last.abs_diff(place));
        if !self.closed {
            return Some(apart);
        }
        let around = |i: usize| self.references - i.abs_diff(place);
        Some(apart.min(around(first)).min(around(last)))
    }

    /// Is an answer right, to a tolerance in references?
    pub(crate) fn is_right(&self, step: usize, answer: Option<usize>, tolerance: usize) -> bool {
        match answer {
            Some(place) => self.error(step, place).is_some_and(|error| error <= tolerance),
            None => self.truth[step].is_none(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_go_the_short_way_on_a_closed_route() {
        let mut recording = Recording {
            name: String::new(),
            references: 10,
            distances: vec![0.0; 20],
            truth: vec![Some(0..=2), None],
            odometry: None,
            closed: false,
        };
        let errors = |recording: &Recording| (0..10).map(|i| recording.error(0, i)).collect();
        let open: Vec<_> = errors(&recording);
        assert_eq!(open, [0, 0, 0, 1, 2, 3, 4, 5, 6, 7].map(Some));
        recording.closed = true;
        let closed: Vec<_> = errors(&recording);
        assert_eq!(closed, [0, 0, 0, 1, 2, 3, 4, 3, 2, 1].map(Some));
        assert!(recording.is_right(0, Some(9), 1) && !recording.is_right(0, Some(8), 1));
        assert!(!recording.is_right(0, None, 9) && recording.is_right(1, None, 0));
        assert!(!recording.is_right(1, Some(3), 9));
    }
}
