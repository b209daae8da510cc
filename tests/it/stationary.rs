//! Stationary priors: the distribution, models with it, and learning where it follows from A.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::inference::{LabelledSequence, LearnError, LearningOptions};
use wayfix::transition::{
    ConstrainedTransition, DwellTransition, EvidenceTransition, LearnTransition, MoveCounts,
    RestartTransition, SwitchedTransition,
};
use wayfix::{
    Belief, DenseTransition, Fixed, Hmm, HmmError, Prior, SparseTransition, TableLikelihood,
    TransitionEntries, TransitionError,
};

use crate::kit::{
    Matrix, any_stochastic, cases, cases_of, close, dense, matrix, normalized, rng, says, sparse,
};

fn stationary<A: TransitionEntries>(a: &A) -> Vec<f64> {
    Prior::stationary(a).unwrap().belief().as_slice().to_vec()
}

/// True at `[i][j]` if j leads to i in any number of steps.
fn reaches(m: &Matrix) -> Vec<Vec<bool>> {
    let n = m.len();
    let mut reach: Vec<Vec<bool>> =
        (0..n).map(|i| (0..n).map(|j| i == j || m[i][j] > 0.0).collect()).collect();
    for k in 0..n {
        for i in 0..n {
            for j in 0..n {
                reach[i][j] |= reach[i][k] && reach[k][j];
            }
        }
    }
    reach
}

proptest! {
    #![proptest_config(cases())]

    /// A π = π, 0 outside the closed class; several of these are an error that names states of two.
    #[test]
    fn the_distribution_is_that_of_the_only_closed_class(m in any_stochastic(false, 7)) {
        let n = m.len();
        let reach = reaches(&m);
        let is_recurrent = |j: &usize| (0..n).all(|i| !reach[i][*j] || reach[*j][i]);
        let recurrent: Vec<usize> = (0..n).filter(is_recurrent).collect();
        let found = Prior::stationary(&sparse(&m));
        if recurrent.iter().any(|i| !reach[*i][recurrent[0]]) {
            let Err(TransitionError::ClosedClasses { first, second }) = found else {
                return Err(TestCaseError::fail(format!("{found:?}")));
            };
            prop_assert!(!reach[first][second] && !reach[second][first]);
            return Ok(());
        }
        let p = found.unwrap().belief().as_slice().to_vec();
        close(p.iter().sum(), 1.0, 1e-15, 1.0)?;
        for i in 0..n {
            prop_assert_eq!(p[i] > 0.0, is_recurrent(&i));
            close((0..n).map(|j| m[i][j] * p[j]).sum(), p[i], 1e-13, 1e-300)?;
        }
        prop_assert_eq!(stationary(&dense(&m)), p.clone());
        prop_assert!(Hmm::new(Prior::Stationary(Belief::new(p).unwrap()), dense(&m), table(n)).is_ok());
    }

    /// Birth and death: π is a product of ratios, however small the probabilities.
    #[test]
    fn small_probabilities_have_small_relative_errors(logs in vec((-60.0..0.0, -60.0..0.0), 1..8)) {
        let n = logs.len() + 1;
        let rates: Vec<(f64, f64)> =
            logs.iter().map(|(up, down)| (0.4 * f64::exp(*up), 0.4 * f64::exp(*down))).collect();
        let mut entries = Vec::new();
        let mut weights = vec![1.0];
        for j in 0..n {
            let up = rates.get(j).map_or(0.0, |rate| rate.0);
            let down = if j > 0 { rates[j - 1].1 } else { 0.0 };
            entries.push((j, j, 1.0 - up - down));
            if j + 1 < n {
                entries.extend([(j + 1, j, up), (j, j + 1, rates[j].1)]);
                weights.push(weights[j] * up / rates[j].1);
            }
        }
        let sum: f64 = weights.iter().sum();
        let p = stationary(&SparseTransition::from_triplets(n, entries).unwrap());
        for (found, weight) in p.iter().zip(weights) {
            close(*found, weight / sum, 1e-13, 0.0)?;
        }
    }

    /// All routines give the same as with these numbers at the first observation.
    #[test]
    fn inference_is_that_at_the_first_observation(case in instances(true)) {
        let hmm = case.hmm(dense(&case.matrix));
        let (prior, a, b) = hmm.clone().into_parts();
        let other = Hmm::new(Prior::AtFirstObservation(prior.belief().clone()), a, b).unwrap();
        for ys in &case.sequences {
            prop_assert_eq!(hmm.log_likelihood(ys).unwrap(), other.log_likelihood(ys).unwrap());
            let (smoothed, same) = (hmm.smooth(ys).unwrap(), other.smooth(ys).unwrap());
            prop_assert_eq!(smoothed.posteriors(), same.posteriors());
            let (best, same) = (hmm.viterbi(ys).unwrap(), other.viterbi(ys).unwrap());
            prop_assert_eq!(best.states(), same.states());
            let (mut filter, mut same) = (hmm.filter(), other.filter());
            for y in ys {
                filter.step(y).unwrap();
                same.step(y).unwrap();
            }
            prop_assert_eq!(filter.snapshot(), same.snapshot());
        }
    }

    /// The M-step ends where the derivative of Q by each probability vanishes.
    #[test]
    fn the_m_step_is_a_maximum(case in instances(false)) {
        let options = LearningOptions::default().with_transition_pseudo_count(0.5);
        let hmm = case.hmm(dense(&case.matrix));
        let (expected, _) = hmm.expectations(&case.sequences);
        let next = hmm.maximize(&expected, &options).unwrap();
        let objective = |m: &Matrix| {
            let starts = stationary(&dense(m));
            expected_log(expected.moves(), expected.first(), m, &starts)
        };
        is_a_maximum(&next.transition().to_rows(), objective)?;

        // Counts of the moves within the closed class.
        let hmm = case.hmm(case.restarts(&case.matrix));
        let (expected, _) = hmm.expectations(&case.sequences);
        let next = hmm.maximize(&expected, &options).unwrap();
        let objective = |m: &Matrix| {
            let starts = stationary(&case.restarts(m));
            expected_log(expected.moves(), expected.first(), m, &starts)
        };
        let found = next.transition().inner();
        let found = matrix(case.matrix.len(), |i, j| SparseTransition::get(found, i, j));
        is_a_maximum(&found, objective)?;
    }
}

proptest! {
    #![proptest_config(cases_of(200))]

    /// The objective never falls, and the prior follows the operator.
    #[test]
    fn learning_never_falls(case in instances(false), count in prop_oneof![Just(0.0), 0.1..2.0]) {
        let options = LearningOptions::default().with_iterations(6).with_tolerance(0.0).with_transition_pseudo_count(count).with_prior_pseudo_count(count / 2.0);
        case.learn(sparse(&case.matrix), &options)?;
        case.learn(dense(&case.matrix), &options)?;
        case.learn(case.restarts(&case.matrix), &options)?;
        let tied = ConstrainedTransition::new(sparse(&case.matrix))
            .with_fixed(|from, to| (from, to) == (0, 1))
            .with_ties(|from, to| usize::from(from == to));
        case.learn(tied, &options)?;
    }

    /// Learning ends where the derivative of the objective vanishes.
    #[test]
    fn learning_ends_at_a_maximum(case in instances(false)) {
        let options = LearningOptions::default().with_iterations(2000).with_tolerance(1e-11).with_transition_pseudo_count(0.5);
        let (prior, a, sensor) = case.hmm(dense(&case.matrix)).into_parts();
        let sensor = Fixed(sensor);
        let start = Hmm::new(prior, a, sensor.clone()).unwrap();
        let learned = start.learn(&case.sequences, &options).unwrap();
        prop_assert!(learned.converged());
        let objective = |m: &Matrix| {
            let hmm = Hmm::new(Prior::stationary(&dense(m)).unwrap(), dense(m), sensor.clone()).unwrap();
            let logs: f64 = case.sequences.iter().map(|ys| hmm.log_likelihood(ys).unwrap()).sum();
            logs + log_prior(m)
        };
        let found = learned.model().transition().to_rows();
        close(objective(&found), learned.objective(), 1e-12, 1.0)?;
        is_a_maximum(&found, objective)?;
    }
}

/// The log-density of pseudo-counts of one half.
fn log_prior(m: &Matrix) -> f64 {
    0.5 * m.iter().flatten().filter(|p| **p > 0.0).map(|p| p.ln()).sum::<f64>()
}

/// Q, with pseudo-counts of one half.
fn expected_log(moves: &MoveCounts, first: &[f64], m: &Matrix, starts: &[f64]) -> f64 {
    let first: f64 = first.iter().zip(starts).map(|(n, p)| n * p.ln()).sum();
    let moves: f64 = moves.moves().map(|n| n.weight * m[n.to][n.from].ln()).sum();
    first + moves + log_prior(m)
}

/// Checks that the derivative vanishes in each direction that moves a column towards an entry.
fn is_a_maximum(m: &Matrix, objective: impl Fn(&Matrix) -> f64) -> Result<(), TestCaseError> {
    let n = m.len();
    for from in 0..n {
        let least = m.iter().map(|row| row[from]).filter(|p| *p > 0.0).fold(1.0, f64::min);
        let step = 1e-4 * least;
        for to in (0..n).filter(|to| m[*to][from] > 0.0) {
            let moved = |step: f64| {
                let towards = |i: usize| m[i][from] + step * (f64::from(i == to) - m[i][from]);
                matrix(n, |i, j| if j == from { towards(i) } else { m[i][j] })
            };
            let slope = (objective(&moved(step)) - objective(&moved(-step))) / (2.0 * step);
            let slope = m[to][from] * slope;
            prop_assert!(slope.abs() < 1e-4, "{} to {}: {}", from, to, slope);
        }
    }
    Ok(())
}

fn table(states: usize) -> TableLikelihood {
    TableLikelihood::from_rows(&vec![[0.5, 0.5]; states]).unwrap()
}

/// An irreducible chain, a table and several sequences.
#[derive(Debug, Clone)]
struct Case {
    matrix: Matrix,
    rows: Vec<Vec<f64>>,
    sequences: Vec<Vec<usize>>,
    restart: f64,
}

fn instances(with_empty: bool) -> impl Strategy<Value = Case> {
    (2..=4_usize).prop_flat_map(move |n| {
        let weight = prop_oneof![1 => Just(0.0), 4 => 0.05..1.0];
        let matrix = vec(vec(weight, n), n).prop_map(move |mut columns| {
            for (j, column) in columns.iter_mut().enumerate() {
                column[(j + 1) % n] += 0.05;
                *column = normalized(std::mem::take(column), j);
            }
            matrix(n, |i, j| columns[j][i])
        });
        let row = vec(0.05..1.0, 3).prop_map(|row| normalized(row, 0));
        let least = usize::from(!with_empty);
        let sequence = vec(0..3_usize, least..6);
        (matrix, vec(row, n), vec(sequence, 1..5), 0.05..0.9).prop_map(
            |(matrix, rows, sequences, restart)| Case { matrix, rows, sequences, restart },
        )
    })
}

impl Case {
    fn hmm<A: TransitionEntries>(&self, a: A) -> Hmm<A, TableLikelihood> {
        let table = TableLikelihood::from_rows(&self.rows).unwrap();
        Hmm::new(Prior::stationary(&a).unwrap(), a, table).unwrap()
    }

    fn restarts(&self, m: &Matrix) -> RestartTransition<SparseTransition> {
        let to = Belief::uniform(m.len()).unwrap();
        RestartTransition::new(sparse(m), self.restart, to).unwrap()
    }

    fn learn<A>(&self, a: A, options: &LearningOptions) -> Result<(), TestCaseError>
    where
        A: LearnTransition<Control = ()> + Clone + Sync,
    {
        let learned = self.hmm(a).learn(&self.sequences, options).unwrap();
        prop_assert!(learned.cause().is_none(), "{:?}", learned.cause());
        for pair in learned.objectives().windows(2) {
            prop_assert!(pair[1] >= pair[0] - 1e-11 * pair[0].abs().max(1.0), "{:?}", pair);
        }
        let model = learned.model();
        prop_assert!(matches!(model.prior(), Prior::Stationary(_)));
        let expected = stationary(model.transition());
        for (found, expected) in model.prior().belief().as_slice().iter().zip(expected) {
            close(*found, expected, 1e-12, 1e-300)?;
        }
        let logs: f64 = self.sequences.iter().map(|ys| model.log_likelihood(ys).unwrap()).sum();
        close(learned.log_likelihood(), logs, 1e-10, 1.0)
    }
}

/// By hand: π = (b, a) / (a + b), with moves a from 0 to 1 and b back. A path that starts in state
/// 0, and has three moves from 0 to 0, one to 1 and two from 1 to 1, has the likelihood (1 − a)³ a
/// (1 − b)² b / (a + b).
#[test]
fn counting_takes_account_of_the_start() {
    let hmm = Hmm::new(
        Prior::Stationary(Belief::uniform(2).unwrap()),
        DenseTransition::from_rows(&[[0.5, 0.5], [0.5, 0.5]]).unwrap(),
        table(2),
    )
    .unwrap();
    let path = [0, 0, 0, 0, 1, 1, 1];
    let drive = || LabelledSequence { initial: None, states: &path, sequence: &[0; 7][..] };
    let log = |a: f64, b: f64| {
        3.0 * (1.0 - a).ln() + a.ln() + 2.0 * (1.0 - b).ln() + b.ln() - (a + b).ln()
    };
    let learned = hmm.fit(&[drive()], &LearningOptions::default()).unwrap();
    let (a, b) = (learned.transition().get(1, 0), learned.transition().get(0, 1));
    let p = learned.prior().belief().as_slice();
    assert!((p[0] - b / (a + b)).abs() < 1e-15);
    for (a_step, b_step) in [(1e-4, 0.0), (0.0, 1e-4)] {
        let slope = log(a + a_step, b + b_step) - log(a - a_step, b - b_step);
        assert!((slope / 2e-4).abs() < 1e-5, "{a}, {b}: {slope}");
    }
    // Plain counting would give 1/4 and 0.
    assert!(a < 0.25 && b > 0.1, "{a}, {b}");

    // If it is kept, it equals these numbers at the first observation.
    let keep = LearningOptions::default().with_keep_prior(true);
    let learned = hmm.fit(&[drive()], &keep).unwrap();
    assert_eq!(learned.prior(), &Prior::AtFirstObservation(Belief::uniform(2).unwrap()));
    assert_eq!(learned.transition().to_rows(), [[0.75, 0.0], [0.25, 1.0]]);
}

/// Tied entries, against finite differences of the likelihood.
#[test]
fn tied_parameters_end_at_a_maximum() {
    let build = |stay: f64, last: f64| {
        let entries = [
            (0, 0, stay),
            (1, 0, 1.0 - stay),
            (1, 1, stay),
            (2, 1, 1.0 - stay),
            (2, 2, last),
            (0, 2, 1.0 - last),
        ];
        let a = SparseTransition::from_triplets(3, entries).unwrap();
        ConstrainedTransition::new(a)
            .with_ties(|from, to| if from == 2 { 2 + to } else { to - from })
    };
    let sensor = Fixed(
        TableLikelihood::from_rows(&[[0.7, 0.2, 0.1], [0.2, 0.7, 0.1], [0.1, 0.2, 0.7]]).unwrap(),
    );
    let hmm = |stay, last| {
        let a = build(stay, last);
        Hmm::new(Prior::stationary(&a).unwrap(), a, sensor.clone()).unwrap()
    };
    let seen = [vec![0, 1, 2], vec![0], vec![0, 0, 1, 1], vec![2, 2, 0], vec![1, 0]];
    let options = LearningOptions::default().with_iterations(2000).with_tolerance(1e-13);
    let learned = hmm(0.5, 0.5).learn(&seen, &options).unwrap();
    let a = learned.model().transition().inner();
    let (stay, last) = (a.get(0, 0), a.get(2, 2));
    assert_eq!(a.get(1, 1), stay);
    let log = |stay: f64, last: f64| -> f64 {
        let hmm = hmm(stay, last);
        seen.iter().map(|ys| hmm.log_likelihood(ys).unwrap()).sum()
    };
    assert!(stay > 0.01 && stay < 0.99 && last > 0.01 && last < 0.99, "{stay}, {last}");
    for (x, y) in [(1e-4, 0.0), (0.0, 1e-4)] {
        let slope = (log(stay + x, last + y) - log(stay - x, last - y)) / 2e-4;
        assert!(slope.abs() < 1e-4, "{slope}");
    }
    assert_eq!(learned.free_parameters(), 2);
}

#[test]
fn a_prior_that_a_transition_changes_is_refused() {
    let a = || DenseTransition::from_rows(&[[0.75, 0.5], [0.25, 0.5]]).unwrap();
    let error = Hmm::new(Prior::Stationary(Belief::uniform(2).unwrap()), a(), table(2));
    says(
        error,
        "the prior is not stationary: state 0 has probability 0.5, and 0.625 after a transition",
    );
    let short = Prior::Stationary(Belief::uniform(3).unwrap());
    assert!(matches!(Hmm::new(short, a(), table(2)), Err(HmmError::StateCount { .. })));
}

#[test]
fn operators_without_one_stationary_distribution_are_refused() {
    let still = sparse(&matrix(3, |i, j| f64::from(i == j)));
    says(
        Prior::stationary(&still),
        "there is no unique stationary distribution: from state 0 and from state 2, the transition operator leads to different closed classes",
    );
    // Each distribution of it is stationary.
    let given = Prior::Stationary(Belief::new(vec![0.2, 0.3, 0.5]).unwrap());
    let hmm = Hmm::new(given, still.clone(), table(3)).unwrap();
    let error = hmm.learn(&[[0, 1]], &LearningOptions::default()).unwrap_err();
    assert!(matches!(
        error,
        LearnError::Transition(TransitionError::ClosedClasses { first: 0, second: 2 })
    ));

    let switched = SwitchedTransition::new(vec![still.clone()]).unwrap();
    let expected = "there is no unique stationary distribution: the operator has a control";
    says(Prior::stationary(&switched), expected);
    let given = || Prior::Stationary(Belief::uniform(3).unwrap());
    let error = Hmm::new(given(), switched, table(3));
    says(error, &format!("the prior cannot be stationary: {expected}"));
    let measured = EvidenceTransition::new(still, |(): &(), _, _| 0.0).unwrap();
    assert!(matches!(
        Hmm::new(given(), measured, table(3)),
        Err(HmmError::Stationary(TransitionError::Stationary(_)))
    ));
}

/// Operators that do not give the probabilities of their moves are refused rather than learned
/// wrongly.
#[test]
fn operators_that_cannot_learn_it_say_so() {
    let moves = SparseTransition::from_rows(&[[0.0, 1.0], [1.0, 0.0]]).unwrap();
    let dwell = DwellTransition::new(moves, &[vec![0.5, 0.5], vec![1.0]]).unwrap();
    let hmm = Hmm::new(Prior::stationary(&dwell).unwrap(), dwell, table(3)).unwrap();
    let p = hmm.prior().belief().as_slice();
    assert!((p[0] - 0.4).abs() < 1e-15 && (p[1] - 0.2).abs() < 1e-15, "{p:?}");
    let error = hmm.learn(&[[0, 1, 1]], &LearningOptions::default()).unwrap_err();
    assert!(matches!(error, LearnError::Stationary), "{error}");
    let keep = LearningOptions::default().with_keep_prior(true);
    assert!(hmm.learn(&[[0, 1, 1]], &keep).is_ok());
    // A fixed operator need not give them.
    let (prior, dwell, table) = hmm.into_parts();
    let hmm = Hmm::new(prior, Fixed(dwell), table).unwrap();
    let learned = hmm.learn(&[[0, 1, 1]], &LearningOptions::default()).unwrap();
    assert!(matches!(learned.model().prior(), Prior::Stationary(_)));
}

/// Restarts and criteria.
#[test]
fn learning_in_other_ways_takes_it() {
    let start = |stay: f64| {
        let a = DenseTransition::from_rows(&[[stay, 0.3], [1.0 - stay, 0.7]]).unwrap();
        let sensor = TableLikelihood::from_rows(&[[0.8, 0.2], [0.3, 0.7]]).unwrap();
        Hmm::new(Prior::stationary(&a).unwrap(), a, sensor).unwrap()
    };
    let mut noise = rng(4);
    let truth = start(0.9);
    let seen: Vec<Vec<usize>> =
        (0..12).map(|_| truth.simulate(30, &mut noise).observations().to_vec()).collect();
    let options = LearningOptions::default().with_tolerance(1e-7).with_iterations(500);
    let best = Hmm::learn_best(&[start(0.6), start(0.9)], &seen, &options, |_, _| ()).unwrap();
    assert_eq!(best.criteria().parameters, 2 + 2);
    assert_eq!(best.model().free_parameters(), 2 + 2);
    let p = best.model().prior().belief().as_slice().to_vec();
    assert_eq!(p, stationary(best.model().transition()));

    let order = best.model().reordered(&[1, 0]).unwrap();
    assert_eq!(order.prior(), &Prior::Stationary(Belief::new(vec![p[1], p[0]]).unwrap()));
}

/// A loop of places: elimination has little fill-in, and the distribution is known.
#[test]
fn a_long_road_has_its_distribution() {
    let n = 20_000;
    let stay = |j: usize| 0.1 + 0.8 * (j % 7) as f64 / 7.0;
    let entries = (0..n).flat_map(|j| [(j, j, stay(j)), ((j + 1) % n, j, 1.0 - stay(j))]);
    let p = stationary(&SparseTransition::from_triplets(n, entries).unwrap());
    // The flow through each place is the same.
    let flow = p[0] * (1.0 - stay(0));
    assert!((0..n).all(|j| (p[j] * (1.0 - stay(j)) / flow - 1.0).abs() < 1e-11));
}

/// A file stores that the prior is stationary, and this is checked when it is read.
#[cfg(feature = "serde")]
#[test]
fn files_keep_it() {
    let a = DenseTransition::from_rows(&[[0.75, 0.5], [0.25, 0.5]]).unwrap();
    let hmm = Hmm::new(Prior::stationary(&a).unwrap(), a, table(2)).unwrap();
    let text = serde_json::to_string(&hmm).unwrap();
    assert!(text.contains(r#""prior":{"stationary":[0.66"#), "{text}");
    let read: Hmm<DenseTransition, TableLikelihood> = serde_json::from_str(&text).unwrap();
    assert_eq!(read.prior(), hmm.prior());
    let start = text.find('[').unwrap();
    let end = text.find(']').unwrap();
    let wrong = format!("{}0.5,0.5{}", &text[..=start], &text[end..]);
    let error = serde_json::from_str::<Hmm<DenseTransition, TableLikelihood>>(&wrong).unwrap_err();
    assert!(error.to_string().contains("the prior is not stationary"), "{error}");
}
