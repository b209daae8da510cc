//! Turning probabilities learned from drives, as a Dirichlet posterior around a rule, or from
//! counts of traffic, as a consistent flow.

use super::probabilities::{FittedTurn, TurningProbabilities};
use super::rule::TurningRule;
use crate::error::{OutOfRange, TransitionError};
use crate::map::{MapError, RoadMap};
use crate::transition::MoveCounts;

impl TurningProbabilities {
    /// Learns from counted moves, with a prior by road class: a rule that counts as `prior_moves`
    /// moves out of each place. With n moves out of a place, n_j of them to j, the rule's φ_j and a
    /// prior weight of w,
    ///
    /// ```text
    /// Φ_j = (n_j + w φ_j) / (n + w)
    /// ```
    ///
    /// which is the posterior mean under a Dirichlet prior around the rule. This applies to the
    /// roads, given that the vehicle does not stay; the probability of staying is that of the rule,
    /// and stays are not counted, since routes of matched drives have none. Where stays were
    /// observed, use [`fit_with_stays`](Self::fit_with_stays). Places without data follow the rule,
    /// even at a weight of 0; a weight of 5 is a good start. O(places + roads + moves log roads).
    ///
    /// ```
    /// use wayfix::canberra;
    /// use wayfix::map::{TurningProbabilities, TurningRule};
    /// use wayfix::transition::MoveCounts;
    ///
    /// let map = canberra::map();
    /// // Routes of two matched drives, as places.
    /// let mut counts = MoveCounts::of_path(&[0, 1, 2, 3, 4]);
    /// counts.merge(&MoveCounts::of_path(&[0, 1, 2]));
    /// let learned = TurningProbabilities::fit(&map, &counts, &TurningRule::default(), 5.0)?;
    ///
    /// let straight_on = learned.turns().iter().find(|turn| (turn.from, turn.to) == (0, 1)).unwrap();
    /// assert_eq!(straight_on.count, 2.0);
    /// assert!(straight_on.probability > canberra::turning().get(0, 1));
    /// # Ok::<(), wayfix::map::MapError>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`MapError::Parameter`] for a number of the prior out of its range,
    /// [`MapError::Moved`] for moves without a road, and [`MapError::Transition`]
    /// for a place that does not exist.
    pub fn fit<P>(
        map: &RoadMap<P>,
        counts: &MoveCounts,
        rule: &TurningRule,
        prior_moves: f64,
    ) -> Result<Self, MapError> {
        Self::of_moves(map, counts, rule, prior_moves, false)
    }

    /// Learns from counted moves as [`fit`](Self::fit) does, with stays counted as moves from a
    /// place to itself: the probability of staying is learned like those of the roads.
    ///
    /// # From drives without labels
    ///
    /// [`Hmm::learn`](crate::Hmm::learn) estimates a [tied](Self::tied) or free operator by
    /// expectation maximisation. The moves expected under a model, by
    /// [`Hmm::expected_moves`](crate::Hmm::expected_moves), tell how much data is behind each turn;
    /// passed to this function, they make one EM iteration with this prior.
    ///
    /// ```
    /// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
    /// use wayfix::canberra;
    /// use wayfix::map::{TurningProbabilities, TurningRule};
    ///
    /// let hmm = canberra::hmm(5, 1.0)?;
    /// let drive = hmm.simulate(200, &mut ChaCha8Rng::seed_from_u64(1));
    /// let moves = hmm.expected_moves(drive.observations())?;
    /// let (map, rule) = (canberra::map(), TurningRule::default());
    /// let learned = TurningProbabilities::fit_with_stays(&map, &moves, &rule, 5.0)?;
    /// let all: f64 = learned.turns().iter().map(|turn| turn.count).sum();
    /// assert!((all - 200.0).abs() < 1e-9);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// As [`fit`](Self::fit).
    pub fn fit_with_stays<P>(
        map: &RoadMap<P>,
        counts: &MoveCounts,
        rule: &TurningRule,
        prior_moves: f64,
    ) -> Result<Self, MapError> {
        Self::of_moves(map, counts, rule, prior_moves, true)
    }

    fn of_moves<P>(
        map: &RoadMap<P>,
        counts: &MoveCounts,
        rule: &TurningRule,
        prior_moves: f64,
        stays: bool,
    ) -> Result<Self, MapError> {
        let rule = Self::by_rule(map, rule)?;
        if !(prior_moves >= 0.0 && prior_moves.is_finite()) {
            let expected = "a finite value of at least 0";
            let what = "the weight of the prior";
            return Err(OutOfRange::new(what, prior_moves, expected).into());
        }
        let states = map.places().len();
        for moved in counts.moves() {
            let (from, to) = (moved.from, moved.to);
            let (Some(start), Some(end)) = (map.places().get(from), map.places().get(to)) else {
                return Err(TransitionError::OutOfRange { to, from, states }.into());
            };
            if from != to && !map.has_road(from, to) && moved.weight != 0.0 {
                let count = moved.weight;
                return Err(MapError::Moved { from: start.id, to: end.id, count });
            }
        }
        let mut turns = Vec::with_capacity(states + map.roads().len());
        for from in 0..states {
            let start = turns.len();
            turns.extend(ways(map, from).map(|to| {
                let counted = to != from || stays;
                let count = if counted { counts.get(from, to) } else { 0.0 };
                FittedTurn { from, to, probability: rule.get(from, to), count }
            }));
            // Without stays, the first entry keeps the rule's probability, and the roads share the
            // rest.
            let first = start + usize::from(!stays);
            let turns = &mut turns[first..];
            let whole: f64 = turns.iter().map(|turn| turn.probability).sum();
            share(turns, |turn| turn.count + prior_moves * (turn.probability / whole));
        }
        Self::of_turns(map, turns)
    }

    /// Learns from counts of traffic, one per road in the order of [`RoadMap::roads`], without any
    /// observed turn: the vehicles that leave a place choose among its roads as the [consistent
    /// flow](RoadMap::consistent_flow) does. Staying, and places without traffic, follow the rule.
    ///
    /// These are the only turning probabilities (apart from staying) whose long-run flow is that
    /// flow, since Φ depends on the place alone. They cannot tell turns apart by where vehicles
    /// come from; for that, see `EdgeTurns` of wayfix-roads. A road with a count of 0
    /// is never taken: pass an expected number for a road that was not counted.
    ///
    /// # Errors
    ///
    /// [`MapError::Parameter`] for a number of the rule out of its range, and those of
    /// [`consistent_flow`](RoadMap::consistent_flow) if there is none.
    pub fn fit_traffic<P>(
        map: &RoadMap<P>,
        counts: &[f64],
        rule: &TurningRule,
    ) -> Result<Self, MapError> {
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
            // The flow determined the probabilities; what is reported is the count itself.
            roads.iter_mut().zip(&counts[road..]).for_each(|(turn, count)| turn.count = *count);
            road += roads.len();
        }
        Self::of_turns(map, turns)
    }

    fn of_turns<P>(map: &RoadMap<P>, turns: Vec<FittedTurn>) -> Result<Self, MapError> {
        let entries = turns.iter().filter(|turn| turn.probability > 0.0);
        let entries = entries.map(|turn| (turn.from, turn.to, turn.probability));
        let mut probabilities = Self::new(map, entries)?;
        probabilities.turns = turns;
        Ok(probabilities)
    }
}

/// Next places from a place: itself, then the ends of its roads.
fn ways<P>(map: &RoadMap<P>, from: usize) -> impl Iterator<Item = usize> {
    std::iter::once(from).chain(map.roads_from(from).map(|road| road.0))
}

/// Redistributes the total probability of turns in proportion to weights, unless all of these are
/// 0.
fn share(turns: &mut [FittedTurn], weight: impl Fn(&FittedTurn) -> f64) {
    let whole: f64 = turns.iter().map(|turn| turn.probability).sum();
    let sum: f64 = turns.iter().map(&weight).sum();
    if sum > 0.0 {
        turns.iter_mut().for_each(|turn| turn.probability = whole * weight(turn) / sum);
    }
}
