//! Observed states: the standard errors of counts.

use wayfix::inference::LearningOptions;
use wayfix::{DenseTransition, Fixed, Hmm, Prior, SparseTransition};
use wayfix_learn::StandardErrors;

use super::{Discrete, identity, kept, near, probabilities, uniform};

const PATH: [usize; 24] = [0, 1, 1, 2, 0, 0, 1, 2, 2, 2, 0, 1, 0, 0, 0, 1, 1, 2, 1, 0, 2, 1, 1, 0];

/// Numbers of moves \[to\]\[from\] of a path, and of those out of each state.
fn counts(path: &[usize]) -> ([[f64; 3]; 3], [f64; 3]) {
    let (mut moves, mut left) = ([[0.0; 3]; 3], [0.0; 3]);
    for pair in path.windows(2) {
        moves[pair[1]][pair[0]] += 1.0;
        left[pair[0]] += 1.0;
    }
    (moves, left)
}

fn third() -> DenseTransition {
    DenseTransition::from_fn(3, |_, _| 1.0 / 3.0).unwrap()
}

/// The covariance of shares p and q of n is (p [the same] − p q) / n, for every entry, including
/// the reference.
#[test]
fn covariances_are_those_of_multinomial_counts() {
    let (_, left) = counts(&PATH);
    let hmm: Discrete = Hmm::new(uniform(3), third(), identity(3)).unwrap();
    let learned = hmm.learn(&[PATH], &kept()).unwrap().into_model();
    let found = StandardErrors::from_likelihood(&learned, &[PATH], &kept(), probabilities).unwrap();
    let p = found.values();
    for (a, b) in (0..9).flat_map(|a| (0..9).map(move |b| (a, b))) {
        let from = a % 3;
        let expected = match (from == b % 3, a == b) {
            (false, _) => 0.0,
            (true, same) => (if same { p[a] } else { 0.0 } - p[a] * p[b]) / left[from],
        };
        let covariance = found.covariance(a, b).unwrap();
        let size = found.errors()[a] * found.errors()[b];
        assert!((covariance - expected).abs() < 1e-7 * size, "{a} {b}: {covariance}, {expected}");
    }
    // The table has six zeros.
    assert_eq!((found.at_bound(), found.errors()[9..].to_vec()), (6, vec![0.0; 9]));
}

/// With pseudo-counts, the posterior: a Dirichlet density of these counts, at its mode in log-odds.
#[test]
fn pseudo_counts_are_counts() {
    let (moves, left) = counts(&PATH);
    let options = kept().with_transition_pseudo_count(1.5);
    let hmm = Hmm::new(uniform(3), third(), Fixed(identity(3))).unwrap();
    let learned = hmm.learn(&[PATH], &options).unwrap().into_model();
    let read = |hmm: &Hmm<DenseTransition, Fixed<_>>| hmm.transition().to_rows().concat();
    let found = StandardErrors::from_likelihood(&learned, &[PATH], &options, read).unwrap();
    for (at, (p, error)) in found.values().iter().zip(found.errors()).enumerate() {
        let (to, from) = (at / 3, at % 3);
        near(*p, (moves[to][from] + 1.5) / (left[from] + 4.5), 1e-12);
        near(*error, (p * (1.0 - p) / (left[from] + 4.5)).sqrt(), 1e-7);
    }
    // Without pseudo-counts, the model is not at the maximum.
    assert!(
        StandardErrors::from_likelihood(&learned, &[PATH], &kept(), read)
            .is_ok_and(|own| own != found)
    );
}

/// Moves that were never made, with the probabilities that learning left: known, and counted.
#[test]
fn probabilities_on_the_way_to_0_are_known() {
    let (moves, left) = counts(&PATH);
    for rest in [1e-3, 1e-6, 1e-12, 1e-30, 1e-300] {
        // From state 2 only to itself or to 0.
        let path: Vec<usize> = PATH.iter().copied().filter(|state| *state != 1).collect();
        let stays = path.windows(2).filter(|pair| **pair == [2, 2]).count() as f64;
        let all = path.windows(2).filter(|pair| pair[0] == 2).count() as f64;
        let p = stays / all * (1.0 - rest);
        let own = path.windows(2).filter(|pair| **pair == [0, 0]).count() as f64;
        let out = path.windows(2).filter(|pair| pair[0] == 0).count() as f64;
        let rows = [[own / out, 0.5, 1.0 - p - rest], [0.0, 0.5, rest], [1.0 - own / out, 0.0, p]];
        let a = DenseTransition::from_rows(&rows).unwrap();
        let hmm = Hmm::new(uniform(3), a, Fixed(identity(3))).unwrap();
        let read = |hmm: &Hmm<DenseTransition, Fixed<_>>| {
            vec![hmm.transition().get(2, 2), hmm.transition().get(1, 2), hmm.transition().get(0, 0)]
        };
        let error = StandardErrors::from_likelihood(&hmm, &[&path], &kept(), read).unwrap_err();
        // State 1 is never left, so its column is undetermined.
        assert!(
            error.to_string().contains("free parameter 1 of the transition operator (0.5)"),
            "{error}"
        );

        let rows = [[rows[0][0], 1.0, rows[0][2]], [0.0, 0.0, rest], [rows[2][0], 0.0, p]];
        let a = DenseTransition::from_rows(&rows).unwrap();
        let hmm = Hmm::new(uniform(3), a, Fixed(identity(3))).unwrap();
        let found = StandardErrors::from_likelihood(&hmm, &[&path], &kept(), read).unwrap();
        assert_eq!(found.at_bound(), 4, "{rest}"); // three zeros, and the rest
        near(found.errors()[0], (p * (1.0 - p) / all).sqrt(), 2e-3_f64.max(rest));
        assert!(found.errors()[1] <= rest, "{rest}: {}", found.errors()[1]);
        let p = own / out;
        near(found.errors()[2], (p * (1.0 - p) / out).sqrt(), 1e-7);
    }
    assert!(moves[2][2] > 0.0 && left[1] > 0.0);
}

/// Moves that a sparse matrix does not store are not parameters.
#[test]
fn moves_that_are_not_stored_do_not_count() {
    let path = [0, 0, 1, 1, 1, 0, 1];
    let a = SparseTransition::from_rows(&[[0.5, 0.5, 0.0], [0.5, 0.5, 0.0], [0.0, 0.0, 1.0]]);
    let hmm = Hmm::new(uniform(3), a.unwrap(), Fixed(identity(3))).unwrap();
    let learned = hmm.learn(&[path], &kept()).unwrap().into_model();
    let read = |hmm: &Hmm<SparseTransition, Fixed<_>>| vec![hmm.transition().get(0, 0)];
    let found = StandardErrors::from_likelihood(&learned, &[path], &kept(), read).unwrap();
    assert_eq!((found.values()[0], found.at_bound()), (1.0 / 3.0, 0));
    near(found.errors()[0], (2.0_f64 / 27.0).sqrt(), 1e-7);
    // The prior of one path: certain, with two probabilities of 0, once it is learned.
    let options = LearningOptions::default();
    let learned = hmm.learn(&[path], &options).unwrap().into_model();
    let found = StandardErrors::from_likelihood(&learned, &[path], &options, read).unwrap();
    assert_eq!(found.at_bound(), 2);
}

/// Linear and nonlinear functions of the parameters.
#[test]
fn errors_of_functions_are_those_of_the_delta_method() {
    let hmm: Discrete = Hmm::new(uniform(3), third(), identity(3)).unwrap();
    let learned = hmm.learn(&[PATH], &kept()).unwrap().into_model();
    let read = |hmm: &Discrete| {
        let (a, b) = (hmm.transition().get(0, 0), hmm.transition().get(1, 0));
        vec![a, b, 3.0 * a - 2.0 * b + 7.0, 1.0 / (1.0 - a), a.ln(), a / b, 5.0]
    };
    let found = StandardErrors::from_likelihood(&learned, &[PATH], &kept(), read).unwrap();
    let (p, e) = (found.values(), found.errors());
    let covariance = found.covariance(0, 1).unwrap();
    let linear = 9.0 * e[0] * e[0] + 4.0 * e[1] * e[1] - 12.0 * covariance;
    near(e[2], linear.sqrt(), 1e-7);
    near(e[3], e[0] / (1.0 - p[0]).powi(2), 1e-7);
    near(e[4], e[0] / p[0], 1e-7);
    let (by_a, by_b) = (1.0 / p[1], -p[0] / p[1].powi(2));
    let ratio = (by_a * e[0]).powi(2) + (by_b * e[1]).powi(2) + 2.0 * by_a * by_b * covariance;
    near(e[5], ratio.sqrt(), 1e-7);
    assert_eq!(e[6], 0.0);
    near(found.covariance(0, 3).unwrap(), e[0] * e[3], 1e-7);
}

/// With a stationary prior, the first states of paths are informative about the moves, too.
#[test]
fn stationary_starts_count() {
    let paths = [[0, 0, 1, 1], [1, 0, 0, 0], [1, 1, 1, 0], [0, 1, 0, 0], [0, 0, 0, 1]];
    let (mut n, mut m) = ([[0.0; 2]; 2], [0.0; 2]);
    for path in &paths {
        m[path[0]] += 1.0;
        path.windows(2).for_each(|pair| n[pair[0]][pair[1]] += 1.0);
    }
    let half = DenseTransition::from_fn(2, |_, _| 0.5).unwrap();
    let prior = Prior::stationary(&half).unwrap();
    let hmm = Hmm::new(prior, half, Fixed(identity(2))).unwrap();
    let options = LearningOptions::default().with_tolerance(1e-12);
    let learned = hmm.learn(&paths, &options).unwrap().into_model();
    let read = |hmm: &Hmm<DenseTransition, Fixed<_>>| {
        vec![hmm.transition().get(1, 0), hmm.transition().get(0, 1)]
    };
    let found = StandardErrors::from_likelihood(&learned, &paths, &options, read).unwrap();
    // Σ n ln A + m_0 ln b / (a + b) + m_1 ln a / (a + b) with A[1, 0] = a, A[0, 1] = b
    let [a, b] = [found.values()[0], found.values()[1]];
    let both = (m[0] + m[1]) / (a + b).powi(2);
    let of = |p: f64, moves: f64, stays: f64| moves / (p * p) + stays / (1.0 - p).powi(2) - both;
    let (aa, bb) = (of(a, n[0][1] + m[1], n[0][0]), of(b, n[1][0] + m[0], n[1][1]));
    let determinant = aa * bb - both * both;
    near(found.errors()[0], (bb / determinant).sqrt(), 1e-5);
    near(found.errors()[1], (aa / determinant).sqrt(), 1e-5);
    near(found.covariance(0, 1).unwrap(), both / determinant, 1e-5);
    assert_eq!(found.at_bound(), 0);
}
