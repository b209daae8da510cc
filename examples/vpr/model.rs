//! What is learned on the labelled part: how the vehicle moves, what an
//! unchanged view means, how the images compare, and how far they are to be
//! believed.

use std::error::Error;
use std::ops::Range;

use wayfix::observation::{AppearanceLikelihood, Offsets, Views, alike_stretches};
use wayfix::{
    Belief, GroupedLikelihood, Groups, Hmm, Odometry, OffMapTransition, OptionalLikelihood, Prior,
    RouteControl, RouteTransition, TransitionEntries, View, ViewRates,
};

use super::gears::{self, SLACK};
use super::recording::Recording;

/// What a frame says to the filter: nothing, if it shows what the last one did.
pub(crate) type Sighting = Option<Vec<f32>>;
pub(crate) type Camera = GroupedLikelihood<OptionalLikelihood<AppearanceLikelihood>>;

/// How often each reference counts as an average one, beside the labelled rows.
const AVERAGE: f64 = 20.0;
/// The probabilities of leaving the map and of coming back, where the labelled
/// part shows neither.
const LEAVE: f64 = 0.001;
const RETURN: f64 = 0.01;
/// The rank of the match that is as likely as a place off the map.
const RANK: f64 = 0.15;
/// How often a view stays as it is: standing, within a stretch, and moving on;
/// each counts as seen twice.
const UNCHANGED: [f64; 3] = [0.95, 0.8, 0.02];

/// The steps of a recording as a filter takes them.
#[derive(Clone)]
pub(crate) struct Steps {
    pub(crate) controls: Vec<RouteControl>,
    pub(crate) sightings: Vec<Sighting>,
}

impl Steps {
    /// A view is compared with those before it only, so this works live.
    pub(crate) fn new(
        recording: &Recording,
        fit_on: &[Range<usize>],
    ) -> Result<Self, Box<dyn Error>> {
        let variance = odometry_variance(recording, fit_on);
        let longest = fit_on.iter().max_by_key(|range| range.len()).ok_or("nothing to fit on")?;
        let labelled: Vec<&[f32]> = longest.clone().map(|step| recording.row(step)).collect();
        let mut views = Views::new(Views::threshold_of(&labelled)?)?;
        let (mut controls, mut sightings) = (Vec::new(), Vec::new());
        for step in 0..recording.steps() {
            let row = recording.row(step);
            let view = views.next(row)?;
            let distance = recording.odometry.as_ref().map(|odometry| odometry[step]);
            let odometry = distance.map(|distance| Odometry { distance, variance });
            controls.push(RouteControl { odometry, view: Some(view) });
            // Where a part begins, its first frame is new to it.
            let first = fit_on.iter().any(|range| range.start == step);
            sightings.push((first || view == View::Changed).then(|| row.to_vec()));
        }
        Ok(Self { controls, sightings })
    }

    /// The same steps with the rows of another recording.
    pub(crate) fn with_rows(&self, recording: &Recording) -> Self {
        let rows = self.sightings.iter().enumerate();
        let sightings =
            rows.map(|(step, seen)| seen.is_some().then(|| recording.row(step).to_vec()));
        Self { controls: self.controls.clone(), sightings: sightings.collect() }
    }

    fn new_rows(&self, fit_on: &[Range<usize>]) -> Vec<&[f32]> {
        let steps = fit_on.iter().cloned().flatten();
        steps.filter_map(|step| self.sightings[step].as_deref()).collect()
    }
}

/// The cameras to choose from, without the temperature, those that correct least
/// first.
pub(crate) fn cameras(
    recording: &Recording,
    steps: &Steps,
    fit_on: &[Range<usize>],
    off_map: bool,
) -> Result<[(&'static str, AppearanceLikelihood); 3], Box<dyn Error>> {
    let rows = steps.new_rows(fit_on);
    let plain = AppearanceLikelihood::new(recording.references)?;
    let plain = if off_map { plain.with_off_map(RANK)? } else { plain };
    let hubs = plain.clone().with_offsets(Offsets::Hubs, &rows, AVERAGE)?;
    let all = plain.clone().with_offsets(Offsets::All, &rows, AVERAGE)?;
    Ok([("none", plain), ("hubs", hubs), ("all", all)])
}

/// The middle of the true places of each labelled step.
pub(crate) fn labels(recording: &Recording, range: &Range<usize>) -> Vec<Option<usize>> {
    let middle =
        |step: usize| recording.truth[step].as_ref().map(|r| usize::midpoint(*r.start(), *r.end()));
    range.clone().map(middle).collect()
}

/// How many references on either side of the middle are right, too: half the
/// usual length of the labelled ranges.
pub(crate) fn width(recording: &Recording, fit_on: &[Range<usize>]) -> usize {
    let labels = fit_on.iter().cloned().flatten().filter_map(|step| recording.truth[step].as_ref());
    let mut lengths: Vec<usize> = labels.map(|range| range.end() - range.start()).collect();
    lengths.sort_unstable();
    lengths.get(lengths.len() / 2).map_or(0, |length| length / 2)
}

/// Where the labelled part never leaves the map: the same recording on a map
/// without the places of the middle fifth of that part, so that there is
/// something to learn what it looks like.
pub(crate) fn with_a_gap(recording: &Recording, fit_on: &[Range<usize>]) -> Recording {
    let labelled: Vec<usize> = fit_on.iter().cloned().flatten().collect();
    let mut gap = recording.clone();
    if labelled.iter().any(|step| recording.truth[*step].is_none()) {
        return gap;
    }
    let middle = &labelled[2 * labelled.len() / 5..3 * labelled.len() / 5];
    let mut hidden = vec![false; recording.references];
    for place in middle.iter().filter_map(|step| recording.truth[*step].clone()).flatten() {
        hidden[place] = true;
    }
    for row in gap.distances.chunks_mut(recording.references) {
        let places = row.iter_mut().zip(&hidden).filter(|(_, hidden)| **hidden);
        places.for_each(|(distance, _)| *distance = f32::INFINITY);
    }
    for truth in &mut gap.truth {
        if truth.clone().is_some_and(|mut range| range.all(|place| hidden[place])) {
            *truth = None;
        }
    }
    gap
}

/// The labelled moves: steps, from, and how many places on.
fn moves(recording: &Recording, fit_on: &[Range<usize>]) -> Vec<Vec<(usize, usize, isize)>> {
    let n = recording.references.cast_signed();
    let moved = |from: usize, to: usize| {
        let ahead = to.cast_signed() - from.cast_signed();
        if recording.closed { (ahead + n / 2).rem_euclid(n) - n / 2 } else { ahead }
    };
    let of = |range: &Range<usize>| {
        let labels = labels(recording, range);
        let pairs = labels.windows(2).zip(range.start + 1..);
        pairs.filter_map(|(pair, step)| Some((step, pair[0]?, moved(pair[0]?, pair[1]?)))).collect()
    };
    fit_on.iter().map(of).collect()
}

/// Are two steps in a row labelled?
pub(crate) fn shows_motion(recording: &Recording, fit_on: &[Range<usize>]) -> bool {
    moves(recording, fit_on).iter().any(|part| !part.is_empty())
}

/// How far the odometry is off, squared, on average over the labelled moves.
fn odometry_variance(recording: &Recording, fit_on: &[Range<usize>]) -> f64 {
    let Some(odometry) = &recording.odometry else { return 0.0 };
    let moves = moves(recording, fit_on);
    let errors = moves.iter().flatten().map(|(step, _, moved)| odometry[*step] - *moved as f64);
    let (count, squares) = errors.fold((0.0, 0.0), |(n, sum), e| (n + 1.0, sum + e * e));
    if count > 0.0 { squares / count } else { 1.0 }
}

/// Motion along the route, with gears and views as the labelled part shows them.
pub(crate) fn motion(
    recording: &Recording,
    steps: &Steps,
    fit_on: &[Range<usize>],
) -> Result<(RouteTransition, Vec<f64>, String), Box<dyn Error>> {
    let n = recording.references;
    let moves = moves(recording, fit_on);
    let (occupied, change, slack) = gears::used(&gears::all(SLACK)?, &moves)?;
    let gears = gears::all(slack)?;
    let stretches = alike_stretches(&steps.new_rows(fit_on))?;

    // How often the view stays, standing, within a stretch, and moving on.
    let mut counts = UNCHANGED.map(|rate| [2.0 * rate, 2.0]);
    for &(step, from, moved) in moves.iter().flatten() {
        let to = from.wrapping_add_signed(moved) % n;
        let class = if moved == 0 { 0 } else { 1 + usize::from(stretches[from] != stretches[to]) };
        let unchanged = steps.controls[step].view == Some(View::Unchanged);
        counts[class][0] += f64::from(u8::from(unchanged));
        counts[class][1] += 1.0;
    }
    let [standing, alike, moved] = counts.map(|[unchanged, all]| unchanged / all);
    let views = ViewRates { standing, alike, moved };
    let mut switching = Vec::new();
    for (to, share) in occupied.iter().enumerate() {
        switching.extend((0..gears.len()).map(|from| {
            let stays = if from == to { 1.0 - change } else { 0.0 };
            stays + change * share
        }));
    }
    let note = format!(
        "gears reverse, stand, half, one, two, any: {}; change {change:.4}; slack {slack:.4}; \
         unchanged views: standing {standing:.3}, alike {alike:.3}, moving {moved:.3}",
        occupied.iter().map(|p| format!("{p:.3}")).collect::<Vec<_>>().join(", "),
    );
    let motion = RouteTransition::new(n, recording.closed, gears, 0.5)?
        .with_switching(&switching)?
        .with_views(&stretches, views)?;
    Ok((motion, occupied, note))
}

/// The rates of leaving the map and of coming back, as the labelled part shows
/// them.
pub(crate) fn off_map_rates(recording: &Recording, fit_on: &[Range<usize>]) -> [f64; 2] {
    let mut counts = [[LEAVE, 1.0], [RETURN, 1.0]];
    for range in fit_on {
        for pair in recording.truth[range.clone()].windows(2) {
            let [before, after] = [pair[0].is_some(), pair[1].is_some()];
            let count = &mut counts[usize::from(!before)];
            count[0] += f64::from(u8::from(before != after));
            count[1] += 1.0;
        }
    }
    // Nothing seen of one of them is no sign that it never happens.
    let off = recording.truth[fit_on[0].clone()].iter().any(Option::is_none);
    if off { counts.map(|[changed, all]| changed / all) } else { [LEAVE, RETURN] }
}

/// A model whose states are grouped by place, the last group being off the map
/// if there is one more group than places.
pub(crate) struct Model<A> {
    pub(crate) motion: A,
    pub(crate) groups: Groups,
    prior: Belief,
}

impl<A: TransitionEntries<Control = RouteControl>> Model<A> {
    pub(crate) fn hmm(
        &self,
        sensor: AppearanceLikelihood,
    ) -> Result<Hmm<&A, Camera>, Box<dyn Error>> {
        let camera = GroupedLikelihood::new(OptionalLikelihood::new(sensor), self.groups.clone())?;
        let prior = Prior::AtFirstObservation(self.prior.clone());
        Ok(Hmm::new(prior, &self.motion, camera)?)
    }
}

/// All places alike to begin with, in gears as often as they were used.
fn anywhere(motion: &RouteTransition, occupied: &[f64]) -> Vec<f64> {
    let n = motion.places();
    occupied.iter().flat_map(|p| std::iter::repeat_n(p / n as f64, n)).collect()
}

pub(crate) fn on_map(
    motion: RouteTransition,
    occupied: &[f64],
) -> Result<Model<RouteTransition>, Box<dyn Error>> {
    let prior = Belief::from_weights(anywhere(&motion, occupied))?;
    Ok(Model { groups: motion.place_groups(), motion, prior })
}

pub(crate) fn with_off_map(
    motion: RouteTransition,
    occupied: &[f64],
    [leave, back]: [f64; 2],
) -> Result<Model<OffMapTransition<RouteTransition>>, Box<dyn Error>> {
    let mut prior = anywhere(&motion, occupied);
    let returned = Belief::from_weights(prior.clone())?;
    prior.push(leave / (leave + back)); // as often as it is off the map
    let groups = motion.place_groups();
    let motion = OffMapTransition::new(motion, leave, back, returned)?;
    let groups = motion.groups(&groups)?;
    Ok(Model { motion, groups, prior: Belief::from_weights(prior)? })
}
