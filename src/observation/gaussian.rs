//! The Gaussian superimposed on the discrete part (paper eqs. 2 to 4). Each row of the sum is
//! divided by its own sum, whatever the numbering does to the Gaussian at the ends.

use std::f64::consts::TAU;

use super::Confusion;
use crate::error::OutOfRange;
use crate::likelihood::TableLikelihood;
use crate::map::{Coordinates, RoadMap};
use wayfix_kernels as kernels;

/// Distance between two places, for the Gaussian part of a sensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Metric {
    /// Difference of the places' indices, as in the paper (eq. 3). Accuracy then depends on how
    /// places are numbered.
    Index,
    /// Number of roads between the places, in either direction.
    Hops,
    /// Straight distance in metres.
    Metres,
}

impl Metric {
    /// Distances from place i to all places, infinite to those that cannot be reached.
    fn distances<P: Coordinates>(self, map: &RoadMap<P>, i: usize) -> Vec<f64> {
        let n = map.places().len();
        match self {
            Self::Index => (0..n).map(|j| i.abs_diff(j) as f64).collect(),
            Self::Hops => {
                let hops = map.hops_either_way(i);
                hops.into_iter().map(|hops| hops.map_or(f64::INFINITY, f64::from)).collect()
            }
            Self::Metres => {
                let here = map.places()[i].position;
                map.places().iter().map(|place| here.metres_to(place.position)).collect()
            }
        }
    }
}

impl Confusion {
    /// Returns the whole sensor: P(j | i) = (P_c(j | i) + G(j; i)) / (1 + Σ_j G(j; i)), with a
    /// Gaussian G of the distance between places i and j and the standard deviation `sigma`, in the
    /// unit of the metric.
    ///
    /// With [`Metric::Index`] G is the density of eq. 3 with this σ, and this is the paper's
    /// sensor: eq. 4's δ is read as the normalising sum, which divides. In hops and metres places
    /// are not one unit apart, so there G is scaled to sum to one over all places: it weighs as
    /// much as P_c, whatever the unit.
    ///
    /// Its tails reach down to 1e-320. A model that need not keep them is faster
    /// [`with_rounded_tails`](crate::Hmm::with_rounded_tails).
    ///
    /// O(n²), and for hops O(n (places + roads)).
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] unless `sigma` is finite and above 0, or if the map has a
    /// different number of places.
    pub fn with_gaussian<P: Coordinates>(
        &self,
        map: &RoadMap<P>,
        metric: Metric,
        sigma: f64,
    ) -> Result<TableLikelihood, OutOfRange> {
        if !(sigma > 0.0 && sigma.is_finite()) {
            let (what, expected) = ("sigma", "a finite value above 0");
            return Err(OutOfRange::new(what, sigma, expected));
        }
        if map.places().len() != self.places() {
            let (what, found) = ("the number of places of the map", map.places().len());
            return Err(OutOfRange::count(what, found, self.places()));
        }
        let mut rows = Vec::with_capacity(self.places());
        for i in 0..self.places() {
            let mut row = self.row(i);
            let distances = metric.distances(map, i);
            let mut gaussian: Vec<f64> =
                distances.iter().map(|d| (-0.5 * (d / sigma).powi(2)).exp()).collect();
            let height = match metric {
                Metric::Index => 1.0 / (TAU.sqrt() * sigma),
                // Place i itself adds 1, so the sum is not 0.
                Metric::Hops | Metric::Metres => 1.0 / kernels::sum(&gaussian),
            };
            gaussian.iter_mut().for_each(|g| *g *= height);
            // The row of P_c sums to one.
            let normalizer = 1.0 + kernels::sum(&gaussian);
            row.iter_mut().zip(&gaussian).for_each(|(p, g)| *p = (*p + g) / normalizer);
            rows.push(row);
        }
        TableLikelihood::from_rows(&rows)
    }
}
