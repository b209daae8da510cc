//! Views compared with the last new one, and counts of views and of odometry readings, to find out
//! whether the camera or the odometry is stuck.

use super::Options;
use super::warning::Warning;
use crate::motion::ViewChange;
use crate::observation::change;

/// Number of views over which counts fade to 1/e.
const RECENT: f64 = 1000.0;
/// Number of recent views, exact repetitions aside, below which they are too few to judge by.
const ENOUGH_VIEWS: f64 = 100.0;
/// Share of unchanged views, exact repetitions aside, above which they count as most. On drives
/// along a railway, a corridor and streets it was 0.49 at most.
const UNCHANGED_SHARE: f64 = 0.6;
/// Share of unchanged views with another nearest reference above which the vehicle moves; and share
/// of unchanged views among all above which it must move at least at times.
const MOVED: f64 = 0.25;
const NEARLY_ALL_SHARE: f64 = 0.9;
/// Number of equal readings that count nearly in full.
const ALIKE: f64 = 5.0;
/// Number of equal readings in a row after which odometry may be stuck.
pub(super) const EQUAL: u32 = 30;
/// Largest reading of a vehicle that stands, in places.
pub(super) const STANDS: f64 = 0.05;
/// Excess of changed views over unchanged ones that shows motion: a vehicle that stands in traffic
/// sees both.
const CHANGED: u32 = 20;
/// Number of unchanged views in a row after which the camera may be stuck or, with equal readings,
/// odometry; and the least distance read meanwhile, in places, and in deviations of the readings of
/// a vehicle that stands. A railway's tunnel took 58 views.
const STILL: u32 = 100;
const STILL_EQUAL: u32 = 60;
const DRIVEN: f64 = 10.0;
const MOTION_DEVIATIONS: f64 = 4.0;

/// Largest distance, in places, at which one nearest reference counts as beside another.
const BESIDE: usize = 2;

/// Least score of a row without NaN.
pub(super) fn least(rows: &[f32]) -> f32 {
    // Sixteen independent minima, which the compiler turns into vectors.
    let mut lanes = [f32::INFINITY; 16];
    let (whole, rest) = rows.as_chunks::<16>();
    let take = |least: &mut f32, score: f32| *least = if score < *least { score } else { *least };
    for chunk in whole {
        lanes.iter_mut().zip(chunk).for_each(|(least, score)| take(least, *score));
    }
    lanes.iter_mut().zip(rest).for_each(|(least, score)| take(least, *score));
    lanes.into_iter().fold(f32::INFINITY, f32::min)
}

/// Index of the least score of a row that is not empty; the first if several are equal.
pub(super) fn nearest(rows: &[f32]) -> usize {
    let least = least(rows);
    rows.iter().position(|score| *score == least).unwrap_or(0)
}

/// Comparison of a view with the last new one.
#[derive(Debug, Clone, Copy)]
pub(super) struct View {
    /// Changed or not, if that is clear.
    pub(super) change: Option<ViewChange>,
    /// Share of the view that is new, 1 − r for a correlation of r with the last new one; 0 for a
    /// view that is not new.
    pub(super) fresh: f64,
    /// True if the view equals the last new one.
    repeated: bool,
    /// True if the nearest reference of an unchanged or unclear view is not the last one nor beside
    /// it: the vehicle has moved although the view has hardly changed. `None` for other views.
    moved: Option<bool>,
}

impl View {
    /// The first view, which is new.
    pub(super) const FIRST: Self =
        Self { change: Some(ViewChange::Changed), fresh: 1.0, repeated: false, moved: None };

    /// Compares the scores within a row with those of the last new view; a view that changes by at
    /// most `still` counts as unchanged.
    pub(super) fn beside(last: &[f32], still: f64, scores: &[f32], options: &Options) -> Self {
        let changed = change(last, scores);
        // The unit is the change from reference to reference in the same row, so that neither scale
        // nor density of the references matters.
        let unit = change(&scores[1..], &scores[..scores.len() - 1]);
        let repeated = changed == 0.0;
        let unchanged = changed <= still;
        // Below the threshold but above `still`, the view carries evidence neither on the place nor
        // of standing.
        if unchanged || changed < options.view_threshold * unit {
            let moved = (!repeated).then(|| {
                let steps = nearest(last).abs_diff(nearest(scores));
                let around = if options.closed { scores.len() - steps } else { steps };
                steps.min(around) > BESIDE.max(options.window)
            });
            let change = unchanged.then_some(ViewChange::Unchanged);
            return Self { change, fresh: 0.0, repeated, moved };
        }
        Self { fresh: changed.min(1.0), repeated, ..Self::FIRST }
    }
}

/// Counts of recent views and of readings.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub(crate) struct Tally {
    /// Numbers of views compared with another, of those that equal it, of other views that are
    /// unchanged or unclear, and of those of them with another nearest reference; all fade.
    pub(crate) views: f64,
    pub(crate) repeated: f64,
    pub(crate) unchanged: f64,
    pub(crate) moved: f64,
    /// The last reading, the number of times in a row that it was read, and the recent excess of
    /// changed views over unchanged ones.
    pub(crate) reading: Option<f64>,
    pub(crate) equal: u32,
    pub(crate) changed: u32,
    /// The number of views since the last changed one, and the sums of the readings and of their
    /// squares meanwhile.
    pub(crate) still: u32,
    pub(crate) driven: f64,
    pub(crate) squares: f64,
}

impl Tally {
    /// Returns a reading that counts, or `None`: of a run of equal readings, as many count as 5 ln(1 +
    /// k / 5) of k, since wheels that are stuck err once and not k times. Of readings of a vehicle
    /// that stands, those while views change are counted.
    pub(super) fn thinned(&self, odometry: Option<f64>) -> Option<f64> {
        let reading = odometry?;
        let run = if odometry != self.reading {
            0
        } else if reading.abs() <= STANDS {
            self.changed
        } else {
            self.equal
        };
        let counted = |k: u32| (ALIKE * (f64::from(k) / ALIKE).ln_1p()).floor();
        (run == 0 || counted(run + 1) > counted(run)).then_some(reading)
    }

    /// Takes a step: its view, if there is one before it to compare with, and its reading.
    pub(super) fn record(&mut self, view: Option<&View>, odometry: Option<f64>) {
        // A run of equal readings ends with any other reading, and with a missing one.
        if odometry.is_none() || odometry != self.reading {
            (self.reading, self.equal, self.changed) = (odometry, 0, 0);
        }
        if odometry.is_some() {
            self.equal = self.equal.saturating_add(1);
        }
        let Some(&View { change, repeated, moved, .. }) = view else {
            (self.still, self.driven, self.squares) = (0, 0.0, 0.0);
            return;
        };
        let add = |count: &mut f64, one: bool| {
            *count = *count * (1.0 - 1.0 / RECENT) + f64::from(u8::from(one));
        };
        add(&mut self.views, true);
        add(&mut self.repeated, repeated);
        add(&mut self.unchanged, moved.is_some());
        add(&mut self.moved, moved == Some(true));
        // Saturating at 0 gives the excess since its last minimum, as in a CUSUM test: long
        // standing before does not hide that the vehicle moves now.
        if change == Some(ViewChange::Unchanged) {
            self.changed = self.changed.saturating_sub(1);
        }
        if change == Some(ViewChange::Changed) {
            self.changed = self.changed.saturating_add(1);
            (self.still, self.driven, self.squares) = (0, 0.0, 0.0);
        } else if let Some(reading) = odometry {
            self.still = self.still.saturating_add(1);
            self.driven += reading;
            self.squares += reading * reading;
        }
    }

    /// Checks counts read from storage.
    #[cfg(feature = "serde")]
    pub(crate) fn checked(self) -> Result<Self, String> {
        let Self { views, repeated, unchanged, moved, reading, driven, squares, .. } = self;
        let counts = [views, repeated, unchanged, moved];
        if let Some(count) = counts.iter().find(|count| !(0.0..=2.0 * RECENT).contains(*count)) {
            return Err(format!("{count} recent views, expected from 0 to {}", 2.0 * RECENT));
        }
        let readings = [reading.unwrap_or(0.0), driven, squares];
        if let Some(sum) = readings.iter().find(|sum| !sum.is_finite()) {
            return Err(format!("a sum of readings of {sum}, expected a finite value"));
        }
        Ok(self)
    }

    /// Warns if most views are unchanged although the vehicle moves.
    fn unchanged(&self) -> Option<Warning> {
        let Self { views, repeated, unchanged, moved, .. } = *self;
        let others = views - repeated;
        let most = others >= ENOUGH_VIEWS && unchanged > UNCHANGED_SHARE * others;
        let moves = moved > MOVED * unchanged || unchanged > NEARLY_ALL_SHARE * others;
        (most && moves).then(|| Warning::Unchanged {
            unchanged: unchanged / views,
            repeated: repeated / views,
        })
    }

    /// Warns if odometry reads the same again and again: either that the vehicle stands while the
    /// views change, or that it moves while they do not.
    fn stuck(&self) -> Option<Warning> {
        let Self { reading, equal: steps, changed, still, driven, .. } = *self;
        let reading = reading?;
        let stuck = if reading.abs() <= STANDS {
            steps >= EQUAL && changed >= CHANGED
        } else {
            still.min(steps) >= STILL_EQUAL && driven.abs() >= DRIVEN
        };
        stuck.then_some(Warning::Stuck { reading, steps })
    }

    /// Warns if the views do not change while odometry reads that the vehicle moves.
    fn still(&self) -> Option<Warning> {
        let Self { still: steps, driven, squares, .. } = *self;
        // If the readings were independent noise around 0, their sum would have a standard
        // deviation of about √Σ r².
        let sure = driven.abs() >= DRIVEN.max(MOTION_DEVIATIONS * squares.sqrt());
        (steps >= STILL && sure).then_some(Warning::Still { steps, driven })
    }

    /// Returns all warnings about recent views and readings.
    pub(super) fn warnings(&self) -> Vec<Warning> {
        self.unchanged().into_iter().chain(self.stuck()).chain(self.still()).collect()
    }
}

/// The strongest warning of each kind in the course of a drive.
#[derive(Debug, Default)]
pub(super) struct StrongestWarnings {
    unchanged: Option<Warning>,
    stuck: Option<(u32, Warning)>,
    still: Option<(u32, Warning)>,
}

impl StrongestWarnings {
    pub(super) fn record(&mut self, tally: &Tally) {
        // The last tally covers the whole drive, with fading weights for old views.
        self.unchanged = tally.unchanged();
        let longest = |kept: &mut Option<(u32, Warning)>, found: Option<Warning>, steps: u32| {
            if kept.as_ref().is_none_or(|kept| kept.0 < steps) {
                *kept = found.map(|found| (steps, found)).or(kept.take());
            }
        };
        longest(&mut self.stuck, tally.stuck(), tally.equal);
        longest(&mut self.still, tally.still(), tally.still);
    }

    pub(super) fn into_warnings(self) -> Vec<Warning> {
        let runs = self.stuck.into_iter().chain(self.still).map(|run| run.1);
        self.unchanged.into_iter().chain(runs).collect()
    }
}
