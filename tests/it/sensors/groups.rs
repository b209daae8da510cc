//! Sensors of places for expanded states, and known states.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::likelihood::{GroupedLikelihood, Groups, SparseObservation};
use wayfix::transition::WindowTransition;
use wayfix::{
    Belief, FusedLikelihood, Hmm, LikelihoodVector, OptionalLikelihood, Prior, SparseLikelihood,
    TableLikelihood,
};

use crate::kit::{NEVER, any_stochastic, cases, close_logs, normalized, sparse, still, text};

proptest! {
    #![proptest_config(cases())]

    /// A known state is a likelihood of 0 elsewhere.
    #[test]
    fn known_states_constrain(
        m in any_stochastic(false, 4), rows in vec((vec(-5.0..0.0, 4), any::<Option<u8>>()), 1..5),
    ) {
        let n = m.len();
        let prior = Prior::BeforeFirstTransition(Belief::uniform(n).unwrap());
        let known: Vec<(Vec<f64>, Option<usize>)> = rows.iter()
            .map(|(logs, known)| (logs[..n].to_vec(), known.map(|k| usize::from(k) % n))).collect();
        let ruled: Vec<Vec<f64>> = known.iter().map(|(logs, known)| {
            let rule = |i| known.is_none_or(|known| known == i);
            logs.iter().enumerate().map(|(i, log)| if rule(i) { *log } else { NEVER }).collect()
        }).collect();
        let sensor = LikelihoodVector::log(n).owned();
        let fused = FusedLikelihood::new(sensor, OptionalLikelihood::new(SparseLikelihood::new(n))).unwrap();
        let seen: Vec<_> = known.iter()
            .map(|(logs, known)| (logs.clone(), known.map(SparseObservation::known))).collect();
        let plain = Hmm::new(prior.clone(), sparse(&m), sensor).unwrap();
        let hmm = Hmm::new(prior, sparse(&m), fused).unwrap();
        match (plain.viterbi(&ruled), hmm.viterbi(&seen)) {
            (Ok(expected), Ok(found)) => {
                prop_assert_eq!(found.states(), expected.states());
                close_logs(found.log_probability(), expected.log_probability(), 1e-12)?;
                let (found, expected) = (hmm.smooth(&seen).unwrap(), plain.smooth(&ruled).unwrap());
                close_logs(found.log_likelihood(), expected.log_likelihood(), 1e-12)?;
            }
            (expected, found) => prop_assert!(expected.is_err() && found.is_err()),
        }
    }

    /// A table of places, lifted, is the table with its rows repeated.
    #[test]
    fn grouped_sensors_are_repeated_rows(
        of in vec(0..3_usize, 1..7), weights in vec(vec(0.01..1.0, 3), 3),
        ys in vec(0..3_usize, 1..5),
    ) {
        let of = [of, vec![2, 0, 1]].concat();
        let n = of.len();
        let rows: Vec<Vec<f64>> = weights.into_iter().map(|w| normalized(w, 0)).collect();
        let repeated: Vec<_> = of.iter().map(|&g| rows[g].clone()).collect();
        let prior = Prior::AtFirstObservation(Belief::uniform(n).unwrap());
        let around = WindowTransition::closed(n, 0, &[0.5, 0.5]).unwrap();
        let groups = Groups::new(of).unwrap();
        let table = TableLikelihood::from_rows(&rows).unwrap();
        let grouped = Hmm::new(prior.clone(), &around, GroupedLikelihood::new(table, groups).unwrap());
        let plain = Hmm::new(prior, &around, TableLikelihood::from_rows(&repeated).unwrap());
        let (grouped, plain) = (grouped.unwrap(), plain.unwrap());
        let smoothed = [grouped.smooth(&ys).unwrap(), plain.smooth(&ys).unwrap()];
        prop_assert_eq!(smoothed[0].log_likelihood(), smoothed[1].log_likelihood());
        let [a, b] = smoothed.each_ref().map(|s| s.posteriors().as_slice());
        prop_assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-12 * b), "{:?}", smoothed);
        prop_assert_eq!(grouped.viterbi(&ys).unwrap(), plain.viterbi(&ys).unwrap());
    }
}

#[test]
fn bad_groups_and_unknown_states_are_named() {
    assert_eq!(text(Groups::new(vec![])), "the number of grouped states is 0, expected at least 1");
    assert_eq!(
        text(Groups::new(vec![0, 2, 2])),
        "the number of states in group 1 is 0, expected at least 1, as groups are numbered up to 2"
    );
    assert_eq!(
        text(Groups::new(vec![0, usize::MAX])),
        format!(
            "the number of states in group 1 is 0, expected at least 1, as groups are numbered up to {}",
            usize::MAX
        )
    );
    let groups = Groups::new(vec![1, 0, 1]).unwrap();
    assert_eq!((groups.count(), groups.group_of(2), groups.group_of(3)), (2, Some(1), None));
    assert!(groups.states(1).eq([0, 2]) && groups.states(0).eq([1]) && groups.states(2).len() == 0);
    assert_eq!(
        text(groups.marginal(&Belief::uniform(2).unwrap())),
        "the number of states of the belief is 2, expected 3"
    );
    assert_eq!(text(groups.map_path(&[0, 3])), "the state is 3, expected 0 to 2");
    assert_eq!(
        text(GroupedLikelihood::new(SparseLikelihood::new(3), groups.clone())),
        "the sensor has 3 states, expected 2 to match the number of groups"
    );

    let prior = || Prior::AtFirstObservation(Belief::uniform(2).unwrap());
    let hmm = Hmm::new(prior(), still(2), SparseLikelihood::new(2)).unwrap();
    let error = hmm.smooth(&[1, 2].map(SparseObservation::known)).unwrap_err();
    assert_eq!(
        error.to_string(),
        "step 2 has no valid likelihood: the observation lists state 2, but there are 2 states (0 to 1)"
    );
    // A vector of a wrong length is found before it is spread over the states.
    let groups = Groups::new(vec![0, 0]).unwrap();
    let vector = GroupedLikelihood::new(LikelihoodVector::linear(1), groups).unwrap();
    let error = Hmm::new(prior(), still(2), vector).unwrap().filter().step(&[0.5; 3]).unwrap_err();
    assert_eq!(
        error.to_string(),
        "step 1 has no valid likelihood: the likelihood has 3 values, expected one for each of 1 states"
    );
}
