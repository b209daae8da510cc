//! Errors of wheels that last, and an odometer that accounts for them.
//!
//! The scale of an odometer is a hidden chain. Each of m coins is turned over at a rate; the scale
//! is 1 + d (heads − tails) / √m, an Ornstein–Uhlenbeck process on m + 1 values (Ehrenfest's urn),
//! whose stationary distribution is binomial. There is an odometer for each scale: readings divided
//! by the scale, released in whole cells. Each starts at another place in the cell, so that they do
//! not release at the same time.

use std::sync::Arc;

use super::odometer::{Odometer, Slips};
use super::travel::{Travel, check_reading};
use wayfix::TransitionError;
use wayfix::error::OutOfRange;

/// Number of coins, m.
const COINS: usize = 8;
/// Largest deviation of the scale: the smallest scale is then 0.43.
const MOST: f64 = 0.2;
/// Largest mean loss of a slip, in cells.
const MOST_SLIPPED: f64 = 1000.0;

/// Errors of the wheels of a vehicle on [cells of roads](crate::cells::RoadCells), for a
/// [`WheelTransition`](super::WheelTransition).
///
/// Noise that is new in each reading averages out over a drive; these do not:
///
/// - **Scale.** Tyres are never quite as large as they are taken to be, which makes all readings of
///   a drive wrong by the same factor. After a hundred metres an error of 2% is 2 m, while noise of
///   3 cm in each metre is 30 cm. The scale is hidden, and is learned while driving: it has [nine
///   values](super::WheelTransition::scales), binomial around 1 with the given deviation, and
///   changes slowly.
/// - **Slips.** Now and then wheels turn, and the vehicle does not move as far. Slips come at
///   random, and each takes a random number of metres (exponentially distributed, in whole cells
///   geometrically) off the distance.
///
/// The default is for wheels that nobody has calibrated.
///
/// ```
/// use wayfix_roads::cells::Wheels;
///
/// // Calibrated last week, on a floor that is wet in places.
/// let wheels = Wheels { scale: 0.01, slips: 0.05, ..Wheels::default() };
/// assert_eq!(wheels.slipped, 0.1);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct Wheels {
    /// Standard deviation of the scale, the metres read for each metre driven, among vehicles and
    /// days: from 0 (the scale is 1) to 0.2. Scales up to 2.8 deviations from 1 can be found.
    pub scale: f64,
    /// Metres over which the correlation of the scale falls to 1/e. Above 0; if infinite, the scale
    /// never changes.
    pub lasts: f64,
    /// Slips per metre, from 0 to 1,000. Together they may take off at most half of the metres.
    pub slips: f64,
    /// Mean metres by which a slip shortens the distance; above 0, at most 1,000 cells.
    pub slipped: f64,
}

impl Default for Wheels {
    /// A scale with a deviation of 2% that lasts for 2 km, and a slip of 10 cm in 50 m.
    fn default() -> Self {
        Self { scale: 0.02, lasts: 2000.0, slips: 0.02, slipped: 0.1 }
    }
}

impl Wheels {
    /// Checks the numbers, for cells of a length in metres.
    pub(super) fn check(&self, cell: f64) -> Result<(), TransitionError> {
        let Self { scale, lasts, slips, slipped } = *self;
        let wrong = |what: &str, value, expected| {
            Err(OutOfRange::new(what.to_owned(), value, expected).into())
        };
        if !(0.0..=MOST).contains(&scale) {
            return wrong("the deviation of the wheels' scale", scale, "a value from 0 to 0.2");
        }
        if lasts.is_nan() || lasts <= 0.0 {
            return wrong("the distance over which the scale lasts", lasts, "metres above 0");
        }
        if !(0.0..=1000.0).contains(&slips) {
            return wrong("the number of slips in a metre", slips, "a value from 0 to 1000");
        }
        if !(slipped > 0.0 && slipped <= MOST_SLIPPED * cell) {
            return wrong("the metres lost in a slip", slipped, "above 0, at most 1000 cells");
        }
        if slips * slipped > 0.5 {
            let what = "the part of the metres lost in slips";
            return wrong(what, slips * slipped, "at most a half");
        }
        Ok(())
    }

    /// Scales, ascending.
    pub(super) fn scales(&self) -> Vec<f64> {
        if self.scale == 0.0 {
            return vec![1.0];
        }
        let (m, step) = (COINS as f64, self.scale / (COINS as f64).sqrt());
        (0..=COINS).map(|heads| 1.0 + step * (2.0 * heads as f64 - m)).collect()
    }

    /// Stationary probabilities of the scales.
    pub(super) fn shares(&self) -> Vec<f64> {
        if self.scale == 0.0 { vec![1.0] } else { binomial(COINS, 0.5) }
    }

    /// Probabilities of a scale after some metres, given the scale before: `[to * count + from]`.
    pub(super) fn changes(&self, metres: f64) -> Vec<f64> {
        if self.scale == 0.0 {
            return vec![1.0];
        }
        // Probability that a coin is turned over an odd number of times: (1 − e^(−metres / lasts))
        // / 2.
        let turned = -0.5 * (-metres / self.lasts).exp_m1();
        let count = COINS + 1;
        let mut changes = vec![0.0; count * count];
        for from in 0..count {
            // Heads after the step: those of the `from` heads that stay, and the tails that turn.
            let (kept, new) = (binomial(from, 1.0 - turned), binomial(COINS - from, turned));
            for (a, p) in kept.iter().enumerate() {
                for (b, q) in new.iter().enumerate() {
                    changes[(a + b) * count + from] += p * q;
                }
            }
        }
        changes
    }
}

/// Probabilities of the number of heads among some coins.
fn binomial(coins: usize, p: f64) -> Vec<f64> {
    let mut all = vec![0.0; coins + 1];
    all[0] = 1.0;
    for last in 1..=coins {
        // Downwards, so that `all[at - 1]` still holds the probability for one coin fewer.
        for at in (0..=last).rev() {
            let before = if at > 0 { all[at - 1] } else { 0.0 };
            all[at] = (1.0 - p) * all[at] + p * before;
        }
    }
    all
}

/// Distance driven in a step at each scale of [`Wheels`], and the change of the scale. The control
/// of a [`WheelTransition`](super::WheelTransition), from a [`WheelOdometer`]; cheap to clone.
#[derive(Debug, Clone, PartialEq)]
pub struct WheelTravel {
    steps: Arc<Steps>,
}

#[derive(Debug, PartialEq)]
struct Steps {
    travels: Vec<Travel>,
    /// Probabilities of a scale given the one before, `[to * count + from]`; empty if scales stay.
    changes: Vec<f64>,
}

impl WheelTravel {
    fn new(travels: Vec<Travel>, changes: Vec<f64>) -> Self {
        Self { steps: Arc::new(Steps { travels, changes }) }
    }

    /// Distances by scale.
    #[must_use]
    pub fn travels(&self) -> &[Travel] {
        &self.steps.travels
    }

    /// Probability of a scale after the step, given the one before; 0 if either does not exist.
    #[must_use]
    pub fn change(&self, to: usize, from: usize) -> f64 {
        let count = self.steps.travels.len();
        if to >= count || from >= count {
            return 0.0;
        }
        match self.steps.changes.as_slice() {
            [] => f64::from(u8::from(to == from)),
            changes => changes[to * count + from],
        }
    }

    /// True if scales may change.
    pub(super) fn is_changing(&self) -> bool {
        !self.steps.changes.is_empty()
    }
}

/// Odometer of a vehicle on cells whose wheels have errors that last: an [`Odometer`] for each
/// scale of the [wheels](Wheels), which adds up the readings divided by its scale.
///
/// Each scale releases whole cells at times of its own and starts from another place in the cell,
/// so together they know the position more finely than to a cell: the belief in a cell rises and
/// falls gradually while the vehicle drives through it.
///
/// A vehicle may be anywhere in its cell, so even noise far smaller than a cell takes some vehicles
/// into the next: each cell driven adds more variance than its noise has, the same at any rate of
/// readings. The smaller the cells, the less this costs. On simulated aisles of 2 m with tags read
/// within 40 cm and cells of 25 cm, at scale errors from 0 to 5%, an edge with a probability of
/// 0.95 or more was right in 98% of ticks or more; with cells of 1 m, in 76 to 86%, though sets of
/// 95% hold the vehicle's cell in 97% there, too. Give position fixes with 0 m ahead.
///
/// Made by [`WheelTransition::odometer`](super::WheelTransition::odometer). A reading costs O(k)
/// for k scales, and where cells are released, O(k³) for the changes of the scale.
#[derive(Debug, Clone, PartialEq)]
pub struct WheelOdometer {
    wheels: Wheels,
    scales: Vec<f64>,
    odometers: Vec<Odometer>,
    /// Buffer for the odometers before a reading.
    before: Vec<Odometer>,
    cell: f64,
    /// Metres since the scale last changed.
    metres: f64,
    still: WheelTravel,
}

impl WheelOdometer {
    pub(super) fn new(wheels: Wheels, odometer: &Odometer, cell: f64) -> Self {
        let scales = wheels.scales();
        let count = scales.len();
        let slips = Slips { rate: wheels.slips, metres: wheels.slipped };
        let start = |number: usize| odometer.clone().slipping(slips, cell * place(number, count));
        let odometers: Vec<Odometer> = (0..count).map(start).collect();
        let still = WheelTravel::new(vec![Travel::still(); count], Vec::new());
        Self { wheels, scales, before: odometers.clone(), odometers, cell, metres: 0.0, still }
    }

    /// Adds a reading in metres with the variance of its noise, in square metres, and returns the
    /// control of the step: no distance, until there is a cell to be released. The variance covers
    /// only noise that is new in each reading; scale and slips are those of the wheels.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Control`] unless the metres are finite, and the variance finite and at
    /// least 0; [`TransitionError::Parameter`] for more than 10,000,000 cells. Nothing is added
    /// then.
    pub fn add(&mut self, metres: f64, variance: f64) -> Result<WheelTravel, TransitionError> {
        check_reading(metres, variance)?;
        // All odometers add a reading or none does: a copy is restored on an error.
        self.before.clone_from(&self.odometers);
        let mut moved: Option<Vec<Travel>> = None;
        for number in 0..self.scales.len() {
            let scale = self.scales[number];
            match self.odometers[number].add(metres / scale, variance / (scale * scale)) {
                Ok(travel) if travel.last() > 0 => {
                    moved.get_or_insert_with(|| self.still.travels().to_vec())[number] = travel;
                }
                Ok(_) => {}
                Err(error) => {
                    std::mem::swap(&mut self.odometers, &mut self.before);
                    return Err(error);
                }
            }
        }
        self.metres += metres.abs();
        let Some(travels) = moved else { return Ok(self.still.clone()) };
        // The change of scale depends only on the metres driven, so it can wait until a cell was
        // driven and something moves. Its O(k³), for k scales, are then paid at most once a cell.
        let mut changes = Vec::new();
        if self.metres >= self.cell && self.scales.len() > 1 {
            changes = self.wheels.changes(self.metres);
            self.metres = 0.0;
        }
        Ok(WheelTravel::new(travels, changes))
    }

    /// Metres by which a vehicle whose wheels have this scale is ahead of the middle of each cell;
    /// see [`Odometer::ahead`].
    ///
    /// # Panics
    ///
    /// If the scale does not exist.
    #[must_use]
    pub fn ahead(&self, scale: usize) -> f64 {
        self.odometers[scale].ahead()
    }

    /// Forgets the metres not yet released, for a vehicle that was carried elsewhere.
    pub fn reset(&mut self) {
        let count = self.scales.len();
        for (number, odometer) in self.odometers.iter_mut().enumerate() {
            odometer.restart(self.cell * place(number, count));
        }
    }
}

/// Place in its cell where a scale starts, from −½ to ½: places are spread evenly, and those of
/// neighbouring scales lie far apart.
fn place(number: usize, count: usize) -> f64 {
    // For an odd count, ⌊count / 2⌋ and the count have no common divisor: multiples modulo the
    // count visit every place once, in strides of nearly half a cell.
    let turn = count / 2;
    let place = if count > 1 { number * turn % count } else { 0 };
    (place as f64 + 0.5) / count as f64 - 0.5
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scale_is_a_stationary_process_of_its_deviation() {
        let wheels = Wheels { scale: 0.03, lasts: 500.0, ..Wheels::default() };
        let (scales, shares) = (wheels.scales(), wheels.shares());
        let mean: f64 = scales.iter().zip(&shares).map(|(s, p)| p * s).sum();
        let variance: f64 = scales.iter().zip(&shares).map(|(s, p)| p * (s - 1.0).powi(2)).sum();
        assert!((mean - 1.0).abs() < 1e-12 && (variance.sqrt() - 0.03).abs() < 1e-12);
        let count = scales.len();
        let changes = wheels.changes(200.0);
        let mut covariance = 0.0;
        for to in 0..count {
            let row = (0..count).map(|from| changes[to * count + from] * shares[from]);
            assert!((row.sum::<f64>() - shares[to]).abs() < 1e-15);
            for from in 0..count {
                let p = changes[to * count + from] * shares[from];
                covariance += p * (scales[to] - 1.0) * (scales[from] - 1.0);
            }
        }
        assert!((covariance / variance - (-0.4_f64).exp()).abs() < 1e-12);
        // Changes add up.
        let (once, twice) = (wheels.changes(7.0), wheels.changes(14.0));
        for to in 0..count {
            for from in 0..count {
                let sum: f64 =
                    (0..count).map(|by| once[to * count + by] * once[by * count + from]).sum();
                assert!((sum - twice[to * count + from]).abs() < 1e-15);
            }
        }
    }
}
