//! The discrete part of the sensor, P_c.

use super::ObservationError;
use crate::likelihood::TableLikelihood;
use crate::map::RoadMap;

/// P_c: a place is seen as itself, or mistaken for a place that a road joins
/// with it (in either direction); for no other (paper section II-B).
///
/// Each neighbour takes the same share q of a place's probability, so that a
/// busy junction is harder to tell from its neighbours than a quiet corner:
/// P_c(i | i) = 1 − q dᵢ for a place with dᵢ neighbours. The share is chosen so
/// that the mean of P_c(i | i) over all places is the one asked for; in the
/// paper that is 0.7.
///
/// Holds n² numbers, as the sensors made from it do: meant for up to some
/// thousands of places. See the [module](super) for an example.
#[derive(Debug, Clone, PartialEq)]
pub struct Confusion {
    /// P_c(j | i) at `rows[i][j]`.
    pub(super) rows: Vec<Vec<f64>>,
}

impl Confusion {
    /// The confusion of the places of a map, with this mean probability of a
    /// correct observation. O(n²).
    ///
    /// # Errors
    ///
    /// [`ObservationError`] if the mean is not above 0 and at most 1, if it is
    /// below 1 and no place has a neighbour, or if a place has so many
    /// neighbours that nothing would be left for itself.
    pub fn new(map: &RoadMap, mean_correct: f64) -> Result<Self, ObservationError> {
        if !(mean_correct > 0.0 && mean_correct <= 1.0) {
            return Err(ObservationError::Parameter {
                what: "the mean probability of a correct observation",
                value: mean_correct,
                expected: "above 0 and at most 1",
            });
        }
        let n = map.places().len();
        let joined: Vec<Vec<usize>> = (0..n).map(|i| map.joined(i)).collect();
        let pairs: usize = joined.iter().map(Vec::len).sum();
        if pairs == 0 && mean_correct < 1.0 {
            return Err(ObservationError::NoNeighbors { mean: mean_correct });
        }
        let share = if pairs == 0 { 0.0 } else { (1.0 - mean_correct) * n as f64 / pairs as f64 };
        let mut rows = vec![vec![0.0; n]; n];
        for (i, (row, joined)) in rows.iter_mut().zip(&joined).enumerate() {
            let correct = 1.0 - share * joined.len() as f64;
            if correct <= 0.0 {
                let (id, neighbors) = (map.places()[i].id, joined.len());
                return Err(ObservationError::TooManyNeighbors { id, neighbors, correct });
            }
            row[i] = correct;
            joined.iter().for_each(|&j| row[j] = share);
        }
        Ok(Self { rows })
    }

    /// P_c(seen | place), by index, or `None` where there is no such place.
    #[must_use]
    pub fn probability(&self, place: usize, seen: usize) -> Option<f64> {
        self.rows.get(place)?.get(seen).copied()
    }

    /// The sensor without Gaussian noise. O(n²).
    ///
    /// # Errors
    ///
    /// None in practice: the rows sum to one.
    pub fn into_table(self) -> Result<TableLikelihood, ObservationError> {
        Ok(TableLikelihood::from_rows(&self.rows)?)
    }
}
