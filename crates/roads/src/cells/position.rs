//! Positions measured on cells of roads, as by a satellite receiver: a Student density, along the
//! cell and across it.
//!
//! Cells are compared by their middles, projected to the plane of the map with their directions and
//! lengths. Middles are sorted by squares of a grid, so that a row of squares is a run of the
//! sorted points, and a pruned filter finds the cells near a fix without visiting the others.

use std::marker::PhantomData;
use std::sync::Arc;

use crate::NetworkError;
use crate::cells::RoadCells;
use wayfix::error::OutOfRange;
use wayfix::internal::wrapped;
use wayfix::likelihood::LocalLikelihood;
use wayfix::map::{Coordinates, Position};
use wayfix::{Diagonal, Likelihood, LikelihoodError, Scratch};

/// Distance, in deviations, within which cells stand out.
const NEAR: f64 = 10.0;

/// A measured position with its deviation, the observation of a [`PositionLikelihood`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PositionFix<P = Position> {
    /// Measured position.
    pub position: P,
    /// Standard deviation of each coordinate in metres; above 0 and finite. It should not be below
    /// that of the map's lines.
    pub deviation: f64,
    /// Metres by which the vehicle is ahead of the middle of each cell, as known to an
    /// [`Odometer`](crate::cells::Odometer::ahead); otherwise 0.
    pub ahead: f64,
}

impl<P> PositionFix<P> {
    /// Creates a fix, 0 m ahead.
    #[must_use]
    pub fn new(position: P, deviation: f64) -> Self {
        Self { position, deviation, ahead: 0.0 }
    }
}

/// A sensor of positions on [cells of roads](RoadCells): the density of a fix at each cell, with
/// heavy tails.
///
/// The vehicle is somewhere in its cell, which adds ℓ² / 12 to the variance along a cell of ℓ
/// metres. With the distance d in metres from the middle of the cell to the fix, along the road and
/// across, the density is that of a Student distribution with ν degrees of freedom:
///
/// ```text
/// q = d_along² / (s² + ℓ² / 12) + d_across² / s²
/// b = (1 + q / ν)^(−(ν + 2) / 2) / (2π s √(s² + ℓ² / 12))
/// ```
///
/// With ν = 3, the default, a fix 10 deviations off counts 1/6,000 of a good one, so a few
/// reflected signals don't outweigh what was known. Errors of fixes persist: a fix is hardly a
/// witness beside that of the second before. Use a larger deviation, or fewer fixes.
///
/// Distances are in the plane around the fix. O(n) for all cells; as a [`LocalLikelihood`], O(cells
/// asked for + cells within ten deviations). Memory: 48 bytes a cell.
///
/// ```
/// use wayfix_roads::NetworkBuilder;
/// use wayfix::map::{Position, RoadClass};
/// use wayfix_roads::cells::RoadCells;
/// use wayfix_roads::cells::{CellTransition, TurnWeights};
/// use wayfix_roads::cells::{PositionFix, PositionLikelihood};
/// use wayfix::{Belief, Hmm, Prior};
///
/// let mut builder = NetworkBuilder::new();
/// builder.node(1, Position { latitude: -35.280, longitude: 149.130 })?;
/// builder.node(2, Position { latitude: -35.280, longitude: 149.140 })?;
/// builder.both_ways(1, 2, RoadClass::Street)?;
/// let cells = RoadCells::new(builder.build()?, 20.0)?;
///
/// let sensor = PositionLikelihood::new(&cells);
/// let motion = CellTransition::new(&cells, &TurnWeights::default())?;
/// let mut odometer = motion.odometer();
/// let prior = Prior::AtFirstObservation(Belief::uniform(cells.states())?);
/// let hmm = Hmm::new(prior, motion, sensor)?;
/// let mut filter = hmm.filter();
/// // Two fixes 91 m apart, to the east: which direction it goes is known.
/// for (longitude, metres) in [(149.133, 0.0), (149.134, 91.0)] {
///     let travel = odometer.add(metres, 4.0)?;
///     let position = Position { latitude: -35.28003, longitude };
///     let fix = PositionFix { ahead: odometer.ahead(), ..PositionFix::new(position, 8.0) };
///     filter.step_with(&travel, &fix)?;
/// }
/// let east = cells.network().edge_between(0, 1).unwrap();
/// assert!(filter.belief().mass(cells.cells(east))? > 0.99);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct PositionLikelihood<P = Position> {
    points: Arc<Points>,
    degrees: f64,
    position: PhantomData<fn(P)>,
}

impl<P: Coordinates> PositionLikelihood<P> {
    /// Creates a sensor with three degrees of freedom. O(cells log cells).
    #[must_use]
    pub fn new(cells: &RoadCells<P>) -> Self {
        let points = Arc::new(Points::new(cells));
        Self { points, degrees: 3.0, position: PhantomData }
    }

    /// Sets the degrees of freedom ν: fewer make heavier tails, 1,000 nearly a Gaussian's.
    ///
    /// # Errors
    ///
    /// [`NetworkError::Parameter`] unless they are from 1 to 1,000.
    pub fn with_degrees(self, degrees: f64) -> Result<Self, NetworkError> {
        if !(1.0..=1000.0).contains(&degrees) {
            let (what, expected) = ("the degrees of freedom", "a value from 1 to 1000");
            return Err(OutOfRange::new(what, degrees, expected).into());
        }
        Ok(Self { degrees, ..self })
    }

    fn density_of(&self, fix: &PositionFix<P>) -> Result<FixDensity<'_>, LikelihoodError> {
        let PositionFix { position, deviation, ahead } = *fix;
        let parameter = |what, value, expected| {
            let error = NetworkError::Parameter(OutOfRange::new(what, value, expected));
            Err(LikelihoodError::sensor(error))
        };
        for ((what, limit), value) in P::AXES.into_iter().zip(position.values()) {
            if !(-limit..=limit).contains(&value) {
                return parameter(what, value, "a position of the map's kind");
            }
        }
        if !(1e-6..=1e9).contains(&deviation) {
            return parameter("the deviation of a position", deviation, "metres above 1e-6");
        }
        if !(-1e9..=1e9).contains(&ahead) {
            return parameter("the distance ahead of the cell", ahead, "metres up to 1e9");
        }
        let at = position.to_plane();
        let (points, degrees) = (&*self.points, self.degrees);
        let metres = P::scale(at);
        let variance = deviation * deviation;
        Ok(FixDensity { points, at, metres, turn: P::X_PERIOD, variance, ahead, degrees })
    }
}

/// A fix, compared with cells.
struct FixDensity<'a> {
    points: &'a Points,
    at: [f64; 2],
    /// Metres per unit of the plane.
    metres: f64,
    /// Width of the plane, after which it repeats.
    turn: f64,
    variance: f64,
    ahead: f64,
    degrees: f64,
}

impl FixDensity<'_> {
    /// Logarithm of the likelihood of a cell, at most 0.
    fn log(&self, cell: usize) -> f64 {
        let ([x, y], [u, v]) = (self.points.middles[cell], self.points.directions[cell]);
        let (u, v) = (f64::from(u), f64::from(v));
        let x = wrapped(x, self.at[0], self.turn);
        let [dx, dy] = [self.metres * (self.at[0] - x), self.metres * (self.at[1] - y)];
        let (along, across) = (dx * u + dy * v - self.ahead, dx * v - dy * u);
        // The unknown place in the cell adds to the variance along the road only.
        let wide = self.variance + f64::from(self.points.squares[cell]);
        // Without a direction, all of the distance counts as across.
        let across = if u == 0.0 && v == 0.0 { dx * dx + dy * dy } else { across * across };
        let q = along * along / wide + across / self.variance;
        // The density is relative to its peak for a cell of length 0, so it is at most 1.
        self.tail(q) + 0.5 * (self.variance / wide).ln()
    }

    /// Logarithm of the tail (1 + q / ν)^(−(ν + 2) / 2).
    fn tail(&self, q: f64) -> f64 {
        -0.5 * (self.degrees + 2.0) * (q / self.degrees).ln_1p()
    }

    fn log_factor(&self) -> f64 {
        -(2.0 * std::f64::consts::PI * self.variance).ln()
    }

    /// Passes on all cells within ten deviations, and some others nearby.
    fn near(&self, mut take: impl FnMut(usize)) {
        let wide = (self.variance + self.points.largest_square).sqrt();
        let distance = (NEAR * wide + self.ahead.abs()) / self.metres;
        let [x, y] = self.at;
        // Across the antimeridian, the coordinate of a nearby cell differs by a full turn.
        for turn in [0.0, self.turn, -self.turn].into_iter().filter(|turn| turn.is_finite()) {
            let is_nearest = |cell: usize| {
                let middle = self.points.middles[cell][0];
                wrapped(middle, x, self.turn) == middle - turn
            };
            let mut take = |cell| {
                if is_nearest(cell) {
                    take(cell);
                }
            };
            // A margin for the rounding of directions and of the grid's squares.
            self.points.grid.near([x + turn, y], distance * (1.0 + 1e-5), &mut take);
        }
    }
}

impl<P: Coordinates> Likelihood for PositionLikelihood<P> {
    type Observation = PositionFix<P>;

    fn states(&self) -> usize {
        self.points.middles.len()
    }

    /// # Errors
    ///
    /// [`LikelihoodError::Sensor`] with an [`NetworkError::Parameter`] for a fix that is not
    /// on Earth (or in the plane), or a deviation that is not above 0.
    fn diagonal<'a>(
        &'a self,
        fix: &'a PositionFix<P>,
        scratch: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        let density = self.density_of(fix)?;
        let logs = scratch.values(self.states());
        logs.iter_mut().enumerate().for_each(|(cell, log)| *log = density.log(cell));
        Ok(Diagonal::log(logs).with_log_factor(density.log_factor()))
    }
}

impl<P: Coordinates> LocalLikelihood for PositionLikelihood<P> {
    /// # Errors
    ///
    /// As [`diagonal`](Likelihood::diagonal).
    fn local<'a>(
        &'a self,
        fix: &'a PositionFix<P>,
        states: &[usize],
        scratch: &'a mut Scratch,
    ) -> Result<(Diagonal<'a>, f64), LikelihoodError> {
        let density = self.density_of(fix)?;
        let out = scratch.values(states.len());
        out.iter_mut().zip(states).for_each(|(out, &cell)| *out = density.log(cell));
        // Cells that `near` leaves out are more than ten deviations away, which bounds their
        // density. Nearby cells that were not asked for are evaluated.
        let mut largest = density.tail(NEAR * NEAR);
        density.near(|cell| {
            if states.binary_search(&cell).is_err() {
                largest = largest.max(density.log(cell));
            }
        });
        Ok((Diagonal::log(out).with_log_factor(density.log_factor()), largest))
    }

    fn listed_states(&self, fix: &PositionFix<P>, states: &mut Vec<usize>) {
        if let Ok(density) = self.density_of(fix) {
            density.near(|cell| states.push(cell));
        }
    }
}

/// Side of the squares of the grid, in mean cells.
const SQUARE: f64 = 8.0;

/// Middles of the cells in the plane.
#[derive(Debug)]
pub(super) struct Points {
    pub(super) middles: Vec<[f64; 2]>,
    /// Unit vector along each cell, or zero.
    pub(super) directions: Vec<[f32; 2]>,
    /// ℓ² / 12, in square metres, of each cell.
    pub(super) squares: Vec<f32>,
    pub(super) largest_square: f64,
    pub(super) grid: Grid,
}

impl Points {
    pub(super) fn new<P: Coordinates>(cells: &RoadCells<P>) -> Self {
        let n = cells.states();
        let (mut middles, mut directions) = (Vec::with_capacity(n), Vec::with_capacity(n));
        let mut squares = Vec::with_capacity(n);
        let network = cells.network();
        let (mut line, mut marks) = (Vec::new(), Vec::new());
        for (edge, road) in network.edges().iter().enumerate() {
            let count = cells.cells(edge).len();
            line.clear();
            line.extend(P::unwrap(network.shape(edge).iter().copied()));
            // Start, middle and end of each cell: successive cells share a mark.
            divide(&line, 2 * count, &mut marks);
            for ends in marks.windows(3).step_by(2) {
                let [dx, dy] = [ends[2][0] - ends[0][0], ends[2][1] - ends[0][1]];
                let length = dx.hypot(dy);
                let unit = |d: f64| if length > 0.0 { (d / length) as f32 } else { 0.0 };
                middles.push(ends[1]);
                directions.push([unit(dx), unit(dy)]);
                squares.push(((road.metres / count as f64).powi(2) / 12.0) as f32);
            }
        }
        let largest_square = squares.iter().copied().fold(0.0, f32::max).into();
        let grid = Grid::new(&middles, SQUARE * cells.mean_metres());
        Self { middles, directions, squares, largest_square, grid }
    }
}

/// Points that divide a line into parts of equal length, including both ends.
fn divide(line: &[[f64; 2]], parts: usize, marks: &mut Vec<[f64; 2]>) {
    let length = |pair: &[[f64; 2]]| (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1]);
    let total: f64 = line.windows(2).map(length).sum();
    let (mut piece, mut before) = (0, 0.0);
    marks.clear();
    for mark in 0..=parts {
        let along = total * mark as f64 / parts as f64;
        // Marks ascend, so `piece` never goes back. It stops at the last piece, even if the rounded
        // sum of lengths leaves a mark beyond its end.
        while piece + 2 < line.len() && before + length(&line[piece..piece + 2]) < along {
            before += length(&line[piece..piece + 2]);
            piece += 1;
        }
        let (a, b) = (line[piece], line[piece + 1]);
        let here = length(&[a, b]);
        let share = if here > 0.0 { ((along - before) / here).clamp(0.0, 1.0) } else { 0.0 };
        marks.push([a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])]);
    }
}

/// Largest number of squares in a row or column.
const MOST_SQUARES: f64 = 65_536.0;

/// Numbered points, found by their square.
#[derive(Debug, Clone)]
pub(super) struct Grid {
    low: [f64; 2],
    side: f64,
    /// Largest square of each axis.
    last: [u64; 2],
    /// Row and column of each point's square, and its number; sorted.
    points: Vec<(u64, u32)>,
}

impl Grid {
    /// Sorts points into squares with at least this side. O(points log points).
    #[expect(clippy::cast_sign_loss, reason = "no point is below the lowest")]
    pub(super) fn new(points: &[[f64; 2]], side: f64) -> Self {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for point in points {
            for axis in 0..2 {
                low[axis] = low[axis].min(point[axis]);
                high[axis] = high[axis].max(point[axis]);
            }
        }
        let extent = (high[0] - low[0]).max(high[1] - low[1]);
        // At most 2^16 squares on an axis: row and column fit 32 bits each.
        let side = side.max(extent / MOST_SQUARES);
        let square = |axis: usize, x: f64| ((x - low[axis]) / side) as u64;
        let mut sorted: Vec<(u64, u32)> = (0..)
            .zip(points)
            .map(|(number, &[x, y])| (square(1, y) << 32 | square(0, x), number))
            .collect();
        sorted.sort_unstable();
        let last = [square(0, high[0]), square(1, high[1])];
        Self { low, side, last, points: sorted }
    }

    /// Passes on all points within a distance of a point, and some others nearby.
    #[expect(clippy::cast_sign_loss, reason = "squares are counted from the lowest, 0")]
    pub(super) fn near(&self, [x, y]: [f64; 2], distance: f64, mut take: impl FnMut(usize)) {
        let range = |axis: usize, x: f64| {
            let square = |x: f64| (x - self.low[axis]) / self.side;
            (square(x - distance).max(0.0), square(x + distance).min(self.last[axis] as f64))
        };
        let (columns, rows) = (range(0, x), range(1, y));
        // Empty if the distance does not reach the grid, or is NaN.
        if !(columns.0 < columns.1 + 1.0
            && rows.0 < rows.1 + 1.0
            && columns.1 >= 0.0
            && rows.1 >= 0.0)
        {
            return;
        }
        // Columns of a row are consecutive keys, so one search finds their run.
        for row in rows.0 as u64..=rows.1 as u64 {
            let (first, last) = (row << 32 | columns.0 as u64, row << 32 | columns.1 as u64);
            let start = self.points.partition_point(|point| point.0 < first);
            let points = self.points[start..].iter().take_while(|point| point.0 <= last);
            points.for_each(|point| take(point.1 as usize));
        }
    }
}
