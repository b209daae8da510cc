//! From queries to what the filter takes: likelihoods, and evidence on the move.

use super::references::References;
use super::{Options, RecognitionError};
use crate::motion::{RouteControl, RouteTransition, View, ViewEvidence};
use crate::observation::{ObservationError, OddsTable, Standardizer, next_view};
use crate::transition::Transition;

/// The camera, with what it has learned of the references so far. Live and afterwards it
/// sees no more than was seen by then.
#[derive(Debug, Clone)]
pub(super) struct Sensor {
    state: SensorState,
    odds: OddsTable,
    distances: Vec<f32>,
    more: Vec<f32>,
}

/// What changes with each query.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SensorState {
    pub(crate) standardizer: Standardizer,
    /// The last view that was new.
    pub(crate) last_view: Option<Vec<f32>>,
    /// How many views in a row have been the same as the last, changed or not.
    pub(crate) run: Option<(View, u32)>,
    /// The best score of the last new query.
    pub(crate) best: f64,
}

/// What a step of the sensor depends on.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seeing<'a> {
    pub(super) options: &'a Options,
    pub(super) references: &'a References,
    pub(super) motion: &'a RouteTransition,
}

impl Sensor {
    pub(super) fn new(standardizer: Standardizer, options: &Options) -> Self {
        Self {
            state: SensorState { standardizer, last_view: None, run: None, best: f64::INFINITY },
            odds: options.odds.table(),
            distances: Vec::new(),
            more: Vec::new(),
        }
    }

    /// Takes the query of a step: writes the likelihood of each place, and that of off the
    /// map behind them, and gives the control.
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
        let failed = |source| RecognitionError::Query { step, source };
        let Self { state: SensorState { standardizer, last_view, run, best }, .. } = self;
        let n = references.count();
        // Checked first: after an error nothing has changed.
        standardizer.check(&self.distances).map_err(failed)?;
        let nowhere = self.distances.iter().all(|d| *d == f32::INFINITY);
        if nowhere && options.off_map.is_none() {
            return Err(failed(ObservationError::NoMatch));
        }
        let control = RouteControl { odometry, view: None };
        seeing.motion.check_control(&control)?;
        let (places, off) = out.split_at_mut(n);
        let view = next_view(last_view, options.view_threshold, &self.distances).map_err(failed)?;
        if view == View::Unchanged && !nowhere {
            // It says nothing that the frame before has not said.
            places.fill(1.0);
        } else {
            let scored = if options.standardize && !nowhere {
                standardizer.observed_scores(&self.distances, places)
            } else {
                standardizer.scores(&self.distances, places)
            };
            scored.map_err(failed)?;
            *best = places.iter().copied().fold(f64::INFINITY, f64::min);
            places.iter_mut().for_each(|score| *score = self.odds.odds(*score));
        }
        off.fill(1.0);
        let count = match *run {
            Some((before, count)) if before == view => count.saturating_add(1),
            _ => 1,
        };
        // The first view of all has nothing before it.
        let first = run.is_none();
        *run = Some((view, count));
        let fades = match view {
            View::Changed => options.changed_fades,
            View::Unchanged => options.unchanged_fades,
        };
        let weight = 1.0 / (1.0 + f64::from(count - 1) * fades);
        let evidence = ViewEvidence { view, weight };
        let view = (options.use_views && !first).then_some(evidence);
        Ok(RouteControl { view, ..control })
    }

    /// The best score of the last new query.
    pub(super) fn best_score(&self) -> f64 {
        self.state.best
    }

    pub(super) fn standardizer(&self) -> &Standardizer {
        &self.state.standardizer
    }

    pub(super) fn state(&self) -> &SensorState {
        &self.state
    }

    pub(super) fn set_state(&mut self, state: SensorState) {
        self.state = state;
    }
}
