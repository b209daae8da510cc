//! A distracted sensor and what it follows, against the chain of mode, place and what is followed.

use proptest::collection::vec;
use proptest::prelude::*;
use rand::{Rng, RngExt};
use wayfix::inference::Distractor;
use wayfix::transition::{
    DistractedTransition, Distraction, DistractionRates, EvidenceTransition, SwitchedTransition,
};
use wayfix::{
    Belief, Controlled, DenseTransition, Hmm, HmmError, LikelihoodVector, Prior, SparseTransition,
    Transition,
};

use crate::kit::{
    Matrix, all_close, cases, close_logs, dense, distribution, matrix, normalized, rate, rng,
    sparse, still, stochastic, text,
};

/// A drive with a sensor that may be distracted.
#[derive(Debug, Clone)]
struct Drive {
    rates: DistractionRates,
    /// Moves of the vehicle, and of what a distracted sensor follows.
    moves: Matrix,
    others: Matrix,
    /// Where a distraction begins.
    start: Vec<f64>,
    prior: Vec<f64>,
    /// Probability that the sensor is distracted at the first observation, if the prior is there;
    /// otherwise it is attentive before the first step.
    at_first: Option<f64>,
    /// Likelihoods of each step, of places and of what is followed; `None` without an observation.
    seen: Vec<Option<(Vec<f64>, Vec<f64>)>>,
}

/// Log-likelihood, and probabilities of each step: of (mode, place), filtered and smoothed, and of
/// what is followed, given the mode.
#[derive(Debug)]
struct Beliefs {
    log_likelihood: f64,
    filtered: Vec<Vec<f64>>,
    smoothed: Vec<Vec<f64>>,
    followed: Vec<Vec<f64>>,
}

type Joint = Hmm<DenseTransition, LikelihoodVector<Vec<f64>>>;

impl Drive {
    fn places(&self) -> usize {
        self.moves.len()
    }

    fn prior(&self, distracted: impl Fn(f64) -> Vec<f64>) -> Prior {
        let share = self.at_first.unwrap_or(0.0);
        let attentive = self.prior.iter().map(|p| (1.0 - share) * p);
        let distracted = self.prior.iter().flat_map(|p| distracted(share * p));
        let belief = Belief::new(attentive.chain(distracted).collect()).unwrap();
        match self.at_first {
            Some(_) => Prior::AtFirstObservation(belief),
            None => Prior::BeforeFirstTransition(belief),
        }
    }

    /// The chain of all three: first the attentive places, then pairs of a place and what is
    /// followed. An observation without likelihoods has 1.
    fn joint(&self) -> (Joint, Vec<Vec<f64>>) {
        let (n, m) = (self.places(), self.start.len());
        let DistractionRates { begin, end } = self.rates;
        let pair = |state: usize| (state >= n).then(|| ((state - n) / m, (state - n) % m));
        let a = matrix(n + n * m, |to, from| match (pair(to), pair(from)) {
            (None, None) => (1.0 - begin) * self.moves[to][from],
            (Some((i, z)), None) => begin * self.moves[i][from] * self.start[z],
            (None, Some((j, _))) => end * self.moves[to][j],
            (Some((i, z)), Some((j, y))) => (1.0 - end) * self.moves[i][j] * self.others[z][y],
        });
        let prior = self.prior(|p| self.start.iter().map(|start| p * start).collect());
        let seen = self.seen.iter().map(|seen| match seen {
            None => vec![1.0; n + n * m],
            Some((places, others)) => {
                let pairs = (0..n).flat_map(|_| others.iter().copied());
                places.iter().copied().chain(pairs).collect()
            }
        });
        let sensor = LikelihoodVector::linear(n + n * m).owned();
        (Hmm::new(prior, dense(&a), sensor).unwrap(), seen.collect())
    }

    fn exact(&self) -> Result<Beliefs, HmmError> {
        let (n, m) = (self.places(), self.start.len());
        let (hmm, seen) = self.joint();
        let smoothing = hmm.smooth(&seen)?;
        let pairs = |belief: &[f64]| -> Vec<f64> {
            let of = |pairs: &[f64]| pairs.iter().sum::<f64>();
            belief[..n].iter().copied().chain(belief[n..].chunks(m).map(of)).collect()
        };
        let mut filter = hmm.filter();
        let (mut filtered, mut followed) = (Vec::new(), Vec::new());
        for seen in &seen {
            filter.step(seen)?;
            let belief = filter.belief().as_slice();
            filtered.push(pairs(belief));
            let others = (0..m).map(|z| belief[n + z..].iter().step_by(m).sum::<f64>());
            let others: Vec<f64> = others.collect();
            let sum: f64 = others.iter().sum();
            followed.push(if sum > 1e-12 {
                others.iter().map(|p| p / sum).collect()
            } else {
                Vec::new()
            });
        }
        let smoothed = (1..=seen.len()).map(|k| smoothing.posteriors().get(k).unwrap());
        let smoothed = smoothed.map(|view| pairs(view.as_slice())).collect();
        Ok(Beliefs { log_likelihood: filter.log_likelihood(), filtered, smoothed, followed })
    }

    /// The filter of modes and places, with a distractor.
    fn factored(&self) -> Result<Beliefs, HmmError> {
        let n = self.places();
        let a = DistractedTransition::new(sparse(&self.moves), self.rates).unwrap();
        let prior = self.prior(|p| vec![p]);
        let hmm = Hmm::new(prior, a, LikelihoodVector::linear(2 * n).owned()).unwrap();
        let start = Belief::new(self.start.clone()).unwrap();
        let mut distractor = Distractor::new(sparse(&self.others), start, self.rates).unwrap();
        let mut filter = hmm.filter();
        let (mut controls, mut drive) = (Vec::new(), Vec::new());
        let (mut filtered, mut followed) = (Vec::new(), Vec::new());
        for (k, seen) in self.seen.iter().enumerate() {
            let [_, distracted] = hmm.transition().mode_masses(filter.belief().as_slice());
            let first = k == 0 && self.at_first.is_some();
            let mut y = vec![1.0; 2 * n];
            let mut control = Distraction::none(());
            if let Some((places, others)) = seen {
                y[..n].copy_from_slice(places);
                let before = distractor.belief().as_slice().to_vec();
                if first {
                    let (begins, _) = distractor.first(others)?;
                    y[n..].fill(begins);
                } else {
                    let likelihoods = distractor.observe(&(), others, distracted)?;
                    (control.begins, control.continues) = likelihoods;
                }
                assert_eq!(distractor.belief().as_slice(), before);
                let proposed = distractor.proposed().as_slice().to_vec();
                filter.step_with(&control, &y)?;
                distractor.accept();
                assert_eq!(distractor.belief().as_slice(), proposed);
            } else {
                filter.predict_with(&control)?;
                if !first {
                    distractor.predict(&(), distracted)?;
                }
            }
            controls.push(control);
            drive.push(y);
            filtered.push(filter.belief().as_slice().to_vec());
            followed.push(distractor.belief().as_slice().to_vec());
        }
        let smoothing = hmm.smooth(&Controlled::new(&controls, &drive).unwrap())?;
        let smoothed = (1..=drive.len()).map(|k| smoothing.posteriors().get(k).unwrap());
        let smoothed = smoothed.map(|view| view.as_slice().to_vec()).collect();
        Ok(Beliefs { log_likelihood: filter.log_likelihood(), filtered, smoothed, followed })
    }

    /// Checks that the factored filter is exact, and if asked for, the smoother.
    fn assert_exact(&self, smoother: bool) -> Result<(), TestCaseError> {
        let (found, expected) = match (self.factored(), self.exact()) {
            (Ok(found), Ok(expected)) => (found, expected),
            (found, expected) => {
                // What is impossible may be a move here, and an observation there.
                let step = |error: Option<HmmError>| error.map(|error| error.step());
                prop_assert_eq!(step(found.err()), step(expected.err()));
                return Ok(());
            }
        };
        close_logs(found.log_likelihood, expected.log_likelihood, 1e-12)?;
        for (found, expected) in found.filtered.iter().zip(&expected.filtered) {
            all_close(found, expected, 1e-12, 1.0)?;
        }
        for (found, expected) in found.followed.iter().zip(&expected.followed) {
            if !expected.is_empty() {
                all_close(found, expected, 1e-9, 1.0)?;
            }
        }
        for (found, expected) in found.smoothed.iter().zip(&expected.smoothed) {
            if smoother {
                all_close(found, expected, 1e-12, 1.0)?;
            }
        }
        Ok(())
    }
}

/// Likelihoods of a step, some of them 0.
fn seen(places: usize, others: usize) -> impl Strategy<Value = (Vec<f64>, Vec<f64>)> {
    let value = || prop_oneof![1 => Just(0.0), 6 => 0.01..1.0];
    (vec(value(), places), vec(value(), others))
}

/// Drives of 4 to 6 steps among 1 to 3 places and things to follow, where some steps have no
/// observation.
fn drives() -> impl Strategy<Value = Drive> {
    let sizes = (1..=3_usize, 1..=3_usize, 4..=6_usize);
    sizes.prop_flat_map(|(n, m, steps)| {
        let rates = (rate(false), rate(false));
        let rates = rates.prop_map(|(begin, end)| DistractionRates { begin, end });
        let first = prop_oneof![Just(None), rate(false).prop_map(Some)];
        let seen = vec(prop_oneof![1 => Just(None), 4 => seen(n, m).prop_map(Some)], steps);
        let chains = (stochastic(false, n), stochastic(false, m), distribution(false, m));
        (rates, chains, distribution(false, n), first, seen).prop_map(
            |(rates, (moves, others, start), prior, at_first, seen)| Drive {
                rates,
                moves,
                others,
                start,
                prior,
                at_first,
                seen,
            },
        )
    })
}

proptest! {
    #![proptest_config(cases())]

    /// Attentive observations that say nothing of the vehicle: any number of distractions.
    #[test]
    fn a_distractor_is_exact_if_nothing_is_seen_of_the_vehicle(mut drive in drives()) {
        for (places, _) in drive.seen.iter_mut().flatten() {
            let likelihood = places[0];
            places.fill(likelihood);
        }
        drive.assert_exact(false)?;
    }

    /// What is followed is drawn anew for each observation, as outliers of robust sensors are.
    #[test]
    fn a_distractor_is_exact_if_it_has_no_memory(mut drive in drives()) {
        drive.others = matrix(drive.start.len(), |i, _| drive.start[i]);
        drive.assert_exact(true)?;
    }

    /// Distractions begin in one state, which only one observation allows.
    #[test]
    fn a_distractor_is_exact_if_it_is_known_when_a_distraction_began(
        mut drive in drives(), onset in 0..4_usize,
    ) {
        let certain = |i: usize| f64::from(i == 0);
        drive.start = (0..drive.start.len()).map(certain).collect();
        let (n, m) = (drive.places(), drive.start.len());
        for (k, seen) in drive.seen.iter_mut().enumerate() {
            let seen = seen.get_or_insert_with(|| (vec![0.5; n], vec![0.25; m]));
            seen.1[0] = if k == onset { 0.75 } else { 0.0 };
        }
        drive.assert_exact(true)?;
    }
}

/// A random drive. Likelihoods of an observation differ by up to a factor of `reach`; both chains stay
/// where they are with probability `stay`, else move at random.
fn random_drive(rng: &mut impl Rng, reach: f64, stay: f64) -> Drive {
    let (n, m) = (rng.random_range(2..=3), rng.random_range(2..=3));
    let steps = rng.random_range(4..=6);
    let draw = |rng: &mut dyn FnMut() -> f64, count: usize| -> Vec<f64> {
        normalized((0..count).map(|_| rng()).collect(), 0)
    };
    let mut uniform = || rng.random_range(0.0..1.0);
    let columns = |uniform: &mut dyn FnMut() -> f64, count: usize| {
        let columns: Vec<Vec<f64>> = (0..count).map(|_| draw(uniform, count)).collect();
        matrix(count, |i, j| stay * f64::from(i == j) + (1.0 - stay) * columns[j][i])
    };
    let (moves, others) = (columns(&mut uniform, n), columns(&mut uniform, m));
    let (start, prior) = (draw(&mut uniform, m), draw(&mut uniform, n));
    let rates = DistractionRates { begin: 0.3 * uniform(), end: 0.5 * uniform() };
    let mut likelihoods =
        |count: usize| -> Vec<f64> { (0..count).map(|_| reach.powf(-uniform())).collect() };
    let seen = (0..steps).map(|_| Some((likelihoods(n), likelihoods(m)))).collect();
    Drive { rates, moves, others, start, prior, at_first: None, seen }
}

/// Half the sum of differences.
fn total_variation(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum::<f64>() / 2.0
}

/// Otherwise it is approximate: largest and mean total variation of the probabilities of (mode,
/// place), filtered, then smoothed, and the largest difference of log-likelihoods.
#[test]
fn a_distractor_is_close_otherwise() {
    // Half as much again as in 30,000 drives of each kind.
    let cases = [
        (3.0, 0.0, [0.004, 1e-5, 0.1, 0.0011, 3e-4]),
        (20.0, 0.0, [0.02, 6e-5, 0.2, 0.0025, 0.006]),
        (200.0, 0.0, [0.05, 1e-4, 0.3, 0.003, 0.02]),
        (20.0, 0.9, [0.15, 0.0017, 0.4, 0.01, 0.05]),
        (200.0, 0.9, [0.26, 0.004, 0.65, 0.02, 0.4]),
    ];
    for (reach, stay, limits) in cases {
        let (mut rng, count) = (rng(7), 2000);
        let (mut most, mut sums, mut most_log, mut steps) = ([0.0_f64; 3], [0.0; 3], 0.0_f64, 0.0);
        for _ in 0..count {
            let drive = random_drive(&mut rng, reach, stay);
            let (found, expected) = (drive.factored().unwrap(), drive.exact().unwrap());
            // Observations of a distracted sensor that are independent, as outliers are.
            let others = matrix(drive.start.len(), |i, _| drive.start[i]);
            let outliers = Drive { others, ..drive.clone() }.factored().unwrap();
            let pairs = [
                (&found.filtered, &expected.filtered),
                (&found.smoothed, &expected.smoothed),
                (&outliers.filtered, &expected.filtered),
            ];
            for (at, (found, expected)) in pairs.into_iter().enumerate() {
                for (found, expected) in found.iter().zip(expected) {
                    let difference = total_variation(found, expected);
                    most[at] = most[at].max(difference);
                    sums[at] += difference;
                }
            }
            steps += drive.seen.len() as f64;
            most_log = most_log.max((found.log_likelihood - expected.log_likelihood).abs());
        }
        let means = sums.map(|sum| sum / steps);
        let found = [most[0], means[0], most[1], means[1], most_log];
        assert!(found.iter().zip(limits).all(|(found, limit)| *found < limit), "{found:?}");
        // What is followed has a memory, which outliers lack.
        assert!(means[0] < means[2] / 4.0, "{} and {}", means[0], means[2]);
    }
}

fn loops() -> Distractor<SwitchedTransition<SparseTransition>> {
    let operators = vec![still(2), SparseTransition::from_rows(&[[0.0, 1.0], [1.0, 0.0]]).unwrap()];
    let transition = SwitchedTransition::new(operators).unwrap();
    let rates = DistractionRates { begin: 0.25, end: 0.5 };
    Distractor::new(transition, Belief::new(vec![0.75, 0.25]).unwrap(), rates).unwrap()
}

#[test]
fn a_proposal_is_taken_over_only_when_it_is_accepted() {
    let mut distractor = loops();
    assert_eq!(distractor.first(&[0.5, 0.5]).unwrap(), (0.5, 0.5));
    assert_eq!(distractor.first(&[0.0, 2.0]).unwrap(), (0.5, 0.5));
    assert_eq!(distractor.belief().as_slice(), [0.75, 0.25]);
    assert_eq!(distractor.proposed().as_slice(), [0.0, 1.0]);
    distractor.accept();
    distractor.accept(); // without a proposal it does nothing
    assert_eq!(distractor.belief().as_slice(), [0.0, 1.0]);
    assert_eq!(distractor.proposed().as_slice(), [0.0, 1.0]);

    // Surely distracted: it turns to the other state. Surely attentive: it is at the start.
    assert_eq!(distractor.observe(&1, &[0.5, 1.0], 1.0).unwrap(), (0.625, 0.5));
    assert_eq!(distractor.proposed().as_slice(), [1.0, 0.0]);
    assert_eq!(distractor.observe(&1, &[0.5, 1.5], 0.0).unwrap(), (0.75, 0.5));
    assert_eq!(distractor.proposed().as_slice(), [0.5, 0.5]);
    let clone = distractor.clone();
    distractor.predict(&1, 1.0).unwrap(); // drops it
    distractor.accept();
    assert_eq!(distractor.belief().as_slice(), [1.0, 0.0]);
    assert_eq!(clone.belief().as_slice(), [0.0, 1.0]);
    assert_eq!(clone.proposed().as_slice(), [0.5, 0.5]);

    let mut again = clone.with_belief(Belief::new(vec![0.5, 0.5]).unwrap()).unwrap();
    assert_eq!(again.proposed().as_slice(), [0.5, 0.5]);
    assert_eq!(again.transition().operators().len(), 2);
    again.observe(&1, &[0.5, 1.5], 0.0).unwrap();
    again.restart(); // drops the proposal
    again.accept();
    assert_eq!(again.belief().as_slice(), [0.75, 0.25]);
}

#[test]
fn a_distractor_without_a_way_on_starts_anew() {
    let mut distractor = loops();
    // Likelihoods that rule out all states, or are tiny.
    assert_eq!(distractor.observe(&0, &[0.0, 0.0], 0.5).unwrap(), (0.0, 0.0));
    assert_eq!(distractor.proposed().as_slice(), [0.75, 0.25]);
    distractor.observe(&0, &[1e-308, 3e-308], 0.0).unwrap();
    assert!((distractor.proposed().as_slice()[0] - 0.5).abs() < 1e-12);
    // A distraction can neither begin nor go on.
    let rates = DistractionRates { begin: 0.0, end: 1.0 };
    let start = || Belief::new(vec![0.75, 0.25]).unwrap();
    let mut never = Distractor::new(still(2), start(), rates).unwrap();
    never.predict(&(), 0.5).unwrap();
    assert_eq!(never.belief().as_slice(), [0.75, 0.25]);

    // Evidence that rules out all moves, and evidence far beyond doubles.
    let rates = DistractionRates { begin: 0.5, end: 0.0 };
    let odometry = |u: &f64, _: usize, from: usize| if from == 0 { *u } else { 2.0 * *u };
    let a = EvidenceTransition::new(still(2), odometry).unwrap();
    let mut driven = Distractor::new(a, start(), rates).unwrap();
    let (begins, continues) = driven.observe(&f64::NEG_INFINITY, &[0.5, 1.0], 0.5).unwrap();
    assert_eq!((begins, continues), (0.625, 0.0));
    assert!((driven.proposed().as_slice()[0] - 0.6).abs() < 1e-15);
    let (_, continues) = driven.observe(&-5000.0, &[0.5, 1.0], 1.0).unwrap();
    assert_eq!((continues, driven.proposed().as_slice()), (0.5, &[1.0, 0.0][..]));
    // The likelihoods e^-u and e^-2u, with odds of 3 to 1 before.
    let (_, continues) = driven.observe(&-3_f64.ln(), &[0.0, 1.0], 1.0).unwrap();
    assert!((continues - 0.1).abs() < 1e-15);
}

#[test]
fn errors_leave_a_distractor_as_it_was() {
    let mut distractor = loops();
    distractor.observe(&1, &[0.5, 1.0], 0.5).unwrap();
    distractor.accept();
    distractor.observe(&1, &[1.0, 0.25], 0.25).unwrap();
    let before = format!("{:?}", (distractor.belief(), distractor.proposed()));
    let nan = f64::NAN;
    let bad: [(usize, &[f64], f64, &str); 7] = [
        (
            1,
            &[1.0],
            0.5,
            "step 2 has no valid likelihood: the likelihood has 1 values, expected one for each of 2 states",
        ),
        (
            1,
            &[1.0, nan],
            0.5,
            "step 2 has no valid likelihood: state 1 has likelihood NaN, expected a finite value of at least 0",
        ),
        (
            1,
            &[-1.0, 1.0],
            0.5,
            "step 2 has no valid likelihood: state 0 has likelihood -1, expected a finite value of at least 0",
        ),
        (
            1,
            &[1.0, f64::INFINITY],
            0.5,
            "step 2 has no valid likelihood: state 1 has likelihood inf, expected a finite value of at least 0",
        ),
        (
            1,
            &[1.0, 1.0],
            1.5,
            "step 2 has no valid control: the probability that the sensor is distracted is 1.5, expected a value from 0 to 1",
        ),
        (
            1,
            &[1.0, 1.0],
            nan,
            "step 2 has no valid control: the probability that the sensor is distracted is NaN, expected a value from 0 to 1",
        ),
        (
            2,
            &[1.0, 1.0],
            0.5,
            "step 2 has no valid control: operator 2, expected one of 2 (0 to 1)",
        ),
    ];
    for (control, likelihoods, distracted, expected) in bad {
        assert_eq!(text(distractor.observe(&control, likelihoods, distracted)), expected);
        if likelihoods == [1.0, 1.0] {
            assert_eq!(text(distractor.predict(&control, distracted)), expected);
        } else {
            assert_eq!(text(distractor.first(likelihoods)), expected);
        }
        assert_eq!(format!("{:?}", (distractor.belief(), distractor.proposed())), before);
    }
    distractor.observe(&1, &[1.0, 1.0], 1.0 + 1e-12).unwrap(); // a rounding error of a sum

    let rates = DistractionRates { begin: 0.25, end: 0.5 };
    let three = || Belief::uniform(3).unwrap();
    assert_eq!(
        text(Distractor::new(still(2), three(), rates)),
        "the start belief has 3 states, expected 2 to match the inner operator"
    );
    assert_eq!(
        text(distractor.with_belief(three())),
        "the belief has 3 states, expected 2 to match the inner operator"
    );
    let rates = DistractionRates { begin: 2.0, end: 0.5 };
    assert_eq!(
        text(Distractor::new(still(3), three(), rates)),
        "the probability that a distraction begins is 2, expected a value from 0 to 1"
    );
}

/// An operator that violates its contract.
struct Negative;

impl Transition for Negative {
    type Control = u8;
    fn states(&self) -> usize {
        2
    }
    fn apply(&self, _: &u8, _: &[f64], out: &mut [f64]) {
        out.copy_from_slice(&[1.5, -0.5]);
    }
    fn apply_transpose(&self, control: &u8, x: &[f64], out: &mut [f64]) {
        self.apply(control, x, out);
    }
}

#[test]
fn predictions_that_are_no_probabilities_are_named() {
    let rates = DistractionRates { begin: 0.25, end: 0.5 };
    let mut distractor = Distractor::new(Negative, Belief::uniform(2).unwrap(), rates).unwrap();
    let expected =
        "at step 1 the transition operator predicts -0.5 for state 1, expected a probability";
    assert_eq!(text(distractor.observe(&0, &[1.0, 1.0], 0.5)), expected);
    assert_eq!(distractor.belief().as_slice(), [0.5, 0.5]);
}
