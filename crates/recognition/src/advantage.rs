//! How much better views match on the map than off it, learned as the vehicle drives
//! (`guide::formulas`, Off the map).

/// Number of views of a stretch: successive views err together, so single ones say little. The first
/// stretch is left out, since the vehicle is still being located.
const STRETCH: f64 = 10.0;
/// Number of standard deviations below the mean that few stretches on the map fall short of.
const RARE: f64 = 1.8;
/// Prior of the mean and the mean square over stretches: it counts as this many views of mean 0,
/// with this mean square.
const PRIOR_COUNT: f64 = 3.0;
const PRIOR_SQUARE: f64 = 0.25;

/// Log-likelihoods of views at the vehicle's place, minus those at the phantom's: their mean and
/// mean square over stretches of views, weighted by the probability that the vehicle is on the map
/// and the camera attentive.
///
/// Off the map, and while distracted, the camera follows a phantom, so the vehicle's place matches no
/// better. On the map, a vehicle with a clear camera matches better in all stretches, so a stretch
/// in which it does not is evidence that it has left. A weak camera gives no such evidence.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub(crate) struct Advantage {
    /// Mean over the last stretch.
    recent: f64,
    /// Number of views; and sums, after the first stretch, of the means of stretches and of their
    /// squares.
    views: f64,
    sum: f64,
    squares: f64,
}

impl Default for Advantage {
    fn default() -> Self {
        Self { recent: 0.0, views: 0.0, sum: 0.0, squares: PRIOR_COUNT * PRIOR_SQUARE }
    }
}

impl Advantage {
    /// Takes the log-likelihoods of a view at the vehicle's place and at the phantom's.
    pub(crate) fn observe(&mut self, weight: f64, place: f64, phantom: f64) {
        let advantage = place - phantom;
        if !(weight > 0.0 && advantage.is_finite()) {
            return;
        }
        self.views += weight;
        self.recent += weight * (advantage - self.recent) / STRETCH.min(1.0 + self.views);
        if self.views > STRETCH {
            self.sum += weight * self.recent;
            self.squares += weight * self.recent * self.recent;
        }
    }

    /// Advantage that nearly all stretches on the map have; 0 if some have none.
    pub(crate) fn least(&self) -> f64 {
        let count = (self.views - STRETCH).max(0.0) + PRIOR_COUNT;
        let mean = self.sum / count;
        let variance = (self.squares / count - mean * mean).max(0.0);
        (mean - RARE * variance.sqrt()).max(0.0)
    }

    /// Checks sums read from storage.
    #[cfg(feature = "serde")]
    pub(crate) fn checked(self) -> Result<Self, String> {
        let Self { recent, views, sum, squares } = self;
        // Odds of places and of the phantom are within a factor e^71 of each other.
        let in_range = recent.abs() <= 100.0 && (0.0..=1e15).contains(&views);
        let (sums, all) = (100.0 * (views + 1.0), 1e4 * (views + 1.0));
        if in_range && sum.abs() <= sums && (0.0..=all).contains(&squares) {
            return Ok(self);
        }
        Err(format!("{self:?}, expected sums of means from -100 to 100"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clear_camera_has_an_advantage_in_all_stretches() {
        let mut clear = Advantage::default();
        let mut weak = Advantage::default();
        assert_eq!(clear.least(), 0.0);
        for k in 0..200_u32 {
            let noise = f64::from(k % 7) - 3.0;
            clear.observe(1.0, 2.0 + 0.3 * noise, 0.0);
            // None for stretches of twenty views.
            let shows = f64::from(u8::from(k % 40 < 20));
            weak.observe(1.0, 1.5 * shows + 0.3 * noise, 0.1);
        }
        assert!((1.0..2.0).contains(&clear.least()), "{clear:?}");
        assert_eq!(weak.least(), 0.0);
        // Nothing is learned while the vehicle is off the map, nor from a view that rules out all.
        let before = clear;
        clear.observe(0.0, -3.0, 0.0);
        clear.observe(1.0, f64::NEG_INFINITY, 0.0);
        assert_eq!(clear, before);
    }
}
