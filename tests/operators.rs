//! Structured operators against the dense matrices that define them, and
//! groups and their sensors against sums over paths.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::{
    Belief, Controlled, DenseTransition, DwellTransition, Ends, FusedLikelihood, GroupedLikelihood,
    Groups, Hmm, KnownState, KroneckerTransition, LikelihoodVector, PowerTransition, Prior,
    RestartTransition, SparseTransition, SwitchedTransition, TableLikelihood, Transition,
    TransitionEntries, WindowTransition,
};

/// `matrix[to][from]`.
type Matrix = Vec<Vec<f64>>;

const NEVER: f64 = f64::NEG_INFINITY;

fn matrix(n: usize, entry: impl Fn(usize, usize) -> f64) -> Matrix {
    (0..n).map(|i| (0..n).map(|j| entry(i, j)).collect()).collect()
}

fn times(a: &Matrix, b: &Matrix) -> Matrix {
    matrix(a.len(), |i, j| (0..a.len()).map(|k| a[i][k] * b[k][j]).sum())
}

fn sparse(m: &Matrix) -> SparseTransition {
    SparseTransition::from_rows(m.len(), &m.concat()).unwrap()
}

fn dense(m: &Matrix) -> DenseTransition {
    DenseTransition::from_rows(m.len(), &m.concat()).unwrap()
}

/// What operators are tried on, one value a state: numbers, logarithms of a
/// huge range, and whole scores, which tie.
#[derive(Debug, Clone)]
struct Inputs {
    numbers: Vec<f64>,
    logs: Vec<f64>,
    scores: Vec<f64>,
}

/// For up to this many states.
const MOST: usize = 28;

fn inputs() -> impl Strategy<Value = Inputs> {
    let number = prop_oneof![1 => Just(0.0), 3 => 0.0..1.0];
    let log = prop_oneof![1 => Just(NEVER), 2 => -5000.0..0.0, 2 => -3.0..0.0];
    let score = prop_oneof![1 => Just(NEVER), 4 => (-2..3_i32).prop_map(f64::from)];
    (vec(number, MOST), vec(log, MOST), vec(score, MOST))
        .prop_map(|(numbers, logs, scores)| Inputs { numbers, logs, scores })
}

/// Weights; `exact` ones are powers of two, of which logarithms are exact.
fn distribution(exact: bool, most: usize) -> impl Strategy<Value = Vec<f64>> {
    let halves = |(zeros, mut order): (Vec<bool>, Vec<usize>)| {
        // 1/2, 1/4, … with the rest on the last; some places in between are 0.
        let count = zeros.len();
        let mut left = 1.0;
        let mut p = vec![0.0; count];
        order.retain(|&at| !zeros[at]);
        for (k, &at) in order.iter().enumerate() {
            p[at] = if k + 1 == order.len() { left } else { left / 2.0 };
            left -= p[at];
        }
        if order.is_empty() {
            p[0] = 1.0;
        }
        p
    };
    (1..=most).prop_flat_map(move |count| {
        if exact {
            let order = Just((0..count).collect::<Vec<_>>()).prop_shuffle();
            (vec(any::<bool>(), count), order).prop_map(halves).boxed()
        } else {
            let weight = prop_oneof![1 => Just(0.0), 3 => 0.01..1.0];
            let scale = |mut w: Vec<f64>| {
                let sum: f64 = w.iter().sum();
                if sum == 0.0 {
                    w[0] = 1.0;
                    return w;
                }
                w.iter().map(|w| w / sum).collect()
            };
            vec(weight, count).prop_map(scale).boxed()
        }
    })
}

fn stochastic(exact: bool, n: usize) -> impl Strategy<Value = Matrix> {
    let column = distribution(exact, n).prop_map(move |mut p| {
        p.resize(n, 0.0);
        p
    });
    let rotated = (column, 0..n).prop_map(|(mut p, by)| {
        p.rotate_right(by);
        p
    });
    vec(rotated, n).prop_map(move |columns| matrix(n, |i, j| columns[j][i]))
}

/// A stochastic matrix of 1 to `most` states.
fn any_stochastic(exact: bool, most: usize) -> impl Strategy<Value = Matrix> {
    (1..=most).prop_flat_map(move |n| stochastic(exact, n))
}

fn log_sum(terms: impl Iterator<Item = f64> + Clone) -> f64 {
    let largest = terms.clone().fold(NEVER, f64::max);
    if largest == NEVER {
        return NEVER;
    }
    largest + terms.map(|term| (term - largest).exp()).sum::<f64>().ln()
}

fn close(found: f64, expected: f64, tolerance: f64, what: &str) -> Result<(), TestCaseError> {
    let close = found == expected
        || (found - expected).abs() <= tolerance * expected.abs().max(f64::MIN_POSITIVE);
    prop_assert!(close, "{}: found {}, expected {}", what, found, expected);
    Ok(())
}

/// Every method of an operator against its matrix. If it is `exact`, of equal
/// predecessors the lowest must be named.
fn check<A: TransitionEntries>(
    a: &A,
    control: &A::Control,
    m: &Matrix,
    inputs: &Inputs,
    exact: bool,
) -> Result<(), TestCaseError> {
    let n = m.len();
    prop_assert_eq!(a.states(), n);
    prop_assert!(a.check_control(control).is_ok());
    let transposed = matrix(n, |i, j| m[j][i]);
    let logs_near: Vec<f64> = inputs.logs.iter().map(|log| log / 1000.0).collect();
    let mut out = vec![f64::NAN; n];

    for (m, transpose) in [(m, false), (&transposed, true)] {
        let name = if transpose { "transpose" } else { "apply" };
        let x = &inputs.numbers[..n];
        if transpose {
            a.apply_transpose(control, x, &mut out);
        } else {
            a.apply(control, x, &mut out);
        }
        for (found, row) in out.iter().zip(m) {
            close(*found, row.iter().zip(x).map(|(a, x)| a * x).sum(), 1e-13, name)?;
        }
        for x in [&inputs.logs[..n], &logs_near[..n], &vec![NEVER; n]] {
            out.fill(f64::NAN);
            if transpose {
                a.apply_transpose_log(control, x, &mut out);
            } else {
                a.apply_log(control, x, &mut out);
            }
            for (found, row) in out.iter().zip(m) {
                let expected = log_sum(row.iter().zip(x).map(|(a, x)| a.ln() + x));
                if expected.abs() > 0.1 {
                    close(*found, expected, 1e-12, name)?;
                } else {
                    prop_assert!(
                        (found - expected).abs() <= 1e-12,
                        "{}: {} {}",
                        name,
                        found,
                        expected
                    );
                }
            }
        }
        for (state, row) in m.iter().enumerate() {
            let found: Vec<_> = if transpose {
                a.outgoing(control, state).collect()
            } else {
                a.incoming(control, state).collect()
            };
            let expected: Vec<_> =
                row.iter().copied().enumerate().filter(|entry| entry.1 > 0.0).collect();
            let states = |entries: &[(usize, f64)]| entries.iter().map(|e| e.0).collect::<Vec<_>>();
            prop_assert_eq!(states(&found), states(&expected), "entries of {}", state);
            for (found, expected) in found.iter().zip(&expected) {
                close(found.1, expected.1, 1e-13, "entry")?;
            }
        }
    }

    let mut from = vec![u32::MAX; n];
    for x in [&inputs.scores[..n], &vec![0.0; n], &vec![NEVER; n]] {
        a.max_product(control, x, &mut out, &mut from);
        for (i, row) in m.iter().enumerate() {
            let values: Vec<f64> = row.iter().zip(x).map(|(a, x)| a.log2() + x).collect();
            let best = values.iter().copied().fold(NEVER, f64::max);
            if best == NEVER {
                prop_assert_eq!(out[i], NEVER);
                continue;
            }
            prop_assert!((out[i] - best).abs() <= 1e-12, "best {} for {}", out[i], best);
            let named = from[i] as usize;
            prop_assert!(values[named] >= best - 1e-12, "{} of {:?}", named, values);
            if exact {
                prop_assert_eq!(named, values.iter().position(|v| *v >= best - 1e-12).unwrap());
            }
        }
    }
    Ok(())
}

/// Smoother and decoder with the operator as with its matrix.
fn check_inference<A>(
    a: A,
    control: &A::Control,
    m: &Matrix,
    inputs: &Inputs,
) -> Result<(), TestCaseError>
where
    A: TransitionEntries<Control: Clone>,
{
    let n = m.len();
    let prior = Prior::BeforeFirstTransition(Belief::uniform(n).unwrap());
    let ys: Vec<Vec<f64>> = [&inputs.logs, &inputs.scores]
        .map(|x| x[..n].iter().map(|log| log / 50.0).collect())
        .into_iter()
        .chain([vec![0.0; n]])
        .collect();
    let sensor = LikelihoodVector::log(n).owned();
    let reference = Hmm::new(prior.clone(), dense(m), sensor).unwrap();
    let hmm = Hmm::new(prior, a, sensor).unwrap();
    let controls = vec![control.clone(); ys.len()];
    let drive = Controlled::new(&controls, &ys).unwrap();
    let Ok(expected) = reference.smooth(&ys) else {
        prop_assert!(hmm.smooth(&drive).is_err());
        prop_assert!(hmm.viterbi(&drive).is_err());
        return Ok(());
    };
    let found = hmm.smooth(&drive).unwrap();
    let close = |a: f64, b: f64| (a - b).abs() <= 1e-11 * b.abs().max(1.0);
    prop_assert!(close(found.log_likelihood(), expected.log_likelihood()));
    let posteriors = found.posteriors().as_slice().iter().zip(expected.posteriors().as_slice());
    for (found, expected) in posteriors {
        prop_assert!(close(*found, *expected), "{} {}", found, expected);
    }
    let mut lagged = hmm.fixed_lag(ys.len());
    let mut online = hmm.online_viterbi();
    let mut path = Vec::new();
    for (control, y) in controls.iter().zip(&ys) {
        lagged.step_with(control, y).unwrap();
        path.extend_from_slice(online.step_with(control, y).unwrap());
    }
    prop_assert_eq!(Some(lagged.lagged()), found.posteriors().get(0));
    prop_assert!(close(hmm.score(&drive).unwrap(), expected.log_likelihood()));
    let entropy = reference.path_entropy(&ys).unwrap();
    prop_assert!(close(hmm.path_entropy(&drive).unwrap(), entropy));
    let (moves, others) =
        (hmm.expected_moves(&drive).unwrap(), reference.expected_moves(&ys).unwrap());
    for (m, other) in
        (0..n * n).map(|at| (at / n, at % n)).map(|(i, j)| (moves.get(i, j), others.get(i, j)))
    {
        prop_assert!(close(m, other), "{} {}", m, other);
    }
    let best = reference.k_best(&ys, 7).unwrap();
    let found = hmm.k_best(&drive, 7).unwrap();
    prop_assert_eq!(found.len(), best.len());
    for (found, best) in found.iter().zip(&best) {
        prop_assert!(close(found.log_probability(), best.log_probability()));
    }
    let first = found[0].clone();
    let found = hmm.viterbi(&drive).unwrap();
    prop_assert_eq!(&first, &found);
    path.extend(online.undecided());
    prop_assert_eq!(&path[..], found.states());
    prop_assert!(close(found.log_probability(), best[0].log_probability()));
    for pair in found.states().windows(2) {
        prop_assert!(m[pair[1]][pair[0]] > 0.0, "a move that there is not");
    }
    Ok(())
}

fn check_all<A>(a: A, m: &Matrix, inputs: &Inputs, exact: bool) -> Result<(), TestCaseError>
where
    A: TransitionEntries<Control = ()>,
{
    check(&a, &(), m, inputs, exact)?;
    check(&SparseTransition::from_operator(&a).unwrap(), &(), m, inputs, exact)?;
    check_inference(a, &(), m, inputs)
}

/// The matrix of a window, move by move; `None` if a column has nothing left.
fn window(n: usize, first: isize, weights: &[f64], ends: Ends) -> Option<Matrix> {
    let places = n.cast_signed();
    let mut m = vec![vec![0.0; n]; n];
    for from in 0..places {
        let column = from.cast_unsigned();
        for (offset, weight) in (first..).zip(weights) {
            let mut to = from + offset;
            match ends {
                Ends::Loop => {
                    while to < 0 {
                        to += places;
                    }
                    while to >= places {
                        to -= places;
                    }
                }
                Ends::Stop => to = to.max(0).min(places - 1),
                Ends::Renormalise if to < 0 || to >= places => continue,
                Ends::Renormalise => {}
            }
            m[to.cast_unsigned()][column] += weight;
        }
        if ends == Ends::Renormalise {
            let sum: f64 = m.iter().map(|row| row[column]).sum();
            if sum == 0.0 {
                return None;
            }
            m.iter_mut().for_each(|row| row[column] /= sum);
        }
    }
    Some(m)
}

fn ends() -> impl Strategy<Value = Ends> {
    prop_oneof![Just(Ends::Loop), Just(Ends::Stop), Just(Ends::Renormalise)]
}

fn restart(m: &Matrix, rate: f64, r: &[f64]) -> Matrix {
    matrix(m.len(), |i, j| (1.0 - rate) * m[i][j] + rate * r[i])
}

fn rates() -> impl Strategy<Value = f64> {
    prop_oneof![Just(0.0), Just(1.0), Just(0.25), Just(0.5), 0.001..0.999]
}

fn kronecker(a: &Matrix, b: &Matrix) -> Matrix {
    let n2 = b.len();
    matrix(a.len() * n2, |i, j| a[i / n2][j / n2] * b[i % n2][j % n2])
}

fn power(m: &Matrix, exponent: u32) -> Matrix {
    (0..exponent).fold(matrix(m.len(), |i, j| f64::from(u8::from(i == j))), |p, _| times(m, &p))
}

/// The matrix of dwell times, state by state, by probabilities of leaving.
fn dwell(moves: &Matrix, leaving: &[Vec<f64>]) -> Matrix {
    let states: Vec<(usize, usize)> =
        (0..leaving.len()).flat_map(|i| (0..leaving[i].len()).map(move |age| (i, age))).collect();
    matrix(states.len(), |to, from| {
        let ((i, new_age), (j, age)) = (states[to], states[from]);
        let leave = leaving[j][age];
        let arrives = if new_age == 0 { leave * moves[i][j] } else { 0.0 };
        let oldest = age + 1 == leaving[j].len();
        let stays = i == j && new_age == if oldest { age } else { age + 1 };
        arrives + if stays { 1.0 - leave } else { 0.0 }
    })
}

/// Probabilities of leaving from those of the number of steps.
fn hazards(dwell: &[f64]) -> Vec<f64> {
    let last = dwell.iter().rposition(|p| *p > 0.0).unwrap();
    (0..=last)
        .map(|c| if c == last { 1.0 } else { dwell[c] / dwell[c..].iter().sum::<f64>() })
        .collect()
}

/// A place graph with dwell times for each place.
fn dwelling(exact: bool) -> impl Strategy<Value = (Matrix, Vec<Vec<f64>>)> {
    (1..=4_usize).prop_flat_map(move |n| (stochastic(exact, n), vec(distribution(exact, 4), n)))
}

fn leaving(exact: bool) -> BoxedStrategy<f64> {
    if exact {
        prop_oneof![Just(0.0), Just(0.5), Just(1.0)].boxed()
    } else {
        prop_oneof![1 => Just(0.0), 1 => Just(1.0), 4 => 0.0..1.0].boxed()
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(2000) })]

    #[test]
    fn windows(
        (exact, weights) in any::<bool>().prop_flat_map(|e| (Just(e), distribution(e, 12))),
        (n, first, ends) in (1..=10_usize, -14..12_isize, ends()),
        inputs in inputs(),
    ) {
        let built = WindowTransition::new(n, first, &weights, ends);
        if let Some(m) = window(n, first, &weights, ends) {
            // Scaled, or added up on a loop, weights are no powers of two.
            let exact = exact && ends != Ends::Renormalise && weights.len() <= n;
            check_all(built.unwrap(), &m, &inputs, exact)?;
        } else {
            let text = built.unwrap_err().to_string();
            prop_assert!(text.ends_with("sums to 0, expected 1"), "{}", text);
        }
    }

    #[test]
    fn restarts(
        m in any_stochastic(true, 6), r in distribution(true, 6), rate in rates(), inputs in inputs(),
    ) {
        let mut r = r;
        r.resize(m.len().max(r.len()), 0.0);
        let rest: f64 = r.drain(m.len()..).sum();
        r[0] += rest;
        let expected = restart(&m, rate, &r);
        let belief = Belief::new(r).unwrap();
        let a = RestartTransition::new(sparse(&m), rate, belief).unwrap();
        // A sum of two products ties only by chance, but to the bit.
        check_all(a, &expected, &inputs, true)?;
    }

    #[test]
    fn restarts_of_windows(
        weights in distribution(false, 5), (n, first) in (1..=6_usize, -3..3_isize), rate in rates(),
        inputs in inputs(),
    ) {
        let inner = WindowTransition::new(n, first, &weights, Ends::Loop).unwrap();
        let m = window(n, first, &weights, Ends::Loop).unwrap();
        let r = vec![1.0 / n as f64; n];
        let a = RestartTransition::new(inner, rate, Belief::uniform(n).unwrap()).unwrap();
        check_all(a, &restart(&m, rate, &r), &inputs, false)?;
    }

    #[test]
    fn kronecker_products(
        (exact, first, second) in any::<bool>()
            .prop_flat_map(|e| (Just(e), any_stochastic(e, 5), any_stochastic(e, 4))),
        inputs in inputs(),
    ) {
        let a = KroneckerTransition::new(sparse(&first), dense(&second)).unwrap();
        for state in 0..a.states() {
            let (i1, i2) = a.parts(state).unwrap();
            prop_assert_eq!(a.index(i1, i2), Some(state));
            prop_assert_eq!(a.first_groups().group_of(state), Some(i1));
            prop_assert_eq!(a.second_groups().group_of(state), Some(i2));
        }
        check_all(a, &kronecker(&first, &second), &inputs, exact)?;
    }

    /// Three factors, one of them with a restart and one a power: buffers nest.
    #[test]
    fn nested_products(
        (a, b, c) in (any_stochastic(false, 3), any_stochastic(false, 3), any_stochastic(false, 3)),
        (rate, exponent) in (rates(), 0..4_u32),
        inputs in inputs(),
    ) {
        let r = vec![1.0 / b.len() as f64; b.len()];
        let belief = Belief::new(r.clone()).unwrap();
        let restarted = RestartTransition::new(sparse(&b), rate, belief).unwrap();
        let within = KroneckerTransition::new(PowerTransition::new(sparse(&c), exponent), restarted);
        let all = KroneckerTransition::new(sparse(&a), within.unwrap()).unwrap();
        let m = kronecker(&a, &kronecker(&power(&c, exponent), &restart(&b, rate, &r)));
        check_all(all, &m, &inputs, false)?;
    }

    #[test]
    fn powers(m in any_stochastic(false, 6), exponent in 0..6_u32, inputs in inputs()) {
        let a = PowerTransition::new(sparse(&m), exponent);
        check_all(a, &power(&m, exponent), &inputs, exponent < 2)?;
    }

    #[test]
    fn powers_of_restarts(
        m in any_stochastic(false, 5), rate in rates(), exponent in 0..5_u32, inputs in inputs(),
    ) {
        let r = vec![1.0 / m.len() as f64; m.len()];
        let belief = Belief::new(r.clone()).unwrap();
        let inner = RestartTransition::new(sparse(&m), rate, belief).unwrap();
        let a = PowerTransition::new(inner, exponent);
        check_all(a, &power(&restart(&m, rate, &r), exponent), &inputs, false)?;
    }

    #[test]
    fn dwell_times((moves, times) in dwelling(false), inputs in inputs()) {
        let a = DwellTransition::new(sparse(&moves), &times).unwrap();
        let leaving: Vec<_> = times.iter().map(|times| hazards(times)).collect();
        check_all(a, &dwell(&moves, &leaving), &inputs, false)?;
    }

    #[test]
    fn leaving_probabilities(
        (exact, (moves, leaving)) in any::<bool>().prop_flat_map(|e| {
            let places = (1..=4_usize)
                .prop_flat_map(move |n| (stochastic(e, n), vec(vec(leaving(e), 1..4), n)));
            (Just(e), places)
        }),
        inputs in inputs(),
    ) {
        let a = DwellTransition::from_leaving(dense(&moves), &leaving).unwrap();
        // Leaving for the same place and staying may add up to no power of two.
        let sums = leaving.iter().any(|leaving| leaving.len() == 1);
        check_all(a, &dwell(&moves, &leaving), &inputs, exact && !sums)?;
    }

    /// All of them pass a control on to what is within.
    #[test]
    fn controls_reach_the_operator_within(
        (n, control, rate) in (1..=3_usize, 0..2_usize, rates()), inputs in inputs(),
        weights in [distribution(false, 4), distribution(false, 4)],
    ) {
        let gears = || {
            let gear = |w: &Vec<f64>| WindowTransition::new(n, 0, w, Ends::Stop).unwrap();
            SwitchedTransition::new(weights.iter().map(gear).collect()).unwrap()
        };
        let m = window(n, 0, &weights[control], Ends::Stop).unwrap();
        let belief = Belief::uniform(n).unwrap();
        let r = belief.as_slice().to_vec();
        let restarted = RestartTransition::new(gears(), rate, belief).unwrap();
        let leaving = vec![vec![0.25, 0.5]; n];
        let all = KroneckerTransition::new(
            PowerTransition::new(gears(), 2),
            DwellTransition::from_leaving(restarted, &leaving).unwrap(),
        ).unwrap();
        let text = all.check_control(&2).unwrap_err().to_string();
        prop_assert_eq!(text, "unknown control: operator 2, expected one of 2 (0 to 1)");
        let expected = kronecker(&power(&m, 2), &dwell(&restart(&m, rate, &r), &leaving));
        check(&all, &control, &expected, &inputs, false)?;
        check_inference(all, &control, &expected, &inputs)?;
    }

    /// Against sums over all ways to cut a drive into stays: dwell times and
    /// moves as they were given, with no hazards and no expansion.
    #[test]
    fn dwell_times_are_those_of_a_semi_markov_chain(
        ((moves, times), logs) in ((dwelling(false)), vec(vec(-3.0..0.0, 4), 1..5)),
        start in 0..4_usize,
    ) {
        let n = moves.len();
        let start = start % n;
        let b: Vec<Vec<f64>> = logs.iter().map(|logs: &Vec<f64>| logs[..n].iter().map(|l| l.exp()).collect()).collect();
        let chain = Stays { moves: &moves, times: &times, b: &b };
        let mut total = Answer { sum: 0.0, best: 0.0, at: vec![vec![0.0; n]; b.len()] };
        chain.walk(start, 0, 1.0, &mut Vec::new(), &mut total);

        let a = DwellTransition::new(sparse(&moves), &times).unwrap();
        let groups = a.groups().clone();
        let places = Belief::certain(n, start).unwrap();
        let prior = Prior::AtFirstObservation(a.arriving(&places).unwrap());
        prop_assert_eq!(prior.belief().mode(), a.arrival(start).unwrap());
        let sensor = LikelihoodVector::linear(n).owned();
        let hmm = Hmm::new(prior, a, GroupedLikelihood::new(sensor, groups.clone()).unwrap()).unwrap();
        let smoothing = hmm.smooth(&b).unwrap();
        close(smoothing.log_likelihood().exp(), total.sum, 1e-11, "sum")?;
        for (k, expected) in total.at.iter().enumerate() {
            let found = groups.marginal(&smoothing.posteriors().get(k + 1).unwrap()).unwrap();
            for (found, expected) in found.as_slice().iter().zip(expected) {
                prop_assert!((found - expected / total.sum).abs() <= 1e-11);
            }
        }
        let path = hmm.viterbi(&b).unwrap();
        close(path.log_probability().exp(), total.best, 1e-11, "best")?;
        prop_assert_eq!(groups.map_path(path.states()).unwrap()[0], start);
    }

    /// A known state is a likelihood of 0 elsewhere.
    #[test]
    fn known_states_constrain(
        m in any_stochastic(false, 4), rows in vec((vec(-5.0..0.0, 4), any::<Option<u8>>()), 1..5),
    ) {
        let n = m.len();
        let prior = Prior::BeforeFirstTransition(Belief::uniform(n).unwrap());
        let known: Vec<(Vec<f64>, Option<usize>)> = rows.iter()
            .map(|(logs, known)| (logs[..n].to_vec(), known.map(|k| usize::from(k) % n))).collect();
        let ruled: Vec<Vec<f64>> = known.iter().map(|(logs, known)| {
            let rule = |i| known.is_none_or(|known| known == i);
            logs.iter().enumerate().map(|(i, log)| if rule(i) { *log } else { NEVER }).collect()
        }).collect();
        let sensor = LikelihoodVector::log(n).owned();
        let fused = FusedLikelihood::new(sensor, KnownState::new(n)).unwrap();
        let plain = Hmm::new(prior.clone(), sparse(&m), sensor).unwrap();
        let hmm = Hmm::new(prior, sparse(&m), fused).unwrap();
        match (plain.viterbi(&ruled), hmm.viterbi(&known)) {
            (Ok(expected), Ok(found)) => {
                prop_assert_eq!(found.states(), expected.states());
                close(found.log_probability(), expected.log_probability(), 1e-12, "path")?;
                let (found, expected) = (hmm.smooth(&known).unwrap(), plain.smooth(&ruled).unwrap());
                close(found.log_likelihood(), expected.log_likelihood(), 1e-12, "likelihood")?;
            }
            (expected, found) => prop_assert!(expected.is_err() && found.is_err()),
        }
    }

    /// A table of places, lifted, is the table with its rows repeated.
    #[test]
    fn grouped_sensors_are_repeated_rows(
        of in vec(0..3_usize, 1..7), weights in vec(vec(0.01..1.0, 3), 3),
        ys in vec(0..3_usize, 1..5),
    ) {
        let of = [of, vec![2, 0, 1]].concat();
        let n = of.len();
        let scale = |w: &Vec<f64>| w.iter().map(|x| x / w.iter().sum::<f64>()).collect();
        let rows: Vec<Vec<f64>> = weights.iter().map(scale).collect();
        let repeated: Vec<_> = of.iter().map(|&g| rows[g].clone()).collect();
        let prior = Prior::AtFirstObservation(Belief::uniform(n).unwrap());
        let around = WindowTransition::new(n, 0, &[0.5, 0.5], Ends::Loop).unwrap();
        let groups = Groups::new(of).unwrap();
        let table = TableLikelihood::from_rows(&rows).unwrap();
        let grouped = Hmm::new(prior.clone(), &around, GroupedLikelihood::new(table, groups).unwrap());
        let plain = Hmm::new(prior, &around, TableLikelihood::from_rows(&repeated).unwrap());
        let (grouped, plain) = (grouped.unwrap(), plain.unwrap());
        let smoothed = [grouped.smooth(&ys).unwrap(), plain.smooth(&ys).unwrap()];
        prop_assert_eq!(smoothed[0].log_likelihood(), smoothed[1].log_likelihood());
        let [a, b] = smoothed.each_ref().map(|s| s.posteriors().as_slice());
        prop_assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-12 * b), "{:?}", smoothed);
        prop_assert_eq!(grouped.viterbi(&ys).unwrap(), plain.viterbi(&ys).unwrap());
    }
}

/// A semi-Markov chain and its observations.
struct Stays<'a> {
    moves: &'a Matrix,
    times: &'a [Vec<f64>],
    b: &'a [Vec<f64>],
}

struct Answer {
    sum: f64,
    best: f64,
    /// The joint probability of each place at each step.
    at: Vec<Vec<f64>>,
}

impl Stays<'_> {
    /// Every stay that begins in `place` after `seen` steps, and what follows.
    fn walk(&self, place: usize, seen: usize, p: f64, path: &mut Vec<usize>, total: &mut Answer) {
        let left = self.b.len() - seen;
        let times = &self.times[place];
        let b = |steps: usize| self.b[seen..seen + steps].iter().map(|b| b[place]).product::<f64>();
        // The stay that outlasts the observations, or ends with them.
        let longer: f64 = times.iter().skip(left - 1).sum();
        let whole = p * longer * b(left);
        path.resize(self.b.len(), place);
        total.sum += whole;
        total.best = total.best.max(whole);
        path.iter().zip(&mut total.at).for_each(|(&place, at)| at[place] += whole);
        for steps in 1..left {
            let stayed = p * times.get(steps - 1).copied().unwrap_or(0.0) * b(steps);
            for (next, row) in self.moves.iter().enumerate() {
                if stayed * row[place] > 0.0 {
                    path.truncate(seen);
                    path.resize(seen + steps, place);
                    self.walk(next, seen + steps, stayed * row[place], path, total);
                }
            }
        }
    }
}

fn text<T, E: ToString>(result: Result<T, E>) -> String {
    result.err().unwrap().to_string()
}

fn identity() -> SparseTransition {
    SparseTransition::from_rows(2, &[1.0, 0.0, 0.0, 1.0]).unwrap()
}

#[test]
fn leading_weights_of_0_change_no_bit() {
    let x: Vec<f64> = (0..10).map(|i| 1.0 / (3.0 + f64::from(i))).collect();
    let product = |first, weights: &[f64]| {
        let a = WindowTransition::new(10, first, weights, Ends::Loop).unwrap();
        let mut out = vec![0.0; 10];
        a.apply(&(), &x, &mut out);
        out
    };
    let leading = product(4, &[0.0, 0.0, 0.0, 0.3, 0.5, 0.2]);
    assert_eq!(leading, product(7, &[0.3, 0.5, 0.2]));
    assert_eq!(leading, product(-3, &[0.3, 0.5, 0.2]));
}

#[test]
fn bad_windows_restarts_and_pairs_are_named() {
    let window =
        |n, first, weights: &[f64], ends| text(WindowTransition::new(n, first, weights, ends));
    assert_eq!(
        window(0, 0, &[1.0], Ends::Loop),
        "a transition operator needs at least one state, found none"
    );
    assert_eq!(window(3, 0, &[], Ends::Loop), "the sum of the weights is 0, expected 1");
    assert_eq!(
        window(3, 0, &[0.5, 0.25], Ends::Stop),
        "the sum of the weights is 0.75, expected 1"
    );
    assert_eq!(
        window(3, -2, &[0.5, -0.5], Ends::Stop),
        "the weight of offset -1 is -0.5, expected a finite value of at least 0"
    );
    assert_eq!(
        window(3, 1, &[f64::NAN], Ends::Stop),
        "the weight of offset 1 is NaN, expected a finite value of at least 0"
    );
    assert_eq!(
        window(3, 1, &[1.0], Ends::Renormalise),
        "column 2 (the transitions out of state 2) sums to 0, expected 1"
    );
    assert_eq!(
        window(5_000_000_000, 1, &[1.0], Ends::Loop),
        "5000000000 states, expected at most 4294967295 (32-bit indices)"
    );

    let restart =
        |rate, n| text(RestartTransition::new(identity(), rate, Belief::uniform(n).unwrap()));
    assert_eq!(restart(1.5, 2), "the rate is 1.5, expected a value from 0 to 1");
    assert_eq!(restart(f64::NAN, 2), "the rate is NaN, expected a value from 0 to 1");
    assert_eq!(
        restart(0.5, 3),
        "the restart belief has 3 states, expected 2 as the operator within"
    );

    let long = || WindowTransition::new(100_000, 1, &[1.0], Ends::Loop).unwrap();
    assert_eq!(
        text(KroneckerTransition::new(long(), long())),
        "10000000000 states, expected at most 4294967295 (32-bit indices)"
    );
    let pairs = KroneckerTransition::new(identity(), identity()).unwrap();
    assert_eq!((pairs.index(2, 0), pairs.index(0, 2), pairs.parts(4)), (None, None, None));
}

#[test]
fn bad_dwell_times_are_named() {
    let dwell = |times: &[Vec<f64>]| text(DwellTransition::new(identity(), times));
    assert_eq!(
        dwell(&[vec![1.0]]),
        "the dwell table has 1 states, expected 2 as the operator within"
    );
    assert_eq!(
        dwell(&[vec![1.0], vec![0.5, 0.25]]),
        "the sum of the dwell times of place 1 is 0.75, expected 1"
    );
    assert_eq!(
        dwell(&[vec![], vec![1.0]]),
        "the sum of the dwell times of place 0 is 0, expected 1"
    );
    assert_eq!(
        dwell(&[vec![1.0], vec![0.5, f64::INFINITY]]),
        "the probability of 2 steps in place 1 is inf, expected a finite value of at least 0"
    );
    let leaving = |leaving: &[Vec<f64>]| text(DwellTransition::from_leaving(identity(), leaving));
    assert_eq!(
        leaving(&[vec![0.5], vec![]]),
        "the number of leaving probabilities of place 1 is 0, expected at least 1"
    );
    assert_eq!(
        leaving(&[vec![0.5], vec![0.5, 1.5]]),
        "the probability of leaving place 1 after 2 steps is 1.5, expected a value from 0 to 1"
    );
    let a = DwellTransition::new(identity(), &[vec![1.0], vec![0.5, 0.5]]).unwrap();
    assert_eq!((a.arrival(1), a.arrival(2)), (Some(1), None));
    assert_eq!(
        text(a.arriving(&Belief::uniform(3).unwrap())),
        "the belief has 3 states, expected 2"
    );
}

#[test]
fn bad_groups_and_unknown_states_are_named() {
    assert_eq!(text(Groups::new(vec![])), "groups need at least one state, found none");
    assert_eq!(
        text(Groups::new(vec![0, 2, 2])),
        "no state is in group 1, though groups are numbered up to 2"
    );
    assert_eq!(
        text(Groups::new(vec![0, usize::MAX])),
        format!("no state is in group 1, though groups are numbered up to {}", usize::MAX)
    );
    let groups = Groups::new(vec![1, 0, 1]).unwrap();
    assert_eq!((groups.count(), groups.group_of(2), groups.group_of(3)), (2, Some(1), None));
    assert!(groups.states(1).eq([0, 2]) && groups.states(0).eq([1]) && groups.states(2).len() == 0);
    assert_eq!(
        text(groups.marginal(&Belief::uniform(2).unwrap())),
        "the belief has 2 states, expected 3"
    );
    assert_eq!(
        text(groups.map_path(&[0, 3])),
        "state 3 does not exist, 3 states are grouped (0 to 2)"
    );
    assert_eq!(
        text(GroupedLikelihood::new(KnownState::new(3), groups.clone())),
        "the sensor has 3 states, expected 2 as the number of groups"
    );

    let prior = || Prior::AtFirstObservation(Belief::uniform(2).unwrap());
    let hmm = Hmm::new(prior(), identity(), KnownState::new(2)).unwrap();
    let error = hmm.smooth(&[None, Some(2)]).unwrap_err();
    let source = std::error::Error::source(&error).unwrap().to_string();
    assert_eq!(source, "state 2 is given as known, but there are 2 states (0 to 1)");
    // A vector of a wrong length is found before it is spread over the states.
    let groups = Groups::new(vec![0, 0]).unwrap();
    let vector = GroupedLikelihood::new(LikelihoodVector::linear(1), groups).unwrap();
    let error =
        Hmm::new(prior(), identity(), vector).unwrap().filter().step(&[0.5; 3]).unwrap_err();
    let source = std::error::Error::source(&error).unwrap().to_string();
    assert_eq!(source, "the likelihood has 3 values, expected one for each of 1 states");
}

#[test]
fn long_routes_go_block_by_block() {
    let n = 5000;
    let x: Vec<f64> = (0..n).map(|i| (f64::from(i) * 0.618_033_988_749_894_9).fract()).collect();
    let (mut out, mut back, mut from) = (x.clone(), x.clone(), vec![0; x.len()]);
    for (first, ends) in [(-3, Ends::Loop), (-1, Ends::Stop), (0, Ends::Renormalise)] {
        let a = WindowTransition::new(x.len(), first, &[0.125, 0.0, 0.5, 0.375], ends).unwrap();
        a.apply(&(), &x, &mut out);
        a.apply_transpose(&(), &x, &mut back);
        for (i, (out, back)) in out.iter().zip(&back).enumerate() {
            let into: f64 = a.incoming(&(), i).map(|(j, p)| p * x[j]).sum();
            let outof: f64 = a.outgoing(&(), i).map(|(j, p)| p * x[j]).sum();
            assert!((out - into).abs() < 1e-14 && (back - outof).abs() < 1e-14, "{ends:?} {i}");
        }
        a.max_product(&(), &x, &mut out, &mut from);
        for (i, out) in out.iter().enumerate() {
            let score = |(j, p): (usize, f64)| p.log2() + x[j];
            let best = a.incoming(&(), i).map(score).fold(NEVER, f64::max);
            assert!(best == *out || (best - out).abs() < 1e-12, "{ends:?} {i}");
        }
    }
}

#[test]
fn windows_far_beyond_the_route_are_none_the_worse() {
    for ends in [Ends::Loop, Ends::Stop] {
        for first in [isize::MIN, -1_000_000_007, 1_000_000_007, isize::MAX] {
            let a = WindowTransition::new(3, first, &[0.25, 0.75], ends).unwrap();
            let mut out = [0.0; 3];
            a.apply(&(), &[0.25, 0.25, 0.5], &mut out);
            assert_eq!(out.iter().sum::<f64>(), 1.0, "{ends:?} {first}");
        }
    }
}

#[test]
fn simulations_stay_as_long_as_they_should() {
    use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
    let moves = SparseTransition::from_rows(2, &[0.0, 1.0, 1.0, 0.0]).unwrap();
    let a = DwellTransition::new(moves, &[vec![0.0, 0.0, 1.0], vec![1.0]]).unwrap();
    let prior = Prior::AtFirstObservation(a.arriving(&Belief::certain(2, 0).unwrap()).unwrap());
    let groups = a.groups().clone();
    let camera = TableLikelihood::from_rows(&[[1.0, 0.0], [0.0, 1.0]]).unwrap();
    let sensor = GroupedLikelihood::new(camera, groups.clone()).unwrap();
    let both = FusedLikelihood::new(sensor, KnownState::new(4)).unwrap();
    let drive = Hmm::new(prior, a, both).unwrap().simulate(8, &mut ChaCha8Rng::seed_from_u64(1));
    let places = [0, 0, 0, 1, 0, 0, 0, 1];
    assert_eq!(groups.map_path(drive.states()).unwrap(), places);
    assert_eq!(drive.observations(), places.map(|place| (place, None)));
}
