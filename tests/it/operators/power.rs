//! Powers: several steps in one.

use proptest::prelude::*;
use wayfix::Belief;
use wayfix::transition::{PowerTransition, RestartTransition};

use crate::kit::{Expected, any_stochastic, assert_operator, cases, power, rate, restart, sparse};

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn powers(m in any_stochastic(false, 6), exponent in 0..6_u32) {
        let a = PowerTransition::new(sparse(&m), exponent);
        let expected = power(&m, exponent);
        assert_operator(a, Expected::constant(&expected).with_exact_ties(exponent < 2))?;
    }

    #[test]
    fn powers_of_restarts(
        m in any_stochastic(false, 5), rate in rate(false), exponent in 0..5_u32,
    ) {
        let r = vec![1.0 / m.len() as f64; m.len()];
        let belief = Belief::new(r.clone()).unwrap();
        let inner = RestartTransition::new(sparse(&m), rate, belief).unwrap();
        let a = PowerTransition::new(inner, exponent);
        assert_operator(a, &power(&restart(&m, rate, &r), exponent))?;
    }
}
