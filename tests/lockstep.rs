//! Many sequences in lock-step give what each gives by itself.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::{
    Belief, DenseTransition, Hmm, InferenceError, Likelihood, LikelihoodVector, OptionalLikelihood,
    Posteriors, Prior, RoundedTails, SequenceError, SparseTransition, TransitionEntries,
};

/// Likelihoods or their logarithms, or nothing.
type Sensor = OptionalLikelihood<LikelihoodVector<Vec<f64>>>;
type Drive = Vec<Option<Vec<f64>>>;

/// A model of states enough for lock-step, and drives through it.
#[derive(Debug, Clone)]
struct Case {
    states: usize,
    at_first: bool,
    prior: Vec<f64>,
    /// `columns[from][to]`.
    columns: Vec<Vec<f64>>,
    drives: Vec<Drive>,
    log: bool,
}

fn distribution(mut weights: Vec<f64>, spare: usize) -> Vec<f64> {
    if weights.iter().sum::<f64>() < 1e-6 {
        weights[spare] = 1.0;
    }
    let sum: f64 = weights.iter().sum();
    weights.iter().map(|w| w / sum).collect()
}

/// Plain ones, or with numbers that lock-step leaves to others here and there.
fn cases(extreme: bool) -> impl Strategy<Value = Case> {
    (9..=20_usize, any::<bool>(), any::<bool>(), 0..=20_usize).prop_flat_map(
        move |(n, at_first, log, count)| {
            let weight = if extreme {
                prop_oneof![200 => Just(0.0), 200 => 0.01..1.0, 1 => Just(1e-300), 1 => Just(1e-50)]
                    .boxed()
            } else {
                prop_oneof![1 => Just(0.0), 1 => 0.01..1.0].boxed()
            };
            let column = (vec(weight, n), 0..n).prop_map(|(w, spare)| distribution(w, spare));
            let likelihood = prop_oneof![1 => Just(0.0), 9 => 0.001..1.0];
            let row = vec(likelihood, n);
            let usual = row.prop_map(move |b| {
                Some(if log { b.iter().map(|b: &f64| b.ln()).collect() } else { b })
            });
            let scale = if log {
                prop_oneof![Just(-1e5), Just(-400.0), Just(700.0)].boxed()
            } else {
                prop_oneof![Just(1e-250), Just(1e-100), Just(1e200)].boxed()
            };
            let scaled = (vec(0.001..1.0, n), scale).prop_map(move |(b, scale)| {
                let scaled = |b: &f64| if log { b.ln() + scale } else { b * scale };
                Some(b.iter().map(scaled).collect::<Vec<f64>>())
            });
            let wild = vec(-1500.0..0.0, n).prop_map(move |logs| {
                Some(logs.iter().map(|l: &f64| if log { *l } else { (l / 3.0).exp() }).collect())
            });
            let bad = (0..n, prop_oneof![Just(f64::NAN), Just(-1.0), Just(f64::INFINITY)])
                .prop_map(move |(at, bad)| {
                    let bad = if log && bad < 0.0 { 2e300 } else { bad };
                    Some((0..n).map(|i| if i == at { bad } else { 0.5 }).collect())
                });
            let nothing = Just(Some(vec![if log { f64::NEG_INFINITY } else { 0.0 }; n]));
            let short = Just(Some(vec![0.5; n - 1]));
            let rare = u32::from(extreme);
            let y = prop_oneof![
                200 => usual, 10 => Just(None), 10 => scaled,
                rare => wild, rare => bad, rare => nothing, rare => short
            ];
            let drives = vec(vec(y, 0..40), count);
            (column.clone(), vec(column, n), drives).prop_map(move |(prior, columns, drives)| {
                Case { states: n, at_first, prior, columns, drives, log }
            })
        },
    )
}

impl Case {
    fn prior(&self) -> Prior {
        let belief = Belief::new(self.prior.clone()).unwrap();
        if self.at_first {
            Prior::AtFirstObservation(belief)
        } else {
            Prior::BeforeFirstTransition(belief)
        }
    }

    fn sensor(&self) -> Sensor {
        let vectors = if self.log { LikelihoodVector::log } else { LikelihoodVector::linear };
        OptionalLikelihood::new(vectors(self.states).owned())
    }

    fn sparse(&self) -> SparseTransition {
        let entries = self.columns.iter().enumerate();
        let entries = entries.flat_map(|(j, c)| c.iter().enumerate().map(move |(i, p)| (i, j, *p)));
        SparseTransition::from_triplets(self.states, entries).unwrap()
    }

    fn dense(&self) -> DenseTransition {
        DenseTransition::from_fn(self.states, |to, from| self.columns[from][to]).unwrap()
    }
}

fn close(found: f64, expected: f64) -> bool {
    (found - expected).abs() <= 1e-12 * expected.abs() + 1e-300
}

fn near(found: &Posteriors, expected: &Posteriors) -> bool {
    let (found, expected) = (found.as_slice(), expected.as_slice());
    found.len() == expected.len() && found.iter().zip(expected).all(|(f, e)| close(*f, *e))
}

/// A sum of logarithms, some of which are large.
fn near_log(found: f64, expected: f64, size: f64) -> bool {
    (found - expected).abs() <= 1e-12 * expected.abs().max(size)
}

/// The same results but for rounding, the same errors in the same places.
fn same<R: std::fmt::Debug>(
    many: &[Result<R, SequenceError>],
    one: impl Fn(usize) -> Result<R, InferenceError>,
    near: impl Fn(&R, &R) -> bool,
) -> Result<(), TestCaseError> {
    for (index, found) in many.iter().enumerate() {
        match (found, one(index)) {
            (Ok(found), Ok(expected)) => {
                prop_assert!(near(found, &expected), "{index}: {found:?}, expected {expected:?}");
            }
            (Err(found), Err(expected)) => {
                prop_assert_eq!(found.sequence, index);
                prop_assert_eq!(found.source.to_string(), expected.to_string());
            }
            (found, expected) => prop_assert!(false, "{found:?}, expected {expected:?}"),
        }
    }
    Ok(())
}

fn check<A, B>(hmm: &Hmm<A, B>, drives: &[Drive]) -> Result<(), TestCaseError>
where
    A: TransitionEntries<Control = ()> + Sync,
    B: Likelihood<Observation = Option<Vec<f64>>> + Sync,
{
    let filtered = hmm.forward_all(drives);
    prop_assert_eq!(filtered.len(), drives.len());
    same(
        &filtered,
        |i| hmm.forward(&drives[i]),
        |found, expected| {
            let size = expected.log_likelihoods().iter().map(|log| log.abs()).fold(1.0, f64::max);
            let mut logs = found.log_likelihoods().iter().zip(expected.log_likelihoods());
            near(found.posteriors(), expected.posteriors())
                && found.log_likelihoods().len() == expected.log_likelihoods().len()
                && logs.all(|(f, e)| near_log(*f, *e, size))
                && near_log(found.log_likelihood(), expected.log_likelihood(), size)
        },
    )?;
    same(
        &hmm.smooth_all(drives),
        |i| hmm.smooth(&drives[i]),
        |found, expected| {
            near(found.posteriors(), expected.posteriors())
                && near_log(found.log_likelihood(), expected.log_likelihood(), 1e5)
        },
    )?;
    same(&hmm.score_all(drives), |i| hmm.score(&drives[i]), |f, e| near_log(*f, *e, 1e5))?;
    same(
        &hmm.viterbi_all(drives),
        |i| hmm.viterbi(&drives[i]),
        |found, expected| {
            found.states() == expected.states()
                && found.log_probability().to_bits() == expected.log_probability().to_bits()
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(300) })]

    #[test]
    fn sequences_together_are_those_alone(case in cases(false)) {
        check(&Hmm::new(case.prior(), case.sparse(), case.sensor()).unwrap(), &case.drives)?;
        check(&Hmm::new(case.prior(), case.dense(), case.sensor()).unwrap(), &case.drives)?;
    }

    /// Also where some are impossible, not valid, or beyond doubles.
    #[test]
    fn extremes_are_left_to_who_knows_them(case in cases(true)) {
        check(&Hmm::new(case.prior(), case.sparse(), case.sensor()).unwrap(), &case.drives)?;
        let rounded = RoundedTails(case.sensor());
        check(&Hmm::new(case.prior(), case.dense(), rounded).unwrap(), &case.drives)?;
    }
}
