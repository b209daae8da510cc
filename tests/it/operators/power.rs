//! Powers: several steps in one.

use proptest::prelude::*;

use crate::kit::{Expected, any_stochastic, assert_operator, cases, power, sparse};

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn powers(m in any_stochastic(false, 6), exponent in 0..6_u32) {
        let a = sparse(&m).power(exponent).unwrap();
        let expected = power(&m, exponent);
        assert_operator(a, Expected::constant(&expected).with_exact_ties(exponent < 2))?;
    }
}
