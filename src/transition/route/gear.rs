//! How a vehicle moves along a route while it is in one gear.

use std::ops::RangeInclusive;

use super::super::{check_count, check_sum};
use crate::error::TransitionError;

/// A way of moving along a route: how many places on, with which probability.
/// Standing, reversing, half speed, one on, two on, or anything.
///
/// ```
/// use wayfix::Gear;
///
/// let slow = Gear::speed(0.5, 0.125)?;
/// assert_eq!(slow.first(), -1);
/// assert_eq!(slow.weights(), [0.125, 0.375, 0.375, 0.125]);
/// # Ok::<(), wayfix::TransitionError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Gear {
    first: isize,
    weights: Vec<f64>,
}

/// The longest move: differences of places and moves are then far from the
/// range of an `isize` of 32 bits.
const FARTHEST: i32 = 1 << 30;

impl Gear {
    /// The vehicle goes on by `first` + d places with probability `weights[d]`.
    /// Zeros at either end are left out.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Parameter`] for a weight that is NaN, negative or
    /// infinite, or above 0 and below 2.2e-308 (it may be the only one that odometry
    /// leaves), for weights that do not sum to one within 1e-9, or for a move of more
    /// than 2^30 places.
    pub fn new(first: isize, weights: &[f64]) -> Result<Self, TransitionError> {
        check_sum(weights, "the sum of the weights of a gear".into(), |d| {
            format!("the weight of move {}", first.saturating_add_unsigned(d))
        })?;
        if let Some((d, value)) = weights.iter().enumerate().find(|entry| entry.1.is_subnormal()) {
            return Err(TransitionError::Parameter {
                what: format!("the weight of move {}", first.saturating_add_unsigned(d)),
                value: *value,
                expected: "0, or at least 2.2250738585072014e-308",
            });
        }
        let leading = weights.iter().take_while(|weight| **weight == 0.0).count();
        let trailing = weights.iter().rev().take_while(|weight| **weight == 0.0).count();
        let weights = weights[leading..weights.len() - trailing].to_vec();
        let first = first.saturating_add_unsigned(leading);
        let gear = Self { first, weights };
        let ends = [*gear.moves().start(), *gear.moves().end()];
        if let Some(far) = ends.iter().find(|m| m.unsigned_abs() > FARTHEST as usize) {
            let (what, value) = ("a move of a gear".into(), *far as f64);
            let expected = "a move within 1073741824 places";
            return Err(TransitionError::Parameter { what, value, expected });
        }
        Ok(gear)
    }

    /// Goes on by `speed` places a step, on average: the two nearest whole
    /// moves share 1 − 2 `slack` by linear interpolation (a whole speed has
    /// one), and each neighbour of these has `slack`.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Parameter`] unless the speed is below 2^30 − 1 in
    /// size, and the slack at least 0 and below 0.5.
    pub fn speed(speed: f64, slack: f64) -> Result<Self, TransitionError> {
        let fastest = f64::from(FARTHEST) - 1.0;
        if !(-fastest..fastest).contains(&speed) {
            return Err(TransitionError::Parameter {
                what: "the speed of a gear".into(),
                value: speed,
                expected: "a value within 1073741823 places a step",
            });
        }
        if !(0.0..0.5).contains(&slack) {
            return Err(TransitionError::Parameter {
                what: "the slack of a gear".into(),
                value: slack,
                expected: "a value of at least 0 and below 0.5",
            });
        }
        let (below, rest) = (speed.floor(), 1.0 - 2.0 * slack);
        let share = speed - below;
        let first = below as isize - 1;
        if share == 0.0 {
            Self::new(first, &[slack, rest, slack])
        } else {
            Self::new(first, &[slack, rest * (1.0 - share), rest * share, slack])
        }
    }

    /// Every move of these is as likely as the others.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Parameter`] for no moves, or for one of more than 2^30
    /// places.
    pub fn uniform(moves: RangeInclusive<isize>) -> Result<Self, TransitionError> {
        let count = moves.end().abs_diff(*moves.start());
        if moves.is_empty() {
            return Err(TransitionError::Parameter {
                what: "the number of moves of a gear".into(),
                value: 0.0,
                expected: "at least 1",
            });
        }
        let count = count.saturating_add(1);
        check_count("moves", count)?;
        Self::new(*moves.start(), &vec![1.0 / count as f64; count])
    }

    /// The first move of which the probability is above 0.
    #[must_use]
    pub fn first(&self) -> isize {
        self.first
    }

    /// The probabilities of the moves from the first on.
    #[must_use]
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }

    pub(super) fn moves(&self) -> RangeInclusive<isize> {
        self.first..=self.first.saturating_add_unsigned(self.weights.len() - 1)
    }
}
