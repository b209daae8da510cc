//! Operators within operators.

use proptest::prelude::*;
use wayfix::transition::{
    DwellTransition, KroneckerTransition, RestartTransition, SwitchedTransition, WindowTransition,
};
use wayfix::{Belief, Transition};

use crate::kit::{
    Expected, any_distribution, any_stochastic, assert_operator, cases, dwell, kronecker, rate,
    restart, sparse, text, window,
};

proptest! {
    #![proptest_config(cases())]

    /// Three factors, one of them with a restart: buffers nest.
    #[test]
    fn nested_products(
        (a, b, c) in (any_stochastic(false, 3), any_stochastic(false, 3), any_stochastic(false, 3)),
        rate in rate(false),
    ) {
        let r = vec![1.0 / b.len() as f64; b.len()];
        let belief = Belief::new(r.clone()).unwrap();
        let restarted = RestartTransition::new(sparse(&b), rate, belief).unwrap();
        let within = KroneckerTransition::new(sparse(&c), restarted);
        let all = KroneckerTransition::new(sparse(&a), within.unwrap()).unwrap();
        let m = kronecker(&a, &kronecker(&c, &restart(&b, rate, &r)));
        assert_operator(all, &m)?;
    }

    /// All operators pass a control on to the inner one.
    #[test]
    fn controls_reach_the_operator_within(
        (n, rate) in (1..=3_usize, rate(false)),
        weights in [any_distribution(false, 4), any_distribution(false, 4)],
    ) {
        let gears = || {
            let gear = |w: &Vec<f64>| WindowTransition::open(n, 0, w).unwrap();
            SwitchedTransition::new(weights.iter().map(gear).collect()).unwrap()
        };
        let belief = Belief::uniform(n).unwrap();
        let r = belief.as_slice().to_vec();
        let restarted = RestartTransition::new(gears(), rate, belief).unwrap();
        let leaving = vec![vec![0.25, 0.5]; n];
        let all = KroneckerTransition::new(
            gears(),
            DwellTransition::from_leaving(restarted, &leaving).unwrap(),
        ).unwrap();
        prop_assert_eq!(
            text(all.check_control(&2)),
            "operator 2, expected one of 2 (0 to 1)"
        );
        let whole = |weights: &Vec<f64>| {
            let m = window(n, 0, weights, false);
            kronecker(&m, &dwell(&restart(&m, rate, &r), &leaving))
        };
        let controls = [0, 1, 0];
        let expected = controls.map(|gear: usize| whole(&weights[gear]));
        assert_operator(all, Expected::each(&controls, &expected))?;
    }
}
