//! From queries to what the filter takes: likelihoods, and evidence on the move.

use super::references::References;
use super::{Options, RecognitionError};
use crate::motion::{RouteControl, RouteTransition, View, ViewEvidence};
use crate::observation::{ObservationError, OddsTable, Standardizer, Views};
use crate::transition::Transition;

/// The camera, with what it has learned of the references so far. Live and afterwards it
/// sees no more than was seen by then.
#[derive(Debug, Clone)]
pub(super) struct Sensor {
    standardizer: Standardizer,
    views: Views,
    odds: OddsTable,
    /// How many views in a row have been the same as the last, changed or not.
    run: Option<(View, u32)>,
    /// The best score of the last query.
    best: f64,
    distances: Vec<f32>,
    more: Vec<f32>,
}

/// What a step of the sensor depends on.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seeing<'a> {
    pub(super) options: &'a Options,
    pub(super) references: &'a References,
    pub(super) motion: &'a RouteTransition,
}

impl Sensor {
    pub(super) fn new(
        standardizer: Standardizer,
        options: &Options,
    ) -> Result<Self, ObservationError> {
        Ok(Self {
            standardizer,
            views: Views::new(options.view_threshold)?,
            odds: options.odds.table(),
            run: None,
            best: f64::INFINITY,
            distances: Vec::new(),
            more: Vec::new(),
        })
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
        let n = references.count();
        let nowhere = self.distances.iter().all(|d| *d == f32::INFINITY);
        if nowhere && options.off_map.is_none() {
            return Err(failed(ObservationError::NoMatch));
        }
        let (places, off) = out.split_at_mut(n);
        // Checked first: after an error nothing has changed.
        let control = RouteControl { odometry, view: None };
        self.standardizer.check(&self.distances).map_err(failed)?;
        seeing.motion.check_control(&control)?;
        let view = self.views.next(&self.distances).map_err(failed)?;
        if view == View::Unchanged && !nowhere {
            // It says nothing that the frame before has not said.
            places.fill(1.0);
        } else {
            let scored = if options.standardize && !nowhere {
                self.standardizer.observed_scores(&self.distances, places)
            } else {
                self.standardizer.scores(&self.distances, places)
            };
            scored.map_err(failed)?;
            self.best = places.iter().copied().fold(f64::INFINITY, f64::min);
            places.iter_mut().for_each(|score| *score = self.odds.odds(*score));
        }
        off.fill(1.0);
        let count = match self.run {
            Some((before, count)) if before == view => count.saturating_add(1),
            _ => 1,
        };
        // The first view of all has nothing before it.
        let first = self.run.is_none();
        self.run = Some((view, count));
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
        self.best
    }

    pub(super) fn standardizer(&self) -> &Standardizer {
        &self.standardizer
    }
}
