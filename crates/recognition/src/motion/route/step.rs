//! One step, entry by entry: A_u of `guide::formulas`, Route, as four factors. Products
//! multiply them, decoders add them up as logarithms.
//!
//! States off the map have no speed: p̄, the likelihood of measurements there, is the sum of three
//! cases. Off the map must pay as much for a reading as the map does, or the belief drifts there.
//!
//! G has rank one but for neighbours on the grid of speeds; yet maxima do not factor as sums do, so
//! Viterbi takes k² passes over the places.

use super::shape::RouteShape;
use super::{Driven, RouteControl, RouteTransition, ViewFactors};
use wayfix::TransitionEntries;
use wayfix::internal::buffers;
use wayfix::transition::kit::check_slices;
use wayfix_kernels::log2;

/// Factors of the entries of a step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Step<'a> {
    pub(super) route: &'a RouteTransition,
    /// Weights of the moves of all speeds, with the likelihood of the odometry.
    pub(super) windows: &'a [f64],
    pub(super) factors: ViewFactors,
    /// Probability of not leaving the map.
    pub(super) not_leaving: f64,
    pub(super) off: Option<OffMapFactors>,
}

/// Factors of entries to and from off the map, including the likelihood of the measurements.
#[derive(Debug, Clone, Copy)]
pub(super) struct OffMapFactors {
    pub(super) enter: f64,
    pub(super) stay: f64,
    pub(super) back: f64,
    /// Probability of coming back at a given place by the uniform part.
    pub(super) uniform_return: f64,
    /// True if the vehicle comes back anywhere, with no preference for near places.
    pub(super) is_anywhere: bool,
    pub(super) within: usize,
}

/// Factors of an entry.
type EntryFactors = [f64; 4];

impl RouteTransition {
    /// Calls `work` with the step of a control.
    pub(super) fn with_step<R>(
        &self,
        control: &RouteControl,
        work: impl FnOnce(Step<'_>, &[f64]) -> R,
    ) -> R {
        let width = self.starts[self.k()];
        buffers::with_two(width.max(self.k()), |windows, means| {
            // Odometry depends on the exact speed v, so it weights the nodes in the window of each
            // grid speed. The mean over the nodes is the likelihood of the grid speed.
            let (windows, means) = (&mut windows[..width], &mut means[..self.k()]);
            for (g, window) in self.speeds.windows.iter().enumerate() {
                let out = &mut windows[self.starts[g]..self.starts[g + 1]];
                means[g] = match control.odometry {
                    None => {
                        out.copy_from_slice(&window.weights);
                        1.0
                    }
                    Some(reading) => {
                        let likelihood =
                            |v: f64| self.odometry.relative(reading, v, window.spacing);
                        window.weigh(likelihood, out)
                    }
                };
            }
            let seen = self.views.zip(control.view);
            let factors = seen.map_or(ViewFactors::NONE, |(rates, view)| rates.factors(view).0);
            let not_leaving = self.off_map.map_or(1.0, |off| 1.0 - off.leave);
            // `off_map_likelihood` reads the view's factors but not `off`, so the step can be made
            // without it first.
            let mut step = Step { route: self, windows, factors, not_leaving, off: None };
            let driven = step.off_map_likelihood(control, means);
            step.off = self.off_map.map(|off| OffMapFactors {
                enter: off.leave * driven,
                stay: (1.0 - off.back) * driven,
                back: off.back * driven,
                uniform_return: (1.0 - off.near) / self.shape.places as f64,
                is_anywhere: off.near == 0.0,
                within: off.within,
            });
            work(step, means)
        })
    }

    /// Log factor taken out of the entries of a step with evidence.
    pub(super) fn log_factor(&self, control: &RouteControl) -> Option<f64> {
        let seen = self.views.zip(control.view);
        let view = seen.map(|(rates, view)| rates.factors(view).1);
        let driven = control.odometry.map(|_| self.odometry.log_peak());
        (view.is_some() || driven.is_some()).then(|| view.unwrap_or(0.0) + driven.unwrap_or(0.0))
    }
}

impl Step<'_> {
    /// The weights of a speed.
    pub(super) fn window(&self, speed: usize) -> &[f64] {
        &self.windows[self.route.starts[speed]..self.route.starts[speed + 1]]
    }

    /// Factors of the entry between two places at a speed: the weight of the move, and the
    /// likelihood of the view.
    fn move_factors(&self, speed: usize, from: usize, to: usize) -> [f64; 2] {
        let (route, window) = (self.route, self.window(speed));
        let weight = route.move_weight(speed, window, from, to);
        if from != to || route.shape.closed || !route.shape.ends().any(|end| end == to) {
            return [weight, self.factors.of(from == to)];
        }
        // Moves beyond an end stop there. The vehicle may be standing or moving then, so such a
        // move takes the lesser of the two likelihoods; only a move of 0 is surely standing.
        let stay = usize::try_from(-route.span_of(speed).0).ok().and_then(|at| window.get(at));
        let stay = stay.copied().unwrap_or(0.0);
        let ViewFactors { standing, moved } = self.factors;
        [stay * standing + (weight - stay).max(0.0) * standing.min(moved), 1.0]
    }

    /// Product of [`move_factors`](Self::move_factors).
    pub(super) fn move_entry(&self, speed: usize, from: usize, to: usize) -> f64 {
        let [weight, seen] = self.move_factors(speed, from, to);
        weight * seen
    }

    /// Probability of coming back at a place.
    fn returns(&self, off: &OffMapFactors, left: usize, to: usize) -> f64 {
        let shape = self.route.shape;
        let near = shape.near(left, off.within).any(|place| place == to);
        let share = if near { self.route.near_shares[left] } else { 0.0 };
        share + off.uniform_return
    }

    /// Visits the entries out of a state, as states and factors, in ascending order.
    fn column(&self, from: usize, mut work: impl FnMut(usize, EntryFactors)) {
        let (route, n, k) = (self.route, self.route.shape.places, self.route.k());
        let (g, i) = (from / n, from % n);
        for new in 0..k {
            if g < k {
                let mix = route.switching[new * k + g];
                for j in route.shape.targets(route.span_of(new), i) {
                    let [weight, seen] = self.move_factors(new, i, j);
                    work(new * n + j, [self.not_leaving, mix, weight, seen]);
                }
            // Back to any place, so the column is dense.
            } else if let Some(off) = &self.off {
                for j in 0..n {
                    let share = route.speeds.shares()[new];
                    work(new * n + j, [off.back, share, self.returns(off, i, j), 1.0]);
                }
            }
        }
        if let Some(off) = &self.off {
            let into = if g < k { off.enter } else { off.stay };
            work(k * n + i, [into, 1.0, 1.0, 1.0]);
        }
    }

    /// Visits the entries into a state, as states and factors, in ascending order.
    fn row(&self, to: usize, mut work: impl FnMut(usize, EntryFactors)) {
        let (route, n, k) = (self.route, self.route.shape.places, self.route.k());
        let (new, j) = (to / n, to % n);
        for g in 0..k {
            if new < k {
                let mix = route.switching[new * k + g];
                for i in route.shape.sources(route.span_of(new), j) {
                    let [weight, seen] = self.move_factors(new, i, j);
                    work(g * n + i, [self.not_leaving, mix, weight, seen]);
                }
            } else if let Some(off) = &self.off {
                work(g * n + j, [off.enter, 1.0, 1.0, 1.0]);
            }
        }
        if let Some(off) = &self.off {
            if new == k {
                return work(to, [off.stay, 1.0, 1.0, 1.0]);
            }
            for i in 0..n {
                let share = route.speeds.shares()[new];
                work(k * n + i, [off.back, share, self.returns(off, i, j), 1.0]);
            }
        }
    }
}

impl RouteTransition {
    /// The first and the last move of a speed.
    pub(super) fn span_of(&self, speed: usize) -> (isize, isize) {
        let window = &self.speeds.windows[speed];
        (window.first, window.last())
    }

    /// Bound on the moves of all speeds, rounded up to a multiple of eight, so that blocks padded
    /// by as many places stay aligned to vectors.
    pub(super) fn reach(&self) -> usize {
        let windows = self.speeds.windows.iter();
        let reach = windows.map(|window| window.last().max(-window.first));
        reach.max().unwrap_or(0).max(0).cast_unsigned().next_multiple_of(8)
    }

    /// Weight, at a speed with the weights `window`, of going from one place to another, summed
    /// over all moves that join them.
    fn move_weight(&self, speed: usize, window: &[f64], from: usize, to: usize) -> f64 {
        let RouteShape { places, closed } = self.shape;
        let at = to.cast_signed() - from.cast_signed() - self.speeds.windows[speed].first;
        if closed {
            // Moves that differ by whole laps lead to the same place.
            let at = at.rem_euclid(places.cast_signed()).cast_unsigned();
            return window.iter().skip(at).step_by(places).sum();
        }
        let cut = |at: isize| at.max(0).cast_unsigned().min(window.len());
        // An end also takes the weights of all moves beyond it.
        let start = if to == 0 { 0 } else { cut(at) };
        let end = if to + 1 == places { window.len() } else { cut(at + 1) };
        window[start..end].iter().sum()
    }
}

/// Largest number of readings averaged, so that the mean follows the present speed.
const READINGS: u32 = 10;

/// Relative density below which a reading counts as unlike the mean: some three deviations off.
const UNLIKE: f64 = 0.05;

/// Share of steps in motion below which a vehicle is taken for one that never moves.
const LEAST_SHARE: f64 = 1e-3;

/// Likelihoods of the measurements of a step off the map, each times the probability of its case.
struct MotionCases {
    stands: f64,
    goes_on: f64,
    changes: f64,
}

impl Step<'_> {
    /// Likelihood of the measurements off the map; `means` has the likelihood of the reading at
    /// each speed.
    fn off_map_likelihood(&self, control: &RouteControl, means: &[f64]) -> f64 {
        // Without measurements the cases sum to one but for rounding.
        if control.odometry.is_none() && self.factors == ViewFactors::NONE {
            return 1.0;
        }
        let MotionCases { stands, goes_on, changes } = self.likelihood_cases(control, means);
        stands + goes_on + changes
    }

    fn likelihood_cases(&self, control: &RouteControl, means: &[f64]) -> MotionCases {
        let speeds = &self.route.speeds;
        // `share` is the share of speed 0; `at_rest` and `moving` are sums of the means weighted by
        // the shares, for speed 0 and for all others.
        let (mut share, mut at_rest, mut moving) = (0.0, 0.0, 0.0);
        for ((v, p), mean) in speeds.values().iter().zip(speeds.shares()).zip(means) {
            if *v == 0.0 {
                (share, at_rest) = (share + p, at_rest + p * mean);
            } else {
                moving += p * mean;
            }
        }
        let (nearby, anywhere) = speeds.changes();
        let factors = self.factors;
        // Without a previous motion, the step is like the first one: speeds have their shares, so
        // only `changes` and the second term of `stands` are left.
        let (change, stood) = match control.before {
            None => (1.0, 0.0),
            Some(before) => {
                // A vehicle always stood if no speed moves, and never if no speed is 0.
                let moves = 1.0 - share >= LEAST_SHARE;
                let stood = if moves { before.standing } else { 1.0 };
                ((nearby + anywhere).min(1.0), if share > 0.0 { stood } else { 0.0 })
            }
        };
        // Given that the vehicle stands.
        let at_rest = if share > 0.0 { at_rest / share } else { 0.0 };
        let mean = control.before.and_then(|before| before.odometry);
        // The likelihood at a speed that goes on: the predictive density given the readings so far
        // or, if there are none, the mean over the moving speeds.
        let likelihood_going_on = control
            .odometry
            .zip(mean)
            .map_or(moving / (1.0 - share).max(LEAST_SHARE), |(reading, (mean, count))| {
                self.route.odometry.predictive_density(reading, mean, count)
            });
        MotionCases {
            stands: ((1.0 - change) * stood + change * share) * at_rest * factors.standing,
            goes_on: (1.0 - change) * (1.0 - stood) * likelihood_going_on * factors.moved,
            changes: change * moving * factors.moved,
        }
    }
}

impl RouteTransition {
    /// Returns the motion after a step, from the motion before it and the measurements, both in the
    /// control.
    #[must_use]
    pub fn driven(&self, control: &RouteControl) -> Driven {
        let MotionCases { stands, goes_on, changes } =
            self.with_step(control, |step, means| step.likelihood_cases(control, means));
        let sum = stands + goes_on + changes;
        // If no case explains the measurements, standing and moving are equally probable.
        let standing = if sum > 0.0 { (stands / sum).min(1.0) } else { 0.5 };
        let before = control.before.and_then(|before| before.odometry);
        // The mean starts anew when the vehicle stands or when a change explains the step better.
        let odometry = match (before.filter(|_| goes_on >= changes), control.odometry) {
            _ if standing > 0.5 => None,
            (Some((mean, count)), Some(reading)) => {
                // A reading unlike the mean halves the weight of earlier ones: the speed changed.
                let unlike = self.odometry.predictive_density(reading, mean, count) < UNLIKE;
                let count = if unlike { count / 2 } else { count }.saturating_add(1).min(READINGS);
                Some((mean + (reading - mean) / f64::from(count), count))
            }
            (None, Some(reading)) => Some((reading, 1)),
            (before, None) => before,
        };
        Driven { standing, odometry }
    }
}

impl TransitionEntries for RouteTransition {
    fn incoming(&self, control: &RouteControl, to: usize) -> impl Iterator<Item = (usize, f64)> {
        assert!(to < self.count(), "there is no state {to}");
        let mut entries = Vec::new();
        self.with_step(control, |step, _| {
            step.row(to, |from, factors| entries.push((from, factors.into_iter().product())));
        });
        entries.into_iter().filter(|entry: &(usize, f64)| entry.1 > 0.0)
    }

    fn outgoing(&self, control: &RouteControl, from: usize) -> impl Iterator<Item = (usize, f64)> {
        assert!(from < self.count(), "there is no state {from}");
        let mut entries = Vec::new();
        self.with_step(control, |step, _| {
            step.column(from, |to, factors| entries.push((to, factors.into_iter().product())));
        });
        entries.into_iter().filter(|entry: &(usize, f64)| entry.1 > 0.0)
    }

    fn incoming_log2(
        &self,
        control: &RouteControl,
        to: usize,
    ) -> impl Iterator<Item = (usize, f64)> {
        assert!(to < self.count(), "there is no state {to}");
        let mut entries = Vec::new();
        self.with_step(control, |step, _| {
            step.row(to, |from, factors| entries.push((from, factors.into_iter().map(log2).sum())));
        });
        entries.into_iter().filter(|entry: &(usize, f64)| entry.1 > f64::NEG_INFINITY)
    }

    fn outgoing_log2(
        &self,
        control: &RouteControl,
        from: usize,
    ) -> impl Iterator<Item = (usize, f64)> {
        assert!(from < self.count(), "there is no state {from}");
        let mut entries = Vec::new();
        self.with_step(control, |step, _| {
            step.column(from, |to, factors| {
                entries.push((to, factors.into_iter().map(log2).sum()));
            });
        });
        entries.into_iter().filter(|entry: &(usize, f64)| entry.1 > f64::NEG_INFINITY)
    }

    fn max_product(&self, control: &RouteControl, x: &[f64], out: &mut [f64], from: &mut [u32]) {
        check_slices(self.count(), x, out);
        self.with_step(control, |step, _| step.max_product(x, out, from));
    }
}

impl Step<'_> {
    fn max_product(&self, x: &[f64], out: &mut [f64], from: &mut [u32]) {
        let (n, k) = (self.route.shape.places, self.route.k());
        buffers::with_two(n, |returned, left| {
            let mut returned = ScoredPredecessors { scores: returned, from: left };
            returned.clear();
            if let Some(off) = &self.off {
                self.best_return(off, &x[k * n..], &mut returned);
            }
            buffers::with_two(n, |mixed, origin| {
                let mut mixed = ScoredPredecessors { scores: mixed, from: origin };
                // For each new speed: first the best old speed at each place, then the best move
                // from there. The factor of G depends only on the speeds and that of the move only
                // on the places, so the two maxima separate.
                buffers::with(n, |states| {
                    for new in 0..k {
                        let mut best =
                            ScoredPredecessors { scores: &mut out[new * n..][..n], from: states };
                        best.clear();
                        mixed.clear();
                        for g in 0..k {
                            let share =
                                log2(self.route.switching[new * k + g]) + log2(self.not_leaving);
                            let scores = x[g * n..][..n].iter().map(|x| x + share);
                            mixed.offer(0, scores.zip((g * n..).map(encoded)));
                        }
                        self.offer_moves(new, &mixed, &mut best);
                        let share = log2(self.route.speeds.shares()[new]);
                        // A return from off the map arrives at this speed with the share of the
                        // speed. It may tie with a move on the map: `offer` then takes the lower
                        // state.
                        let moves = returned.scores.iter().map(|x| x + share);
                        best.offer(0, moves.zip(returned.from.iter().copied()));
                        for (from, state) in from[new * n..].iter_mut().zip(&*best.from) {
                            *from = decoded(*state);
                        }
                    }
                });
            });
        });
        let Some(off) = &self.off else { return };
        buffers::with(n, |states| {
            let mut best = ScoredPredecessors { scores: &mut out[k * n..], from: states };
            best.clear();
            // From any speed at the same place, or from off the map (g = k) at the same place.
            for g in 0..=k {
                let into = log2(if g < k { off.enter } else { off.stay });
                let scores = x[g * n..][..n].iter().map(|x| x + into);
                best.offer(0, scores.zip((g * n..).map(encoded)));
            }
            for (from, state) in from[k * n..].iter_mut().zip(&*best.from) {
                *from = decoded(*state);
            }
        });
    }

    /// Offers to the places of a speed the moves of its window from places with these scores.
    fn offer_moves(
        &self,
        new: usize,
        mixed: &ScoredPredecessors<'_>,
        best: &mut ScoredPredecessors<'_>,
    ) {
        let (route, window) = (self.route, self.window(new));
        // Around a short loop, several moves join the same two places. Their weights add up to one
        // entry, but the taps, one for each move, would offer it in parts. So all places are then
        // offered entry by entry.
        let laps = route.shape.closed && window.len() > route.shape.places;
        let alone = if laps { 0..0 } else { 0..route.shape.places };
        for (places, taps) in route.stencils[new][0].runs(alone) {
            for (first, weight, stays) in taps {
                let added = log2(window[weight]) + log2(self.factors.of(stays));
                for (span, at) in route.shape.spans(first, places.len()) {
                    let scores = mixed.scores[span.clone()].iter().map(|x| x + added);
                    best.offer(places.start + at, scores.zip(mixed.from[span].iter().copied()));
                }
            }
        }
        let ends = route.shape.ends().chain((0..route.shape.places).filter(|_| laps));
        for end in ends {
            for i in route.shape.sources(route.span_of(new), end) {
                let [weight, seen] = self.move_factors(new, i, end).map(log2);
                let score = mixed.scores[i] + (weight + seen);
                best.offer(end, std::iter::once((score, mixed.from[i])));
            }
        }
    }

    /// Finds the best way back to each place, before the share of the speed.
    fn best_return(&self, off: &OffMapFactors, x: &[f64], best: &mut ScoredPredecessors<'_>) {
        let (shape, first) = (self.route.shape, self.route.k() * x.len());
        let back = log2(off.back);
        // The best place to have left, the lowest on ties. Places near it get a second, larger
        // offer of the same move below, which includes its uniform part.
        let mut top = 0;
        for (i, score) in x.iter().enumerate() {
            if *score > x[top] {
                top = i;
            }
        }
        let anywhere = (x[top] + back + log2(off.uniform_return), encoded(first + top));
        best.offer(0, std::iter::repeat_n(anywhere, x.len()));
        for (i, score) in x.iter().enumerate().filter(|entry| *entry.1 > f64::NEG_INFINITY) {
            let returning = back + log2(self.route.near_shares[i] + off.uniform_return);
            for j in shape.near(i, off.within) {
                best.offer(j, std::iter::once((score + returning, encoded(first + i))));
            }
        }
    }
}

/// Scores of places, and the states they come from. States are encoded as doubles, so that a vector
/// register holds as many of them as of scores.
struct ScoredPredecessors<'a> {
    scores: &'a mut [f64],
    from: &'a mut [f64],
}

/// 2^52: a state added to it gives a double whose low bits are the state, as the spacing of doubles
/// from 2^52 to 2^53 is 1.
const STATE_OFFSET: f64 = (1_u64 << 52) as f64;

/// Encodes a state, below 2^32, as a double.
fn encoded(state: usize) -> f64 {
    STATE_OFFSET + state as f64
}

/// Decodes a state: the low 32 bits.
fn decoded(state: f64) -> u32 {
    state.to_bits() as u32
}

impl ScoredPredecessors<'_> {
    fn clear(&mut self) {
        self.scores.fill(f64::NEG_INFINITY);
        self.from.fill(STATE_OFFSET);
    }

    /// Offers moves with these scores to consecutive places. The lowest state wins ties, whatever
    /// the order of offers.
    fn offer(&mut self, to: usize, moves: impl Iterator<Item = (f64, f64)>) {
        let best = self.scores[to..].iter_mut().zip(&mut self.from[to..]);
        // Selections instead of branches, which vectorise. A place without a way keeps state 0,
        // as −∞ ties with −∞; its score says that there is none.
        for ((score, from), (value, state)) in best.zip(moves) {
            let lower = if state < *from { state } else { *from };
            let tied = if value == *score { lower } else { *from };
            *from = if value > *score { state } else { tied };
            *score = if value > *score { value } else { *score };
        }
    }
}
