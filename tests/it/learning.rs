//! Learning against expectations by enumeration.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::inference::{LabelledSequence, LearnError, LearnedModel, LearningOptions, Simulation};
use wayfix::likelihood::{GroupedLikelihood, Groups, LearnLikelihood, SparseObservation};
use wayfix::transition::{
    ConstrainedTransition, EvidenceTransition, LearnTransition, SwitchedTransition,
};
use wayfix::{
    Belief, Controlled, DenseTransition, Fixed, FusedLikelihood, Hmm, OptionalLikelihood, Prior,
    SparseLikelihood, SparseTransition, TableLikelihood, canberra,
};

use crate::kit::{Kind, Model, cases, close, measured_models, models, rng};

type Sensor = OptionalLikelihood<TableLikelihood>;

/// A model with a table, several sequences for it, and pseudo-counts.
#[derive(Debug, Clone)]
struct Case {
    /// States, prior, and the matrices that controls choose from.
    model: Model,
    table: Vec<Vec<f64>>,
    /// For each sequence its controls and symbols.
    sequences: Vec<(Vec<usize>, Vec<Option<usize>>)>,
    pseudo_counts: [f64; 3],
}

fn instances(kind: Kind) -> impl Strategy<Value = Case> {
    instances_of(models(kind))
}

fn instances_of(models: impl Strategy<Value = Model>) -> impl Strategy<Value = Case> {
    let model = models.prop_filter("matrices", |model| !model.matrices.is_empty());
    model.prop_flat_map(|model| {
        let (n, operators) = (model.states, model.matrices.len());
        let row = vec(prop_oneof![1 => Just(0.0), 4 => 0.05..1.0], 3).prop_map(|mut row| {
            row[0] += 1e-3;
            let sum: f64 = row.iter().sum();
            row.iter().map(|p| p / sum).collect::<Vec<f64>>()
        });
        let step = (0..operators, prop_oneof![1 => Just(None), 6 => (0..3_usize).prop_map(Some)]);
        let sequence = vec(step, 0..=4).prop_map(|steps| steps.into_iter().unzip());
        let pseudo = || prop_oneof![Just(0.0), 0.1..3.0];
        (vec(row, n), vec(sequence, 1..=4), [pseudo(), pseudo(), pseudo()]).prop_map(
            move |(table, sequences, pseudo_counts)| Case {
                model: model.clone(),
                table,
                sequences,
                pseudo_counts,
            },
        )
    })
}

/// Expected counts, by enumeration.
struct Counts {
    first: Vec<f64>,
    /// By operator, `to` and `from`.
    moves: Vec<Vec<Vec<f64>>>,
    symbols: Vec<Vec<f64>>,
    log_likelihood: f64,
    left_out: Vec<usize>,
}

impl Case {
    fn learning(&self, iterations: usize) -> LearningOptions {
        let [prior_pseudo_count, transition_pseudo_count, likelihood_pseudo_count] =
            self.pseudo_counts;
        LearningOptions::default()
            .with_iterations(iterations)
            .with_tolerance(0.0)
            .with_keep_prior(false)
            .with_prior_pseudo_count(prior_pseudo_count)
            .with_transition_pseudo_count(transition_pseudo_count)
            .with_likelihood_pseudo_count(likelihood_pseudo_count)
    }

    fn hmm<A: LearnTransition<Control = usize>>(&self, transition: A) -> Hmm<A, Sensor> {
        let table = TableLikelihood::from_rows(&self.table).unwrap();
        Hmm::new(self.model.prior(), transition, OptionalLikelihood::new(table)).unwrap()
    }

    fn drives(&self) -> Vec<Controlled<'_, usize, Option<usize>>> {
        self.sequences.iter().map(|(us, ys)| Controlled::new(us, ys).unwrap()).collect()
    }

    /// One sequence as a model whose steps have these matrices and diagonals.
    fn unrolled(&self, sequence: usize) -> Model {
        let (us, ys) = &self.sequences[sequence];
        let column = |y: usize| self.table.iter().map(|row| row[y].ln()).collect();
        Model {
            matrices: us.iter().map(|u| self.model.matrices[*u].clone()).collect(),
            evidence: us.iter().filter_map(|u| self.model.evidence.get(*u)).cloned().collect(),
            logs: ys.iter().map(|y| y.map(column)).collect(),
            ..self.model.clone()
        }
    }

    fn count(&self) -> Counts {
        let (n, operators) = (self.model.states, self.model.matrices.len());
        let mut counts = Counts {
            first: vec![0.0; n],
            moves: vec![vec![vec![0.0; n]; n]; operators],
            symbols: vec![vec![0.0; 3]; n],
            log_likelihood: 0.0,
            left_out: Vec::new(),
        };
        for (index, (us, ys)) in self.sequences.iter().enumerate() {
            if us.is_empty() {
                continue; // an impossible sequence adds no counts
            }
            let model = self.unrolled(index);
            let answer = model.enumerate();
            if answer.impossible_at.is_some() {
                counts.left_out.push(index);
                continue;
            }
            counts.log_likelihood += answer.log_likelihood;
            for (path, log) in model.posterior_paths() {
                let p = log.exp();
                counts.first[path[0]] += p;
                for k in 1..path.len() {
                    if k > 1 || !model.at_first {
                        counts.moves[us[k - 1]][path[k]][path[k - 1]] += p;
                    }
                    if let Some(y) = ys[k - 1] {
                        counts.symbols[path[k]][y] += p;
                    }
                }
            }
        }
        counts
    }
}

/// Normalises weights, with a pseudo-count for allowed entries.
fn share(old: &[f64], seen: &[f64], pseudo_count: f64) -> Vec<f64> {
    let weights: Vec<f64> = old
        .iter()
        .zip(seen)
        .map(|(old, seen)| if *old > 0.0 { seen + pseudo_count } else { 0.0 })
        .collect();
    let sum: f64 = weights.iter().sum();
    if sum == 0.0 { old.to_vec() } else { weights.iter().map(|w| w / sum).collect() }
}

fn learn<A: LearnTransition<Control = usize> + Clone + Sync>(
    case: &Case,
    transition: A,
    iterations: usize,
) -> Option<LearnedModel<A, Sensor>> {
    let result = case.hmm(transition).learn(&case.drives(), &case.learning(iterations));
    let left_out = case.count().left_out;
    let seen = |index: usize| !left_out.contains(&index) && !case.sequences[index].1.is_empty();
    if !(0..case.sequences.len()).any(seen) {
        let first = match result.err() {
            Some(LearnError::Nothing { .. }) => None,
            Some(LearnError::AllFailed(error)) => Some(error.cause.sequence),
            other => panic!("{other:?}"),
        };
        assert_eq!(first, left_out.first().copied());
        return None;
    }
    Some(result.unwrap())
}

/// The matrix of the operator, by its products with unit vectors.
fn entry<A: LearnTransition<Control = usize>>(a: &A, u: usize, to: usize, from: usize) -> f64 {
    let (mut x, mut out) = (vec![0.0; a.states()], vec![0.0; a.states()]);
    x[from] = 1.0;
    a.apply(&u, &x, &mut out);
    out[to]
}

fn check_one_step<A: LearnTransition<Control = usize> + Clone + Sync>(
    case: &Case,
    transition: A,
    entry: impl Fn(&A, usize, usize, usize) -> f64,
) -> Result<(), TestCaseError> {
    let counts = case.count();
    let Some(learned) = learn(case, transition, 1) else { return Ok(()) };
    let left_out: Vec<usize> = learned.left_out().iter().map(|error| error.sequence).collect();
    prop_assert_eq!(left_out, counts.left_out);
    prop_assert_eq!(learned.iterations(), 1);
    let n = case.model.states;
    let prior = share(&case.model.prior, &counts.first, case.pseudo_counts[0]);
    for (found, expected) in learned.model().prior().belief().as_slice().iter().zip(prior) {
        close(*found, expected, 1e-10, 1e-200)?;
    }
    for (u, matrix) in case.model.matrices.iter().enumerate() {
        for from in 0..n {
            let column = |m: &Vec<Vec<f64>>| m.iter().map(|row| row[from]).collect::<Vec<f64>>();
            let expected = share(&column(matrix), &column(&counts.moves[u]), case.pseudo_counts[1]);
            // Digits of a count of less than 2.2e-308 are lost, also as a share of few.
            let seen: f64 = column(&counts.moves[u]).iter().sum::<f64>() + case.pseudo_counts[1];
            let floor = f64::max(1e-200, 1e-290 / seen);
            for (to, expected) in expected.into_iter().enumerate() {
                close(entry(learned.model().transition(), u, to, from), expected, 1e-10, floor)?;
            }
        }
    }
    // The sensor's parameters show in its likelihoods.
    let mut objective = counts.log_likelihood;
    let log_prior = |values: &mut dyn Iterator<Item = f64>, pseudo_count: f64| {
        let sum: f64 = values.filter(|p| *p > 0.0).map(f64::ln).sum();
        if pseudo_count == 0.0 { 0.0 } else { pseudo_count * sum }
    };
    let matrices = case.model.matrices.iter().flatten().flatten().copied();
    objective += log_prior(&mut case.model.prior.iter().copied(), case.pseudo_counts[0]);
    objective += log_prior(&mut { matrices }, case.pseudo_counts[1]);
    objective += log_prior(&mut case.table.iter().flatten().copied(), case.pseudo_counts[2]);
    close(learned.objectives()[0], objective, 1e-10, 1e-2)?;

    // A state may be so rare that doubles hold none of its counts: its row stays as it was.
    let seen = |symbols: &Vec<f64>| symbols.iter().sum::<f64>();
    if counts.symbols.iter().map(seen).any(|seen| 0.0 < seen && seen < 1e-290) {
        return Ok(());
    }
    let rows: Vec<Vec<f64>> =
        (0..n).map(|i| share(&case.table[i], &counts.symbols[i], case.pseudo_counts[2])).collect();
    let table = TableLikelihood::from_rows(&rows).unwrap();
    let expected = Hmm::new(
        learned.model().prior().clone(),
        learned.model().transition(),
        OptionalLikelihood::new(table),
    );
    let expected = expected.unwrap();
    for symbol in 0..3 {
        let drive = ([0], [Some(symbol)]);
        let drive = Controlled::new(&drive.0, &drive.1).unwrap();
        match (learned.model().log_likelihood(&drive), expected.log_likelihood(&drive)) {
            (Ok(found), Ok(expected)) => close(found, expected, 1e-10, 1e-2)?,
            (found, expected) => prop_assert!(found.is_err() && expected.is_err()),
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn one_step_of_baum_welch_equals_enumeration(case in instances(Kind::Plain)) {
        check_one_step(&case, case.model.sparse(), entry)?;
    }

    /// With transitions of 1e-300.
    #[test]
    fn one_step_on_extremes_equals_enumeration(case in instances(Kind::Extreme)) {
        check_one_step(&case, case.model.sparse(), entry)?;
    }

    #[test]
    fn one_step_on_dense_operators_equals_enumeration(case in instances(Kind::Plain)) {
        check_one_step(&case, case.model.dense(), entry)?;
    }

    /// Evidence on moves is not learned.
    #[test]
    fn one_step_with_evidence_on_moves_equals_enumeration(case in instances_of(measured_models(Kind::Plain, false))) {
        let base = |a: &SwitchedTransition<EvidenceTransition<_, _, _, _>>, u: usize, to, from| {
            SparseTransition::get(a.operators()[u].base(), to, from)
        };
        check_one_step(&case, case.model.measured(), base)?;
    }

    /// The objective never falls, and zeros stay.
    #[test]
    fn learning_climbs_and_keeps_the_structure(case in instances(Kind::Plain)) {
        let Some(learned) = learn(&case, case.model.sparse(), 25) else { return Ok(()) };
        for pair in learned.objectives().windows(2) {
            prop_assert!(pair[1] >= pair[0] - 1e-9 * pair[0].abs().max(1.0));
        }
        for (u, matrix) in case.model.matrices.iter().enumerate() {
            for (to, row) in matrix.iter().enumerate() {
                for (from, p) in row.iter().enumerate() {
                    if *p == 0.0 {
                        prop_assert_eq!(entry(learned.model().transition(), u, to, from), 0.0);
                    }
                }
            }
        }
        let again: f64 = case.drives().iter().enumerate()
            .filter(|(index, _)| learned.left_out().iter().all(|error| error.sequence != *index))
            .map(|(_, drive)| learned.model().log_likelihood(drive).unwrap()).sum();
        close(learned.log_likelihood(), again, 1e-10, 1e-2)?;
    }

    /// Moves with the same label, out of states with the same labels, are one parameter: one step
    /// against the counts by enumeration.
    #[test]
    fn tied_parameters_equal_enumeration(case in instances(Kind::Plain), labels in vec(0..3_usize, 25)) {
        let n = case.model.states;
        let label = |from: usize, to: usize| labels[from * 5 + to];
        let single = |m: &Vec<Vec<f64>>| {
            let entries = (0..n * n).map(|at| (at / n, at % n, m[at / n][at % n]));
            ConstrainedTransition::new(SparseTransition::from_triplets(n, entries).unwrap()).with_ties(label)
        };
        let tied: Vec<ConstrainedTransition> = case.model.matrices.iter().map(single).collect();
        // Enumerate with the tied matrices.
        let mut tied_case = case.clone();
        for (matrix, tied) in tied_case.model.matrices.iter_mut().zip(&tied) {
            for (to, row) in matrix.iter_mut().enumerate() {
                row.iter_mut().enumerate().for_each(|(from, p)| *p = tied.inner().get(to, from));
            }
        }
        let counts = tied_case.count();
        let operator = SwitchedTransition::new(tied).unwrap();
        let Some(learned) = learn(&tied_case, operator, 1) else { return Ok(()) };
        for (u, matrix) in tied_case.model.matrices.iter().enumerate() {
            let ways = |from: usize| (0..n).filter(move |to| matrix[*to][from] > 0.0);
            let kind = |from: usize| {
                let mut kind: Vec<usize> = ways(from).map(|to| label(from, to)).collect();
                kind.sort_unstable();
                kind
            };
            #[expect(clippy::needless_range_loop, reason = "it is a column")]
            for from in 0..n {
                let alike: Vec<usize> = (0..n).filter(|j| kind(*j) == kind(from)).collect();
                let seen = |l: usize| -> f64 {
                    let moves = |&j: &usize| -> f64 {
                        ways(j).filter(|to| label(j, *to) == l).map(|to| counts.moves[u][to][j]).sum()
                    };
                    alike.iter().map(moves).sum::<f64>() + case.pseudo_counts[1]
                };
                let mut distinct = kind(from);
                distinct.dedup();
                let total: f64 = distinct.iter().map(|l| seen(*l)).sum();
                for to in ways(from) {
                    let times = kind(from).iter().filter(|l| **l == label(from, to)).count();
                    let expected = if total == 0.0 {
                        matrix[to][from]
                    } else {
                        seen(label(from, to)) / total / times as f64
                    };
                    close(entry(learned.model().transition(), u, to, from), expected, 1e-10, 1e-200)?;
                }
            }
        }
        let more = learn(&tied_case, learned.model().transition().clone(), 10).unwrap();
        prop_assert!(more.objectives().windows(2).all(|pair| pair[1] >= pair[0] - 1e-9 * pair[0].abs().max(1.0)));
    }
}

proptest! {
    /// Fixed entries stay, the others share the rest by their counts and pseudo-counts, with ties
    /// or without.
    #[test]
    fn fixed_entries_and_their_pseudo_counts_equal_enumeration(
        case in instances(Kind::Plain), fixed in vec(any::<bool>(), 25),
        sticky in 0.0..3.0_f64, is_tied: bool,
    ) {
        let (n, fixed) = (case.model.states, &fixed);
        let (is_fixed, label) = (|from: usize, to: usize| fixed[from * 5 + to], |from: usize, to: usize| {
            if is_tied { usize::from(from == to) } else { from * 5 + to }
        });
        let prior = |from: usize, to: usize| if from == to { sticky } else { 0.0 };
        let single = |m: &Vec<Vec<f64>>| {
            let entries = (0..n * n).map(|at| (at / n, at % n, m[at / n][at % n]));
            ConstrainedTransition::new(SparseTransition::from_triplets(n, entries).unwrap())
                .with_fixed(is_fixed)
                .with_ties(label)
                .with_pseudo_counts(prior)
                .unwrap()
        };
        let constrained: Vec<ConstrainedTransition> = case.model.matrices.iter().map(single).collect();
        let mut case = case;
        for (matrix, a) in case.model.matrices.iter_mut().zip(&constrained) {
            for (to, row) in matrix.iter_mut().enumerate() {
                row.iter_mut().enumerate().for_each(|(from, p)| {
                    if is_fixed(from, to) {
                        assert_eq!(*p, a.inner().get(to, from));
                    }
                    *p = a.inner().get(to, from);
                });
            }
        }
        let counts = case.count();
        let operator = SwitchedTransition::new(constrained).unwrap();
        let Some(learned) = learn(&case, operator, 1) else { return Ok(()) };
        for (u, matrix) in case.model.matrices.iter().enumerate() {
            let free = |from: usize| (0..n).filter(move |&to| matrix[to][from] > 0.0 && !fixed[from * 5 + to]);
            let kind = |from: usize| {
                let mut kind: Vec<usize> = free(from).map(|to| label(from, to)).collect();
                kind.sort_unstable();
                kind
            };
            for from in 0..n {
                let alike: Vec<usize> = (0..n).filter(|j| kind(*j) == kind(from)).collect();
                let seen = |l: usize| -> f64 {
                    let moves = |&j: &usize| -> f64 {
                        let ways = free(j).filter(|to| label(j, *to) == l);
                        ways.map(|to| counts.moves[u][to][j] + prior(j, to)).sum()
                    };
                    alike.iter().map(moves).sum::<f64>() + case.pseudo_counts[1]
                };
                let mut distinct = kind(from);
                distinct.dedup();
                let total: f64 = distinct.iter().map(|l| seen(*l)).sum();
                let rest: f64 = free(from).map(|to| matrix[to][from]).sum();
                for to in 0..n {
                    let expected = if fixed[from * 5 + to] || matrix[to][from] == 0.0 || total == 0.0 {
                        matrix[to][from]
                    } else {
                        let times = kind(from).iter().filter(|l| **l == label(from, to)).count();
                        rest * seen(label(from, to)) / total / times as f64
                    };
                    close(entry(learned.model().transition(), u, to, from), expected, 1e-10, 1e-200)?;
                }
            }
        }
        let more = learn(&case, learned.model().transition().clone(), 10).unwrap();
        prop_assert!(more.objectives().windows(2).all(|pair| pair[1] >= pair[0] - 1e-9 * pair[0].abs().max(1.0)));
    }
}

#[test]
fn pseudo_counts_are_finite_numbers() {
    let a = SparseTransition::from_rows(&[[0.5, 0.5], [0.5, 0.5]]).unwrap();
    for bad in [f64::NAN, -1.0, f64::INFINITY] {
        let counts = |from: usize, to: usize| if (from, to) == (0, 1) { bad } else { 1.0 };
        let error = ConstrainedTransition::new(a.clone()).with_pseudo_counts(counts).unwrap_err();
        assert!(error.to_string().starts_with("the transition from state 0 to state 1 has weight"));
    }
}

#[test]
fn what_learning_drops_is_no_parameter_any_more() {
    let a = SparseTransition::from_rows(&[[0.5, 0.5], [0.5, 0.5]]).unwrap();
    let tied = ConstrainedTransition::new(a).with_ties(|from, to| usize::from(from != to));
    assert_eq!(tied.parameters(), 2);
    let prior = Prior::AtFirstObservation(Belief::new(vec![1.0, 0.0]).unwrap());
    let sensor = TableLikelihood::from_rows(&[[1.0, 0.0], [0.0, 1.0]]).unwrap();
    let hmm = Hmm::new(prior, tied, Fixed(sensor)).unwrap();
    let learned = hmm.learn(&[[0, 1, 0, 1]], &LearningOptions::default()).unwrap();
    let tied = learned.model().transition();
    assert_eq!((tied.inner().entries(), tied.parameters()), (2, 1));
}

#[test]
fn tied_turning_probabilities_are_found_again() {
    let map = canberra::map();
    let truth = canberra::turning().tied(&map);
    let hmm = |a: ConstrainedTransition| {
        let prior = Prior::AtFirstObservation(Belief::uniform(canberra::PLACES).unwrap());
        Hmm::new(prior, a, Fixed(canberra::sensor(1.0).unwrap())).unwrap().with_rounded_tails()
    };
    let source = hmm(truth.clone());
    let mut rng = rng(4);
    let drives: Vec<Vec<usize>> =
        (0..100).map(|_| source.simulate(50, &mut rng).observations().to_vec()).collect();
    // From equal turns.
    let alike = (0..canberra::PLACES).flat_map(|from| {
        let ways: Vec<usize> = canberra::turning().row(from).map(|way| way.0).collect();
        let share = 1.0 / ways.len() as f64;
        ways.into_iter().map(move |to| (to, from, share)).collect::<Vec<_>>()
    });
    let alike = SparseTransition::from_triplets(canberra::PLACES, alike).unwrap();
    let labels = |from: usize, to: usize| {
        let road = map.roads_from(from).find(|road| road.0 == to);
        road.map_or(0, |(_, road)| 1 + road.class as usize)
    };
    let start = ConstrainedTransition::new(alike).with_ties(labels);
    let learning =
        LearningOptions::default().with_keep_prior(true).with_transition_pseudo_count(1.0);
    let learned = hmm(start.clone()).learn(&drives, &learning).unwrap();
    assert!(learned.converged());
    // The mean distance to the true turns (total variation, in the places that
    // drives stay in) is less than a third of what it was.
    let distance = |a: &ConstrainedTransition| -> f64 {
        let turns =
            (0..canberra::PLACES).flat_map(|from| (0..canberra::PLACES).map(move |to| (to, from)));
        turns
            .map(|(to, from)| (a.inner().get(to, from) - truth.inner().get(to, from)).abs() / 2.0)
            .sum()
    };
    let (before, after) = (distance(&start), distance(learned.model().transition()));
    assert!(after < before / 3.0, "{before} to {after}");
}

#[test]
fn a_sequence_that_cannot_be_is_left_out_and_named() {
    let hmm = Hmm::new(
        Prior::AtFirstObservation(Belief::uniform(2).unwrap()),
        DenseTransition::from_rows(&[[0.6, 0.4], [0.4, 0.6]]).unwrap(),
        TableLikelihood::from_rows(&[[0.7, 0.3, 0.0], [0.3, 0.7, 0.0]]).unwrap(),
    )
    .unwrap();
    let sequences = [vec![0, 1, 1], vec![0, 2], vec![1, 0], vec![7]];
    let learned = hmm.learn(&sequences, &LearningOptions::default()).unwrap();
    let texts: Vec<String> = learned.left_out().iter().map(ToString::to_string).collect();
    assert_eq!(
        texts,
        [
            "sequence 1 failed: the observation of step 2 is impossible under the model",
            "sequence 3 failed: step 1 has no valid likelihood: symbol 7 does not exist, the table has 3 symbols (0 to 2)",
        ]
    );
    let error = hmm.learn(&sequences[1..2], &LearningOptions::default()).unwrap_err();
    assert_eq!(
        error.to_string(),
        "there is no observation to learn from, in 1 sequences given: sequence 0 failed: the observation of step 2 is impossible under the model"
    );
    let without = hmm.learn(&[vec![0, 1, 1], vec![1, 0]], &LearningOptions::default()).unwrap();
    assert_eq!(learned.objectives(), without.objectives());

    let none: [Vec<usize>; 0] = [];
    let error = hmm.learn(&none, &LearningOptions::default()).unwrap_err();
    assert_eq!(error.to_string(), "there is no observation to learn from, in 0 sequences given");
    let bad = LearningOptions::default().with_transition_pseudo_count(-1.0);
    assert_eq!(
        hmm.learn(&sequences, &bad).unwrap_err().to_string(),
        "the pseudo-count of the transitions is -1, expected a finite value of at least 0"
    );
}

/// If every state is known, one step of Baum–Welch is counting; and a sensor of groups of one state
/// each learns as one of states.
#[test]
fn learning_from_known_states_is_counting() {
    let source = Hmm::new(
        Prior::AtFirstObservation(Belief::new(vec![0.5, 0.3, 0.2]).unwrap()),
        SparseTransition::from_rows(&[[0.5, 0.0, 0.5], [0.5, 0.6, 0.0], [0.0, 0.4, 0.5]]).unwrap(),
        TableLikelihood::from_rows(&[[0.8, 0.2], [0.3, 0.7], [0.5, 0.5]]).unwrap(),
    )
    .unwrap();
    let mut rng = rng(9);
    let drives: Vec<_> = (0..20).map(|_| source.simulate(15, &mut rng)).collect();
    let labelled: Vec<_> = drives.iter().map(Simulation::labelled).collect();
    let learning = LearningOptions::default().with_iterations(1).with_transition_pseudo_count(0.5);
    let counted = source.fit(&labelled, &learning).unwrap();

    let groups = Groups::new(vec![0, 1, 2]).unwrap();
    let camera = GroupedLikelihood::new(source.likelihood().clone(), groups).unwrap();
    let sensor =
        FusedLikelihood::new(camera, OptionalLikelihood::new(SparseLikelihood::new(3))).unwrap();
    let hmm = Hmm::new(source.prior().clone(), source.transition().clone(), sensor).unwrap();
    let known: Vec<Vec<(usize, Option<SparseObservation>)>> = drives
        .iter()
        .map(|d| {
            let known = d.states().iter().map(|&state| Some(SparseObservation::known(state)));
            d.observations().iter().copied().zip(known).collect()
        })
        .collect();
    let learned = hmm.learn(&known, &learning).unwrap().into_model();

    let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} {b}");
    for (a, b) in
        learned.prior().belief().as_slice().iter().zip(counted.prior().belief().as_slice())
    {
        close(*a, *b);
    }
    for (to, from) in (0..9).map(|at| (at / 3, at % 3)) {
        close(learned.transition().get(to, from), counted.transition().get(to, from));
    }
    let ahead =
        Hmm::new(counted.prior().clone(), counted.transition(), learned.likelihood()).unwrap();
    for symbol in 0..2 {
        close(
            ahead.log_likelihood(&[(symbol, None)]).unwrap(),
            counted.log_likelihood(&[symbol]).unwrap(),
        );
    }
    // By hand.
    let pairs = || drives.iter().flat_map(|d| d.states().windows(2));
    let from_0 = pairs().filter(|pair| pair[0] == 0).count() as f64;
    let to_1 = pairs().filter(|pair| pair[0] == 0 && pair[1] == 1).count() as f64;
    close(counted.transition().get(1, 0), (to_1 + 0.5) / (from_0 + 1.0));
}

#[test]
fn labelled_drives_that_do_not_fit_are_errors() {
    let hmm = Hmm::new(
        Prior::BeforeFirstTransition(Belief::certain(2, 0).unwrap()),
        SparseTransition::from_triplets(2, [(1, 0, 1.0), (1, 1, 1.0)]).unwrap(),
        TableLikelihood::from_rows(&[[0.8, 0.1, 0.1], [0.3, 0.7, 0.0]]).unwrap(),
    )
    .unwrap();
    let text = |initial, states: &[usize], sequence: &[usize]| {
        let fine = LabelledSequence { initial: None, states: &[1], sequence: &[0][..] };
        let drives = [fine, LabelledSequence { initial, states, sequence }];
        hmm.fit(&drives, &LearningOptions::default()).unwrap_err().to_string()
    };
    for (found, expected) in [
        (
            text(None, &[1], &[0, 0]),
            "sequence 1 has 1 states for 2 observations, expected one each",
        ),
        (text(None, &[1, 2], &[0, 0]), "sequence 1 is in state 2 at step 2, expected 0 to 1"),
        (text(Some(3), &[1, 1], &[0, 0]), "sequence 1 is in state 3 at step 0, expected 0 to 1"),
        (text(Some(1), &[1], &[0]), "sequence 1 starts in state 1, which the prior rules out"),
        (
            text(Some(0), &[1, 0], &[0, 0]),
            "sequence 1 moves from state 1 to state 0 at step 2, which the transition operator forbids",
        ),
        (
            text(Some(0), &[1, 1], &[0, 2]),
            "sequence 1 is in state 1 at step 2, where the sensor rules its observation out",
        ),
        (
            text(Some(0), &[1], &[5]),
            "sequence 1 failed: step 1 has no valid likelihood: symbol 5 does not exist, the table has 3 symbols (0 to 2)",
        ),
    ] {
        assert_eq!(found, expected);
    }
    let none: [LabelledSequence<'_, [usize]>; 0] = [];
    let error = hmm.fit(&none, &LearningOptions::default()).unwrap_err();
    assert_eq!(error.to_string(), "there is no observation to learn from, in 0 sequences given");
}

#[test]
fn a_count_that_is_no_number_is_an_error() {
    let table = TableLikelihood::from_rows(&[[0.7, 0.3], [0.3, 0.7]]).unwrap();
    let mut statistics = table.statistics();
    table.add(&mut statistics, &1, &[f64::NAN, 0.5]);
    let error = table.maximize(&statistics, 0.0).unwrap_err().to_string();
    assert!(error.contains("NaN"), "{error}");
    table.add(&mut statistics, &0, &[0.5, f64::INFINITY]);
    assert!(table.maximize(&statistics, 0.0).is_err());
}
