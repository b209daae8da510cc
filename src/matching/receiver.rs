//! Errors of a receiver, and what a state knows of them and of the place along its road.
//!
//! An error is a slowly moving offset and white noise: y = x + o + w. In each direction of the
//! plane, o is a Gauss–Markov process with the variance ρσ², of which the share κ = e^(−Δ/τ) is left
//! after Δ seconds, and w has the variance (1 − ρ)σ². So a second look from the same place is hardly
//! a second witness: a vehicle that a road explains with an offset of 20 m pays for it once, and not
//! at each point.
//!
//! Reception is usual, poor or rough. In poor reception σ is four times as large; it comes and goes
//! within a minute or so. Rough reception lasts as long as a drive as a rule: that of a receiver
//! whose errors are twice as large, and a good part of them white. Each state carries the probability
//! of each and, for each, the joint Gaussian of x, its metres along the edge, and o: the interacting
//! multiple model of Blom and Bar-Shalom (1988). A
//! position is two measurements of these: a distance across, n · o + w, and a place along,
//! x + t · o + w, where n and t are the unit vectors across and along. That x is on the edge is a
//! third, which is no Gaussian: the update takes the first two derivatives of its logarithm.

use super::placement::{Mixture, Placement};
use crate::matching::MatchModel;

/// Kinds of reception: usual, poor, and rough.
pub(super) const RECEPTIONS: usize = 3;
/// Factors of the standard deviation.
pub(super) const FACTORS: [f64; RECEPTIONS] = [1.0, POOR, 2.0];
pub(super) const POOR: f64 = 4.0;
/// Share of receivers that are rough, and the largest share of their errors that lasts.
pub(super) const ROUGH: f64 = 0.05;
const LASTING_IN_ROUGH: f64 = 0.7;
/// Seconds after which it is drawn anew whether reception is poor, and whether the receiver is rough.
pub(super) const REDRAWN_AFTER: f64 = 60.0;
const RECEIVER_LASTS: f64 = 3600.0;

/// Place along an edge and error of the receiver, as the drive so far tells them.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Place {
    /// Distributions by reception.
    pub(super) placements: [Placement; RECEPTIONS],
    /// Probabilities of the kinds of reception.
    pub(super) shares: [f64; RECEPTIONS],
}

/// A position as it is seen from an edge.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Sighting {
    /// Unit vector across, from the road to the position.
    pub(super) normal: [f64; 2],
    /// Unit vector along; zero if none is known.
    pub(super) tangent: [f64; 2],
    /// Metres across, in the direction of `normal`.
    pub(super) across: f64,
    /// Metres along, on the straight line that goes on beyond the ends.
    pub(super) along: f64,
    /// Length of the edge in metres.
    pub(super) length: f64,
    /// True if the position is beside the edge, and not beyond its ends.
    pub(super) is_beside: bool,
    /// Log density of a position that says nothing of the place.
    pub(super) log_outlier: f64,
}

/// A receiver at a point.
#[derive(Debug, Clone, Copy)]
pub(super) struct Receiver {
    /// Variances of the error that lasts, in each direction, by reception.
    lasting: [f64; RECEPTIONS],
    /// Variances of the white noise, in each direction, by reception.
    white: [f64; RECEPTIONS],
    /// Shares of the kinds of reception over all time.
    shares: [f64; RECEPTIONS],
    log_inlier: f64,
}

/// Metres that a position is ahead of a place, by reception.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ahead {
    /// Probabilities of the kinds of reception.
    pub(super) shares: [f64; RECEPTIONS],
    pub(super) metres: [f64; RECEPTIONS],
    pub(super) deviations: [f64; RECEPTIONS],
}

/// Probability of a reception below which the share on an edge is that of the others.
const RARE: f64 = 1e-3;
/// Slope of the logistic function that is nearest to the normal distribution function.
pub(super) const SLOPE: f64 = 1.702;
/// Deviations, as arguments of the logistic function, beyond which nothing is cut off.
const FAR: f64 = 7.0;
/// Least variance along, in square metres: below that of the finest receiver.
const LEAST_VARIANCE: f64 = 1e-15;
/// Largest share of a variance that an update by the ends of an edge takes away: its second
/// derivative is that of a logistic function, and no exact one.
const MOST_LEARNED: f64 = 0.9;

impl Place {
    fn each(&self, change: impl FnMut(Placement) -> Placement) -> Self {
        Self { placements: self.placements.map(change), ..*self }
    }

    /// The same with the metres counted from another point of the road.
    pub(super) fn counted_from(&self, metres: f64) -> Self {
        self.each(|placement| placement.counted_from(metres))
    }

    /// The same error at a place of which the position says nothing.
    pub(super) fn unseen(&self, along: f64, deviation: f64) -> Self {
        self.each(|placement| placement.unseen(along, deviation))
    }

    /// The same with other probabilities of the kinds of reception, in proportion; as before if all are
    /// zero.
    fn reweighted(mut self, weights: [f64; RECEPTIONS]) -> (Self, f64) {
        let total = weights.iter().sum::<f64>();
        if total > 0.0 {
            self.shares = weights.map(|weight| weight / total);
        }
        (self, total)
    }

    /// Update by a measurement of a linear function, and the log density of it.
    #[inline]
    fn observed(&self, h: [f64; 3], value: f64, receiver: &Receiver) -> (Self, f64) {
        let mut updated = *self;
        let [mut squares, mut deviations] = [[0.0; RECEPTIONS]; 2];
        for (number, placement) in updated.placements.iter_mut().enumerate() {
            let [mean, variance] = placement.of(h);
            let (variance, z) = (variance + receiver.white[number], value - mean);
            (squares[number], deviations[number]) = (0.5 * z * z / variance, variance.sqrt());
            *placement = placement.learned(h, z / variance, -1.0 / variance);
        }
        // The largest exponent comes out first: a position may be a thousand deviations off.
        let least = squares.iter().copied().fold(f64::INFINITY, f64::min);
        let mut densities = self.shares;
        for (number, density) in densities.iter_mut().enumerate() {
            *density *= (least - squares[number]).exp() / deviations[number];
        }
        let (updated, total) = updated.reweighted(densities);
        (updated, (total / std::f64::consts::TAU.sqrt()).ln() - least)
    }
}

impl Sighting {
    fn along_and_error(&self) -> [f64; 3] {
        [1.0, self.tangent[0], self.tangent[1]]
    }

    /// Shares of a distribution of places along that are before the start of the edge and before its
    /// end, the share between them, and the slope of the logistic function; `None` if nothing is cut
    /// off.
    #[inline]
    fn ends(&self, mean: f64, variance: f64) -> Option<([f64; 2], f64, f64)> {
        let slope = SLOPE / variance.max(LEAST_VARIANCE).sqrt();
        let [low, high] = [-slope * mean, slope * (self.length - mean)];
        if low < -FAR && high > FAR {
            return None;
        }
        let [below, up_to] = [low, high].map(|z| 1.0 / (1.0 + (-z).exp()));
        // Their difference, without loss where both are near 0 or 1.
        let share = -up_to * (1.0 - below) * (low - high).exp_m1();
        Some(([below, up_to], if share > 0.0 { share } else { 0.0 }, slope))
    }

    /// Share of a distribution that is on the edge.
    #[inline]
    pub(super) fn share(&self, place: &Place) -> f64 {
        let (mut on_edge, mut of) = (0.0, 0.0);
        for (placement, share) in place.placements.iter().zip(place.shares) {
            // Rare receptions are taken as the others.
            if share > RARE {
                let ends = self.ends(placement.mean[0], placement.covariance[0]);
                on_edge += share * ends.map_or(1.0, |ends| ends.1);
                of += share;
            }
        }
        on_edge / of
    }

    /// Restricts a place to the edge.
    #[inline]
    pub(super) fn within(&self, place: &Place) -> Place {
        let (mut updated, mut shares) = (*place, place.shares);
        for (placement, share) in updated.placements.iter_mut().zip(&mut shares) {
            let variance = placement.covariance[0].max(LEAST_VARIANCE);
            let Some(([below, up_to], on_edge, slope)) = self.ends(placement.mean[0], variance)
            else {
                continue;
            };
            *share *= on_edge;
            if on_edge > 0.0 {
                let first = -slope * (1.0 - up_to - below);
                let second = -slope * slope * (up_to * (1.0 - up_to) + below * (1.0 - below));
                let second = second.max(-MOST_LEARNED / variance);
                *placement = placement.learned([1.0, 0.0, 0.0], first, second);
            }
        }
        updated.reweighted(shares).0
    }

    /// Log density of the position, and the probability that it belongs to the road, from the log
    /// density across of those that do.
    pub(super) fn position(&self, receiver: &Receiver, log_across: f64) -> (f64, f64) {
        let inlier = receiver.log_inlier + log_across;
        let most = inlier.max(self.log_outlier);
        let total = most + ((inlier - most).exp() + (self.log_outlier - most).exp()).ln();
        (total, (inlier - total).exp())
    }
}

impl Receiver {
    /// Creates a receiver whose errors have a standard deviation in each direction, in usual reception.
    pub(super) fn new(model: &MatchModel, deviation: f64) -> Self {
        let shares = [(1.0 - ROUGH) * (1.0 - model.poor), (1.0 - ROUGH) * model.poor, ROUGH];
        let lasting = [model.lasting, model.lasting, model.lasting.min(LASTING_IN_ROUGH)];
        let (mut lasts, mut white) = (lasting, lasting);
        for (number, factor) in FACTORS.iter().enumerate() {
            let variance = (factor * deviation).powi(2);
            lasts[number] = lasting[number] * variance;
            white[number] = (1.0 - lasting[number]) * variance;
        }
        Self { lasting: lasts, white, shares, log_inlier: (-model.outliers).ln_1p() }
    }

    /// Variances of the change of an error, of which so much of the lasting part is drawn anew, if the
    /// deviation is that of a difference.
    pub(super) fn changes(&self, redrawn: f64) -> [f64; RECEPTIONS] {
        let mut changes = self.white;
        for (change, lasting) in changes.iter_mut().zip(self.lasting) {
            *change += redrawn * lasting;
        }
        changes
    }

    /// Error of which nothing is known, at no place.
    pub(super) fn unknown(&self) -> Place {
        let placement = |variance| Placement {
            mean: [0.0; 3],
            covariance: [0.0, 0.0, 0.0, variance, 0.0, variance],
        };
        Place { placements: self.lasting.map(placement), shares: self.shares }
    }

    /// Distribution after so many seconds, of whose error a share is left.
    pub(super) fn predicted(&self, place: &Place, seconds: f64, kept: f64) -> Place {
        let redrawn = -(-seconds / REDRAWN_AFTER).exp_m1();
        let other_receiver = -(-seconds / RECEIVER_LASTS).exp_m1();
        let fine = self.shares[0] + self.shares[1];
        // Probability of one reception after another.
        let follows = |from: usize, to: usize| {
            let kind = if from == 2 || to == 2 {
                if from == to { 1.0 } else { 0.0 }
            } else {
                let stays = if from == to { 1.0 - redrawn } else { 0.0 };
                stays + redrawn * self.shares[to] / fine
            };
            (1.0 - other_receiver) * kind + other_receiver * self.shares[to]
        };
        let mut predicted = *place;
        for (number, placement) in predicted.placements.iter_mut().enumerate() {
            let mut mixture = Mixture::default();
            for (other, (share, before)) in place.shares.iter().zip(&place.placements).enumerate() {
                let weight = share * follows(other, number);
                if weight > 0.0 {
                    mixture.add(weight, before);
                }
            }
            predicted.shares[number] = mixture.weight;
            let Some(merged) = mixture.merged() else { continue };
            let ([along, x, y], [aa, ax, ay, xx, xy, yy]) = (merged.mean, merged.covariance);
            let (k, new) = (kept * kept, (1.0 - kept * kept) * self.lasting[number]);
            *placement = Placement {
                mean: [along, kept * x, kept * y],
                covariance: [aa, kept * ax, kept * ay, k * xx + new, k * xy, k * yy + new],
            };
        }
        predicted
    }

    /// Update by the distance across, and the log density of it.
    #[inline]
    pub(super) fn across(&self, place: &Place, sighting: &Sighting) -> (Place, f64) {
        let Sighting { normal: [a, b], across, .. } = *sighting;
        place.observed([0.0, a, b], across, self)
    }

    /// Update by the place along, for a vehicle that stood.
    #[inline]
    pub(super) fn stood(&self, place: &Place, sighting: &Sighting) -> Place {
        place.observed(sighting.along_and_error(), sighting.along, self).0
    }

    /// Distribution of a vehicle that moved: the position alone tells its place along.
    #[inline]
    pub(super) fn moved(&self, place: &Place, sighting: &Sighting) -> Place {
        let mut whites = self.white.into_iter();
        place.each(|Placement { mean: [_, x, y], covariance: [_, _, _, xx, xy, yy] }| {
            let [a, b] = sighting.tangent;
            let (u, v) = (a * xx + b * xy, a * xy + b * yy);
            let white = whites.next().unwrap_or_default();
            Placement {
                mean: [sighting.along - a * x - b * y, x, y],
                covariance: [a * u + b * v + white, -u, -v, xx, xy, yy],
            }
        })
    }

    /// Metres that a position is ahead of a place.
    #[inline]
    pub(super) fn ahead(&self, place: &Place, sighting: &Sighting) -> Ahead {
        let h = sighting.along_and_error();
        let moments = place.placements.map(|placement| placement.of(h));
        let metres = moments.map(|[mean, _]| sighting.along - mean);
        let mut whites = self.white.into_iter();
        let deviations =
            moments.map(|[_, variance]| (variance + whites.next().unwrap_or_default()).sqrt());
        Ahead { shares: place.shares, metres, deviations }
    }
}

impl Ahead {
    /// The same distance with any reception.
    pub(super) fn of(metres: f64, deviation: f64) -> Self {
        let [metres, deviations] = [[metres; RECEPTIONS], [deviation; RECEPTIONS]];
        Self { shares: [1.0, 0.0, 0.0], metres, deviations }
    }

    /// Density of the distance of a vehicle that stood, whose displacement is so many times as probable
    /// as each reception says.
    pub(super) fn standing(&self, steadier: [f64; RECEPTIONS]) -> f64 {
        let mut sum = 0.0;
        for (number, steadier) in steadier.into_iter().enumerate() {
            let deviation = self.deviations[number];
            let z = self.metres[number] / deviation;
            sum += steadier * self.shares[number] * (-0.5 * z * z).exp() / deviation;
        }
        sum / std::f64::consts::TAU.sqrt()
    }

    /// Mean, and standard deviation.
    pub(super) fn moments(&self) -> [f64; 2] {
        let (mut mean, mut variance) = (0.0, 0.0);
        for (share, metres) in self.shares.iter().zip(self.metres) {
            mean += share * metres;
        }
        for (number, share) in self.shares.iter().enumerate() {
            let (off, deviation) = (self.metres[number] - mean, self.deviations[number]);
            variance += share * (off * off + deviation * deviation);
        }
        [mean, variance.sqrt()]
    }
}

/// Mixture of places, of which those of one reception are merged by their moments.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PlaceMixture([Mixture; RECEPTIONS]);

impl PlaceMixture {
    pub(super) fn add(&mut self, weight: f64, place: &Place) {
        for ((mixture, share), placement) in
            self.0.iter_mut().zip(place.shares).zip(&place.placements)
        {
            let weight = weight * share;
            if weight > 0.0 {
                mixture.add(weight, placement);
            }
        }
    }

    /// `None` without weight.
    pub(super) fn merged(&self) -> Option<Place> {
        let merged = self.0.each_ref().map(Mixture::merged);
        let any = merged.iter().flatten().next()?;
        let place = Place {
            placements: merged.map(|placement| placement.unwrap_or(*any)),
            ..Place::default()
        };
        Some(place.reweighted(self.0.each_ref().map(|mixture| mixture.weight)).0)
    }
}
