//! Operators from weights of moves, against sums over a dense matrix.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::{Belief, SparseTransition, Transition};

use crate::kit::cases;

proptest! {
    #![proptest_config(cases())]

    /// Duplicates and zeros, on any scale.
    #[test]
    fn columns_in_proportion_to_the_sums_of_weights(
        n in 1..6_usize,
        given in vec((0..6_usize, 0..6_usize, 0..5_u32), 0..40),
        exponents in vec(-290..290_i32, 6),
    ) {
        let scale = |from: usize| 10_f64.powi(exponents[from]);
        let mut weights: Vec<(usize, usize, f64)> = given
            .into_iter()
            .filter(|(to, from, _)| *to < n && *from < n)
            .map(|(to, from, weight)| (to, from, f64::from(weight) * scale(from)))
            .collect();
        // Each state has a move out of it.
        weights.extend((0..n).map(|from| ((from + 1) % n, from, scale(from))));
        let a = SparseTransition::from_weights(n, weights.iter().copied()).unwrap();
        prop_assert_eq!(a.states(), n);
        for from in 0..n {
            let mut column = vec![0.0; n];
            weights.iter().filter(|w| w.1 == from).for_each(|w| column[w.0] += w.2);
            let expected = Belief::from_weights(column).unwrap();
            for (to, p) in expected.as_slice().iter().enumerate() {
                prop_assert!((a.get(to, from) - p).abs() <= 1e-15, "{to} {from} {p}");
                prop_assert_eq!(a.get(to, from) == 0.0, *p == 0.0);
            }
        }
    }
}

#[test]
fn weights_at_the_limits_of_a_double() {
    let largest = [(0, 0, f64::MAX), (0, 0, f64::MAX), (1, 0, f64::MAX), (1, 0, f64::MAX)];
    let least = [(0, 1, 5e-324), (1, 1, 5e-324), (1, 1, 1e-323)];
    let a = SparseTransition::from_weights(2, largest.into_iter().chain(least)).unwrap();
    assert_eq!([a.get(0, 0), a.get(1, 0), a.get(0, 1), a.get(1, 1)], [0.5, 0.5, 0.25, 0.75]);
}
