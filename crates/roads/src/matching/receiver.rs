//! Errors of a receiver, and the kinds of its reception.
//!
//! An error is a slowly moving offset and white noise: y = x + o + w. In each direction of the
//! plane, o is a Gauss–Markov process with the variance ρσ², of which the share κ = e^(−Δ/τ) is
//! left after Δ seconds, and w has the variance (1 − ρ)σ². So a second position from the same place
//! is hardly a second witness: a road that explains a drive by an offset of 20 m pays for the
//! offset once, not at each point.
//!
//! Reception is usual, poor or rough. In poor reception σ is four times as large; it comes and goes
//! within a minute or so. Rough reception usually lasts as long as a drive: it is that of a
//! receiver whose errors are twice as large, with a good part of them white. Each state carries the
//! probability of each and, for each, the joint Gaussian of x, its metres along the edge, and o:
//! the interacting multiple model of Blom and Bar-Shalom (1988).

use super::place::{ByReception, Mixtures, Place};
use crate::matching::MatchModel;

/// Kinds of reception: usual, poor, and rough.
pub(super) const RECEPTIONS: usize = 3;
pub(super) const POOR_AT: usize = 1;
pub(super) const ROUGH_AT: usize = 2;
/// Factors of the standard deviation.
pub(super) const FACTORS: ByReception = [1.0, POOR, 2.0];
pub(super) const POOR: f64 = 4.0;
/// Share of receivers that are rough, and the largest lasting share of their errors' variance.
pub(super) const ROUGH: f64 = 0.05;
const LASTING_IN_ROUGH: f64 = 0.7;
/// Time constants in seconds after which poor or usual reception is drawn anew, and the kind of
/// receiver is.
pub(super) const REDRAWN_AFTER: f64 = 60.0;
const RECEIVER_LASTS: f64 = 3600.0;

/// A receiver at a point.
#[derive(Debug, Clone, Copy)]
pub(super) struct Receiver {
    /// Variances of the error that lasts, in each direction, by reception.
    lasting: ByReception,
    /// Variances of the white noise, in each direction, by reception.
    pub(super) white: ByReception,
    /// Long-run shares of the kinds of reception.
    shares: ByReception,
    /// Probability that a position belongs to a road.
    pub(super) inlier: f64,
}

impl Receiver {
    /// Creates a receiver whose errors in usual reception have the given standard deviation in each
    /// direction.
    pub(super) fn new(model: &MatchModel, deviation: f64) -> Self {
        let fine = 1.0 - ROUGH;
        let shares = [fine * (1.0 - model.poor), fine * model.poor, ROUGH];
        let mut lasting = [model.lasting; RECEPTIONS];
        lasting[ROUGH_AT] = model.lasting.min(LASTING_IN_ROUGH);
        let (mut lasts, mut white) = (lasting, lasting);
        for (number, factor) in FACTORS.iter().enumerate() {
            let variance = (factor * deviation).powi(2);
            lasts[number] = lasting[number] * variance;
            white[number] = (1.0 - lasting[number]) * variance;
        }
        Self { lasting: lasts, white, shares, inlier: 1.0 - model.outliers }
    }

    /// Variances of the change of an error when the share `redrawn` of the lasting part is drawn
    /// anew, for a receiver created with the standard deviation of a difference.
    pub(super) fn changes(&self, redrawn: f64) -> ByReception {
        let mut changes = self.white;
        for (change, lasting) in changes.iter_mut().zip(self.lasting) {
            *change += redrawn * lasting;
        }
        changes
    }

    /// Error before any position, at no place.
    pub(super) fn unknown(&self) -> Place {
        let zero = [0.0; RECEPTIONS];
        let covariance = [zero, zero, zero, self.lasting, zero, self.lasting];
        Place { mean: [zero; 3], covariance, shares: self.shares }
    }

    /// Distribution after some seconds, when the share `kept` of the error is left.
    pub(super) fn predicted(&self, place: &Place, seconds: f64, kept: f64) -> Place {
        let redrawn = -(-seconds / REDRAWN_AFTER).exp_m1();
        let other_receiver = -(-seconds / RECEIVER_LASTS).exp_m1();
        // The mixing step of the interacting multiple model. A reception that is drawn anew may
        // come from any of its kind, whose merged Gaussian it then has: usual and poor are redrawn
        // among themselves, and all three with a new receiver.
        let fine = pooled(place, (0..RECEPTIONS).filter(|number| *number != ROUGH_AT));
        let any = pooled(place, 0..RECEPTIONS);
        let [of_fine, of_any] = [&fine, &any].map(|pool| pool.weights[0]);
        let all_fine = 1.0 - self.shares[ROUGH_AT];
        let [mut stays, mut from_fine, mut from_any] = [[0.0; RECEPTIONS]; 3];
        for number in 0..RECEPTIONS {
            let share = self.shares[number];
            from_any[number] = other_receiver * share * of_any;
            stays[number] = (1.0 - other_receiver) * place.shares[number];
            if number != ROUGH_AT {
                from_fine[number] = (1.0 - other_receiver) * redrawn * share / all_fine * of_fine;
                stays[number] *= 1.0 - redrawn;
            }
        }
        let mut mixtures = Mixtures::default();
        mixtures.add(stays, &place.mean, &place.covariance);
        for (weights, pool) in [(from_fine, &fine), (from_any, &any)] {
            let (mean, covariance) = (pool.mean.map(in_each), pool.covariance.map(in_each));
            mixtures.add(weights, &mean, &covariance);
        }
        // Only a place without any weight, the state off the road's, is left as it is.
        let Some(mut predicted) = Place::of_mixtures(mixtures) else { return *place };
        let squared = kept * kept;
        let Place { mean: [_, x, y], covariance: [_, ax, ay, xx, xy, yy], .. } = &mut predicted;
        for r in 0..RECEPTIONS {
            // The Gauss–Markov step o → κ o + noise of variance (1 − κ²) ρσ²: means and covariances
            // with o scale by κ, those within o by κ².
            let new = (1.0 - squared) * self.lasting[r];
            (x[r], y[r]) = (kept * x[r], kept * y[r]);
            (ax[r], ay[r]) = (kept * ax[r], kept * ay[r]);
            (xx[r], yy[r]) = (squared * xx[r] + new, squared * yy[r] + new);
            xy[r] *= squared;
        }
        predicted
    }
}

/// Some receptions of a place, merged.
fn pooled(place: &Place, receptions: impl Iterator<Item = usize>) -> Mixtures<1> {
    let mut pool = Mixtures::default();
    for number in receptions {
        let (mean, covariance) = (&place.mean, &place.covariance);
        let mean = mean.each_ref().map(|mean| [mean[number]]);
        let covariance = covariance.each_ref().map(|part| [part[number]]);
        pool.add([place.shares[number]], &mean, &covariance);
    }
    pool
}

/// The same number for each reception.
fn in_each([value]: [f64; 1]) -> ByReception {
    [value; RECEPTIONS]
}
