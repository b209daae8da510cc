//! From queries to likelihoods and evidence on moves.

use super::recognizer::KNOWN_COUNT;
use super::references::References;
use super::tally::{Glance, Tally};
use super::{Options, RecognitionError};
use crate::error::InferenceError;
use crate::motion::{Driven, RouteControl, RouteTransition, ViewChange, ViewEvidence};
use crate::observation::{
    ObservationError, RowScratch, Spread, Standardizer, change, row_scores, within,
};
use crate::transition::Transition;

/// Share of a view that is new above which it counts as a whole witness: frames of a route that is
/// sampled densely share theirs.
const WITNESS: f64 = 0.03;
/// Quantile of the changes from a reference to the next, and part of it, up to which a view is
/// unchanged: less than in nearly all steps along the route, dark stretches among them.
const STILL_SHARE: f64 = 0.02;
const STILL_PART: f64 = 0.2;

/// Share of the least score up to which a reference is among the nearest.
const AMONG: f32 = 0.8;
/// Share of its score up to which a reference is near usually, and not now only.
const USUALLY: f32 = 0.3;
/// Number of queries from which on usual scores tell one from the other: those known before the
/// drive may be of another season, and ten of the drive.
const ACQUAINTED: f64 = 2.0 * KNOWN_COUNT;
/// Largest share of those that linger, so that what becomes near to everything is learned at last.
const MOST_LINGERING: f64 = 0.8;
/// Number of new views over which the share of those that linger fades, by e.
const LINGERING: f64 = 20.0;

/// Places from the nearest reference within which another is beside it.
const BESIDE: usize = 2;

/// Largest change of an unchanged view.
fn still(standardizer: &Standardizer, scratch: &mut Vec<f64>) -> f64 {
    STILL_PART * standardizer.step_quantile(STILL_SHARE, scratch)
}

/// The least of the scores of a row, without NaN.
pub(super) fn least(rows: &[f32]) -> f32 {
    // Lanes of their own, which a compiler brings into vectors.
    let mut lanes = [f32::INFINITY; 16];
    let (whole, rest) = rows.as_chunks::<16>();
    let take = |least: &mut f32, score: f32| *least = if score < *least { score } else { *least };
    for chunk in whole {
        lanes.iter_mut().zip(chunk).for_each(|(least, score)| take(least, *score));
    }
    lanes.iter_mut().zip(rest).for_each(|(least, score)| take(least, *score));
    lanes.into_iter().fold(f32::INFINITY, f32::min)
}

/// Index of the least score of a row that is not empty; the first of equal ones.
pub(super) fn nearest(rows: &[f32]) -> usize {
    let least = least(rows);
    rows.iter().position(|score| *score == least).unwrap_or(0)
}

/// A view compared with the last new one.
struct View {
    /// Changed or not, if that is clear.
    change: Option<ViewChange>,
    /// Share of it that is new, in an autoregression of the first order.
    fresh: f64,
    /// True if it equals the last new view.
    repeated: bool,
}

/// The camera, with all that it has learned of the references so far. It is causal: live and in
/// recordings, a step depends on no later query.
#[derive(Debug, Clone)]
pub(super) struct Sensor {
    state: SensorState,
    distances: Vec<f32>,
    more: Vec<f32>,
    /// Scores within the row of the last query.
    rows: Vec<f32>,
    scratch: RowScratch,
    /// Scratch memory for changes from a reference to the next.
    steps: Vec<f64>,
    /// log2 of the odds of each place by the last new frame alone, if kept.
    alone: Vec<f32>,
}

/// The part of a sensor that changes with each query.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SensorState {
    pub(crate) standardizer: Standardizer,
    /// Scores within the row of the last view that was new.
    pub(crate) last_view: Option<Vec<f32>>,
    /// Length of the run of views like the last one, changed or not.
    pub(crate) run: Option<(Option<ViewChange>, u32)>,
    /// Largest change of an unchanged view.
    pub(crate) still: f64,
    /// Share of recent new views in which the reference that was nearest before is still among the
    /// nearest.
    pub(crate) lingering: f64,
    /// Motion by odometry and views, if the vehicle may leave the map.
    pub(crate) driven: Option<Driven>,
    /// Recent views and readings.
    pub(crate) tally: Tally,
}

/// Surroundings of a step of the sensor.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seeing<'a> {
    pub(super) options: &'a Options,
    pub(super) references: &'a References,
    pub(super) motion: &'a RouteTransition,
}

impl Sensor {
    pub(super) fn new(standardizer: Standardizer) -> Self {
        let mut steps = Vec::new();
        Self {
            state: SensorState {
                still: still(&standardizer, &mut steps),
                standardizer,
                last_view: None,
                run: None,
                lingering: 0.0,
                driven: None,
                tally: Tally::default(),
            },
            distances: Vec::new(),
            more: Vec::new(),
            rows: Vec::new(),
            scratch: RowScratch::default(),
            steps,
            alone: Vec::new(),
        }
    }

    /// Takes the query of a step: writes the likelihood of each place, then that of off the map,
    /// and returns the control.
    pub(super) fn sense(
        &mut self,
        seeing: Seeing<'_>,
        step: usize,
        query: &[f32],
        odometry: Option<f64>,
        out: &mut [f64],
    ) -> Result<RouteControl, RecognitionError> {
        let Seeing { options, references, .. } = seeing;
        references.distances(step, query, &mut self.distances, &mut self.more)?;
        let failed = |cause| RecognitionError::query(step, cause);
        let control = self.moved(odometry);
        let n = references.count();
        // Checked first, so that an error leaves the sensor as it was.
        let View { change: view, fresh, repeated } = self.compare(options).map_err(failed)?;
        let moved = (fresh == 0.0 && !repeated).then(|| self.nearest_moved(options));
        let nowhere = self.rows.iter().all(|score| *score == f32::INFINITY);
        if nowhere && options.off_map.is_none() {
            return Err(failed(ObservationError::NoMatch));
        }
        let refused = |cause| InferenceError::control(step, cause);
        seeing.motion.check_control(&control).map_err(refused)?;
        if fresh == 0.0 && !nowhere {
            // A repeated view adds no evidence on the place.
            out.fill(1.0);
        } else {
            let (places, off) = out.split_at_mut(n);
            let spread = self.state.standardizer.spread();
            self.state.standardizer.standardize(spread, &self.rows, places);
            options.odds.log2_odds_of(&places[..self.alone.len()], &mut self.alone);
            let weight = (fresh / WITNESS).min(1.0);
            options.odds.odds_of(weight, places);
            let odds =
                if options.off_map.is_some() { options.off_map_odds } else { options.lost_odds };
            off.fill(odds.powf(weight));
            self.learn(options, spread, fresh);
        }
        let SensorState { run, driven, tally, .. } = &mut self.state;
        let count = match *run {
            Some((before, count)) if before == view => count.saturating_add(1),
            _ => 1,
        };
        // The first view has no view before it.
        let first = run.is_none();
        *run = Some((view, count));
        tally.take(if first { None } else { Some(Glance { view, repeated, moved }) }, odometry);
        let weight = 1.0 / (1.0 + f64::from(count - 1) * options.view_fades);
        let evidence = view.map(|view| ViewEvidence { view, weight });
        let view = evidence.filter(|_| options.use_views && !first);
        let control = RouteControl { view, ..control };
        // Motion before the step matters off the map only: a lost vehicle need not go on as it
        // did.
        if options.off_map.is_some() && (view.is_some() || odometry.is_some()) {
            *driven = Some(seeing.motion.driven(&control));
        }
        Ok(control)
    }

    /// Compares the last row of distances with that of the last new view.
    fn compare(&mut self, options: &Options) -> Result<View, ObservationError> {
        let Self { state: SensorState { standardizer, last_view, still, .. }, distances, .. } =
            self;
        standardizer.check(distances)?;
        row_scores(distances, &mut self.rows, &mut self.scratch)?;
        let Some(last) = last_view else {
            return Ok(View { change: Some(ViewChange::Changed), fresh: 1.0, repeated: false });
        };
        let rows = &self.rows;
        let changed = change(last, rows);
        // A change has the unit of one from a reference to the next.
        let unit = change(&rows[1..], &rows[..rows.len() - 1]);
        let repeated = changed == 0.0;
        Ok(if changed <= *still {
            View { change: Some(ViewChange::Unchanged), fresh: 0.0, repeated }
        } else if changed < options.view_threshold * unit {
            View { change: None, fresh: 0.0, repeated }
        } else {
            let part = changed.min(1.0);
            // (1 − r) / (1 + r) for a correlation r from view to view.
            View { change: Some(ViewChange::Changed), fresh: part / (2.0 - part), repeated }
        })
    }

    /// True if the nearest reference is another than that of the last new view, and not beside it:
    /// so the vehicle has moved although the view is hardly another.
    fn nearest_moved(&self, options: &Options) -> bool {
        let Some(last) = &self.state.last_view else { return false };
        let apart = nearest(last).abs_diff(nearest(&self.rows));
        let around = if options.closed { self.rows.len() - apart } else { apart };
        apart.min(around) > BESIDE.max(options.window)
    }

    /// Learns from the last row, that of a view with a new part.
    #[expect(clippy::cast_sign_loss, reason = "ln(1 + count) is at least 0")]
    fn learn(&mut self, options: &Options, spread: Spread, fresh: f64) {
        let SensorState { standardizer, last_view, still: unchanged, lingering, .. } =
            &mut self.state;
        if options.standardize {
            if let Some(last) = last_view {
                let at = nearest(last);
                // References that are near to everything linger, too, but usually.
                let lingers = self.rows[at] <= AMONG * least(&self.rows)
                    && standardizer.count() >= ACQUAINTED
                    && standardizer.usual(spread, at) > USUALLY * within(self.rows[at]);
                *lingering += (f64::from(u8::from(lingers)) - *lingering) / LINGERING;
            }
            // A vehicle that moves on slowly has views with new noise and little else: where it is
            // must not become usual. The correlation of views is taken for the share of those that
            // linger.
            let lingering = lingering.min(MOST_LINGERING);
            let fresh = fresh * (1.0 - lingering) / (1.0 + lingering);
            let level = |count: f64| (30.0 * count.ln_1p()) as u32;
            let before = level(standardizer.count());
            standardizer.count_in(spread, &self.rows, fresh);
            // Not at each step, since it takes as long as all else.
            if level(standardizer.count()) != before {
                *unchanged = still(standardizer, &mut self.steps);
            }
        }
        match last_view {
            Some(last) => last.copy_from_slice(&self.rows),
            None => *last_view = Some(self.rows.clone()),
        }
    }

    /// Learns from a row of distances alone; returns true for a new view.
    pub(super) fn see(&mut self, options: &Options, row: &[f32]) -> Result<bool, ObservationError> {
        self.distances.clear();
        self.distances.extend_from_slice(row);
        let View { fresh, .. } = self.compare(options)?;
        if fresh > 0.0 {
            self.learn(options, self.state.standardizer.spread(), fresh);
        }
        Ok(fresh > 0.0)
    }

    /// Takes a step without a query. The next view then counts as the first after a gap: it may
    /// have changed or not for any reason.
    pub(super) fn miss(&mut self, seeing: Seeing<'_>, control: &RouteControl) {
        self.state.run = None;
        if seeing.options.off_map.is_some() && control.odometry.is_some() {
            self.state.driven = Some(seeing.motion.driven(control));
        }
    }

    /// Control with an odometry reading and the motion before the step.
    pub(super) fn moved(&self, odometry: Option<f64>) -> RouteControl {
        RouteControl { odometry, view: None, before: self.state.driven }
    }

    /// Forgets the last view, but nothing learned of the references.
    pub(super) fn forget(&mut self) {
        let SensorState { last_view, run, lingering, driven, tally, .. } = &mut self.state;
        (*run, *lingering, *driven, *tally) = (None, 0.0, None, Tally::default());
        // Infinite distances are not compared; the memory is kept.
        last_view.iter_mut().for_each(|row| row.fill(f32::INFINITY));
    }

    /// Extends the sensor to more references, the first of which are the present ones.
    ///
    /// Usual scores are those of `fresh`, which treats all references alike. If old references
    /// had learned from many queries and new ones from few, old places would win (on a railway by
    /// pixels, up to 27 times as many wrong matches).
    pub(super) fn extended(&self, fresh: Self) -> Self {
        let mut state = self.state.clone();
        let count = fresh.state.standardizer.references();
        // Infinite distances are not compared.
        state.last_view.iter_mut().for_each(|row| row.resize(count, f32::INFINITY));
        state.standardizer = fresh.state.standardizer;
        Self { state, ..fresh }
    }

    /// Keeps the single-frame odds from now on.
    pub(super) fn keep_alone(&mut self) {
        self.alone = vec![0.0; self.state.standardizer.references()];
    }

    /// log2 of the odds of each place by the last new frame alone.
    pub(super) fn alone(&self) -> &[f32] {
        &self.alone
    }

    /// The least score within the row of the last query.
    pub(super) fn best(&self) -> f64 {
        f64::from(least(&self.rows))
    }

    pub(super) fn standardizer(&self) -> &Standardizer {
        &self.state.standardizer
    }

    pub(super) fn tally(&self) -> &Tally {
        &self.state.tally
    }

    pub(super) fn state(&self) -> &SensorState {
        &self.state
    }

    pub(super) fn set_state(&mut self, state: SensorState) {
        self.state = state;
    }
}
