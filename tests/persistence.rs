//! What is stored comes back to the bit, and what is no model is refused.
#![cfg(feature = "serde")]

mod common;

use common::{Kind, Model, models};
use proptest::collection::vec;
use proptest::prelude::*;
use serde::de::value::{Error as ValueError, SeqDeserializer};
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use wayfix::{
    Belief, DenseTransition, DwellTransition, Ends, FilterState, Fixed, FixedLagState,
    FusedLikelihood, Gear, GroupedLikelihood, Groups, Hmm, KnownState, KroneckerTransition,
    Learning, LikelihoodVector, Odometry, OptionalLikelihood, PowerTransition, Prior,
    RestartTransition, RouteControl, RouteTransition, SparseTransition, SwitchedTransition,
    TableLikelihood, TiedTransition, Transition, TransitionEntries, View, ViewRates,
    WindowTransition,
};

fn json<T: Serialize>(value: &T) -> String {
    serde_json::to_string(value).unwrap()
}

/// There and back. JSON tells any two doubles apart, so that it tells whether
/// all bits are the same.
fn stored<T: Serialize + DeserializeOwned>(value: &T) -> T {
    let text = json(value);
    let back: T = serde_json::from_str(&text).unwrap_or_else(|error| panic!("{error} in {text}"));
    assert_eq!(json(&back), text);
    back
}

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|value| value.to_bits()).collect()
}

/// All products and entries of an operator.
fn outcome<A: TransitionEntries>(a: &A, u: &A::Control) -> Vec<Vec<u64>> {
    let n = a.states();
    let x: Vec<f64> = (0..n).map(|i| (i as f64 * 0.618_033_988_7 + 0.1).fract()).collect();
    let logs: Vec<f64> = x.iter().map(|x| x.ln() * 700.0).collect();
    let product = |apply: &dyn Fn(&mut [f64])| {
        let mut out = vec![0.0; n];
        apply(&mut out);
        bits(&out)
    };
    let mut from = vec![0; n];
    let mut all = vec![
        product(&|out| a.apply(u, &x, out)),
        product(&|out| a.apply_transpose(u, &x, out)),
        product(&|out| a.apply_log(u, &logs, out)),
        product(&|out| a.apply_transpose_log(u, &logs, out)),
    ];
    let mut best = vec![0.0; n];
    a.max_product(u, &logs, &mut best, &mut from);
    all.push(bits(&best));
    all.push(from.into_iter().map(u64::from).collect());
    for state in 0..n {
        all.push(a.incoming(u, state).flat_map(|(j, p)| [j as u64, p.to_bits()]).collect());
        all.push(a.outgoing(u, state).flat_map(|(i, p)| [i as u64, p.to_bits()]).collect());
    }
    all
}

#[track_caller]
fn operator<A: TransitionEntries + Serialize + DeserializeOwned>(a: &A, u: &A::Control) {
    assert_eq!(outcome(&stored(a), u), outcome(a, u), "{}", json(a));
}

/// What operators of all kinds are made from.
#[derive(Debug, Clone)]
struct Parts {
    model: Model,
    first: isize,
    weights: Vec<f64>,
    ends: Ends,
    rate: f64,
    exponent: u32,
    dwell: Vec<Vec<f64>>,
}

fn distribution(most: usize) -> impl Strategy<Value = Vec<f64>> {
    let weight = prop_oneof![2 => Just(0.0), 5 => 0.01..1.0, 1 => Just(1e-300)];
    vec(weight, 1..=most).prop_map(|mut weights| {
        let last = weights.len() - 1;
        weights[last] += f64::from(weights.iter().sum::<f64>() < 1e-3);
        let sum: f64 = weights.iter().sum();
        weights.iter().map(|w| w / sum).collect()
    })
}

fn parts() -> impl Strategy<Value = Parts> {
    let ends = prop_oneof![Just(Ends::Loop), Just(Ends::Stop), Just(Ends::Renormalise)];
    let rate = prop_oneof![1 => Just(0.0), 1 => Just(1.0), 4 => 0.0..1.0];
    let model = models(Kind::Extreme).prop_filter("matrices", |model| !model.matrices.is_empty());
    let window = (-9..9_isize, distribution(8), ends);
    (model, window, rate, 0..4_u32, vec(distribution(4), 5)).prop_map(
        |(model, (first, weights, ends), rate, exponent, dwell)| Parts {
            model,
            first,
            weights,
            ends,
            rate,
            exponent,
            dwell,
        },
    )
}

impl Parts {
    fn sparse(&self) -> SparseTransition {
        let n = self.model.states;
        SparseTransition::from_rows(n, &self.model.matrices[0].concat()).unwrap()
    }

    fn belief(&self) -> Belief {
        Belief::new(self.model.prior.clone()).unwrap()
    }

    fn tied(&self) -> TiedTransition {
        TiedTransition::new(self.sparse(), |from, to| (from * 3 + to) % 2)
    }

    fn window(&self) -> Option<WindowTransition> {
        WindowTransition::new(self.model.states, self.first, &self.weights, self.ends).ok()
    }

    /// Gears of the window and of dwell times, which switch as the matrix says.
    fn route(&self) -> Option<RouteTransition> {
        let n = self.model.states;
        let gears = (0..n).map(|g| match g {
            0 => Gear::new(self.first, &self.weights),
            _ => Gear::new(-1, &self.dwell[g]),
        });
        let gears = gears.collect::<Result<_, _>>().unwrap();
        let route = RouteTransition::new(5, self.ends == Ends::Loop, gears, self.rate).ok()?;
        let route = route.with_switching(&self.model.matrices[0].concat()).unwrap();
        if self.exponent == 0 {
            return Some(route);
        }
        let rate = self.rate.clamp(1e-30, 0.999);
        let rates = ViewRates { standing: rate, alike: 0.25, moved: 0.125 };
        Some(route.with_views(&[9, 9, 3, 3, usize::MAX], rates).unwrap())
    }

    fn nested(&self) -> DwellTransition<RestartTransition<Fixed<TiedTransition>>> {
        let restart = RestartTransition::new(Fixed(self.tied()), self.rate, self.belief()).unwrap();
        DwellTransition::new(restart, &self.dwell[..self.model.states]).unwrap()
    }

    fn sensor(&self) -> Place {
        let table: Vec<_> = (0..self.model.states)
            .map(|i| [0.6, 0.2 - 0.03 * i as f64, 0.2 + 0.03 * i as f64])
            .collect();
        let table = OptionalLikelihood::new(TableLikelihood::from_rows(&table).unwrap());
        FusedLikelihood::new(table, KnownState::new(self.model.states)).unwrap()
    }

    fn hmm(&self) -> Nested {
        let (a, sensor) = (self.nested(), self.sensor());
        let prior = Prior::AtFirstObservation(a.arriving(&self.belief()).unwrap());
        let sensor = GroupedLikelihood::new(sensor, a.groups().clone()).unwrap();
        Hmm::new(prior, a, sensor).unwrap()
    }
}

type Place = FusedLikelihood<OptionalLikelihood<TableLikelihood>, KnownState>;
type Nested =
    Hmm<DwellTransition<RestartTransition<Fixed<TiedTransition>>>, GroupedLikelihood<Place>>;
type Given = OptionalLikelihood<LikelihoodVector<Vec<f64>>>;
type Pairs =
    Hmm<KroneckerTransition<WindowTransition, SparseTransition>, LikelihoodVector<Vec<f64>>>;
type Switched = Hmm<SwitchedTransition<SparseTransition>, Given>;

/// The given sensor, for a model with a matrix for each step.
fn switched(model: &Model) -> Switched {
    let sensor = OptionalLikelihood::new(LikelihoodVector::log(model.states).owned());
    Hmm::new(model.prior(), model.sparse(), sensor).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(2000) })]

    #[test]
    fn operators_are_the_same_to_the_bit(parts in parts()) {
        let n = parts.model.states;
        let restart = |a| RestartTransition::new(a, parts.rate, parts.belief()).unwrap();
        operator(&parts.model.dense(), &0);
        operator(&parts.model.sparse(), &(parts.model.steps() - 1));
        operator(&parts.tied(), &());
        prop_assert_eq!(stored(&parts.tied()).parameters(), parts.tied().parameters());
        operator(&parts.nested(), &());
        operator(&PowerTransition::new(restart(parts.sparse()), parts.exponent), &());
        let leaving: Vec<_> = (0..n).map(|i| vec![parts.rate, 1.0 / (3.0 + i as f64)]).collect();
        let leaving = DwellTransition::from_leaving(parts.model.sparse(), &leaving).unwrap();
        operator(&RestartTransition::new(
            leaving.clone(), parts.rate, leaving.arriving(&parts.belief()).unwrap()).unwrap(), &0);
        if let Some(route) = parts.route() {
            let odometry = Some(Odometry { distance: parts.rate, variance: 0.5 });
            for view in [None, Some(View::Changed), Some(View::Unchanged)] {
                operator(&route, &RouteControl { odometry: None, view });
                operator(&route, &stored(&RouteControl { odometry, view }));
            }
        }
        if let Some(window) = parts.window() {
            operator(&window, &());
            let pairs = KroneckerTransition::new(window, parts.sparse()).unwrap();
            operator(&pairs, &());
            operator(&SwitchedTransition::new(vec![pairs.clone(), pairs]).unwrap(), &1);
        }
    }

    /// Learned operators, in which entries have vanished.
    #[test]
    fn learned_models_are_the_same_to_the_bit(parts in parts(), ys in vec(0..3_usize, 1..6)) {
        let table = vec![[0.6, 0.3, 0.1]; parts.model.states];
        let sensor = TableLikelihood::from_rows(&table).unwrap();
        let hmm = Hmm::new(Prior::AtFirstObservation(parts.belief()), parts.tied(), sensor).unwrap();
        let learning = Learning { iterations: 3, ..Learning::default() };
        if let Ok(learned) = hmm.learn(&[ys], &learning) {
            let model = learned.model();
            operator(model.transition(), &());
            prop_assert_eq!(stored(model).transition().parameters(), model.transition().parameters());
        }
    }

    /// A filter, and a smoother with a lag, that stop after any step, are stored
    /// with their model, and go on.
    #[test]
    fn to_stop_changes_no_bit(model in models(Kind::Extreme), stop in 0..7_usize, lag in 0..4_usize) {
        let hmm = switched(&model);
        let (mut filter, mut smoother) = (hmm.filter(), hmm.fixed_lag(lag));
        let restored = stored(&hmm);
        let (mut next, mut late) = (restored.filter(), restored.fixed_lag(0));
        for (step, y) in model.logs.iter().enumerate() {
            if step == stop.min(model.steps() - 1) {
                let state = stored(&filter.snapshot());
                prop_assert_eq!(&state, &filter.snapshot());
                next.restore(&state).unwrap();
                let state = stored(&smoother.snapshot());
                prop_assert_eq!(&state, &smoother.snapshot());
                late.restore(&state).unwrap();
            }
            let stepped = filter.step_with(&step, y);
            let _ = smoother.step_with(&step, y);
            if step >= stop.min(model.steps() - 1) {
                prop_assert_eq!(format!("{stepped:?}"), format!("{:?}", next.step_with(&step, y)));
                prop_assert_eq!(json(&next.snapshot()), json(&filter.snapshot()));
                let _ = late.step_with(&step, y);
                prop_assert_eq!(json(&late.snapshot()), json(&smoother.snapshot()));
                for k in 0..=step + 1 {
                    let bits = |view: Option<wayfix::BeliefView<'_>>| view.map(|view| bits(view.as_slice()));
                    prop_assert_eq!(bits(late.get(k)), bits(smoother.get(k)));
                }
            }
            if stepped.is_err() {
                break;
            }
        }
    }

    #[test]
    fn nested_models_smooth_and_decode_the_same(
        parts in parts(),
        ys in vec((prop_oneof![Just(None), (0..3_usize).prop_map(Some)], Just(None)), 1..6),
    ) {
        let hmm = parts.hmm();
        let restored = stored(&hmm);
        match (hmm.smooth(&ys), restored.smooth(&ys)) {
            (Ok(a), Ok(b)) => {
                prop_assert_eq!(a.log_likelihood().to_bits(), b.log_likelihood().to_bits());
                for k in 1..=ys.len() {
                    let (a, b) = (a.posteriors().get(k), b.posteriors().get(k));
                    prop_assert_eq!(bits(a.unwrap().as_slice()), bits(b.unwrap().as_slice()));
                }
            }
            (a, b) => prop_assert_eq!(format!("{:?}", a.err()), format!("{:?}", b.err())),
        }
        let paths = (hmm.viterbi(&ys).ok(), restored.viterbi(&ys).ok());
        let states = |path: Option<wayfix::ViterbiPath>| path.map(|path| path.states().to_vec());
        prop_assert_eq!(states(paths.0), states(paths.1));
    }

    /// Whatever is changed in a file, there is an error or something that works.
    #[test]
    fn damaged_files_are_refused_or_valid(parts in parts(), damage in damage()) {
        let n = parts.model.states;
        if let Ok(hmm) = serde_json::from_str::<Nested>(&damage.of(&json(&parts.hmm()))) {
            check_columns(hmm.transition(), &())?;
            let _ = hmm.smooth(&[(Some(0), None), (None, Some(0)), (Some(1), None)]);
            let _ = hmm.viterbi(&[(Some(0), None), (None, Some(0)), (Some(1), None)]);
        }
        if let Some(window) = parts.window() {
            let pairs = KroneckerTransition::new(window, parts.sparse()).unwrap();
            let prior = Prior::BeforeFirstTransition(Belief::uniform(n * n).unwrap());
            let hmm = Hmm::new(prior, pairs, LikelihoodVector::log(n * n).owned()).unwrap();
            if let Ok(hmm) = serde_json::from_str::<Pairs>(&damage.of(&json(&hmm))) {
                check_columns(hmm.transition(), &())?;
                let _ = hmm.viterbi(&[vec![0.0; n * n], vec![-1.0; n * n]]);
            }
        }
        // A number put in may make a valid route of billions of places.
        if let Some(route) = parts.route()
            && let Ok(route) = serde_json::from_str::<RouteTransition>(&damage.of(&json(&route)))
            && route.states() < 1_000_000
        {
            let odometry = Some(Odometry { distance: 0.5, variance: 0.5 });
            let view = Some(View::Unchanged);
            check_columns(&route, &RouteControl { odometry, view })?;
        }
        let dense = damage.of(&json(&parts.model.dense()));
        if let Ok(dense) = serde_json::from_str::<SwitchedTransition<DenseTransition>>(&dense) {
            check_columns(&dense, &0)?;
        }
        let hmm = switched(&parts.model);
        let mut smoother = hmm.fixed_lag(2);
        for (step, y) in parts.model.logs.iter().enumerate() {
            let text = damage.of(&json(&smoother.snapshot()));
            if let Ok(state) = serde_json::from_str::<FixedLagState<usize>>(&text) {
                let mut other = hmm.fixed_lag(0);
                if other.restore(&state).is_ok() {
                    let _ = other.step_with(&step, y);
                    let _ = other.predict_with(&step);
                    for belief in [other.filter().belief(), other.lagged()] {
                        let sum: f64 = belief.as_slice().iter().sum();
                        prop_assert!((sum - 1.0).abs() < 1e-6, "{sum} from {text}");
                    }
                }
            }
            if smoother.step_with(&step, y).is_err() {
                break;
            }
        }
    }
}

fn check_columns<A: Transition>(a: &A, u: &A::Control) -> Result<(), TestCaseError> {
    let mut sums = vec![0.0; a.states()];
    a.apply_transpose(u, &vec![1.0; a.states()], &mut sums);
    prop_assert!(sums.iter().all(|sum| (sum - 1.0).abs() < 1e-8), "{sums:?}");
    Ok(())
}

/// What is done to a text: at some place in it a character is removed, or one
/// put in its place, or a number is replaced.
#[derive(Debug, Clone)]
enum Damage {
    Remove(usize),
    Put(usize, char),
    Number(usize, &'static str),
}

fn damage() -> impl Strategy<Value = Damage> {
    let characters = proptest::sample::select("0123456789.-e[]{},:\"n".chars().collect::<Vec<_>>());
    let numbers = proptest::sample::select(vec![
        "-1",
        "0",
        "2",
        "0.1",
        "-0.0",
        "1e308",
        "1e999",
        "null",
        "NaN",
        "4294967295",
        "\"1\"",
        "9007199254740993",
        "18446744073709551615",
        "-9223372036854775808",
        "[]",
        "5e-324",
    ]);
    prop_oneof![
        1 => any::<usize>().prop_map(Damage::Remove),
        1 => (any::<usize>(), characters).prop_map(|(at, c)| Damage::Put(at, c)),
        4 => (any::<usize>(), numbers).prop_map(|(at, number)| Damage::Number(at, number)),
    ]
}

impl Damage {
    fn of(&self, text: &str) -> String {
        let numeric = |c: char| c.is_ascii_digit() || "+-.eE".contains(c);
        match self {
            Self::Remove(at) => {
                let at = at % text.len();
                [&text[..at], &text[at + 1..]].concat()
            }
            Self::Put(at, c) => {
                let at = at % text.len();
                [&text[..at], &c.to_string(), &text[at + 1..]].concat()
            }
            Self::Number(at, number) => {
                let starts: Vec<usize> = text
                    .char_indices()
                    .filter(|(at, c)| {
                        (c.is_ascii_digit() || *c == '-') && "[,:".contains(&text[at - 1..*at])
                    })
                    .map(|start| start.0)
                    .collect();
                let start = starts[at % starts.len()];
                let rest = text[start..].trim_start_matches(numeric);
                [&text[..start], number, rest].concat()
            }
        }
    }
}

/// The text of the error for a JSON text.
#[track_caller]
fn refuses<T: DeserializeOwned>(text: &str, expected: &str) {
    let error = serde_json::from_str::<T>(text).err().expect("to be refused").to_string();
    let error = error.split(" at line").next().unwrap();
    assert_eq!(error, expected);
}

#[test]
fn the_format_is_as_documented() {
    let sparse = SparseTransition::from_rows(2, &[0.5, 0.0, 0.5, 1.0]).unwrap();
    assert_eq!(
        json(&sparse),
        r#"{"version":1,"states":2,"to":[0,1,1],"from":[0,0,1],"probability":[0.5,0.5,1.0]}"#
    );
    assert_eq!(
        json(&DenseTransition::from_rows(2, &[0.5, 0.0, 0.5, 1.0]).unwrap()),
        r#"{"version":1,"states":2,"columns":[0.5,0.5,0.0,1.0]}"#
    );
    let tied = TiedTransition::new(sparse.clone(), |_, to| to);
    assert_eq!(
        json(&tied),
        format!(r#"{{"version":1,"transition":{},"parameters":[0,1,2]}}"#, json(&sparse))
    );
    let window = WindowTransition::new(4, -2, &[0.0, 0.5, 0.0, 0.5, 0.0], Ends::Stop).unwrap();
    assert_eq!(
        json(&window),
        r#"{"version":1,"states":4,"first":-1,"weights":[0.5,0.0,0.5],"ends":"stop"}"#
    );
    assert_eq!(
        json(&PowerTransition::new(Fixed(window.clone()), 3)),
        format!(r#"{{"version":1,"inner":{},"exponent":3}}"#, json(&window))
    );
    let still = SparseTransition::from_rows(1, &[1.0]).unwrap();
    let within = json(&still);
    let restart = RestartTransition::new(still.clone(), 0.25, Belief::uniform(1).unwrap());
    assert_eq!(
        json(&restart.unwrap()),
        format!(r#"{{"version":1,"inner":{within},"keep":0.75,"restart":[0.25]}}"#)
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
        format!(r#"{{"version":1,"moves":{within},"ages":[[[0.5,0.5],[1.0,0.0]]]}}"#)
    );
    let gears = vec![Gear::new(-1, &[0.0, 0.25, 0.75]).unwrap(), Gear::speed(2.0, 0.0).unwrap()];
    let route = RouteTransition::new(3, true, gears, 0.75).unwrap();
    let start = r#"{"version":1,"places":3,"closed":true,"gears":[[0,[0.25,0.75]],[2,[1.0]]],"switching":[0.75,0.25,0.25,0.75],"views":"#;
    assert_eq!(json(&route), format!("{start}null}}"));
    let rates = ViewRates { standing: 0.75, alike: 0.5, moved: 0.25 };
    assert_eq!(
        json(&route.with_views(&[7, 7, 8], rates).unwrap()),
        format!(r#"{start}[[7,7,8],{{"standing":0.75,"alike":0.5,"moved":0.25}}]}}"#)
    );
    let odometry = Some(Odometry { distance: 1.5, variance: 0.25 });
    assert_eq!(
        json(&RouteControl { odometry, view: Some(View::Unchanged) }),
        r#"{"odometry":{"distance":1.5,"variance":0.25},"view":"unchanged"}"#
    );
    assert_eq!(json(&RouteControl::default()), r#"{"odometry":null,"view":null}"#);

    let table = TableLikelihood::from_rows(&[[0.75, 0.25], [0.5, 0.5]]).unwrap();
    let rows = json(&table);
    assert_eq!(rows, r#"{"version":1,"rows":[[0.75,0.25],[0.5,0.5]]}"#);
    let optional = OptionalLikelihood::new(table);
    assert_eq!(json(&optional), format!(r#"{{"version":1,"sensor":{rows}}}"#));
    let fused = FusedLikelihood::new(KnownState::new(2), LikelihoodVector::log(2)).unwrap();
    assert_eq!(
        json(&fused),
        r#"{"version":1,"first":{"version":1,"states":2},"second":{"version":1,"states":2,"log":true}}"#
    );
    let groups = Groups::new(vec![0, 1, 1]).unwrap();
    let grouped = GroupedLikelihood::new(KnownState::new(2), groups).unwrap();
    assert_eq!(
        json(&grouped),
        r#"{"version":1,"sensor":{"version":1,"states":2},"groups":[0,1,1]}"#
    );

    let prior = Prior::BeforeFirstTransition(Belief::new(vec![0.5, 0.5]).unwrap());
    let hmm = Hmm::new(prior, sparse.clone(), LikelihoodVector::log(2)).unwrap();
    assert_eq!(
        json(&hmm),
        format!(
            r#"{{"version":1,"prior":{{"before_first_transition":[0.5,0.5]}},"transition":{},"likelihood":{{"version":1,"states":2,"log":true}}}}"#,
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
    let present = r#"{"version":1,"steps":2,"belief":[1.0,0.0],"logs":[0.0,-1000.0],"log_likelihood":[-2.0794415416798357,-1.1102230246251565e-16]}"#;
    let past = r#"{"version":1,"steps":1,"belief":[1.0,0.0],"logs":null,"log_likelihood":[-1.3862943611198906,0.0]}"#;
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
    refuses::<Belief>("[0.5,0.4]", "the probabilities sum to 0.9, expected 1");
    refuses::<Belief>("[]", "a belief needs at least one state, found none");
    refuses::<Belief>(
        "[1.5,-0.5]",
        "state 1 has probability -0.5, expected a finite value of at least 0",
    );
    // Other formats than JSON have NaN.
    let nan = SeqDeserializer::<_, ValueError>::new([0.5, f64::NAN].into_iter());
    assert_eq!(
        Belief::deserialize(nan).unwrap_err().to_string(),
        "state 1 has probability NaN, expected a finite value of at least 0"
    );
    refuses::<Groups>("[0,2]", "no state is in group 1, though groups are numbered up to 2");
    refuses::<TableLikelihood>(
        r#"{"version":1,"rows":[[0.5,0.5],[0.5,0.4]]}"#,
        "the probabilities of what state 1 shows sum to 0.9, expected 1",
    );
    refuses::<TableLikelihood>(
        r#"{"version":1,"rows":[[0.5,0.5],[1.0]]}"#,
        "the row of state 1 has 1 values, expected 2 as state 0",
    );
    refuses::<GroupedLikelihood<KnownState>>(
        r#"{"version":1,"sensor":{"version":1,"states":2},"groups":[0,0]}"#,
        "the sensor has 2 states, expected 1 as the number of groups",
    );
    refuses::<FusedLikelihood<KnownState, KnownState>>(
        r#"{"version":1,"first":{"version":1,"states":2},"second":{"version":1,"states":3}}"#,
        "the second sensor has 3 states, expected 2 as the first sensor",
    );
    refuses::<OptionalLikelihood<KnownState>>(
        r#"{"version":1,"sensor":{"version":1,"states":18446744073709551615}}"#,
        "memory allocation failed because the computed capacity exceeded the collection's maximum",
    );
}

#[test]
fn other_versions_and_fields_are_refused() {
    refuses::<KnownState>(r#"{"version":2,"states":3}"#, "version 2, expected 1");
    refuses::<KnownState>(r#"{"states":3}"#, "missing field `version`");
    refuses::<KnownState>(r#"{"version":1}"#, "missing field `states`");
    refuses::<KnownState>(
        r#"{"version":1,"states":3,"state":3}"#,
        "unknown field `state`, expected `version` or `states`",
    );
    refuses::<KnownState>("7", "invalid type: integer `7`, expected struct KnownState");
    refuses::<FilterState>(
        r#"{"version":3,"steps":0,"belief":[1.0],"logs":null,"log_likelihood":[0,0]}"#,
        "version 3, expected 1",
    );
}

#[test]
fn what_is_no_operator_is_refused() {
    let route = |gears: &str, switching: &str, views: &str, expected: &str| {
        refuses::<RouteTransition>(
            &format!(
                r#"{{"version":1,"places":2,"closed":true,"gears":{gears},"switching":{switching},"views":{views}}}"#
            ),
            expected,
        );
    };
    let views = |rate: f64| format!(r#"[[0,0],{{"standing":{rate},"alike":0.5,"moved":0.5}}]"#);
    route("[]", "[]", "null", "a transition operator needs at least one state, found none");
    route("[[0,[1]]]", "[0.9]", "null", "the sum of the ways out of gear 0 is 0.9, expected 1");
    route(
        "[[0,[0.5,0.25,0.25]]]",
        "[1]",
        "null",
        "the number of weights of gear 0 is 3, expected at most the number of places of a closed route",
    );
    route(
        "[[0,[1]]]",
        "[1]",
        &views(1.0),
        "the probability of an unchanged view standing is 1, expected a value of at least 1e-30 and below 1",
    );
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
        r#"{"version":1,"states":3,"first":1,"weights":[1],"ends":"renormalise"}"#,
        "column 2 (the transitions out of state 2) sums to 0, expected 1",
    );
    refuses::<WindowTransition>(
        r#"{"version":1,"states":3,"first":1,"weights":[1],"ends":"bounce"}"#,
        "unknown variant `bounce`, expected one of `loop`, `stop`, `renormalise`",
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
    restart("1", "[0,0]", "the restart belief has 2 states, expected 1 as the operator within");
    let dwell = |ages: &str, expected: &str| {
        refuses::<DwellTransition<DenseTransition>>(
            &format!(r#"{{"version":1,"moves":{one},"ages":{ages}}}"#),
            expected,
        );
    };
    dwell("[[]]", "the number of ages of place 0 is 0, expected at least 1");
    dwell("[]", "the dwell table has 0 states, expected 1 as the operator within");
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
        refuses::<TiedTransition>(
            &format!(r#"{{"version":1,"transition":{two},"parameters":{parameters}}}"#),
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

type Staying = Hmm<DwellTransition<DenseTransition>, KnownState>;

#[test]
fn what_is_no_model_is_refused_with_all_that_is_behind() {
    let hmm = |belief: &str, first: f64| {
        let a = r#"{"version":1,"states":1,"columns":[1]}"#;
        let dwell = format!(r#"{{"version":1,"moves":{a},"ages":[[[{first},0.25]]]}}"#);
        let part = r#"{"version":1,"states":1}"#;
        format!(
            r#"{{"version":1,"prior":{{"at_first_observation":{belief}}},"transition":{dwell},"likelihood":{part}}}"#
        )
    };
    refuses::<Staying>(
        &hmm("[0.5,0.5]", 0.75),
        "the transition operator has 1 states, expected 2 as the prior",
    );
    // Each part is right but for rounding, but not what they make.
    let restart = r#"{"version":1,"inner":{"version":1,"states":1,"columns":[1.0000000009]},"keep":0.5,"restart":[0.5000000009]}"#;
    refuses::<Hmm<RestartTransition<DenseTransition>, KnownState>>(
        &format!(
            r#"{{"version":1,"prior":{{"at_first_observation":[1]}},"transition":{restart},"likelihood":{{"version":1,"states":1}}}}"#
        ),
        "the transition operator is not valid: column 0 (the transitions out of state 0) sums to 1.0000000013500001, expected 1",
    );
    refuses::<Staying>(
        &hmm("[1]", 0.75).replace("at_first", "at_last"),
        "unknown variant `at_last_observation`, expected `before_first_transition` or `at_first_observation`",
    );
}

fn state(steps: usize, belief: &str, logs: &str, log_likelihood: &str) -> String {
    format!(
        r#"{{"version":1,"steps":{steps},"belief":{belief},"logs":{logs},"log_likelihood":{log_likelihood}}}"#
    )
}

#[test]
fn what_no_filter_knows_is_refused() {
    let refused = |steps: usize, belief: &str, logs: &str, expected: &str| {
        refuses::<FilterState>(&state(steps, belief, logs, "[0,0]"), expected);
    };
    refused(1, "[0.5,0.4]", "null", "the probabilities sum to 0.9, expected 1");
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
    refuses::<FilterState>(
        &state(1, "[1]", "null", "[0]"),
        "invalid length 1, expected an array of length 2",
    );
    refuses::<FilterState>(
        &state(1, "[1]", "null", "[null,0]"),
        "invalid type: null, expected f64",
    );
}

#[test]
fn what_no_smoother_knows_is_refused() {
    let refused = |lag: usize, past: &[String], expected: &str| {
        let present = state(2, "[0.5,0.5]", "null", "[0,0]");
        let past: Vec<_> = past.iter().map(|past| format!("[{past},null]")).collect();
        let past = past.join(",");
        refuses::<FixedLagState<()>>(
            &format!(r#"{{"version":1,"lag":{lag},"present":{present},"past":[{past}]}}"#),
            expected,
        );
    };
    let past = |steps, belief| state(steps, belief, "null", "[0,0]");
    let one = "[0.5,0.5]";
    refused(1, &[], "0 past states after 2 steps with a lag of 1, expected 1");
    refused(
        1,
        &[past(0, one), past(1, one)],
        "2 past states after 2 steps with a lag of 1, expected 1",
    );
    refused(
        3,
        &[past(0, one), past(1, one), past(2, one)],
        "3 past states after 2 steps with a lag of 3, expected 2",
    );
    refused(2, &[past(1, one), past(1, one)], "past state 0 is of step 1, expected 0");
    refused(2, &[past(0, one), past(2, one)], "past state 1 is of step 2, expected 1");
    refused(
        2,
        &[past(0, one), past(1, "[1]")],
        "past state 1 is over 1 states, expected 2 as the present one",
    );
    refused(2, &[past(0, one), past(1, "[0.5,0.4]")], "the probabilities sum to 0.9, expected 1");
}

/// A sensor with rounded tails, in a whole model.
#[test]
fn the_canberra_model_comes_back_to_the_bit() {
    let hmm = wayfix::canberra::hmm(5, 1.0).unwrap();
    let restored: wayfix::canberra::Model = stored(&hmm);
    let ys = [4, 5, 5, 7, 8, 50, 8];
    assert_eq!(restored.smooth(&ys).unwrap(), hmm.smooth(&ys).unwrap());
    assert_eq!(restored.viterbi(&ys).unwrap(), hmm.viterbi(&ys).unwrap());
}
