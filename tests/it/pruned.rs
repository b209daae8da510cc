//! The pruned filter against the exact one: its bound holds, and it drops nothing that it must
//! keep.

use std::ops::RangeInclusive;
use std::sync::Arc;

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::inference::{Certificate, Pruning};
use wayfix::likelihood::{LocalLikelihood, SparseObservation};
use wayfix::{
    Belief, Fixed, FusedLikelihood, Hmm, HmmError, Likelihood, LikelihoodVector,
    OptionalLikelihood, Prior, PrunedFilter, Scratch, SparseLikelihood, SparseTransition,
    TableLikelihood, TransitionEntries, canberra,
};

use crate::kit::{Own, cases_of, matrix, prior, rng, weighted};

/// A model of a few states, and observations: an optional symbol, and a list.
#[derive(Debug, Clone)]
struct Case {
    states: usize,
    at_first: bool,
    prior: Vec<f64>,
    /// `columns[from]` lists the moves out of a state.
    columns: Vec<Vec<f64>>,
    /// `table[state][symbol]`.
    table: Vec<Vec<f64>>,
    seen: Vec<(Option<usize>, SparseObservation)>,
    pruning: Pruning,
}

type Sensor = FusedLikelihood<OptionalLikelihood<TableLikelihood>, SparseLikelihood>;

impl Case {
    fn prior(&self) -> Prior {
        prior(&self.prior, self.at_first)
    }

    fn hmm(&self) -> Hmm<SparseTransition, Sensor> {
        let entries = self.columns.iter().enumerate();
        let entries = entries.flat_map(|(from, column)| {
            column.iter().enumerate().map(move |(to, p)| (to, from, *p))
        });
        let motion = SparseTransition::from_triplets(self.states, entries).unwrap();
        Hmm::new(self.prior(), motion, self.sensor()).unwrap()
    }

    fn sensor(&self) -> Sensor {
        let camera = OptionalLikelihood::new(TableLikelihood::from_rows(&self.table).unwrap());
        FusedLikelihood::new(camera, SparseLikelihood::new(self.states)).unwrap()
    }

    /// The model with a matrix-free operator.
    fn by_lists(&self) -> Hmm<Own, Sensor> {
        let own = Own(matrix(self.states, |to, from| self.columns[from][to]));
        Hmm::new(self.prior(), own, self.sensor()).unwrap()
    }

    fn prunes(&self) -> bool {
        self.pruning.tolerance > 0.0 || self.pruning.most_active < self.states
    }

    fn likelihood(&self, k: usize, i: usize) -> f64 {
        let (symbol, list) = &self.seen[k];
        let listed = list.listed().iter().find(|entry| entry.0 == i).map(|entry| entry.1);
        symbol.map_or(1.0, |y| self.table[i][y]) * listed.unwrap_or(list.elsewhere())
    }

    /// The exact beliefs and log-likelihoods, up to the first impossible step.
    fn exact(&self) -> Vec<(Vec<f64>, f64)> {
        let n = self.states;
        let (mut belief, mut log, mut all) = (self.prior.clone(), 0.0, Vec::new());
        for k in 0..self.seen.len() {
            let moved = |i: usize| (0..n).map(|j| self.columns[j][i] * belief[j]).sum();
            let predicted: Vec<f64> =
                if k == 0 && self.at_first { belief.clone() } else { (0..n).map(moved).collect() };
            let joint: Vec<f64> = (0..n).map(|i| self.likelihood(k, i) * predicted[i]).collect();
            let sum: f64 = joint.iter().sum();
            if sum == 0.0 {
                break;
            }
            belief = joint.iter().map(|p| p / sum).collect();
            log += sum.ln();
            all.push((belief.clone(), log));
        }
        all
    }
}

fn weight() -> impl Strategy<Value = f64> {
    prop_oneof![4 => Just(0.0), 3 => 0.05..1.0, 1 => Just(1e-6), 1 => Just(1e-12)]
}

/// Models of few states, and of enough for exact steps while many are active.
fn instances() -> impl Strategy<Value = Case> {
    prop_oneof![3 => models(2..=9), 1 => models(17..=40)]
}

fn models(states: RangeInclusive<usize>) -> impl Strategy<Value = Case> {
    (states, 1..=25_usize, 1..=3_usize).prop_flat_map(|(n, steps, symbols)| {
        let distribution = move |n| weighted(weight(), n);
        let list = (vec((0..n, weight()), 0..=n), prop_oneof![1 => Just(0.0), 4 => 1e-3..1.0]);
        let list = list.prop_map(|(mut listed, elsewhere)| {
            listed.sort_by_key(|entry| entry.0);
            listed.dedup_by_key(|entry| entry.0);
            SparseObservation::new(listed, elsewhere).unwrap()
        });
        let symbol = prop_oneof![1 => Just(None), 3 => (0..symbols).prop_map(Some)];
        let tolerance = prop_oneof![Just(0.0), Just(1e-12), Just(1e-3), Just(1.0), Just(1e8)];
        let most_active = prop_oneof![if n < 10 { 1 } else { 4 } => Just(usize::MAX), 2 => 1..=n];
        (
            any::<bool>(),
            distribution(n),
            vec(distribution(n), n),
            vec(distribution(symbols), n),
            vec((symbol, list), steps),
            (tolerance, most_active),
        )
            .prop_map(move |(at_first, prior, columns, table, seen, pruning)| {
                let (tolerance, most_active) = pruning;
                let pruning =
                    Pruning::default().with_tolerance(tolerance).with_most_active(most_active);
                Case { states: n, at_first, prior, columns, table, seen, pruning }
            })
    })
}

fn distance<M, A, B>(pruned: &PrunedFilter<M>, exact: &[f64]) -> f64
where
    M: std::ops::Deref<Target = Hmm<A, B>>,
    A: TransitionEntries<Control = ()>,
    B: LocalLikelihood,
{
    let difference = |(i, p): (usize, &f64)| (p - pruned.probability(i).unwrap()).abs();
    0.5 * exact.iter().enumerate().map(difference).sum::<f64>()
}

proptest! {
    #![proptest_config(cases_of(2500))]

    #[test]
    fn the_bound_holds_at_each_step(case in instances()) {
        check_bound(&case, &case.hmm())?;
    }

    /// Models that use only lists, also from many states.
    #[test]
    fn the_bound_holds_at_each_step_by_lists(case in instances()) {
        check_bound(&case, &case.by_lists())?;
    }

    #[test]
    fn without_tolerance_it_is_the_exact_filter(case in instances()) {
        check_exact(&case, &case.hmm())?;
    }

    #[test]
    fn without_tolerance_it_is_the_exact_filter_by_lists(case in instances()) {
        check_exact(&case, &case.by_lists())?;
    }

    /// Steps, predictions and updates in any order, with a restart from bytes at one.
    #[test]
    fn the_bound_holds_after_each_verb(
        case in instances(),
        verbs in vec(0..4_u8, 25),
        stop in 0..25_usize,
    ) {
        check_verbs(&case, &case.hmm(), &verbs, stop)?;
        check_verbs(&case, &case.by_lists(), &verbs, stop)?;
    }
}

type Model<A> = Hmm<A, Sensor>;

fn check_bound<A>(case: &Case, hmm: &Model<A>) -> Result<(), TestCaseError>
where
    A: TransitionEntries<Control = ()>,
{
    let mut pruned = hmm.pruned_filter(case.pruning);
    let exact = case.exact();
    for (k, seen) in case.seen.iter().enumerate() {
        let before = (pruned.active().to_vec(), pruned.probabilities().to_vec());
        let step = pruned.step(seen);
        let Some((belief, log)) = exact.get(k) else {
            // An impossible observation is never taken for possible.
            let impossible = HmmError::Impossible { step: k + 1 }.to_string();
            let dropped = HmmError::Pruned { step: k + 1 }.to_string();
            let error = step.unwrap_err().to_string();
            prop_assert!(error == impossible || error == dropped, "{}", error);
            prop_assert!(case.prunes() || error == impossible);
            break;
        };
        match step {
            Ok(certificate) => {
                let (found, bound) = (distance(&pruned, belief), certificate.bound());
                prop_assert!(found <= bound + 1e-14, "step {}: {found:e} > {bound:e}", k + 1);
                prop_assert!((0.0..=1.0).contains(&bound));
                prop_assert_eq!(certificate.holds(), bound <= case.pruning.tolerance);
                prop_assert_eq!(certificate, pruned.certificate());
                let range = pruned.log_likelihood();
                prop_assert!(
                    range.start() - 1e-10 <= *log && *log <= range.end() + 1e-10,
                    "step {}: {log} in {range:?}",
                    k + 1
                );
                let sum: f64 = pruned.probabilities().iter().sum();
                prop_assert!((sum - 1.0).abs() < 1e-14);
                prop_assert!(pruned.active().is_sorted_by(|a, b| a < b));
                prop_assert!(pruned.active().len() <= case.pruning.most_active);
                prop_assert_eq!(pruned.steps(), k + 1);
            }
            Err(error) => {
                // The observation is possible, so it must not be reported as impossible.
                let expected = HmmError::Pruned { step: k + 1 }.to_string();
                prop_assert_eq!(error.to_string(), expected);
                prop_assert!(case.prunes());
                prop_assert_eq!(pruned.active(), before.0);
                prop_assert_eq!(pruned.probabilities(), before.1);
                prop_assert_eq!(pruned.steps(), k);
                break;
            }
        }
    }
    Ok(())
}

fn check_exact<A>(case: &Case, hmm: &Model<A>) -> Result<(), TestCaseError>
where
    A: TransitionEntries<Control = ()>,
{
    let mut exact = hmm.filter();
    let mut pruned = hmm.pruned_filter(Pruning::default().with_tolerance(0.0));
    for seen in &case.seen {
        match exact.step(seen) {
            Ok(_) => {
                let bound = pruned.step(seen).unwrap().bound();
                // The bound includes rounding, which unlikely observations magnify.
                prop_assert!(bound < 1e-6, "{bound:e}");
                for (i, p) in exact.belief().as_slice().iter().enumerate() {
                    let found = pruned.probability(i).unwrap();
                    prop_assert!((found - p).abs() <= 1e-12 * p, "{i}: {found:e}, {p:e}");
                }
                let range = pruned.log_likelihood();
                let log = exact.log_likelihood();
                prop_assert!((range.start() - log).abs() <= 1e-11 * (1.0 + log.abs()));
                prop_assert!((range.end() - log).abs() <= 1e-11 * (1.0 + log.abs()));
                let largest = exact.belief().as_slice().iter().copied().fold(0.0, f64::max);
                prop_assert!(pruned.probability(pruned.mode()).unwrap() >= largest * (1.0 - 1e-12));
            }
            Err(error) => {
                let found = pruned.step(seen).unwrap_err();
                prop_assert_eq!(found.to_string(), error.to_string());
            }
        }
    }
    Ok(())
}

fn check_verbs<A>(
    case: &Case,
    hmm: &Model<A>,
    verbs: &[u8],
    stop: usize,
) -> Result<(), TestCaseError>
where
    A: TransitionEntries<Control = ()>,
{
    let n = case.states;
    let mut pruned = hmm.pruned_filter(case.pruning);
    let (mut belief, mut log, mut steps) = (case.prior.clone(), 0.0, 0);
    for (k, (seen, verb)) in case.seen.iter().zip(verbs).enumerate() {
        let before = pruned.snapshot();
        let (moves, sees) = (!matches!(verb, 1 | 2), *verb > 0);
        if moves && (steps > 0 || !case.at_first) {
            let moved = |i: usize| (0..n).map(|j| case.columns[j][i] * belief[j]).sum();
            belief = (0..n).map(moved).collect();
        }
        steps += usize::from(moves || (steps == 0 && case.at_first));
        if sees {
            belief.iter_mut().enumerate().for_each(|(i, p)| *p *= case.likelihood(k, i));
        }
        let sum: f64 = belief.iter().sum();
        belief.iter_mut().for_each(|p| *p /= sum);
        log += sum.ln();
        let found = match (moves, sees) {
            (true, false) => pruned.predict(),
            (false, _) => pruned.update(seen),
            (true, true) => pruned.step(seen),
        };
        let possible = sum > 0.0;
        prop_assert!(possible || found.is_err());
        let certificate = match found {
            Ok(certificate) => certificate,
            Err(error) => {
                // (A possible observation may only be reported as possibly dropped.)
                let dropped = matches!(error, HmmError::Pruned { .. });
                prop_assert!(dropped || !possible, "{}", error);
                prop_assert_eq!(pruned.snapshot(), before);
                break;
            }
        };
        let bound = certificate.bound();
        let distance = distance(&pruned, &belief);
        // (The reference has rounding errors of its own.)
        prop_assert!(distance <= bound + 1e-14, "{k}, verb {verb}: {distance:e} > {bound:e}");
        prop_assert_eq!(certificate, pruned.certificate());
        prop_assert_eq!(pruned.steps(), steps);
        let range = pruned.log_likelihood();
        prop_assert!(range.start() - 1e-10 <= log && log <= range.end() + 1e-10);
        if k == stop {
            let snapshot = pruned.snapshot();
            prop_assert_eq!(snapshot.certificate(), certificate);
            // Into a filter with another state.
            let mut other = hmm.pruned_filter(Pruning::default());
            let _ = other.step(&case.seen[0]);
            other.restore(&snapshot).unwrap();
            prop_assert_eq!(&other.snapshot(), &snapshot);
            prop_assert_eq!(other.log_likelihood(), pruned.log_likelihood());
            let _ = pruned.predict().and_then(|_| pruned.step(seen));
            let _ = other.predict().and_then(|_| other.step(seen));
            prop_assert_eq!(other.snapshot(), pruned.snapshot());
            pruned.restore(&snapshot).unwrap();
            prop_assert_eq!(pruned.snapshot(), snapshot);
            for i in 0..case.states {
                let at = pruned.active().iter().position(|active| *active == i);
                let p = at.map_or(0.0, |at| pruned.probabilities()[at]);
                prop_assert_eq!(pruned.probability(i), Some(p));
            }
        }
    }
    Ok(())
}

/// From a wide belief, products with the whole matrix and lists agree.
#[test]
fn a_wide_start_goes_over_to_lists() {
    let n = 3000;
    let motion = ring(n);
    let rows: Vec<Vec<(usize, f64)>> = (0..n).map(|i| motion.incoming(&(), i).collect()).collect();
    let prior = || Prior::AtFirstObservation(Belief::uniform(n).unwrap());
    let sensor = || LikelihoodVector::linear(n);
    let whole = Hmm::new(prior(), motion, sensor()).unwrap();
    let lists = Hmm::new(prior(), Listed(rows), sensor()).unwrap();
    for most_active in [usize::MAX, 1500] {
        let pruning = Pruning::default().with_most_active(most_active);
        let mut exact = whole.filter();
        let (mut one, mut other) = (whole.pruned_filter(pruning), lists.pruned_filter(pruning));
        let mut counts = Vec::new();
        for k in 0..40_usize {
            // Observations are vague at first, then show the place.
            let sharp = 0.02 * (k as f64 - 3.0).max(0.0);
            let like = |i: usize| {
                let off = i.abs_diff(700 + k * 3 / 4) as f64;
                (-sharp * off.min(60.0)).exp() * (1.0 + 0.1 * (i as f64).sin())
            };
            let y: Vec<f64> = (0..n).map(like).collect();
            exact.step(&y[..]).unwrap();
            let bounds = [one.step(&y[..]).unwrap(), other.step(&y[..]).unwrap()];
            let belief = exact.belief().as_slice();
            for (found, bound) in [distance(&one, belief), distance(&other, belief)]
                .into_iter()
                .zip(bounds.map(Certificate::bound))
            {
                assert!(found <= bound, "step {k}: {found:e} > {bound:e}");
            }
            let range = one.log_likelihood();
            let log = exact.log_likelihood();
            assert!(range.start() - 1e-9 <= log && log <= range.end() + 1e-9, "{range:?} {log}");
            let [one_bound, other_bound] = bounds.map(Certificate::bound);
            assert!((one_bound - other_bound).abs() <= 1e-3 * other_bound + 1e-12);
            // Exact steps drop nothing before few states are left, and keep what lists drop earlier.
            let (by_products, by_lists) = (one.active().len(), other.active().len());
            assert!(by_products >= by_lists, "{by_products}, {by_lists}");
            counts.push(one.active().len());
        }
        let many = if most_active < n { most_active } else { n };
        assert!(counts[0] == many && counts[39] < n / 5, "{counts:?}");
        assert_eq!(one.certificate().holds(), most_active == usize::MAX);
    }
}

/// Entries by row, without a stored matrix.
struct Listed(Vec<Vec<(usize, f64)>>);

impl wayfix::Transition for Listed {
    type Control = ();
    fn states(&self) -> usize {
        self.0.len()
    }
    fn apply(&self, (): &(), x: &[f64], out: &mut [f64]) {
        for (out, row) in out.iter_mut().zip(&self.0) {
            *out = row.iter().map(|(j, a)| a * x[*j]).sum();
        }
    }
    fn apply_transpose(&self, (): &(), x: &[f64], out: &mut [f64]) {
        out.fill(0.0);
        for (x, row) in x.iter().zip(&self.0) {
            row.iter().for_each(|(j, a)| out[*j] += a * x);
        }
    }
}

impl TransitionEntries for Listed {
    fn incoming(&self, (): &(), to: usize) -> impl Iterator<Item = (usize, f64)> {
        self.0[to].iter().copied()
    }
    fn outgoing(&self, (): &(), from: usize) -> impl Iterator<Item = (usize, f64)> {
        // (On the ring: stay or go on to the next.)
        let n = self.0.len();
        let to = [from, (from + 1) % n];
        to.into_iter().flat_map(move |i| {
            self.0[i].iter().filter(move |entry| entry.0 == from).map(move |entry| (i, entry.1))
        })
    }
}

#[test]
fn a_snapshot_of_another_model_is_refused() {
    let models =
        [4, 5].map(|n| Hmm::new(certain(n, 0), ring(n), SparseLikelihood::new(n)).unwrap());
    let snapshot = models[0].pruned_filter(Pruning::default()).snapshot();
    let mut other = models[1].pruned_filter(Pruning::default());
    let before = other.snapshot();
    assert_eq!(
        other.restore(&snapshot).unwrap_err().to_string(),
        "the snapshot has 4 states, expected 5 to match the model"
    );
    assert_eq!(other.snapshot(), before);
}

/// A loop of places: stay or go on to the next.
fn ring(n: usize) -> SparseTransition {
    let moves = (0..n).flat_map(|j| [(j, j, 0.25), ((j + 1) % n, j, 0.75)]);
    SparseTransition::from_triplets(n, moves).unwrap()
}

fn certain(n: usize, state: usize) -> Prior {
    Prior::AtFirstObservation(Belief::certain(n, state).unwrap())
}

fn seen(place: usize, others: f64) -> SparseObservation {
    SparseObservation::new(vec![(place, 1.0)], others).unwrap()
}

#[test]
fn on_the_map_few_places_prove_much_over_long_drives() {
    for (sigma, seed) in [(1.0, 1), (2.0, 2), (2.0, 3)] {
        let hmm = canberra::hmm(5, sigma).unwrap();
        let drive = hmm.simulate(5000, &mut rng(seed));
        let (mut exact, mut pruned) = (hmm.filter(), hmm.pruned_filter(Pruning::default()));
        let mut active = 0;
        for y in drive.observations() {
            exact.step(y).unwrap();
            let certificate = pruned.step(y).unwrap();
            assert!(certificate.holds() && certificate.bound() < 1e-6);
            assert!(distance(&pruned, exact.belief().as_slice()) <= certificate.bound());
            active += pruned.active().len();
        }
        assert!(active < 15 * 5000, "{active}");
        let range = pruned.log_likelihood();
        assert!(range.contains(&exact.log_likelihood()), "{range:?}");
        assert!(range.end() - range.start() < 1e-4, "{range:?}");
    }
}

#[test]
fn what_cannot_be_held_is_said_and_comes_back() {
    let n = 1000;
    let hmm = Hmm::new(certain(n, 100), ring(n), SparseLikelihood::new(n)).unwrap();
    let pruning = Pruning::default().with_most_active(5);
    let (mut exact, mut pruned) = (hmm.filter(), hmm.pruned_filter(pruning));
    // Without observations, the belief spreads to more places than are allowed.
    let blind = SparseObservation::new(vec![], 1.0).unwrap();
    for _ in 0..40 {
        exact.step(&blind).unwrap();
        let certificate = pruned.step(&blind).unwrap();
        assert!(pruned.active().len() <= 5);
        assert!(distance(&pruned, exact.belief().as_slice()) <= certificate.bound());
    }
    let lost = pruned.certificate();
    assert!(matches!(lost, Certificate::Exceeded(bound) if bound > 0.5), "{lost:?}");
    // Then the vehicle is seen again, each time at the next place.
    for place in 130..140 {
        exact.step(&seen(place, 1e-6)).unwrap();
        let certificate = pruned.step(&seen(place, 1e-6)).unwrap();
        assert!(distance(&pruned, exact.belief().as_slice()) <= certificate.bound());
    }
    let found = pruned.certificate();
    assert!(found.holds(), "{found:?}");
    assert_eq!(pruned.mode(), 139);
}

#[test]
fn a_place_where_nothing_led_is_not_denied() {
    let n = 100;
    let hmm = Hmm::new(certain(n, 10), ring(n), SparseLikelihood::new(n)).unwrap();
    let mut pruned = hmm.pruned_filter(Pruning::default().with_most_active(1));
    pruned.step(&seen(10, 0.1)).unwrap();
    pruned.step(&seen(10, 0.1)).unwrap(); // place 11 is dropped
    let before = (pruned.active().to_vec(), pruned.log_likelihood(), pruned.certificate());
    assert_eq!(
        pruned.step(&seen(13, 0.0)).unwrap_err().to_string(),
        "the observation of step 3 is impossible in all states that were not pruned"
    );
    assert_eq!((pruned.active().to_vec(), pruned.log_likelihood(), pruned.certificate()), before);
    // The observation is impossible everywhere.
    let nothing = SparseObservation::new(vec![], 0.0).unwrap();
    assert_eq!(
        pruned.step(&nothing).unwrap_err().to_string(),
        "the observation of step 3 is impossible under the model"
    );
    assert_eq!(
        pruned.step(&seen(n, 0.5)).unwrap_err().to_string(),
        format!(
            "step 3 has no valid likelihood: the observation lists state {n}, but there are {n} states (0 to {})",
            n - 1
        )
    );
    pruned.step(&seen(10, 0.1)).unwrap();
    assert_eq!((pruned.steps(), pruned.mode()), (3, 10));
}

#[test]
fn restart_and_relocate_begin_anew() {
    let n = 50;
    let hmm = Arc::new(Hmm::new(certain(n, 10), ring(n), SparseLikelihood::new(n)).unwrap());
    let mut pruned = PrunedFilter::new(Arc::clone(&hmm), Pruning::default());
    let drive: Vec<_> = (10..20).map(|place| seen(place, 1e-3)).collect();
    let run = |pruned: &mut PrunedFilter<Arc<_>>| {
        let bounds: Vec<_> = drive.iter().map(|y| pruned.step(y).unwrap().bound()).collect();
        (bounds, pruned.active().to_vec(), pruned.probabilities().to_vec(), pruned.log_likelihood())
    };
    let first = run(&mut pruned);
    pruned.restart();
    assert_eq!((pruned.steps(), pruned.active()), (0, &[10][..]));
    assert_eq!(pruned.log_likelihood(), 0.0..=0.0);
    assert_eq!(run(&mut pruned), first);

    let log = pruned.log_likelihood();
    pruned.relocate(&Belief::certain(n, 40).unwrap()).unwrap();
    assert_eq!((pruned.active(), pruned.mode(), pruned.steps()), (&[40][..], 40, 10));
    assert_eq!(pruned.probability(19), Some(0.0));
    assert_eq!(pruned.probability(n), None);
    assert_eq!(pruned.certificate(), Certificate::Within(0.0));
    assert!(pruned.log_likelihood().start() == log.start());
    let text = pruned.relocate(&Belief::uniform(3).unwrap()).unwrap_err().to_string();
    assert_eq!(text, "the belief has 3 states, expected 50 to match the model");
    // A prediction moves on without an observation.
    pruned.predict().unwrap();
    assert_eq!((pruned.active(), pruned.probabilities()), (&[40, 41][..], &[0.25, 0.75][..]));
}

#[test]
fn likelihoods_of_any_scale_and_far_tails_are_held() {
    let n = 30;
    let sensor = LikelihoodVector::log(n);
    let hmm = Hmm::new(certain(n, 3), ring(n), sensor).unwrap();
    let (mut exact, mut pruned) = (hmm.filter(), hmm.pruned_filter(Pruning::default()));
    for k in 0..200 {
        let place = (3 + k / 2) % n;
        let log = |i: usize| -90_000.0 - 40.0 * (i.abs_diff(place) as f64);
        let logs: Vec<f64> = (0..n).map(log).collect();
        exact.step(&logs).unwrap();
        let bound = pruned.step(&logs).unwrap().bound();
        let found = distance(&pruned, exact.belief().as_slice());
        assert!(found <= bound + 1e-15, "step {k}: {found:e} {bound:e}");
    }
    let (range, log) = (pruned.log_likelihood(), exact.log_likelihood());
    assert!((range.start() - log).abs() < 1e-3 && (range.end() - log).abs() < 1e-3, "{range:?}");
}

/// A sensor's local likelihoods are those of its full diagonal.
fn check_local<B: LocalLikelihood>(sensor: &B, y: &B::Observation) {
    let n = sensor.states();
    let model = |sensor| {
        let prior = Prior::AtFirstObservation(Belief::uniform(n).unwrap());
        Hmm::new(prior, ring(n), sensor).unwrap()
    };
    let hmm = model(sensor);
    let mut exact = hmm.filter();
    let log = exact.step(y);
    for chosen in 0..1_usize << n {
        let states: Vec<usize> = (0..n).filter(|i| chosen >> i & 1 == 1).collect();
        let mut scratch = Scratch::default();
        let (found, others) = sensor.local(y, &states, &mut scratch).unwrap();
        let Ok(log) = log else { return };
        // p(i | y) n p(y) is the likelihood, for a uniform prior.
        let likelihood = |i: usize| exact.belief().as_slice()[i] * n as f64;
        let scale = found.log_factor() - log;
        let scaled = |b: f64| if found.is_log() { (b + scale).exp() } else { b * scale.exp() };
        assert_eq!(found.as_slice().len(), states.len());
        for (&i, &b) in states.iter().zip(found.as_slice()) {
            assert!((scaled(b) - likelihood(i)).abs() < 1e-12, "{i} of {states:?}");
        }
        let missing = (0..n).filter(|i| chosen >> i & 1 == 0).map(likelihood);
        let largest = missing.fold(0.0, f64::max);
        assert!(scaled(others) >= largest - 1e-12, "{states:?}");
    }
    let mut wanted = Vec::new();
    sensor.listed_states(y, &mut wanted);
    assert!(wanted.iter().all(|&i| i < n));
}

#[test]
fn local_likelihoods_are_those_of_the_diagonal() {
    let rows: Vec<_> =
        (1..=6).map(|i| [0.1 * f64::from(i), 0.0, 1.0 - 0.1 * f64::from(i)]).collect();
    let table = TableLikelihood::from_rows(&rows).unwrap();
    for symbol in [0, 2] {
        check_local(&table, &symbol);
        check_local(&Fixed(Arc::new(table.clone())), &symbol);
        check_local(&OptionalLikelihood::new(table.clone()), &Some(symbol));
        let known = OptionalLikelihood::new(SparseLikelihood::new(6));
        let fused = FusedLikelihood::new(table.clone(), known).unwrap();
        check_local(&fused, &(symbol, None));
        check_local(&fused, &(symbol, Some(SparseObservation::known(4))));
        let far = FusedLikelihood::new(LikelihoodVector::log(6).owned(), table.clone()).unwrap();
        check_local(&far, &(vec![-700.0, -701.0, f64::NEG_INFINITY, -702.0, -700.5, -9e9], symbol));
    }
    check_local(&OptionalLikelihood::new(table), &None);
    check_local(&LikelihoodVector::linear(6), &[0.5, 0.0, 2.0, 1e-9, 0.25, 0.75]);
    let small = [1e-200, 0.0, 2e-200, 1e-209, 3e-200, 4e-200].to_vec();
    let linear = || LikelihoodVector::linear(6).owned();
    check_local(&FusedLikelihood::new(linear(), linear()).unwrap(), &(small.clone(), small));
    check_local(&SparseLikelihood::new(6), &SparseObservation::new(vec![(2, 0.5)], 0.1).unwrap());
    check_local(&SparseLikelihood::new(6), &SparseObservation::known(3));
    // Also for more states than those that stand out.
    let rows: Vec<_> = (0..20).map(|i| [0.01 * f64::from(i), 1.0 - 0.01 * f64::from(i)]).collect();
    let table = TableLikelihood::from_rows(&rows).unwrap();
    let ask = |states: &[usize]| table.local(&0, states, &mut Scratch::default()).unwrap().1;
    assert_eq!(ask(&[]), 0.19);
    assert_eq!(ask(&[18, 19]), 0.17);
    assert_eq!(ask(&(4..20).collect::<Vec<_>>()), 0.04);
    assert_eq!(ask(&(0..20).collect::<Vec<_>>()), 0.0);
}

#[test]
fn errors_of_a_sensor_say_what_is_wrong() {
    let sensor = LikelihoodVector::linear(2);
    let text = |y: &[f64]| sensor.local(y, &[0], &mut Scratch::default()).unwrap_err().to_string();
    assert_eq!(text(&[1.0]), "the likelihood has 1 values, expected one for each of 2 states");
    assert_eq!(
        text(&[1.0, -1.0]),
        "state 1 has likelihood -1, expected a finite value of at least 0"
    );
    let known = SparseObservation::known(2);
    let (sensor, mut scratch) = (SparseLikelihood::new(2), Scratch::default());
    assert_eq!(
        sensor.local(&known, &[], &mut scratch).unwrap_err().to_string(),
        "the observation lists state 2, but there are 2 states (0 to 1)"
    );
}

/// A user's sensor that returns nonsense.
struct Wrong {
    value: f64,
    others: f64,
    log_factor: f64,
}

impl Likelihood for Wrong {
    type Observation = ();
    fn states(&self) -> usize {
        2
    }
    fn diagonal<'a>(
        &'a self,
        (): &(),
        scratch: &'a mut Scratch,
    ) -> Result<wayfix::Diagonal<'a>, wayfix::LikelihoodError> {
        Ok(wayfix::Diagonal::linear(scratch.values(2)))
    }
}

impl LocalLikelihood for Wrong {
    fn local<'a>(
        &'a self,
        (): &(),
        states: &[usize],
        scratch: &'a mut Scratch,
    ) -> Result<(wayfix::Diagonal<'a>, f64), wayfix::LikelihoodError> {
        let values = scratch.values(states.len());
        values.fill(self.value);
        Ok((wayfix::Diagonal::linear(values).with_log_factor(self.log_factor), self.others))
    }
}

#[test]
fn nonsense_of_a_sensor_is_an_error_with_the_step() {
    for (sensor, expected) in [
        (
            Wrong { value: f64::NAN, others: 0.0, log_factor: 0.0 },
            "state 0 has likelihood NaN, expected a finite value of at least 0",
        ),
        (
            Wrong { value: 1.0, others: f64::INFINITY, log_factor: 0.0 },
            "the likelihood of unlisted states is bounded by inf, expected a finite value of at least 0",
        ),
        (
            Wrong { value: 1.0, others: 1.0, log_factor: f64::NAN },
            "the log factor is NaN, expected a value from -1e300 to 1e300",
        ),
    ] {
        let hmm = Hmm::new(certain(2, 0), ring(2), sensor).unwrap();
        let error = hmm.pruned_filter(Pruning::default()).step(&()).unwrap_err();
        let expected = format!("step 1 has no valid likelihood: {expected}");
        assert_eq!(error.to_string(), expected);
        let error = hmm.beam_viterbi(&[()], 1.0).unwrap_err();
        assert_eq!(error.to_string(), expected);
    }
}
