//! Simulated drives, estimated by each method and scored.

use std::error::Error;
use std::num::NonZeroUsize;

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use wayfix::map::RoadMap;
use wayfix::{Hmm, SparseTransition, TableLikelihood, canberra, evaluate};

/// Length of a drive in the paper (section IV).
pub(crate) const STEPS: usize = 50;

/// Start of the drive and noise of the sensor, with the paper's two accuracies.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Setting {
    pub(crate) initial: u64,
    pub(crate) sigma: f64,
    paper_filter: f64,
    paper_smoother: f64,
}

/// Table 1 of the paper.
pub(crate) const SETTINGS: [Setting; 3] = [
    Setting { initial: 5, sigma: 1.0, paper_filter: 0.76, paper_smoother: 0.88 },
    Setting { initial: 5, sigma: 2.0, paper_filter: 0.68, paper_smoother: 0.82 },
    Setting { initial: 90, sigma: 1.0, paper_filter: 0.76, paper_smoother: 0.82 },
];

/// Methods to estimate the place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Estimator {
    /// The sensor alone.
    Raw,
    /// The most probable place given the observations so far.
    Filter,
    /// The most probable place given all observations.
    Smoother,
    /// The most probable path.
    Viterbi,
}

pub(crate) const ESTIMATORS: [Estimator; 4] =
    [Estimator::Raw, Estimator::Filter, Estimator::Smoother, Estimator::Viterbi];

/// One drive: X_0, the truth X_1 … X_T, and an estimate of it by each method.
pub(crate) struct Drive {
    pub(crate) initial: usize,
    pub(crate) truth: Vec<usize>,
    pub(crate) estimates: [Vec<usize>; ESTIMATORS.len()],
}

/// Scores of an estimator in a setting.
pub(crate) struct Row {
    pub(crate) setting: Setting,
    pub(crate) estimator: Estimator,
    /// Accuracy of each drive.
    pub(crate) accuracies: Vec<f64>,
    /// Mean accuracy over the drives, and its standard error.
    pub(crate) mean: f64,
    pub(crate) std_error: f64,
    /// Central 95% of the accuracies of single drives.
    pub(crate) lo95: f64,
    pub(crate) hi95: f64,
    /// Mean distance from the true to the estimated place.
    pub(crate) hops: f64,
    pub(crate) metres: f64,
    /// Fraction of estimated paths with possible moves only.
    pub(crate) legal: f64,
}

impl Row {
    /// Accuracy in the paper, if it has one.
    pub(crate) fn paper(&self) -> Option<f64> {
        match self.estimator {
            Estimator::Filter => Some(self.setting.paper_filter),
            Estimator::Smoother => Some(self.setting.paper_smoother),
            Estimator::Raw | Estimator::Viterbi => None,
        }
    }
}

impl Setting {
    /// Simulates drive number `run` with its own stream of the generator, so that it does not
    /// depend on how many drives there are.
    pub(crate) fn drive(&self, seed: u64, run: u64) -> Result<Drive, Box<dyn Error>> {
        let hmm = canberra::hmm(self.initial, self.sigma)?;
        drive(&hmm, self, seed, run)
    }

    /// Returns the beliefs of filter and smoother at each observation of a drive.
    pub(crate) fn beliefs(&self, drive: &Drive) -> Result<[Vec<Vec<f64>>; 2], Box<dyn Error>> {
        let hmm = canberra::hmm(self.initial, self.sigma)?;
        let seen = &drive.estimates[Estimator::Raw as usize];
        let filtering = hmm.forward(seen)?;
        let smoothing = hmm.smooth(seen)?;
        Ok([filtering.posteriors(), smoothing.posteriors()]
            .map(|posteriors| posteriors.iter().map(|belief| belief.as_slice().to_vec()).collect()))
    }

    /// Simulates and scores many drives, with one row per estimator.
    pub(crate) fn run(
        &self,
        map: &RoadMap,
        runs: NonZeroUsize,
        seed: u64,
        mut done: impl FnMut(),
    ) -> Result<Vec<Row>, Box<dyn Error>> {
        let places = 0..map.places().len();
        let hops: Vec<Vec<f64>> = places
            .clone()
            .map(|i| {
                map.hops_either_way(i).into_iter().map(|h| h.map_or(f64::NAN, f64::from)).collect()
            })
            .collect();
        let metres: Vec<Vec<f64>> = places
            .clone()
            .map(|i| places.clone().map(|j| map.metres_between(i, j).unwrap_or(f64::NAN)).collect())
            .collect();

        let hmm = canberra::hmm(self.initial, self.sigma)?;
        let mut accuracies = [(); ESTIMATORS.len()].map(|()| Vec::new());
        let mut sums = [(0.0, 0.0, 0.0); ESTIMATORS.len()];
        for run in 0..runs.get() as u64 {
            let drive = drive(&hmm, self, seed, run)?;
            for (i, estimate) in drive.estimates.iter().enumerate() {
                accuracies[i].push(evaluate::accuracy(&drive.truth, estimate)?);
                sums[i].0 += evaluate::mean_error(&drive.truth, estimate, |a, b| hops[a][b])?;
                sums[i].1 += evaluate::mean_error(&drive.truth, estimate, |a, b| metres[a][b])?;
                // The move from X_0 counts too: a path that starts with an impossible move is not
                // legal.
                let path: Vec<usize> =
                    std::iter::once(drive.initial).chain(estimate.iter().copied()).collect();
                let illegal = evaluate::illegal_moves(hmm.transition(), &path)?;
                sums[i].2 += f64::from(illegal == 0);
            }
            done();
        }
        let rows = ESTIMATORS.iter().zip(accuracies).zip(sums);
        Ok(rows
            .map(|((&estimator, accuracies), (hops, metres, legal))| {
                let count = runs.get() as f64;
                let mut sorted = accuracies.clone();
                sorted.sort_by(f64::total_cmp);
                let mean = sorted.iter().sum::<f64>() / count;
                let squares: f64 = sorted.iter().map(|a| (a - mean).powi(2)).sum();
                Row {
                    setting: *self,
                    estimator,
                    accuracies,
                    mean,
                    // Standard error of the mean, from the sample variance with n − 1.
                    std_error: (squares / (count - 1.0).max(1.0) / count).sqrt(),
                    lo95: quantile(&sorted, 0.025),
                    hi95: quantile(&sorted, 0.975),
                    hops: hops / count,
                    metres: metres / count,
                    legal: legal / count,
                }
            })
            .collect())
    }
}

fn drive(
    hmm: &Hmm<SparseTransition, TableLikelihood>,
    setting: &Setting,
    seed: u64,
    run: u64,
) -> Result<Drive, Box<dyn Error>> {
    // Streams are numbered by setting and drive, so no two drives share random numbers.
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let number =
        SETTINGS.iter().position(|s| s.initial == setting.initial && s.sigma == setting.sigma);
    rng.set_stream((number.unwrap_or(SETTINGS.len()) as u64) << 32 | run);
    let drive = hmm.simulate(STEPS, &mut rng);
    Ok(Drive {
        initial: drive.initial().ok_or("the drive has no start")?,
        truth: drive.states().to_vec(),
        estimates: [
            drive.observations().to_vec(),
            hmm.forward(drive.observations())?.posteriors().modes(),
            hmm.smooth(drive.observations())?.posteriors().modes(),
            hmm.viterbi(drive.observations())?.into_states(),
        ],
    })
}

/// Value below which a fraction of the sorted values lies (nearest rank).
fn quantile(sorted: &[f64], fraction: f64) -> f64 {
    let below = sorted
        .iter()
        .enumerate()
        .take_while(|(i, _)| *i as f64 + 1.0 < fraction * sorted.len() as f64);
    sorted[below.count()]
}
