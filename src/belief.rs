//! [`Belief`], a probability distribution over states.
//!
//! Invariant: every value is finite and at least 0, and they sum to one within 1e-9. It is checked
//! where values come from outside; `known` and `view` take values that satisfy it.

use std::ops::Range;

use crate::error::OutOfRange;

/// Largest difference from one of a sum of probabilities.
///
/// Wide enough for rounding over millions of states, and narrow enough to find a missing entry. It
/// only decides what is accepted: no value is ever changed by it.
pub const SUM_TOLERANCE: f64 = 1e-9;

/// A probability distribution over the states 0 to n − 1.
///
/// `S` is the storage of the values: [`Belief`] owns them, [`BeliefView`] borrows them from a
/// filter or from a block of posteriors; both have the same methods. Every value is finite and at
/// least 0, and they sum to one.
///
/// ```
/// use wayfix::Belief;
///
/// let belief = Belief::new(vec![0.1, 0.6, 0.3])?;
/// assert_eq!(belief.mode(), 1);
/// assert_eq!(belief.credible_set(0.85)?, [1, 2]);
/// assert!((belief.mass([0, 2])? - 0.4).abs() < 1e-15);
/// # Ok::<(), wayfix::error::OutOfRange>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Belief<S = Vec<f64>> {
    probabilities: S,
}

/// A belief that borrows its values; it is `Copy`.
pub type BeliefView<'a> = Belief<&'a [f64]>;

impl Belief {
    /// Creates a belief from probabilities, one per state.
    ///
    /// The values are kept unchanged, to the bit. O(n).
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] if `probabilities` is empty, a value is NaN, negative or infinite, or their
    /// sum differs from one by more than 1e-9.
    pub fn new(probabilities: Vec<f64>) -> Result<Self, OutOfRange> {
        let sum = sum_of_valid(&probabilities)?;
        if (sum - 1.0).abs() > SUM_TOLERANCE {
            return Err(OutOfRange::new("the sum of the probabilities", sum, "1"));
        }
        Ok(Self { probabilities })
    }

    /// Creates a belief proportional to weights of any positive scale. O(n).
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] if `weights` is empty, one is NaN, negative or infinite, or all are 0.
    pub fn from_weights(mut weights: Vec<f64>) -> Result<Self, OutOfRange> {
        sum_of_valid(&weights)?;
        let largest = weights.iter().copied().fold(0.0, f64::max);
        if largest == 0.0 {
            return Err(OutOfRange::new("the sum of the weights", 0.0, "a value above 0"));
        }
        // Divided by the maximum first: a sum of weights near the limits of a double would
        // overflow, or lose precision below the smallest normal number.
        weights.iter_mut().for_each(|w| *w /= largest);
        let sum: f64 = weights.iter().sum();
        weights.iter_mut().for_each(|w| *w /= sum);
        Ok(Self { probabilities: weights })
    }

    /// Creates the uniform distribution over `states` states.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] if `states` is 0.
    pub fn uniform(states: usize) -> Result<Self, OutOfRange> {
        if states == 0 {
            return Err(no_states());
        }
        Ok(Self { probabilities: vec![1.0 / states as f64; states] })
    }

    /// Creates the belief that gives probability one to `state`, out of `states`.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] if the state does not exist.
    pub fn certain(states: usize, state: usize) -> Result<Self, OutOfRange> {
        if states == 0 {
            return Err(no_states());
        }
        if state >= states {
            return Err(no_state(state, states));
        }
        let mut probabilities = vec![0.0; states];
        probabilities[state] = 1.0;
        Ok(Self { probabilities })
    }

    /// Probabilities, one per state.
    #[must_use]
    pub fn as_slice(&self) -> &[f64] {
        &self.probabilities
    }

    /// Moves the probabilities out.
    #[must_use]
    pub fn into_vec(self) -> Vec<f64> {
        self.probabilities
    }

    /// Creates a belief from values that are known to be a distribution.
    #[doc(hidden)]
    #[must_use]
    pub fn from_valid(probabilities: Vec<f64>) -> Self {
        Self { probabilities }
    }
}

impl<'a> Belief<&'a [f64]> {
    /// Creates a view of values that are known to be a distribution.
    #[doc(hidden)]
    #[must_use]
    pub fn view(probabilities: &'a [f64]) -> Self {
        Self { probabilities }
    }

    /// Probabilities, one per state, for as long as they are borrowed.
    #[must_use]
    pub fn as_slice(self) -> &'a [f64] {
        self.probabilities
    }
}

impl<S: AsRef<[f64]>> Belief<S> {
    /// Number of states, n.
    #[must_use]
    pub fn states(&self) -> usize {
        self.values().len()
    }

    #[doc(hidden)]
    pub fn values(&self) -> &[f64] {
        self.probabilities.as_ref()
    }

    /// Probability of one state, or `None` if the state does not exist. For the most probable state
    /// and its probability, use [`peak`](Self::peak); for the sum over some states,
    /// [`mass`](Self::mass).
    #[must_use]
    pub fn probability(&self, state: usize) -> Option<f64> {
        self.values().get(state).copied()
    }

    /// Returns the most probable state; ties go to the lowest. O(n).
    #[must_use]
    pub fn mode(&self) -> usize {
        self.peak().0
    }

    /// Returns the [mode](Self::mode) and its probability. O(n).
    ///
    /// ```
    /// let belief = wayfix::Belief::new(vec![0.1, 0.6, 0.3])?;
    /// let (place, probability) = belief.peak();
    /// assert_eq!((place, probability), (1, 0.6));
    /// # Ok::<(), wayfix::error::OutOfRange>(())
    /// ```
    #[must_use]
    pub fn peak(&self) -> (usize, f64) {
        // Strictly above, so the lowest state keeps a tie.
        let mut best = (0, f64::NEG_INFINITY);
        for (i, &p) in self.values().iter().enumerate() {
            if p > best.1 {
                best = (i, p);
            }
        }
        best
    }

    /// Shannon entropy −Σ p ln p, in nats: 0 for a certain belief, ln n for the uniform one.
    /// O(n).
    #[must_use]
    pub fn entropy(&self) -> f64 {
        // 0 ln 0 is 0. Folded from 0, so that a certain belief gives 0 and not −0.
        self.values().iter().filter(|p| **p > 0.0).fold(0.0, |sum, p| sum - p * p.ln())
    }

    /// Probability that the state is one of `states`. A state listed several times is counted each
    /// time. O(size of the set).
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] if one of them does not exist.
    pub fn mass(&self, states: impl IntoIterator<Item = usize>) -> Result<f64, OutOfRange> {
        let p = self.values();
        states.into_iter().try_fold(0.0, |sum, state| {
            let p = p.get(state).ok_or_else(|| no_state(state, p.len()))?;
            Ok(sum + p)
        })
    }

    /// Probability of the states whose index is within `radius` of `centre`: on a route, of being
    /// within that many places.
    ///
    /// Taken around the [mode](Self::mode) and compared with a threshold, it tells whether a
    /// vehicle is localised. Only indices count: a last state off the map is a neighbour like any
    /// other, and the ends of a loop are far apart ([`given`](Self::given) excludes states).
    /// O(radius).
    ///
    /// ```
    /// let belief = wayfix::Belief::new(vec![0.02, 0.3, 0.5, 0.13, 0.05])?;
    /// let localised = belief.mass_around(belief.mode(), 1)? >= 0.9;
    /// assert!(localised);
    /// # Ok::<(), wayfix::error::OutOfRange>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] if the centre does not exist.
    pub fn mass_around(&self, centre: usize, radius: usize) -> Result<f64, OutOfRange> {
        let states = self.states();
        if centre >= states {
            return Err(no_state(centre, states));
        }
        let end = centre.saturating_add(radius).saturating_add(1).min(states);
        self.mass(centre.saturating_sub(radius)..end)
    }

    /// Conditional distribution given that the state is in a range, such as the places on the map.
    /// Its states are numbered from the start of the range. O(length).
    ///
    /// ```
    /// let belief = wayfix::Belief::new(vec![0.5, 0.25, 0.25])?; // the last state is off the map
    /// assert_eq!(belief.given(1..3)?.as_slice(), [0.5, 0.5]);
    /// # Ok::<(), wayfix::error::OutOfRange>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] if a state does not exist, or the range has probability 0.
    pub fn given(&self, range: Range<usize>) -> Result<Belief, OutOfRange> {
        let values = self.values();
        let states = values.len();
        if range.is_empty() {
            return Err(no_states());
        }
        let state = range.end - 1;
        let kept = values.get(range).ok_or_else(|| no_state(state, states))?;
        Belief::from_weights(kept.to_vec())
    }

    /// Returns the smallest set of states with a total probability of at least `level`, the most
    /// probable first; ties go to the lowest.
    ///
    /// States of probability 0 are never included. O(n log n).
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] if `level` is outside 0 to 1.
    pub fn credible_set(&self, level: f64) -> Result<Vec<usize>, OutOfRange> {
        OutOfRange::check("the level", level, 0.0..=1.0, "a value from 0 to 1")?;
        let p = self.values();
        let mut order: Vec<usize> = (0..p.len()).filter(|&i| p[i] > 0.0).collect();
        order.sort_by(|&i, &j| p[j].total_cmp(&p[i])); // a stable sort keeps ties in order
        // A state is needed if those before it have not reached the level.
        let mut held = 0.0;
        let needed = order.iter().take_while(|&&i| {
            let before = held;
            held += p[i];
            before < level
        });
        let count = needed.count();
        order.truncate(count);
        Ok(order)
    }

    /// Copies the values into a belief that owns them.
    #[must_use]
    pub fn to_owned(&self) -> Belief {
        Belief { probabilities: self.values().to_vec() }
    }
}

fn no_states() -> OutOfRange {
    OutOfRange::none("the number of states of a belief")
}

fn no_state(state: usize, states: usize) -> OutOfRange {
    OutOfRange::index("the state", state, states)
}

/// Checks each value and returns the sum.
fn sum_of_valid(values: &[f64]) -> Result<f64, OutOfRange> {
    if values.is_empty() {
        return Err(no_states());
    }
    match values.iter().position(|&p| !(p >= 0.0 && p.is_finite())) {
        Some(state) => {
            let what = format!("the probability of state {state}");
            Err(OutOfRange::new(what, values[state], "a finite value of at least 0"))
        }
        None => Ok(values.iter().sum()),
    }
}

#[cfg(feature = "serde")]
impl<S: AsRef<[f64]>> serde::Serialize for Belief<S> {
    fn serialize<Out: serde::Serializer>(&self, serializer: Out) -> Result<Out::Ok, Out::Error> {
        self.values().serialize(serializer)
    }
}

#[cfg(feature = "serde")]
impl<'de> serde::Deserialize<'de> for Belief {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Self::new(Vec::deserialize(deserializer)?).map_err(crate::stored::refused)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refuses_what_is_no_distribution_and_says_where() {
        let text = |p: Vec<f64>| Belief::new(p).unwrap_err().to_string();
        assert_eq!(text(vec![]), "the number of states of a belief is 0, expected at least 1");
        assert_eq!(
            text(vec![0.5, f64::NAN]),
            "the probability of state 1 is NaN, expected a finite value of at least 0"
        );
        assert_eq!(
            text(vec![1.5, -0.5]),
            "the probability of state 1 is -0.5, expected a finite value of at least 0"
        );
        assert_eq!(text(vec![0.5, 0.4]), "the sum of the probabilities is 0.9, expected 1");
        assert_eq!(
            Belief::certain(3, 3).unwrap_err().to_string(),
            "the state is 3, expected 0 to 2"
        );
        assert!(Belief::from_weights(vec![0.0, 0.0]).is_err());
    }

    #[test]
    fn weights_near_the_limits_of_a_double_keep_their_ratio() {
        for scale in [f64::MAX, 1.0, 1e-300, f64::MIN_POSITIVE] {
            let belief = Belief::from_weights(vec![scale, scale, scale, scale]).unwrap();
            assert_eq!(belief.as_slice(), [0.25; 4], "scale {scale}");
        }
    }

    #[test]
    fn ties_go_to_the_lowest_state() {
        let belief = Belief::new(vec![0.25, 0.375, 0.375]).unwrap();
        assert_eq!(belief.mode(), 1);
        assert_eq!(belief.credible_set(0.375).unwrap(), [1]);
        assert_eq!(belief.credible_set(0.5).unwrap(), [1, 2]);
        assert_eq!(belief.credible_set(0.0).unwrap(), [0_usize; 0]);
    }

    #[test]
    fn a_credible_set_ends_where_the_level_is_reached_in_double_precision() {
        let belief = Belief::new(vec![1e-300, 0.0, 1.0]).unwrap();
        // In double precision, state 2 alone reaches 1.0.
        assert_eq!(belief.credible_set(1.0).unwrap(), [2]);
        assert!(belief.credible_set(1.1).is_err());
    }

    #[test]
    fn mass_around_a_state_stops_at_the_ends() {
        let belief = Belief::new(vec![0.5, 0.25, 0.125, 0.125]).unwrap();
        let around = |centre, radius| belief.mass_around(centre, radius).unwrap();
        assert_eq!([around(0, 0), around(0, 1), around(2, 1), around(3, 9)], [0.5, 0.75, 0.5, 1.0]);
        assert_eq!(around(1, usize::MAX), 1.0);
        assert!(belief.mass_around(4, 1).is_err());
    }

    #[test]
    fn given_a_range_what_is_left_sums_to_one() {
        let belief = Belief::new(vec![0.5, 0.125, 0.375, 0.0]).unwrap();
        assert_eq!(belief.given(1..3).unwrap().as_slice(), [0.25, 0.75]);
        assert_eq!(belief.given(0..4).unwrap().as_slice(), belief.as_slice());
        let text = |range| belief.given(range).unwrap_err().to_string();
        assert_eq!(text(2..5), "the state is 4, expected 0 to 3");
        assert_eq!(text(3..4), "the sum of the weights is 0, expected a value above 0");
        assert!(belief.given(2..2).is_err() && belief.given(9..9).is_err());
    }

    #[test]
    fn entropy_is_zero_when_certain_and_ln_n_when_uniform() {
        assert_eq!(Belief::certain(5, 2).unwrap().entropy().to_bits(), 0.0_f64.to_bits());
        assert!((Belief::uniform(8).unwrap().entropy() - 8f64.ln()).abs() < 1e-15);
    }
}
