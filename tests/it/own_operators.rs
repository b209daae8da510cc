//! Operators and sensors of a user's own, checked by the kits: those that agree pass, and each kind of
//! mistake is named. (That all operators of the core pass is part of `assert_operator`.)

use proptest::prelude::*;
use rand::{Rng, RngExt};
use wayfix::error::Disagreement;
use wayfix::likelihood::{
    Groups, LocalLikelihood, SampleObservation, SparseObservation, SparseTableLikelihood,
    kit as sensor_kit,
};
use wayfix::transition::{
    EvidenceTransition, LearnFromMoves, MoveCounts, RestartTransition, Stored, kit,
};
use wayfix::{
    Belief, Diagonal, Fixed, FusedLikelihood, Hmm, Likelihood, LikelihoodError, LikelihoodVector,
    OptionalLikelihood, Prior, Scratch, SparseLikelihood, SparseTransition, TableLikelihood,
    Transition, TransitionEntries, TransitionError,
};

use crate::kit::{Own, any_stochastic, cases, rng, sparse, text};

/// A correct operator; a test breaks one of its methods.
struct Wrong {
    right: SparseTransition,
    /// Name of the method.
    method: &'static str,
    disturb: fn(&mut Vec<f64>),
}

impl Wrong {
    fn new(method: &'static str, disturb: fn(&mut Vec<f64>)) -> Self {
        let right = SparseTransition::from_rows(&[
            [0.5, 0.0, 0.25, 0.0],
            [0.5, 0.5, 0.25, 0.0],
            [0.0, 0.5, 0.25, 0.0],
            [0.0, 0.0, 0.25, 1.0],
        ]);
        Self { right: right.unwrap(), method, disturb }
    }

    fn values(&self, method: &str, out: &mut [f64]) {
        if self.method == method {
            let mut values = out.to_vec();
            (self.disturb)(&mut values);
            out.copy_from_slice(&values);
        }
    }

    /// The values of a list, with its states.
    fn list(
        &self,
        method: &str,
        list: impl Iterator<Item = (usize, f64)>,
    ) -> impl Iterator<Item = (usize, f64)> {
        let (states, mut values): (Vec<usize>, Vec<f64>) = list.unzip();
        self.values(method, &mut values);
        states.into_iter().zip(values)
    }

    fn error(&self) -> String {
        text(kit::check(self, &()))
    }
}

impl Transition for Wrong {
    type Control = ();
    fn states(&self) -> usize {
        self.right.states()
    }
    fn apply(&self, (): &(), x: &[f64], out: &mut [f64]) {
        self.right.apply(&(), x, out);
        self.values("apply", out);
    }
    fn apply_transpose(&self, (): &(), x: &[f64], out: &mut [f64]) {
        self.right.apply_transpose(&(), x, out);
        self.values("apply_transpose", out);
    }
    fn apply_log(&self, (): &(), x: &[f64], out: &mut [f64]) {
        self.right.apply_log(&(), x, out);
        self.values("apply_log", out);
    }
    fn apply_transpose_log(&self, (): &(), x: &[f64], out: &mut [f64]) {
        self.right.apply_transpose_log(&(), x, out);
        self.values("apply_transpose_log", out);
    }
    fn apply_in_blocks(&self, (): &(), x: &[f64], take: &mut dyn FnMut(usize, &[f64])) {
        let mut out = vec![0.0; x.len()];
        self.right.apply(&(), x, &mut out);
        self.values("apply_in_blocks", &mut out);
        take(0, &out[..2]);
        take(if self.method == "blocks" { 1 } else { 2 }, &out[2..]);
    }
    fn smallest_entry(&self, (): &()) -> f64 {
        if self.method == "smallest_entry" { 0.375 } else { 0.25 }
    }
    fn stored(&self, (): &()) -> Option<Stored<'_>> {
        (self.method != "stored").then(|| self.right.stored(&())).flatten()
    }
    fn check_control(&self, (): &()) -> Result<(), TransitionError> {
        if self.method == "check_control" {
            return Err(TransitionError::Control("not today".into()));
        }
        Ok(())
    }
}

impl TransitionEntries for Wrong {
    fn incoming(&self, (): &(), to: usize) -> impl Iterator<Item = (usize, f64)> {
        self.list("incoming", self.right.incoming(&(), to))
    }
    fn outgoing(&self, (): &(), from: usize) -> impl Iterator<Item = (usize, f64)> {
        let list = self.list("outgoing", self.right.outgoing(&(), from));
        let mut list: Vec<_> = list.collect();
        match self.method {
            "reversed" => list.reverse(),
            "beyond" => list.push((4, 0.1)),
            "zero" => list.push((3, 0.0)),
            _ => {}
        }
        list.into_iter()
    }
    fn incoming_log2(&self, (): &(), to: usize) -> impl Iterator<Item = (usize, f64)> {
        self.list("incoming_log2", self.right.incoming_log2(&(), to))
    }
    fn outgoing_log2(&self, (): &(), from: usize) -> impl Iterator<Item = (usize, f64)> {
        self.list("outgoing_log2", self.right.outgoing_log2(&(), from))
    }
    fn max_product(&self, (): &(), x: &[f64], out: &mut [f64], from: &mut [u32]) {
        self.right.max_product(&(), x, out, from);
        self.values("max_product", out);
        if self.method == "highest" {
            // The last of equal predecessors.
            for (to, from) in from.iter_mut().enumerate() {
                let entries = self.right.incoming_log2(&(), to).filter(|e| e.1 + x[e.0] == out[to]);
                *from = entries.last().map_or(*from, |entry| entry.0 as u32);
            }
        }
        if self.method == "predecessor" {
            from.fill(3);
        }
    }
}

#[test]
fn a_right_operator_passes() {
    assert_eq!(kit::check(&Wrong::new("none", |_| {}), &()), Ok(()));
    assert_eq!(kit::check(&Wrong::new("stored", |_| {}), &()), Ok(()));
}

#[test]
fn each_method_that_disagrees_is_named_with_its_states() {
    let half = |values: &mut Vec<f64>| {
        if let Some(value) = values.iter_mut().find(|value| **value == 0.5) {
            *value = 0.375;
        }
    };
    let entry = |method| {
        format!(
            "`{method}` gives 0.375 for the transition from state 0 to state 0, expected 0.5 as by its other methods"
        )
    };
    for method in ["outgoing", "incoming", "apply_transpose", "apply_in_blocks"] {
        assert_eq!(Wrong::new(method, half).error(), entry(method));
    }
    let minus_one = |values: &mut Vec<f64>| {
        if let Some(value) = values.iter_mut().find(|value| **value == -1.0) {
            *value = -3.0;
        }
    };
    for method in ["outgoing_log2", "incoming_log2", "max_product"] {
        let error = Wrong::new(method, minus_one).error();
        let expected = format!(
            "`{method}` gives -3 for the transition from state 0 to state 0, expected -1 as by its other methods"
        );
        assert_eq!(error, expected);
    }
    let lower = |values: &mut Vec<f64>| values.iter_mut().for_each(|value| *value -= 0.125);
    for method in ["apply_log", "apply_transpose_log"] {
        let error = kit::check(&Wrong::new(method, lower), &()).unwrap_err();
        let TransitionError::Disagreement(wrong) = error else { panic!("{error}") };
        let Disagreement { method: found, to, from, found: value, expected, .. } = wrong;
        assert_eq!((found, to, from), (method, Some(0), Some(0)));
        assert!((value - expected + 0.125).abs() < 1e-12);
    }
    let smallest = "`smallest_entry` gives 0.375 for the transition from state 2 to state 0, expected 0.25 as by its other methods";
    assert_eq!(Wrong::new("smallest_entry", |_| {}).error(), smallest);
    let blocks = "`apply_in_blocks` passes state 1 2 times, expected once for each state";
    assert_eq!(Wrong::new("blocks", |_| {}).error(), blocks);
    assert_eq!(Wrong::new("check_control", |_| {}).error(), "not today");
}

#[test]
fn a_stored_matrix_must_be_that_of_the_products() {
    /// Moves on where the stored matrix stays.
    struct Swapped(SparseTransition);
    impl Transition for Swapped {
        type Control = ();
        fn states(&self) -> usize {
            2
        }
        fn apply(&self, (): &(), x: &[f64], out: &mut [f64]) {
            out.copy_from_slice(&[x[1], x[0]]);
        }
        fn apply_transpose(&self, (): &(), x: &[f64], out: &mut [f64]) {
            out.copy_from_slice(&[x[1], x[0]]);
        }
        fn stored(&self, (): &()) -> Option<Stored<'_>> {
            self.0.stored(&())
        }
    }
    impl TransitionEntries for Swapped {
        fn incoming(&self, (): &(), to: usize) -> impl Iterator<Item = (usize, f64)> {
            [(1 - to, 1.0)].into_iter()
        }
        fn outgoing(&self, (): &(), from: usize) -> impl Iterator<Item = (usize, f64)> {
            [(1 - from, 1.0)].into_iter()
        }
    }
    let still = SparseTransition::from_rows(&[[1.0, 0.0], [0.0, 1.0]]).unwrap();
    let expected = "`stored` gives 1 for the transition from state 0 to state 0, expected 0 as by its other methods";
    assert_eq!(text(kit::check(&Swapped(still), &())), expected);
}

#[test]
fn lists_that_break_their_contract_are_described() {
    let error = |method| Wrong::new(method, |_| {}).error();
    let reversed = "`outgoing` of state 0 lists state 0 after state 1, expected ascending states";
    assert_eq!(error("reversed"), reversed);
    let beyond = "`outgoing` of state 0 lists state 4, but there are 4 states";
    assert_eq!(error("beyond"), beyond);
    let zero = "`outgoing` of state 0 lists state 3 with 0, expected entries above 0";
    assert_eq!(error("zero"), zero);
}

#[test]
fn a_predecessor_must_be_the_lowest_of_the_best() {
    let starts = |text: String, start: &str| assert!(text.starts_with(start), "{text}");
    let wrong =
        "`the predecessor of max_product` gives -inf for the transition from state 3 to state 0";
    starts(Wrong::new("predecessor", |_| {}).error(), wrong);
    // States 0 and 1 lead to state 1 with one half each.
    let wrong =
        "`the predecessor of max_product` gives -1 for the transition from state 1 to state 1";
    starts(Wrong::new("highest", |_| {}).error(), wrong);
}

#[test]
fn values_that_are_no_probabilities_are_errors() {
    let first = |value: f64| -> fn(&mut Vec<f64>) {
        if value.is_nan() { |out| out[0] = f64::NAN } else { |out| out[0] = -0.5 }
    };
    for value in [f64::NAN, -0.5] {
        let error = Wrong::new("apply", first(value)).error();
        let expected = format!(
            "the transition from state 0 to state 0 has probability {value}, expected a finite value of at least 0"
        );
        assert_eq!(error, expected);
        for method in ["apply_transpose", "apply_in_blocks", "apply_log", "apply_transpose_log"] {
            let wrong = Wrong::new(method, first(value));
            assert!(wrong.error().starts_with(&format!("`{method}` gives {value}")), "{method}");
        }
    }
    let leaky = Own(vec![vec![1.0, 0.0], vec![0.0, 0.9]]);
    let expected = "column 1 (the transitions out of state 1) sums to 0.9, expected 1";
    assert_eq!(text(kit::check(&leaky, &())), expected);
}

/// A product that drops small numbers is not linear.
#[test]
fn products_at_other_scales_are_compared() {
    let drop = |out: &mut Vec<f64>| {
        out.iter_mut().filter(|out| **out < 1e-30).for_each(|out| *out = 0.0);
    };
    let error = Wrong::new("apply_transpose", drop).error();
    assert!(error.starts_with("`apply_transpose` gives 0 for state 0, expected"), "{error}");
}

#[test]
fn restarts_go_outside_evidence() {
    let restart = RestartTransition::new(Own(vec![vec![1.0]]), 0.5, Belief::certain(1, 0).unwrap());
    let within: Box<RestartTransition<Own>> = Box::new(restart.unwrap());
    let error = EvidenceTransition::new(within, |_: &f64, _, _| 0.0).err().unwrap();
    assert_eq!(error, TransitionError::Restarts);
    assert!(error.to_string().contains("put the restart outside"), "{error}");
}

proptest! {
    #![proptest_config(cases())]

    /// Every entry that is changed is found, whatever the matrix.
    #[test]
    fn a_changed_entry_is_found(m in any_stochastic(false, 6), at in any::<prop::sample::Index>()) {
        /// Lists another value out of a state than the products have.
        struct Changed(SparseTransition, usize);
        impl Transition for Changed {
            type Control = ();
            fn states(&self) -> usize {
                self.0.states()
            }
            fn apply(&self, (): &(), x: &[f64], out: &mut [f64]) {
                self.0.apply(&(), x, out);
            }
            fn apply_transpose(&self, (): &(), x: &[f64], out: &mut [f64]) {
                self.0.apply_transpose(&(), x, out);
            }
        }
        impl TransitionEntries for Changed {
            fn incoming(&self, (): &(), to: usize) -> impl Iterator<Item = (usize, f64)> {
                self.0.incoming(&(), to)
            }
            fn outgoing(&self, (): &(), from: usize) -> impl Iterator<Item = (usize, f64)> {
                let changed = move |(to, p)| (to, if from == self.1 { 0.75 * p } else { p });
                self.0.outgoing(&(), from).map(changed)
            }
        }
        let from = at.index(m.len());
        prop_assert_eq!(kit::check(&sparse(&m), &()), Ok(()));
        let Err(TransitionError::Disagreement(found)) = kit::check(&Changed(sparse(&m), from), &())
        else {
            return Err(TestCaseError::fail("not found"));
        };
        prop_assert_eq!(found.from, Some(from));
    }
}

/// The example of the trait: two methods are enough to be learned.
#[test]
fn an_operator_learns_from_moves_by_two_methods() {
    #[derive(Clone)]
    struct Halves(Own);
    impl Transition for Halves {
        type Control = ();
        fn states(&self) -> usize {
            2
        }
        fn apply(&self, (): &(), x: &[f64], out: &mut [f64]) {
            self.0.apply(&(), x, out);
        }
        fn apply_transpose(&self, (): &(), x: &[f64], out: &mut [f64]) {
            self.0.apply_transpose(&(), x, out);
        }
    }
    impl TransitionEntries for Halves {
        fn incoming(&self, (): &(), to: usize) -> impl Iterator<Item = (usize, f64)> {
            self.0.incoming(&(), to)
        }
        fn outgoing(&self, (): &(), from: usize) -> impl Iterator<Item = (usize, f64)> {
            self.0.outgoing(&(), from)
        }
    }
    impl LearnFromMoves for Halves {
        fn maximize(&self, counts: &MoveCounts) -> Result<Self, TransitionError> {
            let column = |j| {
                let [a, b] = [0, 1].map(|i| counts.get(j, i));
                [a / (a + b), b / (a + b)]
            };
            let [[a, c], [b, d]] = [column(0), column(1)];
            Ok(Self(Own(vec![vec![a, b], vec![c, d]])))
        }
        fn free_parameters(&self) -> usize {
            2
        }
    }
    let rows = [[0.75, 0.5], [0.25, 0.5]];
    let sensor = || TableLikelihood::from_rows(&[[0.9, 0.1], [0.2, 0.8]]).unwrap();
    let prior = || Prior::AtFirstObservation(Belief::uniform(2).unwrap());
    let own = Halves(Own(rows.iter().map(|row| row.to_vec()).collect()));
    kit::check(&own, &()).unwrap();
    let stored = SparseTransition::from_rows(&rows).unwrap();
    let options = wayfix::inference::LearningOptions::default().with_transition_pseudo_count(0.5);
    let ys = [[0, 0, 1, 1, 0, 1, 1, 1, 0, 0, 0, 1]];
    let found = Hmm::new(prior(), own, sensor()).unwrap().learn(&ys, &options).unwrap();
    let expected = Hmm::new(prior(), stored, sensor()).unwrap().learn(&ys, &options).unwrap();
    assert_eq!(found.iterations(), expected.iterations());
    for (to, row) in found.model().transition().0.0.iter().enumerate() {
        for (from, p) in row.iter().enumerate() {
            assert!((p - expected.model().transition().get(to, from)).abs() < 1e-12);
        }
    }
}

/// Entries that share a parameter add up their pseudo-counts, without a word from the operator.
#[test]
fn pseudo_counts_are_of_entries_where_these_are_tied() {
    /// Two states; all stays are equally probable.
    #[derive(Clone)]
    struct Stay(f64);
    impl Stay {
        fn entries(&self, own: usize) -> impl Iterator<Item = (usize, f64)> {
            let stay = self.0;
            (0..2).map(move |other| (other, if other == own { stay } else { 1.0 - stay }))
        }
    }
    impl Transition for Stay {
        type Control = ();
        fn states(&self) -> usize {
            2
        }
        fn apply(&self, (): &(), x: &[f64], out: &mut [f64]) {
            (0..2).for_each(|i| out[i] = self.entries(i).map(|(j, p)| p * x[j]).sum());
        }
        fn apply_transpose(&self, (): &(), x: &[f64], out: &mut [f64]) {
            self.apply(&(), x, out);
        }
    }
    impl TransitionEntries for Stay {
        fn incoming(&self, (): &(), to: usize) -> impl Iterator<Item = (usize, f64)> {
            self.entries(to)
        }
        fn outgoing(&self, (): &(), from: usize) -> impl Iterator<Item = (usize, f64)> {
            self.entries(from)
        }
    }
    impl LearnFromMoves for Stay {
        fn maximize(&self, counts: &MoveCounts) -> Result<Self, TransitionError> {
            let of = |stays| counts.moves().filter(move |m| (m.from == m.to) == stays);
            let [stays, moves] =
                [true, false].map(|stays| of(stays).map(|m| m.weight).sum::<f64>());
            Ok(Self(stays / (stays + moves)))
        }
        fn free_parameters(&self) -> usize {
            1
        }
    }
    let own = Stay(0.7);
    kit::check(&own, &()).unwrap();
    let seen = TableLikelihood::from_rows(&[[1.0, 0.0], [0.0, 1.0]]).unwrap();
    let prior = Prior::AtFirstObservation(Belief::uniform(2).unwrap());
    let hmm = Hmm::new(prior, own, Fixed(seen)).unwrap();
    for count in [0.0, 0.5, 30.0, 1000.0] {
        let options =
            wayfix::inference::LearningOptions::default().with_transition_pseudo_count(count);
        // Two stays and five moves.
        let learned = hmm.learn(&[[0, 0, 1, 0, 1, 1, 0, 1]], &options).unwrap();
        assert!(learned.converged(), "{count}");
        let expected = (2.0 + 2.0 * count) / (7.0 + 4.0 * count);
        assert!((learned.model().transition().0 - expected).abs() < 1e-12, "{count}");
    }
}

/// A sensor of four states with one wrong method.
struct WrongSensor(&'static str, Groups);

impl WrongSensor {
    fn new(method: &'static str) -> Self {
        Self(method, Groups::new(vec![0, 0, 1, 1]).unwrap())
    }

    fn is(&self, method: &str) -> bool {
        self.0 == method
    }
}

impl Likelihood for WrongSensor {
    type Observation = bool;
    fn states(&self) -> usize {
        4
    }
    fn diagonal<'a>(
        &'a self,
        &y: &bool,
        scratch: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        let b = scratch.values(if self.is("length") { 3 } else { 4 });
        let written = if self.is("unwritten") { 3 } else { 4 };
        for (b, group) in b.iter_mut().zip([0, 0, 1, 1]).take(written) {
            *b = if y == (group == 1) { 1.0 } else { 0.0 };
        }
        if self.is("negative") {
            b[2] = -0.5;
        }
        Ok(Diagonal::linear(b))
    }
    fn by_groups<'a>(
        &'a self,
        &y: &bool,
        scratch: &'a mut Scratch,
    ) -> Option<Result<(Diagonal<'a>, &'a Groups), LikelihoodError>> {
        let b = scratch.values(2);
        b.copy_from_slice(if y { &[0.0, 1.0] } else { &[1.0, 0.0] });
        let factor = if self.is("by_groups") { 1.0 } else { 0.0 };
        Some(Ok((Diagonal::linear(b).with_log_factor(factor), &self.1)))
    }
}

impl LocalLikelihood for WrongSensor {
    fn local<'a>(
        &'a self,
        &y: &'a bool,
        states: &[usize],
        scratch: &'a mut Scratch,
    ) -> Result<(Diagonal<'a>, f64), LikelihoodError> {
        let b = scratch.values(states.len());
        let value = if self.is("local") { 0.5 } else { 1.0 };
        let at = |state: usize| if y == (state >= 2) { value } else { 0.0 };
        b.iter_mut().zip(states).for_each(|(b, state)| *b = at(*state));
        Ok((Diagonal::linear(b), if self.is("bound") { 0.25 } else { 1.0 }))
    }
    fn listed_states(&self, _: &bool, states: &mut Vec<usize>) {
        states.push(if self.is("listed") { 4 } else { 2 });
    }
}

impl SampleObservation for WrongSensor {
    type Sample = bool;
    fn sample<R: Rng + ?Sized>(&self, state: usize, rng: &mut R) -> bool {
        if self.is("sample") { rng.random() } else { state >= 2 }
    }
}

fn sensor_error(method: &'static str) -> String {
    let sensor = WrongSensor::new(method);
    let checked = sensor_kit::check(&sensor, &true)
        .and_then(|()| sensor_kit::check_local(&sensor, &true))
        .and_then(|()| sensor_kit::check_samples(&sensor, 64, &mut rng(3)));
    text(checked)
}

#[test]
fn each_method_of_a_sensor_that_disagrees_is_named() {
    let right = WrongSensor::new("none");
    sensor_kit::check(&right, &true).unwrap();
    sensor_kit::check_local(&right, &false).unwrap();
    sensor_kit::check_samples(&right, 64, &mut rng(1)).unwrap();

    let length = "the likelihood has 3 values, expected one for each of 4 states";
    assert_eq!(sensor_error("length"), length);
    let value = "state 2 has likelihood -0.5, expected a finite value of at least 0";
    assert_eq!(sensor_error("negative"), value);
    let unwritten = "state 3 has likelihood NaN, expected a finite value of at least 0";
    assert_eq!(sensor_error("unwritten"), unwritten);
    let groups = "`by_groups` gives 1 for state 2, expected 0 as by its other methods";
    assert_eq!(sensor_error("by_groups"), groups);
    assert!(sensor_error("local").starts_with("`local` gives -0.69"), "{}", sensor_error("local"));
    let bound = "`the bound of local` gives -1.38";
    assert!(sensor_error("bound").starts_with(bound), "{}", sensor_error("bound"));
    let listed = "the observation lists state 4, but there are 4 states (0 to 3)";
    assert_eq!(sensor_error("listed"), listed);
    let sample = "an observation drawn in state 0 is impossible there";
    assert_eq!(sensor_error("sample"), sample);
}

#[test]
fn sensors_of_the_core_pass() {
    let table = || TableLikelihood::from_rows(&[[0.9, 0.1], [0.0, 1.0], [0.25, 0.75]]).unwrap();
    for y in 0..2 {
        sensor_kit::check(&table(), &y).unwrap();
        sensor_kit::check_local(&table(), &y).unwrap();
    }
    sensor_kit::check_samples(&table(), 50, &mut rng(1)).unwrap();
    let lists = [(vec![(1, 0.5)], 0.25), (vec![(1, 0.5)], 0.75)];
    let tags = SparseTableLikelihood::from_lists(3, &lists).unwrap();
    (0..2).for_each(|y| sensor_kit::check_local(&tags, &y).unwrap());
    let known = SparseObservation::known(1);
    sensor_kit::check(&SparseLikelihood::new(3), &known).unwrap();
    sensor_kit::check_local(&SparseLikelihood::new(3), &known).unwrap();
    let logs = [-1000.0, f64::NEG_INFINITY, 3.0];
    sensor_kit::check(&LikelihoodVector::log(3), &logs[..]).unwrap();
    sensor_kit::check_local(&LikelihoodVector::log(3), &logs[..]).unwrap();
    let both = FusedLikelihood::new(table(), OptionalLikelihood::new(table())).unwrap();
    for y in [(0, None), (1, Some(1))] {
        sensor_kit::check(&both, &y).unwrap();
        sensor_kit::check_local(&both, &y).unwrap();
    }
    sensor_kit::check_samples(&both, 50, &mut rng(2)).unwrap();
}
