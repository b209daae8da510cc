//! One more state: off the map.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::likelihood::GroupedLikelihood;
use wayfix::likelihood::Groups;
use wayfix::motion::OffMapTransition;
use wayfix::transition::{DwellTransition, KroneckerTransition, RestartTransition};
use wayfix::{
    Belief, Hmm, LikelihoodVector, Prior, SparseTransition, TableLikelihood, Transition,
    TransitionEntries,
};

use crate::kit::{
    Expected, Matrix, assert_operator, cases_of, close_logs, dense, distribution, dwell, kronecker,
    off_map, rate, restart, rng, sparse, still, stochastic, switched, text,
};

/// Three matrices of one size, and a distribution.
fn motion(exact: bool, most: usize) -> impl Strategy<Value = (Vec<Matrix>, Vec<f64>)> {
    (1..=most).prop_flat_map(move |n| (vec(stochastic(exact, n), 3), distribution(exact, n)))
}

proptest! {
    #![proptest_config(cases_of(1000))]

    #[test]
    fn off_map_is_its_matrix(
        (exact, (matrices, back), leave, return_rate) in any::<bool>()
            .prop_flat_map(|e| (Just(e), motion(e, 6), rate(e), rate(e))),
    ) {
        let whole = |m: &Matrix| off_map(m, leave, return_rate, &back);
        let expected: Vec<Matrix> = matrices.iter().map(whole).collect();
        let belief = || Belief::new(back.clone()).unwrap();
        let plain =
            OffMapTransition::new(sparse(&matrices[0]), leave, return_rate, belief()).unwrap();
        prop_assert_eq!(plain.off_map_state(), back.len());
        assert_operator(plain, Expected::constant(&expected[0]).with_exact_ties(exact))?;
        // Each gear has its own control; a fourth does not exist.
        let geared =
            OffMapTransition::new(switched(&matrices), leave, return_rate, belief()).unwrap();
        prop_assert_eq!(
            text(geared.check_control(&3)),
            "operator 3, expected one of 3 (0 to 2)"
        );
        let expected = Expected::each(&[0, 1, 2], &expected).with_exact_ties(exact);
        assert_operator(geared, expected)?;
    }

    /// Within other operators and around them: they need not pass on the whole vector.
    #[test]
    fn off_map_nests(
        ((matrices, back), (leave, return_rate, again)) in
            (motion(false, 3), (rate(false), rate(false), rate(false))),
        turns in stochastic(false, 2),
    ) {
        let n = back.len();
        let belief = Belief::new(back.clone()).unwrap();
        let lost = || {
            OffMapTransition::new(switched(&matrices), leave, return_rate, belief.clone()).unwrap()
        };
        let whole: Vec<Matrix> =
            matrices.iter().map(|m| off_map(m, leave, return_rate, &back)).collect();
        let over = |map: &dyn Fn(&Matrix) -> Matrix| whole.iter().map(map).collect::<Vec<_>>();
        let controls = [0, 1, 2];
        let uniform = |n: usize| Belief::uniform(n).unwrap();
        let even = |n: usize| vec![1.0 / n as f64; n];

        let a = RestartTransition::new(lost(), again, uniform(n + 1)).unwrap();
        let expected = over(&|m| restart(m, again, &even(n + 1)));
        assert_operator(a, Expected::each(&controls, &expected))?;
        let a = OffMapTransition::new(lost(), again, 0.25, uniform(n + 1)).unwrap();
        let expected = over(&|m| off_map(m, again, 0.25, &even(n + 1)));
        assert_operator(a, Expected::each(&controls, &expected))?;
        let a = KroneckerTransition::new(lost(), switched(&vec![turns.clone(); 3])).unwrap();
        let expected = over(&|m| kronecker(m, &turns));
        assert_operator(a, Expected::each(&controls, &expected))?;
        let pairs =
            KroneckerTransition::new(switched(&vec![turns.clone(); 3]), lost()).unwrap();
        let a = OffMapTransition::new(pairs, again, 0.5, uniform(2 * n + 2)).unwrap();
        let expected = over(&|m| off_map(&kronecker(&turns, m), again, 0.5, &even(2 * n + 2)));
        assert_operator(a, Expected::each(&controls, &expected))?;
        let a = DwellTransition::from_leaving(lost(), &vec![[again, 1.0]; n + 1]).unwrap();
        let expected = over(&|m| dwell(m, &vec![vec![again, 1.0]; m.len()]));
        assert_operator(a, Expected::each(&controls, &expected))?;
    }

    /// Two independent chains; the camera sees the place of one, or that it is off the map.
    #[test]
    fn a_camera_sees_place_or_none(
        (gears, places) in (stochastic(false, 2), stochastic(false, 3)),
        (leave, return_rate) in (rate(false), rate(false)),
        ys in vec(vec(-3.0..0.0, 4), 1..5),
    ) {
        let pairs = KroneckerTransition::new(sparse(&gears), sparse(&places)).unwrap();
        let seen = pairs.second_groups();
        let back = vec![1.0 / 6.0; 6];
        let m = off_map(&kronecker(&gears, &places), leave, return_rate, &back);
        let a = OffMapTransition::new(pairs, leave, return_rate, Belief::uniform(6).unwrap());
        let a = a.unwrap();
        let groups = a.groups(&seen).unwrap();
        prop_assert_eq!(groups.as_slice(), [0, 1, 2, 0, 1, 2, 3]);
        let sensor = GroupedLikelihood::new(LikelihoodVector::log(4).owned(), groups).unwrap();
        let prior = Prior::AtFirstObservation(Belief::uniform(7).unwrap());
        let hmm = Hmm::new(prior.clone(), a, sensor).unwrap();
        let plain = Hmm::new(prior, dense(&m), LikelihoodVector::log(7).owned()).unwrap();
        let of = [0, 1, 2, 0, 1, 2, 3];
        let all: Vec<Vec<f64>> =
            ys.iter().map(|y: &Vec<f64>| of.iter().map(|&g| y[g]).collect()).collect();
        close_logs(hmm.log_likelihood(&ys).unwrap(), plain.log_likelihood(&all).unwrap(), 1e-12)?;
        let (path, best) = (hmm.viterbi(&ys).unwrap(), plain.viterbi(&all).unwrap());
        close_logs(path.log_probability(), best.log_probability(), 1e-12)?;
    }
}

#[test]
fn bad_ways_off_the_map_are_named() {
    let new = |leave, return_rate, back: Vec<f64>| {
        text(OffMapTransition::new(still(2), leave, return_rate, Belief::new(back).unwrap()))
    };
    let even = || vec![0.5, 0.5];
    assert_eq!(new(1.5, 0.5, even()), "the rate of leaving is 1.5, expected a value from 0 to 1");
    assert_eq!(new(-0.5, 0.5, even()), "the rate of leaving is -0.5, expected a value from 0 to 1");
    assert_eq!(
        new(f64::NAN, 0.5, even()),
        "the rate of leaving is NaN, expected a value from 0 to 1"
    );
    assert_eq!(new(0.5, 2.0, even()), "the rate of return is 2, expected a value from 0 to 1");
    assert_eq!(
        new(0.5, f64::INFINITY, even()),
        "the rate of return is inf, expected a value from 0 to 1"
    );
    assert_eq!(
        new(0.5, 0.5, vec![1.0]),
        "the return belief has 1 states, expected 2 to match the inner operator"
    );
    let least = f64::MIN_POSITIVE;
    assert_eq!(
        new(0.5, 0.5, vec![1.0, least]),
        format!(
            "the probability of a return to state 1 is {:e}, expected 0 or at least 2.2e-308, the smallest normal double",
            0.5 * least
        )
    );
    let tiny = Belief::new(vec![1.0, least]).unwrap();
    assert!(OffMapTransition::new(still(2), 0.5, 1.0, tiny.clone()).is_ok());
    assert!(OffMapTransition::new(still(2), 0.5, 0.0, tiny).is_ok());

    let a = OffMapTransition::new(still(2), 0.5, 0.5, Belief::uniform(2).unwrap()).unwrap();
    assert_eq!(a.inner().entries(), 2);
    assert_eq!(
        text(a.groups(&Groups::new(vec![0, 0, 1]).unwrap())),
        "the grouping has 3 states, expected 2 to match the inner operator"
    );
    let endless = wayfix::transition::WindowTransition::closed(1, 0, &[1.0]).unwrap();
    let one = Belief::uniform(1).unwrap();
    assert_eq!(OffMapTransition::new(endless, 0.5, 0.5, one).unwrap().off_map_state(), 1);
}

/// The way back onto the map comes last, and is taken only if it is strictly better.
#[test]
fn ties_go_to_the_map() {
    let a = OffMapTransition::new(still(2), 0.5, 0.5, Belief::certain(2, 1).unwrap()).unwrap();
    let (mut out, mut from) = ([0.0; 3], [9; 3]);
    a.max_product(&(), &[0.0, 0.0, 0.0], &mut out, &mut from);
    assert_eq!((out, from), ([-1.0; 3], [0, 1, 0]));
    a.max_product(&(), &[-1.0, 0.0, 1.0], &mut out, &mut from);
    assert_eq!((out, from), ([-2.0, 0.0, 0.0], [0, 2, 2]));
    a.max_product(&(), &[-1.0, 1.0, 1.0], &mut out, &mut from);
    assert_eq!((out, from), ([-2.0, 0.0, 0.0], [0, 1, 1]));
}

/// A drive that leaves the map is decoded as one, and simulated.
#[test]
fn drives_leave_the_map_and_come_back() {
    let around = SparseTransition::from_rows(&[[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    let gate = Belief::certain(3, 1).unwrap();
    let a = OffMapTransition::new(around.unwrap(), 0.125, 0.25, gate).unwrap();
    let camera = TableLikelihood::from_rows(&[
        [0.75, 0.0, 0.0, 0.25],
        [0.0, 0.75, 0.0, 0.25],
        [0.0, 0.0, 0.75, 0.25],
        [0.125, 0.125, 0.125, 0.625],
    ]);
    let prior = Prior::AtFirstObservation(Belief::certain(4, 0).unwrap());
    let hmm = Hmm::new(prior, a, camera.unwrap()).unwrap();
    let path = hmm.viterbi(&[0, 1, 3, 3, 3, 3, 1, 2, 0]).unwrap();
    assert_eq!(path.states(), [0, 1, 3, 3, 3, 3, 1, 2, 0]);
    let drive = hmm.simulate(2000, &mut rng(1));
    let off = drive.states().iter().filter(|state| **state == 3).count();
    // About a third of the steps.
    assert!((500..850).contains(&off), "{off}");
    assert!(
        drive
            .states()
            .windows(2)
            .all(|pair| hmm.transition().outgoing(&(), pair[0]).any(|e| e.0 == pair[1]))
    );
}
