//! Turning probabilities Φ of a map.

use super::{MapError, RoadClass, RoadMap};
use crate::belief::SUM_TOLERANCE;
use crate::error::Parameter;
use crate::transition::{SparseTransition, TiedTransition, TransitionEntries};

/// One number per [`RoadClass`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ByClass {
    /// Number of [`RoadClass::Main`].
    pub main: f64,
    /// Number of [`RoadClass::Arterial`].
    pub arterial: f64,
    /// Number of [`RoadClass::Collector`].
    pub collector: f64,
    /// Number of [`RoadClass::Street`].
    pub street: f64,
}

impl ByClass {
    /// Creates the same number for every class.
    ///
    /// ```
    /// use wayfix::map::{ByClass, RoadClass};
    ///
    /// assert_eq!(ByClass::all(0.5).of(RoadClass::Collector), 0.5);
    /// ```
    #[must_use]
    pub fn all(value: f64) -> Self {
        Self { main: value, arterial: value, collector: value, street: value }
    }

    /// Returns the number of a class.
    #[must_use]
    pub fn of(&self, class: RoadClass) -> f64 {
        match class {
            RoadClass::Main => self.main,
            RoadClass::Arterial => self.arterial,
            RoadClass::Collector => self.collector,
            RoadClass::Street => self.street,
        }
    }
}

/// Rule by which a vehicle chooses among the roads out of a place.
///
/// The class of a place is the highest class of the roads that leave it. With the probability
/// that `stop` gives for this class, the vehicle **stops** (stays for one step). Otherwise it
/// takes a road with probability proportional to the road's `weight`; at places on the main road,
/// the weight of the main road itself is multiplied by `straight_on`. At a place that no road
/// leaves, the vehicle stays.
///
/// By default, the weight doubles from class to class (1, 2, 4, 8), straight on doubles it again,
/// and the probability of stopping is 0.05 on the main road and 0.05 more for each class below.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TurningRule {
    /// Relative traffic that a road of each class attracts; above 0, of any scale.
    pub weight: ByClass,
    /// Factor of the main road's weight for vehicles already on it; above 0.
    pub straight_on: f64,
    /// Probability of staying for a step; at least 0 and below 1.
    pub stop: ByClass,
}

impl Default for TurningRule {
    fn default() -> Self {
        Self {
            weight: ByClass { main: 8.0, arterial: 4.0, collector: 2.0, street: 1.0 },
            straight_on: 2.0,
            stop: ByClass { main: 0.05, arterial: 0.10, collector: 0.15, street: 0.20 },
        }
    }
}

impl TurningRule {
    fn check(&self) -> Result<(), MapError> {
        use RoadClass::{Arterial, Collector, Main, Street};
        let positive = |what: String, value: f64| {
            let expected = "a finite value above 0";
            let valid = value > 0.0 && value.is_finite();
            if valid { Ok(()) } else { Err(Parameter::new(what, value, expected)) }
        };
        positive("the straight-on factor".into(), self.straight_on)?;
        for class in [Main, Arterial, Collector, Street] {
            positive(format!("the weight of class {class}"), self.weight.of(class))?;
            let value = self.stop.of(class);
            if !(0.0..1.0).contains(&value) {
                let what = format!("the probability of stopping for class {class}");
                let expected = "at least 0 and below 1";
                return Err(Parameter::new(what, value, expected).into());
            }
        }
        Ok(())
    }
}

/// Turning probabilities Φ\[i, j\] = p(next place is j | place is i), along
/// roads or staying, whose rows sum to one (paper eq. 1).
///
/// The transition operator is the transpose, A = Φ' (paper eq. 6). See the
/// [module](super) for an example.
#[derive(Debug, Clone)]
pub struct TurningProbabilities {
    transition: SparseTransition,
}

impl TurningProbabilities {
    /// Creates turning probabilities from entries (from, to, probability) by index, for instance
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
            let has_road = from == to || map.outgoing.of(from).binary_search(&(to as u32)).is_ok();
            if !has_road && value != 0.0 {
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
        let triplets = entries.into_iter().map(|(from, to, value)| (to, from, value));
        Ok(Self { transition: SparseTransition::from_triplets(n, triplets)? })
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

    /// Returns Φ\[from, to\] by index, 0 where there is no such turn.
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

    /// Returns the transition operator with parameters tied by the classes of the roads of `map`,
    /// for learning from drives. Places with the same classes of outgoing roads share the same
    /// turning probabilities; where these differed, their mean.
    ///
    /// ```
    /// use wayfix::canberra;
    ///
    /// let tied = canberra::turning().tied(&canberra::map());
    /// assert_eq!(tied.entries(), 420);
    /// assert!(tied.parameters() < 100);
    /// ```
    #[must_use]
    pub fn tied<P>(self, map: &RoadMap<P>) -> TiedTransition {
        TiedTransition::new(self.transition, |from, to| {
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
