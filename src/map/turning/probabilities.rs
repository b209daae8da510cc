//! Turning probabilities Φ of a map: the transition operator's transpose (paper eqs. 1 and 6),
//! stored as A = Φ'.

use super::rule::TurningRule;
use crate::belief::SUM_TOLERANCE;
use crate::map::{MapError, RoadClass, RoadMap};
use crate::transition::{ConstrainedTransition, SparseTransition, TransitionEntries};

/// Turning probabilities Φ\[i, j\] = p(next place is j | place is i), along
/// roads or staying, whose rows sum to one (paper eq. 1).
///
/// The transition operator is the transpose, A = Φ' (paper eq. 6). See the
/// [module](crate::map) for an example.
#[derive(Debug, Clone)]
pub struct TurningProbabilities {
    transition: SparseTransition,
    pub(super) turns: Vec<FittedTurn>,
}

impl TurningProbabilities {
    /// Creates turning probabilities from entries (from, to, probability) by index, such as
    /// relative frequencies. Missing entries are 0. O((places + entries) log).
    ///
    /// # Errors
    ///
    /// [`MapError`] for a turn without a road, an entry that is NaN,
    /// negative, infinite, out of range or given twice, or a row that does not
    /// sum to one within 1e-9.
    pub fn new<P>(
        map: &RoadMap<P>,
        entries: impl IntoIterator<Item = (usize, usize, f64)>,
    ) -> Result<Self, MapError> {
        let n = map.places().len();
        let entries: Vec<_> = entries.into_iter().collect();
        let mut sums = vec![0.0; n];
        for &(from, to, value) in &entries {
            let (Some(start), Some(end)) = (map.places().get(from), map.places().get(to)) else {
                continue; // out of range: an error of the operator below
            };
            if from != to && value != 0.0 && !map.has_road(from, to) {
                return Err(MapError::NoRoad { from: start.id, to: end.id, value });
            }
            sums[from] += value;
        }
        // A NaN sum means a NaN entry, which the operator below reports with its indices.
        if let Some(i) = sums.iter().position(|sum| (sum - 1.0).abs() > SUM_TOLERANCE)
            && entries.iter().all(|e| e.0 < n && e.1 < n && e.2 >= 0.0 && e.2.is_finite())
        {
            return Err(MapError::TurningSum { id: map.places()[i].id, sum: sums[i] });
        }
        // A = Φ' (paper eq. 6): the entry into row `to`, column `from`.
        let triplets = entries.into_iter().map(|(from, to, value)| (to, from, value));
        Ok(Self { transition: SparseTransition::from_triplets(n, triplets)?, turns: Vec::new() })
    }

    /// Creates turning probabilities by a rule, from the classes of the roads. O((places + roads)
    /// log).
    ///
    /// # Errors
    ///
    /// [`MapError::Parameter`] for a number out of its range.
    pub fn by_rule<P>(map: &RoadMap<P>, rule: &TurningRule) -> Result<Self, MapError> {
        rule.check()?;
        let mut entries = Vec::with_capacity(map.places().len() + map.roads().len());
        for from in 0..map.places().len() {
            let Some(class) = map.roads_from(from).map(|(_, road)| road.class).max() else {
                entries.push((from, from, 1.0));
                continue;
            };
            let weight = |other: RoadClass| {
                // The class of a place is that of its highest road: on a main road, going on along
                // it is straight on.
                let straight = class == RoadClass::Main && other == RoadClass::Main;
                rule.weight.of(other) * if straight { rule.straight_on } else { 1.0 }
            };
            let total: f64 = map.roads_from(from).map(|(_, road)| weight(road.class)).sum();
            let stop = rule.stop.of(class);
            entries.push((from, from, stop));
            entries.extend(
                map.roads_from(from)
                    .map(|(to, road)| (from, to, (1.0 - stop) * weight(road.class) / total)),
            );
        }
        Self::new(map, entries)
    }

    /// Returns Φ\[from, to\] by index; 0 if the turn does not exist.
    #[must_use]
    pub fn get(&self, from: usize, to: usize) -> f64 {
        self.transition.get(to, from)
    }

    /// Turns out of a place, as pairs (to, probability) with probabilities above 0.
    ///
    /// # Panics
    ///
    /// If the place does not exist.
    pub fn row(&self, from: usize) -> impl Iterator<Item = (usize, f64)> {
        self.transition.outgoing(&(), from)
    }

    /// Turns with the data behind them, if the probabilities were learned by [`fit`](Self::fit) or
    /// a similar function; none otherwise. They are sorted by the place they leave: staying first,
    /// then all roads in ascending order of their ends.
    #[must_use]
    pub fn turns(&self) -> &[FittedTurn] {
        &self.turns
    }

    /// Returns the transition operator with parameters tied by the classes of the roads of `map`,
    /// for learning from drives. Places with the same classes of outgoing roads share the same
    /// turning probabilities, the mean of those that they had.
    ///
    /// ```
    /// use wayfix::canberra;
    ///
    /// let tied = canberra::turning().tied(&canberra::map());
    /// assert_eq!(tied.inner().entries(), 420);
    /// assert!(tied.parameters() < 100);
    /// ```
    #[must_use]
    pub fn tied<P>(self, map: &RoadMap<P>) -> ConstrainedTransition {
        // Label 0 is staying, and 1 to 4 the classes.
        ConstrainedTransition::new(self.transition).with_ties(|from, to| {
            let road = map.roads_from(from).find(|road| road.0 == to);
            road.map_or(0, |(_, road)| 1 + road.class as usize)
        })
    }

    /// Returns the transition operator A = Φ'.
    #[must_use]
    pub fn into_transition(self) -> SparseTransition {
        self.transition
    }
}

/// A turn out of a place or an edge, with the data behind it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FittedTurn {
    /// Index of the place that is left, or of the edge among the `EdgeTurns` of wayfix-roads.
    pub from: usize,
    /// Index of the next place or edge; the same for a stay.
    pub to: usize,
    /// Probability of the turn.
    pub probability: f64,
    /// Number of moves (or vehicles) counted on it; 0 for a turn known by the rule alone.
    pub count: f64,
}
