//! Cells and hidden scales of the wheels: A[(g, i), (h, j)] = S[g, h] A_g[i, j], with the chain S
//! of scales and the move A_g = Σ w_k M^k by the distance of the new scale.

use super::{CellTransition, Travel, WheelOdometer, WheelTravel, Wheels};
use wayfix::internal::buffers;
use wayfix::likelihood::Groups;
use wayfix::transition::kit::{check_count, check_slices};
use wayfix::{Belief, Transition, TransitionEntries, TransitionError};

/// Motion on the [cells of roads](crate::cells::RoadCells) by the metres that wheels read, with
/// [errors](Wheels) that last: a [`CellTransition`] for each of several hidden scales.
///
/// State g n + i is scale g at cell i, of n cells: the wheels read `scales()[g]` metres for each
/// metre driven. In a step the scale changes to g with probability S\[g, h\], then the vehicle
/// moves by the distance of the **new** scale:
///
/// ```text
/// A[(g, i), (h, j)] = S[g, h] A_g[i, j]
/// ```
///
/// The control is a [`WheelTravel`] from a [`WheelOdometer`]. Sensors and answers are those of
/// cells, through [groups](Self::cell_groups).
///
/// Use it wherever a robot's wheels are the odometer. A [`CellTransition`] takes the errors of
/// readings to be independent, so they seem to average out: after 100 m with an error of 2%, its
/// belief is 2 m off, and far too narrow to show it.
///
/// # Costs
///
/// The time of a [`CellTransition`] for each of the nine scales, and O(81 n) more in steps where
/// the scale may change, at most one for each cell driven. Memory: the belief has nine times as
/// many states.
///
/// ```
/// use wayfix::likelihood::GroupedLikelihood;
/// use wayfix_roads::NetworkBuilder;
/// use wayfix::map::{PlanePosition, RoadClass};
/// use wayfix_roads::cells::RoadCells;
/// use wayfix_roads::cells::{CellTransition, TurnWeights, WheelTransition, Wheels};
/// use wayfix_roads::cells::{ReadRates, TagLikelihood};
/// use wayfix::{Belief, Hmm, Prior};
///
/// // An aisle of 200 m with a tag at either end.
/// let mut builder = NetworkBuilder::new();
/// builder.node(1, PlanePosition { x: 0.0, y: 0.0 })?;
/// builder.node(2, PlanePosition { x: 200.0, y: 0.0 })?;
/// builder.both_ways(1, 2, RoadClass::Street)?;
/// let cells = RoadCells::new(builder.build()?, 0.5)?;
/// let n = cells.states();
///
/// let motion = CellTransition::new(&cells, &TurnWeights::default())?;
/// let motion = WheelTransition::new(motion, Wheels::default())?;
/// let mut odometer = motion.odometer();
/// let rates = ReadRates { read: 0.2, misread: 0.001 };
/// let tags = TagLikelihood::at_nodes(&cells, &[0, 1], 0.5, rates)?;
/// let sensor = GroupedLikelihood::new(tags, motion.cell_groups())?;
/// let start = motion.spread(&Belief::certain(n, cells.cell_at(0, 0.0))?)?;
/// let hmm = Hmm::new(Prior::BeforeFirstTransition(start), motion, sensor)?;
/// let mut filter = hmm.filter();
/// // The wheels are worn: the odometer reads 204 m by the end.
/// for _ in 0..2040 {
///     filter.predict_with(&odometer.add(0.1, 1e-5)?)?;
/// }
/// filter.update(&Some(1))?;
/// let scales = hmm.transition().scale_groups().marginal(&filter.belief())?;
/// let mean: f64 = hmm.transition().scales().iter().zip(scales.as_slice()).map(|(s, p)| s * p).sum();
/// assert!((mean - 1.02).abs() < 0.005);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct WheelTransition {
    cells: CellTransition,
    wheels: Wheels,
    scales: Vec<f64>,
    shares: Vec<f64>,
}

impl WheelTransition {
    /// Creates the motion of a vehicle with these wheels.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Parameter`] for a parameter of the wheels out of its range, or
    /// [`TransitionError::TooMany`] for more than 2^32 − 1 states.
    pub fn new(cells: CellTransition, wheels: Wheels) -> Result<Self, TransitionError> {
        wheels.check(cells.mean_metres)?;
        let (scales, shares) = (wheels.scales(), wheels.shares());
        check_count("states", cells.states().saturating_mul(scales.len()))?;
        Ok(Self { cells, wheels, scales, shares })
    }

    /// Motion on the cells.
    #[must_use]
    pub fn cells(&self) -> &CellTransition {
        &self.cells
    }

    /// Errors of the wheels.
    #[must_use]
    pub fn wheels(&self) -> &Wheels {
        &self.wheels
    }

    /// Scales, in metres read for each metre driven, ascending: nine, or 1 alone if the wheels have
    /// no deviation.
    #[must_use]
    pub fn scales(&self) -> &[f64] {
        &self.scales
    }

    /// Stationary probabilities of the scales.
    #[must_use]
    pub fn shares(&self) -> &[f64] {
        &self.shares
    }

    /// Returns an odometer at 0.
    #[must_use]
    pub fn odometer(&self) -> WheelOdometer {
        WheelOdometer::new(self.wheels, &self.cells.odometer(), self.cells.mean_metres)
    }

    /// State of a scale at a cell, or `None` if either does not exist.
    #[must_use]
    pub fn index(&self, scale: usize, cell: usize) -> Option<usize> {
        let n = self.cells.states();
        (scale < self.scales.len() && cell < n).then(|| scale * n + cell)
    }

    /// States grouped by cell: for sensors of cells, and for the probabilities of cells.
    #[must_use]
    pub fn cell_groups(&self) -> Groups {
        let n = self.cells.states();
        Groups::numbered((0..self.states()).map(|state| state % n).collect(), n)
    }

    /// States grouped by scale.
    #[must_use]
    pub fn scale_groups(&self) -> Groups {
        let n = self.cells.states();
        let scales = (0..self.states()).map(|state| state / n).collect();
        Groups::numbered(scales, self.scales.len())
    }

    /// Returns a belief over cells as one over states, with the scales by their
    /// [shares](Self::shares): to start from, or to
    /// [restart](wayfix::transition::RestartTransition) from.
    ///
    /// # Errors
    ///
    /// [`TransitionError::PartStates`] for a belief over a different number of cells.
    pub fn spread<S: AsRef<[f64]>>(&self, cells: &Belief<S>) -> Result<Belief, TransitionError> {
        let (found, expected) = (cells.states(), self.cells.states());
        if found != expected {
            return Err(TransitionError::PartStates { part: "belief", found, expected });
        }
        let pairs =
            self.shares.iter().flat_map(|share| cells.values().iter().map(move |p| share * p));
        Ok(Belief::from_valid(pairs.collect()))
    }

    /// Moves the cells of each scale by its distance, in a step where no scale changes.
    fn each_scale(
        &self,
        control: &WheelTravel,
        x: &[f64],
        out: &mut [f64],
        move_cells: impl Fn(&CellTransition, &Travel, &[f64], &mut [f64]),
    ) {
        let n = self.cells.states();
        let layers = x.chunks_exact(n).zip(out.chunks_exact_mut(n));
        for ((x, out), travel) in layers.zip(control.travels()) {
            move_cells(&self.cells, travel, x, out);
        }
    }
}

impl Transition for WheelTransition {
    type Control = WheelTravel;

    fn states(&self) -> usize {
        self.cells.states() * self.scales.len()
    }

    fn apply(&self, control: &WheelTravel, x: &[f64], out: &mut [f64]) {
        check_slices(self.states(), x, out);
        let n = self.cells.states();
        if !control.is_changing() {
            return self.each_scale(control, x, out, CellTransition::apply);
        }
        let travels = control.travels().iter();
        // S comes first: it mixes the scales at the same cell. Then each new scale moves the cells
        // by its own distance.
        buffers::with(n, |changed| {
            for (to, (out, travel)) in out.chunks_exact_mut(n).zip(travels).enumerate() {
                changed.fill(0.0);
                for (from, x) in x.chunks_exact(n).enumerate() {
                    add(control.change(to, from), x, changed);
                }
                self.cells.apply(travel, changed, out);
            }
        });
    }

    fn apply_transpose(&self, control: &WheelTravel, x: &[f64], out: &mut [f64]) {
        check_slices(self.states(), x, out);
        let n = self.cells.states();
        if !control.is_changing() {
            return self.each_scale(control, x, out, CellTransition::apply_transpose);
        }
        let travels = control.travels().iter();
        // The transpose works in reverse order: the values of each new scale move back, then S'
        // spreads them over the old scales.
        out.fill(0.0);
        buffers::with(n, |moved| {
            for (to, (x, travel)) in x.chunks_exact(n).zip(travels).enumerate() {
                self.cells.apply_transpose(travel, x, moved);
                for (from, out) in out.chunks_exact_mut(n).enumerate() {
                    add(control.change(to, from), moved, out);
                }
            }
        });
    }

    fn evidence(&self, control: &WheelTravel) -> Option<f64> {
        // The evidence of cells is the same for every scale that moved, so any of them will do.
        control.travels().iter().find_map(|travel| self.cells.evidence(travel))
    }

    fn check_control(&self, control: &WheelTravel) -> Result<(), TransitionError> {
        let (found, expected) = (control.travels().len(), self.scales.len());
        if found == expected {
            return Ok(());
        }
        let text = format!("distances at {found} scales, expected {expected}");
        Err(TransitionError::Control(text))
    }
}

/// Adds a multiple of x.
fn add(factor: f64, x: &[f64], out: &mut [f64]) {
    if factor > 0.0 {
        out.iter_mut().zip(x).for_each(|(out, x)| *out += factor * x);
    }
}

impl TransitionEntries for WheelTransition {
    fn incoming(&self, control: &WheelTravel, to: usize) -> impl Iterator<Item = (usize, f64)> {
        let n = self.cells.states();
        let (scale, cell) = (to / n, to % n);
        let moves: Vec<_> = self.cells.incoming(&control.travels()[scale], cell).collect();
        let from = (0..self.scales.len()).map(move |from| (from, control.change(scale, from)));
        let changes = from.filter(|change| change.1 > 0.0);
        // The moves depend only on the new scale: they are listed once and repeated for each old
        // scale. Scales ascend, and cells ascend within a scale, so the states ascend.
        let all = changes.flat_map(move |(from, change)| {
            moves.clone().into_iter().map(move |(cell, p)| (from * n + cell, change * p))
        });
        all.filter(|entry| entry.1 > 0.0)
    }

    fn outgoing(&self, control: &WheelTravel, from: usize) -> impl Iterator<Item = (usize, f64)> {
        let n = self.cells.states();
        let (scale, cell) = (from / n, from % n);
        let to = (0..self.scales.len()).map(move |to| (to, control.change(to, scale)));
        let changes = to.filter(|change| change.1 > 0.0);
        let all = changes.flat_map(move |(to, change)| {
            let moves = self.cells.outgoing(&control.travels()[to], cell);
            moves.map(move |(cell, p)| (to * n + cell, change * p))
        });
        all.filter(|entry| entry.1 > 0.0)
    }
}
