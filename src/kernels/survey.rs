//! What likelihoods are like: whether they can be used as they are.

use super::abreast::Abreast;
use super::lanes::{Eight, Kernel, Lanes, run};

/// What the likelihoods of some steps are like.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Survey {
    /// The least value above 0.
    pub(crate) least: f64,
    /// The largest value, and the largest of the step in which that is least.
    pub(crate) largest: f64,
    pub(crate) least_largest: f64,
    /// Whether one is NaN.
    pub(crate) nan: bool,
}

pub(super) struct Look<'a, const N: usize>(pub(super) &'a [[Abreast; N]]);

impl<const N: usize> Kernel for Look<'_, N> {
    type Output = Survey;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Survey {
        let (zero, infinity) = (lanes.splat(0.0), lanes.splat(f64::INFINITY));
        let (mut least, mut largest, mut least_largest) = (infinity, zero, infinity);
        let mut sum = zero; // NaN if one is
        for step in self.0 {
            let first = lanes.load(&step[0]);
            let above = lanes.select(lanes.equal(first, zero), infinity, first);
            let (mut lowest, mut most, mut total) = (above, first, first);
            for b in &step[1..] {
                let b = lanes.load(b);
                let above = lanes.select(lanes.equal(b, zero), infinity, b);
                lowest = lanes.min(above, lowest);
                most = lanes.max(b, most);
                total = lanes.add(total, b);
            }
            least = lanes.min(lowest, least);
            sum = lanes.add(sum, total);
            largest = lanes.max(most, largest);
            least_largest = lanes.min(most, least_largest);
        }
        let lowest = |lanes: Eight| lanes.into_iter().fold(f64::INFINITY, f64::min);
        Survey {
            least: lowest(lanes.to_array(least)),
            largest: lanes.to_array(largest).into_iter().fold(0.0, f64::max),
            least_largest: lowest(lanes.to_array(least_largest)),
            nan: lanes.to_array(sum).into_iter().any(f64::is_nan),
        }
    }
}

/// Looks at likelihoods.
pub(crate) fn look<const N: usize>(likelihoods: &[[Abreast; N]]) -> Survey {
    run(Look(likelihoods))
}
