//! Operators without a control, by their faster routines, against the same with one.

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::test_runner::TestCaseResult;
use wayfix::inference::Pruning;
use wayfix::transition::{EvidenceTransition, Stored, SwitchedTransition};
use wayfix::{
    Belief, Controlled, Hmm, HmmError, LikelihoodVector, Prior, TableLikelihood, Transition,
    TransitionEntries, TransitionError,
};

use crate::kit::{
    Matrix, Own, all_close, bits, cases_of, close_logs, dense, distribution, prior, same_results,
    says, sparse, stochastic, weighted,
};

/// An operator that takes a control, which changes nothing.
#[derive(Debug, Clone)]
struct Driven<A>(A);

impl<A: Transition<Control = ()>> Transition for Driven<A> {
    type Control = u8;
    fn states(&self) -> usize {
        self.0.states()
    }
    fn apply(&self, _: &u8, x: &[f64], out: &mut [f64]) {
        self.0.apply(&(), x, out);
    }
    fn apply_transpose(&self, _: &u8, x: &[f64], out: &mut [f64]) {
        self.0.apply_transpose(&(), x, out);
    }
    fn apply_log(&self, _: &u8, x: &[f64], out: &mut [f64]) {
        self.0.apply_log(&(), x, out);
    }
    fn apply_transpose_log(&self, _: &u8, x: &[f64], out: &mut [f64]) {
        self.0.apply_transpose_log(&(), x, out);
    }
    fn stored(&self, _: &u8) -> Option<Stored<'_>> {
        self.0.stored(&())
    }
}

impl<A: TransitionEntries<Control = ()>> TransitionEntries for Driven<A> {
    fn incoming(&self, _: &u8, to: usize) -> impl Iterator<Item = (usize, f64)> {
        self.0.incoming(&(), to)
    }
    fn outgoing(&self, _: &u8, from: usize) -> impl Iterator<Item = (usize, f64)> {
        self.0.outgoing(&(), from)
    }
}

/// Operators of several types, chosen at run time.
type Chosen = Box<dyn Transition<Control = ()> + Send + Sync>;

/// A model with symbols, and sequences of these.
#[derive(Debug, Clone)]
struct Case {
    at_first: bool,
    prior: Vec<f64>,
    matrix: Matrix,
    table: Vec<Vec<f64>>,
    sequences: Vec<Vec<usize>>,
}

/// Below and above eight states, with short and long sequences, few and many.
fn instances() -> impl Strategy<Value = Case> {
    (1..=12_usize, 1..=3_usize).prop_flat_map(|(n, symbols)| {
        let row = weighted(prop_oneof![1 => Just(0.0), 12 => 0.01..1.0], symbols);
        let sequences = vec(vec(0..symbols, 0..80), 1..=6);
        (any::<bool>(), distribution(false, n), stochastic(false, n), vec(row, n), sequences)
            .prop_map(|(at_first, prior, matrix, table, sequences)| Case {
                at_first,
                prior,
                matrix,
                table,
                sequences,
            })
    })
}

impl Case {
    fn hmm<A: Transition>(&self, transition: A) -> Hmm<A, TableLikelihood> {
        let table = TableLikelihood::from_rows(&self.table).unwrap();
        Hmm::new(prior(&self.prior, self.at_first), transition, table).unwrap()
    }

    /// Whole sequences, one by one and at once.
    fn check_batches<A>(&self, operator: A) -> TestCaseResult
    where
        A: TransitionEntries<Control = ()> + Clone + Sync,
    {
        let (hmm, other) = (self.hmm(operator.clone()), self.hmm(Driven(operator)));
        let (ys, count) = (&self.sequences, self.sequences.len());
        let controls: Vec<Vec<u8>> = ys.iter().map(|ys| vec![0; ys.len()]).collect();
        let driven: Vec<_> =
            controls.iter().zip(ys).map(|(us, ys)| Controlled::new(us, ys).unwrap()).collect();
        let near = |found: &[f64], expected: &[f64]| all_close(found, expected, 1e-11, 1e-280);
        let near_log = |found, expected| close_logs(found, expected, 1e-11).is_ok();
        same_results(
            &other.forward_all(&driven),
            count,
            |i| hmm.forward(&ys[i]),
            |found, expected| {
                near(found.posteriors().as_slice(), expected.posteriors().as_slice()).is_ok()
                    && near_log(found.log_likelihood(), expected.log_likelihood())
            },
        )?;
        same_results(
            &hmm.smooth_all(ys),
            count,
            |i| other.smooth(&driven[i]),
            |found, expected| {
                near(found.posteriors().as_slice(), expected.posteriors().as_slice()).is_ok()
                    && near_log(found.log_likelihood(), expected.log_likelihood())
            },
        )?;
        same_results(
            &hmm.log_likelihood_all(ys),
            count,
            |i| other.log_likelihood(&driven[i]),
            |found, expected| near_log(*found, *expected),
        )?;
        same_results(
            &hmm.viterbi_all(ys),
            count,
            |i| other.viterbi(&driven[i]),
            |found, expected| {
                found.states() == expected.states()
                    && near_log(found.log_probability(), expected.log_probability())
            },
        )
    }

    /// A trait object of an operator gives the same as the operator, to the bit.
    fn check_trait_object<A>(&self, operator: A) -> TestCaseResult
    where
        A: Transition<Control = ()> + Clone + Send + Sync + 'static,
    {
        let chosen: Chosen = Box::new(operator.clone());
        let (hmm, other) = (self.hmm(operator), self.hmm(chosen));
        for ys in &self.sequences {
            let (mut filter, mut filter_of_other) = (hmm.filter(), other.filter());
            for y in ys {
                let [log, of_other] = [filter.step(y), filter_of_other.step(y)]
                    .map(|log| log.map(f64::to_bits).map_err(|error| error.to_string()));
                prop_assert_eq!(log, of_other);
                let belief = filter.belief();
                prop_assert_eq!(bits(belief.as_slice()), bits(filter_of_other.belief().as_slice()));
            }
            let [found, of_other] = [hmm.smooth(ys), other.smooth(ys)].map(|smoothed| {
                smoothed
                    .map(|s| (bits(s.posteriors().as_slice()), s.log_likelihood().to_bits()))
                    .map_err(|error| error.to_string())
            });
            prop_assert_eq!(found, of_other);
        }
        Ok(())
    }

    /// Streams, step by step: the filter to the bit, the pruned one within its bound.
    fn check_streams<A>(&self, operator: A, pruning: Pruning) -> TestCaseResult
    where
        A: TransitionEntries<Control = ()> + Clone,
    {
        let (hmm, other) = (self.hmm(operator.clone()), self.hmm(Driven(operator)));
        let (mut filter, mut filter_of_other) = (hmm.filter(), other.filter());
        let (mut pruned, mut pruned_of_other) =
            (hmm.pruned_filter(pruning), other.pruned_filter(pruning));
        for y in self.sequences.iter().flatten() {
            let log = match (filter.step(y), filter_of_other.step_with(&0, y)) {
                (Ok(log), Ok(of_other)) => {
                    prop_assert_eq!(log.to_bits(), of_other.to_bits());
                    log
                }
                (found, of_other) => {
                    prop_assert_eq!(
                        found.unwrap_err().to_string(),
                        of_other.unwrap_err().to_string()
                    );
                    pruned.step(y).unwrap_err();
                    pruned_of_other.step_with(&0, y).unwrap_err();
                    continue;
                }
            };
            prop_assert!(log.is_finite());
            let belief = filter.belief();
            prop_assert_eq!(bits(belief.as_slice()), bits(filter_of_other.belief().as_slice()));
            let (Ok(certificate), Ok(of_other)) =
                (pruned.step(y), pruned_of_other.step_with(&0, y))
            else {
                // The only state that explains the observation was dropped.
                prop_assert!(pruning.tolerance > 0.0);
                break;
            };
            let (mut distance, mut distance_of_other) = (0.0, 0.0);
            for (i, p) in belief.as_slice().iter().enumerate() {
                let [found, of_other] =
                    [pruned.probability(i), pruned_of_other.probability(i)].map(Option::unwrap);
                distance += 0.5 * (found - p).abs();
                distance_of_other += 0.5 * (of_other - p).abs();
                if pruning.tolerance == 0.0 {
                    prop_assert!((found - of_other).abs() <= 1e-12 * p, "{found} {of_other} {p}");
                }
            }
            prop_assert!(distance <= certificate.bound() + 1e-14, "{distance:e}");
            prop_assert!(distance_of_other <= of_other.bound() + 1e-14, "{distance_of_other:e}");
        }
        Ok(())
    }
}

proptest! {
    #![proptest_config(cases_of(1000))]

    #[test]
    fn batches_are_the_same_with_a_control(case in instances()) {
        case.check_batches(sparse(&case.matrix))?;
        case.check_batches(dense(&case.matrix))?;
        case.check_batches(Own(case.matrix.clone()))?;
    }

    #[test]
    fn trait_objects_do_what_their_operators_do(case in instances()) {
        case.check_trait_object(sparse(&case.matrix))?;
        case.check_trait_object(dense(&case.matrix))?;
        case.check_trait_object(Own(case.matrix.clone()))?;
    }

    #[test]
    fn streams_are_the_same_with_a_control(
        case in instances(),
        tolerance in prop_oneof![Just(0.0), Just(1e-9), Just(1e-3)],
    ) {
        let pruning = Pruning::default().with_tolerance(tolerance);
        case.check_streams(sparse(&case.matrix), pruning)?;
        case.check_streams(Own(case.matrix.clone()), pruning)?;
    }
}

/// State 1 loses a tenth.
fn leaky() -> Own {
    Own(vec![vec![1.0, 0.0], vec![0.0, 0.9]])
}

fn anywhere() -> Prior {
    Prior::BeforeFirstTransition(Belief::uniform(2).unwrap())
}

#[test]
fn a_bad_operator_is_refused_by_the_model() {
    let refused = "the transition operator is not valid: column 1 (the transitions out of state 1) sums to 0.9, expected 1";
    let sensor = || LikelihoodVector::linear(2);
    says(Hmm::new(anywhere(), Box::new(leaky()), sensor()), refused);
    says(Hmm::new(anywhere(), &leaky(), sensor()), refused);
    says(Hmm::new(anywhere(), Box::new(leaky()) as Chosen, sensor()), refused);
}

#[test]
fn a_bad_operator_with_a_control_is_an_error_of_the_first_step() {
    let hmm = Hmm::new(anywhere(), Driven(leaky()), LikelihoodVector::linear(2)).unwrap();
    let found = |error: HmmError| match error {
        HmmError::PredictedSum { step: 1, sum } => assert!((sum - 0.95).abs() < 1e-15),
        error => panic!("{error}"),
    };
    let ys = vec![[0.5, 0.5]; 3000];
    let driven = Controlled::new(&[0; 3000], &ys).unwrap();
    found(hmm.forward(&driven).unwrap_err());
    found(hmm.smooth(&driven).unwrap_err());
    found(hmm.log_likelihood(&driven).unwrap_err());

    let mut filter = hmm.filter();
    found(filter.step_with(&0, &ys[0]).unwrap_err());
    found(filter.predict_with(&0).unwrap_err());
    assert_eq!(filter.belief().as_slice(), [0.5, 0.5]);
    found(hmm.fixed_lag(1).step_with(&0, &ys[0]).unwrap_err());
    let mut pruned = hmm.pruned_filter(Pruning::default());
    found(pruned.step_with(&0, &ys[0]).unwrap_err());
    assert_eq!(pruned.probabilities(), [0.5, 0.5]);
}

/// Steps with evidence may have any sum, so a wrong column would not be found later.
#[test]
fn families_and_evidence_check_their_operators() {
    let refused = |error| match error {
        TransitionError::ColumnSum { .. } => {}
        error => panic!("{error}"),
    };
    refused(SwitchedTransition::new(vec![leaky()]).unwrap_err());
    let log = |_: &f64, _, _| -1.0;
    refused(EvidenceTransition::new(leaky(), log).err().unwrap());
}
