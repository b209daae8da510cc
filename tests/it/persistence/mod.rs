//! Stored values come back to the bit, and invalid ones are refused.

mod names;
mod places;
mod refused;
mod streams;

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::inference::{FixedLagSnapshot, LearningOptions};
use wayfix::likelihood::{GroupedLikelihood, SparseObservation};
use wayfix::transition::{
    ConstrainedTransition, DistractedTransition, Distraction, DistractionRates, DwellTransition,
    KroneckerTransition, RestartTransition, SwitchedTransition, WindowTransition,
};
use wayfix::{
    Belief, DenseTransition, Fixed, FusedLikelihood, Hmm, LikelihoodVector, OptionalLikelihood,
    Prior, SparseLikelihood, SparseTransition, TableLikelihood,
};

use crate::kit::{
    Kind, Model, assert_stored_operator as operator, bits, cases, check_columns, damage, json,
    models, stored, weighted,
};

/// Parameters of operators of all kinds.
#[derive(Debug, Clone)]
struct Parts {
    model: Model,
    first: isize,
    weights: Vec<f64>,
    closed: bool,
    rate: f64,
    dwell: Vec<Vec<f64>>,
}

/// Up to `most` probabilities, including 0 and 1e-300.
fn tiny_and_usual(most: usize) -> impl Strategy<Value = Vec<f64>> {
    let weight = || prop_oneof![2 => Just(0.0), 5 => 0.01..1.0, 1 => Just(1e-300)];
    (1..=most).prop_flat_map(move |count| weighted(weight(), count))
}

fn parts() -> impl Strategy<Value = Parts> {
    let rate = prop_oneof![1 => Just(0.0), 1 => Just(1.0), 4 => 0.0..1.0];
    let model = models(Kind::Extreme).prop_filter("matrices", |model| !model.matrices.is_empty());
    let window = (-9..9_isize, tiny_and_usual(8), any::<bool>());
    (model, window, rate, vec(tiny_and_usual(4), 5)).prop_map(
        |(model, (first, weights, closed), rate, dwell)| Parts {
            model,
            first,
            weights,
            closed,
            rate,
            dwell,
        },
    )
}

impl Parts {
    fn sparse(&self) -> SparseTransition {
        SparseTransition::from_rows(&self.model.matrices[0]).unwrap()
    }

    fn belief(&self) -> Belief {
        Belief::new(self.model.prior.clone()).unwrap()
    }

    fn tied(&self) -> ConstrainedTransition {
        ConstrainedTransition::new(self.sparse()).with_ties(|from, to| (from * 3 + to) % 2)
    }

    fn window(&self) -> Option<WindowTransition> {
        crate::kit::window_transition(self.model.states, self.first, &self.weights, self.closed)
            .ok()
    }

    fn nested(&self) -> DwellTransition<RestartTransition<Fixed<ConstrainedTransition>>> {
        let restart = RestartTransition::new(Fixed(self.tied()), self.rate, self.belief()).unwrap();
        DwellTransition::new(restart, &self.dwell[..self.model.states]).unwrap()
    }

    fn sensor(&self) -> Place {
        let table: Vec<_> = (0..self.model.states)
            .map(|i| [0.6, 0.2 - 0.03 * i as f64, 0.2 + 0.03 * i as f64])
            .collect();
        let table = OptionalLikelihood::new(TableLikelihood::from_rows(&table).unwrap());
        let known = OptionalLikelihood::new(SparseLikelihood::new(self.model.states));
        FusedLikelihood::new(table, known).unwrap()
    }

    fn hmm(&self) -> Nested {
        let (a, sensor) = (self.nested(), self.sensor());
        let prior = Prior::AtFirstObservation(a.arriving(&self.belief()).unwrap());
        let sensor = GroupedLikelihood::new(sensor, a.groups().clone()).unwrap();
        Hmm::new(prior, a, sensor).unwrap()
    }
}

type Place =
    FusedLikelihood<OptionalLikelihood<TableLikelihood>, OptionalLikelihood<SparseLikelihood>>;
type Nested =
    Hmm<DwellTransition<RestartTransition<Fixed<ConstrainedTransition>>>, GroupedLikelihood<Place>>;
type Pairs =
    Hmm<KroneckerTransition<WindowTransition, SparseTransition>, LikelihoodVector<Vec<f64>>>;

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn operators_are_the_same_to_the_bit(parts in parts()) {
        let n = parts.model.states;
        let restart = |a| RestartTransition::new(a, parts.rate, parts.belief()).unwrap();
        operator(&parts.model.dense(), &0);
        operator(&parts.model.sparse(), &(parts.model.steps() - 1));
        operator(&parts.tied(), &());
        prop_assert_eq!(stored(&parts.tied()).parameters(), parts.tied().parameters());
        operator(&parts.nested(), &());
        operator(&restart(parts.sparse()), &());
        let rates = DistractionRates { begin: parts.rate, end: 0.25 };
        let distracted = DistractedTransition::new(restart(parts.sparse()), rates).unwrap();
        let control = stored(&Distraction { control: (), begins: 0.1, continues: parts.rate });
        operator(&distracted, &control);
        prop_assert_eq!(stored(&distracted).rates(), stored(&rates));
        let leaving: Vec<_> = (0..n).map(|i| vec![parts.rate, 1.0 / (3.0 + i as f64)]).collect();
        let leaving = DwellTransition::from_leaving(parts.model.sparse(), &leaving).unwrap();
        operator(&RestartTransition::new(
            leaving.clone(), parts.rate, leaving.arriving(&parts.belief()).unwrap()).unwrap(), &0);
        if let Some(window) = parts.window() {
            operator(&window, &());
            let pairs = KroneckerTransition::new(window, parts.sparse()).unwrap();
            operator(&pairs, &());
            operator(&SwitchedTransition::new(vec![pairs.clone(), pairs]).unwrap(), &1);
        }
    }

    /// Learned operators, some of whose entries have vanished.
    #[test]
    fn learned_models_are_the_same_to_the_bit(parts in parts(), ys in vec(0..3_usize, 1..6)) {
        let table = vec![[0.6, 0.3, 0.1]; parts.model.states];
        let sensor = TableLikelihood::from_rows(&table).unwrap();
        let hmm = Hmm::new(Prior::AtFirstObservation(parts.belief()), parts.tied(), sensor).unwrap();
        let learning = LearningOptions::default().with_iterations(3);
        if let Ok(learned) = hmm.learn(&[ys], &learning) {
            let model = learned.model();
            operator(model.transition(), &());
            prop_assert_eq!(stored(model).transition().parameters(), model.transition().parameters());
        }
    }

    /// A filter, and a smoother with a lag, that are stored with their model after any step, and
    /// continue.
    #[test]
    fn to_stop_changes_no_bit(model in models(Kind::Extreme), stop in 0..7_usize, lag in 0..4_usize) {
        let hmm = model.hmm(model.sparse());
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
        let states = |path: Option<wayfix::inference::ViterbiPath>| path.map(|path| path.states().to_vec());
        prop_assert_eq!(states(paths.0), states(paths.1));
    }

    /// Any change to a file gives an error or a usable value.
    #[test]
    fn damaged_files_are_refused_or_valid(parts in parts(), damage in damage()) {
        let n = parts.model.states;
        if let Ok(hmm) = serde_json::from_str::<Nested>(&damage.of(&json(&parts.hmm()))) {
            check_columns(hmm.transition(), &())?;
            let _ = hmm.smooth(&[(Some(0), None), (None, Some(SparseObservation::known(0))), (Some(1), None)]);
            let _ = hmm.viterbi(&[(Some(0), None), (None, Some(SparseObservation::known(0))), (Some(1), None)]);
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
        let dense = damage.of(&json(&parts.model.dense()));
        if let Ok(dense) = serde_json::from_str::<SwitchedTransition<DenseTransition>>(&dense) {
            check_columns(&dense, &0)?;
        }
        let hmm = parts.model.hmm(parts.model.sparse());
        let mut smoother = hmm.fixed_lag(2);
        for (step, y) in parts.model.logs.iter().enumerate() {
            let text = damage.of(&json(&smoother.snapshot()));
            if let Ok(state) = serde_json::from_str::<FixedLagSnapshot<usize>>(&text) {
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
