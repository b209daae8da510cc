//! Motion along a route: the operator against its definition, and learning.

mod blocks;
pub(crate) mod definition;
mod grids;
mod learning;
mod routines;
mod values;

use proptest::collection::vec;
use proptest::prelude::*;

use self::definition::{control, parts};
use crate::kit::{Expected, Matrix, assert_operator, cases_of};

proptest! {
    #![proptest_config(cases_of(600))]

    #[test]
    fn a_route_is_the_matrix_of_its_definition(
        parts in prop_oneof![2 => parts(12, 3), 1 => parts(7, 5)],
        controls in vec(control(), 1..4),
    ) {
        let matrices: Vec<Matrix> = controls.iter().map(|u| parts.matrix(u)).collect();
        let log_factors: Vec<_> = controls.iter().map(|u| parts.log_factor(u)).collect();
        let expected = Expected::each(&controls, &matrices).with_evidence(&log_factors);
        assert_operator(parts.route(), expected.within(1e-11, 1e-30))?;
    }

}

proptest! {
    #![proptest_config(cases_of(100))]

    /// The usual speeds; some go around a short loop more than once.
    #[test]
    fn so_is_one_at_the_usual_speeds(parts in parts(5, 13), controls in vec(control(), 1..3)) {
        let matrices: Vec<Matrix> = controls.iter().map(|u| parts.matrix(u)).collect();
        let log_factors: Vec<_> = controls.iter().map(|u| parts.log_factor(u)).collect();
        let expected = Expected::each(&controls, &matrices).with_evidence(&log_factors);
        assert_operator(parts.route(), expected.within(1e-11, 1e-30))?;
    }
}
