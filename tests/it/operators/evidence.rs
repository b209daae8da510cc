//! Evidence on moves in operators that are composed of others, entry by entry.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::error::At;
use wayfix::motion::OffMapTransition;
use wayfix::transition::{
    DistractedTransition, Distraction, DistractionRates, DwellTransition, EvidenceTransition,
    KroneckerTransition, RestartTransition,
};
use wayfix::{
    Belief, Controlled, Hmm, HmmError, LikelihoodVector, Prior, SparseTransition, Transition,
    TransitionEntries, TransitionError,
};

use crate::kit::{
    Matrix, NEVER, all_close, any_stochastic, cases, close, close_logs, distribution, log_sum,
    matrix, off_map, rate, sparse, still,
};

/// ln p(u | to, from) for u = 1, and in proportion for others.
fn logs(n: usize) -> impl Strategy<Value = Matrix> {
    vec(vec(prop_oneof![1 => Just(NEVER), 3 => -3.0..1.0, 1 => -900.0..400.0], n), n)
}

/// Likelihoods of any scale.
fn likelihood() -> impl Strategy<Value = f64> {
    prop_oneof![1 => Just(0.0), 3 => 0.01..1.0, 1 => Just(1e-300), 1 => Just(1e250)]
}

type LogLikelihood = Box<dyn Fn(&f64, usize, usize) -> f64>;
type Driven = EvidenceTransition<SparseTransition, f64, LogLikelihood, Box<dyn Fn(&f64) -> f64>>;

fn driven(m: &Matrix, logs: &Matrix, log_factor: f64) -> Driven {
    let logs = logs.clone();
    let log: LogLikelihood = Box::new(move |u, to, from| u * logs[to][from]);
    EvidenceTransition::new(sparse(m), log).unwrap().with_log_factor(Box::new(move |_| log_factor))
}

/// Checks all methods against the logarithms of the entries with the log factor put back; `tells`
/// is true if the operator reports that they are beyond doubles.
pub(super) fn check<A: TransitionEntries<Control: Copy>>(
    a: &A,
    control: A::Control,
    expected: &Matrix,
    tells: bool,
) -> Result<(), TestCaseError> {
    let n = expected.len();
    let factor = a.evidence(&control).unwrap();
    let expected = matrix(n, |i, j| expected[i][j] - factor);
    let column = |j: usize| expected.iter().map(move |row| row[j]);
    // Digits that a large factor has cost the expected logarithms.
    let lost = 4.0 * f64::EPSILON * factor.abs();
    let close_log = |found: f64, expected: f64| close(found, expected, 1e-12 + lost, 30.0);
    let beyond = |margin: f64| {
        let held = f64::MIN_POSITIVE.ln() - margin..=300.0 * 10_f64.ln() + margin;
        expected.iter().flatten().any(|log| *log > NEVER && !held.contains(log))
    };
    prop_assert!(!beyond(10.0) || !tells || a.needs_logs(&control));
    let x: Vec<f64> = (0..n).map(|j| [0.25, -3.0, NEVER, -40.0, 2.0][j % 5]).collect();
    let (mut out, mut from) = (vec![0.0; n], vec![0; n]);
    a.apply_log(&control, &x, &mut out);
    for (i, found) in out.iter().enumerate() {
        close_log(*found, log_sum(expected[i].iter().zip(&x).map(|(a, x)| a + x)))?;
    }
    a.max_product(&control, &x, &mut out, &mut from);
    for (i, found) in out.iter().enumerate() {
        let best = expected[i].iter().zip(&x).map(|(a, x)| a + x * std::f64::consts::LN_2);
        close_log(found * std::f64::consts::LN_2, best.fold(NEVER, f64::max))?;
    }
    a.apply_transpose_log(&control, &x, &mut out);
    for (j, found) in out.iter().enumerate() {
        close_log(
            *found,
            log_sum(column(j).zip(&x).map(|(a, x)| a + x).collect::<Vec<_>>().into_iter()),
        )?;
    }
    for state in 0..n {
        let row = (0..n).map(|j| (j, expected[state][j])).filter(|entry| entry.1 > NEVER);
        let found: Vec<_> = a.incoming_log2(&control, state).collect();
        prop_assert!(found.iter().map(|entry| entry.0).eq(row.clone().map(|entry| entry.0)));
        for (found, expected) in found.iter().zip(row) {
            close_log(found.1 * std::f64::consts::LN_2, expected.1)?;
        }
        let column = column(state).enumerate().filter(|entry| entry.1 > NEVER).collect::<Vec<_>>();
        let found: Vec<_> = a.outgoing_log2(&control, state).collect();
        prop_assert!(found.iter().map(|entry| entry.0).eq(column.iter().map(|entry| entry.0)));
        for (found, expected) in found.iter().zip(column) {
            close_log(found.1 * std::f64::consts::LN_2, expected.1)?;
        }
    }
    if beyond(-10.0) || a.needs_logs(&control) {
        return Ok(());
    }
    let x: Vec<f64> = (0..n).map(|j| [0.5, 0.0, 1.0, 1e-9][j % 4]).collect();
    let product =
        |row: &mut dyn Iterator<Item = f64>| row.zip(&x).map(|(a, x)| a.exp() * x).sum::<f64>();
    a.apply(&control, &x, &mut out);
    for (i, found) in out.iter().enumerate() {
        close(*found, product(&mut expected[i].iter().copied()), 1e-11 + lost, 1e-300)?;
    }
    a.apply_transpose(&control, &x, &mut out);
    for (j, found) in out.iter().enumerate() {
        close(*found, product(&mut column(j)), 1e-11 + lost, 1e-300)?;
    }
    for (i, expected) in expected.iter().enumerate() {
        let mut row = vec![0.0; n];
        a.incoming(&control, i).for_each(|(j, p)| row[j] = p);
        for (j, p) in row.into_iter().enumerate() {
            close(p, expected[j].exp(), 1e-11 + lost, 1e-300)?;
            let found =
                a.outgoing(&control, j).find(|entry| entry.0 == i).map_or(0.0, |entry| entry.1);
            prop_assert_eq!(found, p);
        }
    }
    Ok(())
}

/// A matrix, logarithms of its evidence, and a log factor.
fn parts(most: usize) -> impl Strategy<Value = (Matrix, Matrix, f64)> {
    any_stochastic(false, most).prop_flat_map(|m| {
        let n = m.len();
        (Just(m), logs(n), -5.0..5.0)
    })
}

/// ln A plus the evidence.
fn joint(m: &Matrix, logs: &Matrix) -> Matrix {
    matrix(m.len(), |i, j| if m[i][j] > 0.0 { m[i][j].ln() + logs[i][j] } else { NEVER })
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn evidence_on_moves_is_that_of_each((m, logs, log_factor) in parts(5)) {
        check(&driven(&m, &logs, log_factor), 1.0, &joint(&m, &logs), true)?;
    }

    #[test]
    fn off_the_map_evidence_is_what_it_is_said_to_be(
        ((m, logs, log_factor), back) in parts(5).prop_flat_map(|part| { let n = part.0.len(); (Just(part), distribution(false, n)) }),
        (leave, return_rate) in (rate(false), rate(false)),
        off in prop_oneof![Just(None), (-9.0..3.0).prop_map(Some), Just(Some(-800.0))],
    ) {
        let n = m.len();
        let a = driven(&m, &logs, log_factor);
        let a = OffMapTransition::new(a, leave, return_rate, Belief::new(back.clone()).unwrap()).unwrap();
        let a = match off { Some(log) => a.with_evidence(log).unwrap(), None => a };
        let (off, on_map) = (off.unwrap_or(log_factor), joint(&m, &logs));
        let expected = matrix(n + 1, |i, j| match (i < n, j < n) {
            (true, true) => (1.0 - leave).ln() + on_map[i][j],
            (false, true) => leave.ln() + off,
            (true, false) => (return_rate * back[i]).ln() + off,
            (false, false) => (1.0 - return_rate).ln() + off,
        });
        check(&a, 1.0, &expected, true)?;
    }

    /// Every routine, with rates of 0 and 1 and evidence far from 1, as with a likelihood of moves
    /// of the whole matrix.
    #[test]
    fn off_the_map_routines_are_those_of_the_matrix(
        ((m, logs, _), back) in parts(4).prop_flat_map(|part| { let n = part.0.len(); (Just(part), distribution(false, n)) }),
        (leave, return_rate) in (rate(false), rate(false)),
        shift in prop_oneof![Just(0.0), Just(100.0), Just(-100.0), Just(300.0), Just(600.0), Just(-600.0)],
        off in prop_oneof![Just(None), (-9.0..3.0).prop_map(Some), Just(Some(100.0)), Just(Some(-800.0)), Just(Some(705.0))],
    ) {
        let n = m.len();
        let shifted: Matrix = logs.iter().map(|row| row.iter().map(|log| log + shift).collect()).collect();
        let a = OffMapTransition::new(driven(&m, &shifted, 0.0), leave, return_rate, Belief::new(back.clone()).unwrap()).unwrap();
        let a = match off { Some(log) => a.with_evidence(log).unwrap(), None => a };
        let whole = off_map(&m, leave, return_rate, &back);
        let all = matrix(n + 1, |i, j| if i < n && j < n { shifted[i][j] } else { off.unwrap_or(0.0) });
        same_routines(a, driven(&whole, &all, 0.0))?;
    }

    /// Zeros of one operator, and entries of the other that leave the range of doubles.
    #[test]
    fn side_by_side_routines_are_those_of_the_matrix(first in parts(3), second in parts(3)) {
        let (n2, count) = (second.0.len(), first.0.len() * second.0.len());
        let all = matrix(count, |i, j| first.1[i / n2][j / n2] + second.1[i % n2][j % n2]);
        let whole = matrix(count, |i, j| first.0[i / n2][j / n2] * second.0[i % n2][j % n2]);
        let both = KroneckerTransition::new(driven(&first.0, &first.1, 0.0), driven(&second.0, &second.1, 0.0)).unwrap();
        same_routines(both, driven(&whole, &all, 0.0))?;
    }

    #[test]
    fn evidence_of_restarts_is_what_it_is_said_to_be(
        ((m, logs, log_factor), r) in parts(5).prop_flat_map(|part| { let n = part.0.len(); (Just(part), distribution(false, n)) }),
        rate in rate(false),
        restart in prop_oneof![Just(None), (-9.0..3.0).prop_map(Some), Just(Some(-800.0))],
    ) {
        let a = driven(&m, &logs, log_factor);
        let a = RestartTransition::new(a, rate, Belief::new(r.clone()).unwrap()).unwrap();
        let a = match restart { Some(log) => a.with_evidence(log).unwrap(), None => a };
        let (restart, moves) = (restart.unwrap_or(log_factor), joint(&m, &logs));
        let expected = matrix(m.len(), |i, j| {
            log_sum([(1.0 - rate).ln() + moves[i][j], (rate * r[i]).ln() + restart].into_iter())
        });
        check(&a, 1.0, &expected, true)?;
    }

    /// Rates and likelihoods of a distraction multiply the evidence, also far beyond doubles.
    #[test]
    fn evidence_of_distracted_moves_is_that_of_each(
        (m, logs, log_factor) in parts(4), (begin, end) in (rate(false), rate(false)),
        [begins, continues] in [likelihood(), likelihood()],
    ) {
        let base = driven(&m, &logs, log_factor);
        let a = DistractedTransition::new(base, DistractionRates { begin, end }).unwrap();
        let (n, moves) = (m.len(), joint(&m, &logs));
        let factors = [
            [(1.0 - begin).ln(), end.ln()],
            [begin.ln() + begins.ln(), (1.0 - end).ln() + continues.ln()],
        ];
        let expected = matrix(2 * n, |i, j| factors[i / n][j / n] + moves[i % n][j % n]);
        let control = Distraction { control: 1.0, begins, continues };
        prop_assert_eq!(a.evidence(&control), Some(log_factor));
        check(&a, control, &expected, false)?;
    }

    #[test]
    fn side_by_side_evidence_multiplies(first in parts(3), second in parts(3)) {
        let a = driven(&first.0, &first.1, first.2);
        let b = driven(&second.0, &second.1, second.2);
        let (one, two) = (joint(&first.0, &first.1), joint(&second.0, &second.1));
        let n2 = two.len();
        let expected = matrix(one.len() * n2, |i, j| one[i / n2][j / n2] + two[i % n2][j % n2]);
        let both = KroneckerTransition::new(a, b).unwrap();
        check(&both, 1.0, &expected, false)?;
        close_logs(both.evidence(&1.0).unwrap(), first.2 + second.2, 1e-15)?;
    }
}

/// Results of the routines for three steps of evidence, or the error.
fn outcome<A: TransitionEntries<Control = f64>>(a: A) -> Result<Vec<Vec<f64>>, HmmError> {
    let n = a.states();
    let prior = Prior::BeforeFirstTransition(Belief::uniform(n).unwrap());
    let hmm = Hmm::new(prior, a, LikelihoodVector::linear(n).owned()).unwrap();
    let seen: Vec<Vec<f64>> =
        (0..3).map(|k| (0..n).map(|i| 0.1 + 0.2 * ((i + k) % 4) as f64).collect()).collect();
    let drive = Controlled::new(&[1.0; 3], &seen).unwrap();
    let (mut filter, mut lagged, mut online) =
        (hmm.filter(), hmm.fixed_lag(1), hmm.online_viterbi());
    let mut results = Vec::new();
    for y in &seen {
        filter.step_with(&1.0, y)?;
        lagged.step_with(&1.0, y)?;
        online.step_with(&1.0, y)?;
        results.push(filter.belief().as_slice().to_vec());
        results.push(lagged.lagged().as_slice().to_vec());
    }
    filter.predict_with(&1.0)?;
    results.push(filter.belief().as_slice().to_vec());
    let smoothed = hmm.smooth(&drive)?;
    results.push(smoothed.posteriors().as_slice().to_vec());
    let moves = hmm.expected_moves(&drive)?;
    results.push((0..n * n).map(|at| moves.get(at / n, at % n)).collect());
    let best = hmm.viterbi(&drive)?.log_probability();
    let online = online.log_probability();
    results.push(vec![filter.log_likelihood(), smoothed.log_likelihood(), best, online]);
    Ok(results)
}

fn same_routines<A, B>(found: A, expected: B) -> Result<(), TestCaseError>
where
    A: TransitionEntries<Control = f64>,
    B: TransitionEntries<Control = f64>,
{
    match (outcome(found), outcome(expected)) {
        (Ok(found), Ok(expected)) => {
            for (found, expected) in found.iter().zip(&expected) {
                all_close(found, expected, 1e-9, 1.0)?;
            }
        }
        (found, expected) => {
            let (found, expected) = (found.err(), expected.err());
            prop_assert_eq!(found.map(|e| e.to_string()), expected.map(|e| e.to_string()));
        }
    }
    Ok(())
}

/// 0 times a product that leaves the range of doubles is 0.
#[test]
fn who_always_leaves_the_map_is_off_it() {
    for nats in [100.0, 400.0, 700.0, -700.0] {
        let a = EvidenceTransition::new(still(2), move |_: &f64, _, _| nats).unwrap();
        let back = Belief::uniform(2).unwrap();
        let a = OffMapTransition::new(a, 1.0, 0.25, back).unwrap();
        let prior = Prior::BeforeFirstTransition(Belief::uniform(3).unwrap());
        let hmm = Hmm::new(prior, a, LikelihoodVector::linear(3)).unwrap();
        let mut filter = hmm.filter();
        filter.predict_with(&1.0).unwrap();
        let off = (2.0 + 0.75) / 3.0;
        assert!((filter.belief().as_slice()[2] - off).abs() < 1e-12, "{nats}");
        assert!(filter.log_likelihood().abs() < 1e-12);
    }
}

fn refused<A: Transition<Control = f64>>(a: A, name: &str) {
    let prior = Prior::BeforeFirstTransition(Belief::certain(1, 0).unwrap());
    let hmm = Hmm::new(prior, a, LikelihoodVector::linear(1)).unwrap();
    let error = hmm.filter().step_with(&1.0, &[1.0]).unwrap_err();
    let HmmError::Control(At { number: 1, cause, .. }) = error else { panic!("{error}") };
    let expected = format!("evidence on moves within a {name}, which does not take it");
    assert_eq!(cause.to_string(), expected);
}

#[test]
fn operators_that_cannot_take_evidence_refuse_it() {
    let a = || EvidenceTransition::new(still(1), |_: &f64, _, _| -1.0).unwrap();
    let one = || Belief::certain(1, 0).unwrap();
    refused(DwellTransition::new(a(), &[[1.0]]).unwrap(), "DwellTransition");
    let inner = EvidenceTransition::new(still(1), |(): &(), _, _| -1.0).unwrap();
    let twice = EvidenceTransition::new(inner, |_: &f64, _, _| -1.0);
    assert!(matches!(twice, Err(TransitionError::Control(_))));
    let off = OffMapTransition::new(a(), 0.5, 0.5, one()).unwrap();
    let restart = RestartTransition::new(a(), 0.5, one()).unwrap();
    let error = restart.with_evidence(f64::INFINITY).unwrap_err().to_string();
    let expected = "the log-likelihood of evidence at a restart is inf, expected a finite number";
    assert_eq!(error, expected);
    for log in [f64::NAN, NEVER, f64::INFINITY] {
        let off = off.clone().with_evidence(log);
        assert!(matches!(off, Err(TransitionError::Parameter(_))), "{log}");
    }
}
