//! Kronecker products: two independent chains side by side.

use proptest::prelude::*;
use wayfix::Transition;
use wayfix::transition::{KroneckerTransition, WindowTransition};

use crate::kit::{
    Expected, any_stochastic, assert_operator, cases, dense, kronecker, sparse, still, text,
};

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn kronecker_products(
        (exact, first, second) in any::<bool>()
            .prop_flat_map(|e| (Just(e), any_stochastic(e, 5), any_stochastic(e, 4))),
    ) {
        let a = KroneckerTransition::new(sparse(&first), dense(&second)).unwrap();
        for state in 0..a.states() {
            let (i1, i2) = a.parts(state).unwrap();
            prop_assert_eq!(a.index(i1, i2), Some(state));
            prop_assert_eq!(a.first_groups().group_of(state), Some(i1));
            prop_assert_eq!(a.second_groups().group_of(state), Some(i2));
        }
        let expected = kronecker(&first, &second);
        assert_operator(a, Expected::constant(&expected).with_exact_ties(exact))?;
    }
}

#[test]
fn bad_pairs_are_named() {
    let long = || WindowTransition::closed(100_000, 1, &[1.0]).unwrap();
    assert_eq!(
        text(KroneckerTransition::new(long(), long())),
        "10000000000 states, expected at most 4294967295 (32-bit indices)"
    );
    let pairs = KroneckerTransition::new(still(2), still(2)).unwrap();
    assert_eq!((pairs.index(2, 0), pairs.index(0, 2), pairs.parts(4)), (None, None, None));
}
