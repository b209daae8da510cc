//! A simple filter and smoother as a baseline, all of it in this file: places at eleven speeds and
//! one state for a lost vehicle, with odds of one shape for every camera. It learns the usual score
//! of each reference, but uses neither labels nor odometry. The odds are divided by their mean over
//! the recording, which is all that the filter knows of later images.

use std::ops::Add;

use super::Recording;

const SPEEDS: [f64; 11] = [-1.0, -0.5, 0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 3.0];
/// Probabilities of keeping the speed, and of changing to a neighbouring one; in the rest, the new
/// speed is any, each as probable.
const KEEP: f64 = 0.95;
const NEAR: f64 = 0.03;
/// Probability of coming one place further, or one less far, than the speed says.
const SLACK: f64 = 0.15;
/// Probability of being lost at first, and, in each step, of getting lost and of being found.
const LOST: f64 = 0.02;
const LOSE: f64 = 1e-3;
const FIND: f64 = 0.05;
/// Divisor of log-odds, since images in sequence err together.
const TEMPERATURE: f64 = 1.8;

/// Beliefs of the filter and of the smoother: for each step the probabilities of all places, and
/// last that of being lost. Memory for O(T n) numbers.
pub(crate) fn beliefs(recording: &Recording) -> [Vec<Vec<f64>>; 2] {
    let n = recording.references;
    let (odds, motion) = (odds(recording), Motion::new(recording));
    let all = |on: f64, lost: f64| State { on: vec![on; SPEEDS.len() * n], lost };
    let next = |state: &State, row: &[f64]| motion.forward(state).times(row, 1.0).over(f64::add);
    // The filter's states, eleven times as large as beliefs, are kept at each √T-th step; the
    // smoother computes the others again.
    let block = recording.steps().isqrt().max(1);
    let (mut kept, mut filtered) = (Vec::<State>::new(), Vec::new());
    let mut state = all((1.0 - LOST) / (SPEEDS.len() * n) as f64, LOST);
    for (step, row) in odds.chunks_exact(n).enumerate() {
        let first = |state: State| state.times(row, 1.0).over(f64::add);
        state = if step == 0 { first(state) } else { next(&state, row) };
        filtered.push(state.places(n));
        if step % block == 0 {
            kept.push(state.clone());
        }
    }
    // Likelihood of all later images, up to a factor.
    let (mut later, mut smoothed) = (all(1.0, 1.0), Vec::new());
    for (rows, start) in odds.chunks(block * n).zip(kept).rev() {
        let mut states = vec![start];
        for row in rows.chunks_exact(n).skip(1) {
            states.push(next(&states[states.len() - 1], row));
        }
        for (row, state) in rows.chunks_exact(n).zip(states).rev() {
            smoothed.push(state.times(&later.on, later.lost).over(f64::add).places(n));
            later = motion.backward(&later.times(row, 1.0)).over(f64::max);
        }
    }
    smoothed.reverse();
    [filtered, smoothed]
}

/// Odds of each reference at each step, T × n, whose mean is one.
fn odds(recording: &Recording) -> Vec<f64> {
    let (n, distances) = (recording.references, &recording.distances);
    let finite = distances.iter().copied().filter(|d| d.is_finite());
    let farthest = f64::from(finite.fold(f32::MIN, f32::max));
    // Sums of the scores of each reference before a step, and of their squares.
    let mut before = vec![(0.0, 0.0); n];
    let mut odds = Vec::with_capacity(distances.len());
    for (step, row) in distances.chunks_exact(n).enumerate() {
        let mut scores: Vec<f64> = row.iter().map(|d| f64::from(*d).min(farthest)).collect();
        let centre = median(scores.clone());
        let deviation = 1.4826 * median(scores.iter().map(|d| (d - centre).abs()).collect());
        for score in &mut scores {
            *score = (*score - centre) / deviation.max(1e-12);
            if *score < -3.0 {
                *score = -3.0 - (-*score - 3.0).ln_1p();
            }
            *score = score.clamp(-12.0, 6.0);
        }
        for (score, (sum, squares)) in scores.iter().zip(&mut before) {
            // As if there had been three more scores of 0 ± 1, and ten more for the variance.
            let count = step as f64 + 3.0;
            let mean = *sum / count;
            let variance = (*squares + 3.0 - mean * mean * count + 10.0) / (count + 10.0);
            let unusual = ((score - mean) / variance.max(0.05).sqrt()).clamp(-6.0, 3.0);
            odds.push((0.95 * (-2.0 * (unusual + 1.15)).exp() + 0.05).powf(1.0 / TEMPERATURE));
            let own = score.clamp(-2.5, 2.5);
            (*sum, *squares) = (*sum + own, *squares + own * own);
        }
    }
    let mean = odds.iter().sum::<f64>() / odds.len() as f64;
    odds.iter_mut().for_each(|odds| *odds /= mean);
    odds
}

fn median(mut values: Vec<f64>) -> f64 {
    let half = values.len() / 2;
    let even = values.len().is_multiple_of(2);
    let (below, middle, _) = values.select_nth_unstable_by(half, f64::total_cmp);
    let other = below.iter().copied().fold(f64::MIN, f64::max);
    if even { f64::midpoint(other, *middle) } else { *middle }
}

/// A number for each place at each speed, speed by speed, and one for a lost vehicle.
#[derive(Clone)]
struct State {
    on: Vec<f64>,
    lost: f64,
}

impl State {
    /// Multiplies by numbers that repeat at each speed if there is one for each place.
    fn times(mut self, on: &[f64], lost: f64) -> Self {
        self.on.iter_mut().zip(on.iter().cycle()).for_each(|(p, factor)| *p *= factor);
        self.lost *= lost;
        self
    }

    /// Divides by the sum, or the largest, of all numbers.
    fn over(mut self, total: fn(f64, f64) -> f64) -> Self {
        let total = self.on.iter().copied().fold(self.lost, total);
        self.on.iter_mut().for_each(|p| *p /= total);
        self.lost /= total;
        self
    }

    fn places(&self, n: usize) -> Vec<f64> {
        let at = |place: usize| self.on[place..].iter().step_by(n).sum();
        (0..n).map(at).chain([self.lost]).collect()
    }
}

struct Motion {
    n: usize,
    closed: bool,
    /// Places ahead at each speed, with their probabilities.
    moves: [Vec<(isize, f64)>; SPEEDS.len()],
}

impl Motion {
    fn new(recording: &Recording) -> Self {
        let moves = SPEEDS.map(|speed| {
            // Between two places, the nearer one is the more probable.
            let whole = |ahead: f64| (1.0 - (ahead - speed).abs()).max(0.0);
            let aheads = speed.floor() as isize - 1..=speed.ceil() as isize + 1;
            let probability = |ahead: f64| {
                let beside = whole(ahead - 1.0) + whole(ahead + 1.0);
                (1.0 - SLACK) * whole(ahead) + 0.5 * SLACK * beside
            };
            aheads.map(|ahead| (ahead, probability(ahead as f64))).collect()
        });
        Self { n: recording.references, closed: recording.closed, moves }
    }

    /// The place some places ahead: around a loop, or at most at an end.
    fn ahead(&self, place: usize, ahead: isize) -> usize {
        let (n, place) = (self.n.cast_signed(), place.cast_signed() + ahead);
        let place = if self.closed { place.rem_euclid(n) } else { place.clamp(0, n - 1) };
        place.cast_unsigned()
    }

    /// Changes speeds; `back` takes the sums over the speeds afterwards.
    fn change(&self, on: &[f64], back: bool) -> Vec<f64> {
        let (s, n) = (SPEEDS.len(), self.n);
        let mut changed = vec![0.0; s * n];
        for (to, from) in (0..s * s).map(|pair| (pair / s, pair % s)) {
            let beside = if from == 0 || from + 1 == s { NEAR } else { 0.5 * NEAR };
            let own = match to.abs_diff(from) {
                0 => KEEP,
                1 => beside,
                _ => 0.0,
            };
            let probability = own + (1.0 - KEEP - NEAR) / s as f64;
            let (into, of) = if back { (from, to) } else { (to, from) };
            let layers = changed[into * n..][..n].iter_mut().zip(&on[of * n..][..n]);
            layers.for_each(|(sum, p)| *sum += probability * p);
        }
        changed
    }

    /// Moves at each speed; `back` takes the sums over the places afterwards.
    fn drive(&self, on: &[f64], back: bool) -> Vec<f64> {
        let mut driven = vec![0.0; on.len()];
        let layers = driven.chunks_exact_mut(self.n).zip(on.chunks_exact(self.n));
        for ((driven, on), moves) in layers.zip(&self.moves) {
            for &(ahead, probability) in moves {
                for place in 0..self.n {
                    let there = self.ahead(place, ahead);
                    let (into, of) = if back { (place, there) } else { (there, place) };
                    driven[into] += probability * on[of];
                }
            }
        }
        driven
    }

    /// Predicts the next step.
    fn forward(&self, State { on, lost }: &State) -> State {
        let mut moved = self.drive(&self.change(on, false), false);
        let lose = LOSE * moved.iter().sum::<f64>();
        let found = FIND * lost / moved.len() as f64;
        moved.iter_mut().for_each(|p| *p = (1.0 - LOSE) * *p + found);
        State { on: moved, lost: (1.0 - FIND) * lost + lose }
    }

    /// Takes the mean of a number over the next step, for each state before it.
    fn backward(&self, State { on, lost }: &State) -> State {
        let mut moved = self.drive(on, true);
        moved.iter_mut().for_each(|mean| *mean = (1.0 - LOSE) * *mean + LOSE * lost);
        let found = FIND * on.iter().sum::<f64>() / on.len() as f64;
        State { on: self.change(&moved, true), lost: (1.0 - FIND) * lost + found }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Compares with sums over all paths of three steps.
    #[test]
    fn beliefs_are_sums_over_paths() {
        let distances = vec![3.0, 1.0, 4.0, 1.0, 5.0, 9.0, 2.0, 6.0, f32::INFINITY];
        for closed in [false, true] {
            let distances = distances.clone();
            let of = Recording { references: 3, distances, closed, ..Recording::default() };
            let (odds, motion) = (odds(&of), Motion::new(&of));
            // States are 3 s + i at speed s and place i, and 33 if lost.
            let step = |from: usize, to: usize| match (from, to) {
                (33, 33) => 1.0 - FIND,
                (33, _) => FIND / 33.0,
                (_, 33) => LOSE,
                _ => {
                    let (before, after) = (from / 3, to / 3);
                    let speeds = match before.abs_diff(after) {
                        0 => KEEP,
                        1 if before == 0 || before == 10 => NEAR,
                        1 => NEAR / 2.0,
                        _ => 0.0,
                    };
                    let moves = motion.moves[after].iter();
                    let moves = moves.filter(|(by, _)| motion.ahead(from % 3, *by) == to % 3);
                    let chance = moves.map(|(_, probability)| probability).sum::<f64>();
                    (1.0 - LOSE) * (speeds + (1.0 - KEEP - NEAR) / 11.0) * chance
                }
            };
            let seen =
                |at: usize, state: usize| if state == 33 { 1.0 } else { odds[3 * at + state % 3] };
            let [mut filtered, mut smoothed] = [[[0.0; 4]; 3], [[0.0; 4]; 3]];
            for a in 0..34 {
                let first = seen(0, a) * if a == 33 { LOST } else { (1.0 - LOST) / 33.0 };
                let place = |state: usize| if state == 33 { 3 } else { state % 3 };
                filtered[0][place(a)] += first;
                for b in 0..34 {
                    let second = first * step(a, b) * seen(1, b);
                    filtered[1][place(b)] += second;
                    for c in 0..34 {
                        let third = second * step(b, c) * seen(2, c);
                        filtered[2][place(c)] += third;
                        [a, b, c]
                            .iter()
                            .zip(&mut smoothed)
                            .for_each(|(at, p)| p[place(*at)] += third);
                    }
                }
            }
            for (found, sums) in beliefs(&of).iter().zip([filtered, smoothed]) {
                for (found, sums) in found.iter().zip(sums) {
                    let all: f64 = sums.iter().sum();
                    let near = |(p, sum): (&f64, &f64)| (p - sum / all).abs() < 1e-12;
                    assert!(found.iter().zip(&sums).all(near), "{found:?}, not {sums:?} / {all}");
                }
            }
        }
    }

    #[test]
    fn a_clear_drive_is_followed() {
        // A stop, and an image that matches nothing.
        let places = [3, 4, 5, 6, 6, 6, 7, 8, 9, 10];
        let seen =
            |at: usize| (at % 5) as f32 + if at % 14 == places[at / 14] { -9.0 } else { 0.0 };
        let mut distances: Vec<f32> = (0..140).map(seen).collect();
        distances[98..112].fill(f32::INFINITY);
        let recording = Recording { references: 14, distances, ..Recording::default() };
        let [_, smoothed] = beliefs(&recording);
        let most = |row: &Vec<f64>| (0..15).max_by(|a, b| row[*a].total_cmp(&row[*b]));
        assert_eq!(smoothed.iter().filter_map(most).collect::<Vec<_>>(), places);
    }
}
