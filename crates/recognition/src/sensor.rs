//! The camera: references, their comparison with queries (of several traverses, the smallest distance
//! to each place), and from there to likelihoods, to evidence on the move, and to what the query
//! teaches about the references (`guide::formulas`, Images as likelihoods).
//!
//! A step takes two calls, so that an error between them leaves no trace: [`Sensor::observe`]
//! changes scratch memory alone, and [`Sensor::learn`] follows once the filter has taken the step.

use std::ops::Range;

use super::views::{Tally, View, least, nearest};
use super::{Options, RecognitionError};
use crate::motion::{Driven, RouteControl, RouteTransition, ViewChange, ViewEvidence};
use crate::observation::{
    Distance, ReferenceDescriptors, RowScratch, Spread, Standardizer, ViewError, row_scores, within,
};
use wayfix::error::OutOfRange;

/// Number of evenly spaced references that are compared with all others, to learn the usual scores
/// of each.
const SAMPLE: usize = 64;
/// Distance along the route within which references always count as alike because they are near,
/// and the score below which farther ones also do.
const NEAR: usize = 10;
const FAR_SCORE: f32 = -1.0;

/// A view that teaches the usual scores of references.
#[derive(Debug, Clone, Copy)]
pub(super) struct Exemplar<'a> {
    pub(super) descriptor: &'a [f32],
    /// The reference that shows the same view, if there is one: those around it say nothing about
    /// usual scores.
    pub(super) reference: Option<usize>,
    /// Weight, in queries.
    pub(super) weight: f64,
}

/// Scratch memory for [`References::observe`].
#[derive(Debug, Default)]
pub(super) struct ExemplarScratch {
    row: Vec<f32>,
    more: Vec<f32>,
    scores: Vec<f32>,
    rows: RowScratch,
}

/// References around a given one that look like it because they are near.
fn alike_around(
    row: &[f32],
    at: usize,
    scores: &mut Vec<f32>,
    scratch: &mut RowScratch,
) -> Result<Range<usize>, ViewError> {
    row_scores(row, scores, scratch)?;
    let alike = |score: &&f32| **score < FAR_SCORE;
    let before = scores[..at].iter().rev().take_while(alike).count().max(NEAR);
    let after = scores[at + 1..].iter().take_while(alike).count().max(NEAR);
    Ok(at.saturating_sub(before)..(at + after + 1).min(row.len()))
}

/// References of a route: descriptors of one traverse or of several, or only their number if
/// queries come as distances.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum References {
    /// Number of references; a query is a row of that many distances.
    Compared(usize),
    /// Descriptors of each traverse, in the form of queries; reference i of each shows place i.
    Descriptors(Vec<ReferenceDescriptors>),
}

impl References {
    /// Checks the descriptors of several traverses of the same places.
    pub(super) fn from_traverses<R: AsRef<[f32]>>(
        traverses: &[&[R]],
        distance: Distance,
    ) -> Result<Self, RecognitionError> {
        let mut all = Vec::new();
        for (traverse, rows) in traverses.iter().enumerate() {
            let failed = |cause| RecognitionError::references(traverse, cause);
            all.push(ReferenceDescriptors::from_rows(rows, distance).map_err(failed)?);
        }
        let Some(first) = all.first() else {
            return Err(OutOfRange::none("the number of traverses").into());
        };
        for other in &all[1..] {
            let counts = [
                ("the number of references of a traverse", other.count(), first.count()),
                ("the number of numbers of a descriptor", other.dimension(), first.dimension()),
            ];
            if let Some(&(what, found, expected)) = counts.iter().find(|(_, a, b)| a != b) {
                return Err(OutOfRange::count(what, found, expected).into());
            }
        }
        Ok(Self::Descriptors(all))
    }

    /// Estimates the usual scores of each reference from the other references: one that looks like
    /// many of them looks like many queries, too (on one recording in two seasons, means correlate
    /// by 0.7 and deviations by 0.8).
    pub(super) fn standardizer(&self) -> Result<Standardizer, ViewError> {
        let count = self.count();
        let mut standardizer = Standardizer::new(count)?;
        let Self::Descriptors(traverses) = self else { return Ok(standardizer) };
        let sample = SAMPLE.min(count);
        let mut scratch = ExemplarScratch::default();
        for at in (0..sample).map(|at| at * count / sample) {
            let Some(descriptor) = traverses[0].descriptor(at) else { continue };
            let view = Exemplar { descriptor: &descriptor, reference: Some(at), weight: 1.0 };
            self.observe(view, &mut standardizer, &mut scratch)?;
        }
        Ok(standardizer)
    }

    /// Learns the usual scores of each reference from a view.
    pub(super) fn observe(
        &self,
        view: Exemplar<'_>,
        standardizer: &mut Standardizer,
        scratch: &mut ExemplarScratch,
    ) -> Result<(), ViewError> {
        let ExemplarScratch { row, more, scores, rows } = scratch;
        // A view that cannot be compared, such as a zero descriptor, teaches nothing.
        if self.distances(0, view.descriptor, row, more).is_err() {
            return Ok(());
        }
        if let Some(at) = view.reference.filter(|at| *at < row.len()) {
            let near = alike_around(row, at, scores, rows)?;
            // The standardizer leaves out infinite distances.
            row[near].fill(f32::INFINITY);
        }
        row_scores(row, scores, rows)?;
        standardizer.add_scores(standardizer.spread(), scores, view.weight);
        Ok(())
    }

    pub(super) fn count(&self) -> usize {
        match self {
            Self::Compared(count) => *count,
            Self::Descriptors(traverses) => traverses[0].count(),
        }
    }

    /// Computes the distance of a query to each place: the smallest over the traverses, since a
    /// place that looks right in one season is right. `more` is scratch memory.
    pub(super) fn distances(
        &self,
        step: usize,
        query: &[f32],
        out: &mut Vec<f32>,
        more: &mut Vec<f32>,
    ) -> Result<(), RecognitionError> {
        let failed = |cause| RecognitionError::descriptor(step, cause);
        match self {
            Self::Compared(_) => {
                out.clear();
                out.extend_from_slice(query);
            }
            Self::Descriptors(traverses) => {
                out.resize(self.count(), 0.0);
                traverses[0].distances_into(query, out).map_err(failed)?;
                for traverse in &traverses[1..] {
                    more.resize(out.len(), 0.0);
                    traverse.distances_into(query, more).map_err(failed)?;
                    out.iter_mut().zip(&*more).for_each(|(a, b)| *a = a.min(*b));
                }
            }
        }
        Ok(())
    }
}

/// Share of a view that must be new for it to count as a whole witness: along a densely sampled
/// route, successive frames are partly one witness.
const WITNESS: f64 = 0.03;
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
    /// Odometry, the view, and the motion before the step.
    pub(super) control: RouteControl,
    view: View,
    /// Length of the run of views like this one, including it.
    run: u32,
    /// Variances of usual scores, if the view is evidence on the place.
    spread: Option<Spread>,
}

/// Scratch memory of a sensor. Except for `single_odds`, no result depends on what an earlier step
/// left in it.
#[derive(Debug, Clone, Default)]
pub(super) struct Scratch {
    distances: Vec<f32>,
    more: Vec<f32>,
    /// Scores within the row of the last query.
    scores: Vec<f32>,
    rows: RowScratch,
    /// Changes from reference to reference.
    changes: Vec<f64>,
    /// Likelihood of each place, then that of off the map.
    pub(super) likelihoods: Vec<f64>,
    /// log2 of the odds of each place by the last new frame alone; empty if they are not wanted.
    pub(super) single_odds: Vec<f32>,
}

impl Scratch {
    /// Least score within the row of the last query.
    pub(super) fn best_score(&self) -> f64 {
        f64::from(least(&self.scores))
    }
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
    /// Recent views and readings.
    pub(crate) tally: Tally,
}

impl Sensor {
    pub(super) fn new(standardizer: Standardizer) -> Self {
        Self {
            still: still(&standardizer, &mut Vec::new()),
            standardizer,
            last_view: None,
            run: None,
            lingering: 0.0,
            driven: None,
            tally: Tally::default(),
        }
    }

    /// Computes the likelihoods of the query of a step into the scratch memory. The odometry
    /// reading is not checked.
    pub(super) fn observe(
        &self,
        references: &References,
        options: &Options,
        step: usize,
        query: &[f32],
        odometry: Option<f64>,
        scratch: &mut Scratch,
    ) -> Result<Sighting, RecognitionError> {
        let n = references.count();
        let failed = |cause| RecognitionError::query(step, cause);
        references.distances(step, query, &mut scratch.distances, &mut scratch.more)?;
        let view = self.compare(options, scratch).map_err(failed)?;
        let Scratch { scores, likelihoods, single_odds, .. } = scratch;
        let nowhere = scores.iter().all(|score| *score == f32::INFINITY);
        if nowhere && options.off_map.is_none() {
            return Err(failed(ViewError::NoMatch));
        }
        likelihoods.resize(n + 1, 1.0);
        // A view that matches nothing at all is evidence of being off the map, even if it is
        // repeated.
        let spread = (view.fresh > 0.0 || nowhere).then(|| self.standardizer.spread());
        if let Some(spread) = spread {
            let (places, off) = likelihoods.split_at_mut(n);
            self.standardizer.standardize(spread, scores, places);
            options.odds.log2_odds_of(&places[..single_odds.len()], single_odds);
            // All places and off the map get the same power: the view is one witness, or a part of
            // one, for all of them.
            let weight = (view.fresh / WITNESS).min(1.0);
            options.odds.odds_of(weight, places);
            let off_map = options.off_map.is_some();
            let odds = if off_map { options.off_map_odds } else { options.lost_odds };
            off.fill(odds.powf(weight));
        } else {
            // A repeated view is not new evidence on the place.
            likelihoods.fill(1.0);
        }
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
        let control = RouteControl { view: evidence, ..self.control(odometry) };
        Ok(Sighting { control, view, run, spread })
    }

    /// Learns from a query after the filter has taken its step; `scratch` must be as
    /// [`observe`](Self::observe) left it.
    pub(super) fn learn(
        &mut self,
        motion: &RouteTransition,
        options: &Options,
        sighting: &Sighting,
        scratch: &mut Scratch,
    ) {
        let Sighting { control, view, run, spread } = sighting;
        if let Some(spread) = spread {
            self.learn_scores(options, *spread, view.fresh, scratch);
        }
        self.tally.record(self.run.map(|_| view), control.odometry);
        self.run = Some((view.change, *run));
        self.drive(motion, options, control);
    }

    /// Takes a step without a query. The next view then counts as the first after a gap: whether it
    /// has changed may have any reason.
    pub(super) fn skip(
        &mut self,
        motion: &RouteTransition,
        options: &Options,
        control: &RouteControl,
    ) {
        self.run = None;
        self.drive(motion, options, control);
    }

    /// Control of a step by odometry, after the motion before the step.
    pub(super) fn control(&self, odometry: Option<f64>) -> RouteControl {
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
        let Scratch { distances, scores, rows, .. } = scratch;
        self.standardizer.check(distances)?;
        row_scores(distances, scores, rows)?;
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
        self.tally = Tally::default();
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
