//! Restarts: with a given rate, the next state may be any.

use proptest::prelude::*;
use wayfix::Belief;
use wayfix::transition::{RestartTransition, WindowTransition};

use crate::kit::{
    Expected, any_distribution, assert_operator, cases, distribution, rate, restart, sparse, still,
    stochastic, text, window,
};

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn restarts(
        (m, r) in (1..=6_usize).prop_flat_map(|n| (stochastic(true, n), distribution(true, n))),
        rate in rate(false),
    ) {
        let belief = Belief::new(r.clone()).unwrap();
        let a = RestartTransition::new(sparse(&m), rate, belief).unwrap();
        // A sum of two products ties only by chance, but to the bit.
        let expected = restart(&m, rate, &r);
        assert_operator(a, Expected::constant(&expected).with_exact_ties(true))?;
    }

    #[test]
    fn restarts_of_windows(
        weights in any_distribution(false, 5), (n, first) in (1..=6_usize, -3..3_isize),
        rate in rate(false),
    ) {
        let inner = WindowTransition::closed(n, first, &weights).unwrap();
        let m = window(n, first, &weights, true);
        let r = vec![1.0 / n as f64; n];
        let a = RestartTransition::new(inner, rate, Belief::uniform(n).unwrap()).unwrap();
        assert_operator(a, &restart(&m, rate, &r))?;
    }
}

#[test]
fn bad_restarts_are_named() {
    let restart =
        |rate, n| text(RestartTransition::new(still(2), rate, Belief::uniform(n).unwrap()));
    assert_eq!(restart(1.5, 2), "the rate is 1.5, expected a value from 0 to 1");
    assert_eq!(restart(f64::NAN, 2), "the rate is NaN, expected a value from 0 to 1");
    assert_eq!(
        restart(0.5, 3),
        "the restart belief has 3 states, expected 2 to match the inner operator"
    );
}
