//! The format, and refused values.

use serde::Deserialize;
use serde::de::value::{Error as ValueError, SeqDeserializer};
use wayfix::inference::{
    FilterSnapshot, FixedLagSnapshot, OnlineViterbiSnapshot, PrunedFilterSnapshot,
};
use wayfix::likelihood::{GroupedLikelihood, Groups, SparseObservation};
use wayfix::transition::{
    ConstrainedTransition, DwellTransition, KroneckerTransition, RestartTransition,
    SwitchedTransition, WindowTransition,
};
use wayfix::{
    Belief, DenseTransition, Fixed, FusedLikelihood, Hmm, LikelihoodVector, OptionalLikelihood,
    Prior, SparseLikelihood, SparseTransition, TableLikelihood,
};

use crate::kit::{json, refuses, stored};

#[test]
fn the_format_is_as_documented() {
    let sparse = SparseTransition::from_rows(&[[0.5, 0.0], [0.5, 1.0]]).unwrap();
    assert_eq!(
        json(&sparse),
        r#"{"version":1,"states":2,"to":[0,1,1],"from":[0,0,1],"probability":[0.5,0.5,1.0]}"#
    );
    assert_eq!(
        json(&DenseTransition::from_rows(&[[0.5, 0.0], [0.5, 1.0]]).unwrap()),
        r#"{"version":1,"states":2,"columns":[0.5,0.5,0.0,1.0]}"#
    );
    let tied = ConstrainedTransition::new(sparse.clone()).with_ties(|_, to| to);
    assert_eq!(
        json(&tied),
        format!(
            r#"{{"version":1,"transition":{},"parameters":[0,1,2],"pseudo_counts":[]}}"#,
            json(&sparse)
        )
    );
    let window = WindowTransition::open(4, -2, &[0.0, 0.5, 0.0, 0.5, 0.0]).unwrap();
    assert_eq!(
        json(&window),
        r#"{"version":1,"states":4,"first":-1,"weights":[0.5,0.0,0.5],"closed":false}"#
    );
    assert_eq!(json(&Fixed(window.clone())), json(&window));
    let still = SparseTransition::from_rows(&[[1.0]]).unwrap();
    let within = json(&still);
    let restart = RestartTransition::new(still.clone(), 0.25, Belief::uniform(1).unwrap());
    assert_eq!(
        json(&restart.unwrap()),
        format!(r#"{{"version":1,"inner":{within},"keep":0.75,"restart":[0.25],"evidence":null}}"#)
    );
    assert_eq!(
        json(&KroneckerTransition::new(still.clone(), still.clone()).unwrap()),
        format!(r#"{{"version":1,"first":{within},"second":{within}}}"#)
    );
    assert_eq!(
        json(&SwitchedTransition::new(vec![still.clone()]).unwrap()),
        format!(r#"{{"version":1,"operators":[{within}]}}"#)
    );
    assert_eq!(
        json(&DwellTransition::new(still.clone(), &[vec![0.5, 0.5]]).unwrap()),
        format!(
            r#"{{"version":1,"moves":{within},"ages":[[[0.5,0.5],[1.0,0.0]]],"durations":[]}}"#
        )
    );

    let table = TableLikelihood::from_rows(&[[0.75, 0.25], [0.5, 0.5]]).unwrap();
    let rows = json(&table);
    assert_eq!(rows, r#"{"version":1,"rows":[[0.75,0.25],[0.5,0.5]]}"#);
    let optional = OptionalLikelihood::new(table);
    assert_eq!(json(&optional), format!(r#"{{"version":1,"sensor":{rows}}}"#));
    let scores = LikelihoodVector::log(2).owned();
    let fused = FusedLikelihood::new(SparseLikelihood::new(2), scores).unwrap();
    assert_eq!(
        json(&fused),
        r#"{"version":1,"first":{"version":1,"states":2},"second":{"version":1,"states":2,"log":true}}"#
    );
    let groups = Groups::new(vec![0, 1, 1]).unwrap();
    let grouped = GroupedLikelihood::new(SparseLikelihood::new(2), groups).unwrap();
    assert_eq!(
        json(&grouped),
        r#"{"version":1,"sensor":{"version":1,"states":2},"groups":[0,1,1]}"#
    );

    let prior = Prior::BeforeFirstTransition(Belief::new(vec![0.5, 0.5]).unwrap());
    let hmm = Hmm::new(prior, sparse.clone(), LikelihoodVector::log(2)).unwrap();
    assert_eq!(
        json(&hmm),
        format!(
            r#"{{"version":1,"prior":{{"before_first_transition":[0.5,0.5]}},"transition":{},"likelihood":{{"version":1,"states":2,"log":true}},"rounds_tails":false}}"#,
            json(&sparse)
        )
    );
    assert!(
        json(&Prior::AtFirstObservation(hmm.prior().belief().clone()))
            .contains("at_first_observation")
    );
    let mut smoother = hmm.fixed_lag(1);
    smoother.step(&[0.0, f64::NEG_INFINITY]).unwrap();
    smoother.step(&[0.0, -1000.0]).unwrap();
    let present = r#"{"version":1,"steps":2,"steps_in_logs":1,"belief":[1.0,0.0],"logs":[0.0,-1000.0],"log_likelihood":[-2.0794415416798357,-1.1102230246251565e-16]}"#;
    let past = r#"{"version":1,"steps":1,"steps_in_logs":0,"belief":[1.0,0.0],"logs":null,"log_likelihood":[-1.3862943611198906,0.0]}"#;
    assert_eq!(
        json(&smoother.snapshot()),
        format!(r#"{{"version":1,"lag":1,"present":{present},"past":[[{past},null]]}}"#)
    );
    stored(&smoother.snapshot());
    assert_eq!(json(&smoother.lagged()), "[1.0,0.0]");
}

#[test]
fn what_is_no_belief_group_or_table_is_refused() {
    refuses::<Belief>("[0.5,null]", "invalid type: null, expected f64");
    refuses::<Belief>("[0.5,0.4]", "the sum of the probabilities is 0.9, expected 1");
    refuses::<Belief>("[]", "the number of states of a belief is 0, expected at least 1");
    refuses::<Belief>(
        "[1.5,-0.5]",
        "the probability of state 1 is -0.5, expected a finite value of at least 0",
    );
    // Formats other than JSON have NaN.
    let nan = SeqDeserializer::<_, ValueError>::new([0.5, f64::NAN].into_iter());
    assert_eq!(
        Belief::deserialize(nan).unwrap_err().to_string(),
        "the probability of state 1 is NaN, expected a finite value of at least 0"
    );
    refuses::<Groups>(
        "[0,2]",
        "the number of states in group 1 is 0, expected at least 1, as groups are numbered up to 2",
    );
    refuses::<TableLikelihood>(
        r#"{"version":1,"rows":[[0.5,0.5],[0.5,0.4]]}"#,
        "the sum of the symbol probabilities of state 1 is 0.9, expected 1",
    );
    refuses::<TableLikelihood>(
        r#"{"version":1,"rows":[[0.5,0.5],[1.0]]}"#,
        "the length of the row of state 1 is 1, expected 2",
    );
    refuses::<GroupedLikelihood<SparseLikelihood>>(
        r#"{"version":1,"sensor":{"version":1,"states":2},"groups":[0,0]}"#,
        "the sensor has 2 states, expected 1 to match the number of groups",
    );
    refuses::<FusedLikelihood<SparseLikelihood, SparseLikelihood>>(
        r#"{"version":1,"first":{"version":1,"states":2},"second":{"version":1,"states":3}}"#,
        "the second sensor has 3 states, expected 2 to match the first sensor",
    );
    refuses::<OptionalLikelihood<SparseLikelihood>>(
        r#"{"version":1,"sensor":{"version":1,"states":18446744073709551615}}"#,
        "memory allocation failed because the computed capacity exceeded the collection's maximum",
    );
}

#[test]
fn other_versions_and_fields_are_refused() {
    refuses::<SparseLikelihood>(r#"{"version":2,"states":3}"#, "version 2, expected 1");
    refuses::<SparseLikelihood>(r#"{"states":3}"#, "missing field `version`");
    refuses::<SparseLikelihood>(r#"{"version":1}"#, "missing field `states`");
    refuses::<SparseLikelihood>(
        r#"{"version":1,"states":3,"state":3}"#,
        "unknown field `state`, expected `version` or `states`",
    );
    refuses::<SparseLikelihood>("7", "invalid type: integer `7`, expected struct SparseLikelihood");
    refuses::<FilterSnapshot>(
        r#"{"version":3,"steps":0,"steps_in_logs":0,"belief":[1.0],"logs":null,"log_likelihood":[0,0]}"#,
        "version 3, expected 1",
    );
}

#[test]
fn what_is_no_operator_is_refused() {
    let sparse = |to: &str, from: &str, p: &str, expected: &str| {
        refuses::<SparseTransition>(
            &format!(r#"{{"version":1,"states":2,"to":{to},"from":{from},"probability":{p}}}"#),
            expected,
        );
    };
    sparse(
        "[0,1]",
        "[0,1]",
        "[1,0.9]",
        "column 1 (the transitions out of state 1) sums to 0.9, expected 1",
    );
    sparse(
        "[0,1]",
        "[0,1]",
        "[1,-1]",
        "the transition from state 1 to state 1 has probability -1, expected a finite value of at least 0",
    );
    sparse("[0,1]", "[0,1]", "[1,null]", "invalid type: null, expected f64");
    sparse(
        "[0,1]",
        "[0,1]",
        "[1]",
        "the number of values in `probability` is 1, expected as many as in `to`",
    );
    sparse(
        "[0,1]",
        "[0,1,1]",
        "[1,1]",
        "the number of values in `from` is 3, expected as many as in `to`",
    );
    sparse(
        "[0,2]",
        "[0,1]",
        "[1,1]",
        "the transition from state 1 to state 2 is out of range, there are 2 states (0 to 1)",
    );
    refuses::<SparseTransition>(
        r#"{"version":1,"states":4294967295,"to":[0,0],"from":[0,2],"probability":[1,1]}"#,
        "column 1 (the transitions out of state 1) sums to 0, expected 1",
    );
    refuses::<DenseTransition>(
        r#"{"version":1,"states":2,"columns":[1,0,0]}"#,
        "3 values given for 2 states, expected 4 (states squared)",
    );
    refuses::<DenseTransition>(
        r#"{"version":1,"states":2,"columns":[1,0,0.5,0.4]}"#,
        "column 1 (the transitions out of state 1) sums to 0.9, expected 1",
    );
    refuses::<SwitchedTransition<DenseTransition>>(
        r#"{"version":1,"operators":[]}"#,
        "a transition operator needs at least one state, found none",
    );
    refuses::<WindowTransition>(
        r#"{"version":1,"states":3,"first":1,"weights":[1],"closed":"bounce"}"#,
        "invalid type: string \"bounce\", expected a boolean",
    );
}

#[test]
fn what_is_no_structured_operator_is_refused() {
    let one = r#"{"version":1,"states":1,"columns":[1]}"#;
    let restart = |keep: &str, restart: &str, expected: &str| {
        refuses::<RestartTransition<DenseTransition>>(
            &format!(r#"{{"version":1,"inner":{one},"keep":{keep},"restart":{restart}}}"#),
            expected,
        );
    };
    restart("0.5", "[0.25]", "the probability of a restart or none is 0.75, expected 1");
    restart("1.5", "[0]", "the probability of no restart is 1.5, expected a value from 0 to 1");
    restart(
        "1",
        "[-1]",
        "the probability of a restart in state 0 is -1, expected a finite value of at least 0",
    );
    restart(
        "1",
        "[0,0]",
        "the restart belief has 2 states, expected 1 to match the inner operator",
    );
    let dwell = |ages: &str, expected: &str| {
        refuses::<DwellTransition<DenseTransition>>(
            &format!(r#"{{"version":1,"moves":{one},"ages":{ages},"durations":[]}}"#),
            expected,
        );
    };
    dwell("[[]]", "the number of ages of place 0 is 0, expected at least 1");
    dwell("[]", "the dwell table has 0 states, expected 1 to match the inner operator");
    dwell(
        "[[[0.5,0.5],[1.5,-0.5]]]",
        "the probability of leaving place 0 after 2 steps is 1.5, expected a value from 0 to 1",
    );
    dwell(
        "[[[0.5,-0.5]]]",
        "the probability of staying in place 0 after 1 steps is -0.5, expected a value from 0 to 1",
    );
    dwell(
        "[[[0.5,0.25]]]",
        "the probability of leaving or staying in place 0 after 1 steps is 0.75, expected 1",
    );
    let tied = |parameters: &str, expected: &str| {
        let two = r#"{"version":1,"states":2,"to":[0,1,0,1],"from":[0,0,1,1],"probability":[0.25,0.75,0.75,0.25]}"#;
        refuses::<ConstrainedTransition>(
            &format!(
                r#"{{"version":1,"transition":{two},"parameters":{parameters},"pseudo_counts":[]}}"#
            ),
            expected,
        );
    };
    tied("[0,1,2]", "3 parameters for 4 entries, expected one each");
    tied("[0,1,3,4]", "no entry has parameter 2, though one has a higher one");
    tied("[0,1,4294967295,0]", "no entry has parameter 2, though one has a higher one");
    let unlike = |from, to, parameter| {
        format!(
            "the transition from state {from} to state {to} has parameter {parameter}, which another state has with other parameters or another probability"
        )
    };
    tied("[0,1,0,1]", &unlike(1, 0, 0)); // 0.25 and 0.75
    tied("[0,1,1,2]", &unlike(1, 0, 1)); // tied, but without the other
    tied("[0,0,1,2]", &unlike(0, 1, 0));
}

type Staying = Hmm<DwellTransition<DenseTransition>, SparseLikelihood>;

#[test]
fn what_is_no_model_is_refused_with_all_that_is_behind() {
    let hmm = |belief: &str, first: f64| {
        let a = r#"{"version":1,"states":1,"columns":[1]}"#;
        let dwell =
            format!(r#"{{"version":1,"moves":{a},"ages":[[[{first},0.25]]],"durations":[]}}"#);
        let part = r#"{"version":1,"states":1}"#;
        format!(
            r#"{{"version":1,"prior":{{"at_first_observation":{belief}}},"transition":{dwell},"likelihood":{part},"rounds_tails":false}}"#
        )
    };
    refuses::<Staying>(
        &hmm("[0.5,0.5]", 0.75),
        "the transition operator has 1 states, expected 2 to match the prior",
    );
    // Each part is right up to rounding, but their product is not.
    let restart = r#"{"version":1,"inner":{"version":1,"states":1,"columns":[1.0000000009]},"keep":0.5,"restart":[0.5000000009]}"#;
    refuses::<Hmm<RestartTransition<DenseTransition>, SparseLikelihood>>(
        &format!(
            r#"{{"version":1,"prior":{{"at_first_observation":[1]}},"transition":{restart},"likelihood":{{"version":1,"states":1}},"rounds_tails":false}}"#
        ),
        "the transition operator is not valid: column 0 (the transitions out of state 0) sums to 1.0000000013500001, expected 1",
    );
    refuses::<Staying>(
        &hmm("[1]", 0.75).replace("at_first", "at_last"),
        "unknown variant `at_last_observation`, expected one of `before_first_transition`, `at_first_observation`, `stationary`",
    );
}

fn state(steps: usize, belief: &str, logs: &str, log_likelihood: &str) -> String {
    format!(
        r#"{{"version":1,"steps":{steps},"steps_in_logs":0,"belief":{belief},"logs":{logs},"log_likelihood":{log_likelihood}}}"#
    )
}

#[test]
fn what_no_filter_knows_is_refused() {
    let refused = |steps: usize, belief: &str, logs: &str, expected: &str| {
        refuses::<FilterSnapshot>(&state(steps, belief, logs, "[0,0]"), expected);
    };
    refused(1, "[0.5,0.4]", "null", "the sum of the probabilities is 0.9, expected 1");
    refused(1, "[0.5,null]", "null", "invalid type: null, expected f64");
    refused(1, "[1,0]", "[0]", "1 logarithms for a belief over 2 states");
    refused(
        1,
        "[1,0]",
        "[0.5,null]",
        "state 0 has probability 1, expected exp(0.5) as its logarithm says",
    );
    refused(
        1,
        "[1,0]",
        "[null,0]",
        "state 0 has probability 1, expected exp(-inf) as its logarithm says",
    );
    refused(
        9_007_199_254_740_993,
        "[1]",
        "null",
        "9007199254740993 steps, expected at most 9007199254740992",
    );
    refuses::<FilterSnapshot>(
        &state(1, "[1]", "null", "[0]"),
        "invalid length 1, expected an array of length 2",
    );
    refuses::<FilterSnapshot>(
        &state(1, "[1]", "null", "[null,0]"),
        "invalid type: null, expected f64",
    );
    refuses::<FilterSnapshot>(
        &state(1, "[1]", "null", "[1e308,1e308]"),
        &format!("the log-likelihood is the sum of {0} and {0}, expected finite values", 1e308),
    );
}

#[test]
fn what_no_pruned_filter_knows_is_refused() {
    let state = |log_likelihood: &str, log_excess: &str| {
        format!(
            r#"{{"version":1,"states":2,"steps":1,"tolerance":1e-6,"most_active":null,"active":[0],"estimate":[1.0],"lower":[1.0],"excess":[0.0],"others":[0.0,0.0],"bound":0.0,"log_likelihood":{log_likelihood},"log_excess":{log_excess},"log_lost":false,"share":1e-8}}"#
        )
    };
    serde_json::from_str::<PrunedFilterSnapshot>(&state("[-3.0,0.0]", "[1e-15,0.0]")).unwrap();
    // Otherwise the upper bound of the log-likelihood would be below the lower one.
    refuses::<PrunedFilterSnapshot>(
        &state("[-3.0,0.0]", "[1e-15,-1000.0]"),
        "the log-likelihood may be 0.000000000000001 and -1000 more, expected at least 0",
    );
    refuses::<PrunedFilterSnapshot>(
        &state("[-1e308,-1e308]", "[0.0,0.0]"),
        &format!("the log-likelihood is the sum of {0} and {0}, expected finite values", -1e308),
    );
}

#[test]
fn what_no_decoder_knows_is_refused() {
    let state = |taken_out: &str| {
        format!(
            r#"{{"version":1,"steps":1,"scores":[0.0,null],"taken_out":{taken_out},"undecided":[]}}"#
        )
    };
    serde_json::from_str::<OnlineViterbiSnapshot>(&state("[-4,-0.5,1e-17]")).unwrap();
    for (taken_out, whole, sum, lost) in [
        ("[0,1e308,1e308]", 0.0, 1e308, 1e308),
        ("[1.7e308,1e308,0]", 1.7e308, 1e308, 0.0),
        ("[0.5,0,0]", 0.5, 0.0, 0.0),
    ] {
        refuses::<OnlineViterbiSnapshot>(
            &state(taken_out),
            &format!(
                "{whole}, {sum} and {lost} were taken out of the scores, expected a whole number \
                 and finite values"
            ),
        );
    }
}

/// Otherwise a filter could store what cannot be read.
#[test]
fn the_most_steps_that_are_read_are_the_most_that_are_taken() {
    let most = state(9_007_199_254_740_992, "[0.25,0.75]", "null", "[-5,0]");
    let most: FilterSnapshot = serde_json::from_str(&most).unwrap();
    let hmm = Hmm::new(
        Prior::AtFirstObservation(Belief::uniform(2).unwrap()),
        crate::kit::still(2),
        SparseLikelihood::new(2),
    )
    .unwrap();
    let mut filter = hmm.filter();
    filter.restore(&most).unwrap();
    let known = SparseObservation::known(1);
    let full = "9007199254740992 steps have been taken, the most that can be counted";
    assert_eq!(filter.step(&known).unwrap_err().to_string(), full);
    assert_eq!(filter.predict().unwrap_err().to_string(), full);
    assert_eq!(filter.snapshot(), most);
    let text = serde_json::to_string(&filter.snapshot()).unwrap();
    assert_eq!(serde_json::from_str::<FilterSnapshot>(&text).unwrap(), most);
    filter.update(&known).unwrap();
    assert_eq!(filter.snapshot().steps(), most.steps());
}

#[test]
fn what_no_smoother_knows_is_refused() {
    let refused = |lag: usize, past: &[String], expected: &str| {
        let present = state(2, "[0.5,0.5]", "null", "[0,0]");
        let past: Vec<_> = past.iter().map(|past| format!("[{past},null]")).collect();
        let past = past.join(",");
        refuses::<FixedLagSnapshot<()>>(
            &format!(r#"{{"version":1,"lag":{lag},"present":{present},"past":[{past}]}}"#),
            expected,
        );
    };
    let past = |steps, belief| state(steps, belief, "null", "[0,0]");
    let one = "[0.5,0.5]";
    refused(
        1,
        &[past(0, one), past(1, one)],
        "2 past states after 2 steps with a lag of 1, expected at most 1",
    );
    refused(
        3,
        &[past(0, one), past(1, one), past(2, one)],
        "3 past states after 2 steps with a lag of 3, expected at most 2",
    );
    refused(2, &[past(1, one), past(1, one)], "past state 0 is of step 1, expected 0");
    refused(2, &[past(0, one), past(2, one)], "past state 1 is of step 2, expected 1");
    refused(
        2,
        &[past(0, one), past(1, "[1]")],
        "past state 1 is over 1 states, expected 2 as the present one",
    );
    refused(
        2,
        &[past(0, one), past(1, "[0.5,0.4]")],
        "the sum of the probabilities is 0.9, expected 1",
    );
}

/// Rounded tails are stored, too.
#[test]
fn the_canberra_model_comes_back_to_the_bit() {
    let hmm = wayfix::canberra::hmm(5, 1.0).unwrap();
    let restored: Hmm<SparseTransition, TableLikelihood> = stored(&hmm);
    assert!(hmm.rounds_tails() && restored.rounds_tails());
    let ys = [4, 5, 5, 7, 8, 50, 8];
    assert_eq!(restored.smooth(&ys).unwrap(), hmm.smooth(&ys).unwrap());
    assert_eq!(restored.viterbi(&ys).unwrap(), hmm.viterbi(&ys).unwrap());
}
