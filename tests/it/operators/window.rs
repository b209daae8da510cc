//! Windows: moves by the same offsets from every place.

use proptest::prelude::*;
use wayfix::transition::WindowTransition;
use wayfix::{Transition, TransitionEntries};

use crate::kit::{
    Expected, NEVER, any_distribution, assert_operator, cases, text, window, window_transition,
};

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn windows(
        (exact, weights) in any::<bool>().prop_flat_map(|e| (Just(e), any_distribution(e, 12))),
        (n, first, closed) in (1..=10_usize, -14..12_isize, any::<bool>()),
    ) {
        let a = window_transition(n, first, &weights, closed).unwrap();
        // Weights that add up on a loop are not powers of two.
        let exact = exact && weights.len() <= n;
        let m = window(n, first, &weights, closed);
        assert_operator(a, Expected::constant(&m).with_exact_ties(exact))?;
    }
}

#[test]
fn leading_weights_of_0_change_no_bit() {
    let x: Vec<f64> = (0..10).map(|i| 1.0 / (3.0 + f64::from(i))).collect();
    let product = |first, weights: &[f64]| {
        let a = WindowTransition::closed(10, first, weights).unwrap();
        let mut out = vec![0.0; 10];
        a.apply(&(), &x, &mut out);
        out
    };
    let leading = product(4, &[0.0, 0.0, 0.0, 0.3, 0.5, 0.2]);
    assert_eq!(leading, product(7, &[0.3, 0.5, 0.2]));
    assert_eq!(leading, product(-3, &[0.3, 0.5, 0.2]));
}

#[test]
fn long_routes_go_block_by_block() {
    let n = 5000;
    let x: Vec<f64> = (0..n).map(|i| (f64::from(i) * 0.618_033_988_749_894_9).fract()).collect();
    let (mut out, mut back, mut from) = (x.clone(), x.clone(), vec![0; x.len()]);
    for (first, closed) in [(-3, true), (-1, false)] {
        let a = window_transition(x.len(), first, &[0.125, 0.0, 0.5, 0.375], closed).unwrap();
        a.apply(&(), &x, &mut out);
        a.apply_transpose(&(), &x, &mut back);
        for (i, (out, back)) in out.iter().zip(&back).enumerate() {
            let into: f64 = a.incoming(&(), i).map(|(j, p)| p * x[j]).sum();
            let outof: f64 = a.outgoing(&(), i).map(|(j, p)| p * x[j]).sum();
            assert!((out - into).abs() < 1e-14 && (back - outof).abs() < 1e-14, "{closed:?} {i}");
        }
        a.max_product(&(), &x, &mut out, &mut from);
        for (i, out) in out.iter().enumerate() {
            let score = |(j, p): (usize, f64)| p.log2() + x[j];
            let best = a.incoming(&(), i).map(score).fold(NEVER, f64::max);
            assert!(best == *out || (best - out).abs() < 1e-12, "{closed:?} {i}");
        }
    }
}

#[test]
fn windows_far_beyond_the_route_are_none_the_worse() {
    for closed in [true, false] {
        for first in [isize::MIN, -1_000_000_007, 1_000_000_007, isize::MAX] {
            let a = window_transition(3, first, &[0.25, 0.75], closed).unwrap();
            let mut out = [0.0; 3];
            a.apply(&(), &[0.25, 0.25, 0.5], &mut out);
            assert_eq!(out.iter().sum::<f64>(), 1.0, "{closed:?} {first}");
        }
    }
}

#[test]
fn bad_windows_are_named() {
    let window =
        |n, first, weights: &[f64], closed| text(window_transition(n, first, weights, closed));
    assert_eq!(
        window(0, 0, &[1.0], true),
        "a transition operator needs at least one state, found none"
    );
    assert_eq!(window(3, 0, &[], true), "the sum of the weights is 0, expected 1");
    assert_eq!(window(3, 0, &[0.5, 0.25], false), "the sum of the weights is 0.75, expected 1");
    assert_eq!(
        window(3, -2, &[0.5, -0.5], false),
        "the weight of offset -1 is -0.5, expected a finite value of at least 0"
    );
    assert_eq!(
        window(3, 1, &[f64::NAN], false),
        "the weight of offset 1 is NaN, expected a finite value of at least 0"
    );
    assert_eq!(
        window(5_000_000_000, 1, &[1.0], true),
        "5000000000 states, expected at most 4294967295 (32-bit indices)"
    );
}
