//! From queries to likelihoods and evidence on moves.

use super::references::References;
use super::{Options, RecognitionError};
use crate::error::InferenceError;
use crate::motion::{Driven, RouteControl, RouteTransition, ViewChange, ViewEvidence};
use crate::observation::{ObservationError, Standardizer, next_view};
use crate::transition::Transition;

/// The camera, with all that it has learned of the references so far. It is causal: live and in
/// recordings, a step depends on no later query.
#[derive(Debug, Clone)]
pub(super) struct Sensor {
    state: SensorState,
    distances: Vec<f32>,
    more: Vec<f32>,
    /// log2 of the odds of each place by the last new frame alone, if kept.
    alone: Vec<f32>,
}

/// The part of a sensor that changes with each query.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SensorState {
    pub(crate) standardizer: Standardizer,
    /// The last view that was new.
    pub(crate) last_view: Option<Vec<f32>>,
    /// Length of the run of views like the last one, changed or not.
    pub(crate) run: Option<(ViewChange, u32)>,
    /// Motion by odometry and views, if the vehicle may leave the map.
    pub(crate) driven: Option<Driven>,
    /// Mean gain of each reference over the last frames, in log-odds.
    pub(crate) gained: Vec<f32>,
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
        Self {
            state: SensorState {
                gained: vec![0.0; standardizer.references()],
                standardizer,
                last_view: None,
                run: None,
                driven: None,
            },
            distances: Vec::new(),
            more: Vec::new(),
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
        let failed = |source| RecognitionError::Query { step, source };
        let control = self.moved(odometry);
        let SensorState { standardizer, last_view, run, driven, gained } = &mut self.state;
        let n = references.count();
        // Checked first, so that an error leaves the sensor as it was.
        let moments = standardizer.moments(&self.distances).map_err(failed)?;
        let nowhere = moments.count == 0.0;
        if nowhere && options.off_map.is_none() {
            return Err(failed(ObservationError::NoMatch));
        }
        let refused = |source| InferenceError::Control { step, source };
        seeing.motion.check_control(&control).map_err(refused)?;
        let view = next_view(last_view, options.view_threshold, &self.distances, &moments)
            .map_err(failed)?;
        if view == ViewChange::Unchanged && !nowhere {
            // A repeated view adds no evidence on the place.
            out.fill(1.0);
        } else {
            let (places, off) = out.split_at_mut(n);
            if options.standardize && !nowhere {
                standardizer.observed_scores_of(&self.distances, &moments, places);
            } else {
                standardizer.scores_of(&self.distances, &moments, places);
            }
            options.odds.log2_odds_of(&places[..self.alone.len()], &mut self.alone);
            options.odds.habituated(options.habituation, gained, places);
            off.fill(if options.off_map.is_some() {
                options.off_map_odds
            } else {
                options.lost_odds
            });
        }
        let count = match *run {
            Some((before, count)) if before == view => count.saturating_add(1),
            _ => 1,
        };
        // The first view has no view before it.
        let first = run.is_none();
        *run = Some((view, count));
        let fades = match view {
            ViewChange::Changed => options.changed_fades,
            ViewChange::Unchanged => options.unchanged_fades,
        };
        let weight = 1.0 / (1.0 + f64::from(count - 1) * fades);
        let evidence = ViewEvidence { view, weight };
        let view = (options.use_views && !first).then_some(evidence);
        let control = RouteControl { view, ..control };
        // Motion before the step matters off the map only: a lost vehicle need not go on as it
        // did.
        if options.off_map.is_some() && (view.is_some() || odometry.is_some()) {
            *driven = Some(seeing.motion.driven(&control));
        }
        Ok(control)
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
        let SensorState { last_view, run, driven, gained, .. } = &mut self.state;
        (*run, *driven) = (None, None);
        gained.fill(0.0);
        // Infinite distances are not compared; the memory is kept.
        last_view.iter_mut().for_each(|row| row.fill(f32::INFINITY));
    }

    /// Extends the sensor to more references, the first of which are the present ones.
    ///
    /// Usual scores are those of `fresh`, which treats all references alike. If old references
    /// had learned from many queries and new ones from few, old places would win (on a railway by
    /// pixels, up to 27 times as many wrong matches).
    pub(super) fn extended(&self, fresh: Self) -> Self {
        let SensorState { mut last_view, run, driven, mut gained, .. } = self.state.clone();
        let count = fresh.state.gained.len();
        gained.resize(count, 0.0);
        // Infinite distances are not compared.
        last_view.iter_mut().for_each(|row| row.resize(count, f32::INFINITY));
        let standardizer = fresh.state.standardizer;
        Self { state: SensorState { standardizer, last_view, run, driven, gained }, ..fresh }
    }

    /// Keeps the single-frame odds from now on.
    pub(super) fn keep_alone(&mut self) {
        self.alone = vec![0.0; self.state.standardizer.references()];
    }

    /// log2 of the odds of each place by the last new frame alone.
    pub(super) fn alone(&self) -> &[f32] {
        &self.alone
    }

    /// The distances of the last query.
    pub(super) fn distances(&self) -> &[f32] {
        &self.distances
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
