//! Operators of places (off the map, by distance, pooled images) against dense
//! matrices and plain loops that are written here anew.

use std::fmt::Debug;

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::{
    Belief, Controlled, DenseTransition, Diagonal, DistanceTransition, DwellTransition,
    FusedLikelihood, GroupedLikelihood, Groups, Hmm, InferenceError, KroneckerTransition,
    Likelihood, LikelihoodError, LikelihoodVector, Odometry, OffMapTransition, OptionalLikelihood,
    PooledLikelihood, PowerTransition, Prior, RestartTransition, RoundedTails, SampleObservation,
    Scratch, SparseTransition, SwitchedTransition, TableLikelihood, Transition, TransitionEntries,
};

/// `matrix[to][from]`.
type Matrix = Vec<Vec<f64>>;

const NEVER: f64 = f64::NEG_INFINITY;

fn matrix(n: usize, entry: impl Fn(usize, usize) -> f64) -> Matrix {
    (0..n).map(|i| (0..n).map(|j| entry(i, j)).collect()).collect()
}

fn sparse(m: &Matrix) -> SparseTransition {
    SparseTransition::from_rows(m.len(), &m.concat()).unwrap()
}

fn dense(m: &Matrix) -> DenseTransition {
    DenseTransition::from_rows(m.len(), &m.concat()).unwrap()
}

fn switched(matrices: &[Matrix]) -> SwitchedTransition<SparseTransition> {
    SwitchedTransition::new(matrices.iter().map(sparse).collect()).unwrap()
}

fn off_map(m: &Matrix, leave: f64, return_rate: f64, back: &[f64]) -> Matrix {
    let n = m.len();
    matrix(n + 1, |i, j| match (i == n, j == n) {
        (false, false) => (1.0 - leave) * m[i][j],
        (true, false) => leave,
        (false, true) => return_rate * back[i],
        (true, true) => 1.0 - return_rate,
    })
}

fn restart(m: &Matrix, rate: f64, r: &[f64]) -> Matrix {
    matrix(m.len(), |i, j| (1.0 - rate) * m[i][j] + rate * r[i])
}

fn kronecker(a: &Matrix, b: &Matrix) -> Matrix {
    let n2 = b.len();
    matrix(a.len() * n2, |i, j| a[i / n2][j / n2] * b[i % n2][j % n2])
}

fn squared(m: &Matrix) -> Matrix {
    matrix(m.len(), |i, j| (0..m.len()).map(|k| m[i][k] * m[k][j]).sum())
}

/// With states (place, age) of two ages each, left with these probabilities.
fn dwell(m: &Matrix, leaving: [f64; 2]) -> Matrix {
    matrix(2 * m.len(), |to, from| {
        let leave = leaving[from % 2];
        let arrives = if to % 2 == 0 { leave * m[to / 2][from / 2] } else { 0.0 };
        let stays = to % 2 == 1 && to / 2 == from / 2;
        arrives + if stays { 1.0 - leave } else { 0.0 }
    })
}

/// What operators are tried on, for up to so many states.
const MOST: usize = 24;

/// Numbers, logarithms and whole scores, which tie.
#[derive(Debug, Clone)]
struct Inputs {
    numbers: Vec<f64>,
    logs: Vec<f64>,
    scores: Vec<f64>,
}

fn inputs() -> impl Strategy<Value = Inputs> {
    let number = prop_oneof![1 => Just(0.0), 3 => 0.0..1.0];
    let log = prop_oneof![1 => Just(NEVER), 2 => -2000.0..2000.0, 2 => -3.0..0.0];
    let score = prop_oneof![1 => Just(NEVER), 4 => (-2..3_i32).prop_map(f64::from)];
    (vec(number, MOST), vec(log, MOST), vec(score, MOST))
        .prop_map(|(numbers, logs, scores)| Inputs { numbers, logs, scores })
}

/// `count` probabilities; if `exact` powers of two, with exact logarithms.
fn distribution(exact: bool, count: usize) -> BoxedStrategy<Vec<f64>> {
    if exact {
        // 1/2, 1/4, … for as many as are drawn, the rest 0, in any order.
        let halves = move |kept: usize| {
            let share = |k: usize| 0.5_f64.powi((k + 1).min(kept - 1).try_into().unwrap());
            (0..count).map(|k| if k < kept { share(k) } else { 0.0 }).collect::<Vec<f64>>()
        };
        return (1..=count).prop_map(halves).prop_shuffle().boxed();
    }
    let weight = prop_oneof![1 => Just(0.0), 3 => 0.01..1.0];
    let scaled = |(mut weights, spare): (Vec<f64>, usize)| {
        weights[spare] += 0.01;
        let sum: f64 = weights.iter().sum();
        weights.iter().map(|w| w / sum).collect()
    };
    (vec(weight, count), 0..count).prop_map(scaled).boxed()
}

fn stochastic(exact: bool, n: usize) -> impl Strategy<Value = Matrix> {
    vec(distribution(exact, n), n).prop_map(move |columns| matrix(n, |i, j| columns[j][i]))
}

fn rate(exact: bool) -> BoxedStrategy<f64> {
    if exact {
        prop_oneof![Just(0.0), Just(0.5), Just(1.0)].boxed()
    } else {
        prop_oneof![1 => Just(0.0), 1 => Just(1.0), 4 => 0.0..1.0].boxed()
    }
}

fn log_sum(terms: impl Iterator<Item = f64> + Clone) -> f64 {
    let largest = terms.clone().fold(NEVER, f64::max);
    if largest == NEVER {
        return NEVER;
    }
    largest + terms.map(|term| (term - largest).exp()).sum::<f64>().ln()
}

/// Equal, but for this part of it.
#[track_caller]
fn close(found: f64, expected: f64, tolerance: f64, what: &str) -> Result<(), TestCaseError> {
    let close = found == expected || (found - expected).abs() <= tolerance * expected.abs();
    prop_assert!(close, "{}: found {}, expected {}", what, found, expected);
    Ok(())
}

/// As [`close`], of logarithms: but for this part of it or of 1.
fn close_log(found: f64, expected: f64, tolerance: f64, what: &str) -> Result<(), TestCaseError> {
    let within = (found - expected).abs() <= tolerance * expected.abs().max(1.0);
    prop_assert!(found == expected || within, "{}: found {}, expected {}", what, found, expected);
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
    let mut out = vec![f64::NAN; n];
    a.apply_transpose(control, &vec![1.0; n], &mut out);
    for sum in &out {
        close(*sum, 1.0, 1e-12, "column sum")?;
    }
    let transposed = matrix(n, |i, j| m[j][i]);
    for (m, transpose) in [(m, false), (&transposed, true)] {
        let x = &inputs.numbers[..n];
        out.fill(f64::NAN);
        if transpose {
            a.apply_transpose(control, x, &mut out);
        } else {
            a.apply(control, x, &mut out);
        }
        for (found, row) in out.iter().zip(m) {
            close(*found, row.iter().zip(x).map(|(a, x)| a * x).sum(), 1e-12, "product")?;
        }
        for x in [&inputs.logs[..n], &vec![NEVER; n], &vec![-2000.0; n]] {
            out.fill(f64::NAN);
            if transpose {
                a.apply_transpose_log(control, x, &mut out);
            } else {
                a.apply_log(control, x, &mut out);
            }
            for (found, row) in out.iter().zip(m) {
                let expected = log_sum(row.iter().zip(x).map(|(a, x)| a.ln() + x));
                close_log(*found, expected, 1e-12, "product in logarithms")?;
            }
        }
        for (state, row) in m.iter().enumerate() {
            let found: Vec<_> = if transpose {
                a.outgoing(control, state).collect()
            } else {
                a.incoming(control, state).collect()
            };
            let entries = row.iter().copied().enumerate().filter(|entry| entry.1 > 0.0);
            let (states, values): (Vec<_>, Vec<_>) = entries.unzip();
            prop_assert_eq!(found.iter().map(|e| e.0).collect::<Vec<_>>(), states, "of {}", state);
            for (found, expected) in found.iter().zip(values) {
                close(found.1, expected, 1e-12, "entry")?;
            }
        }
    }
    let mut from = vec![u32::MAX; n];
    for x in [&inputs.scores[..n], &vec![0.0; n], &vec![NEVER; n]] {
        a.max_product(control, x, &mut out, &mut from);
        for (i, row) in m.iter().enumerate() {
            // As decoders that list entries do it, to the bit.
            let listed = a.incoming_log2(control, i).map(|(j, log2)| log2 + x[j]);
            let listed = listed.fold(NEVER, f64::max);
            prop_assert_eq!(out[i], listed);
            let values: Vec<f64> = row.iter().zip(x).map(|(a, x)| a.log2() + x).collect();
            let best = values.iter().copied().fold(NEVER, f64::max);
            close_log(out[i], best, 1e-12, "best")?;
            if best > NEVER {
                let named = from[i] as usize;
                prop_assert!(values[named] >= best - 1e-12, "{} of {:?}", named, values);
                if exact {
                    prop_assert_eq!(Some(named), values.iter().position(|v| *v >= best - 1e-12));
                }
            }
        }
    }
    Ok(())
}

/// All routines with the operator as with its matrices, one for each step.
fn check_model<A>(
    a: A,
    controls: &[A::Control],
    matrices: &[Matrix],
    inputs: &Inputs,
    exact: bool,
) -> Result<(), TestCaseError>
where
    A: TransitionEntries<Control: Clone>,
{
    let n = a.states();
    let prior = Prior::BeforeFirstTransition(Belief::uniform(n).unwrap());
    let sensor = LikelihoodVector::log(n).owned();
    let family = SwitchedTransition::new(matrices.iter().map(dense).collect()).unwrap();
    let reference = Hmm::new(prior.clone(), family, sensor).unwrap();
    let hmm = Hmm::new(prior, a, sensor).unwrap();
    let ys: Vec<Vec<f64>> = (0..controls.len())
        .map(|k| if k % 2 == 0 { &inputs.scores } else { &inputs.logs })
        .map(|x| x[..n].to_vec())
        .collect();
    let numbers: Vec<usize> = (0..controls.len()).collect();
    let plain = Controlled::new(&numbers, &ys).unwrap();
    let drive = Controlled::new(controls, &ys).unwrap();
    let Ok(expected) = reference.smooth(&plain) else {
        prop_assert!(hmm.smooth(&drive).is_err());
        prop_assert!(hmm.score(&drive).is_err());
        prop_assert!(hmm.viterbi(&drive).is_err());
        return Ok(());
    };
    let found = hmm.smooth(&drive).unwrap();
    let log = expected.log_likelihood();
    close_log(found.log_likelihood(), log, 1e-11, "log-likelihood")?;
    close_log(hmm.score(&drive).unwrap(), log, 1e-11, "score")?;
    let posteriors = found.posteriors().as_slice().iter().zip(expected.posteriors().as_slice());
    for (found, expected) in posteriors {
        close_log(*found, *expected, 1e-10, "posterior")?;
    }
    let (mut lagged, mut online) = (hmm.fixed_lag(2), hmm.online_viterbi());
    let mut other = reference.fixed_lag(2);
    let mut states = Vec::new();
    for (k, (control, y)) in controls.iter().zip(&ys).enumerate() {
        lagged.step_with(control, y).unwrap();
        other.step_with(&k, y).unwrap();
        for (found, expected) in lagged.lagged().as_slice().iter().zip(other.lagged().as_slice()) {
            close_log(*found, *expected, 1e-10, "fixed lag")?;
        }
        states.extend_from_slice(online.step_with(control, y).unwrap());
    }
    states.extend(online.undecided());
    let (path, best) = (hmm.viterbi(&drive).unwrap(), reference.viterbi(&plain).unwrap());
    prop_assert_eq!(&states[..], path.states());
    close_log(path.log_probability(), best.log_probability(), 1e-11, "path")?;
    if exact {
        prop_assert_eq!(path.states(), best.states());
    }
    for (k, pair) in path.states().windows(2).enumerate() {
        prop_assert!(matrices[k + 1][pair[1]][pair[0]] > 0.0, "a move that there is not");
    }
    let first = hmm.k_best(&drive, 3).unwrap()[0].log_probability();
    close_log(first, path.log_probability(), 1e-11, "first of the best")?;
    let entropy = reference.path_entropy(&plain).unwrap();
    close_log(hmm.path_entropy(&drive).unwrap(), entropy, 1e-9, "entropy")?;
    let (moves, others) =
        (hmm.expected_moves(&drive).unwrap(), reference.expected_moves(&plain).unwrap());
    for at in 0..n * n {
        let (to, from) = (at / n, at % n);
        close_log(moves.get(to, from), others.get(to, from), 1e-9, "expected moves")?;
    }
    Ok(())
}

/// Each method for each matrix, and a model of all of them.
fn check_all<A: TransitionEntries<Control: Clone + Debug>>(
    a: A,
    controls: &[A::Control],
    matrices: &[Matrix],
    inputs: &Inputs,
    exact: bool,
) -> Result<(), TestCaseError> {
    for (control, m) in controls.iter().zip(matrices) {
        check(&a, control, m, inputs, exact)?;
    }
    check_model(a, controls, matrices, inputs, exact)
}

fn cases() -> ProptestConfig {
    ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(1000) }
}

/// Three matrices of a size, and a distribution.
fn motion(exact: bool, most: usize) -> impl Strategy<Value = (Vec<Matrix>, Vec<f64>)> {
    (1..=most).prop_flat_map(move |n| (vec(stochastic(exact, n), 3), distribution(exact, n)))
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn off_map_is_its_matrix(
        (exact, (matrices, back), leave, return_rate) in any::<bool>()
            .prop_flat_map(|e| (Just(e), motion(e, 6), rate(e), rate(e))),
        inputs in inputs(),
    ) {
        let whole = |m: &Matrix| off_map(m, leave, return_rate, &back);
        let expected: Vec<Matrix> = matrices.iter().map(whole).collect();
        let belief = || Belief::new(back.clone()).unwrap();
        let plain =
            OffMapTransition::new(sparse(&matrices[0]), leave, return_rate, belief()).unwrap();
        prop_assert_eq!(plain.off_map_state(), back.len());
        check_all(plain, &[(); 3], &vec![expected[0].clone(); 3], &inputs, exact)?;
        // Each gear has its own control; a fourth there is not.
        let geared =
            OffMapTransition::new(switched(&matrices), leave, return_rate, belief()).unwrap();
        prop_assert_eq!(
            geared.check_control(&3).unwrap_err().to_string(),
            "unknown control: operator 3, expected one of 3 (0 to 2)"
        );
        check_all(geared, &[0, 1, 2], &expected, &inputs, exact)?;
    }

    /// Within others and around them: what they hand down need not be the
    /// whole vector.
    #[test]
    fn off_map_nests(
        ((matrices, back), (leave, return_rate, again)) in
            (motion(false, 3), (rate(false), rate(false), rate(false))),
        (turns, inputs) in (stochastic(false, 2), inputs()),
    ) {
        let n = back.len();
        let belief = Belief::new(back.clone()).unwrap();
        let lost = || {
            OffMapTransition::new(switched(&matrices), leave, return_rate, belief.clone()).unwrap()
        };
        let whole: Vec<Matrix> =
            matrices.iter().map(|m| off_map(m, leave, return_rate, &back)).collect();
        let over = |map: &dyn Fn(&Matrix) -> Matrix| whole.iter().map(map).collect::<Vec<_>>();
        let controls = [0, 1, 2];
        let uniform = |n: usize| Belief::uniform(n).unwrap();
        let even = |n: usize| vec![1.0 / n as f64; n];

        let a = RestartTransition::new(lost(), again, uniform(n + 1)).unwrap();
        let expected = over(&|m| restart(m, again, &even(n + 1)));
        check_all(a, &controls, &expected, &inputs, false)?;
        let a = OffMapTransition::new(lost(), again, 0.25, uniform(n + 1)).unwrap();
        let expected = over(&|m| off_map(m, again, 0.25, &even(n + 1)));
        check_all(a, &controls, &expected, &inputs, false)?;
        let a = KroneckerTransition::new(lost(), switched(&vec![turns.clone(); 3])).unwrap();
        let expected = over(&|m| kronecker(m, &turns));
        check_all(a, &controls, &expected, &inputs, false)?;
        let pairs =
            KroneckerTransition::new(switched(&vec![turns.clone(); 3]), lost()).unwrap();
        let a = OffMapTransition::new(pairs, again, 0.5, uniform(2 * n + 2)).unwrap();
        let expected = over(&|m| off_map(&kronecker(&turns, m), again, 0.5, &even(2 * n + 2)));
        check_all(a, &controls, &expected, &inputs, false)?;
        let expected = over(&squared);
        check_all(PowerTransition::new(lost(), 2), &controls, &expected, &inputs, false)?;
        let a = DwellTransition::from_leaving(lost(), &vec![[again, 1.0]; n + 1]).unwrap();
        let expected = over(&|m| dwell(m, [again, 1.0]));
        check_all(a, &controls, &expected, &inputs, false)?;
    }

    /// Gear × place, of which the camera sees the place, or that it is none.
    #[test]
    fn a_camera_sees_place_or_none(
        (gears, places) in (stochastic(false, 2), stochastic(false, 3)),
        (leave, return_rate) in (rate(false), rate(false)),
        ys in vec(vec(-3.0..0.0, 4), 1..5),
    ) {
        let pairs = KroneckerTransition::new(sparse(&gears), sparse(&places)).unwrap();
        let seen = pairs.second_groups();
        let back = vec![1.0 / 6.0; 6];
        let m = off_map(&kronecker(&gears, &places), leave, return_rate, &back);
        let a = OffMapTransition::new(pairs, leave, return_rate, Belief::uniform(6).unwrap());
        let a = a.unwrap();
        let groups = a.groups(&seen).unwrap();
        prop_assert_eq!(groups.as_slice(), [0, 1, 2, 0, 1, 2, 3]);
        let sensor = GroupedLikelihood::new(LikelihoodVector::log(4).owned(), groups).unwrap();
        let prior = Prior::AtFirstObservation(Belief::uniform(7).unwrap());
        let hmm = Hmm::new(prior.clone(), a, sensor).unwrap();
        let plain = Hmm::new(prior, dense(&m), LikelihoodVector::log(7).owned()).unwrap();
        let of = [0, 1, 2, 0, 1, 2, 3];
        let all: Vec<Vec<f64>> =
            ys.iter().map(|y: &Vec<f64>| of.iter().map(|&g| y[g]).collect()).collect();
        close_log(hmm.score(&ys).unwrap(), plain.score(&all).unwrap(), 1e-12, "score")?;
        let (path, best) = (hmm.viterbi(&ys).unwrap(), plain.viterbi(&all).unwrap());
        close_log(path.log_probability(), best.log_probability(), 1e-12, "path")?;
    }
}

/// By the formula, with the least of the exponents taken out of all.
fn by_distance(m: &Matrix, lengths: &Matrix, odometry: Option<Odometry>) -> Matrix {
    let Some(Odometry { distance, variance }) = odometry else { return m.clone() };
    let n = m.len();
    let column = |j: usize| -> Vec<f64> {
        let squares = (0..n).map(|i| {
            if m[i][j] > 0.0 { (distance - lengths[i][j]).powi(2) } else { f64::INFINITY }
        });
        let squares: Vec<f64> = squares.collect();
        let least = squares.iter().copied().fold(f64::INFINITY, f64::min);
        let log = |i: usize| match squares[i] - least {
            0.0 => m[i][j].ln(),
            more => m[i][j].ln() - more / (2.0 * variance),
        };
        let sum = log_sum((0..n).map(log));
        let top = (0..n).map(log).fold(NEVER, f64::max);
        let p = (0..n).map(|i| (log(i) - top).exp() / (sum - top).exp());
        p.map(|p| if p < f64::MIN_POSITIVE { 0.0 } else { p }).collect()
    };
    let columns: Vec<Vec<f64>> = (0..n).map(column).collect();
    matrix(n, |i, j| columns[j][i])
}

/// A base, the length of each move, and what three steps have driven. Lengths
/// are whole quarters and variances powers of two, 2^least or more, so that
/// squares are exact. If it is `exact`, all ways out of a place are alike, and variances are 0.
fn road_network(
    exact: bool,
    most: usize,
    least: i32,
) -> impl Strategy<Value = (Matrix, Matrix, Vec<Option<Odometry>>)> {
    let quarters = |n: i32| (0..n).prop_map(|quarters| 0.25 * f64::from(quarters));
    let variance = move || {
        let spread = (least..14_i32).prop_map(|power| 2.0_f64.powi(power));
        if exact { Just(0.0).boxed() } else { prop_oneof![1 => Just(0.0), 5 => spread].boxed() }
    };
    let odometry = move || {
        (quarters(1000), variance())
            .prop_map(|(distance, variance)| Odometry { distance: distance - 25.0, variance })
    };
    let alike = |mut m: Matrix| {
        for j in 0..m.len() {
            let ways = m.iter().filter(|row| row[j] > 0.0).count();
            m.iter_mut()
                .for_each(|row| row[j] = if row[j] > 0.0 { 1.0 / ways as f64 } else { 0.0 });
        }
        m
    };
    (1..=most).prop_flat_map(move |n| {
        let base = stochastic(false, n).prop_map(move |m| if exact { alike(m) } else { m });
        let length = prop_oneof![1 => Just(0.0), 1 => Just(100.0), 2 => quarters(800)];
        let controls = (odometry(), odometry(), any::<bool>());
        let controls =
            controls.prop_map(|(a, b, none)| vec![Some(a), (!none).then_some(b), Some(b)]);
        (base, vec(vec(length, n), n), controls)
    })
}

fn on_roads(m: &Matrix, lengths: &Matrix) -> DistanceTransition {
    DistanceTransition::new(sparse(m), |to, from| lengths[to][from]).unwrap()
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn by_distance_is_its_matrix(
        (exact, (m, lengths, controls)) in
            any::<bool>().prop_flat_map(|e| (Just(e), road_network(e, 7, -6))),
        inputs in inputs(),
    ) {
        let a = on_roads(&m, &lengths);
        for (i, j) in (0..49).map(|at| (at / 7, at % 7)) {
            let there = i < m.len() && j < m.len() && m[i][j] > 0.0;
            prop_assert_eq!(a.length(i, j), there.then(|| lengths[i][j]));
        }
        let expected: Vec<Matrix> = controls.iter().map(|u| by_distance(&m, &lengths, *u)).collect();
        check_all(a, &controls, &expected, &inputs, exact)?;
    }

    /// Lengths so alike on either side of the distance that rounding decides.
    #[test]
    fn lengths_that_differ_by_a_bit_give_distributions(
        (distance, off) in (0.0..1000.0, prop_oneof![0.0..1e-9, 0.0..500.0]),
        sides in vec((any::<bool>(), -3..4_i64), 1..8),
        variance in prop_oneof![Just(0.0), Just(5e-324), Just(1e-30), Just(1e-12)],
    ) {
        let nudged = |x: f64, bits: i64| f64::from_bits(x.to_bits().saturating_add_signed(bits));
        let length = |(up, bits): &(bool, i64)| {
            nudged(if *up { distance + off } else { f64::abs(distance - off) }, *bits)
        };
        let lengths: Vec<f64> = sides.iter().map(length).collect();
        let found = ways(&fork(&lengths), distance, variance);
        close(found.iter().map(|way| way.1).sum(), 1.0, 1e-14, "sum")?;
        // Whatever is there without variance is the nearest, but for a bit.
        let far = |length: &f64| (length - distance).abs();
        let least = lengths.iter().map(far).fold(f64::INFINITY, f64::min);
        for (to, _) in found.iter().filter(|_| variance == 0.0) {
            prop_assert!(far(&lengths[to - 1]) <= least + 1e-15 * (distance + off), "{:?}", found);
        }
    }

    /// Its listed entries are those that its products have, to the bit.
    #[test]
    fn listed_entries_are_those_of_products((m, lengths, controls) in road_network(false, 6, -6)) {
        let a = on_roads(&m, &lengths);
        let n = m.len();
        for control in &controls {
            for j in 0..n {
                let (mut unit, mut column) = (vec![0.0; n], vec![0.0; n]);
                unit[j] = 1.0;
                a.apply(control, &unit, &mut column);
                let listed: Vec<_> = a.outgoing(control, j).collect();
                let entries = column.into_iter().enumerate().filter(|entry| entry.1 > 0.0);
                prop_assert_eq!(&entries.collect::<Vec<_>>(), &listed);
                for (i, p) in listed {
                    prop_assert_eq!(a.incoming(control, i).find(|e| e.0 == j), Some((j, p)));
                }
            }
        }
    }

    #[test]
    fn by_distance_nests(
        (m, lengths, controls) in road_network(false, 3, 9),
        (one, other, inputs) in (rate(false), rate(false), inputs()),
    ) {
        let n = m.len();
        let a = || on_roads(&m, &lengths);
        let uniform = Belief::uniform(n).unwrap();
        let even = vec![1.0 / n as f64; n];
        let driven: Vec<Matrix> = controls.iter().map(|u| by_distance(&m, &lengths, *u)).collect();
        let over = |map: &dyn Fn(&Matrix) -> Matrix| driven.iter().map(map).collect::<Vec<_>>();

        let lost = || OffMapTransition::new(a(), one, other, uniform.clone()).unwrap();
        let off = |m: &Matrix| off_map(m, one, other, &even);
        check_all(lost(), &controls, &over(&off), &inputs, false)?;
        let towed = RestartTransition::new(a(), one, uniform.clone()).unwrap();
        check_all(towed, &controls, &over(&|m| restart(m, one, &even)), &inputs, false)?;
        let pairs = KroneckerTransition::new(a(), lost()).unwrap();
        check_all(pairs, &controls, &over(&|m| kronecker(m, &off(m))), &inputs, false)?;
        let twice = PowerTransition::new(a(), 2);
        check_all(twice, &controls, &over(&squared), &inputs, false)?;
        let slow = DwellTransition::from_leaving(a(), &vec![[other, 1.0]; n]).unwrap();
        check_all(slow, &controls, &over(&|m| dwell(m, [other, 1.0])), &inputs, false)?;
    }
}

/// Ways from state 0 of these lengths, to states 1, 2, …, all alike.
fn fork(lengths: &[f64]) -> DistanceTransition {
    let (n, p) = (lengths.len() + 1, 1.0 / lengths.len() as f64);
    let ways = (1..n).flat_map(|i| [(i, 0, p), (i, i, 1.0)]);
    let base = SparseTransition::from_triplets(n, ways).unwrap();
    DistanceTransition::new(base, |to, from| if from == 0 { lengths[to - 1] } else { 0.0 }).unwrap()
}

fn ways(a: &DistanceTransition, distance: f64, variance: f64) -> Vec<(usize, f64)> {
    let control = Some(Odometry { distance, variance });
    a.check_control(&control).unwrap();
    a.outgoing(&control, 0).collect()
}

#[test]
fn the_nearest_length_takes_all_without_variance() {
    let a = fork(&[0.0, 100.0, 100.0, 250.0]);
    assert_eq!(ways(&a, 0.0, 0.0), [(1, 1.0)]);
    assert_eq!(ways(&a, -1e300, 0.0), [(1, 1.0)]);
    assert_eq!(ways(&a, 49.9, 0.0), [(1, 1.0)]);
    assert_eq!(ways(&a, 50.0, 0.0), [(1, 1.0 / 3.0), (2, 1.0 / 3.0), (3, 1.0 / 3.0)]);
    assert_eq!(ways(&a, 50.1, 0.0), [(2, 0.5), (3, 0.5)]);
    assert_eq!(ways(&a, 175.0, 0.0), [(2, 1.0 / 3.0), (3, 1.0 / 3.0), (4, 1.0 / 3.0)]);
    assert_eq!(ways(&a, 1e300, 0.0), [(4, 1.0)]);
}

#[test]
fn far_off_distances_keep_their_digits() {
    // Squares near 1e12 differ by 2^-10 (2e6 − 200), which the formula loses.
    let gap = 2.0_f64.powi(-10);
    let a = fork(&[100.0, 100.0 + gap]);
    let found = ways(&a, 1e6, 1024.0);
    let exponent = gap * (2e6 - 200.0 - gap) / 2048.0;
    assert!((found[1].1 / found[0].1 / exponent.exp() - 1.0).abs() < 1e-14, "{found:?}");
}

#[test]
fn numbers_at_the_limits_give_distributions() {
    let extremes = [0.0, 5e-324, 1e-308, 1e-160, 1.0, 1e160, 1e300, f64::MAX];
    let a = fork(&extremes);
    let n = a.states();
    let (mut out, mut from) = (vec![0.0; n], vec![0; n]);
    for distance in extremes.iter().flat_map(|d| [*d, -d]) {
        for variance in extremes {
            let control = Some(Odometry { distance, variance });
            a.check_control(&control).unwrap();
            a.apply_transpose(&control, &vec![1.0; n], &mut out);
            assert!(out.iter().all(|sum| (sum - 1.0).abs() < 1e-14), "{control:?}: {out:?}");
            a.apply(&control, &vec![1.0; n], &mut out);
            assert!((out.iter().sum::<f64>() - n as f64).abs() < 1e-13, "{control:?}: {out:?}");
            a.max_product(&control, &vec![0.0; n], &mut out, &mut from);
            assert!(out.iter().all(|best| *best <= 0.0), "{control:?}: {out:?}");
        }
    }
}

/// A camera that sees nothing, and two ways to the same end.
#[test]
fn odometry_tells_ways_apart() {
    // From 0 by 1 (100 m, 300 m) or by 2 (300 m, 100 m) to 3, and on to itself.
    let base = [(1, 0, 0.5), (2, 0, 0.5), (3, 1, 1.0), (3, 2, 1.0), (3, 3, 1.0)];
    let base = SparseTransition::from_triplets(4, base).unwrap();
    let metres = |to: usize, from: usize| match (from, to) {
        (0, 1) | (2, 3) => 100.0,
        (0, 2) | (1, 3) => 300.0,
        _ => 0.0,
    };
    let a = DistanceTransition::new(base, metres).unwrap();
    let prior = Prior::AtFirstObservation(Belief::certain(4, 0).unwrap());
    let hmm = Hmm::new(prior, a, LikelihoodVector::linear(4).owned()).unwrap();
    let seen = vec![vec![1.0; 4]; 3];
    let metres = |distance| Some(Odometry { distance, variance: 900.0 });
    for (driven, path) in [(120.0, [0, 1, 3]), (270.0, [0, 2, 3]), (200.0, [0, 1, 3])] {
        let controls = [None, metres(driven), None];
        let drive = Controlled::new(&controls, &seen).unwrap();
        assert_eq!(hmm.viterbi(&drive).unwrap().states(), path);
        let smoothed = hmm.smooth(&drive).unwrap();
        let odds = ((driven - 300.0).powi(2) - (driven - 100.0).powi(2)) / 1800.0;
        let p = 1.0 / (1.0 + (-odds).exp());
        assert!((smoothed.posteriors().get(2).unwrap().as_slice()[1] - p).abs() < 1e-14);
    }
}

#[test]
fn bad_lengths_and_odometry_are_named() {
    let new = |length: f64| {
        text(DistanceTransition::new(still(2), |to, _| if to == 1 { length } else { 0.0 }))
    };
    let length = |value: &str| {
        format!(
            "the length of the transition from state 1 to state 1 is {value}, expected a finite value of at least 0"
        )
    };
    assert_eq!(new(f64::NAN), length("NaN"));
    assert_eq!(new(-1.0), length("-1"));
    assert_eq!(new(f64::INFINITY), length("inf"));

    let a = fork(&[100.0]);
    let control =
        |distance, variance| text(a.check_control(&Some(Odometry { distance, variance })));
    let distance = |value: &str| {
        format!("unknown control: an odometry distance of {value}, expected a finite value")
    };
    assert_eq!(control(f64::NAN, 1.0), distance("NaN"));
    assert_eq!(control(f64::NEG_INFINITY, 1.0), distance("-inf"));
    let variance = |value: &str| {
        format!(
            "unknown control: an odometry variance of {value}, expected a finite value of at least 0"
        )
    };
    assert_eq!(control(1.0, f64::NAN), variance("NaN"));
    assert_eq!(control(1.0, -0.5), variance("-0.5"));
    assert_eq!(control(1.0, f64::INFINITY), variance("inf"));
    assert!(a.check_control(&None).is_ok());

    let map = wayfix::canberra::map();
    assert_eq!(
        text(DistanceTransition::on_map(&map, still(2))),
        "the map has 105 states, expected 2 as the operator within"
    );
    let jump = (0..105).map(|i| (if i == 7 { 90 } else { i }, i, 1.0));
    let jump = SparseTransition::from_triplets(105, jump).unwrap();
    assert_eq!(
        text(DistanceTransition::on_map(&map, jump)),
        "the number of roads from state 7 to state 90 is 0, expected 1, since there is such a transition"
    );
}

#[test]
fn on_a_map_lengths_are_those_of_roads() {
    let map = wayfix::canberra::map();
    let turning = wayfix::canberra::turning().into_transition();
    let a = DistanceTransition::on_map(&map, turning).unwrap();
    for from in 0..map.places().len() {
        assert_eq!(a.length(from, from), Some(0.0));
        for (to, road) in map.roads_from(from) {
            assert_eq!(a.length(to, from), Some(road.metres));
        }
    }
    assert_eq!((a.length(0, 105), a.length(105, 0)), (None, None));
}

/// ln of the mean of numbers that are given as logarithms.
fn log_mean(logs: &[f64]) -> f64 {
    log_sum(logs.iter().copied()) - (logs.len() as f64).ln()
}

/// The place of each of some images; all of 0 … 2 have one at least.
fn albums() -> impl Strategy<Value = Vec<usize>> {
    vec(0..3_usize, 0..7).prop_map(|more| [more, vec![2, 0, 1]].concat()).prop_shuffle()
}

/// Logarithms of likelihoods, among them some far off.
fn log_likelihoods() -> impl Strategy<Value = Vec<f64>> {
    let log = prop_oneof![1 => Just(NEVER), 2 => -2000.0..2000.0, 4 => -3.0..0.0];
    let none = Just(vec![NEVER; 9]);
    prop_oneof![1 => none, 9 => vec(log, 9)]
}

/// A sensor that takes a common factor out of the logarithms that it is given,
/// or out of numbers.
struct Scaled {
    states: usize,
    log: bool,
}

impl Likelihood for Scaled {
    type Observation = (Vec<f64>, f64);

    fn states(&self) -> usize {
        self.states
    }

    fn diagonal<'a>(
        &'a self,
        (values, log_factor): &'a (Vec<f64>, f64),
        _: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        let diagonal = if self.log { Diagonal::log(values) } else { Diagonal::linear(values) };
        Ok(diagonal.with_log_factor(*log_factor))
    }
}

/// ln b of each place, −∞ where it is ruled out, as a model finds it.
fn found_logs<B: Likelihood>(sensor: &B, y: &B::Observation) -> Vec<f64> {
    let n = sensor.states();
    let log = |place: usize| {
        let prior = Prior::AtFirstObservation(Belief::certain(n, place).unwrap());
        let hmm = Hmm::new(prior, still(n), sensor).unwrap();
        let mut filter = hmm.filter();
        match filter.step(y) {
            Ok(_) => filter.log_likelihood(),
            Err(InferenceError::Impossible { step: 1 }) => NEVER,
            Err(error) => panic!("{error}"),
        }
    };
    (0..n).map(log).collect()
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn pooled_likelihoods_are_means(
        places in albums(), logs in log_likelihoods(), log_factor in -50.0..50.0,
    ) {
        let logs = &logs[..places.len()];
        let mean = |place| {
            let of: Vec<f64> =
                logs.iter().zip(&places).filter(|e| *e.1 == place).map(|e| *e.0).collect();
            log_mean(&of) + log_factor
        };
        let groups = Groups::new(places.clone()).unwrap();
        let states = logs.len();
        let sensor = PooledLikelihood::new(Scaled { states, log: true }, groups.clone()).unwrap();
        prop_assert_eq!(sensor.states(), 3);
        let found = found_logs(&sensor, &(logs.to_vec(), log_factor));
        for (place, found) in found.iter().enumerate() {
            close_log(*found, mean(place), 1e-12, "logarithm")?;
        }
        // The same as numbers, as far as doubles hold them.
        if logs.iter().all(|log| *log == NEVER || log.abs() < 700.0) {
            let sensor = PooledLikelihood::new(Scaled { states, log: false }, groups).unwrap();
            let numbers = logs.iter().map(|log| log.exp()).collect();
            let found = found_logs(&sensor, &(numbers, log_factor));
            for (place, found) in found.iter().enumerate() {
                close_log(*found, mean(place), 1e-12, "number")?;
            }
        }
    }

    /// Whole models, with a table and with logarithms, against the means.
    #[test]
    fn pooled_models_are_those_of_means(
        (places, m) in (albums(), stochastic(false, 3)),
        drives in vec((0..4_usize, log_likelihoods()), 1..6),
        rows in vec(distribution(false, 4), 9),
    ) {
        let (n, groups) = (places.len(), Groups::new(places).unwrap());
        let prior = Prior::AtFirstObservation(Belief::uniform(3).unwrap());
        let pool = |values: &[f64]| -> Vec<f64> {
            let of = |g| groups.states(g).map(|i| values[i]).collect::<Vec<_>>();
            (0..3).map(|g| log_mean(&of(g))).collect()
        };
        let plain = Hmm::new(prior.clone(), dense(&m), LikelihoodVector::log(3).owned()).unwrap();
        let table = TableLikelihood::from_rows(&rows[..n]).unwrap();
        let given = LikelihoodVector::log(n).owned();
        let fused = FusedLikelihood::new(table, OptionalLikelihood::new(given)).unwrap();
        let sensor = PooledLikelihood::new(fused, groups.clone()).unwrap();
        let hmm = Hmm::new(prior, sparse(&m), sensor).unwrap();
        // Every other step the table alone.
        let ys: Vec<_> = drives.iter().enumerate()
            .map(|(k, (y, logs))| (*y, (k % 2 == 1).then(|| logs[..n].to_vec()))).collect();
        let means: Vec<Vec<f64>> = ys.iter().map(|(y, logs)| {
            let log = |i: usize| rows[i][*y].ln() + logs.as_ref().map_or(0.0, |logs| logs[i]);
            pool(&(0..n).map(log).collect::<Vec<_>>())
        }).collect();
        let Ok(expected) = plain.smooth(&means) else {
            prop_assert!(hmm.smooth(&ys).is_err() && hmm.viterbi(&ys).is_err());
            return Ok(());
        };
        let found = hmm.smooth(&ys).unwrap();
        close_log(found.log_likelihood(), expected.log_likelihood(), 1e-12, "log-likelihood")?;
        let posteriors = found.posteriors().as_slice().iter().zip(expected.posteriors().as_slice());
        for (found, expected) in posteriors {
            close_log(*found, *expected, 1e-10, "posterior")?;
        }
        let (path, best) = (hmm.viterbi(&ys).unwrap(), plain.viterbi(&means).unwrap());
        close_log(path.log_probability(), best.log_probability(), 1e-11, "path")?;
    }
}

#[test]
fn pooled_numbers_at_the_limits_are_not_lost() {
    let pool = |values: [f64; 4]| {
        let images = Groups::new(vec![0, 1, 1, 1]).unwrap();
        let sensor = PooledLikelihood::new(LikelihoodVector::linear(4), images).unwrap();
        found_logs(&sensor, &values)
    };
    // Sums overflow, and means underflow, but not their logarithms.
    let found = pool([1.0, f64::MAX, f64::MAX, f64::MAX]);
    assert!(found[0].abs() < 1e-12 && (found[1] - f64::MAX.ln()).abs() < 1e-12, "{found:?}");
    let least = 5e-324_f64;
    let found = pool([1.0, least, 0.0, 0.0]);
    assert!((found[1] - (least.ln() - 3.0_f64.ln())).abs() < 1e-12, "{found:?}");
    assert_eq!(pool([0.0; 4]), [NEVER; 2]);
    assert_eq!(pool([1.0, 0.0, 0.0, 0.0]), [0.0, NEVER]);
    assert_eq!(pool([0.5, 0.75, 0.75, 0.0]), [0.5_f64.ln(), 0.5_f64.ln()]);
}

/// A sensor whose tails may be rounded stays one; another does not become one.
#[test]
fn pooled_tails_are_rounded_if_the_sensors_are() {
    let modes = |rounded: bool| {
        let images = Groups::new(vec![0, 1, 1]).unwrap();
        let prior = Prior::AtFirstObservation(Belief::uniform(2).unwrap());
        let seen = [[0.0, -800.0, -800.0], [-1000.0, 0.0, 0.0]];
        let vector = LikelihoodVector::log(3);
        let smoothed = if rounded {
            let sensor = PooledLikelihood::new(RoundedTails(vector), images).unwrap();
            Hmm::new(prior, still(2), sensor).unwrap().smooth(&seen).unwrap()
        } else {
            let sensor = PooledLikelihood::new(vector, images).unwrap();
            Hmm::new(prior, still(2), sensor).unwrap().smooth(&seen).unwrap()
        };
        smoothed.posteriors().modes()
    };
    assert_eq!(modes(false), [1, 1]);
    assert_eq!(modes(true), [0, 0]);
}

#[test]
fn bad_pools_are_named() {
    let images = Groups::new(vec![0, 1, 1]).unwrap();
    assert_eq!(
        text(PooledLikelihood::new(LikelihoodVector::linear(2), images.clone())),
        "the grouping has 3 states, expected 2 as the sensor"
    );
    let sensor = PooledLikelihood::new(LikelihoodVector::linear(3), images).unwrap();
    assert_eq!(sensor.groups().count(), 2);
    assert_eq!(sensor.sensor().states(), 3);
    let prior = Prior::AtFirstObservation(Belief::uniform(2).unwrap());
    let hmm = Hmm::new(prior, still(2), sensor).unwrap();
    let step = |y: &[f64]| {
        let error = hmm.filter().step(y).unwrap_err();
        std::error::Error::source(&error).unwrap().to_string()
    };
    // Errors name the image.
    assert_eq!(
        step(&[0.5, 0.5, f64::NAN]),
        "state 2 has likelihood NaN, expected a finite value of at least 0"
    );
    assert_eq!(
        step(&[0.5, 0.75, -0.25]),
        "state 2 has likelihood -0.25, expected a finite value of at least 0"
    );
    assert_eq!(step(&[0.5; 2]), "the likelihood has 2 values, expected one for each of 3 states");
}

#[test]
fn pooled_sightings_are_drawn_from_all_images() {
    use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
    let images = Groups::new(vec![0, 1, 0, 1, 1]).unwrap();
    let names = matrix(5, |image, symbol| f64::from(u8::from(image == symbol)));
    let sensor = PooledLikelihood::new(TableLikelihood::from_rows(&names).unwrap(), images);
    let sensor = sensor.unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut seen = [[0; 5]; 2];
    for k in 0..6000 {
        seen[k % 2][sensor.sample(k % 2, &mut rng)] += 1;
    }
    let near = |count: i32, expected: i32| (count - expected).abs() < 150;
    assert!(near(seen[0][0], 1500) && near(seen[0][2], 1500), "{seen:?}");
    assert!([1, 3, 4].iter().all(|&image| near(seen[1][image], 1000)), "{seen:?}");
    assert_eq!(seen.iter().flatten().sum::<i32>(), 6000);
    assert_eq!((seen[0][1], seen[0][3], seen[0][4], seen[1][0], seen[1][2]), (0, 0, 0, 0, 0));
}

fn text<T, E: ToString>(result: Result<T, E>) -> String {
    result.err().unwrap().to_string()
}

fn still(n: usize) -> SparseTransition {
    SparseTransition::from_triplets(n, (0..n).map(|i| (i, i, 1.0))).unwrap()
}

#[test]
fn bad_ways_off_the_map_are_named() {
    let new = |leave, return_rate, back: Vec<f64>| {
        text(OffMapTransition::new(still(2), leave, return_rate, Belief::new(back).unwrap()))
    };
    let even = || vec![0.5, 0.5];
    assert_eq!(new(1.5, 0.5, even()), "the rate of leaving is 1.5, expected a value from 0 to 1");
    assert_eq!(new(-0.5, 0.5, even()), "the rate of leaving is -0.5, expected a value from 0 to 1");
    assert_eq!(
        new(f64::NAN, 0.5, even()),
        "the rate of leaving is NaN, expected a value from 0 to 1"
    );
    assert_eq!(new(0.5, 2.0, even()), "the rate of return is 2, expected a value from 0 to 1");
    assert_eq!(
        new(0.5, f64::INFINITY, even()),
        "the rate of return is inf, expected a value from 0 to 1"
    );
    assert_eq!(
        new(0.5, 0.5, vec![1.0]),
        "the return belief has 1 states, expected 2 as the operator within"
    );
    let least = f64::MIN_POSITIVE;
    assert_eq!(
        new(0.5, 0.5, vec![1.0, least]),
        format!(
            "the probability of a return to state 1 is {}, expected 0 or at least 2.2e-308, the smallest normal double",
            0.5 * least
        )
    );
    let tiny = Belief::new(vec![1.0, least]).unwrap();
    assert!(OffMapTransition::new(still(2), 0.5, 1.0, tiny.clone()).is_ok());
    assert!(OffMapTransition::new(still(2), 0.5, 0.0, tiny).is_ok());

    let a = OffMapTransition::new(still(2), 0.5, 0.5, Belief::uniform(2).unwrap()).unwrap();
    assert_eq!(a.inner().entries(), 2);
    assert_eq!(
        text(a.groups(&Groups::new(vec![0, 0, 1]).unwrap())),
        "the grouping has 3 states, expected 2 as the operator within"
    );
    let endless = wayfix::WindowTransition::new(1, 0, &[1.0], wayfix::Ends::Loop).unwrap();
    let one = Belief::uniform(1).unwrap();
    assert_eq!(OffMapTransition::new(endless, 0.5, 0.5, one).unwrap().off_map_state(), 1);
}

/// The way back from nowhere is the last, and counts only if it is better.
#[test]
fn ties_go_to_the_map() {
    let a = OffMapTransition::new(still(2), 0.5, 0.5, Belief::certain(2, 1).unwrap()).unwrap();
    let (mut out, mut from) = ([0.0; 3], [9; 3]);
    a.max_product(&(), &[0.0, 0.0, 0.0], &mut out, &mut from);
    assert_eq!((out, from), ([-1.0; 3], [0, 1, 0]));
    a.max_product(&(), &[-1.0, 0.0, 1.0], &mut out, &mut from);
    assert_eq!((out, from), ([-2.0, 0.0, 0.0], [0, 2, 2]));
    a.max_product(&(), &[-1.0, 1.0, 1.0], &mut out, &mut from);
    assert_eq!((out, from), ([-2.0, 0.0, 0.0], [0, 1, 1]));
}

/// A drive that leaves the map is decoded as one, and simulated.
#[test]
fn drives_leave_the_map_and_come_back() {
    use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
    let around = SparseTransition::from_rows(3, &[0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    let gate = Belief::certain(3, 1).unwrap();
    let a = OffMapTransition::new(around.unwrap(), 0.125, 0.25, gate).unwrap();
    let camera = TableLikelihood::from_rows(&[
        [0.75, 0.0, 0.0, 0.25],
        [0.0, 0.75, 0.0, 0.25],
        [0.0, 0.0, 0.75, 0.25],
        [0.125, 0.125, 0.125, 0.625],
    ]);
    let prior = Prior::AtFirstObservation(Belief::certain(4, 0).unwrap());
    let hmm = Hmm::new(prior, a, camera.unwrap()).unwrap();
    let path = hmm.viterbi(&[0, 1, 3, 3, 3, 3, 1, 2, 0]).unwrap();
    assert_eq!(path.states(), [0, 1, 3, 3, 3, 3, 1, 2, 0]);
    let drive = hmm.simulate(2000, &mut ChaCha8Rng::seed_from_u64(1));
    let off = drive.states().iter().filter(|state| **state == 3).count();
    // A third of the steps, give or take.
    assert!((500..850).contains(&off), "{off}");
    assert!(
        drive
            .states()
            .windows(2)
            .all(|pair| hmm.transition().outgoing(&(), pair[0]).any(|e| e.0 == pair[1]))
    );
}

#[cfg(feature = "serde")]
mod stored {
    use super::*;
    use serde::{Serialize, de::DeserializeOwned};
    use wayfix::KnownState;

    /// There and back; JSON tells any two doubles apart.
    fn comes_back<T: Serialize + DeserializeOwned>(value: &T) -> String {
        let text = serde_json::to_string(value).unwrap();
        let back: T = serde_json::from_str(&text).unwrap();
        assert_eq!(serde_json::to_string(&back).unwrap(), text);
        text
    }

    #[track_caller]
    fn refused<T: DeserializeOwned>(text: &str, expected: &str) {
        let error = serde_json::from_str::<T>(text).err().expect("to be refused").to_string();
        assert_eq!(error.split(" at line").next().unwrap(), expected);
    }

    const STILL: &str = r#"{"version":1,"states":1,"to":[0],"from":[0],"probability":[1.0]}"#;

    #[test]
    fn off_map() {
        let back = Belief::certain(1, 0).unwrap();
        let a = OffMapTransition::new(still(1), 0.25, 0.5, back).unwrap();
        let text = comes_back(&a);
        assert_eq!(
            text,
            format!(r#"{{"version":1,"inner":{STILL},"leave":0.25,"stay":0.5,"back":[0.5]}}"#)
        );
        let bad = |from: &str, to: &str, expected: &str| {
            refused::<OffMapTransition<SparseTransition>>(&text.replace(from, to), expected);
        };
        bad("0.25", "-1", "the rate of leaving is -1, expected a value from 0 to 1");
        bad(
            r#""stay":0.5"#,
            r#""stay":2"#,
            "the probability of no return is 2, expected a value from 0 to 1",
        );
        bad(
            r#""back":[0.5]"#,
            r#""back":[-1]"#,
            "the probability of a return to state 0 is -1, expected a value from 0 to 1",
        );
        bad(
            r#""back":[0.5]"#,
            r#""back":[0.25]"#,
            "the probability of a return or none is 0.75, expected 1",
        );
        bad(
            r#""back":[0.5]"#,
            r#""back":[0.5,0]"#,
            "the return belief has 2 states, expected 1 as the operator within",
        );
    }

    #[test]
    fn by_distance() {
        let a = DistanceTransition::new(still(1), |_, _| 0.25).unwrap();
        let text = comes_back(&a);
        assert_eq!(text, format!(r#"{{"version":1,"base":{STILL},"lengths":[0.25]}}"#));
        let bad = |lengths: &str, expected: &str| {
            refused::<DistanceTransition>(&text.replace("[0.25]", lengths), expected);
        };
        bad("[]", "the number of lengths is 0, expected one for each entry of the base");
        bad("[1,1]", "the number of lengths is 2, expected one for each entry of the base");
        bad(
            "[-1]",
            "the length of the transition from state 0 to state 0 is -1, expected a finite value of at least 0",
        );
        let a = fork(&[0.1, 1e300, 0.3]);
        let b: DistanceTransition = serde_json::from_str(&comes_back(&a)).unwrap();
        assert!((1..4).all(|to| a.length(to, 0) == b.length(to, 0)));
        assert_eq!(ways(&a, 0.15, 0.01), ways(&b, 0.15, 0.01));
    }

    #[test]
    fn pooled() {
        let images = Groups::new(vec![0, 1, 1]).unwrap();
        let text = comes_back(&PooledLikelihood::new(KnownState::new(3), images).unwrap());
        assert_eq!(text, r#"{"version":1,"sensor":{"version":1,"states":3},"groups":[0,1,1]}"#);
        refused::<PooledLikelihood<KnownState>>(
            &text.replace("[0,1,1]", "[0,1]"),
            "the grouping has 2 states, expected 3 as the sensor",
        );
    }

    #[test]
    fn values_are_the_same_to_the_bit() {
        let back = Belief::new(vec![0.3, 0.7]).unwrap();
        let a = OffMapTransition::new(still(2), 0.1, 0.3, back).unwrap();
        let b: OffMapTransition<SparseTransition> = serde_json::from_str(&comes_back(&a)).unwrap();
        let row = |a: &OffMapTransition<SparseTransition>, i: usize| {
            a.incoming(&(), i).map(|(j, p)| (j, p.to_bits())).collect::<Vec<_>>()
        };
        assert!((0..3).all(|i| row(&a, i) == row(&b, i)));
    }
}
