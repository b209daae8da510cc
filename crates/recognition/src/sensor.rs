//! The camera: from the distances of a query to likelihoods of places, to evidence on the move, to
//! what it says of a distraction, and to what it teaches about references and matches
//! (`guide::formulas`, Images as likelihoods).
//!
//! A step takes two calls, so that an error between them leaves no trace: [`Sensor::observe`]
//! changes scratch memory alone, and [`Sensor::learn`] follows once the filter has taken the step.

use super::advantage::Advantage;
use super::readings::Readings;
use super::recognizer::{Phantom, Recognizer, check_control};
use super::views::{View, least, nearest};
use super::{Options, RecognitionError};
use crate::motion::{Driven, RouteControl, RouteTransition, ViewChange, ViewEvidence};
use crate::observation::{
    MatchOdds, RowScratch, Spread, Standardizer, ViewError, bound_by_neighbours, row_scores, within,
};
use wayfix::transition::Distraction;

/// Shares of views that say nothing, match weakly and match clearly where the camera follows
/// another place than the vehicle's, before any view: less well than the place itself, or the first
/// place could not be believed.
const PHANTOM: MatchOdds = MatchOdds { shares: [0.3, 0.35, 0.35] };
/// Numbers of views that these shares, and those of [`Options::odds`], count as. The phantom's are
/// learned more slowly: if it came to match as well as a place, a vehicle that was placed wrongly at
/// first would not be found again.
const KIND_COUNT: f64 = 10.0;
const PHANTOM_COUNT: f64 = 30.0;

/// A view is unchanged up to this part of this quantile of the changes from reference to reference:
/// nearly all steps along the route change it more, even those in dark stretches.
const STILL_SHARE: f64 = 0.02;
const STILL_PART: f64 = 0.2;

/// Share of the least score up to which a reference is among the nearest.
const NEAREST_SHARE: f32 = 0.8;
/// Share of its score in a row above which the usual score of a reference explains that it is near.
const USUAL_SHARE: f32 = 0.3;
/// Largest number of queries that usual scores learned before a drive count as: they come from
/// other places, or from the same drive again.
pub(super) const KNOWN_COUNT: f64 = 10.0;
/// Number of queries after which usual scores are known well enough for that: those known before
/// the drive may be of another season, so ten of the drive are required.
const LEAST_QUERIES: f64 = 2.0 * KNOWN_COUNT;
/// Largest share of lingering views that counts, so that a reference that becomes near to every
/// query is learned in the end.
const MOST_LINGERING: f64 = 0.8;
/// Number of new views over which the share of lingering ones fades to 1/e.
const LINGERING: f64 = 20.0;

/// Largest change with which a view still counts as unchanged.
fn still(standardizer: &Standardizer, scratch: &mut Vec<f64>) -> f64 {
    STILL_PART * standardizer.step_quantile(STILL_SHARE, scratch)
}

/// A query seen by the sensor, before the sensor has learned from it.
#[derive(Debug)]
pub(super) struct Sighting {
    /// Odometry, the view, the motion before the step, and the likelihoods of a distraction.
    pub(super) control: Distraction<RouteControl>,
    /// Reading, which counts if the control has it.
    odometry: Option<f64>,
    view: View,
    /// Length of the run of views like this one, including it.
    run: u32,
    /// Variances of usual scores, if the view is evidence on the place.
    spread: Option<Spread>,
}

impl Sighting {
    /// True if the view is evidence on the place.
    pub(super) fn is_new(&self) -> bool {
        self.spread.is_some()
    }
}

/// Scratch memory of a sensor. Except for `standardized`, no result depends on what an earlier step
/// left in it.
#[derive(Debug, Clone, Default)]
pub(super) struct Scratch {
    distances: Vec<f32>,
    more: Vec<f32>,
    /// Scores within the row of the last query, and the number of references compared with it.
    scores: Vec<f32>,
    compared: usize,
    rows: RowScratch,
    /// Changes from reference to reference.
    changes: Vec<f64>,
    /// Standardised scores of the last new view.
    pub(super) standardized: Vec<f64>,
    /// Likelihood of each place, of an attentive camera off the map, and of a distracted camera.
    pub(super) likelihoods: Vec<f64>,
    /// Likelihoods of the states of the phantom.
    phantom: Vec<f64>,
}

impl Scratch {
    /// Likelihoods of a step without a query: 1 everywhere.
    pub(super) fn fill(&mut self, references: usize) {
        self.likelihoods.clear();
        self.likelihoods.resize(references + 2, 1.0);
    }
}

/// Filtered probabilities that the sensor learns from: of an attentive camera at each place, and of
/// the phantom at each place.
#[derive(Debug, Clone, Copy)]
pub(super) struct Positions<'a> {
    pub(super) attentive: &'a [f64],
    pub(super) phantom: &'a [f64],
}

/// State of the camera, with all that it has learned about the references so far: plain data, and
/// its own snapshot. It is causal: live and in recordings, a step depends on no later query.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Sensor {
    pub(crate) standardizer: Standardizer,
    /// Scores within the row of the last view that was new.
    pub(crate) last_view: Option<Vec<f32>>,
    /// Length of the run of views like the last one, changed or not.
    pub(crate) run: Option<(Option<ViewChange>, u32)>,
    /// Largest change with which a view still counts as unchanged.
    pub(crate) still: f64,
    /// Share of recent new views where the reference that was nearest before is still among the
    /// nearest.
    pub(crate) lingering: f64,
    /// Motion by odometry and views, if the vehicle may leave the map.
    pub(crate) driven: Option<Driven>,
    /// Run of equal odometry readings.
    pub(crate) readings: Readings,
    /// Numbers of views of each kind, at the vehicle's place and at the phantom's.
    pub(crate) kinds: [[f64; 3]; 2],
    /// How much better views match on the map than off it.
    pub(crate) advantage: Advantage,
}

/// Odds with the shares of some numbers of views.
fn odds(kinds: [f64; 3]) -> MatchOdds {
    let sum: f64 = kinds.iter().sum();
    MatchOdds { shares: kinds.map(|kind| kind / sum) }
}

impl Sensor {
    pub(super) fn new(standardizer: Standardizer, options: &Options) -> Self {
        let known = |odds: MatchOdds, count: f64| odds.shares.map(|share| share * count);
        Self {
            still: still(&standardizer, &mut Vec::new()),
            standardizer,
            last_view: None,
            run: None,
            lingering: 0.0,
            driven: None,
            readings: Readings::default(),
            kinds: [known(options.odds, KIND_COUNT), known(PHANTOM, PHANTOM_COUNT)],
            advantage: Advantage::default(),
        }
    }

    /// Computes the likelihoods of the query of a step into the scratch memory, and lets the
    /// phantom propose its next belief. `attentive` is the filtered probability, before the step,
    /// of a camera that sees the vehicle's place.
    pub(super) fn observe(
        &self,
        recognizer: &Recognizer,
        step: usize,
        (query, odometry): (&[f32], Option<f64>),
        attentive: f64,
        phantom: &mut Phantom,
        scratch: &mut Scratch,
    ) -> Result<Sighting, RecognitionError> {
        let (references, options) = (&recognizer.references, recognizer.options());
        let n = references.count();
        let failed = |cause| RecognitionError::query(step, cause);
        references.distances(step, query, &mut scratch.distances, &mut scratch.more)?;
        let view = self.compare(options, scratch).map_err(failed)?;
        let nowhere = scratch.compared == 0;
        if nowhere && options.off_map.is_none() {
            return Err(failed(ViewError::NoMatch));
        }
        // A view that matches nothing at all is evidence of being off the map, even if it is
        // repeated.
        let spread = (view.fresh > 0.0 || nowhere).then(|| self.standardizer.spread());
        self.weigh(spread, recognizer.phantom_states(), options.closed, scratch);
        // A lost frame sets `self.run` to `None`, so a gap always starts a new run.
        let run = match self.run {
            Some((before, count)) if before == view.change => count.saturating_add(1),
            _ => 1,
        };
        // The k-th view of a run counts 1 / (1 + (k − 1) f), with f = `view_fades`: together the
        // views grow like ln k / f.
        let weight = 1.0 / (1.0 + f64::from(run - 1) * options.view_fades);
        let evidence = view.change.map(|view| ViewEvidence { view, weight });
        // The first view has no view to be compared with.
        let evidence = evidence.filter(|_| options.use_views && self.run.is_some());
        let control = RouteControl { view: evidence, ..self.control(view.change, odometry) };
        check_control(recognizer.motion(), step, &control)?;
        let Scratch { likelihoods, phantom: seen, .. } = scratch;
        let (begins, continues) = if step == 1 {
            let (begins, _) = phantom.first(seen)?;
            // No move leads to the first step, so the observation itself has the likelihoods.
            (likelihoods[n], likelihoods[n + 1]) = (begins, begins);
            (begins, begins)
        } else {
            let (begins, continues) = phantom.observe(&control, seen, 1.0 - attentive)?;
            // Off the map the camera follows a phantom, too: views elsewhere look alike. A lost
            // vehicle is on the map.
            let new = spread.is_some() && options.off_map.is_some();
            let advantage = if new { self.advantage.least().exp() } else { 1.0 };
            (likelihoods[n], likelihoods[n + 1]) = (continues * advantage, 1.0);
            (begins, continues)
        };
        Ok(Sighting {
            control: Distraction { control, begins, continues },
            odometry,
            view,
            run,
            spread,
        })
    }

    /// Computes the odds of each place, and of each state of the phantom; 1 for a view that is not
    /// new.
    fn weigh(
        &self,
        spread: Option<Spread>,
        phantom_states: usize,
        closed: bool,
        scratch: &mut Scratch,
    ) {
        let Scratch { scores, standardized, likelihoods, phantom, .. } = scratch;
        let n = scores.len();
        likelihoods.resize(n + 2, 1.0);
        phantom.resize(phantom_states, 1.0);
        let Some(spread) = spread else {
            likelihoods.fill(1.0);
            phantom.fill(1.0);
            return;
        };
        standardized.resize(n, 0.0);
        self.standardizer.standardize(spread, scores, standardized);
        bound_by_neighbours(standardized, closed, self.standardizer.count());
        let [place, other] = self.kinds.map(odds);
        place.odds_of(standardized, &mut likelihoods[..n]);
        let (first, rest) = phantom.split_at_mut(n);
        other.odds_of(standardized, first);
        // A reference that was not compared says nothing of the phantom.
        first.iter_mut().filter(|odds| **odds == 0.0).for_each(|odds| *odds = other.shares[0]);
        rest.chunks_exact_mut(n).for_each(|layer| layer.copy_from_slice(first));
    }

    /// Learns from a query after the filter has taken its step; `scratch` must be as
    /// [`observe`](Self::observe) left it.
    pub(super) fn learn(
        &mut self,
        recognizer: &Recognizer,
        sighting: &Sighting,
        positions: Positions<'_>,
        scratch: &mut Scratch,
    ) {
        let Sighting { control, odometry, view, run, spread } = sighting;
        let Distraction { control, continues, .. } = control;
        if let Some(spread) = spread {
            self.learn_scores(recognizer.options(), *spread, view.fresh, scratch);
            // The share of views that say nothing has odds of 1, so its part is Σ p ⁄ o: the
            // predicted probabilities, but for their likelihood.
            let [place, phantom] = self.kinds.map(odds);
            let seen = place.kinds(&scratch.standardized, positions.attentive);
            let attentive: f64 = positions.attentive.iter().sum();
            let likelihood = attentive * place.shares[0] / seen[0];
            // A place that was not compared is ruled out, and its probability is not known here.
            if scratch.compared == scratch.scores.len() {
                self.advantage.observe(attentive, likelihood.ln(), continues.ln());
            }
            let followed = phantom.kinds(&scratch.standardized, positions.phantom);
            for (kinds, seen) in self.kinds.iter_mut().zip([seen, followed]) {
                kinds.iter_mut().zip(seen).for_each(|(kind, seen)| *kind += seen);
            }
        }
        self.readings.record(self.run.and(view.change), *odometry);
        self.run = Some((view.change, *run));
        self.drive(recognizer.motion(), recognizer.options(), control);
    }

    /// Takes a step without a query. The next view then counts as the first after a gap: whether it
    /// has changed may have any reason.
    pub(super) fn skip(
        &mut self,
        motion: &RouteTransition,
        options: &Options,
        control: &RouteControl,
        odometry: Option<f64>,
    ) {
        self.readings.record(None, odometry);
        self.run = None;
        self.drive(motion, options, control);
    }

    /// Control of a step by odometry, if the reading counts, after the motion before the step. A
    /// reading that is not valid differs from the last one, so it counts, and the control is refused.
    pub(super) fn control(
        &self,
        change: Option<ViewChange>,
        odometry: Option<f64>,
    ) -> RouteControl {
        let odometry = self.readings.counted(change, odometry);
        RouteControl { odometry, view: None, before: self.driven }
    }

    /// Estimates the motion of a step. It is used off the map only, and only if that is modelled: a
    /// lost vehicle need not go on as it did.
    fn drive(&mut self, motion: &RouteTransition, options: &Options, control: &RouteControl) {
        let measured = control.view.is_some() || control.odometry.is_some();
        if measured && options.off_map.is_some() {
            self.driven = Some(motion.driven(control));
        }
    }

    /// Compares the row of distances in the scratch memory with that of the last new view.
    fn compare(&self, options: &Options, scratch: &mut Scratch) -> Result<View, ViewError> {
        let Scratch { distances, scores, compared, rows, .. } = scratch;
        self.standardizer.check(distances)?;
        *compared = row_scores(distances, scores, rows)?;
        Ok(match &self.last_view {
            Some(last) => View::beside(last, self.still, scores, options),
            None => View::FIRST,
        })
    }

    /// Learns usual scores from the last row, which is that of a view with a new part.
    #[expect(clippy::cast_sign_loss, reason = "ln(1 + count) is at least 0")]
    fn learn_scores(
        &mut self,
        options: &Options,
        spread: Spread,
        fresh: f64,
        scratch: &mut Scratch,
    ) {
        let Self { standardizer, last_view, lingering, .. } = self;
        let Scratch { scores, changes, .. } = scratch;
        if options.standardize {
            if let Some(last) = last_view {
                let at = nearest(last);
                // A reference that is near to every query also stays nearest, but then its usual
                // score explains it.
                let lingers = scores[at] <= NEAREST_SHARE * least(scores)
                    && standardizer.count() >= LEAST_QUERIES
                    && standardizer.usual(spread, at) > USUAL_SHARE * within(scores[at]);
                *lingering += (f64::from(u8::from(lingers)) - *lingering) / LINGERING;
            }
            // A vehicle that moves on slowly has views with new noise and little else: its place
            // must not become usual. The share l of lingering views stands for the correlation of
            // views, and the weight (1 − l) / (1 + l) for the independent part (`guide::formulas`,
            // Views).
            let lingering = lingering.min(MOST_LINGERING);
            let fresh = fresh * (1.0 - lingering) / (1.0 + lingering);
            let level = |count: f64| (30.0 * count.ln_1p()) as u32;
            let before = level(standardizer.count());
            standardizer.add_scores(spread, scores, fresh);
            // Computing the threshold takes as long as all else, so it is only updated at some
            // counts: about 30 times for each factor e of the count.
            if level(standardizer.count()) != before {
                self.still = still(standardizer, changes);
            }
        }
        match last_view {
            Some(last) => last.copy_from_slice(scores),
            None => *last_view = Some(scores.clone()),
        }
    }

    /// Learns usual scores from a row of distances, without a step.
    pub(super) fn learn_row(
        &mut self,
        options: &Options,
        row: &[f32],
        scratch: &mut Scratch,
    ) -> Result<(), ViewError> {
        scratch.distances.clear();
        scratch.distances.extend_from_slice(row);
        let View { fresh, .. } = self.compare(options, scratch)?;
        if fresh > 0.0 {
            self.learn_scores(options, self.standardizer.spread(), fresh, scratch);
        }
        Ok(())
    }

    /// Forgets the last view, but nothing learned about the references.
    pub(super) fn forget(&mut self) {
        (self.run, self.lingering, self.driven) = (None, 0.0, None);
        self.readings = Readings::default();
        // Infinite distances are left out of comparisons, so the next view is new; the memory is
        // kept.
        self.last_view.iter_mut().for_each(|row| row.fill(f32::INFINITY));
    }

    /// Extends the sensor to more references, which start with the present ones.
    ///
    /// Usual scores are those of `fresh`, which treats all references alike. If old references had
    /// learned from many queries and new ones from few, old places would win (on a railway by
    /// pixels, up to 27 times as many wrong matches).
    pub(super) fn extended(&self, fresh: &Self) -> Self {
        let mut sensor = Self { standardizer: fresh.standardizer.clone(), ..self.clone() };
        let count = fresh.standardizer.references();
        // Infinite distances are left out of comparisons.
        sensor.last_view.iter_mut().for_each(|row| row.resize(count, f32::INFINITY));
        sensor
    }
}
