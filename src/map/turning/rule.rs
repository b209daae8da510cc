//! Choice of a vehicle among roads, by their classes.

use crate::error::OutOfRange;
use crate::map::{MapError, RoadClass};

/// One number per [`RoadClass`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ByClass {
    /// Number for [`RoadClass::Main`].
    pub main: f64,
    /// Number for [`RoadClass::Arterial`].
    pub arterial: f64,
    /// Number for [`RoadClass::Collector`].
    pub collector: f64,
    /// Number for [`RoadClass::Street`].
    pub street: f64,
}

impl ByClass {
    /// Returns the same number for every class.
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

    /// Returns the number for a class.
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

/// Rule for the probability of each road out of a place.
///
/// The class of a place is the highest class of the roads that leave it. With the probability that
/// `stop` has for this class, the vehicle **stops** (stays for one step). Otherwise it takes a road
/// with probability proportional to the road's `weight`; at places on the main road, the weight of
/// the main road itself is multiplied by `straight_on`. At a place that no road leaves, the vehicle
/// stays.
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
    pub(super) fn check(&self) -> Result<(), MapError> {
        use RoadClass::{Arterial, Collector, Main, Street};
        let positive = |what: String, value: f64| {
            let expected = "a finite value above 0";
            let valid = value > 0.0 && value.is_finite();
            if valid { Ok(()) } else { Err(OutOfRange::new(what, value, expected)) }
        };
        positive("the straight-on factor".into(), self.straight_on)?;
        for class in [Main, Arterial, Collector, Street] {
            positive(format!("the weight of class {class}"), self.weight.of(class))?;
            let value = self.stop.of(class);
            if !(0.0..1.0).contains(&value) {
                let what = format!("the probability of stopping for class {class}");
                let expected = "at least 0 and below 1";
                return Err(OutOfRange::new(what, value, expected).into());
            }
        }
        Ok(())
    }
}
