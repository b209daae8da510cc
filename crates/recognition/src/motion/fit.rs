//! Learning from labelled moves: the shares and the changes of speeds, and odometry.
//!
//! Speeds by Baum-Welch in a model whose states are speeds alone, with Σ_v q(v) w(m, v) as the
//! likelihood of a move m (`guide::formulas`, Route); priors keep every speed and every change
//! possible. Odometry by least squares over spans of steps.

use super::speeds::{FARTHEST, OdometryModel, Speeds, Window};
use wayfix::Belief;
use wayfix::DenseTransition;
use wayfix::HmmError;
use wayfix::LikelihoodVector;
use wayfix::TransitionError;
use wayfix::error::OutOfRange;
use wayfix::{Hmm, Prior};

/// Prior count, in steps, of the present probabilities of a change: a stretch that was driven
/// steadily does not show that the vehicle never stops. (With 30, filters of drives with stops lost
/// 0.3 nats a step more after such a stretch; after stretches with stops it matters little.)
const CHANGE_COUNT: f64 = 200.0;
/// Prior count of the present shares, in steps.
const SHARE_COUNT: f64 = 40.0;
/// Rounds of expectation and maximisation.
const ROUNDS: usize = 10;
/// Slacks to try, and the prior count of the present slack, in steps.
const SLACKS: [f64; 8] = [0.005, 0.01, 0.02, 0.03, 0.05, 0.08, 0.12, 0.18];
const SLACK_COUNT: f64 = 100.0;

impl Speeds {
    /// Learns the shares, the changes and the slack of speeds from drives, given as the number of
    /// places that each step moved on (halves, say, where a label is a range).
    ///
    /// Runs expectation and maximisation (Baum and others 1970) in a model of speeds alone, for
    /// each of eight slacks from 0.005 to 0.18, and takes the most probable of them; a slack of 0
    /// stays. Present values count as 200 steps of changes, 40 of shares and 100 of slack: a speed
    /// that was never seen stays possible, and so does a change. A move that no speed makes carries
    /// no evidence. O(steps k²) for k speeds.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Parameter`] for a move that is not finite.
    pub fn fit<M: AsRef<[f64]>>(&self, drives: &[M]) -> Result<Self, TransitionError> {
        for drive in drives {
            if let Some(&value) = drive.as_ref().iter().find(|value| !value.is_finite()) {
                let (what, expected) = ("a move", "a finite number of places");
                return Err(OutOfRange::new(what, value, expected).into());
            }
        }
        // A slack of 0 is a statement about the vehicle (a train), not an estimate.
        if self.slack() == 0.0 {
            return Ok(self.fit_changes(drives).0);
        }
        let mut best = (f64::NEG_INFINITY, self.clone());
        for slack in SLACKS {
            let (learned, log) = self.clone().with_slack(slack)?.fit_changes(drives);
            // Twice the slack is the share of moves that are one place off: `now` with this slack,
            // `before` with the previous one. `prior` is the log-density of `now`, up to a
            // constant, under a beta prior that counts as `SLACK_COUNT` moves, of which the share
            // `before` is off. The bound 0.99 keeps both of its parameters above 0.
            let (now, before) = (2.0 * slack, (2.0 * self.slack()).min(0.99));
            let prior = SLACK_COUNT * (before * now.ln() + (1.0 - before) * (1.0 - now).ln());
            if log + prior > best.0 {
                best = (log + prior, learned);
            }
        }
        Ok(best.1)
    }

    /// Speeds with learned shares and changes, and the log-likelihood of the moves.
    fn fit_changes<M: AsRef<[f64]>>(&self, drives: &[M]) -> (Self, f64) {
        let moves =
            |drive: &M| drive.as_ref().iter().map(|moved| self.likelihoods(*moved)).collect();
        let move_likelihoods: Vec<Vec<Vec<f64>>> = drives.iter().map(moves).collect();
        let (mut learned, mut log) = (self.clone(), 0.0);
        for _ in 0..ROUNDS {
            // No error is expected: the model is valid, and no step's likelihoods are all 0. Should
            // one arise after all, the last valid estimate stands.
            match learned.em_round(self, &move_likelihoods) {
                Ok(next) => (learned, log) = next,
                Err(_) => break,
            }
        }
        (learned, log)
    }

    /// Likelihood of each speed, given the number of places that a step moved on. Between two whole
    /// numbers it is interpolated.
    fn likelihoods(&self, places: f64) -> Vec<f64> {
        let share = places - places.floor();
        let of = |window: &Window| {
            let weight = |places: f64| {
                let at = places - window.first as f64;
                let inside = (0.0..window.weights.len() as f64).contains(&at);
                #[expect(clippy::cast_sign_loss, reason = "it was just compared with 0")]
                if inside { window.weights[at as usize] } else { 0.0 }
            };
            (1.0 - share) * weight(places.floor()) + share * weight(places.floor() + 1.0)
        };
        let likelihoods: Vec<f64> = self.windows.iter().map(of).collect();
        // A move that no speed makes counts as no evidence, rather than as an impossible step.
        if likelihoods.iter().all(|p| *p == 0.0) {
            vec![1.0; likelihoods.len()]
        } else {
            likelihoods
        }
    }

    /// A round of expectation and maximisation from `self`, with the prior counts of `before`; also
    /// returns the log-likelihood of `self`.
    fn em_round(
        &self,
        before: &Self,
        move_likelihoods: &[Vec<Vec<f64>>],
    ) -> Result<(Self, f64), HmmError> {
        let k = self.values().len();
        let failed = |cause| HmmError::control(0, cause);
        let matrix = DenseTransition::from_row_major(k, &self.switching()).map_err(failed)?;
        let shares = Belief::from_weights(self.shares().to_vec());
        let Ok(shares) = shares else { return Ok((self.clone(), 0.0)) };
        let hmm = Hmm::new(
            Prior::AtFirstObservation(shares),
            matrix,
            LikelihoodVector::linear(k).owned(),
        );
        let Ok(hmm) = hmm else { return Ok((self.clone(), 0.0)) };
        let mut log = 0.0;
        // The counts start at those of the priors, so that each ratio below is the posterior mean
        // of a Dirichlet prior centred at `before`.
        let ((mut nearby, mut anywhere), mut steps) = (before.changes(), CHANGE_COUNT);
        (nearby, anywhere) = (nearby * steps, anywhere * steps);
        let mut share_counts: Vec<f64> = before.shares().iter().map(|p| p * SHARE_COUNT).collect();
        for drive in move_likelihoods.iter().filter(|drive| !drive.is_empty()) {
            let smoothing = hmm.smooth(drive)?;
            log += smoothing.log_likelihood();
            for belief in smoothing.posteriors().iter() {
                share_counts.iter_mut().zip(belief.as_slice()).for_each(|(count, p)| *count += p);
            }
            for moved in hmm.expected_moves(drive)?.moves() {
                // The weights of a step's moves sum to one, so `steps` counts steps. A change to
                // the same speed by "anywhere" cannot be told from staying, and one to a neighbour
                // is counted as nearby: both are rare beside the others.
                steps += moved.weight;
                match moved.to.abs_diff(moved.from) {
                    0 => {}
                    1 => nearby += moved.weight,
                    _ => anywhere += moved.weight,
                }
            }
        }
        let sum: f64 = share_counts.iter().sum();
        share_counts.iter_mut().for_each(|count| *count /= sum);
        let learned = self.clone().with_changes(nearby / steps, anywhere / steps);
        Ok((learned.and_then(|learned| learned.with_shares(&share_counts)).map_err(failed)?, log))
    }
}

/// Prior deviations of scale and bias: readings at a single speed could not tell them apart.
const SCALE_PRIOR_SD: f64 = 0.05;
const BIAS_PRIOR_SD: f64 = 0.005;
/// Smallest deviation that is learned.
const LEAST_DEVIATION: f64 = 0.05;
/// Steps of a span over which readings are compared with places: over fewer, the error of counting
/// in whole references dominates.
const SPAN: usize = 10;

impl OdometryModel {
    /// Learns the model from drives, given as the number of places that each step moved on, and the
    /// readings. Scale and bias are found by least squares over spans of ten steps, held near 1 and
    /// 0 by priors (deviations 0.05 and 0.005); the deviation comes from the errors, less the
    /// effect of counting in whole places. O(steps).
    ///
    /// # Errors
    ///
    /// [`TransitionError::PartStates`] for a drive whose moves and readings differ in number,
    /// or [`TransitionError::Parameter`] for a number that is NaN or beyond ±1e6.
    pub fn fit<M, R>(drives: &[(M, R)]) -> Result<Self, TransitionError>
    where
        M: AsRef<[f64]>,
        R: AsRef<[f64]>,
    {
        let mut spans = Vec::new();
        for (moves, read) in drives {
            let (moves, read) = (moves.as_ref(), read.as_ref());
            let (found, expected) = (read.len(), moves.len());
            if found != expected {
                return Err(TransitionError::PartStates { part: "readings", found, expected });
            }
            if let Some(&value) =
                moves.iter().chain(read).find(|x| x.is_nan() || x.abs() > FARTHEST)
            {
                let what = "a move or a reading";
                let expected = "a value from -1e6 to 1e6";
                return Err(OutOfRange::new(what, value, expected).into());
            }
            let sum = |x: &[f64]| x.iter().sum::<f64>();
            let pairs = moves.chunks(SPAN).zip(read.chunks(SPAN));
            spans.extend(pairs.map(|(m, r)| (m.len() as f64, sum(m), sum(r))));
        }
        let mut model = Self::default();
        // Iterated, since the weight of the priors depends on the deviation, and the deviation on
        // scale and bias.
        for _ in 0..4 {
            // Ridge regression: the priors enter the normal equations of r ≈ scale m + bias n as
            // pseudo-observations with the mean (1, 0), in units of the errors' variance. The sums
            // m of moves and r of readings over a span of n steps have a variance in proportion to
            // n, hence the weight 1 / n.
            let prior = [SCALE_PRIOR_SD, BIAS_PRIOR_SD].map(|sd| (model.deviation / sd).powi(2));
            let (mut mm, mut mn, mut nn) = (prior[0], 0.0, prior[1]);
            let (mut mr, mut nr) = (prior[0], 0.0);
            for &(n, m, r) in &spans {
                let weight = 1.0 / n;
                (mm, mn, nn) = (mm + weight * m * m, mn + weight * m * n, nn + weight * n * n);
                (mr, nr) = (mr + weight * m * r, nr + weight * n * r);
            }
            // Above 0, as the prior terms are on the diagonal of a matrix that is positive
            // semidefinite.
            let determinant = mm * nn - mn * mn;
            model.scale = (mr * nn - nr * mn) / determinant;
            model.bias = (nr * mm - mr * mn) / determinant;
            model.deviation = model.deviation_of(drives);
        }
        Ok(model)
    }

    /// Deviation by the moments of the errors. Counting in whole places makes the errors of
    /// successive steps negatively correlated, and adds twice as much to the variance as it takes
    /// from the covariance; so variance + 2 covariance is free of it.
    fn deviation_of<M: AsRef<[f64]>, R: AsRef<[f64]>>(&self, drives: &[(M, R)]) -> f64 {
        let (mut squares, mut products, mut count) = (0.0, 0.0, 0.0);
        for (moves, read) in drives {
            let pairs = moves.as_ref().iter().zip(read.as_ref());
            let errors: Vec<f64> = pairs.map(|(m, r)| r - self.scale * m - self.bias).collect();
            // Winsorised, so that a slip counts little, as in the density.
            let bound = 4.0 * median(errors.iter().map(|e| e.abs()).collect()).max(0.05);
            let errors: Vec<f64> = errors.iter().map(|e| e.clamp(-bound, bound)).collect();
            squares += errors.iter().map(|e| e * e).sum::<f64>();
            products += errors.windows(2).map(|pair| pair[0] * pair[1]).sum::<f64>();
            count += errors.len() as f64;
        }
        if count == 0.0 {
            return Self::default().deviation;
        }
        let (variance, covariance) = (squares / count, products / count);
        let own = (variance + 2.0 * covariance).clamp(0.25 * variance, variance);
        // Errors are between a Gaussian, whose variance is the scale squared, and a t with four
        // degrees of freedom, whose variance is twice that; 1.4 is in between.
        (own / 1.4).sqrt().max(LEAST_DEVIATION)
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    let middle = values.len() / 2;
    if values.is_empty() {
        return 0.0;
    }
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steady_drives_have_few_changes() {
        let speeds = Speeds::default();
        let steady = speeds.fit(&[vec![1.0; 600]]).unwrap();
        let (nearby, anywhere) = steady.changes();
        assert!(nearby < 3e-3 && anywhere < 2e-3, "{nearby} {anywhere}");
        assert!(steady.shares()[speeds.nearest(1.0)] > 0.9);
        assert!(steady.shares().iter().all(|p| *p > 0.0));
        let unsteady: Vec<f64> = (0..600).map(|k| [1.0, 0.0, 3.0, -1.0][k / 3 % 4]).collect();
        let unsteady = speeds.fit(&[unsteady]).unwrap();
        assert!(unsteady.changes().1 > 0.1, "{:?}", unsteady.changes());
    }

    #[test]
    fn nothing_seen_is_nothing_learned() {
        let speeds = Speeds::default();
        let none: [Vec<f64>; 0] = [];
        let same = speeds.fit(&none).unwrap();
        assert!((same.changes().0 - speeds.changes().0).abs() < 1e-15);
        let jumps = speeds.fit(&[vec![500.0; 10]]).unwrap();
        assert!(jumps.shares().iter().zip(speeds.shares()).all(|(a, b)| (a - b).abs() < 0.1));
        assert!(speeds.fit(&[[f64::NAN]]).is_err());
    }

    #[test]
    fn counting_in_whole_places_is_no_error_of_the_wheels() {
        // 0.7 places a step, read to a tenth.
        let moves: Vec<f64> = (1..400)
            .map(|k| (0.7 * f64::from(k)).round() - (0.7 * f64::from(k - 1)).round())
            .collect();
        let read: Vec<f64> = (1..400).map(|k| 0.7 + [0.1, 0.0, -0.1][k % 3]).collect();
        let learned = OdometryModel::fit(&[(&moves, &read)]).unwrap();
        assert!(learned.deviation < 0.3, "{learned:?}");
        let none: [(Vec<f64>, Vec<f64>); 0] = [];
        let default = OdometryModel::fit(&none).unwrap();
        assert!((default.scale - 1.0).abs() < 1e-12 && default.bias == 0.0);
        assert!(OdometryModel::fit(&[(&moves[1..], &read[..])]).is_err());
        assert!(OdometryModel::fit(&[([f64::NAN], [0.0])]).is_err());
    }
}
