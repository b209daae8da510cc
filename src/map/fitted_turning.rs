//! Turning probabilities learned from drives or from counts of traffic.

use super::{MapError, RoadMap, TurningProbabilities, TurningRule};
use crate::error::{Parameter, TransitionError};
use crate::transition::MoveCounts;

/// Prior of learned turning probabilities: at each place a Dirichlet distribution around a rule by
/// road class.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TurningPrior {
    /// The mean.
    pub rule: TurningRule,
    /// Number of moves out of each place that the rule counts as; at least 0 and finite.
    pub weight: f64,
    /// True if stays are counted as moves from a place to itself. Routes of matched drives have
    /// none: then false, and the probability of staying is that of the rule.
    pub stays: bool,
}

impl Default for TurningPrior {
    /// The default rule counts as 5 moves out of each place, and stays are not counted.
    fn default() -> Self {
        Self { rule: TurningRule::default(), weight: 5.0, stays: false }
    }
}

/// A turn out of a place, with the data behind it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FittedTurn {
    /// Index of the place.
    pub from: usize,
    /// Index of the next place; the same for a stay.
    pub to: usize,
    /// Probability of the turn.
    pub probability: f64,
    /// Number of moves (or vehicles) that were counted on it; 0 for one known by the rule alone.
    pub count: f64,
}

/// Turning probabilities learned from data, with the data behind each turn.
///
/// From moves of drives by [`TurningProbabilities::fit`], from counts of traffic by
/// [`TurningProbabilities::fit_traffic`].
#[derive(Debug, Clone)]
pub struct FittedTurning {
    probabilities: TurningProbabilities,
    turns: Vec<FittedTurn>,
}

impl FittedTurning {
    /// Turns, by the place that is left: staying first, then all roads, in ascending order of
    /// their ends.
    #[must_use]
    pub fn turns(&self) -> &[FittedTurn] {
        &self.turns
    }

    /// Turning probabilities Φ.
    #[must_use]
    pub fn probabilities(&self) -> &TurningProbabilities {
        &self.probabilities
    }

    /// Returns the turning probabilities Φ alone.
    #[must_use]
    pub fn into_probabilities(self) -> TurningProbabilities {
        self.probabilities
    }
}

impl TurningProbabilities {
    /// Learns from counted moves, with a prior by road class: with n moves out of a place, n_j of
    /// them to j, and φ_j by the rule with a weight of w,
    ///
    /// ```text
    /// Φ_j = (n_j + w φ_j) / (n + w)
    /// ```
    ///
    /// the mean of the posterior. If stays are not counted, this is for the roads given that the
    /// vehicle does not stay, and staying remains as in the rule. Places without data follow the rule, also at a weight of 0.
    /// O(places + roads + moves log roads).
    ///
    /// ```
    /// use wayfix::canberra;
    /// use wayfix::map::{TurningPrior, TurningProbabilities};
    /// use wayfix::transition::MoveCounts;
    ///
    /// let map = canberra::map();
    /// // Routes of two matched drives, as places.
    /// let mut counts = MoveCounts::of_path(&[0, 1, 2, 3, 4]);
    /// counts.merge(&MoveCounts::of_path(&[0, 1, 2]));
    /// let learned = TurningProbabilities::fit(&map, &counts, &TurningPrior::default())?;
    ///
    /// let straight_on = learned.turns().iter().find(|turn| (turn.from, turn.to) == (0, 1)).unwrap();
    /// assert_eq!(straight_on.count, 2.0);
    /// assert!(straight_on.probability > canberra::turning().get(0, 1));
    /// # Ok::<(), wayfix::map::MapError>(())
    /// ```
    ///
    /// # From drives without labels
    ///
    /// [`Hmm::learn`](crate::Hmm::learn) estimates a [tied](Self::tied) or free operator by
    /// expectation maximisation. The moves expected under a model, by
    /// [`Hmm::expected_moves`](crate::Hmm::expected_moves), say how much data stands behind each
    /// turn; given to this function, they make one iteration with this prior.
    ///
    /// ```
    /// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
    /// use wayfix::canberra;
    /// use wayfix::map::{TurningPrior, TurningProbabilities};
    ///
    /// let hmm = canberra::hmm(5, 1.0)?;
    /// let drive = hmm.simulate(200, &mut ChaCha8Rng::seed_from_u64(1));
    /// let moves = hmm.expected_moves(drive.observations())?;
    /// let prior = TurningPrior { stays: true, ..TurningPrior::default() };
    /// let learned = TurningProbabilities::fit(&canberra::map(), &moves, &prior)?;
    /// let all: f64 = learned.turns().iter().map(|turn| turn.count).sum();
    /// assert!((all - 200.0).abs() < 1e-9);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`MapError::Parameter`] for a number of the prior out of its range,
    /// [`MapError::Moved`] for moves where there is no road, and [`MapError::Transition`]
    /// for a place that does not exist.
    pub fn fit<P>(
        map: &RoadMap<P>,
        counts: &MoveCounts,
        prior: &TurningPrior,
    ) -> Result<FittedTurning, MapError> {
        let rule = Self::by_rule(map, &prior.rule)?;
        if !(prior.weight >= 0.0 && prior.weight.is_finite()) {
            let expected = "a finite value of at least 0";
            let what = "the weight of the prior";
            return Err(Parameter::new(what, prior.weight, expected).into());
        }
        let states = map.places().len();
        for moved in counts.moves() {
            let (from, to) = (moved.from, moved.to);
            let (Some(start), Some(end)) = (map.places().get(from), map.places().get(to)) else {
                return Err(TransitionError::OutOfRange { to, from, states }.into());
            };
            if from != to && !map.roads_from(from).any(|road| road.0 == to) && moved.weight != 0.0 {
                let count = moved.weight;
                return Err(MapError::Moved { from: start.id, to: end.id, count });
            }
        }
        let mut turns = Vec::with_capacity(states + map.roads().len());
        for from in 0..states {
            let start = turns.len();
            turns.extend(ways(map, from).map(|to| {
                let counted = to != from || prior.stays;
                let count = if counted { counts.get(from, to) } else { 0.0 };
                FittedTurn { from, to, probability: rule.get(from, to), count }
            }));
            let first = start + usize::from(!prior.stays);
            let turns = &mut turns[first..];
            let whole: f64 = turns.iter().map(|turn| turn.probability).sum();
            share(turns, |turn| turn.count + prior.weight * (turn.probability / whole));
        }
        FittedTurning::new(map, turns)
    }

    /// Learns from counts of traffic, one per road in the order of [`RoadMap::roads`], without any
    /// turn observed: the vehicles that leave a place choose among its roads as the
    /// [consistent flow](RoadMap::consistent_flow) does. Staying, and places without traffic,
    /// follow the rule.
    ///
    /// These are the only turning probabilities (but for staying) whose long-run flow is that
    /// flow, as Φ asks for the place alone. They say nothing on who turns where by where they come
    /// from; for that, see [`EdgeTurns`](crate::motion::EdgeTurns). A road with a count of 0 is
    /// never taken: give what is expected for a road that was not counted.
    ///
    /// # Errors
    ///
    /// [`MapError::Parameter`] for a number of the rule out of its range, and as [`consistent_flow`](RoadMap::consistent_flow)
    /// if there is no consistent flow.
    pub fn fit_traffic<P>(
        map: &RoadMap<P>,
        counts: &[f64],
        rule: &TurningRule,
    ) -> Result<FittedTurning, MapError> {
        let prior = Self::by_rule(map, rule)?;
        let flow = map.consistent_flow(counts)?;
        let (mut turns, mut road) = (Vec::with_capacity(map.places().len() + flow.len()), 0);
        for from in 0..map.places().len() {
            let start = turns.len();
            turns.extend(ways(map, from).map(|to| FittedTurn {
                from,
                to,
                probability: prior.get(from, to),
                count: 0.0,
            }));
            let roads = &mut turns[start + 1..];
            let flow = &flow[road..road + roads.len()];
            roads.iter_mut().zip(flow).for_each(|(turn, flow)| turn.count = *flow);
            share(roads, |turn| turn.count);
            roads.iter_mut().zip(&counts[road..]).for_each(|(turn, count)| turn.count = *count);
            road += roads.len();
        }
        FittedTurning::new(map, turns)
    }
}

impl FittedTurning {
    fn new<P>(map: &RoadMap<P>, turns: Vec<FittedTurn>) -> Result<Self, MapError> {
        let entries = turns.iter().filter(|turn| turn.probability > 0.0);
        let entries = entries.map(|turn| (turn.from, turn.to, turn.probability));
        Ok(Self { probabilities: TurningProbabilities::new(map, entries)?, turns })
    }
}

/// Ends of the ways out of a place: itself, and those of its roads.
fn ways<P>(map: &RoadMap<P>, from: usize) -> impl Iterator<Item = usize> {
    std::iter::once(from).chain(map.roads_from(from).map(|road| road.0))
}

/// Shares the probability of turns anew in proportion to weights, unless all of these are 0.
fn share(turns: &mut [FittedTurn], weight: impl Fn(&FittedTurn) -> f64) {
    let whole: f64 = turns.iter().map(|turn| turn.probability).sum();
    let sum: f64 = turns.iter().map(&weight).sum();
    if sum > 0.0 {
        turns.iter_mut().for_each(|turn| turn.probability = whole * weight(turn) / sum);
    }
}
