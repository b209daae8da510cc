//! From queries to what the filter takes: likelihoods, and evidence on the move.

use super::references::References;
use super::{Options, RecognitionError};
use crate::motion::{RouteControl, View, ViewEvidence};
use crate::observation::{ObservationError, OddsTable, Standardizer, next_view};

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
#[derive(Debug, PartialEq)]
pub(crate) struct SensorState {
    pub(crate) standardizer: Standardizer,
    /// The last view that was new.
    pub(crate) last_view: Option<Vec<f32>>,
    /// How many views in a row have been the same as the last, changed or not.
    pub(crate) run: Option<(View, u32)>,
    /// The best score of the last new query.
    pub(crate) best: f64,
}

impl Clone for SensorState {
    fn clone(&self) -> Self {
        let Self { standardizer, last_view, run, best } = self;
        let (standardizer, last_view) = (standardizer.clone(), last_view.clone());
        Self { standardizer, last_view, run: *run, best: *best }
    }

    /// Takes no new memory.
    fn clone_from(&mut self, source: &Self) {
        let Self { standardizer, last_view, run, best } = source;
        self.standardizer.clone_from(standardizer);
        self.last_view.clone_from(last_view);
        (self.run, self.best) = (*run, *best);
    }
}

/// What a step of the sensor depends on.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seeing<'a> {
    pub(super) options: &'a Options,
    pub(super) references: &'a References,
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
        let Seeing { options, references } = seeing;
        references.distances(step, query, &mut self.distances, &mut self.more)?;
        let failed = |source| RecognitionError::Query { step, source };
        let Self { state: SensorState { standardizer, last_view, run, best }, .. } = self;
        let n = references.count();
        // The scores first: they may be an error, after which nothing has changed.
        let (places, off) = out.split_at_mut(n);
        standardizer.scores(&self.distances, places).map_err(failed)?;
        let nowhere = self.distances.iter().all(|d| *d == f32::INFINITY);
        if nowhere && options.off_map.is_none() {
            return Err(failed(ObservationError::NoMatch));
        }
        let view = next_view(last_view, options.view_threshold, &self.distances).map_err(failed)?;
        if view == View::Unchanged && !nowhere {
            // It says nothing that the frame before has not said.
            places.fill(1.0);
        } else {
            if options.standardize && !nowhere {
                standardizer.observed_scores(&self.distances, places).map_err(failed)?;
            }
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
        Ok(RouteControl { odometry, view })
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

    pub(super) fn state_mut(&mut self) -> &mut SensorState {
        &mut self.state
    }
}
