//! From beliefs to answers: the middle of the most probable window, and the mass around it.

use std::ops::RangeInclusive;

use super::recognizer::Recognizer;
use wayfix_kernels as kernels;

/// Estimated position of the vehicle at one step.
#[derive(Debug, Clone, PartialEq)]
pub struct Answer {
    /// Place of the vehicle, or `None` if it is more probably off the map than on it.
    pub place: Option<usize>,
    /// Probability that the vehicle is within the [window](super::Options::window) of
    /// `place`, or that it is off the map if `place` is `None`. For another distance, or another
    /// place, see [`Recognizer::mass_near`].
    pub probability: f64,
    /// Places around `place` that hold 90% of the belief on the map; on a loop, the first may be
    /// above the last.
    pub around: RangeInclusive<usize>,
    /// Probability of being off the map.
    pub off_map: f64,
    /// ln p of the query and the measurements of this step, given all earlier ones.
    pub log_likelihood: f64,
}

/// Share of the belief that [`Answer::around`] holds.
const CREDIBLE: f64 = 0.9;
/// Tolerance for sums taken in a different order.
const ROUNDING: f64 = 1e-12;
/// Number of windows compared at a time.
const WINDOWS: usize = 8;

impl Recognizer {
    /// Returns the answer for a belief over places, which may end in an entry for off the map.
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

    /// Returns the centre of the most probable window; among equal windows, the most probable
    /// centre.
    fn best_place(&self, places: &[f64]) -> usize {
        let (n, window) = (places.len(), self.options().window);
        let mut best = (0, f64::NEG_INFINITY, f64::NEG_INFINITY);
        // Windows within rounding of each other are equal. `best.1` may creep down by rounding at
        // each such exchange, which only a chain of ever more probable centres can repeat.
        let offer = |best: &mut (usize, f64, f64), place: usize, mass: f64| {
            let more_probable = mass > best.1 - ROUNDING && places[place] > best.2;
            if mass > best.1 + ROUNDING || more_probable {
                *best = (place, mass, places[place]);
            }
        };
        // Windows cut by an end, or wrapped around a loop, are summed on their own.
        let edge = window.min(n);
        let ends = (0..edge).chain(n.saturating_sub(window).max(edge)..n);
        ends.for_each(|place| offer(&mut best, place, self.mass_near(places, place, window)));
        let width = window.saturating_mul(2).saturating_add(1);
        let count = (n + 1).saturating_sub(width);
        // Eight windows at a time; one by one only if one of them may be better than the best so
        // far.
        let mut first = 0;
        while first + WINDOWS <= count {
            let mut masses = [0.0; WINDOWS];
            // Entry k of eight successive places belongs to window first + k: `width` such slices
            // make the eight sums, in vectors.
            for eight in places[first..].windows(WINDOWS).take(width) {
                masses.iter_mut().zip(eight).for_each(|(mass, place)| *mass += place);
            }
            let above = masses.map(|mass| u8::from(mass > best.1 - ROUNDING));
            if above != [0; WINDOWS] {
                let masses = (first + window..).zip(masses);
                masses.for_each(|(place, mass)| offer(&mut best, place, mass));
            }
            first += WINDOWS;
        }
        for first in first..count {
            let mass = places[first..first + width].iter().sum();
            offer(&mut best, first + window, mass);
        }
        best.0
    }

    /// Returns the probability of all places at most `within` from `place`; NaN if any of their
    /// entries is.
    ///
    /// `places` is a belief over places as a slice, from [`Track::places`](super::Track::places) or
    /// from a step of [`PlaceBeliefs`](super::PlaceBeliefs::get). An entry for off the map is left
    /// out.
    ///
    /// ```
    /// use wayfix_recognition::{Options, Recognizer};
    ///
    /// let recognizer = Recognizer::from_distances(3, Options::default())?;
    /// let beliefs = recognizer.recording(&[[0.1, 0.9, 0.8]], &[])?.single();
    /// let places = beliefs.get(0).ok_or("no such step")?;
    /// let near = recognizer.mass_near(places.as_slice(), 0, 1);
    /// assert!((near - places.mass(0..2)?).abs() < 1e-12);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn mass_near(&self, places: &[f64], place: usize, within: usize) -> f64 {
        let n = self.references().min(places.len());
        let places = &places[..n];
        let sum: f64 = if self.options().closed && within < n {
            // A window as long as the loop would count places twice.
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

    /// Grows a range from a place towards the more probable side until it holds enough.
    fn around(&self, places: &[f64], place: usize) -> RangeInclusive<usize> {
        let n = places.len();
        let wanted = CREDIBLE * kernels::sum(places);
        let (mut first, mut last, mut mass) = (place, place, places[place]);
        let mut count = 1;
        // Each turn adds a place that is not in the range: at most n turns.
        while mass < wanted && count < n {
            let (below, above) = if self.options().closed {
                (Some((first + n - 1) % n), Some((last + 1) % n))
            } else {
                (first.checked_sub(1), Some(last + 1).filter(|at| *at < n))
            };
            match (below, above) {
                (Some(a), b) if b.is_none_or(|b| places[a] >= places[b]) => {
                    (first, mass) = (a, mass + places[a]);
                }
                (_, Some(b)) => (last, mass) = (b, mass + places[b]),
                _ => break,
            }
            count += 1;
        }
        first..=last
    }
}

/// Clamps a sum of probabilities that rounding may have taken above 1; keeps NaN.
pub(super) fn at_most_one(sum: f64) -> f64 {
    // An empty sum is -0; adding 0 makes it +0.
    if sum > 1.0 { 1.0 } else { sum + 0.0 }
}
