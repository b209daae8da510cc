//! From beliefs to answers.

use std::ops::RangeInclusive;

use super::recognizer::Recognizer;

/// Where the vehicle is.
#[derive(Debug, Clone, PartialEq)]
pub struct Answer {
    /// The place, or `None` if it is more probably off the map than on it.
    pub place: Option<usize>,
    /// The probability that the place is within the [window](super::Options::window) of
    /// the one that is answered; of an answer off the map, that of being there.
    pub probability: f64,
    /// The places around it that hold 90% of the belief on the map; on a loop, the first
    /// may be above the last.
    pub around: RangeInclusive<usize>,
    /// The probability of being off the map.
    pub off_map: f64,
    /// ln p of what was seen and measured at this step, given what was before.
    pub log_likelihood: f64,
}

/// Share of the belief that [`Answer::around`] holds.
const HELD: f64 = 0.9;
/// Sums in another order differ by less.
const ROUNDING: f64 = 1e-12;
/// As many windows are compared at a time.
const TOGETHER: usize = 8;

impl Recognizer {
    /// The answer of a belief in places, with one off the map behind them if there is such.
    pub(super) fn answer(&self, places: &[f64], log_likelihood: f64) -> Answer {
        let n = self.references();
        let off_map = at_most_one(places.get(n).copied().unwrap_or(0.0));
        let place = self.best_place(&places[..n]);
        let on_map = off_map <= 0.5;
        Answer {
            place: on_map.then_some(place),
            probability: if on_map {
                self.mass_near(places, place, self.options().window)
            } else {
                off_map
            },
            around: self.around(&places[..n], place),
            off_map,
            log_likelihood,
        }
    }

    /// The middle of the window with the most probability; of equal ones, that of the most
    /// probable place.
    fn best_place(&self, places: &[f64]) -> usize {
        let (n, window) = (places.len(), self.options().window);
        let mut best = (0, f64::NEG_INFINITY, f64::NEG_INFINITY);
        let offer = |best: &mut (usize, f64, f64), place: usize, mass: f64| {
            let more_probable = mass > best.1 - ROUNDING && places[place] > best.2;
            if mass > best.1 + ROUNDING || more_probable {
                *best = (place, mass, places[place]);
            }
        };
        let edge = window.min(n);
        let ends = (0..edge).chain(n.saturating_sub(window).max(edge)..n);
        ends.for_each(|place| offer(&mut best, place, self.mass_near(places, place, window)));
        let width = window.saturating_mul(2).saturating_add(1);
        let count = (n + 1).saturating_sub(width);
        // Eight windows at a time, and one by one only where there is a better one.
        let mut first = 0;
        while first + TOGETHER <= count {
            let mut masses = [0.0; TOGETHER];
            for eight in places[first..].windows(TOGETHER).take(width) {
                masses.iter_mut().zip(eight).for_each(|(mass, place)| *mass += place);
            }
            let above = masses.map(|mass| u8::from(mass > best.1 - ROUNDING));
            if above != [0; TOGETHER] {
                let masses = (first + window..).zip(masses);
                masses.for_each(|(place, mass)| offer(&mut best, place, mass));
            }
            first += TOGETHER;
        }
        for first in first..count {
            let mass = places[first..first + width].iter().sum();
            offer(&mut best, first + window, mass);
        }
        best.0
    }

    /// The probability of the places within a distance of one; NaN if one of them is.
    #[must_use]
    pub fn mass_near(&self, places: &[f64], place: usize, within: usize) -> f64 {
        let n = self.references().min(places.len());
        let places = &places[..n];
        let sum: f64 = if self.options().closed && within < n {
            if 2 * within + 1 >= n {
                places.iter().sum()
            } else {
                let first = place % n + n - within;
                (first..=first + 2 * within).map(|at| places[at % n]).sum()
            }
        } else {
            let end = place.saturating_add(within).saturating_add(1).min(n);
            places[place.saturating_sub(within).min(end)..end].iter().sum()
        };
        at_most_one(sum)
    }

    /// Grows from a place to the more probable side until enough is held.
    fn around(&self, places: &[f64], place: usize) -> RangeInclusive<usize> {
        let n = places.len();
        let wanted = HELD * places.iter().sum::<f64>();
        let (mut first, mut last, mut held) = (place, place, places[place]);
        let mut count = 1;
        while held < wanted && count < n {
            let (below, above) = if self.options().closed {
                (Some((first + n - 1) % n), Some((last + 1) % n))
            } else {
                (first.checked_sub(1), Some(last + 1).filter(|at| *at < n))
            };
            match (below, above) {
                (Some(a), b) if b.is_none_or(|b| places[a] >= places[b]) => {
                    (first, held) = (a, held + places[a]);
                }
                (_, Some(b)) => (last, held) = (b, held + places[b]),
                _ => break,
            }
            count += 1;
        }
        first..=last
    }
}

/// A probability that may have been rounded to above 1; NaN stays, and a sum of none is 0.
pub(super) fn at_most_one(sum: f64) -> f64 {
    // Which would be -0.
    if sum > 1.0 { 1.0 } else { sum + 0.0 }
}
