//! exp(Q Δt) against matrices.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::{ReorderStates, Transition, TransitionEntries};
use wayfix_learn::GeneratorTransition;

use super::{generator, rates};
use crate::kit::{Expected, assert_operator, cases, cases_of, close, exponential};

proptest! {
    #![proptest_config(cases_of(1000))]

    #[test]
    fn steps_of_any_time(
        rates in rates(5, 0.7),
        times in vec(prop_oneof![1 => Just(0.0), 6 => (-2.0..1.5_f64).prop_map(|x| 10_f64.powf(x))], 3),
    ) {
        let matrices: Vec<_> = times.iter().map(|t| exponential(&rates, *t)).collect();
        assert_operator(generator(&rates), Expected::each(&times, &matrices))?;
    }
}

proptest! {
    #![proptest_config(cases())]

    /// Rates over six orders of magnitude, and times over 21: entries down to the least double, and
    /// gaps after which the start is forgotten, except by slow moves.
    #[test]
    fn each_entry_by_itself(rates in rates(5, 3.0), time in (-12.0..9.0_f64).prop_map(|x| 10_f64.powf(x))) {
        let (n, a, expected) = (rates.len(), generator(&rates), exponential(&rates, time));
        let largest = (0..n).map(|j| a.exit_rate(j)).fold(0.0, f64::max);
        for from in 0..n {
            let mut column = vec![0.0; n];
            a.outgoing(&time, from).for_each(|(to, p)| column[to] = p);
            close(column.iter().sum(), 1.0, 1e-14, 1.0)?;
            for (to, (found, expected)) in column.iter().zip(&expected).enumerate() {
                let p = expected[from];
                // A stay, with that many roundings.
                let stays = (largest * time).min(-p.ln());
                let tolerance = 1e-13 + 4.0 * stays * f64::EPSILON;
                close(*found, p, tolerance, 1e-290)?;
                let row = a.incoming(&time, to).find(|entry| entry.0 == from);
                close(row.map_or(0.0, |entry| entry.1), p, tolerance, 1e-290)?;
                prop_assert_eq!(p > 1e-290, *found > 1e-290);
            }
        }
    }
}

/// A line with one way: after n moves with probability Pois(n; q t), down to the least double.
#[test]
fn far_states_keep_their_digits() {
    let n = 400;
    let line = GeneratorTransition::from_triplets(n, (1..n).map(|i| (i, i - 1, 2.0))).unwrap();
    for time in [1e-12_f64, 1e-3, 0.5, 20.0, 100.0, 300.0] {
        let mean = 2.0 * time;
        let mut log = -mean;
        let found: Vec<f64> = {
            let mut out = vec![0.0; n];
            line.outgoing(&time, 0).for_each(|(to, p)| out[to] = p);
            out
        };
        for (k, p) in found.iter().take(n - 1).enumerate() {
            if k > 0 {
                log += (mean / k as f64).ln();
            }
            if log > -700.0 {
                assert!((p.ln() - log).abs() < 2e-12 * log.abs().max(1.0), "{k} at {time}: {p:e}");
            } else if log < -750.0 {
                assert_eq!(*p, 0.0, "{k} at {time}");
            }
        }
        // As a logarithm also below the least double.
        let mut out = vec![0.0; n];
        let certain: Vec<f64> =
            (0..n).map(|i| if i == 0 { 0.0 } else { f64::NEG_INFINITY }).collect();
        line.apply_log(&time, &certain, &mut out);
        let reached = out.iter().filter(|log| **log > f64::NEG_INFINITY).count();
        assert!(reached >= found.iter().filter(|p| **p > 0.0).count());
    }
}

/// Too many states for a matrix: the sum ends once the belief is in equilibrium, or early without
/// moves.
#[test]
fn long_gaps_on_many_states() {
    let n = 600;
    // A hub at 0, which holds half of the time.
    let star = (1..n).flat_map(|i| [(i, 0, 1.0), (0, i, (n - 1) as f64)]);
    let star = GeneratorTransition::from_triplets(n, star).unwrap();
    for time in [1.0, 1e3, 1e5] {
        let mut x = vec![0.0; n];
        x[7] = 1.0;
        let mut out = vec![0.0; n];
        star.apply(&time, &x, &mut out);
        assert!((out[0] - 0.5).abs() < 1e-12, "{}", out[0]);
        assert!(out[1..].iter().all(|p| (p * 2.0 * (n - 1) as f64 - 1.0).abs() < 1e-9));
        star.apply_transpose(&time, &x, &mut out);
        assert!(out.iter().all(|p| (p * 2.0 * (n - 1) as f64 - 1.0).abs() < 1e-9));
    }
    let absorbing = GeneratorTransition::from_triplets(n, []).unwrap();
    let (x, mut out) = (vec![1.0 / n as f64; n], vec![0.0; n]);
    absorbing.apply(&1e300, &x, &mut out);
    assert_eq!(out, x);
}

#[test]
fn states_in_another_order() {
    let a = GeneratorTransition::from_triplets(3, [(1, 0, 2.0), (2, 1, 0.5), (0, 2, 3.0)]).unwrap();
    let b = a.reordered(&[2, 0, 1]);
    assert!(b.triplets().eq([(1, 0, 3.0), (2, 1, 2.0), (0, 2, 0.5)]));
    let (mut x, mut y) = ([0.0; 3], [0.0; 3]);
    a.apply(&0.7, &[0.2, 0.3, 0.5], &mut x);
    b.apply(&0.7, &[0.5, 0.2, 0.3], &mut y);
    assert!(y.iter().zip([x[2], x[0], x[1]]).all(|(y, x)| (y - x).abs() < 1e-15));
}
