//! Sum of short readings, released in whole cells. Metres released and metres kept add up to the
//! metres read, and so do their variances.

use super::Travel;
use super::slips::{Slips, rounded};
use wayfix::TransitionError;

/// Number of deviations by which a release must be above 0, so that hardly any probability is left
/// for having driven less than nothing.
const DEVIATIONS: f64 = 3.0;
/// Cells over which a vehicle that may be anywhere in its cell keeps its place there. Chosen on
/// simulated grids: with 1, a belief between rare fixes is far too wide; with 16, sets of 95% hold
/// 94% where cells are as large as the range of a tag.
const TOGETHER: f64 = 4.0;

/// Odometer of a vehicle on cells: adds up readings of any size, and releases whole cells.
///
/// A reading that is short against a cell does not say that the vehicle is in the next one. Moving
/// a part of the belief there, as small as the reading against the cell, has the right mean, but
/// adds variance at each tick: 22 m after 100 m on cells of 5 m. But the reading is the same for
/// all cells that the vehicle may be in, so each hypothesis is equally far ahead of its cell. The
/// metres that do not make up a cell are therefore kept here, once for all, with their variance:
/// the position along the road is the middle of the cell plus [`ahead`](Self::ahead) metres, at
/// most half a cell either way. A release is a whole number of cells with the variance added up, so
/// the belief spreads by that variance and nothing else, whatever the rate.
///
/// Made by [`CellTransition::odometer`](super::CellTransition::odometer). If the deviation is more
/// than a third of the cells to be released, as with a bad odometer over one cell, they are kept
/// longer.
///
/// **Cells are taken to be small** against what the variance adds up to between two looks at the
/// map: the vehicle keeps its place in the cell, so one that was at its edge may be in the next
/// without the belief knowing. On aisles of 2 m with cells of 1 m and noise of 3 cm in each metre,
/// sets of 95% held the vehicle's cell in 80% of ticks. A [`WheelOdometer`](super::WheelOdometer)
/// accounts for this.
///
/// **Backwards**: negative metres are subtracted, which is exact as long as the vehicle returns the
/// same way. Reversing past a junction and taking another road there is not modelled.
///
/// ```
/// use wayfix_roads::NetworkBuilder;
/// use wayfix::map::{PlanePosition, RoadClass};
/// use wayfix_roads::cells::RoadCells;
/// use wayfix_roads::cells::{CellTransition, TurnWeights};
///
/// let mut builder = NetworkBuilder::new();
/// builder.node(1, PlanePosition { x: 0.0, y: 0.0 })?;
/// builder.node(2, PlanePosition { x: 100.0, y: 0.0 })?;
/// builder.both_ways(1, 2, RoadClass::Street)?;
/// let cells = RoadCells::new(builder.build()?, 5.0)?;
/// let motion = CellTransition::new(&cells, &TurnWeights::default())?;
///
/// let mut odometer = motion.odometer();
/// // 60 ticks of 5 cm: more than half a cell, which is then released.
/// let driven: f64 = (0..60).map(|_| odometer.add(0.05, 1e-6).unwrap().mean()).sum();
/// assert!((driven - 1.0).abs() < 1e-9);
/// assert!((odometer.ahead() + 2.0).abs() < 1e-9); // 3 m driven, 5 m released
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Odometer {
    cell: f64,
    rounding: f64,
    ahead: f64,
    variance: f64,
    /// Slips of wheels, if the vehicle is anywhere in its cell rather than in the middle.
    slips: Option<Slips>,
    still: Travel,
}

impl Odometer {
    pub(super) fn new(cell: f64, rounding: f64) -> Self {
        Self { cell, rounding, ahead: 0.0, variance: 0.0, slips: None, still: Travel::still() }
    }

    /// Sets slips of wheels, and the metres ahead to start from. The vehicle may be anywhere in its
    /// cell.
    pub(super) fn slipping(self, slips: Slips, ahead: f64) -> Self {
        Self { slips: Some(slips), ahead, ..self }
    }

    /// Adds a reading in metres with the variance of its error, in square metres, and returns the
    /// control of the step: no distance, until there is a cell to be released.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Control`] unless the metres are finite, and the variance finite and at
    /// least 0; [`TransitionError::Parameter`] for more than 10,000,000 cells. Nothing is added
    /// then.
    pub fn add(&mut self, metres: f64, variance: f64) -> Result<Travel, TransitionError> {
        check(metres, variance)?;
        // Nothing is stored before all checks have passed, so an error leaves the odometer as it
        // was.
        let (ahead, variance) = (self.ahead + metres, self.variance + variance);
        check(ahead, variance)?;
        // Rounded to the nearest cell: what is kept is at most half a cell either way.
        let cells = (ahead / self.cell + 0.5).floor();
        let all = (variance + cells.max(0.0) * self.cell * self.rounding) / self.cell.powi(2);
        let travel = if cells >= 1.0 && cells >= DEVIATIONS * all.sqrt() {
            let travel = match &self.slips {
                None => Travel::measured(cells, all, &[1.0])?,
                Some(slips) => {
                    let lost = slips.lost(cells * self.cell, self.cell);
                    // `TOGETHER` cells are rounded at once, and a release of n cells counts as n /
                    // TOGETHER of them: the sum is the same whether cells are released together or
                    // one by one.
                    let all = cells / TOGETHER * rounded(TOGETHER * all / cells);
                    Travel::measured(cells, all, &lost)?
                }
            };
            (self.ahead, self.variance) = (ahead - cells * self.cell, 0.0);
            travel
        } else {
            (self.ahead, self.variance) = (ahead, variance);
            self.still.clone()
        };
        Ok(travel)
    }

    /// Metres added and not yet released: how far the vehicle is ahead of the middle of its cell.
    /// From minus half a cell to half a cell, unless it reversed, or the variance is large.
    #[must_use]
    pub fn ahead(&self) -> f64 {
        self.ahead
    }

    /// Variance of the metres ahead, in square metres.
    #[must_use]
    pub fn variance(&self) -> f64 {
        self.variance
    }

    /// Forgets the metres not yet released, for a vehicle that was carried elsewhere.
    pub fn reset(&mut self) {
        self.restart(0.0);
    }

    /// Forgets the metres not yet released, and starts this many metres ahead.
    pub(super) fn restart(&mut self, ahead: f64) {
        (self.ahead, self.variance) = (ahead, 0.0);
    }
}

/// Checks a reading; the metres may be negative.
pub(super) fn check(metres: f64, variance: f64) -> Result<(), TransitionError> {
    if !metres.is_finite() {
        let text = format!("{metres} metres driven, expected a finite value");
        return Err(TransitionError::Control(text));
    }
    if !(variance >= 0.0 && variance.is_finite()) {
        let text = format!("a variance of {variance} of the metres driven, expected 0 or more");
        return Err(TransitionError::Control(text));
    }
    Ok(())
}
